"""Claims weighed on samples whose truth is known."""

from __future__ import annotations

from math import sqrt

import numpy as np
import pytest
from scipy import stats

from liftdrag.analysis.claims import LEVEL, difference, within

RNG = np.random.default_rng(7)


def test_difference_is_welchs_t_by_hand():
    """Against the formula of Welch and Satterthwaite, written out."""
    one, other = np.array([5.0, 7.0, 6.0, 9.0]), np.array([4.0, 4.5, 5.5])
    shares = [np.var(values, ddof=1) / len(values) for values in (one, other)]
    error = sqrt(sum(shares))
    freedom = sum(shares) ** 2 / sum(s**2 / (n - 1) for s, n in zip(shares, (4, 3), strict=True))
    found = difference(one, other, "N")
    assert found.size == pytest.approx(6.75 - 14.0 / 3.0)
    assert found.standard_error == pytest.approx(error)
    assert found.p_value == pytest.approx(2.0 * stats.t.sf(abs(found.size) / error, freedom))
    assert (found.packings, found.unit) == ((4, 3), "N")


def test_difference_that_is_not_there_is_seen_one_time_in_twenty():
    samples = RNG.normal(size=(2000, 2, 12)) * np.array([1.0, 3.0])[:, None]
    seen = sum(difference(one, other, "N").verdict != "undecided" for one, other in samples)
    assert seen / 2000 == pytest.approx(LEVEL, abs=3.0 * sqrt(LEVEL / 2000))


@pytest.mark.parametrize(("shift", "verdict"), [(2.0, "supported"), (-2.0, "contradicted")])
def test_difference_that_is_there_has_its_sign(shift: float, verdict: str):
    one, other = RNG.normal(size=(2, 40)) * 0.1
    assert difference(one + shift, other, "N").verdict == verdict


def test_error_of_a_ratio_is_that_of_many_samples():
    """The standard error of one pair of samples against the scatter of many."""
    pairs = np.array([120.0, 100.0])[:, None] + 10.0 * RNG.normal(size=(3000, 2, 40))
    found = [within(one, other, 0.218) for one, other in pairs]
    scatter = np.std([finding.size for finding in found])
    assert np.mean([finding.standard_error for finding in found]) == pytest.approx(
        scatter, rel=0.05
    )
    assert np.mean([finding.size for finding in found]) == pytest.approx(0.2, abs=0.002)


@pytest.mark.parametrize(
    ("ratio", "verdict"), [(1.05, "supported"), (0.95, "supported"), (1.5, "contradicted")]
)
def test_bound_on_a_ratio_is_weighed(ratio: float, verdict: str):
    one, other = 100.0 + RNG.normal(size=(2, 40))
    assert within(ratio * one, other, 0.218).verdict == verdict


def test_ratio_at_its_bound_is_decided_one_time_in_twenty():
    pairs = np.array([121.8, 100.0])[:, None] + 5.0 * RNG.normal(size=(2000, 2, 40))
    seen = sum(within(one, other, 0.218).verdict != "undecided" for one, other in pairs)
    assert seen / 2000 == pytest.approx(LEVEL, abs=0.02)


def test_samples_without_scatter_are_decided_by_their_means():
    same, more = np.ones(3), np.full(3, 2.0)
    assert difference(same, same, "N").verdict == "undecided"
    assert difference(more, same, "N").verdict == "supported"
    assert within(more, same, 0.1).verdict == "contradicted"
    assert within(same, same, 0.1).verdict == "supported"


def test_ratio_of_negative_means_has_a_positive_error():
    found = within(np.array([-1.0, -1.2, -0.8]), np.array([1.0, 1.1, 0.9]), 0.1)
    assert found.standard_error > 0.0
    assert 0.0 <= found.p_value <= 1.0
    with pytest.raises(ValueError, match="no meaning"):
        within(np.ones(3), np.array([-1.0, 0.0, 1.0]), 0.1)
