"""Error bars of correlated series against closed forms, emcee and many repetitions."""

from __future__ import annotations

import emcee
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import lfilter

from liftdrag.analysis.errorbars import (
    MINIMUM_CORRELATION_TIMES,
    MINIMUM_SAMPLES,
    WINDOW,
    autocovariance,
    average,
    integrated_time,
)
from liftdrag.errors import SeriesTooShort


def ar1(phi: float, count: int, length: int, seed: int) -> np.ndarray:
    """Stationary AR(1) series (count, length) with mean 0 and variance 1."""
    noise = np.random.default_rng(seed).normal(size=(count, length))
    noise[:, 1:] *= np.sqrt(1.0 - phi**2)
    return lfilter([1.0], [1.0, -phi], noise, axis=1)


def exact_time(phi: float) -> float:
    """1 + 2 sum phi^t."""
    return (1.0 + phi) / (1.0 - phi)


def exact_variance_of_mean(phi: float, length: int) -> float:
    """Double sum of phi^|i-j| / n^2, written out lag by lag."""
    lags = np.arange(1, length)
    return (length + 2.0 * np.sum((length - lags) * phi**lags)) / length**2


@pytest.mark.parametrize("phi", [0.0, 0.5, 0.9, 0.97])
def test_correlation_time_of_ar1_is_its_closed_form(phi):
    series = ar1(phi, 40, int(1000 * exact_time(phi)), seed=1)
    times = [integrated_time(values) for values in series]
    assert np.mean(times) == pytest.approx(exact_time(phi), rel=0.04)


@pytest.mark.parametrize("phi", [0.5, 0.9, 0.97])
@pytest.mark.parametrize("correlation_times", [30, 40, 60])
def test_error_of_a_short_series_is_the_scatter_of_its_mean(phi, correlation_times):
    series = ar1(phi, 1000, int(correlation_times * exact_time(phi)), seed=2)
    errors = [average(values, 1.0).standard_error for values in series]
    exact = np.sqrt(exact_variance_of_mean(phi, series.shape[1]))
    assert 0.97 < np.mean(errors) / exact < 1.06


@pytest.mark.parametrize("phi", [0.0, 0.5, 0.9, 0.97])
def test_interval_of_nominal_95_percent_covers_the_mean(phi):
    series = ar1(phi, 1000, int(50 * exact_time(phi)), seed=3)
    averages = [average(values, 1.0) for values in series]
    covered = np.mean([abs(a.mean) < 1.96 * a.standard_error for a in averages])
    assert 0.92 < covered < 0.98


@pytest.mark.parametrize("phi", [0.5, 0.9, 0.97])
def test_agrees_with_emcee_on_a_long_series(phi):
    values = ar1(phi, 1, 200_000, seed=4)[0]
    expected = emcee.autocorr.integrated_time(values, c=WINDOW)[0]
    assert integrated_time(values) == pytest.approx(expected, rel=5e-3)


def test_autocovariance_is_the_naive_sum():
    values = ar1(0.8, 1, 37, seed=5)[0] + 3.0
    shifted = values - values.mean()
    for lag, found in enumerate(autocovariance(values)):
        products = [shifted[i] * shifted[i + lag] for i in range(len(values) - lag)]
        assert found == pytest.approx(sum(products) / len(products), abs=1e-12)


def test_error_is_variance_times_correlation_time_over_length():
    found = average(ar1(0.9, 1, 20_000, seed=6)[0], 0.5)
    assert found.n_independent == pytest.approx(10_000.0 / found.correlation_time)
    assert found.standard_error == pytest.approx(np.sqrt(1.0 / found.n_independent), rel=0.05)


@given(
    seed=st.integers(0, 10_000),
    shift=st.floats(-100.0, 100.0),
    scale=st.floats(0.01, 100.0),
    sign=st.sampled_from([-1.0, 1.0]),
    interval=st.floats(1e-6, 1e3),
)
def test_shift_scale_and_interval_only_change_units(seed, shift, scale, sign, interval):
    values = ar1(0.6, 1, 300, seed=seed)[0]
    plain, changed = average(values, 1.0), average(sign * scale * values + shift, interval)
    assert changed.mean == pytest.approx(sign * scale * plain.mean + shift, rel=1e-9, abs=1e-9)
    assert changed.standard_error == pytest.approx(scale * plain.standard_error, rel=1e-6)
    assert changed.correlation_time == pytest.approx(interval * plain.correlation_time, rel=1e-6)
    assert changed.n_independent == pytest.approx(plain.n_independent, rel=1e-6)
    assert changed.converged == plain.converged


def test_converged_from_the_stated_number_of_correlation_times():
    averages = [average(values, 1.0) for values in ar1(0.9, 200, 20 * 19, seed=7)]
    assert {a.converged for a in averages} == {True, False}
    for found in averages:
        assert found.converged == (380 / found.correlation_time >= MINIMUM_CORRELATION_TIMES)


@pytest.mark.parametrize("phi", [-0.5, -0.9])
def test_anticorrelated_series_has_the_error_of_independent_samples(phi):
    for values in ar1(phi, 50, 400, seed=8):
        found = average(values, 1.0)
        assert found.correlation_time == pytest.approx(1.0)
        assert found.standard_error == pytest.approx(values.std() / 20.0, rel=1e-2)


def test_alternating_series_keeps_an_error():
    found = average(np.tile([1.0, -1.0], 50), 1.0)
    assert found.standard_error == pytest.approx(0.1, rel=0.02)


def test_constant_series_has_no_error():
    found = average(np.full(50, 0.1), 2.0)
    assert (found.mean, found.standard_error, found.correlation_time) == (0.1, 0.0, 2.0)
    assert found.converged
    assert integrated_time(np.full(50, 0.1)) == 1.0


def test_too_few_samples_carry_their_mean():
    values = np.arange(MINIMUM_SAMPLES - 1.0)
    with pytest.raises(SeriesTooShort) as caught:
        average(values, 1.0)
    assert caught.value.estimate == pytest.approx(3.0)


def test_no_samples_carry_no_mean():
    with pytest.raises(SeriesTooShort) as caught:
        average(np.array([]), 1.0)
    assert caught.value.estimate is None


@pytest.mark.parametrize("values", [np.arange(500.0), np.exp(-np.arange(500.0) / 170.0)])
def test_series_within_its_correlation_time_carries_its_mean(values):
    with pytest.raises(SeriesTooShort, match="correlation times") as caught:
        average(values, 1.0)
    assert caught.value.estimate == pytest.approx(values.mean())


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_values_that_are_not_finite_are_refused(bad):
    with pytest.raises(ValueError, match="finite"):
        average(np.r_[np.zeros(20), bad], 1.0)


def test_table_of_values_is_refused():
    with pytest.raises(ValueError, match="one-dimensional"):
        average(np.zeros((20, 2)), 1.0)


@pytest.mark.parametrize("interval", [0.0, -1.0, np.nan, np.inf])
def test_interval_must_be_positive(interval):
    with pytest.raises(ValueError, match="interval"):
        average(np.arange(20.0), interval)
