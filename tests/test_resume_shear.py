"""A shear flow of the in-house engine that was cut short goes on to the same bits."""

from __future__ import annotations

import json
import logging
import signal
import subprocess
import sys
from collections.abc import Callable
from itertools import islice
from pathlib import Path

import numpy as np
import pytest
from test_dem_cylinders_motion import law_of
from test_shear_scene import tiny

from liftdrag.case import Case
from liftdrag.deck.shear import START, STRESSES, read_grains
from liftdrag.dem.cylinders import Cell, shear
from liftdrag.engines import checkpoint
from liftdrag.engines.base import Progress
from liftdrag.engines.dem_shear import LOOKS
from liftdrag.errors import InputError, RunFailed
from liftdrag.resume import resume
from liftdrag.runner import analyze, run

CASE = tiny()
STOPS = {
    "precision": tiny(
        stop={"quantity": "bulk_friction", "relative_error": 0.3}, drive={"strain": 30.0}
    ),
    "distance": tiny(stop={"relative_error": 1e-6}),
}
FILES = (STRESSES, LOOKS, "series.csv", "structure.csv", "stress.csv")


@pytest.fixture(autouse=True)
def often(monkeypatch: pytest.MonkeyPatch) -> None:
    """A state is kept after each row."""
    monkeypatch.setattr(checkpoint, "EVERY_S", 0.0)
    monkeypatch.setattr(checkpoint, "SHARE", 1e9)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return run(CASE, tmp_path_factory.mktemp("whole") / "run").folder


def told(rows: int, end: Callable[[], None]) -> Progress:
    """A progress that ends a run at so many rows."""
    seen = 0

    def look(stage: str, _done: int, _total: int) -> None:
        nonlocal seen
        seen += stage == "drive"
        if seen == rows:
            end()

    return look


def interrupt() -> None:
    raise RunFailed("killed", "killed")


def interrupted(folder: Path, rows: int, case: Case = CASE, ranks: int = 1) -> Path:
    """The folder of a run, or of its rest, that was interrupted after so many rows more."""
    with pytest.raises(RunFailed, match="Go on with: liftdrag run --resume --out"):
        resume(case, folder, "dem", ranks, told(rows, interrupt))
    return folder


def same(one: Path, other: Path) -> bool:
    return all((one / name).read_bytes() == (other / name).read_bytes() for name in FILES)


def answers_of(folder: Path) -> tuple[object, ...]:
    found = json.loads((folder / "result.json").read_text())
    kept = ("quantities", "steady_window", "steps", "stopped_by", "sealed", "warnings")
    return tuple(found[name] for name in kept)


def test_a_flow_goes_on_from_any_sample_to_the_same_bits(whole: Path):
    """From its grains alone it does not: their spin is a rounded angular momentum."""
    grains, _ = read_grains(whole)
    cell, law = Cell(np.array(CASE.scene.sides), 100.0), law_of()
    samples = list(islice(shear(grains, cell, law, 1e-5, 7), 60))
    begun = samples[40]
    for exact in (True, False):
        kept = begun.angular_momentum if exact else None
        rest = shear(begun.grains, begun.cell, law, 1e-5, 7, None, 1, 0.5, kept, begun.time)
        last = list(islice(rest, 19))[-1]
        assert np.array_equal(last.contact, samples[-1].contact) == exact
        assert np.array_equal(last.grains.spin, samples[-1].grains.spin) == exact
        assert last.time == samples[-1].time


@pytest.mark.parametrize(
    "rows",
    [(150, 31, 100), *(pytest.param(rows, marks=pytest.mark.validate) for rows in ((1,), (399,)))],
)
def test_a_shear_flow_goes_on_to_the_same_bits(rows: tuple[int, ...], whole: Path, tmp_path: Path):
    folder = interrupted(tmp_path / "run", rows[0])
    for row in rows[1:]:
        interrupted(folder, row)
    result = resume(CASE, folder)
    assert same(whole, folder)
    assert answers_of(folder) == answers_of(whole)
    steps = [point["step"] for point in result.record["provenance"]["resumed"]]
    assert steps == [7 * sum(rows[: k + 1]) for k in range(len(rows))]
    sessions = [one["status"] for one in result.record["provenance"]["sessions"]]
    assert sessions == ["killed"] * len(rows) + ["finished"]
    assert not list(folder.glob("state-*"))
    assert analyze(folder).record == result.record
    assert resume(None, folder).record == result.record


