"""Quantities from correlated series: a mean, a ratio of two means, and a drift."""

from __future__ import annotations

from math import copysign, inf

import numpy as np

from liftdrag.analysis.errorbars import average
from liftdrag.analysis.quantity import Quantity
from liftdrag.errors import SeriesTooShort

ROUND_OFF = 1e-12
"""Spread over the mean up to which a series is constant."""


def mean_of(values: np.ndarray, interval: float, unit: str) -> Quantity:
    """Mean of a correlated series (n,), sampled every `interval` (s), with its error.

    A series that is too short for an error bar gets its plain scatter as error, and is not
    converged.
    """
    mean = float(values.mean())
    if np.ptp(values) <= ROUND_OFF * abs(mean):
        values = np.full(len(values), mean)
    try:
        return Quantity.of(average(values, interval), unit)
    except SeriesTooShort:
        return Quantity(mean, float(values.std()), unit, None, 1.0, False)


def ratio_of_means(
    numerator: np.ndarray, denominator: np.ndarray, interval: float, unit: str = "1"
) -> Quantity | None:
    """R = <a>/<b> of two series (n,) of the same times; None where <b> is zero.

    To first order its error is that of the mean of R + (a - R b)/<b>, in which what the two
    have in common cancels.
    """
    scale = float(denominator.mean())
    if scale == 0.0:
        return None
    value = float(numerator.mean()) / scale
    return mean_of(value + (numerator - value * denominator) / scale, interval, unit)


def drift(values: np.ndarray) -> float:
    """Mean of the late half of `values` (n,) minus that of the early half, in its errors.

    As in `steady`, the error is that about the parabola of least squares, so that a trend does
    not pass for a long correlation and hide itself; zero without an error bar.
    """
    half, samples = len(values) // 2, np.arange(len(values))
    if np.ptp(values) <= ROUND_OFF * abs(float(values.mean())):
        return 0.0
    parabola = np.polynomial.Polynomial.fit(samples, values, 2)
    try:
        error = 2.0 * average(values - parabola(samples), 1.0).standard_error
    except SeriesTooShort:
        return 0.0
    change = float(values[-half:].mean() - values[:half].mean())
    return change / error if error > 0.0 else copysign(inf, change)
