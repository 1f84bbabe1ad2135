"""A bench carried out: points chosen one after another while time is left, some at a time."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import closing, contextmanager
from dataclasses import replace
from pathlib import Path

from liftdrag.analysis.quantity import rounded
from liftdrag.bench.axes import Axis, axes_of
from liftdrag.bench.benched import Benched
from liftdrag.bench.judged import CASE, finished, tolerances
from liftdrag.bench.points import REFERENCE, Task, points_of, reference
from liftdrag.bench.runs import Run, Stand, carried_out, earlier, warm_up
from liftdrag.bench.schedule import State, left_out, next_task
from liftdrag.bench.written import begin, write
from liftdrag.case import Case
from liftdrag.cost import cores
from liftdrag.engines import mpi
from liftdrag.engines.base import Progress
from liftdrag.errors import InputError, RunFailed, shown
from liftdrag.runner import engine_for

BEDS = "LIFTDRAG_BEDS"
"""The variable that says whether settled beds are kept for other runs."""

Work = Callable[[Task], Run]
Clock = Callable[[], float]


def bench(
    case: Case,
    engine: str | None = None,
    out: str | Path | None = None,
    budget_s: float = 1800.0,
    jobs: int | None = None,
    axes: Sequence[str] = (),
    engine_path: str | Path | None = None,
    tell: Callable[[str], None] = lambda _words: None,
) -> Benched:
    """Run a case, and what differs from it in one choice, while the budget (s) lasts.

    `jobs` runs go on at a time, each on one core, by default one a core; `axes` are the choices
    to look at, by default all. What finished in the folder before, by default below runs/bench,
    is not run again. Raises InputError before anything runs, RunFailed when the case itself does
    not finish; a value that fails is a finding.
    """
    if mpi.world(program="liftdrag").size > 1:
        raise InputError("A bench starts its runs by itself; start it without mpiexec.")
    if jobs is not None and jobs < 1:
        raise InputError(f"--jobs {jobs} is not at least 1.")
    found, state = _planned(case, engine, out, axes, engine_path, budget_s)
    halted, runs = threading.Event(), list(state.runs)
    work = _working(found.stand, halted)
    try:
        with _own_beds(), closing(spent(state, work, jobs or cores(), halted)) as ended:
            for one in ended:
                runs.append(one)
                tell(_line(one))
        _check(runs)
    finally:
        left = left_out(replace(state, runs=tuple(runs)))
        found = replace(found, runs=tuple(runs), left=left)
        write(found)
    return found


@contextmanager
def _own_beds() -> Iterator[None]:
    """Each run settles its own bed: what it takes must not depend on what ran before."""
    before = os.environ.get(BEDS)
    os.environ[BEDS] = "off"
    try:
        yield
    finally:
        os.environ.pop(BEDS, None)
        if before is not None:
            os.environ[BEDS] = before


def _planned(
    case: Case,
    engine: str | None,
    out: str | Path | None,
    axes: Sequence[str],
    engine_path: str | Path | None,
    budget_s: float,
) -> tuple[Benched, State]:
    """The bench with the runs of before, and where it goes on; its folder is made."""
    plain = Case(case.name, {key: table for key, table in case.tables.items() if key != "stop"})
    chosen = engine_for(plain, engine, engine_path)
    chosen.check(1)
    known = axes_of(plain, chosen.name)
    wanted = _wanted(known, axes)
    others, refused = points_of(plain, known)
    points = (reference(plain), *others)
    goals = tolerances(plain.scene)
    folder = Path(out) if out is not None else Path("runs") / "bench" / case.name
    path = None if engine_path is None else Path(engine_path)
    stand = Stand(folder, chosen.name, chosen.about().version, path, tuple(goals))
    notes = [
        f"{axis} {name} is left out: {why}"
        for (axis, name), why in refused.items()
        if axis in wanted
    ]
    found = Benched(case, stand, known, goals, (), notes)
    begin(found)
    asked = tuple(point for point in points if point.axis in (REFERENCE, *wanted))
    return found, State(asked, tuple(earlier(points, stand)), (), goals, budget_s)


def _wanted(known: Sequence[Axis], asked: Sequence[str]) -> list[str]:
    names = [axis.name for axis in known]
    for name in asked:
        if name not in names:
            raise InputError(
                f"There is no axis {shown(name)} of this case on this engine; choose from "
                f"{', '.join(names)}."
            )
    return list(asked) or names


def spent(
    state: State,
    work: Work,
    jobs: int,
    halted: threading.Event,
    clock: Clock = time.monotonic,
) -> Generator[Run]:
    """The runs that the time of `state` allows, as they end; a run on several ranks goes alone.

    `halted` is set when it ends, so that runs that still go on may stop.
    """
    deadline = clock() + state.left_s
    pending: dict[Future[Run], Task] = {}
    pool = ThreadPoolExecutor(jobs)
    try:
        while True:
            going = tuple(pending.values())
            state = replace(state, pending=going, left_s=deadline - clock())
            task = next_task(state)
            if task is not None and _has_room(task, going, jobs):
                pending[pool.submit(work, task)] = task
            elif pending:
                for done in wait(pending, return_when=FIRST_COMPLETED).done:
                    del pending[done]
                    state = replace(state, runs=(*state.runs, done.result()))
                    yield done.result()
            else:
                return
    finally:
        halted.set()
        pool.shutdown(cancel_futures=True)


def _has_room(task: Task, going: Sequence[Task], jobs: int) -> bool:
    alone = any(one.point.ranks > 1 for one in (task, *going))
    return len(going) < (1 if alone else jobs)


def _working(stand: Stand, halted: threading.Event) -> Work:
    """What runs a task; before the first on one core, and on several, the engine is compiled."""
    lock, warm = threading.Lock(), set[bool]()

    def work(task: Task) -> Run:
        parallel = task.point.ranks > 1
        with lock:
            if stand.engine == "dem" and parallel not in warm:
                warm_up(task, stand, halted)
                warm.add(parallel)
        return carried_out(task, stand, _until(halted))

    return work


def _until(halted: threading.Event) -> Progress:
    """Progress that ends a run when the bench has ended."""

    def look(_stage: str, _done: int, _total: int) -> None:
        if halted.is_set():
            raise RunFailed("killed", "the bench was interrupted")

    return look


def _check(runs: Sequence[Run]) -> None:
    """Raise RunFailed when the case itself has no answer."""
    failed = [one for one in runs if one.key == CASE and not one.finished]
    if CASE not in finished(runs):
        raise RunFailed(failed[0].status, f"The case itself failed: {failed[0].reason}")


def _line(one: Run) -> str:
    """What is said of a run that ended."""
    name = f"{one.axis} {one.name}".strip() + f", run {one.replica}"
    if one.answers is None:
        return f"{name}: {one.status}, {one.reason}"
    answers = (
        f"{quantity} {' ± '.join(rounded(found.mean, found.standard_error))}"
        for quantity, found in one.answers.items()
    )
    return f"{name}: {one.cpu_s:.3g} s of processor time, {', '.join(answers)}"
