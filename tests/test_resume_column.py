"""A column of the in-house engine that was cut short goes on to the same bits."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from test_janssen_scene import tiny

from liftdrag.arrays import read_arrays
from liftdrag.engines import checkpoint
from liftdrag.engines.dem_column import DECK
from liftdrag.errors import InputError, RunFailed
from liftdrag.resume import resume
from liftdrag.runner import run

CASE = tiny()
FILES = ("forces.csv", "fills.csv", "curve.csv", "profile.csv", "series.csv")


@pytest.fixture(autouse=True)
def often(monkeypatch):
    """A state is kept after each block."""
    monkeypatch.setattr(checkpoint, "EVERY_S", 0.0)
    monkeypatch.setattr(checkpoint, "SHARE", 1e9)


@pytest.fixture(scope="module")
def whole(tmp_path_factory) -> Path:
    return run(CASE, tmp_path_factory.mktemp("whole") / "run", "dem").folder


def interrupted(folder: Path, share: float) -> Path:
    """The folder of a run that was interrupted after a share of its steps."""

    def interrupt(stage: str, done: int, total: int) -> None:
        if stage == "drive" and done >= share * total:
            raise RunFailed("killed", "killed")

    with pytest.raises(RunFailed, match="Go on with: liftdrag run --resume --out"):
        run(CASE, folder, "dem", progress=interrupt)
    return folder


def same(one: Path, other: Path) -> bool:
    return all((one / name).read_bytes() == (other / name).read_bytes() for name in FILES)


@pytest.mark.parametrize(
    "share", [0.45, *(pytest.param(share, marks=pytest.mark.validate) for share in (0.1, 0.8))]
)
def test_a_column_goes_on_to_the_same_bits(share, whole, tmp_path):
    folder = interrupted(tmp_path / "run", share)
    result = resume(None, folder)
    assert same(whole, folder)
    (step,) = (point["step"] for point in result.record["provenance"]["resumed"])
    old = json.loads((whole / "result.json").read_text())
    assert result.record["steps"] == old["steps"]
    assert 0 < step <= share * old["steps"]
    assert result.record["quantities"] == old["quantities"]
    assert not list(folder.glob("state-*"))


@pytest.mark.parametrize(
    "damage", ["later", pytest.param("both", marks=pytest.mark.validate), "other deck"]
)
def test_a_state_that_is_not_whole_or_of_another_deck_is_passed_over(whole, tmp_path, damage):
    folder = interrupted(tmp_path / "run", 0.6)
    steps = {name: int(read_arrays(folder / name)["done"]) for name in checkpoint.FILES}
    later = max(steps, key=steps.get)
    for name in checkpoint.FILES:
        content = bytearray((folder / name).read_bytes())
        if damage == "both" or (damage == "later" and name == later):
            content[len(content) // 2] ^= 1
            (folder / name).write_bytes(content)
    if damage == "other deck":
        (folder / "column.toml").write_text((folder / "column.toml").read_text() + "\n")
        assert checkpoint.Keeper(folder, DECK).latest() is None
        with pytest.raises(InputError, match=r"column\.toml is not the file that was written"):
            resume(None, folder)
        return
    found = resume(None, folder).record["provenance"].get("resumed", [])
    assert [point["step"] for point in found] == ([min(steps.values())] * (damage == "later"))
    assert same(whole, folder)


@pytest.mark.validate
def test_a_column_that_is_killed_goes_on_to_the_same_bits(whole, tmp_path):
    """With kill -9, in compiled code or out of it."""
    folder = tmp_path / "run"
    code = (
        "import os, signal, sys, threading; sys.path.insert(0, sys.argv[1])\n"
        "from liftdrag.engines import checkpoint\n"
        "checkpoint.EVERY_S, checkpoint.SHARE = 0.0, 1e9\n"
        "from test_janssen_scene import tiny; from liftdrag.runner import run\n"
        "end = lambda: os.kill(os.getpid(), signal.SIGKILL)\n"
        "def kill(stage, done, total):\n"
        "    if stage == 'drive' and done >= 0.5 * total: threading.Timer(0.02, end).start()\n"
        "run(tiny(), sys.argv[2], 'dem', progress=kill)"
    )
    command = [sys.executable, "-c", code, str(Path(__file__).parent), str(folder)]
    assert subprocess.run(command, env=os.environ, check=False).returncode == -signal.SIGKILL
    resume(None, folder)
    assert same(whole, folder)
