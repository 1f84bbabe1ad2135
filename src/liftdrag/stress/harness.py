"""A case put under stress: points run one after another while time is left, some at a time."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from liftdrag.bench.axes import wanted
from liftdrag.bench.judged import CASE, finished, tolerances
from liftdrag.bench.points import Point, Task, points_of, reference
from liftdrag.bench.prepared import prepared, stand_of
from liftdrag.bench.runs import Run, Stand, folder_of, read
from liftdrag.bench.schedule import State
from liftdrag.bench.working import check_jobs, through
from liftdrag.case import Case
from liftdrag.cost import cores
from liftdrag.errors import InputError, RunFailed
from liftdrag.folder import RECORD, RESULT, read_json
from liftdrag.stress.axes import SEEDS, axes_of
from liftdrag.stress.outcome import RUNS, Tried, deviations_of, shifted
from liftdrag.stress.shortened import shortened
from liftdrag.stress.stressed import Stressed
from liftdrag.stress.written import begun, write

UNFINISHED = ("killed", "disk_full", "unknown")
"""Ends of a run that say nothing of its case."""


def stress(
    case: Case,
    engine: str | None = None,
    out: str | Path | None = None,
    budget_s: float = 600.0,
    jobs: int | None = None,
    axes: Sequence[str] = (),
    engine_path: str | Path | None = None,
    tell: Callable[[str], None] = lambda _words: None,
) -> Stressed:
    """Run a case cut short, and what differs from it in one choice, while the budget (s) lasts.

    `jobs` runs go on at a time, each on one core, by default one a core; `axes` are the choices
    to look at, by default all. What ended in the folder before, by default below runs/stress, is
    not run again, and the case stays as short as it was cut then. Raises InputError before
    anything runs, RunFailed when the case itself does not finish; a value that breaks is a
    finding.
    """
    check_jobs(jobs)
    seconds = budget_s * (jobs or cores())
    found, state = _planned(case, engine, out, axes, engine_path, seconds, budget_s)
    runs = list(state.runs)
    for line in found.bounds.lines():
        tell(line)

    def ended(one: Run) -> None:
        runs.append(one)
        tell(f"{one.axis} {one.name}: {one.status} {one.reason}".rstrip())

    try:
        through(state, found.stand, jobs, ended, next_task)
        _check(runs)
    finally:
        left = left_out(replace(state, runs=tuple(runs)))
        found = replace(found, tried=tuple(_tried(one, found.stand) for one in runs), left=left)
        write(found)
    return found


def _planned(
    case: Case,
    engine: str | None,
    out: str | Path | None,
    axes: Sequence[str],
    engine_path: str | Path | None,
    seconds: float,
    budget_s: float,
) -> tuple[Stressed, State]:
    """The map with the runs of before, and where it goes on; its folder is made.

    `seconds` of processor time are there for all of it.
    """
    plain, chosen, folder = prepared(case, engine, engine_path, out, "stress")
    names = [axis.name for axis in axes_of(plain)]
    asked = wanted([*names, SEEDS], axes)
    whole = [axis for axis in axes_of(plain) if axis.name in asked]
    short = begun(folder, case, chosen.name, shortened(plain, whole, seconds))
    goals, stand = tolerances(short.scene), stand_of(folder, chosen, engine_path, short.scene)
    known = tuple(axis for axis in axes_of(short) if axis.name in asked)
    others, refused = points_of(short, known)
    points = (reference(short), *others)
    before = tuple(one for point in points for one in _earlier(point, stand))
    state = State(points, before, (), goals, budget_s)
    return Stressed(case, short, stand, known, (), refused), state


def next_task(state: State) -> Task | None:
    """The case itself, then what is in doubt, then the others, the cheapest first."""
    case = state.points[0]
    if state.started(case) < 1:
        return Task(case, 1)
    if CASE not in finished(state.runs):
        return None
    again = [case] if state.started(case) < RUNS else []
    for point in (*again, *_doubted(state), *_unseen(state)):
        if state.affords(point):
            return Task(point, state.started(point) + 1)
    return None


def left_out(state: State) -> list[str]:
    """What the time was too short for, in words: points, and points that stay in doubt."""
    unseen = [f"{point.axis} {point.name}" for point in _unseen(state)]
    return [*unseen, *(f"more runs of {point.axis} {point.name}" for point in _doubted(state))]


def _unseen(state: State) -> list[Point]:
    """The points without a run, the cheapest first."""
    found = [point for point in state.points if not state.started(point)]
    return sorted(found, key=lambda point: point.hint_s)


def _doubted(state: State) -> list[Point]:
    """The points whose answer seems another, of too few runs to be sure."""
    off = shifted(deviations_of(state.runs, state.tolerances), state.tolerances)
    return [point for point in state.points if point.key in off and state.started(point) < RUNS]


def _earlier(point: Point, stand: Stand) -> Iterator[Run]:
    """The runs of a point that ended in the folder before, whole or broken."""
    replica = 1
    while (run := _ended(Task(point, replica), stand)) is not None:
        yield run
        replica += 1


def _ended(task: Task, stand: Stand) -> Run | None:
    folder = folder_of(stand, task)
    try:
        record, result = read_json(folder / RECORD), read_json(folder / RESULT)
    except InputError:
        return None
    version = result.get("engine", {}).get("version")
    if record.get("tables") != dict(task.case.tables) or version != stand.version:
        return None
    if result["status"] == "finished":
        return read(task, stand) if result.get("quantities") else None
    if result["status"] in UNFINISHED:
        return None
    said = next(iter(result.get("warnings", [])), "")
    return Run(*task.point.key, task.replica, result["status"], said, result.get("cpu_s", 0.0))


def _tried(run: Run, stand: Stand) -> Tried:
    folder = stand.folder / run.axis / run.name / f"run-{run.replica}"
    try:
        return Tried(run, read_json(folder / RESULT).get("invariants", {}))
    except InputError:
        return Tried(run, {})


def _check(runs: Sequence[Run]) -> None:
    """Raise RunFailed when the case itself has no answer."""
    failed = [one for one in runs if one.key == CASE and not one.finished]
    if failed and CASE not in finished(runs):
        raise RunFailed(failed[0].status, f"The case itself failed: {failed[0].reason}")
