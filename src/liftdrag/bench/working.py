"""Runs carried out while time is left, some at a time, each with a bed of its own."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import closing, contextmanager
from dataclasses import replace

from liftdrag.bench.points import Task
from liftdrag.bench.runs import Run, Stand, carried_out, warm_up
from liftdrag.bench.schedule import State, next_task
from liftdrag.cost import cores
from liftdrag.engines import mpi
from liftdrag.engines.base import Progress
from liftdrag.errors import InputError, RunFailed

BEDS = "LIFTDRAG_BEDS"
"""The variable that says whether settled beds are kept for other runs."""

Work = Callable[[Task], Run]
Clock = Callable[[], float]


def check_jobs(jobs: int | None) -> None:
    """Raise InputError where no runs can be started, so many at a time."""
    if mpi.world(program="liftdrag").size > 1:
        raise InputError("A bench starts its runs by itself; start it without mpiexec.")
    if jobs is not None and jobs < 1:
        raise InputError(f"--jobs {jobs} is not at least 1.")


@contextmanager
def own_beds() -> Iterator[None]:
    """Each run settles its own bed: what it takes must not depend on what ran before."""
    before = os.environ.get(BEDS)
    os.environ[BEDS] = "off"
    try:
        yield
    finally:
        os.environ.pop(BEDS, None)
        if before is not None:
            os.environ[BEDS] = before


def spent(
    state: State,
    work: Work,
    jobs: int,
    halted: threading.Event,
    clock: Clock = time.monotonic,
    choose: Callable[[State], Task | None] = next_task,
) -> Generator[Run]:
    """The runs that the time of `state` allows, as they end; a run on several ranks goes alone.

    `halted` is set when it ends, so that runs that still go on may stop; `choose` says what is
    next.
    """
    deadline = clock() + state.left_s
    pending: dict[Future[Run], Task] = {}
    pool = ThreadPoolExecutor(jobs)
    try:
        while True:
            going = tuple(pending.values())
            state = replace(state, pending=going, left_s=deadline - clock())
            task = choose(state)
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


def through(
    state: State,
    stand: Stand,
    jobs: int | None,
    tell: Callable[[Run], None],
    choose: Callable[[State], Task | None] = next_task,
) -> None:
    """Carry out what is chosen, `jobs` at a time or one a core, and tell of each run that ended."""
    halted = threading.Event()
    runs = spent(state, working(stand, halted), jobs or cores(), halted, choose=choose)
    with own_beds(), closing(runs) as ended:
        for one in ended:
            tell(one)


def working(stand: Stand, halted: threading.Event) -> Work:
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
