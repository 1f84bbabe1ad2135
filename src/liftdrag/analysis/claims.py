"""Whether measured means bear a claim out: sign, size, error, p-value; or that they cannot tell."""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt

import numpy as np
from scipy import stats

LEVEL = 0.05
"""p-value from which on a claim is undecided."""


@dataclass(frozen=True)
class Finding:
    """`size` and `standard_error` in `unit`, the two-sided `p_value`, and a word for it.

    `verdict`: supported, contradicted or undecided; `packings` are those of both sides.
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
    size = float(one.mean() - other.mean())
    error = sqrt(one.var(ddof=1) / len(one) + other.var(ddof=1) / len(other))
    p = float(stats.ttest_ind(one, other, equal_var=False).pvalue)
    verdict = "undecided" if p >= LEVEL else ("supported" if size > 0.0 else "contradicted")
    return Finding(size, error, unit, p, (len(one), len(other)), verdict)


def within(one: np.ndarray, other: np.ndarray, share: float) -> Finding:
    """The claim that the mean of `one` (n,) differs from that of `other` (m,) by at most a share.

    The size is the relative difference. Its distance from the nearer of the two bounds is
    tested, with errors propagated to first order and taken as normal.
    """
    ratio = float(one.mean() / other.mean())
    shares = [values.std(ddof=1) / sqrt(len(values)) / values.mean() for values in (one, other)]
    error = ratio * float(np.hypot(*shares))
    size = ratio - 1.0
    p = float(2.0 * stats.norm.sf(abs(abs(size) - share) / error))
    verdict = "undecided" if p >= LEVEL else ("supported" if abs(size) < share else "contradicted")
    return Finding(size, error, "1", p, (len(one), len(other)), verdict)
