"""What the running tanks of a study answer so far, by their series on the disk.

The in-house engine writes its series at the end, so nothing is known of its runs before.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

from liftdrag.analysis.quantity import Quantity
from liftdrag.analysis.tank import forces
from liftdrag.engines import engine
from liftdrag.errors import InputError
from liftdrag.folder import Record
from liftdrag.scene import TankScene
from liftdrag.study.pool import View
from liftdrag.study.tasks import Task, folder_of

SHARE = 0.02
"""Of the time on the clock, about this is spent on reading series."""

LEAST_S, MOST_S = 1.0, 10.0
"""Seconds between two looks, each at one run."""


class Early:
    """The answers of running tanks by the names of their tasks, one looked at after the other."""

    def __init__(self) -> None:
        self.answers = dict[str, Mapping[str, Quantity]]()
        self._next = time.monotonic() + LEAST_S

    def look(self, view: View) -> None:
        """Look at the run that was looked at longest ago, unless that was a moment ago."""
        begin = time.monotonic()
        tasks = {row.task.name: row.task for row in view.rows if row.task}
        self.answers = {name: one for name, one in self.answers.items() if name in tasks}
        if begin < self._next or not tasks:
            return
        new = [name for name in tasks if name not in self.answers]
        name = next(iter([*new, *self.answers]))
        self.answers.pop(name, None)
        self.answers[name] = so_far(tasks[name], folder_of(tasks[name], view.study))
        now = time.monotonic()
        self._next = now + min(max((now - begin) / SHARE, LEAST_S), MOST_S)


def so_far(task: Task, folder: Path) -> dict[str, Quantity]:
    """Drag and lift of a tank whose run is in `folder`; none before its flow is steady."""
    scene = task.case.scene
    if not isinstance(scene, TankScene):
        return {}
    with suppress(InputError, OSError, ValueError, LookupError):
        record = Record.read(folder)
        series = engine(record.engine).series(record.plan, folder)
        return forces(scene, series.first(len(series) - 1))
    return {}
