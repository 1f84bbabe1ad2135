"""LAMMPS and LIGGGHTS as programs: found, known by what they say, and caught as copies."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import sysconfig
from functools import cache
from pathlib import Path

import pytest
from conftest import program, tiny_tank

import liftdrag.tank
from liftdrag.deck import Plan
from liftdrag.deck.dialect import LAMMPS, LAMMPS_2021, LAMMPS_2023, LIGGGHTS
from liftdrag.engines import ENGINES, checks, engine, mpi
from liftdrag.engines.program import LIGGGHTS_BINARY, LMP, Kind, Program
from liftdrag.errors import InputError, RunFailed
from liftdrag.runner import run

BANNER = "Large-scale Atomic/Molecular Massively Parallel Simulator - "
LIGGGHTS_SAYS = "LIGGGHTS (Version LIGGGHTS-PUBLIC 3.8.0, compiled 2022-01-26 by buildd)"

KINDS = (LMP, LIGGGHTS_BINARY)
INSTALLED = {LMP: Path("/usr/bin/lmp"), LIGGGHTS_BINARY: Path("/usr/bin/liggghts")}

needs_both = pytest.mark.needs("lmp", "liggghts")
each_kind = pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)


@cache
def debians(kind: Kind) -> Program:
    """The installed program, asked once what it is."""
    return Program(kind, INSTALLED[kind])


def lmp_of(folder: Path, version: str) -> Program:
    """A program that says that it is this version of LAMMPS."""
    return Program(LMP, program(folder / "lmp", "", BANNER + version, "", "Usage example: lmp"))


@pytest.fixture(autouse=True)
def no_variables(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing of the tester's own engines and MPI job."""
    for kind in KINDS:
        monkeypatch.delenv(kind.variable, raising=False)
    for name in ("PMI_SIZE", "OMPI_COMM_WORLD_SIZE", "SLURM_STEP_NUM_TASKS"):
        monkeypatch.delenv(name, raising=False)


def search(monkeypatch: pytest.MonkeyPatch, *folders: Path) -> None:
    monkeypatch.setenv("PATH", os.pathsep.join(map(str, folders)))


def refusal(found: Program) -> str:
    """The sentence that its path is refused with."""
    with pytest.raises(InputError) as caught:
        assert found.path
    return str(caught.value)


@each_kind
def test_a_program_is_the_first_on_the_path(kind, tmp_path, monkeypatch):
    one, two = (program(tmp_path / folder / kind.name) for folder in "ab")
    search(monkeypatch, tmp_path / "empty", two.parent, one.parent)
    assert Program(kind).path == two


@each_kind
def test_a_file_that_does_not_run_is_passed_over(kind, tmp_path, monkeypatch):
    plain, runs = (program(tmp_path / folder / kind.name) for folder in "ab")
    plain.chmod(0o644)
    search(monkeypatch, plain.parent, runs.parent)
    assert Program(kind).path == runs


@each_kind
def test_a_program_below_the_working_folder_gets_its_whole_path(kind, tmp_path, monkeypatch):
    """It is started in the folder of the run."""
    made = program(tmp_path / "bin" / kind.name)
    monkeypatch.chdir(tmp_path)
    search(monkeypatch, Path("bin"))
    assert Program(kind).path == made
    assert Program(kind, Path("bin") / kind.name).path == made
    monkeypatch.setenv(kind.variable, f"bin/{kind.name}")
    assert Program(kind).path == made


@pytest.mark.parametrize(
    ("kind", "variable"), [(LMP, "LIFTDRAG_LMP"), (LIGGGHTS_BINARY, "LIFTDRAG_LIGGGHTS")]
)
def test_a_path_given_counts_above_the_variable_and_that_above_the_path(
    kind, variable, tmp_path, monkeypatch
):
    on_path = program(tmp_path / "path" / kind.name)
    named = program(tmp_path / "named" / "other_name")
    given = program(tmp_path / "given" / "third_name")
    search(monkeypatch, on_path.parent)
    assert Program(kind).path == on_path
    monkeypatch.setenv(variable, str(named))
    assert Program(kind).path == named
    assert Program(kind, given).path == given
    monkeypatch.setenv(variable, "")
    assert Program(kind).path == on_path


