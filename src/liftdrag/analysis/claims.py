"""Whether measured means bear a claim out: sign, size, error, p-value; or that they cannot tell."""

from __future__ import annotations

from dataclasses import dataclass
from math import hypot, sqrt

import numpy as np
from scipy import stats

from liftdrag.analysis.quantity import Quantity

LEVEL = 0.05
"""p-value from which on a claim is undecided."""


@dataclass(frozen=True)
class Finding:
    """`size` and `standard_error` in `unit`, the two-sided `p_value`, and a word for it.

    `verdict`: supported, contradicted or undecided; `packings` are those of both sides, one
    where a side is a single run.
    """

    size: float
    standard_error: float
    unit: str
    p_value: float
    packings: tuple[int, int]
    verdict: str


def difference(one: np.ndarray, other: np.ndarray, unit: str) -> Finding:
    """The claim that the mean of `one` (n,) is larger than that of `other` (m,): Welch's test.

    The size is the difference of the means of independent samples.
    """
    size, error, p = _welch(one, other)
    verdict = _verdict(p, size > 0.0)
    return Finding(size, error, unit, p, (len(one), len(other)), verdict)


def within(one: np.ndarray, other: np.ndarray, share: float) -> Finding:
    """The claim that the mean of `one` (n,) differs from that of `other` (m,) by at most a share.

    The size is the relative difference, its error propagated to first order. Tested is whether
    `one` minus the nearer bound, (1 + share) or (1 - share) times `other`, is zero: Welch's test.
    Raises ValueError when the mean of `other` is zero.
    """
    if other.mean() == 0.0:
        raise ValueError("a relative difference from zero has no meaning")
    ratio = float(one.mean() / other.mean())
    errors = [float(values.std(ddof=1)) / sqrt(len(values)) for values in (one, other)]
    error = hypot(errors[0], ratio * errors[1]) / abs(float(other.mean()))
    bound = 1.0 + (share if ratio > 1.0 else -share)
    p = _welch(one, bound * other)[2]
    verdict = _verdict(p, abs(ratio - 1.0) < share)
    return Finding(ratio - 1.0, error, "1", p, (len(one), len(other)), verdict)


def difference_of_means(one: Quantity, other: Quantity) -> Finding:
    """The claim that `one` is larger than `other`, two means with errors: the normal test."""
    size, error = one.mean - other.mean, hypot(one.standard_error, other.standard_error)
    p = _normal(size, error)
    return Finding(size, error, one.unit, p, (1, 1), _verdict(p, size > 0.0))


def within_of_means(one: Quantity, other: Quantity, share: float) -> Finding:
    """The claim that `one` differs from `other` by at most a share: as `within`, the normal test.

    Raises ValueError when `other` is zero.
    """
    if other.mean == 0.0:
        raise ValueError("a relative difference from zero has no meaning")
    ratio, scale = one.mean / other.mean, abs(other.mean)
    error = hypot(one.standard_error, ratio * other.standard_error) / scale
    bound = 1.0 + (share if ratio > 1.0 else -share)
    p = _normal(
        one.mean - bound * other.mean, hypot(one.standard_error, bound * other.standard_error)
    )
    return Finding(ratio - 1.0, error, "1", p, (1, 1), _verdict(p, abs(ratio - 1.0) < share))


def _normal(size: float, error: float) -> float:
    """The two-sided p-value of a normal variable of this size being zero."""
    return float(2.0 * stats.norm.sf(abs(size) / error)) if error else float(size == 0.0)


def _welch(one: np.ndarray, other: np.ndarray) -> tuple[float, float, float]:
    """Difference of the means, its standard error, and the p-value of its being zero."""
    size = float(one.mean() - other.mean())
    error = sqrt(one.var(ddof=1) / len(one) + other.var(ddof=1) / len(other))
    if error == 0.0:
        return size, error, float(size == 0.0)
    return size, error, float(stats.ttest_ind(one, other, equal_var=False).pvalue)


def _verdict(p: float, holds: bool) -> str:
    if p >= LEVEL:
        return "undecided"
    return "supported" if holds else "contradicted"
