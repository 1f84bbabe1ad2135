"""Where a lift saturates: the fit of its plateau and of the depth of 90 % of it."""

from __future__ import annotations

from math import log

import numpy as np
import pytest

from liftdrag.analysis.saturation import saturation

PLACES = np.array([2.0, 4.0, 6.0, 8.0, 12.0, 20.0])


def curve(plateau: float, length: float) -> np.ndarray:
    return plateau * (1.0 - np.exp(-PLACES / length))


def test_exact_points_give_the_curve_back():
    found = saturation(PLACES, curve(30.0, 5.0), np.full(6, 1.0))
    assert found.saturates
    assert found.plateau == pytest.approx(30.0, rel=1e-5)
    assert found.depth == pytest.approx(5.0 * log(10.0), rel=1e-5)
    assert found.chi_square == pytest.approx(0.0, abs=1e-6)
    at_depth = found.plateau * (1.0 - np.exp(-found.depth / 5.0))
    assert at_depth == pytest.approx(0.9 * 30.0, rel=1e-4)


def test_errors_cover_the_scatter_and_chi_square_its_freedom():
    """400 curves with known noise: deviations over errors have a width of one."""
    random, errors = np.random.default_rng(5), np.linspace(0.4, 1.2, 6)
    fits = [
        saturation(PLACES, curve(30.0, 5.0) + errors * random.normal(size=6), errors)
        for _ in range(400)
    ]
    for mean, error, truth in (
        ("plateau", "plateau_error", 30.0),
        ("depth", "depth_error", 5.0 * log(10.0)),
    ):
        pulls = [(getattr(one, mean) - truth) / getattr(one, error) for one in fits]
        assert abs(np.mean(pulls)) < 0.2
        assert 0.85 < np.std(pulls) < 1.15
    assert np.mean([one.chi_square for one in fits]) == pytest.approx(4.0, abs=0.5)


def test_a_line_has_no_plateau():
    found = saturation(PLACES, 2.0 * PLACES, np.full(6, 1.0))
    assert not found.saturates


@pytest.mark.parametrize(
    ("places", "errors"),
    [([1.0, 2.0], [1.0, 1.0]), ([0.0, 1.0, 2.0], [1.0] * 3), ([1.0, 2.0, 3.0], [1.0, 0.0, 1.0])],
)
def test_points_that_say_nothing_are_refused(places: list[float], errors: list[float]):
    with pytest.raises(ValueError, match="3 points"):
        saturation(np.array(places), np.ones(len(places)), np.array(errors))