def test_a_variable_is_of_one_kind_only(tmp_path, monkeypatch):
    for kind in KINDS:
        program(tmp_path / kind.name)
    search(monkeypatch, tmp_path)
    monkeypatch.setenv("LIFTDRAG_LMP", str(program(tmp_path / "mine")))
    assert Program(LMP).path == tmp_path / "mine"
    assert Program(LIGGGHTS_BINARY).path == tmp_path / "liggghts"


def test_the_virtual_environments_own_lmp_is_not_taken(tmp_path, monkeypatch):
    """The wheel's: a Python script, which the engine lammps runs better."""
    scripts = Path(sysconfig.get_path("scripts"))
    assert os.access(scripts / "lmp", os.X_OK)
    made = program(tmp_path / "lmp")
    search(monkeypatch, scripts, tmp_path)
    assert Program(LMP).path == made
    (tmp_path / "link").symlink_to(scripts)
    search(monkeypatch, tmp_path / "link", tmp_path)
    assert Program(LMP).path == made
    monkeypatch.setenv("PATH", f"{scripts}{os.sep}")
    assert "The engine lmp is not installed" in refusal(Program(LMP))
    assert Program(LMP, scripts / "lmp").path == scripts / "lmp"


@pytest.mark.parametrize(
    ("kind", "install"),
    [(LMP, "apt-get install lammps"), (LIGGGHTS_BINARY, "apt-get install liggghts")],
    ids=lambda value: getattr(value, "name", ""),
)
def test_a_missing_program_says_how_to_install_it(kind, install, tmp_path, monkeypatch):
    search(monkeypatch, tmp_path)
    expected = (
        f"The engine {kind.name} is not installed; run: {install} (Debian), or "
        f"name its path with --engine-path or LIFTDRAG_{kind.name.upper()}."
    )
    assert refusal(Program(kind)) == expected
    for ask in (Program(kind).about, Program(kind).packages, Program(kind).world):
        with pytest.raises(InputError, match="is not installed"):
            ask()


@pytest.mark.parametrize("fault", ["missing", "folder", "not executable"])
@each_kind
def test_a_path_that_is_no_program_is_refused(kind, fault, tmp_path, monkeypatch):
    """Though there is another on the PATH: the user asked for this one."""
    path = tmp_path / "engine"
    if fault == "folder":
        path.mkdir()
    if fault == "not executable":
        program(path, LIGGGHTS_SAYS, BANNER + "22 Jul 2025").chmod(0o644)
    expected = f"{path} is not a program; name the path of {kind.title} with --engine-path "
    expected += f"or {kind.variable}."
    assert refusal(Program(kind, path)) == expected
    monkeypatch.setenv(kind.variable, str(path))
    assert refusal(Program(kind)) == expected


@pytest.mark.parametrize("says", [(), ("Hello",), ("LAMMPS", "LIGGGHTS"), (BANNER,)])
@each_kind
def test_a_program_that_is_something_else_is_refused(kind, says, tmp_path):
    path = program(tmp_path / "engine", *says)
    with pytest.raises(InputError) as caught:
        Program(kind, path).about()
    assert f"{path} does not say that it is {kind.title};" in str(caught.value)
    assert "--engine-path" in str(caught.value)


@needs_both
def test_one_program_is_not_taken_for_the_other(tmp_path):
    with pytest.raises(InputError, match="/usr/bin/liggghts does not say that it is LAMMPS;"):
        Program(LMP, INSTALLED[LIGGGHTS_BINARY]).about()
    path = program(tmp_path / "liggghts", BANNER + "29 Sep 2021 - Update 2")
    with pytest.raises(InputError, match="liggghts does not say that it is LIGGGHTS;"):
        Program(LIGGGHTS_BINARY, path).about()


def test_a_program_that_cannot_be_started_is_refused(tmp_path):
    path = tmp_path / "engine"
    path.write_bytes(b"\x7fELF damaged")
    path.chmod(0o755)
    with pytest.raises(InputError, match="does not say that it is LAMMPS"):
        Program(LMP, path).about()


@pytest.mark.parametrize("stream", [1, 2])
def test_a_program_may_say_what_it_is_on_either_stream(stream, tmp_path):
    path = program(tmp_path / "engine", LIGGGHTS_SAYS, to=stream)
    found = Program(LIGGGHTS_BINARY, path)
    assert found.about().version == "LIGGGHTS-PUBLIC 3.8.0"
    assert found.dialect is LIGGGHTS


