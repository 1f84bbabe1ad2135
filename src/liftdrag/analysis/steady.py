"""From where on a series is steady, and whether what remains still drifts.

Source of the truncation: K. P. White, Simulation 69 (1997) 323, the marginal standard error rule
(MSER), on batch means as in MSER-5; but with a fixed number of batches, so that their length
grows with the series. On stationary AR(1) series of 30 to 200 correlation times this rule throws
away 2 to 5 % of the data on average, and at most a fifth in nine series of ten; the drift test
calls 0.3 to 2 % of them unsteady. A drift of 3 standard deviations of the noise over 60
correlation times is found in three runs of four, the cut hides it in the others.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from liftdrag.analysis.errorbars import average
from liftdrag.errors import SeriesTooShort

BATCHES = 40
LARGEST_CUT = 0.4
LARGEST_DRIFT = 3.0


@dataclass(frozen=True)
class SteadyWindow:
    """The samples [start, stop) to average, and how they drift.

    `drift` is the mean of the late half minus that of the early half, in its standard errors;
    `steady` says that it is at most LARGEST_DRIFT either way: no trend is seen. A window within a
    few correlation times may look steady, its `errorbars.average` is then not converged.
    """

    start: int
    stop: int
    drift: float
    steady: bool


def steady_window(values: np.ndarray, minimum_start: int) -> SteadyWindow:
    """The steady end of `values` (n,), from `minimum_start` or later, to the last sample.

    Raises SeriesTooShort, with the mean of what follows `minimum_start`, when that is less than
    BATCHES samples; ValueError for values that are not finite or a negative `minimum_start`.
    """
    if minimum_start < 0:
        raise ValueError(f"a window cannot start at sample {minimum_start}")
    rest = np.asarray(values, dtype=float)[minimum_start:]
    if not np.all(np.isfinite(rest)):
        raise ValueError("a steady window needs finite values")
    if len(rest) < BATCHES:
        raise SeriesTooShort(
            f"{len(rest)} samples follow the start, {BATCHES} are the least; lengthen the run",
            float(rest.mean()) if len(rest) else None,
        )
    cut = _truncation(rest)
    drift = _drift(rest[cut:])
    start, stop = minimum_start + cut, minimum_start + len(rest)
    return SteadyWindow(start, stop, drift, abs(drift) <= LARGEST_DRIFT)


def common_window(windows: Sequence[SteadyWindow]) -> SteadyWindow:
    """One window for channels of one series: the latest start, and the worst drift of them all.

    Raises ValueError when there is no window, or when they end at different samples.
    """
    if len({window.stop for window in windows}) != 1:
        raise ValueError("a common window needs windows that end at the same sample")
    worst = max((window.drift for window in windows), key=abs)
    start = max(window.start for window in windows)
    return SteadyWindow(start, windows[0].stop, worst, all(window.steady for window in windows))


def _truncation(values: np.ndarray) -> int:
    """How many of the first `values` (n,) to drop: whole batches, counted from the end.

    The search goes up to half of them. A best cut beyond LARGEST_CUT shows a trend without an
    end rather than a transient: then nothing is cut, and the drift of all of it decides.
    """
    size = len(values) // BATCHES
    count = len(values) // size
    relative = values[len(values) - count * size :] - values[0]
    errors = _marginal_errors(relative.reshape(count, size).mean(axis=1))
    dropped = int(np.argmin(errors[: count // 2 + 1]))
    return len(values) - (count - dropped) * size if 0 < dropped <= LARGEST_CUT * count else 0


def _marginal_errors(batches: np.ndarray) -> np.ndarray:
    """MSER statistic (k,): entry d is variance / count of the `batches` (k,) from d on."""
    tails = [batches[d:] for d in range(len(batches))]
    return np.array([np.var(tail) / len(tail) for tail in tails])


def _drift(values: np.ndarray) -> float:
    """Late half mean minus early half mean of `values` (n,), in its standard errors.

    The error, twice that of the whole mean, is taken about the parabola of least squares: about
    the mean, a drift would pass for a long correlation and hide itself.
    """
    if np.ptp(values) == 0.0:
        return 0.0
    half = len(values) // 2
    change = float(values[-half:].mean() - values[:half].mean())
    error = 2.0 * _error_about_parabola(values)
    return change / error if error > 0.0 else math.copysign(math.inf, change)


def _error_about_parabola(values: np.ndarray) -> float:
    """Standard error of the mean of `values` (n,) about their parabola of least squares."""
    samples = np.arange(len(values))
    parabola = np.polynomial.Polynomial.fit(samples, values, 2)
    return average(values - parabola(samples) + values.mean(), 1.0).standard_error
