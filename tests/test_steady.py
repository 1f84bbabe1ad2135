"""Truncation and drift test against series whose steady part is known."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from liftdrag.analysis.errorbars import average
from liftdrag.analysis.steady import (
    BATCHES,
    LARGEST_CUT,
    SteadyWindow,
    common_window,
    steady_window,
)
from liftdrag.errors import SeriesTooShort

LENGTH = 1140
"""Sixty correlation times of AR(1) with phi = 0.9."""


def ar1(count: int, seed: int, phi: float = 0.9, length: int = LENGTH) -> np.ndarray:
    """Stationary AR(1) series (count, length) with mean 0 and variance 1."""
    noise = np.random.default_rng(seed).normal(size=(count, length))
    noise[:, 1:] *= np.sqrt(1.0 - phi**2)
    return lfilter([1.0], [1.0, -phi], noise, axis=1)


def brute_force_start(values: np.ndarray, size: int) -> int:
    """MSER by its definition, for a length that is a whole number of batches."""
    batches = [values[i : i + size].mean() for i in range(0, len(values), size)]
    best, best_error = 0, np.inf
    for dropped in range(len(batches) // 2 + 1):
        kept = batches[dropped:]
        mean = sum(kept) / len(kept)
        error = sum((b - mean) ** 2 for b in kept) / len(kept) ** 2
        if error < best_error:
            best, best_error = dropped, error
    return best * size if best <= LARGEST_CUT * len(batches) else 0


def test_start_is_the_least_marginal_error():
    transient = 2.0 * np.exp(-np.arange(1200) / 100.0)
    for values in ar1(20, seed=1, length=1200) + transient:
        expected = 400 + brute_force_start(values, 1200 // BATCHES)
        assert steady_window(np.r_[np.zeros(400), values], 400).start == expected


@pytest.mark.parametrize("phi", [0.0, 0.5, 0.9, 0.97])
@pytest.mark.parametrize("correlation_times", [30, 60, 200])
def test_stationary_series_loses_little_data(phi, correlation_times):
    length = max(int(correlation_times * (1.0 + phi) / (1.0 - phi)), 60)
    series = ar1(100, seed=2, phi=phi, length=length)
    lost = np.array([steady_window(values, 0).start / length for values in series])
    assert lost.mean() < 0.07
    assert np.quantile(lost, 0.9) < 0.25


def test_stationary_series_is_rarely_called_drifting():
    flagged = [not steady_window(values, 0).steady for values in ar1(300, seed=3)]
    assert np.mean(flagged) < 0.02


def test_drift_of_stationary_series_is_a_unit_normal():
    drifts = [steady_window(values, 0).drift for values in ar1(300, seed=4, phi=0.5)]
    assert np.mean(drifts) == pytest.approx(0.0, abs=0.2)
    assert np.std(drifts) == pytest.approx(1.0, abs=0.15)


def test_truncation_removes_a_decaying_transient():
    transient = 10.0 * np.exp(-np.arange(LENGTH) / 50.0)
    inside_cut = inside_whole = 0
    for values in ar1(100, seed=5) + transient:
        window = steady_window(values, 0)
        cut = average(values[window.start : window.stop], 1.0)
        whole = average(values, 1.0)
        inside_cut += abs(cut.mean) < 2.0 * cut.standard_error
        inside_whole += abs(whole.mean) < 2.0 * cut.standard_error
    assert inside_cut >= 88
    assert inside_whole <= 20


@pytest.mark.parametrize("slope", [-5.0, 5.0])
def test_linear_drift_is_not_steady(slope):
    windows = [steady_window(v, 0) for v in ar1(50, seed=6) + np.linspace(0.0, slope, LENGTH)]
    assert np.mean([not window.steady for window in windows]) > 0.9
    assert all(window.drift * slope > 0.0 for window in windows)


def test_transient_longer_than_the_run_is_not_steady():
    transient = 10.0 * np.exp(-np.arange(LENGTH) / (0.4 * LENGTH))
    windows = [steady_window(values, 0) for values in ar1(50, seed=8) + transient]
    assert np.mean([not window.steady for window in windows]) > 0.9
    assert all(window.drift < 0.0 for window in windows)


def test_window_never_starts_before_its_minimum_nor_after_the_largest_cut():
    for values in ar1(50, seed=7) + np.linspace(0.0, 20.0, LENGTH):
        window = steady_window(values, 101)
        assert 101 <= window.start <= 101 + 0.42 * (LENGTH - 101)
        assert window.stop == LENGTH


def test_constant_series_is_steady_from_its_minimum_start():
    assert steady_window(np.full(100, 0.1), 7) == SteadyWindow(7, 100, 0.0, True)


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_ramp_without_noise_drifts_beyond_all_bounds(sign):
    window = steady_window(sign * np.arange(65.0), 0)
    assert sign * window.drift > 1e6
    assert not window.steady


def test_too_few_samples_after_the_start_carry_their_mean():
    with pytest.raises(SeriesTooShort) as caught:
        steady_window(np.r_[np.zeros(100), np.ones(BATCHES - 1)], 100)
    assert caught.value.estimate == pytest.approx(1.0)


def test_start_beyond_the_end_carries_no_mean():
    with pytest.raises(SeriesTooShort) as caught:
        steady_window(np.zeros(10), 20)
    assert caught.value.estimate is None


def test_slow_oscillation_is_refused_by_the_drift_or_by_the_average():
    values = 5.0 + np.cos(np.linspace(0.0, 2.0 * np.pi, 400))
    window = steady_window(values, 0)
    assert window.steady
    assert not average(values[window.start :], 1.0).converged


def test_bad_arguments_are_refused():
    with pytest.raises(ValueError, match="finite"):
        steady_window(np.r_[np.zeros(99), np.nan], 0)
    with pytest.raises(ValueError, match="cannot start"):
        steady_window(np.zeros(100), -1)


def test_common_window_starts_latest_and_keeps_the_worst_drift():
    drag, lift = SteadyWindow(10, 100, 1.0, True), SteadyWindow(30, 100, -3.5, False)
    assert common_window([drag, lift]) == SteadyWindow(30, 100, -3.5, False)
    assert common_window([drag]) == drag


def test_common_window_needs_windows_of_one_length():
    with pytest.raises(ValueError, match="same sample"):
        common_window([SteadyWindow(0, 9, 0.0, True), SteadyWindow(0, 8, 0.0, True)])
    with pytest.raises(ValueError, match="same sample"):
        common_window([])
