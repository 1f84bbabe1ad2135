"""Columns of LAMMPS and LIGGGHTS, and tanks of LIGGGHTS, that were cut short go on."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from kills import TANK, Kill, end_engines, killed, struck
from test_janssen_scene import tiny

from liftdrag.analysis import janssen_stop
from liftdrag.deck import Plan
from liftdrag.deck.restart import written
from liftdrag.engines import process, restart
from liftdrag.engines.fills import ends_in, read_fills
from liftdrag.engines.phases import Phase, phase_at
from liftdrag.engines.stopper import PRECISION
from liftdrag.files import text
from liftdrag.folder import Record
from liftdrag.resume import resume
from liftdrag.runner import run

COLUMN = tiny(
    fill={"mass": "3 g", "levels": 2},
    drive={"distance": "0.05 d", "mobilise": "0.05 d"},
    numerics={"settle_time": "15 ms", "restart_every": 500},
)
"""Some 85 grains in two fills of 2400 steps, with a dozen restart files."""

LID = COLUMN.set("overload", {"mass": "3 g"})
STOPPED = COLUMN.set("stop", {"quantity": "apparent_mass", "relative_error": 0.5}).set(
    "drive.distance", "0.5 d"
)

SERIES = ("forces.dat", "series.csv")
OF_TANK = (*SERIES, "bed.dat", "surface.dump", "snapshots.dump", "settled.dump")
OF_COLUMN = (*SERIES, "profile.dat", "curve.csv", "profile.csv")

slow = pytest.mark.validate


@pytest.fixture(autouse=True)
def looks_often(monkeypatch):
    monkeypatch.setattr(process, "POLL_S", 0.02)


def resumed_at(folder: Path) -> list[tuple[str, int]]:
    made = json.loads((folder / "run.json").read_text())["provenance"].get("resumed", [])
    return [(point["stage"], point["step"]) for point in made]


@pytest.mark.parametrize(
    ("case", "engine", "stage", "step", "files"),
    [
        pytest.param(LID, "lammps", "drive", 2000, OF_COLUMN, id="column under a lid"),
        pytest.param(COLUMN, "liggghts", "drive", 2000, OF_COLUMN, id="column on LIGGGHTS"),
        pytest.param(TANK, "liggghts", "drive", 2000, OF_TANK, id="tank on LIGGGHTS"),
        pytest.param(TANK, "liggghts", "settle", 600, OF_TANK, id="its settling", marks=slow),
        pytest.param(COLUMN, "lmp", "drive", 2000, OF_COLUMN, id="column on lmp", marks=slow),
    ],
)
def test_what_was_killed_goes_on_to_the_same_bits(case, engine, stage, step, files, tmp_path):
    whole = run(case, tmp_path / "whole", engine)
    folder = killed(tmp_path / "run", stage, step, case, engine)
    result = resume(None, folder)
    ((at, point),) = resumed_at(folder)
    assert at == stage
    assert point > 0
    assert [n for n in files if (folder / n).read_bytes() != (whole.folder / n).read_bytes()] == []
    assert result.record["quantities"] == whole.record["quantities"]
    assert result.record["steps"] == whole.record["steps"]
    assert not list(folder.glob("*.before"))


def test_times_are_those_of_all_sessions(tmp_path):
    folder = killed(tmp_path / "run", "drive", 1500, COLUMN)
    struck(folder, lambda: resume(None, folder, progress=Kill(folder, "drive", 3000)))
    found = resume(None, folder).record
    sessions = found["provenance"]["sessions"]
    assert [session["status"] for session in sessions] == ["killed", "killed", "finished"]
    for name in ("wall_s", "cpu_s"):
        assert found[name] == pytest.approx(sum(session[name] for session in sessions))
        assert min(session[name] for session in sessions) > 0.0
    assert found["steps"] == json.loads((folder / "run.json").read_text())["plan"]["fills"][-1][-1]


def log_of(*marks: str) -> str:
    return "\n".join(f"LIFTDRAG {mark}" for mark in marks)


FIRST = ("PHASE settle_1 from step 0 to 100", "PHASE average_1 from step 100 to 200")
EARLY = ("FILL 1 averaged to step 180", "PHASE settle_2 from step 180 to 280")
AGAIN = ("PHASE average_1 from step 160 to 200", "FILL 1 averaged to step 190")
LATER = ("PHASE settle_2 from step 190 to 290",)


@pytest.mark.parametrize(
    ("marks", "step", "phase"),
    [
        (FIRST, 50, Phase("settle_1", 1, 100, ())),
        (FIRST, 100, Phase("settle_1", 1, 100, ())),
        (FIRST, 101, Phase("average_1", 1, 200, ())),
        ((*FIRST, *EARLY), 170, Phase("average_1", 1, 200, ())),
        ((*FIRST, *EARLY), 180, Phase("average_1", 1, 180, (), done=True)),
        ((*FIRST, *EARLY), 200, Phase("settle_2", 2, 280, (180,))),
        ((*FIRST, *EARLY, *AGAIN), 185, Phase("average_1", 1, 200, ())),
        ((*FIRST, *EARLY, *AGAIN, *LATER), 200, Phase("settle_2", 2, 290, (190,))),
        ((*FIRST, *EARLY, "FILL 1 averaged to step 180"), 160, Phase("average_1", 1, 200, ())),
        (("PHASE settle_2 from step 180 to 280",), 200, None),
        ((), 50, None),
    ],
)
def test_the_logs_tell_the_phase_of_a_step(marks, step, phase):
    """At the end of a phase its layer is not there yet; what a later session said counts."""
    fills = ((5, 0, 100, 200), (9, 200, 300, 400))
    plan = Plan("in.janssen", 1, 1.0, {"drive": 400}, 1, {}, fills, stoppable=True)
    assert phase_at(plan, log_of(*marks), step) == phase


def test_a_file_that_liggghts_was_writing_is_passed_over(tmp_path):
    """It has no mark of its end: the log says which one is whole."""
    folder = killed(tmp_path / "run", "drive", 2000, COLUMN, "liggghts")
    plan = Record.read(folder).plan
    newest = restart.latest(plan, folder, "log.liggghts")
    assert newest is not None
    said = (folder / "log.liggghts").read_text()
    mark = f"LIFTDRAG KEPT {newest.file.name} at step {newest.step}\n"
    assert mark in said
    (folder / "log.liggghts").write_text(said.replace(mark, ""))
    older = restart.latest(plan, folder, "log.liggghts")
    assert older is not None
    assert older.step == newest.step - 510
    assert {older.file.name, newest.file.name} == set(written("drive"))
    resume(None, folder)
    assert resumed_at(folder) == [("drive", older.step)]


@pytest.mark.parametrize("engine", ["lammps", pytest.param("liggghts", marks=slow)])
def test_an_average_that_ended_early_stays_so(engine, tmp_path, monkeypatch):
    """The first fill's end is kept; what liftdrag asked of the second is decided anew."""
    monkeypatch.setattr("liftdrag.engines.stopper.LEAST_S", 0.0)
    monkeypatch.setattr("liftdrag.engines.stopper.SHARE", 1e9)
    monkeypatch.setattr(janssen_stop, "LEAST_WAY", 0.05)
    folder = tmp_path / "run"
    log = folder / f"log.{engine}"

    def kill(_stage: str, _done: int, _total: int) -> None:
        if "LIFTDRAG PHASE average_2" in text(log):
            end_engines(folder)

    struck(folder, lambda: run(STOPPED, folder, engine, progress=kill))
    (ended,) = ends_in(text(log))[:1]
    (folder / "STOP-2").write_text(PRECISION)
    resume(None, folder)
    first, second = read_fills(folder)
    assert first[3] == second[1] == ended
    assert f"FILL 1 averaged to step {ended}" in text(folder / "from.lmp")
    assert 800 <= second[3] - second[2] < 8000
