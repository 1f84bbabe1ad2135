"""What the answers of a study say of its claims, and where they saturate."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

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


def findings(plan: Plan, results: Mapping[str, Answer]) -> Iterator[tuple[Claim, Finding]]:
    """Each claim both points of which have an answer."""
    points = {name: one.point for name, one in results.items()}
    for claim in plan.claims:
        names = (claim.larger, claim.smaller)
        larger, smaller = (results[expanded(name, points)[0].name] for name in names)
        if larger.quantities and smaller.quantities:
            yield claim, _found(claim, larger, smaller)


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


def growths(plan: Plan, results: Mapping[str, Answer]) -> Iterator[tuple[Growth, Saturation]]:
    """The plateau of each run that has answers at points enough."""
    points = {name: one.point for name, one in results.items()}
    for growth in plan.saturations:
        found = [results[point.name] for point in expanded(growth.run, points)]
        found = [one for one in found if one.quantities]
        found = [one for one in found if one.quantity(growth.quantity).standard_error > 0.0]
        if len(found) >= LEAST:
            values = [one.quantity(growth.quantity) for one in found]
            yield (
                growth,
                saturation(
                    np.array([one.place(growth.against, growth.over) for one in found]),
                    np.array([value.mean for value in values]),
                    np.array([value.standard_error for value in values]),
                ),
            )
