"""What the runs of a point of a study answered."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from liftdrag.analysis.precision import hidden_scatter, pooled
from liftdrag.analysis.quantity import Quantity
from liftdrag.ensemble import PACKINGS, each_of
from liftdrag.errors import InputError, shown
from liftdrag.study.plan import is_quantity
from liftdrag.study.points import Point
from liftdrag.study.state import STATUSES, State
from liftdrag.study.tasks import Task, tasks_of


@dataclass(frozen=True)
class Answer:
    """A point, its tasks and the state of each; `quantities` of those tasks that have finished."""

    point: Point
    runs: tuple[tuple[Task, State], ...]
    quantities: Mapping[str, Quantity]

    @property
    def status(self) -> str:
        """Finished, or how far the run is that has come least far."""
        return max((state.status for _, state in self.runs), key=STATUSES.index)

    @property
    def replicas(self) -> tuple[int, int]:
        """How many of its runs have finished, and how many there are."""
        return sum(state.finished for _, state in self.runs), len(self.runs)

    @property
    def whole(self) -> bool:
        """Whether all of its runs have finished."""
        return self.status == "finished"

    @property
    def folder(self) -> Path | None:
        """Where its first run is."""
        return self.runs[0][1].folder

    def quantity(self, name: str) -> Quantity:
        """The quantity of this name. Raises InputError when there is none."""
        if name not in self.quantities:
            raise InputError(
                f"The run in {self.folder} has no {shown(name)}; it has "
                f"{', '.join(self.quantities)}."
            )
        return self.quantities[name]

    def place(self, against: str, over: str | None = None) -> tuple[float, float]:
        """The number of a key or a quantity and its standard error, 0 of a key.

        Both are over the number of the key `over` where there is one.
        """
        scale = self.point.number(over) if over else 1.0
        if not is_quantity(against):
            return self.point.number(against) / scale, 0.0
        found = self.quantity(against)
        return found.mean / scale, found.standard_error / abs(scale)

    def each(self, name: str) -> np.ndarray | None:
        """The quantity of each packing (n,) of an ensemble, None where it is of one series."""
        if self.folder is None or not (self.folder / PACKINGS).exists():
            return None
        return each_of(self.folder, name, self.quantity(name).unit)


def answer(point: Point, states: Mapping[str, State]) -> Answer:
    """The answer of a point from the states of the tasks by digest."""
    runs = tuple((task, states[task.digest]) for task in tasks_of(point))
    done = [state.quantities for _, state in runs if state.finished]
    return Answer(point, runs, dict(_pooled(done)) if done else {})


def _pooled(runs: list[Mapping[str, Quantity]]) -> Iterator[tuple[str, Quantity]]:
    """The means over the seeds of what all of them have.

    The standard error is the larger of that by their scatter and that by their own errors.
    """
    for name in runs[0]:
        group = [one[name] for one in runs if name in one]
        if len(runs) == 1:
            yield name, group[0]
        elif len(group) == len(runs):
            yield name, pooled(group, hidden_scatter([group]))