@pytest.mark.parametrize(
    ("says", "version", "dialect"),
    [
        ("29 Sep 2021 - Update 2", "29 Sep 2021 Update 2", LAMMPS_2021),
        ("29 Sep 2021", "29 Sep 2021", LAMMPS_2021),
        ("23 Jun 2022 - Update 4", "23 Jun 2022 Update 4", LAMMPS_2021),
        ("21 Dec 2022", "21 Dec 2022", LAMMPS_2021),
        ("22 Dec 2022", "22 Dec 2022", LAMMPS_2023),
        ("22 Dec 2022 - Development", "22 Dec 2022", LAMMPS_2023),
        ("2 Aug 2023 - Update 3", "2 Aug 2023 Update 3", LAMMPS_2023),
        ("17 Apr 2024 - Maintenance", "17 Apr 2024", LAMMPS),
        ("22 Jul 2025", "22 Jul 2025", LAMMPS),
        ("29 Sept 2025", "29 Sept 2025", LAMMPS),
    ],
)
def test_the_version_of_lammps_chooses_the_dialect(says, version, dialect, tmp_path):
    found = lmp_of(tmp_path, says)
    assert found.about().version == version
    assert found.dialect is dialect


def test_a_script_has_no_mpi_and_runs_on_one_rank(tmp_path):
    found = lmp_of(tmp_path, "22 Jul 2025")
    assert found.about().mpi == "none"
    assert found.flavour is None
    assert found.settings() == {}
    found.check(1)
    for start in (found.launcher, lambda: found.check(2)):
        with pytest.raises(InputError, match=r"lmp cannot be seen: .* run with --ranks 1\.$"):
            start()


def test_packages_are_those_that_the_program_lists(tmp_path):
    lines = (BANNER + "22 Jul 2025", "", "Installed packages:", "", "ASPHERE GRANULAR ", "", "x")
    assert Program(LMP, program(tmp_path / "a", *lines)).packages() == ("ASPHERE", "GRANULAR")
    assert lmp_of(tmp_path, "22 Jul 2025").packages() == ()


LINKED = "\tlinux-vdso.so.1 (0x1)\n\tlib{} => /opt/lib/lib{} (0x7f)\n\tlibc.so.6 => /lib/libc (0x2)"


@needs_both
def test_library_that_is_not_found_still_tells_the_mpi(monkeypatch):
    monkeypatch.setattr("liftdrag.engines.program._output", lambda _: "libmpi.so.40 => not found")
    assert Program(LMP, INSTALLED[LMP]).flavour is mpi.OPEN_MPI


@needs_both
@pytest.mark.parametrize(
    ("library", "flavour"),
    [
        ("mpi.so.40", mpi.OPEN_MPI),
        ("mpi_cxx.so.40", mpi.OPEN_MPI),
        ("mpi.so.20", mpi.OPEN_MPI),
        ("mpi.so.12", mpi.MPICH),
        ("mpich.so.12", mpi.MPICH),
        ("mpichcxx.so.12", mpi.MPICH),
        ("png16.so.40", None),
    ],
)
def test_the_mpi_is_that_of_the_library_linked(library, flavour, monkeypatch):
    """Open MPI's libraries are of version 20 or 40, those of MPICH and its kin 12."""
    said = LINKED.replace("{}", library)
    monkeypatch.setattr("liftdrag.engines.program._output", lambda _: said)
    assert Program(LMP, INSTALLED[LMP]).flavour is flavour


@needs_both
@pytest.mark.parametrize(
    ("kind", "version", "dialect"),
    [
        (LMP, "29 Sep 2021 Update 2", LAMMPS_2021),
        (LIGGGHTS_BINARY, "LIGGGHTS-PUBLIC 3.8.0", LIGGGHTS),
    ],
    ids=lambda value: getattr(value, "name", ""),
)
def test_debians_programs_say_what_they_are(kind, version, dialect):
    found = debians(kind)
    about = found.about()
    assert (about.name, about.version, about.mpi) == (kind.name, version, "Open MPI")
    assert about.path == INSTALLED[kind]
    assert found.dialect is dialect
    assert found.flavour is mpi.OPEN_MPI
    assert mpi.flavour_of(str(found.launcher())) is mpi.OPEN_MPI
    found.check(2)


@needs_both
def test_debians_lmp_lists_its_packages():
    assert {"GRANULAR", "MOLECULE"} <= set(debians(LMP).packages())
    assert debians(LIGGGHTS_BINARY).packages() == ()


