"""What the answers of a study say of its claims, and where they saturate."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from liftdrag.analysis.claims import (
    Finding,
    difference,
    difference_of_means,
    within,
    within_of_means,
)
from liftdrag.analysis.saturation import LEAST, Saturation, saturation
from liftdrag.study.carried import Answer
from liftdrag.study.plan import Claim, Growth, Plan
from liftdrag.study.points import expanded

UNFINISHED = "unfinished"
"""The verdict on points of which replicas are missing, whatever the numbers so far.

A claim that is weighed again after each replica would be decided wrongly more often than its level
says, and a few replicas show little of their scatter.
"""


@dataclass(frozen=True)
class Grown:
    """The plateau of a run; `finished` of its `points` have all their replicas."""

    growth: Growth
    saturation: Saturation
    finished: int
    points: int


def findings(plan: Plan, results: Mapping[str, Answer]) -> Iterator[tuple[Claim, Finding]]:
    """Each claim both points of which have an answer."""
    points = {name: one.point for name, one in results.items()}
    for claim in plan.claims:
        names = (claim.larger, claim.smaller)
        larger, smaller = (results[expanded(name, points)[0].name] for name in names)
        if larger.quantities and smaller.quantities:
            found = _found(claim, larger, smaller)
            whole = larger.whole and smaller.whole
            yield claim, found if whole else replace(found, verdict=UNFINISHED)


def _found(claim: Claim, larger: Answer, smaller: Answer) -> Finding:
    one, other = larger.quantity(claim.quantity), smaller.quantity(claim.quantity)
    many, others = larger.each(claim.quantity), smaller.each(claim.quantity)
    if many is None or others is None:
        if claim.within is not None:
            return within_of_means(one, other, claim.within)
        return difference_of_means(one, other)
    if claim.within is not None:
        return within(many, others, claim.within)
    return difference(many, others, one.unit)


def growths(plan: Plan, results: Mapping[str, Answer]) -> Iterator[Grown]:
    """The plateau of each run that has answers at points enough, finished ones or not."""
    points = {name: one.point for name, one in results.items()}
    for growth in plan.saturations:
        every = [results[point.name] for point in expanded(growth.run, points)]
        found = [one for one in every if one.quantities]
        found = [one for one in found if one.quantity(growth.quantity).standard_error > 0.0]
        if len(found) >= LEAST:
            finished = sum(one.whole for one in every)
            yield Grown(growth, _fitted(growth, found), finished, len(every))


def _fitted(growth: Growth, found: list[Answer]) -> Saturation:
    values = [one.quantity(growth.quantity) for one in found]
    return saturation(
        np.array([one.place(growth.against, growth.over)[0] for one in found]),
        np.array([value.mean for value in values]),
        np.array([value.standard_error for value in values]),
    )
