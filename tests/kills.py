"""Runs that are killed at a moment, and what they leave."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import pytest
from conftest import tiny_tank

from liftdrag.case import Case
from liftdrag.errors import RunFailed
from liftdrag.runner import run

TANK = tiny_tank(numerics={"restart_every": 500})
"""The tiny tank with some ten restart files."""


def engines_in(folder: Path) -> list[int]:
    """The processes whose working folder this is, or whose command names it, but not our own."""
    found = []
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit() and int(entry.name) != os.getpid():
            try:
                names = f"{(entry / 'cwd').readlink()} {(entry / 'cmdline').read_text()}"
            except OSError:
                continue
            if str(folder.resolve()) in names and "-m\0pytest" not in names:
                found.append(int(entry.name))
    return found


class Kill:
    """A progress that kills the engine in `folder` at a step of a stage; None kills nothing."""

    def __init__(self, folder: Path, stage: str, step: int):
        self.folder, self.stage, self.step = folder, stage, step

    def __call__(self, stage: str, done: int, _total: int) -> None:
        if stage == self.stage and done >= self.step:
            for pid in engines_in(self.folder):
                os.kill(pid, signal.SIGKILL)


def killed(folder: Path, stage: str, step: int, case: Case = TANK, engine: str = "lammps") -> Path:
    """The folder of a run whose engine was killed at that step or soon after."""
    with pytest.raises(RunFailed) as caught:
        run(case, folder, engine, progress=Kill(folder, stage, step))
    assert caught.value.status == "killed"
    return folder
