"""Where a force that grows with depth no longer grows: its plateau, and the depth of 90 % of it.

C(x) = C_inf (1 - exp(-x/l)) is fitted; the critical depth of Guillard et al. (2014, Fig. 6), at
which the lift has 90 % of its plateau, is then l ln 10.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import log, sqrt

import numpy as np
from scipy.optimize import minimize_scalar

LEAST = 3
"""Points that the two parameters need, and one to judge them by."""

LONGEST, SHORTEST = 10.0, 0.02
"""Lengths l between which a fit looks, of the largest and of the smallest place."""


@dataclass(frozen=True)
class Saturation:
    """The plateau (unit of the values) and the place of 90 % of it, with their standard errors.

    `chi_square` is that of `freedom` degrees. Where the values do not bend over the places there
    is no plateau: `saturates` is false and the numbers are not to be used.
    """

    plateau: float
    plateau_error: float
    depth: float
    depth_error: float
    chi_square: float
    freedom: int
    saturates: bool


def saturation(places: np.ndarray, values: np.ndarray, errors: np.ndarray) -> Saturation:
    """The fit to values (n,) with standard errors (n,) at places (n,) > 0.

    Raises ValueError for fewer than three points, or errors that are not positive.
    """
    x, y, e = (np.asarray(each, float) for each in (places, values, errors))
    if len(x) < LEAST or not (x > 0.0).all() or not (e > 0.0).all():
        raise ValueError(f"{LEAST} points with errors are needed, at places above zero")
    bounds = log(SHORTEST * x.min()), log(LONGEST * x.max())
    found = minimize_scalar(lambda s: _chi_square(x, y, e, np.exp(s)), bounds=bounds)
    length = float(np.exp(found.x))
    plateau = _plateau(x, y, e, length)
    of_plateau, of_length = _errors(x, e, plateau, length)
    return Saturation(
        plateau,
        of_plateau,
        log(10.0) * length,
        log(10.0) * of_length,
        _chi_square(x, y, e, length),
        len(x) - 2,
        bool(of_length < length and of_plateau < abs(plateau)),
    )


def _rise(x: np.ndarray, length: float) -> np.ndarray:
    return np.asarray(-np.expm1(-x / length))


def _plateau(x: np.ndarray, y: np.ndarray, e: np.ndarray, length: float) -> float:
    """The best one at a given length: the value is linear in it."""
    rise = _rise(x, length)
    return float(np.sum(rise * y / e**2) / np.sum(rise**2 / e**2))


def _chi_square(x: np.ndarray, y: np.ndarray, e: np.ndarray, length: float) -> float:
    misfit = (y - _plateau(x, y, e, length) * _rise(x, length)) / e
    return float(misfit @ misfit)


def _errors(x: np.ndarray, e: np.ndarray, plateau: float, length: float) -> tuple[float, float]:
    """Standard errors of plateau and length, from the slopes of the curve at the points."""
    by_length = -plateau * x / length**2 * np.exp(-x / length)
    slopes = np.stack([_rise(x, length), by_length]) / e
    covariance = np.linalg.pinv(slopes @ slopes.T)
    return sqrt(covariance[0, 0]), sqrt(covariance[1, 1])
