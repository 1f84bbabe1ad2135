"""How precise a mean is: replicas pooled, its deviation from another, and which are best."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import hypot, sqrt

import numpy as np

from liftdrag.analysis.quantity import Quantity


@dataclass(frozen=True)
class Deviation:
    """A mean over another, less one, and the standard error of that."""

    relative: float
    standard_error: float

    @property
    def bias(self) -> float:
        """What of it the error does not explain, an estimate that is never negative."""
        return sqrt(max(self.relative**2 - self.standard_error**2, 0.0))

    @property
    def reversed(self) -> Deviation:
        """That of the other mean from this one, its error to first order."""
        ratio = 1.0 / (1.0 + self.relative)
        return Deviation(ratio - 1.0, ratio**2 * self.standard_error)


def hidden_scatter(groups: Sequence[Sequence[Quantity]]) -> float:
    """Standard deviation from run to run that the runs' own standard errors do not show.

    Each group holds runs that differ in their seed alone; the scatter is that within groups, over
    all of them, less what the own errors explain. Zero where no group has two runs.
    """
    freedom, beyond = 0, 0.0
    for group in groups:
        mean = _mean(group)
        own = sum(one.standard_error**2 for one in group) / len(group)
        freedom += len(group) - 1
        beyond += sum((one.mean - mean) ** 2 for one in group) - (len(group) - 1) * own
    return sqrt(max(beyond, 0.0) / freedom) if freedom else 0.0


def pooled(runs: Sequence[Quantity], hidden: float) -> Quantity:
    """The mean of independent runs, each with the same weight, and its standard error.

    Weights by the runs' own errors would be biased: in a correlated series a small error goes
    with a small mean square. `hidden` is the scatter that these errors do not show.
    """
    count = len(runs)
    own = sum(one.standard_error**2 for one in runs)
    samples = [one.n_independent for one in runs if one.n_independent is not None]
    return Quantity(
        _mean(runs),
        sqrt(own / count + hidden**2) / sqrt(count),
        runs[0].unit,
        None,
        sum(samples) if samples else None,
        all(one.converged for one in runs),
    )


def _mean(runs: Sequence[Quantity]) -> float:
    return sum(one.mean for one in runs) / len(runs)


def deviation(one: Quantity, other: Quantity) -> Deviation:
    """How far `one` is from `other`, relative to it; their errors are taken as independent.

    Raises ValueError when `other` is zero.
    """
    if other.mean == 0.0:
        raise ValueError("a relative deviation from zero has no meaning")
    ratio = one.mean / other.mean
    error = hypot(one.standard_error, ratio * other.standard_error) / abs(other.mean)
    return Deviation(ratio - 1.0, error)


def paired_deviation(one: np.ndarray, other: np.ndarray) -> Deviation:
    """The same of means of pairs (n,), each of which began alike; the error is of their scatter."""
    ratio = float(one.mean() / other.mean())
    left = (one - ratio * other) / other.mean()
    return Deviation(ratio - 1.0, float(left.std(ddof=1)) / sqrt(len(left)))


def front(costs: Sequence[float], errors: Sequence[float]) -> list[int]:
    """Which of them no other beats in both cost and error (Pareto), in order of cost."""
    best, found = float("inf"), list[int]()
    for k in sorted(range(len(costs)), key=lambda k: (costs[k], errors[k])):
        if errors[k] < best:
            best = errors[k]
            found.append(k)
    return found
