"""Whether a run finished, decided from what it left behind."""

from __future__ import annotations

import re
import shutil
from math import prod
from pathlib import Path

import numpy as np

from liftdrag.deck import Plan
from liftdrag.engines.fills import as_they_were, early, ends_in
from liftdrag.engines.stopper import PRECISION, STOP, stop_files
from liftdrag.errors import InputError
from liftdrag.files import text
from liftdrag.tables import column, read_table

DISK_FULL = "the disk is full; free some and run again"

LOOP = re.compile(
    r"Loop time of (\d+(?:\.\d+)?(?:e[-+]?\d+)?) on \d+ procs for (\d+) steps with (\d+) atoms"
)
_GRID = re.compile(r"^\s*(\d+) by (\d+) by (\d+) MPI processor grid", re.MULTILINE)
_SIGNAL = re.compile(
    r"EXIT STRING: (.*\(signal \d+\))|EXIT CODE: (9|15)$|exited on signal (9|15) ", re.MULTILINE
)
_END = re.compile(r"^LIFTDRAG FINISHED at step (\d+)$", re.MULTILINE)
_SETTLED = re.compile(r"^LIFTDRAG SETTLED after (\d+) steps,", re.MULTILINE)
_UNSETTLED = re.compile(r"^LIFTDRAG UNSETTLED: (.*)$", re.MULTILINE)
_COPIES = re.compile(r"^ERROR.*[Pp]rocessors != physical processors", re.MULTILINE)
_CAUSES = (
    (
        r"^ERROR.*[Ll]ost atoms",
        "lost_grains",
        "grains left the box; a smaller numerics.time_step may help",
    ),
    (
        r"^ERROR.*([Nn]on-numeric|out of range - cannot compute)",
        "not_finite",
        "a position is not a number; a smaller numerics.time_step may help",
    ),
    (
        r"^ERROR.*(skin too small|time-?step.*(rayleigh|hertz))",
        "engine_error",
        "grains move too fast for the time step; a smaller numerics.time_step or a slower "
        "drive.speed may help",
    ),
    (r"No space left on device", "disk_full", DISK_FULL),
)

LEAST_FREE = 65536
"""Bytes below which a disk is full to an engine that could not write."""


def verdict(plan: Plan, folder: Path, log: str, said: str, code: int) -> tuple[str, str]:
    """The status and its reason: "finished" only with end mark, last step and finite series.

    `log` is the engine's log, `said` what it printed, `code` its exit status.
    """
    if plan.ranks > 1 and (ranks_of(log) == 1 or _COPIES.search(f"{log}\n{said}")):
        return "engine_error", (
            f"the engine ran as {plan.ranks} copies of one rank each: the launcher is not of its "
            "MPI, or its MPI is not of one job"
        )
    if _GRID.search(log) and ranks_of(log) != plan.ranks:
        return "engine_error", f"the engine ran on {ranks_of(log)} ranks, not {plan.ranks}"
    for pattern, status, reason in _CAUSES:
        if re.search(pattern, f"{log}\n{said}", re.MULTILINE):
            return status, reason
    if unsettled := _UNSETTLED.search(log):
        return "engine_error", f"the bed did not come to rest: {unsettled[1]}"
    end = _END.search(log)
    if end is None and _is_full(folder):
        return "disk_full", DISK_FULL
    if end is None and (code < 0 or _SIGNAL.search(said)):
        return "killed", "the engine was ended by a signal from outside"
    if end is None:
        return "engine_error", "the engine stopped before the end of the deck"
    last = _last_step(plan, folder, log)
    if int(end[1]) != last and stopped_by(plan, folder, log) == "distance":
        return "engine_error", f"the engine ended at step {end[1]}, not {last}"
    return _judge_series(plan, folder, int(end[1]))


def steps_before(logs: str, log: str, steps: int) -> int:
    """The steps of a finished run before its last session, of so many `steps` and this `log`."""
    if not (end := _END.search(log)):
        return 0
    settled = _SETTLED.findall(logs)
    return int(end[1]) + (int(settled[-1]) if settled else 0) - steps


def _is_full(folder: Path) -> bool:
    return folder.is_dir() and shutil.disk_usage(folder).free < LEAST_FREE


def stopped_by(plan: Plan, folder: Path, log: str) -> str:
    """What ended the run, or all its fills: "precision" or "request" by its file, or "distance"."""
    if plan.fills:
        return _fills_stopped_by(plan, folder, log)
    end = _END.search(log)
    early = end is not None and int(end[1]) < list(plan.stages.values())[-1]
    if not (plan.stoppable and early and (folder / STOP).exists()):
        return "distance"
    return PRECISION if text(folder / STOP) == PRECISION else "request"


def _fills_stopped_by(plan: Plan, folder: Path, log: str) -> str:
    files = _files_of_early(plan, folder, log)
    if len(files) < len(plan.fills) or not all(file.exists() for file in files):
        return "distance"
    return PRECISION if {text(file) for file in files} == {PRECISION} else "request"


def _files_of_early(plan: Plan, folder: Path, log: str) -> list[Path]:
    """For each fill that ended early, the file that asked for it."""
    numbers = early(plan, as_they_were(plan, ends_in(log))) if plan.stoppable else []
    return [folder / stop_files(number)[1] for number in numbers]


def _last_step(plan: Plan, folder: Path, log: str) -> int:
    """The step at which a deck ends: earlier than planned where files ended fills early."""
    files = _files_of_early(plan, folder, log)
    if files and all(file.exists() for file in files):
        return ends_in(log)[-1]
    return list(plan.stages.values())[-1]


def _judge_series(plan: Plan, folder: Path, last: int) -> tuple[str, str]:
    for name, channels in plan.series.items():
        try:
            table = read_table(folder / name, "ave-time")
            steps = column(table, "TimeStep")
        except InputError as error:
            return "engine_error", str(error)
        if gap := _gap(steps, plan.row_every, last):
            return "engine_error", f"{name} {gap}"
        found = table.reindex(columns=[f"v_{channel}" for channel in channels])
        if not np.isfinite(found.to_numpy()).all():
            return "not_finite", f"{name} holds values that are not finite numbers"
    return "finished", ""


def _gap(steps: np.ndarray, every: int, last: int) -> str:
    """What is wrong with the steps of a series, where it is not complete to the last one."""
    if steps[0] > every:
        return f"begins at step {steps[0]:.0f}"
    if last - steps[-1] >= every:
        return f"ends at step {steps[-1]:.0f}"
    wrong = np.flatnonzero(np.diff(steps) != every)
    return f"has a gap or a row too many after step {steps[wrong[0]]:.0f}" if wrong.size else ""


def ranks_of(log: str) -> int:
    """The ranks that the engine says it ran on; 0 when it did not come to say."""
    grid = _GRID.search(log)
    return prod(map(int, grid.groups())) if grid else 0


def last_words(*texts: str) -> str:
    """The last lines of an engine's outputs, those that name an error first."""
    lines = list(
        dict.fromkeys(line for part in texts for line in part.splitlines() if line.strip())
    )
    lines = [line for line in lines if not line.startswith("=") and "FAQ" not in line]
    errors = [line for line in lines if line.startswith(("ERROR", "LIFTDRAG UNSETTLED"))]
    return "\n".join(errors[-3:] or lines[-5:])