def test_a_flow_that_is_interrupted_loses_no_row(
    whole: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """Although a state is due once a minute only."""
    monkeypatch.setattr(checkpoint, "EVERY_S", 60.0)
    folder = interrupted(tmp_path / "run", 50)
    result = resume(None, folder)
    assert [one["step"] for one in result.record["provenance"]["resumed"]] == [7 * 50]
    assert same(whole, folder)


@pytest.mark.parametrize("end", STOPS)
def test_a_flow_that_may_end_early_ends_at_the_same_strain(end: str, tmp_path: Path):
    known = run(STOPS[end], tmp_path / "whole")
    assert known.record["stopped_by"] == end
    folder = interrupted(tmp_path / "run", len(known.series) - 1, STOPS[end])
    interrupted(folder, 1, STOPS[end])
    resume(None, folder)
    assert same(known.folder, folder)
    assert answers_of(folder) == answers_of(known.folder)


@pytest.mark.validate
def test_a_flow_on_two_threads_goes_on_to_the_same_bits(tmp_path: Path):
    known = run(CASE, tmp_path / "whole", ranks=2).folder
    folder = interrupted(tmp_path / "run", 200, ranks=2)
    resume(None, folder)
    assert same(known, folder)


@pytest.mark.parametrize("damage", ["later", "both"])
def test_a_damaged_state_is_passed_over_in_a_sentence(
    damage: str, whole: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture
):
    folder = interrupted(tmp_path / "run", 50)
    later = max(checkpoint.FILES, key=lambda name: (folder / name).stat().st_mtime_ns)
    damaged = [later] if damage == "later" else sorted(checkpoint.FILES)
    for name in damaged:
        content = bytearray((folder / name).read_bytes())
        content[len(content) // 2] ^= 1
        (folder / name).write_bytes(content)
    with caplog.at_level(logging.INFO, "liftdrag"):
        result = resume(None, folder)
    goes_on = "From step 343 of the stage drive."
    anew = "Nothing was kept yet: from the beginning."
    told = [f"{name} is damaged and is passed over." for name in damaged]
    told.append(goes_on if damage == "later" else anew)
    assert caplog.messages[-len(told) :] == told
    points = result.record["provenance"].get("resumed", [])
    assert [point["step"] for point in points] == [343] * (damage == "later")
    assert same(whole, folder)
    assert answers_of(folder) == answers_of(whole)


def test_a_run_that_goes_on_spares_the_later_state(tmp_path: Path):
    folder = interrupted(tmp_path / "run", 50)
    later = max(checkpoint.FILES, key=lambda name: (folder / name).stat().st_mtime_ns)
    before = (folder / later).read_bytes()
    interrupted(folder, 1)
    assert (folder / later).read_bytes() == before


def test_another_deck_is_refused(tmp_path: Path):
    folder = interrupted(tmp_path / "run", 10)
    with (folder / START).open("a") as deck:
        deck.write("\n")
    with pytest.raises(InputError, match=rf"{START} is not the file that was written"):
        resume(None, folder)


KILLED = """
import os, signal, sys
sys.path.insert(0, sys.argv[1])
from liftdrag.engines import checkpoint
from liftdrag.resume import resume
from test_resume_shear import CASE, told
checkpoint.EVERY_S, checkpoint.SHARE = 0.0, 1e9
def end(): os.kill(os.getpid(), signal.SIGKILL)
resume(CASE, sys.argv[2], progress=told(int(sys.argv[3]), end))
"""


def test_a_flow_that_is_killed_goes_on_to_the_same_bits(whole: Path, tmp_path: Path):
    """With kill -9, which no handler sees."""
    folder = tmp_path / "run"
    command = [sys.executable, "-c", KILLED, str(Path(__file__).parent), str(folder), "121"]
    assert subprocess.run(command, check=False).returncode == -signal.SIGKILL
    result = resume(None, folder)
    assert [one["step"] for one in result.record["provenance"]["resumed"]] == [7 * 120]
    assert same(whole, folder)
    assert answers_of(folder) == answers_of(whole)
