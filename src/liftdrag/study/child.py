"""One task of a study in a process of its own: `python -m liftdrag.study.child STUDY --task D`.

Whoever starts it, it claims the task first, so that no two work at the same. In an array job of
SLURM the line of a list says which task is meant.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import signal
import sys
import time
import traceback
from contextlib import ExitStack
from pathlib import Path
from types import FrameType
from typing import NoReturn

from liftdrag.engines import mpi
from liftdrag.engines.base import Progress
from liftdrag.errors import InputError, RunFailed
from liftdrag.execution import CUT_SHORT
from liftdrag.folder import RECORD, RESULT, read_json, write_json
from liftdrag.lock import held
from liftdrag.study.bedded import shared_bed, use_beds
from liftdrag.study.state import END, state_of
from liftdrag.study.tasks import (
    FAILED,
    FINISHED,
    IN_USE,
    PROGRESS,
    Task,
    claim,
    folder_of,
    requested,
)

EVERY_S = 0.5

ENDING = (signal.SIGTERM, signal.SIGHUP)


def carry_out(study: Path, digest: str, ranks: int | None) -> int:
    """Run a task of the study in `study`, or go on with it; the exit status.

    What fails is written down beside the task. Raises InputError where there is no such task.
    """
    place = claim(study, digest)
    task = requested(place)
    with ExitStack() as own:
        try:
            own.enter_context(held(place))
        except InputError as refusal:
            print(refusal, file=sys.stderr)
            return IN_USE
        (place / END).unlink(missing_ok=True)
        return _attempted(task, study, place, ranks)


def _attempted(task: Task, study: Path, place: Path, ranks: int | None) -> int:
    try:
        _run(task, study, place, ranks)
    except RunFailed as failure:
        reason = failure.reason.partition(" Go on with: ")[0]
        end = {"status": failure.status, "reason": _line(reason)}
    except InputError as refusal:
        end = {"status": "refused", "reason": _line(str(refusal))}
    except KeyboardInterrupt:
        end = {"status": "killed", "reason": "it was interrupted"}
    except Exception as error:
        traceback.print_exc()
        end = {"status": "error", "reason": _line(f"{type(error).__name__}: {error}")}
    else:
        return FINISHED
    print(end["reason"], file=sys.stderr)
    write_json(place / END, end)
    return FAILED


def _line(text: str) -> str:
    return " ".join(text.split())


def _run(task: Task, study: Path, place: Path, ranks: int | None) -> None:
    """Nothing where the task is finished; the rest of a run that can go on, or all of it.

    Raises InputError and RunFailed as a run does.
    """
    from liftdrag.resume import resume
    from liftdrag.runner import run

    folder = folder_of(task, study)
    if state_of(task, study, folder).finished:
        return
    (place / PROGRESS).unlink(missing_ok=True)
    progress = _written(place)
    if _cut_short(folder):
        try:
            own = ranks if task.case.tables["scene"] == "drag2d" else None
            resume(task.case, folder, task.engine, own, progress)
        except InputError as refusal:
            print(f"Run anew: {refusal}", file=sys.stderr)
        else:
            return
    if folder.exists():
        shutil.rmtree(folder)
    with shared_bed(task.case, study, folder, progress) as told:
        run(task.case, folder, task.engine, ranks, progress=told)


def _cut_short(folder: Path) -> bool:
    """Whether a run began there, and was not ended by a fault of its own."""
    if not (folder / RECORD).exists():
        return False
    if not (folder / RESULT).exists():
        return True
    try:
        return read_json(folder / RESULT).get("status") in CUT_SHORT
    except InputError:
        return False


def _written(place: Path) -> Progress:
    """Progress to a file of the task: the stage, steps done and planned, seconds in the stage."""
    stage_began, written, stage_now = time.monotonic(), -EVERY_S, ""

    def progress(stage: str, done: int, total: int) -> None:
        nonlocal stage_began, written, stage_now
        now = time.monotonic()
        if stage != stage_now:
            stage_now, stage_began = stage, now
        elif now - written < EVERY_S:
            return
        written = now
        said = {"stage": stage, "done": done, "total": total, "elapsed_s": now - stage_began}
        beside = place / f"{PROGRESS}.part"
        beside.write_text(json.dumps(said), "utf-8")
        beside.replace(place / PROGRESS)

    return progress


def _listed(file: Path) -> str:
    """The task of this element of an array job. Raises InputError when there is none."""
    lines, number = file.read_text("utf-8").split(), os.environ.get("SLURM_ARRAY_TASK_ID", "")
    if not number.isdecimal() or not 1 <= int(number) <= len(lines):
        raise InputError(f"{file} has no line {number!r}.")
    return lines[int(number) - 1]


def _interrupt(_signal: int, _frame: FrameType | None) -> NoReturn:
    """The first signal ends the run; others, one for each thread of a parent, are not heard."""
    for number in ENDING:
        signal.signal(number, signal.SIG_IGN)
    raise KeyboardInterrupt


def _leave_jobs() -> None:
    """Start engines on this machine, by themselves: not as ranks or steps of a job around us."""
    alone = mpi.outside(os.environ)
    for name in list(os.environ):
        if name not in alone or name.startswith("SLURM_"):
            del os.environ[name]
    os.environ["OMP_NUM_THREADS"] = "1"


def main() -> NoReturn:
    """Entry point; never returns."""
    parser = argparse.ArgumentParser(prog="python -m liftdrag.study.child")
    parser.add_argument("study", type=Path)
    parser.add_argument("--task")
    parser.add_argument("--list", type=Path)
    parser.add_argument("--ranks", type=int)
    asked = parser.parse_args()
    for number in ENDING:
        signal.signal(number, _interrupt)
    try:
        digest = asked.task or _listed(asked.list)
        _leave_jobs()
        use_beds(asked.study)
        sys.exit(carry_out(asked.study, digest, asked.ranks))
    except InputError as refusal:
        sys.exit(str(refusal))


if __name__ == "__main__":
    main()
