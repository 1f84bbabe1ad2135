"""Fits of Janssen's curve against exact data, and against the scatter of many noisy curves."""

from __future__ import annotations

from dataclasses import replace
from math import exp

import numpy as np
import pytest
from scipy.stats import kstest

from liftdrag.analysis.janssen_fit import Curve, apparent_mass, fit_one, fit_two, with_scatter

MASS = np.linspace(0.025, 0.2, 8)
SATURATION = 0.07
NOISE = 0.02
MOTIONS = [(1.0, 0.0), (1.0, 0.05), (1.0, 0.1), (-1.0, 0.0), (-1.0, 0.05)]
"""Sense and lid, kg: also one heavier than M_sat, under which the load falls with the fill."""


def curve(sense: float, lid: float, cap: float = 0.0, error: float = 0.0, rng=None) -> Curve:
    load = apparent_mass(MASS, sense, lid, SATURATION, cap)
    scatter = np.zeros(8) if rng is None else error * load * rng.normal(size=8)
    return Curve(MASS, load + scatter, error * load, lid, sense)


def noisy(sense: float, lid: float, cap: float, count: int, seed: int) -> list[Curve]:
    rng = np.random.default_rng(seed)
    return [curve(sense, lid, cap, NOISE, rng) for _ in range(count)]


@pytest.mark.parametrize(("sense", "lid"), MOTIONS)
def test_form_is_the_closed_one(sense, lid):
    for mass, found in zip(MASS, apparent_mass(MASS, sense, lid, SATURATION), strict=True):
        end = sense * SATURATION
        expected = end + (lid - end) * exp(-sense * mass / SATURATION)
        assert found == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize(("sense", "lid"), MOTIONS)
def test_capped_form_is_the_closed_one(sense, lid):
    cap = 0.06
    for mass, found in zip(MASS, apparent_mass(MASS, sense, lid, SATURATION, cap), strict=True):
        end, beyond = sense * SATURATION, mass - cap
        expected = end + (lid + cap - end) * exp(-sense * beyond / SATURATION)
        assert found == pytest.approx(expected if beyond > 0.0 else mass + lid, rel=1e-12)


@pytest.mark.parametrize(("sense", "lid"), MOTIONS)
def test_exact_curve_gives_its_saturation_mass_back(sense, lid):
    found = fit_one(curve(sense, lid))
    assert found.saturation_mass == pytest.approx(SATURATION, rel=1e-6)
    assert (found.hydrostatic_cap, found.cap_error) == (0.0, 0.0)
    assert found.degrees_of_freedom == 7
    assert found.chi_square < 1e-6
    assert found.p_value == pytest.approx(1.0)


@pytest.mark.parametrize(("sense", "lid"), MOTIONS)
@pytest.mark.parametrize("cap", [0.03, 0.05, 0.061])
def test_exact_capped_curve_gives_both_parameters_back(sense, lid, cap):
    found = fit_two(curve(sense, lid, cap))
    assert found.saturation_mass == pytest.approx(SATURATION, rel=1e-6)
    assert found.hydrostatic_cap == pytest.approx(cap, rel=1e-6)
    assert found.degrees_of_freedom == 6


@pytest.mark.parametrize(("sense", "lid"), MOTIONS)
def test_curve_without_a_cap_has_none(sense, lid):
    found = fit_two(curve(sense, lid, error=NOISE))
    assert found.hydrostatic_cap < found.cap_error
    assert found.saturation_mass == pytest.approx(SATURATION, rel=1e-3)


@pytest.mark.parametrize("depth", [0.5, 5.0, 20.0])
def test_shallow_and_deep_curves_are_fitted_from_any_start(depth):
    saturation = MASS[-1] / depth
    load = apparent_mass(MASS, 1.0, 0.0, saturation)
    found = fit_one(Curve(MASS, load, np.zeros(8), 0.0, 1.0))
    assert found.saturation_mass == pytest.approx(saturation, rel=1e-6)


@pytest.mark.parametrize(("sense", "lid"), [(1.0, 0.0), (1.0, 0.05), (-1.0, 0.0)])
def test_stated_error_is_the_scatter_of_many_curves(sense, lid):
    """Of 1/M_sat, to which K is proportional."""
    fits = [fit_one(one) for one in noisy(sense, lid, 0.0, 1000, seed=1)]
    inverse = np.array([1.0 / fit.saturation_mass for fit in fits])
    stated = np.array([fit.saturation_error / fit.saturation_mass**2 for fit in fits])
    assert stated.mean() == pytest.approx(inverse.std(), rel=0.1)
    assert abs(inverse.mean() - 1.0 / SATURATION) < 5.0 * inverse.std() / np.sqrt(1000)
    reduced = np.mean([fit.reduced for fit in fits])
    assert abs(reduced - 1.0) < 5.0 * np.sqrt(2.0 / 7.0 / 1000)


