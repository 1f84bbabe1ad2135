"""Runs of a study that begin from the same bed: one settles it, and the others wait for it."""

from __future__ import annotations

import json
import threading
import time
from pathlib import Path

import pytest
from conftest import tiny_tank

from liftdrag import beds
from liftdrag.study.bedded import shared_bed
from liftdrag.study.child import carry_out
from liftdrag.study.tasks import Task, claim, folder_of, request

SLOW = tiny_tank(drive={"speed": "0.3 m/s", "distance": "5 D"})
FAST = tiny_tank(drive={"speed": "0.4 m/s", "distance": "5 D"})


@pytest.fixture
def study(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("LIFTDRAG_BEDS", str(tmp_path / "beds"))
    return tmp_path


def test_bed_is_kept_when_the_drive_begins_and_the_next_run_takes_it(study: Path):
    first, second = Task("slow", SLOW, "lammps"), Task("fast", FAST, "lammps")
    for task in (first, second):
        request(task, study)
        assert carry_out(study, task.digest, None) == 0
    reused = [
        json.loads((folder_of(task, study) / "result.json").read_text())["provenance"][
            "settled_bed"
        ]["reused"]
        for task in (first, second)
    ]
    assert reused == [False, True]
    said = claim(study, second.digest) / "progress.json"
    assert json.loads(said.read_text())["stage"] == "drive"


def test_second_run_waits_until_the_bed_is_there_and_not_longer(
    study: Path, monkeypatch: pytest.MonkeyPatch
):
    """The holder, like an engine that outlives its settling, never lets its claim go."""
    waited, kept = threading.Event(), threading.Event()
    monkeypatch.setattr("liftdrag.study.bedded.WAIT_S", 0.01)
    monkeypatch.setattr("liftdrag.lock.PATIENCE_S", 0.0)
    monkeypatch.setattr(beds, "find", lambda _scene: None)
    monkeypatch.setattr(beds, "keep", lambda *_: kept.set())
    monkeypatch.setattr(beds, "kept", lambda _: "settled" if kept.is_set() else "packed")
    stages = list[str]()

    def told(stage: str, _done: int, _total: int) -> None:
        stages.append(stage)
        waited.set()

    def second() -> None:
        with shared_bed(FAST, study, study / "two", told) as progress:
            progress("drive", 0, 1)

    with shared_bed(SLOW, study, study / "one", lambda *_: None) as progress:
        other = threading.Thread(target=second)
        other.start()
        assert waited.wait(30.0)
        progress("settle", 1, 2)
        time.sleep(0.1)
        assert other.is_alive()
        progress("drive", 0, 1)
        other.join(30.0)
        assert not other.is_alive()
    assert stages[0] == "bed"
    assert stages[-1] == "drive"
    assert not set(stages) - {"bed", "drive"}
