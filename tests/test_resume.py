"""A run that was cut short goes on to the same last step, with the same rows."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from conftest import tiny_tank, with_lid
from kills import TANK, Kill, engines_in, killed, struck

import liftdrag.resume
from liftdrag.engines import process, restart
from liftdrag.errors import InputError, RunFailed
from liftdrag.folder import Record
from liftdrag.lock import LOCK
from liftdrag.resume import resume
from liftdrag.runner import run

SERIES = ("forces.dat", "bed.dat", "series.csv", "snapshots.dump", "settled.dump")


@pytest.fixture(scope="module", autouse=True)
def looks_often():
    """A tiny run would otherwise end between two looks at its log."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(process, "POLL_S", 0.02)
        yield


@pytest.fixture(scope="module")
def whole(tmp_path_factory) -> Path:
    """The folder of a run that nobody disturbed."""
    return run(TANK, tmp_path_factory.mktemp("whole") / "run").folder


@pytest.fixture(scope="module")
def cut(tmp_path_factory) -> Path:
    """The folder of a run whose engine was killed in its drive."""
    return killed(tmp_path_factory.mktemp("cut") / "run", "drive", 2000)


@pytest.fixture
def again(cut, tmp_path) -> Path:
    """A copy of that folder."""
    return shutil.copytree(cut, tmp_path / "run")


def same(one: Path, other: Path) -> list[str]:
    """The files of the series that differ."""
    return [name for name in SERIES if (one / name).read_bytes() != (other / name).read_bytes()]


def resumed_at(folder: Path) -> list[tuple[str, int]]:
    made = json.loads((folder / "run.json").read_text())["provenance"].get("resumed", [])
    return [(point["stage"], point["step"]) for point in made]


def test_a_killed_engine_goes_on_to_the_same_bits(whole, again):
    result = resume(None, again)
    assert result.status == "finished"
    assert same(whole, again) == []
    ((stage, step),) = resumed_at(again)
    assert stage == "drive"
    assert step >= 513
    assert step % 513 == 0
    old = json.loads((whole / "result.json").read_text())
    assert result.record["quantities"] == old["quantities"]
    assert not list(again.glob("*.before"))
    assert "LIFTDRAG STAGE settle" in (again / "log.lammps.1").read_text()


def test_a_bed_killed_while_it_settled_goes_on_to_the_same_bits(whole, tmp_path):
    folder = killed(tmp_path / "run", "settle", 600)
    step = restart.latest(Record.read(folder).plan, folder, "log.lammps").step
    resume(None, folder)
    assert resumed_at(folder) == [("settle", step)]
    assert same(whole, folder) == []


def test_a_run_that_is_killed_twice_goes_on_to_the_same_bits(whole, again):
    struck(again, lambda: resume(None, again, progress=Kill(again, "drive", 3000)))
    resume(None, again)
    first, second = resumed_at(again)
    assert first < second
    assert same(whole, again) == []


def newest(folder: Path) -> Path:
    point = restart.latest(Record.read(folder).plan, folder, "log.lammps")
    assert point is not None
    return point.file


