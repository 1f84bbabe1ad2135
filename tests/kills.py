"""Runs that are killed at a moment, and what they leave."""

from __future__ import annotations

import contextlib
import os
import shutil
import signal
from collections.abc import Callable
from pathlib import Path

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


def end_engines(folder: Path) -> None:
    """Kill those that are there still."""
    for pid in engines_in(folder):
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)


class Kill:
    """A progress that kills the engine in `folder` at a step of a stage; None kills nothing."""

    def __init__(self, folder: Path, stage: str, step: int):
        self.folder, self.stage, self.step = folder, stage, step

    def __call__(self, stage: str, done: int, _total: int) -> None:
        if stage == self.stage and done >= self.step:
            end_engines(self.folder)


TRIES = 10
"""A tiny run may be over before a busy machine looks at it: its kill is tried again."""


def struck(folder: Path, attempt: Callable[[], object]) -> str:
    """Why the run in `folder` failed under an attempt whose engine was killed in its midst.

    An attempt that came to its end is undone and made again.
    """
    before = folder.with_name(f"{folder.name}-before")
    if folder.exists():
        shutil.copytree(folder, before)
    for _ in range(TRIES):
        try:
            attempt()
        except RunFailed as failed:
            if failed.status != "killed":
                raise
            shutil.rmtree(before, ignore_errors=True)
            return str(failed)
        shutil.rmtree(folder)
        if before.exists():
            shutil.copytree(before, folder)
    raise AssertionError(f"{TRIES} runs in {folder} ended before they were killed")


def killed(folder: Path, stage: str, step: int, case: Case = TANK, engine: str = "lammps") -> Path:
    """The folder of a run whose engine was killed at that step or soon after."""
    struck(folder, lambda: run(case, folder, engine, progress=Kill(folder, stage, step)))
    return folder
