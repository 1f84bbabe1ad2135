"""How long the runs of a study will still take, from their foreseen costs and what runs took."""

from __future__ import annotations

import time
from contextlib import suppress

from liftdrag.cost import expected
from liftdrag.errors import InputError
from liftdrag.numerics import derive
from liftdrag.runner import engine_for
from liftdrag.study.pool import Row, View
from liftdrag.study.tasks import Task

PATIENCE_S = 0.02
"""For which new tasks are foreseen at a time; the others are at the next look."""


class Forecast:
    """The seconds on the clock that tasks should take, each foreseen once."""

    def __init__(self) -> None:
        self._foreseen = dict[str, float | None]()

    def left_s(self, view: View) -> float | None:
        """Until all have ended; None while that of any is not foreseen.

        Jobs that are free share what waits evenly, and none ends before its longest run.
        """
        going = [row.task for row in view.rows if row.task]
        self._foresee([*going, *view.waiting, *(task for task, _ in view.took)], view.ranks)
        if any(self._foreseen.get(task.name) is None for task in [*going, *view.waiting]):
            return None
        left = [self.run_left_s(row, view) or 0.0 for row in view.rows if row.task]
        left += [self._task_s(task, view) or 0.0 for task in view.waiting]
        return max([sum(left) / view.jobs, *left], default=0.0)

    def run_left_s(self, row: Row, view: View) -> float | None:
        """Of a run that goes on: at least that of its stage."""
        whole = self._task_s(row.task, view) if row.task else None
        return row.left_s if whole is None else max(whole - row.went_s, row.left_s or 0.0)

    def _task_s(self, task: Task, view: View) -> float | None:
        foreseen = self._foreseen.get(task.name)
        return None if foreseen is None else foreseen * self._pace(view)

    def _pace(self, view: View) -> float:
        """What the runs that have ended took, over what was foreseen of them."""
        pairs = [(took, self._foreseen.get(task.name)) for task, took in view.took]
        known = [(took, foreseen) for took, foreseen in pairs if foreseen]
        return sum(one for one, _ in known) / sum(one for _, one in known) if known else 1.0

    def _foresee(self, tasks: list[Task], ranks: int) -> None:
        until = time.monotonic() + PATIENCE_S
        for task in tasks:
            if time.monotonic() > until:
                return
            if task.name not in self._foreseen:
                self._foreseen[task.name] = foreseen_s(task, ranks)


def foreseen_s(task: Task, ranks: int) -> float | None:
    """Seconds on the clock that a task should take; None where nothing is known of it."""
    with suppress(InputError):
        scene = task.case.scene
        times = expected(scene, derive(scene), engine_for(task.case, task.engine), ranks).times
        return times.packing_s + times.wall_s
    return None
