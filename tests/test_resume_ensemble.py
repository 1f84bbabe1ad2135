"""An ensemble that was cut short keeps the packings that have finished, and runs the others."""

from __future__ import annotations

import json
import os
import signal
from pathlib import Path

import pytest
from kills import engines_in, struck
from test_drag2d_scene import tiny

import liftdrag.ensemble
from liftdrag.ensemble import OUTCOME, packing_folder
from liftdrag.errors import RunFailed
from liftdrag.resume import resume
from liftdrag.runner import run

CASE = tiny().set("ensemble.runs", 4)
TABLES = ("drag.csv", "packings.csv")


@pytest.fixture(scope="module")
def whole(tmp_path_factory) -> Path:
    return run(CASE, tmp_path_factory.mktemp("whole") / "run", ranks=1).folder


def interrupted(folder: Path, after: int, engine: str = "dem") -> list[str]:
    """The packings that finished before the run was interrupted."""

    def interrupt(stage: str, done: int, _total: int) -> None:
        if stage == "packings" and done >= after:
            raise KeyboardInterrupt

    with pytest.raises(RunFailed) as caught:
        run(CASE, folder, engine, ranks=1, progress=interrupt)
    assert caught.value.status == "killed"
    assert caught.value.reason.endswith(f"Go on with: liftdrag run --resume --out {folder}")
    return sorted(file.parent.name for file in folder.glob(f"*/{OUTCOME}"))


def test_packings_that_have_finished_are_kept(whole, tmp_path, monkeypatch):
    folder, made = tmp_path / "run", list[int]()
    kept = interrupted(folder, 2)
    assert 2 <= len(kept) < 4
    real = liftdrag.ensemble._made

    def counted(case, scene, number, dialect):
        made.append(number)
        return real(case, scene, number, dialect)

    monkeypatch.setattr(liftdrag.ensemble, "_made", counted)
    before = [(folder / name / "series.csv").stat().st_mtime_ns for name in kept]
    result = resume(None, folder, ranks=1)
    assert [(folder / name / "series.csv").stat().st_mtime_ns for name in kept] == before
    assert made == list(range(len(kept), 4))
    assert result.status == "finished"
    for name in TABLES:
        assert (folder / name).read_bytes() == (whole / name).read_bytes()
    old = json.loads((whole / "result.json").read_text())
    assert {key: result.record[key] for key in ("steps", "grains", "quantities")} == {
        key: old[key] for key in ("steps", "grains", "quantities")
    }


@pytest.mark.parametrize("damage", ["begun", "failed", "deck", "series"])
def test_a_packing_that_is_not_whole_is_run_again(whole, tmp_path, damage):
    folder = tmp_path / "run"
    interrupted(folder, 3)
    place = packing_folder(folder, 1)
    if damage == "begun":
        (place / OUTCOME).unlink()
        (place / "series.csv").write_text("time")
    if damage == "failed":
        ended = json.loads((place / OUTCOME).read_text())
        (place / OUTCOME).write_text(json.dumps(ended | {"status": "lost_grains"}))
    if damage == "deck":
        deck = next(iter(json.loads((place / OUTCOME).read_text())["deck_files"]))
        (place / deck).write_bytes(b"another")
    if damage == "series":
        rows = (place / "series.csv").read_text().splitlines(keepends=True)
        (place / "series.csv").write_text("".join(rows[:-1]))
    resume(CASE, folder)
    for name in TABLES:
        assert (folder / name).read_bytes() == (whole / name).read_bytes()


@pytest.mark.validate
def test_an_ensemble_on_lammps_goes_on_when_its_engine_is_killed(tmp_path):
    other = run(CASE, tmp_path / "whole", "lammps", ranks=1).folder
    folder = tmp_path / "run"

    def kill(_stage: str, done: int, _total: int) -> None:
        while done == 1 and not (found := engines_in(folder)):
            pass
        for pid in found if done == 1 else ():
            os.kill(pid, signal.SIGKILL)

    reason = struck(folder, lambda: run(CASE, folder, "lammps", ranks=1, progress=kill))
    assert "killed: packing 2" in reason
    resume(None, folder)
    for name in TABLES:
        assert (folder / name).read_bytes() == (other / name).read_bytes()


def test_an_ensemble_that_takes_too_long_times_out_and_goes_on(whole, tmp_path):
    folder = tmp_path / "run"
    with pytest.raises(RunFailed) as caught:
        run(CASE, folder, ranks=1, timeout_s=1e-3)
    assert caught.value.status == "timeout"
    assert json.loads((folder / "result.json").read_text())["status"] == "timeout"
    resume(None, folder)
    assert (folder / "drag.csv").read_bytes() == (whole / "drag.csv").read_bytes()
