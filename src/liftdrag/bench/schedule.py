"""What a bench runs next: a function of what has been run, and of the time that is left.

First the case itself; then the ends of each axis, the cheapest first, and the values between;
then more runs of what is undecided or among the best, the most information for its time first.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from math import sqrt

from liftdrag.bench.judged import CASE, Cost, Judged, Key, costs, finished, judge
from liftdrag.bench.points import Point, Task
from liftdrag.bench.runs import Run

FIRST = 2
"""Runs of the case itself before anything else."""

NEAR = 1.5
"""Factor in both time and error by which a point may be beaten and still be near the front."""

SHARE, NEAR_SHARE = 0.5, 0.25
"""Error of a deviation over the tolerated from which it is in doubt, of a point near the front."""

CLEAR = 3.0
"""Deviation over its error from which it is no doubt."""


@dataclass(frozen=True)
class State:
    """What is known: the points, the case itself first; the runs that ended; those that go on.

    `tolerances` by quantity, `left_s` the time left on the clock, in seconds.
    """

    points: tuple[Point, ...]
    runs: tuple[Run, ...]
    pending: tuple[Task, ...]
    tolerances: Mapping[str, float]
    left_s: float

    def started(self, point: Point) -> int:
        """Runs of a point that ended or go on."""
        ended = sum(one.key == point.key for one in self.runs)
        return ended + sum(task.point.key == point.key for task in self.pending)

    def failed(self, point: Point) -> bool:
        """Whether a run of it failed: others would."""
        return any(one.key == point.key and not one.finished for one in self.runs)

    def estimate(self, point: Point) -> float:
        """Time (s) that a run of it will take, by what the others took."""
        hints = {known.key: known.hint_s / known.ranks for known in self.points}
        ended = [one for one in self.runs if one.finished and one.key in hints]
        hinted = sum(hints[one.key] for one in ended)
        slowness = sum(one.wall_s for one in ended) / hinted if hinted else 1.0
        return slowness * point.hint_s / point.ranks

    def affords(self, point: Point) -> bool:
        """Whether a run of it would end in time."""
        return self.estimate(point) <= self.left_s


def next_task(state: State) -> Task | None:
    """The run to start next, None when there is none, or none before one of the pending ends."""
    case = state.points[0]
    if state.started(case) < FIRST and not state.failed(case):
        return Task(case, state.started(case) + 1)
    if CASE not in finished(state.runs):
        return None
    for point in (*_unseen(state), *_refined(state)):
        if state.affords(point):
            return Task(point, state.started(point) + 1)
    return None


def _unseen(state: State) -> list[Point]:
    """The points without a run: the ends of the axes, then the others, each the cheapest first."""
    found = [point for point in state.points if not state.started(point)]
    return sorted(found, key=lambda point: (not point.end, point.hint_s))


def left_out(state: State) -> list[str]:
    """What the time was too short for, in words: points, and points that stay undecided."""
    unseen = [f"{point.axis} {point.name}" for point in _unseen(state)]
    doubtful = dict.fromkeys(f"{want.point.axis} {want.point.name}" for want in _wanted(state))
    return [*unseen, *(f"more runs of {name}" for name in doubtful)]


@dataclass(frozen=True)
class _Want:
    """A point whose deviation is not known well enough.

    `own` and `reference` are variances of a single run of it and of the case, over the tolerated.
    """

    point: Point
    own: float
    reference: float


def _refined(state: State) -> list[Point]:
    """The points of which one more run tells most for its time, the case among them, best first.

    The case, which is in each deviation, has more runs than any other.
    """
    case, worth = state.points[0], dict[Key, float]()
    if state.failed(case):
        return []
    most = state.started(case)
    for want in _wanted(state):
        key, count = want.point.key, state.started(want.point)
        worth[key] = worth.get(key, 0.0) + want.own / (count * (count + 1))
        worth[CASE] = worth.get(CASE, 0.0) + want.reference / (most * (most + 1))
    points = [point for point in state.points if point.key in worth]
    points.sort(key=lambda point: -worth[point.key] / state.estimate(point))
    return [case if state.started(point) + 1 >= most else point for point in points]


def _wanted(state: State) -> Iterator[_Want]:
    """What another run would help: each quantity of each point that is still in doubt."""
    known = {point.key: point for point in state.points[1:] if not state.failed(point)}
    most = state.started(state.points[0])
    for quantity, tolerance in state.tolerances.items():
        found = judge(state.runs, quantity)
        close = _near(found, costs(state.runs))
        for key in known.keys() & found.keys():
            own, reference = _variances(found[key], found[CASE])
            left = own / state.started(known[key]) + reference / most
            share = NEAR_SHARE if key in close else SHARE
            if not _is_clear(found[key]) and sqrt(left) > share * tolerance:
                yield _Want(known[key], own / tolerance**2, reference / tolerance**2)


def _variances(one: Judged, case: Judged) -> tuple[float, float]:
    """What a single run of a point and of the case add to the variance of the deviation."""
    if one.paired:
        return one.deviation.standard_error**2 * one.runs, 0.0
    ratio = 1.0 + one.deviation.relative
    return one.error**2 * one.runs, (ratio * case.error) ** 2 * case.runs


def _is_clear(one: Judged) -> bool:
    """Whether the point is known to differ from the case, by how much whatever."""
    return abs(one.deviation.relative) > CLEAR * one.deviation.standard_error


def _near(found: Mapping[Key, Judged], spent: Mapping[Key, Cost]) -> set[Key]:
    """The points that none beats by far in both processor time and total error."""

    def beaten(key: Key) -> bool:
        return any(
            spent[key].cpu_s > NEAR * spent[other].cpu_s
            and found[key].total_error > NEAR * found[other].total_error
            for other in found
        )

    return {key for key in found if not beaten(key)}