@pytest.mark.parametrize(
    "damage",
    [
        "cut",
        "rows",
        *(pytest.param(d, marks=pytest.mark.validate) for d in ("empty", "gone", "frame")),
    ],
)
def test_a_damaged_restart_file_is_passed_over_for_the_older(whole, again, damage):
    file, step = newest(again), restart.step_of(newest(again))[0]
    if damage == "cut":
        file.write_bytes(file.read_bytes()[:-1])
    if damage == "empty":
        file.write_bytes(b"")
    if damage == "gone":
        file.unlink()
    if damage == "rows":
        rows = (again / "bed.dat").read_text().splitlines(keepends=True)
        kept = [row for row in rows if row.startswith("#") or int(row.split()[0]) < step]
        (again / "bed.dat").write_text("".join(kept))
    if damage == "frame":
        frames = (again / "surface.dump").read_text().split("ITEM: TIMESTEP\n")
        frames[(step - 1) // 81 + 1] = frames[(step - 1) // 81 + 1][:-20]
        (again / "surface.dump").write_text("ITEM: TIMESTEP\n".join(frames))
    resume(None, again)
    assert resumed_at(again) == [("drive", step - 513)]
    assert same(whole, again) == []


def test_without_a_whole_restart_file_a_run_begins_anew(whole, again):
    for file in again.glob("*.restart"):
        file.write_bytes(restart.MARK)
    resume(None, again)
    assert resumed_at(again) == []
    assert same(whole, again) == []


def test_what_was_written_after_the_point_is_taken_back_as_often_as_asked(again):
    """Rows and frames to the step alone, a torn tail among what goes."""
    record = Record.read(again)
    with (again / "surface.dump").open("a") as file:
        file.write("ITEM: TIMESTEP\n99")
    with (again / "forces.dat").open("a") as file:
        file.write("9999 0.1")
    point = restart.latest(record.plan, again, "log.lammps")
    for _ in range(2):
        restart.take_back(point, record.plan, again, "log.lammps")
        rows = np.loadtxt(again / "forces.dat.before")
        assert list(rows[:, 0]) == list(range(27, point.step + 1, 27))
        frames = (again / "surface.dump").read_text().split("ITEM: TIMESTEP\n")[1:]
        assert [int(frame.split()[0]) for frame in frames] == list(range(0, point.step, 81))


@pytest.mark.validate
@pytest.mark.parametrize("bulk_gravity", [True, False])
def test_a_lid_goes_on_to_the_same_bits(bulk_gravity, tmp_path):
    case = with_lid(bulk_gravity).set("numerics.restart_every", 500)
    folder = killed(tmp_path / "run", "drive", 1200, case)
    resume(None, folder)
    assert same(run(case, tmp_path / "whole").folder, folder) == []


@pytest.mark.validate
def test_two_ranks_go_on_to_the_same_bits(tmp_path):
    whole, folder = run(TANK, tmp_path / "whole", ranks=2).folder, tmp_path / "run"
    struck(folder, lambda: run(TANK, folder, ranks=2, progress=Kill(folder, "drive", 2000)))
    resume(None, folder)
    assert same(whole, folder) == []


@pytest.mark.needs("lmp")
def test_debians_lammps_goes_on_to_the_same_answer(tmp_path):
    """It computes the forces of the first step anew: the same rows, other digits."""
    folder = killed(tmp_path / "run", "drive", 2000, engine="lmp")
    before = np.loadtxt(folder / "forces.dat")
    result = resume(None, folder)
    ((_, step),) = resumed_at(folder)
    after = np.loadtxt(folder / "forces.dat")
    assert list(after[:, 0]) == list(range(27, 4754, 27))
    assert np.array_equal(after[: step // 27], before[: step // 27])
    other = run(TANK, tmp_path / "whole", engine="lmp").quantities["drag"]
    whole = np.loadtxt(tmp_path / "whole" / "forces.dat")
    next_rows = slice(step // 27, step // 27 + 3)
    scale = np.abs(before[:, 1:]).max()
    assert np.abs(after[next_rows, 1:] - whole[next_rows, 1:]).max() < 0.01 * scale
    error = np.hypot(other.standard_error, result.quantities["drag"].standard_error)
    assert abs(other.mean - result.quantities["drag"].mean) < 4.0 * error


def test_a_run_that_has_finished_is_only_read(whole, tmp_path, monkeypatch):
    folder = shutil.copytree(whole, tmp_path / "run")
    monkeypatch.setattr(liftdrag.resume, "carried_out", None)
    before = (folder / "result.json").read_bytes()
    assert resume(TANK, folder).quantities["drag"].mean > 0.0
    assert (folder / "result.json").read_bytes() == before


def test_a_run_that_never_began_is_started(tmp_path):
    (tmp_path / LOCK).touch()
    with pytest.raises(InputError, match=r"holds no run; name the case to start there\.$"):
        resume(None, tmp_path)
    assert resume(TANK, tmp_path).status == "finished"


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ("case", "is of another case than tiny; choose another --out."),
        ("engine", "is of the engine lammps; leave out --engine."),
        ("ranks", "is on --ranks 1, not 2; leave out --ranks."),
        ("deck", "in.tank-drive is not the file that was written for the run; remove"),
        ("grains", "grains.data is not the file that was written for the run; remove"),
        ("version", "began with lammps 1 Jan 2000, and this is"),
    ],
)
def test_what_cannot_go_on_says_so_and_loses_nothing(again, change, words):
    record = json.loads((again / "run.json").read_text())
    if change == "version":
        record["provenance"]["engine"]["version"] = "1 Jan 2000"
    (again / "run.json").write_text(json.dumps(record))
    if change == "deck":
        (again / "in.tank-drive").write_text("print hello\n")
    if change == "grains":
        (again / "grains.data").unlink()
    before = {file.name: file.read_bytes() for file in again.iterdir() if file.name != LOCK}
    case = tiny_tank() if change == "case" else TANK
    with pytest.raises(InputError) as caught:
        resume(
            case,
            again,
            "lmp" if change == "engine" else None,
            2 if change == "ranks" else None,
        )
    assert words in str(caught.value)
    assert len(str(caught.value).splitlines()) == 1
    after = {file.name: file.read_bytes() for file in again.iterdir() if file.name != LOCK}
    assert after == before
    assert "remove" not in words or str(again) in str(caught.value)


def test_a_liftdrag_that_is_killed_leaves_a_run_that_goes_on(whole, tmp_path):
    """With kill -9, in its drive; the second one waits for the engine to end."""
    folder = tmp_path / "run"
    code = (
        "import os, signal, sys; from pathlib import Path; sys.path.insert(0, sys.argv[1])\n"
        "from kills import TANK; from liftdrag.runner import run\n"
        "def kill(stage, done, total):\n"
        "    if stage == 'drive' and done >= 1500: os.kill(os.getpid(), signal.SIGKILL)\n"
        "run(TANK, sys.argv[2], progress=kill)"
    )
    tests = str(Path(__file__).parent)
    done = subprocess.run([sys.executable, "-c", code, tests, str(folder)], env=os.environ)
    assert done.returncode == -signal.SIGKILL
    assert not (folder / "result.json").exists()
    resume(None, folder)
    assert same(whole, folder) == []
    assert engines_in(folder) == []


def test_an_interruption_says_how_to_go_on(tmp_path):
    def interrupt(stage: str, done: int, _total: int) -> None:
        if stage == "drive" and done >= 1000:
            raise KeyboardInterrupt

    with pytest.raises(RunFailed) as caught:
        run(TANK, tmp_path / "a run", progress=interrupt)
    command = f"liftdrag run --resume --out '{tmp_path}/a run'"
    assert caught.value.reason.endswith(f"was interrupted. Go on with: {command}")
    assert json.loads((tmp_path / "a run" / "result.json").read_text())["status"] == "killed"
