"""The points of a bench: the case as it is, and the case with one choice changed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from liftdrag.bench.axes import Axis, Setting
from liftdrag.case import Case
from liftdrag.errors import InputError
from liftdrag.numerics import derive

REFERENCE = "reference"
"""The axis of the case as it is."""

SAME = 2e-3
"""Relative difference of two values that are the same to a bench."""


@dataclass(frozen=True)
class Point:
    """A case to be run, the name of its axis and of its value, and what it should take.

    `hint_s` is processor time (s) as the numerics estimate it, `work` grain-steps; `end` says
    whether the value is the first or the last of its axis.
    """

    axis: str
    name: str
    case: Case
    ranks: int
    hint_s: float
    work: float
    end: bool

    @property
    def key(self) -> tuple[str, str]:
        """What tells it from the others."""
        return self.axis, self.name


@dataclass(frozen=True)
class Task:
    """One run of a point; replicas, from 1, differ in their seed."""

    point: Point
    replica: int

    @property
    def case(self) -> Case:
        """The case with the seed of the replica."""
        case = self.point.case
        return case.set("seed", case.tables["seed"] + self.replica - 1)


def reference(case: Case) -> Point:
    """The case as it is. Raises CaseError when it has no numerics."""
    return _point(REFERENCE, "", case, 1, True)


def points_of(case: Case, axes: Sequence[Axis]) -> tuple[list[Point], dict[tuple[str, str], str]]:
    """A point for each value that the scene takes, and by axis and name why it refuses others."""
    points, notes = list[Point](), dict[tuple[str, str], str]()
    for axis in axes:
        others = list(_others(axis))
        for setting in others:
            end = setting in (others[0], others[-1])
            try:
                points.append(_changed(case, axis, setting, end))
            except InputError as refused:
                notes[axis.name, setting.name] = str(refused)
    return points, notes


def _others(axis: Axis) -> Iterator[Setting]:
    """The values of an axis that differ from the case's own and from each other."""
    seen = [axis.own]
    for setting in axis.settings:
        if not any(_same(setting.at, value) for value in seen):
            seen.append(setting.at)
            yield setting


def _same(one: float | str, other: float | str) -> bool:
    if isinstance(one, str) or isinstance(other, str):
        return one == other
    return abs(one - other) <= SAME * abs(other)


def _changed(case: Case, axis: Axis, setting: Setting, end: bool) -> Point:
    for key, value in setting.changes.items():
        case = case.set(key, value)
    return _point(axis.name, setting.name, case, setting.ranks, end)


def _point(axis: str, name: str, case: Case, ranks: int, end: bool) -> Point:
    values = dict(derive(case.scene, ranks).rows())
    hint_s, work = values["core_hours"].value * 3600.0, values["grain_steps"].value
    return Point(axis, name, case, ranks, hint_s, work, end)
