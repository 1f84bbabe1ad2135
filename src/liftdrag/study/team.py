"""Tasks carried out over the ranks of an MPI job: the first hands them out, the others run them.

A task runs in a process of its own outside of the job, which would otherwise be taken for a rank.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor, as_completed
from pathlib import Path
from typing import cast

from liftdrag.engines import mpi, process
from liftdrag.study.pool import SAYS, Watch, child_command, ended, told
from liftdrag.study.state import State
from liftdrag.study.tasks import IN_USE, Task, request


def carry_out(
    tasks: Sequence[Task], study: Path, ranks: int | None, watch: Watch
) -> Mapping[str, State]:
    """The states of the tasks by digest, on the first rank; the others end here.

    What another process is at is left to it.
    """
    from mpi4py import MPI
    from mpi4py.futures import MPICommExecutor

    states = dict[str, State]()
    with MPICommExecutor(MPI.COMM_WORLD, root=0) as found:
        pool = cast("Executor | None", found)
        if pool is not None:
            sent = {pool.submit(work, task, study, ranks): task for task in tasks}
            for future in as_completed(sent):
                task, code = sent[future], future.result()
                away = State("running", "another liftdrag is at it")
                states[task.digest] = away if code == IN_USE else ended(task, study, code)
                watch.say(told(task, states[task.digest], len(states), len(tasks)))
    if MPI.COMM_WORLD.rank > 0:
        sys.exit(0)
    return states


def work(task: Task, study: Path, ranks: int | None) -> int:
    """Run a task on this rank; the exit status of its process."""
    place = request(task, study).absolute()
    command = child_command(study, task, ranks)
    started = process.start(command, place, mpi.outside(os.environ), SAYS)
    return process.watch(started, place, lambda: None).code
