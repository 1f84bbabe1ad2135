"""Janssen's curve, apparent mass against the mass of the fill, and its fits with their errors.

With beta = s/M_sat, s = 1 where the wall carries grains and -1 where it pushes them down, a
load Q on top and z = max(M - M_0, 0),

    M_app = z exprel(-beta z) + (Q + min(M, M_0)) exp(-beta z),    exprel(x) = (e^x - 1)/x:

for M_0 = 0 Janssen's s M_sat + (Q - s M_sat) exp(-s M/M_sat), else the two-parameter form of
Vanel and Clement, Eur. Phys. J. B 11 (1999) 525, in which a mass M_0 at the top is not carried.
Written so it holds through beta = 0, without friction, and beta, to which Janssen's K is
proportional, is what is fitted.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from math import hypot, isfinite, sqrt
from typing import Any

import numpy as np
from scipy.optimize import OptimizeWarning, brentq, curve_fit, minimize_scalar
from scipy.special import exprel
from scipy.stats import chi2

STEEPEST = 60.0
"""Largest M/M_sat of the last fill from which a fit starts."""

STARTS = np.sinh(np.linspace(-np.arcsinh(STEEPEST), np.arcsinh(STEEPEST), 241))
"""The slopes beta, over that of the largest mass, from the best of which a fit starts."""

CAPS = 20
"""Caps M_0 from the best of which the fit of two parameters starts."""

LEAST_ERROR = 1e-4
"""Least error of a point over the mass above the piston: a load in a series without scatter
would outweigh all others."""

UNSOLVED = 1e100
"""Chi-square where the least squares came to no end: worse than any."""


def apparent_mass(
    mass: np.ndarray, sense: float, lid: float, saturation: float, cap: float = 0.0
) -> np.ndarray:
    """M_app (n,) of fills of `mass` (n,), all in kg; `sense` is 1, or -1 for a rising piston."""
    return _form(mass, lid, sense / saturation, cap)


def _form(mass: np.ndarray, lid: float, beta: float, cap: float) -> np.ndarray:
    below = np.maximum(mass - cap, 0.0)
    exponent = np.clip(-beta * below, None, 2.0 * STEEPEST)
    return np.asarray(below * exprel(exponent) + (lid + np.minimum(mass, cap)) * np.exp(exponent))


@dataclass(frozen=True)
class Curve:
    """Points of a curve: `mass` and `apparent_mass` with its `error`, all (n,) in kg.

    `lid` (kg) is the load on top; `sense` 1, or -1 where the wall pushes the grains down;
    `scatter` of the loads beyond their errors, over the load.
    """

    mass: np.ndarray
    apparent_mass: np.ndarray
    error: np.ndarray
    lid: float
    sense: float
    scatter: float = 0.0

    @property
    def sigma(self) -> np.ndarray:
        """The errors (n,) in kg, none below LEAST_ERROR of the mass above the piston."""
        own = np.maximum(self.error, LEAST_ERROR * (self.mass + self.lid))
        return np.asarray(np.hypot(own, self.scatter * self.apparent_mass))


@dataclass(frozen=True)
class JanssenFit:
    """A fit's parameters in kg and their errors, as the errors of the points make them.

    `hydrostatic_cap` is M_0, zero with no error where it was not fitted. `chi_square` is the sum
    with the points' own errors, `scatter` what was then added to them, over their load.
    """

    saturation_mass: float
    saturation_error: float
    hydrostatic_cap: float
    cap_error: float
    chi_square: float
    degrees_of_freedom: int
    scatter: float = 0.0

    @property
    def reduced(self) -> float:
        """chi-square per degree of freedom: 1 +- sqrt(2/dof) where the form holds."""
        return self.chi_square / self.degrees_of_freedom

    @property
    def p_value(self) -> float:
        """Probability of a chi-square this large or larger where the form holds."""
        return float(chi2.sf(self.chi_square, self.degrees_of_freedom))

    def to_dict(self) -> dict[str, Any]:
        """The fit as `result.json` holds it, in kg."""
        return {
            "saturation_mass": self.saturation_mass,
            "saturation_error": self.saturation_error,
            "hydrostatic_cap": self.hydrostatic_cap,
            "cap_error": self.cap_error,
            "chi_square": self.chi_square,
            "degrees_of_freedom": self.degrees_of_freedom,
            "p_value": self.p_value,
            "scatter": self.scatter,
        }


def with_scatter(fit: Callable[[Curve], JanssenFit | None], curve: Curve) -> JanssenFit | None:
    """The fit with so much scatter between the fills that chi-square is the degrees of freedom.

    A fill's load differs from that of another column, or from the form, by more than its own
    series shows: packings last longer than an average. What is missing is taken as one relative
    scatter of all loads, as Mandel and Paule do between laboratories (Anal. Chem. 42 (1970)
    1194): a fill of a small error then does not outweigh the others. None is added where the
    form holds within the errors.
    """
    plain = fit(curve)
    if plain is None or plain.reduced <= 1.0:
        return plain

    def excess(scatter: float) -> float:
        found = fit(replace(curve, scatter=scatter))
        return -1.0 if found is None else found.reduced - 1.0

    scatter = 1.0 if excess(1.0) > 0.0 else float(brentq(excess, 0.0, 1.0, xtol=1e-5))
    found = fit(replace(curve, scatter=scatter))
    return found and replace(found, chi_square=plain.chi_square, scatter=scatter)


def fit_one(curve: Curve) -> JanssenFit | None:
    """The one-parameter form by weighted least squares; None where the load does not bend
    as the sense of the motion asks."""
    slope = _slope_at(curve, 0.0)
    return None if slope is None else _fit(curve, slope, 1)


def fit_two(curve: Curve) -> JanssenFit | None:
    """The two-parameter form, 0 <= M_0 <= the last mass but one; None as in `fit_one`.

    M_0 enters as its square where the lid and M_0 are small, so the error is not taken from
    derivatives: it is the way, the longer one, in which the least chi-square rises by one. At
    zero it is a bound from above.
    """
    caps = np.union1d(np.linspace(0.0, curve.mass[-2], CAPS), curve.mass[:-1])
    squares = [_square_at(curve, cap) for cap in caps]
    best = int(np.argmin(squares))
    low, high = caps[max(best - 1, 0)], caps[min(best + 1, len(caps) - 1)]
    cap = _least(lambda cap: _square_at(curve, cap), low, high, caps[best])
    slope = _slope_at(curve, cap)
    if slope is None:
        return None
    ends = [_rise(curve, cap, slope.square + 1.0, end) for end in (0.0, float(curve.mass[-2]))]
    spread = [abs(slope.beta - end.beta) for end in (_slope_at(curve, end) for end in ends) if end]
    error = hypot(slope.error, max(spread, default=0.0))
    cap_error = max(abs(end - cap) for end in ends)
    return _fit(curve, _Slope(slope.beta, error, slope.square), 2, cap, cap_error)


@dataclass(frozen=True)
class _Slope:
    """beta and its error (1/kg), and the chi-square, at one cap."""

    beta: float
    error: float
    square: float


def _fit(
    curve: Curve, slope: _Slope, parameters: int, cap: float = 0.0, cap_error: float = 0.0
) -> JanssenFit | None:
    saturation = curve.sense / slope.beta if slope.beta else np.inf
    if not 0.0 < saturation < np.inf:
        return None
    freedom = len(curve.mass) - parameters
    error = slope.error * saturation**2
    return JanssenFit(saturation, error, cap, cap_error, slope.square, freedom)


def _slope_at(curve: Curve, cap: float) -> _Slope | None:
    """Weighted least squares for beta at a cap, in units of the largest mass; None without."""
    unit = float(curve.mass[-1])
    mass, load, sigma = curve.mass / unit, curve.apparent_mass / unit, curve.sigma / unit

    def form(masses: np.ndarray, beta: Any) -> np.ndarray:
        return _form(masses, curve.lid / unit, beta, cap / unit)

    squares = np.sum(((load - form(mass, STARTS[:, None])) / sigma) ** 2, axis=1)
    found = _solved(form, mass, load, sigma, float(STARTS[np.argmin(squares)]))
    if found is None:
        return None
    residuals = (load - form(mass, found[0])) / sigma
    return _Slope(found[0] / unit, found[1] / unit, float(residuals @ residuals))


def _solved(
    form: Callable[..., np.ndarray],
    mass: np.ndarray,
    load: np.ndarray,
    sigma: np.ndarray,
    start: float,
) -> tuple[float, float] | None:
    """The slope and its error by `curve_fit`; None where it does not come to an end."""
    with warnings.catch_warnings():
        warnings.simplefilter("error", OptimizeWarning)
        try:
            best, covariance = curve_fit(
                form, mass, load, [start], sigma, absolute_sigma=True, xtol=1e-13, ftol=1e-13
            )
        except (RuntimeError, ValueError, OptimizeWarning):
            return None
    beta, error = float(best[0]), sqrt(float(covariance[0, 0]))
    return (beta, error) if isfinite(beta) and isfinite(error) else None


def _square_at(curve: Curve, cap: float) -> float:
    slope = _slope_at(curve, float(cap))
    return UNSOLVED if slope is None else slope.square


def _least(function: Callable[[float], float], low: float, high: float, best: float) -> float:
    """Where `function` is least between `low` and `high`, no worse than at `best`."""
    found = minimize_scalar(function, bounds=(low, high), options={"xatol": 1e-10 * high})
    return float(found.x) if found.fun < function(best) else float(best)


def _rise(curve: Curve, cap: float, square: float, end: float) -> float:
    """The cap from `cap` towards `end` where the least chi-square comes to `square`, or `end`."""
    if end == cap or _square_at(curve, end) <= square:
        return end
    low, high = sorted((cap, end))
    return float(brentq(lambda at: _square_at(curve, at) - square, low, high, rtol=1e-6))
