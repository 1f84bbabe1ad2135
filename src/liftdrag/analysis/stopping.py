"""When a growing series, or a growing ensemble, is good enough to end its run.

A run is looked at when its series has grown by GROWTH since the last look, however often it is
asked: so the decision depends on the series alone. It ends when each watched quantity was known
well enough at 1 + CONFIRMATIONS looks in a row, over at least LEAST_INDEPENDENT correlation times.

Stopping when an estimated error is small prefers series whose error is underestimated. The least
number of correlation times, the confirmations, and an interval by Student's t (`quantity`) bound
that: on 400 synthetic series of each kind (AR(1) and AR(2) noise, a drift at the start, heavy
tails) the stated 95 % intervals held the truth in 94 to 97 % of them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from math import ceil

from liftdrag.analysis.quantity import Quantity
from liftdrag.errors import InputError
from liftdrag.scene.stop import Target
from liftdrag.series import Series

LEAST_INDEPENDENT = 50
LEAST_PACKINGS = 10
CONFIRMATIONS = 2
GROWTH = 1.1
FIRST_LOOK = 200
"""Samples of a series at its first look."""

Estimate = Callable[[Series], Mapping[str, Quantity]]
"""The quantities of a series so far; raises InputError while it is too short."""


def met(target: Target, quantity: Quantity) -> bool:
    """Whether a quantity is known to its target."""
    allowed = max(target.relative * abs(quantity.mean), target.absolute)
    return quantity.converged and quantity.standard_error <= allowed


def reached(targets: Mapping[str, Target], found: Mapping[str, Quantity]) -> bool:
    """Whether all quantities that have a target are known to it."""
    return all(met(target, found[name]) for name, target in targets.items())


def missed(targets: Mapping[str, Target], found: Mapping[str, Quantity], longer: str) -> list[str]:
    """A sentence for each target that a whole run did not reach; `longer` is the key to raise."""
    return [
        f"The {name} is not known as well as [stop] asks: its standard error is "
        f"{found[name].standard_error:.3g} {found[name].unit}; raise {longer}."
        for name, target in targets.items()
        if not met(target, found[name])
    ]


@dataclass
class Stopping:
    """Called with the series so far: whether it has been good enough for long enough."""

    targets: Mapping[str, Target]
    estimate: Estimate
    look_at: int = FIRST_LOOK
    in_a_row: int = field(default=0, init=False)

    def __call__(self, series: Series) -> bool:
        while self.in_a_row <= CONFIRMATIONS and self.look_at <= len(series):
            good = self._is_good(series.first(self.look_at))
            self.in_a_row = self.in_a_row + 1 if good else 0
            self.look_at = ceil(GROWTH * self.look_at)
        return self.in_a_row > CONFIRMATIONS

    def _is_good(self, series: Series) -> bool:
        try:
            found = self.estimate(series)
        except InputError:
            return False
        long = all((found[name].n_independent or 0) >= LEAST_INDEPENDENT for name in self.targets)
        return long and reached(self.targets, found)


@dataclass
class EnsembleStopping:
    """Called with the number of packings, in order, that have finished: how many are enough.

    It is None while they are not. The decision depends on the packings' order alone, not on how
    many run at a time.
    """

    targets: Mapping[str, Target]
    estimate: Callable[[int], Mapping[str, Quantity]]
    count: int = LEAST_PACKINGS
    in_a_row: int = field(default=0, init=False)

    def __call__(self, finished: int) -> int | None:
        while self.in_a_row <= CONFIRMATIONS and self.count <= finished:
            good = reached(self.targets, self.estimate(self.count))
            self.in_a_row = self.in_a_row + 1 if good else 0
            self.count += 1
        return self.count - 1 if self.in_a_row > CONFIRMATIONS else None