def test_p_values_are_uniform_where_the_form_holds():
    for fit, cap in ((fit_one, 0.0), (fit_two, 0.04)):
        found = [fit(one).p_value for one in noisy(1.0, 0.05, cap, 100, seed=3)]
        assert kstest(found, "uniform").pvalue > 0.01


@pytest.mark.parametrize(("sense", "lid"), [(1.0, 0.05), (-1.0, 0.0)])
def test_stated_errors_of_two_parameters_are_their_scatter(sense, lid):
    fits = [fit_two(one) for one in noisy(sense, lid, 0.04, 100, seed=2)]
    for name, error in (("saturation_mass", "saturation_error"), ("hydrostatic_cap", "cap_error")):
        values = np.array([getattr(fit, name) for fit in fits])
        stated = np.array([getattr(fit, error) for fit in fits])
        assert stated.mean() == pytest.approx(values.std(), rel=0.2)
        truth = SATURATION if name == "saturation_mass" else 0.04
        assert abs(values.mean() - truth) < 5.0 * values.std() / np.sqrt(100)


def test_scatter_is_added_where_the_form_does_not_hold():
    """So much that chi-square is the degrees of freedom; its own is kept."""
    one = curve(1.0, 0.0, cap=0.05, error=NOISE)
    plain, found = fit_one(one), with_scatter(fit_one, one)
    assert found.chi_square == plain.chi_square > 50.0
    assert found.p_value < 1e-6
    assert fit_one(replace(one, scatter=found.scatter)).chi_square == pytest.approx(7.0, rel=1e-2)
    assert found.saturation_error > 2.0 * plain.saturation_error
    assert with_scatter(fit_one, curve(1.0, 0.0, error=NOISE)).scatter == 0.0


@pytest.mark.parametrize("share", [0.0, 0.03])
def test_stated_error_holds_with_scatter_from_fill_to_fill(share):
    """Of 1/M_sat over 500 curves whose loads scatter by a share more than their errors say; and
    the share is found, but for the bias of so few fills."""
    rng = np.random.default_rng(6)
    curves = noisy(1.0, 0.0, 0.0, 500, seed=5)
    loads = [one.apparent_mass * (1.0 + share * rng.normal(size=8)) for one in curves]
    pairs = zip(curves, loads, strict=True)
    fits = [with_scatter(fit_one, replace(one, apparent_mass=load)) for one, load in pairs]
    inverse = np.array([1.0 / fit.saturation_mass for fit in fits])
    stated = np.array([fit.saturation_error / fit.saturation_mass**2 for fit in fits])
    assert stated.mean() == pytest.approx(inverse.std(), rel=0.15)
    assert np.mean([fit.scatter for fit in fits]) == pytest.approx(share, abs=0.006)


def test_scatter_of_points_scales_error_and_chi_square():
    rng = np.random.default_rng(4)
    one = curve(1.0, 0.0, 0.0, NOISE, rng)
    tenfold = Curve(MASS, one.apparent_mass, 10.0 * one.error, 0.0, 1.0)
    first, second = fit_one(one), fit_one(tenfold)
    assert second.saturation_error == pytest.approx(10.0 * first.saturation_error, rel=1e-3)
    assert second.chi_square == pytest.approx(first.chi_square / 100.0, rel=1e-6)


def test_point_without_scatter_does_not_outweigh_the_others():
    one = curve(1.0, 0.0, error=NOISE)
    error = np.where(np.arange(8) == 3, 0.0, one.error)
    found = fit_one(Curve(MASS, one.apparent_mass, error, 0.0, 1.0))
    assert found.saturation_mass == pytest.approx(SATURATION, rel=1e-6)
    assert found.saturation_error > 1e-5 * SATURATION


@pytest.mark.parametrize("fit", [fit_one, fit_two])
@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_load_that_bends_the_other_way_has_no_saturation(fit, sense):
    load = apparent_mass(MASS, -sense, 0.0, SATURATION)
    assert fit(Curve(MASS, load, NOISE * load, 0.0, sense)) is None


def test_hydrostatic_load_never_saturates():
    found = fit_one(Curve(MASS, MASS, NOISE * MASS, 0.0, 1.0))
    assert found is None or found.saturation_mass > 1e3 * MASS[-1]


@pytest.mark.parametrize("load", [np.zeros(8), -MASS, MASS[::-1], 1e6 * MASS])
@pytest.mark.parametrize("fit", [fit_one, fit_two])
def test_nonsense_is_fitted_or_refused_without_an_error(fit, load):
    found = fit(Curve(MASS, load, np.zeros(8), 0.0, -1.0))
    assert found is None or np.isfinite(found.chi_square)


def test_three_points_are_enough():
    load = apparent_mass(MASS[::3], 1.0, 0.0, SATURATION)
    few = Curve(MASS[::3], load, NOISE * load, 0.0, 1.0)
    assert fit_one(few).degrees_of_freedom == 2
    assert fit_two(few).degrees_of_freedom == 1