@needs_both
def test_debians_programs_do_not_take_the_wheels_launcher(monkeypatch):
    """Though an active virtual environment has it first on the PATH."""
    search(monkeypatch, Path(sysconfig.get_path("scripts")), Path("/usr/bin"), Path("/bin"))
    for kind, path in INSTALLED.items():
        assert Program(kind, path).launcher() == Path("/usr/bin/mpirun.openmpi")


@needs_both
@each_kind
def test_debians_programs_join_jobs_of_open_mpi_only(kind, monkeypatch):
    found = Program(kind, INSTALLED[kind])
    assert found.world() == mpi.World(0, 1)
    monkeypatch.setenv("PMI_SIZE", "2")
    with pytest.raises(InputError, match=f"engine {kind.name} uses Open MPI .* separate copies"):
        found.world()
    monkeypatch.setenv("OMPI_COMM_WORLD_SIZE", "2")
    monkeypatch.setenv("OMPI_COMM_WORLD_RANK", "1")
    assert found.world() == mpi.World(1, 2)


@pytest.mark.parametrize("name", ["PMI_RANK", "PMIX_NAMESPACE", "OMPI_MCA_orte_launch"])
def test_a_program_is_asked_outside_of_the_job_around(name, tmp_path, monkeypatch):
    """As a rank of a job that it cannot reach it would not start at all."""
    path = program(tmp_path / "lmp", BANNER + "22 Jul 2025")
    path.write_text(path.read_text().replace("echo", f'test -z "${name}" && echo'))
    monkeypatch.setenv(name, "1")
    assert Program(LMP, path).about().version == "22 Jul 2025"


@needs_both
def test_a_real_job_around_does_not_hide_the_programs():
    """Asked by a rank of Open MPI's mpirun, they start as jobs of their own."""
    code = (
        "from pathlib import Path; from liftdrag.engines.program import *\n"
        "for kind in (LMP, LIGGGHTS_BINARY):\n"
        "    print(Program(kind, Path('/usr/bin') / kind.name).about().version)"
    )
    environment = mpi.outside(os.environ)
    done = subprocess.run(
        ["/usr/bin/mpirun", "-n", "1", sys.executable, "-c", code],
        capture_output=True,
        text=True,
        timeout=60,
        env=environment | mpi.settings(mpi.OPEN_MPI, environment),
        check=False,
    )
    versions = [debians(kind).about().version for kind in KINDS]
    assert done.stdout.splitlines() == versions, done.stderr


@needs_both
@each_kind
def test_a_program_logs_to_the_folder_that_it_is_started_in(kind, tmp_path):
    found = debians(kind)
    log = {"lmp": "log.lammps", "liggghts": "log.liggghts"}[kind.name]
    words = found.command("in.tank", tmp_path)
    assert words == [str(found.path), "-in", "in.tank", "-log", log, "-screen", "none"]
    assert found.log == log


def test_engines_are_known_by_their_names():
    assert ENGINES == ("lammps", "lmp", "liggghts")
    for name in ENGINES:
        assert engine(name).name == name
        assert engine(name) is engine(name)


def test_an_engine_is_of_the_path_given(tmp_path):
    path = program(tmp_path / "mine", LIGGGHTS_SAYS)
    assert engine("liggghts", path).about().path == path
    assert engine("liggghts") is not engine("liggghts", path)


@pytest.mark.parametrize(
    ("name", "hint"),
    [
        ("lamps", "did you mean 'lammps'"),
        ("ligghts", "did you mean 'liggghts'"),
        ("lmpp", "did you mean 'lmp'"),
        ("yade", "choose one of lammps, lmp, liggghts, dem"),
        ("", "choose one of lammps, lmp, liggghts, dem"),
    ],
)
def test_an_unknown_engine_gets_a_hint(name, hint):
    with pytest.raises(InputError) as caught:
        engine(name)
    assert str(caught.value) == f"There is no engine {name!r}; {hint}."


def test_the_wheel_has_no_path():
    with pytest.raises(InputError, match=r"has no path; .* choose --engine lmp\.$"):
        engine("lammps", INSTALLED[LMP])


GRID = "  {} by {} by {} MPI processor grid\n"
COPIES = "ERROR: Specified processors != physical processors (../comm.cpp:159)\n"
END = "LIFTDRAG FINISHED at step 10\n"


