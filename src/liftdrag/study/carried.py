"""What the runs of a study answered, point by point."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from liftdrag.analysis.claims import Finding
from liftdrag.analysis.precision import hidden_scatter, pooled
from liftdrag.analysis.quantity import Quantity
from liftdrag.analysis.saturation import Saturation
from liftdrag.ensemble import PACKINGS, each_of
from liftdrag.errors import InputError, RunFailed, shown
from liftdrag.study.plan import Claim, Growth, Plan, is_quantity
from liftdrag.study.points import Point
from liftdrag.study.state import STATUSES, State
from liftdrag.study.tasks import Task, tasks_of


@dataclass(frozen=True)
class Answer:
    """A point, its tasks and the state of each; `quantities` once all of them have finished."""

    point: Point
    runs: tuple[tuple[Task, State], ...]
    quantities: Mapping[str, Quantity]

    @property
    def status(self) -> str:
        """Finished, or how far the run is that has come least far."""
        return max((state.status for _, state in self.runs), key=STATUSES.index)

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

    def place(self, against: str, over: str | None = None) -> float:
        """The number of a key or a quantity, over that of the key `over` where there is one."""
        own = is_quantity(against)
        value = self.quantity(against).mean if own else self.point.number(against)
        return value / self.point.number(over) if over else value

    def each(self, name: str) -> np.ndarray | None:
        """The quantity of each packing (n,) of an ensemble, None where it is of one series."""
        if self.folder is None or not (self.folder / PACKINGS).exists():
            return None
        return each_of(self.folder, name, self.quantity(name).unit)


def answer(point: Point, states: Mapping[str, State]) -> Answer:
    """The answer of a point from the states of the tasks by digest."""
    runs = tuple((task, states[task.digest]) for task in tasks_of(point))
    if not all(state.finished for _, state in runs):
        return Answer(point, runs, {})
    return Answer(point, runs, dict(_pooled([state.quantities for _, state in runs])))


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


@dataclass(frozen=True)
class Studied:
    """The results of a study's points by name, and what they say of its claims, in its folder."""

    plan: Plan
    folder: Path
    results: Mapping[str, Answer]
    findings: list[tuple[Claim, Finding]]
    growths: list[tuple[Growth, Saturation]] = field(default_factory=list)

    @property
    def unfinished(self) -> Iterator[tuple[str, State]]:
        """The runs that have not finished, by name."""
        for one in self.results.values():
            for task, state in one.runs:
                if not state.finished:
                    yield task.name, state

    def check(self) -> None:
        """Raise RunFailed when a run has not finished, with a line for each."""
        left = dict(self.unfinished)
        if left:
            lines = [f"{name}: {state.reason or state.status}" for name, state in left.items()]
            total = len({task.digest for one in self.results.values() for task, _ in one.runs})
            head = f"{len(left)} of {total} runs have not finished; the same command goes on."
            raise RunFailed("engine_error", "\n".join([head, *lines]))
