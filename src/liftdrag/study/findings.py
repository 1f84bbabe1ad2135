"""What the answers of a study say of its claims."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from liftdrag.analysis.claims import (
    Finding,
    difference,
    difference_of_means,
    within,
    within_of_means,
)
from liftdrag.study.carried import Answer
from liftdrag.study.plan import Claim, Plan
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