def judged(ranks: int, log: str, said: str = "", code: int = 0) -> tuple[str, str]:
    """The verdict on a run of 10 steps without series."""
    plan = Plan("in.x", ranks, 1e-5, {"motion": 10}, 1, {})
    return checks.verdict(plan, Path(), log, said, code)


@pytest.mark.parametrize(
    ("log", "ranks"),
    [
        ("", 0),
        ("reading\n" + GRID.format(1, 1, 1), 1),
        (GRID.format(2, 3, 4) + END, 24),
        (GRID.format(12, 1, 1) + GRID.format(1, 1, 1), 12),
        ("# 2 by 1 by 1 MPI processor grid\n", 0),
    ],
)
def test_ranks_are_those_that_the_log_counts(log, ranks):
    assert checks.ranks_of(log) == ranks


@pytest.mark.parametrize(("ranks", "grid"), [(1, (1, 1, 1)), (2, (2, 1, 1)), (6, (3, 2, 1))])
def test_a_run_on_the_ranks_planned_is_finished(ranks, grid):
    assert judged(ranks, GRID.format(*grid) + END) == ("finished", "")


@pytest.mark.parametrize(
    ("planned", "grid", "found"), [(1, (2, 1, 1), 2), (4, (2, 1, 1), 2), (2, (2, 2, 1), 4)]
)
def test_a_run_on_other_ranks_is_an_error(planned, grid, found):
    """Though it came to its end."""
    expected = f"the engine ran on {found} ranks, not {planned}"
    assert judged(planned, GRID.format(*grid) + END) == ("engine_error", expected)


@pytest.mark.parametrize(
    ("log", "said"),
    [
        (GRID.format(1, 1, 1) + END, ""),
        (GRID.format(1, 1, 1) + "ERROR: Lost atoms: original 9 current 8\n", ""),
        (COPIES, ""),
        ("", COPIES),
        (COPIES.replace("Specified p", "P"), ""),
        ("units si\n" + COPIES.replace("ERROR:", "ERROR on proc 0:"), "killed"),
    ],
)
@pytest.mark.parametrize("ranks", [2, 3])
def test_copies_of_one_rank_are_told_from_a_run(ranks, log, said):
    status, reason = judged(ranks, log, said, code=1)
    assert status == "engine_error"
    assert reason.startswith(f"the engine ran as {ranks} copies of one rank each: the launcher")


def test_one_rank_that_was_planned_is_no_copy():
    assert judged(1, GRID.format(1, 1, 1), code=1) == (
        "engine_error",
        "the engine stopped before the end of the deck",
    )
    assert "copies" not in judged(1, COPIES, code=1)[1]
    assert "copies" not in judged(2, GRID.format(2, 1, 1) + "# " + COPIES + END)[1]


@pytest.fixture
def strange_launcher(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """MPICH's mpiexec in place of Open MPI's; of the probes only the one of the ranks."""
    monkeypatch.setattr(Program, "launcher", lambda _: mpi.mpiexec())
    monkeypatch.setattr(liftdrag.tank, "TANK", ())
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


@needs_both
@pytest.mark.usefixtures("strange_launcher")
@each_kind
def test_a_launcher_of_another_mpi_fails_the_probe_of_ranks(kind: Kind, out: Path):
    with pytest.raises(InputError) as caught:
        run(tiny_tank(), out, engine=kind.name, ranks=2)
    said = str(caught.value)
    assert said.startswith(f"The engine {kind.name} fails the probe ranks ({kind.name} failed: ")
    assert "the engine ran as 2 copies of one rank each" in said
    assert "--ignore-probe ranks" in said
    assert not out.exists()


@needs_both
@pytest.mark.usefixtures("strange_launcher")
def test_copies_that_are_run_all_the_same_fail(out: Path):
    """Debian's LIGGGHTS under MPICH's mpiexec: two processes, each on its own."""
    with pytest.raises(RunFailed) as caught:
        run(tiny_tank(), out, engine="liggghts", ranks=2, ignore_probes=["ranks"])
    assert caught.value.status == "engine_error"
    assert "the engine ran as 2 copies of one rank each" in caught.value.reason
    assert "processors != physical processors" in caught.value.evidence.lower()
    record = json.loads((out / "result.json").read_text())
    assert record["status"] == "engine_error"
    assert record["warnings"][0].startswith("THE ENGINE IS WRONG: liggghts fails the probe ranks")
