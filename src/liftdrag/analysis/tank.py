"""The answers of a tank: drag and lift, their coefficients, and what they are measured by."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from math import hypot

import numpy as np

from liftdrag import granular
from liftdrag.analysis.correlated import ratio_of_means
from liftdrag.analysis.errorbars import average
from liftdrag.analysis.quantity import Quantity, ratio, shortcomings
from liftdrag.analysis.steady import SteadyWindow, common_window, steady_window
from liftdrag.analysis.surface import surface_height
from liftdrag.errors import InputError, SeriesTooShort
from liftdrag.granular import GRAVITY
from liftdrag.scene import TankScene
from liftdrag.scene.tank import TRANSIENT
from liftdrag.series import Series

SLIP = 0.05
"""Departure of the far bed's speed from the drive's that is warned about."""


Surface = tuple[float, np.ndarray]
"""A time (s), and the heights (n,) in m of the far field's top grains."""

NOTICED = 0.01
"""Relative error of a far-field quantity above which few correlation times are worth a word."""

FORCES = frozenset({"drag", "lift"})

_FAR_FIELD = ("solid_fraction", "depth", "overburden", "bed_speed_ratio")


@dataclass(frozen=True)
class Answers:
    """The quantities by name, the steady window that they were averaged over, and warnings."""

    quantities: dict[str, Quantity]
    window: SteadyWindow
    warnings: tuple[str, ...]


def forces(scene: TankScene, series: Series) -> dict[str, Quantity]:
    """Drag and lift alone of the steady window. Raises InputError as `answers` does."""
    window = _window(scene, series)
    return {name: _average(series, name, window) for name in sorted(FORCES)}


def answers(scene: TankScene, series: Series, surfaces: Iterable[Surface]) -> Answers:
    """The averages of a tank's steady window.

    `series` has the channels drag, lift (N), bed_speed (m/s), solid_fraction and
    overburden (Pa); `surfaces` the heights of the far field's top grains at some
    times. A quantity without a trustworthy error is not converged, and a warning
    says so. Raises InputError when the series ends before the flow is steady.
    """
    window = _window(scene, series)
    steady = series.part(window.start, window.stop)
    mean = {name: _average(series, name, window) for name in series.channels}
    depths = _depths(scene, surfaces, steady.time[0], steady.time[-1])
    depth = _quantity(depths.metres, depths.interval, "m")
    fraction = mean["solid_fraction"]
    quantities = {
        "drag": mean["drag"],
        "lift": mean["lift"],
        **_coefficients(scene, steady, mean, depths),
        "solid_fraction": fraction,
        "depth": depth,
        "effective_depth": _effective_depth(scene, depth, fraction),
        "overburden": mean["overburden"],
        "bed_speed_ratio": ratio(mean["bed_speed"], 1.0 / scene.drive.speed, [], "1"),
        "inertial_number": _inertial_number(scene, mean["overburden"]),
    }
    return Answers(quantities, window, tuple(_warnings(quantities, window)))


def _window(scene: TankScene, series: Series) -> SteadyWindow:
    skipped = TRANSIENT * scene.intruder.diameter / scene.drive.speed
    start = int(np.searchsorted(series.time, skipped))
    if len(series) - start < 2:
        raise InputError(
            f"The series ends after {len(series)} samples, before the flow is steady; "
            "run the case again."
        )
    try:
        return common_window([steady_window(series[name], start) for name in ("drag", "lift")])
    except SeriesTooShort:
        return SteadyWindow(start, len(series), float("nan"), False)


def _average(series: Series, name: str, window: SteadyWindow) -> Quantity:
    values = series[name][window.start : window.stop]
    return _quantity(values, series.interval, series.units[name])


def _quantity(values: np.ndarray, interval: float, unit: str) -> Quantity:
    """The average of a series; one too slow for an error bar gets its whole spread as error."""
    try:
        return Quantity.of(average(values, interval), unit)
    except SeriesTooShort:
        return Quantity(float(values.mean()), float(values.std()), unit, None, 1.0, False)


@dataclass(frozen=True)
class _Depths:
    """Depths (n,) in m of the axis below the far field's free surface, at `times` (n,) in s."""

    times: np.ndarray
    metres: np.ndarray

    @property
    def interval(self) -> float:
        return float(self.times[-1] - self.times[0]) / (len(self.times) - 1)


def _depths(scene: TankScene, surfaces: Iterable[Surface], start: float, end: float) -> _Depths:
    """Those from `start` to `end` (s)."""
    (left, right), (low, high) = scene.far_field, scene.far_band
    d, area = scene.grains.diameter, (right - left) * scene.tank.thickness
    inside = [(time, heights) for time, heights in surfaces if start <= time <= end]
    if len(inside) < 2:
        raise InputError("The far field's surface was not recorded; run the case again.")
    levels = [surface_height(heights, d, area, (low + d, high)) for _, heights in inside]
    return _Depths(np.array([time for time, _ in inside]), np.array(levels) - scene.axis_height)


def _lid_columns(scene: TankScene) -> float:
    """(pi d / 6) rho*/rho_g: the lid as a height (m) of solid material of the grains."""
    if scene.lid is None:
        return 0.0
    return granular.lid_depth(scene.grains.diameter, scene.lid.density_ratio)


def _effective_depth(scene: TankScene, depth: Quantity, fraction: Quantity) -> Quantity:
    """h~ = h + (pi d / 6) rho*/rho, without h where the bulk has no weight."""
    own = 1.0 if scene.bulk_gravity else 0.0
    lid = _lid_columns(scene) / fraction.mean
    error = hypot(own * depth.standard_error, lid * fraction.standard_error / fraction.mean)
    time, count = depth.correlation_time, depth.n_independent
    return Quantity(own * depth.mean + lid, error, "m", time, count, depth.converged or own == 0.0)


def _weight(scene: TankScene, fraction: np.ndarray, depth: np.ndarray) -> np.ndarray:
    """rho g h~ (n,) in Pa, in which the solid fraction (n,) multiplies the depth, not the lid."""
    own = 1.0 if scene.bulk_gravity else 0.0
    solid = own * fraction * depth + _lid_columns(scene)
    return np.asarray(scene.grains.density * GRAVITY * solid)


def _coefficients(
    scene: TankScene, steady: Series, mean: dict[str, Quantity], depths: _Depths
) -> dict[str, Quantity]:
    """C_d = F/(rho g h~ D L), C_l = F/(rho g (pi D^2/4) L), and C_d by the measured overburden.

    The drag follows the slow rise and fall of the weight above the cylinder: C_d's error is that
    of the ratio of the two series, in which what they share cancels.
    """
    front = scene.intruder.diameter * scene.tank.thickness
    displaced = scene.intruder.section * scene.tank.thickness
    buoyancy = scene.grains.density * GRAVITY * displaced
    fraction, depth = steady["solid_fraction"], np.interp(steady.time, depths.times, depths.metres)
    weight = _weight(scene, fraction, depth)
    means = _weight(scene, fraction.mean(), depths.metres.mean())
    return {
        "drag_coefficient": _drag_ratio(steady, front * weight * means / weight.mean()),
        "lift_coefficient": ratio(mean["lift"], 1.0 / buoyancy, [mean["solid_fraction"]], "1"),
        "drag_coefficient_overburden": _drag_ratio(steady, front * steady["overburden"]),
    }


def _drag_ratio(steady: Series, scale: np.ndarray) -> Quantity:
    """The mean drag over the mean of `scale` (n,) in N. Raises InputError where that is zero."""
    found = ratio_of_means(steady["drag"], scale, steady.interval)
    if found is None:
        raise InputError("Nothing lies above the cylinder; run the case again, deeper.")
    return found


def _inertial_number(scene: TankScene, overburden: Quantity) -> Quantity:
    rate = scene.drive.speed / scene.intruder.diameter
    number = granular.inertial_number(
        rate, scene.grains.diameter, overburden.mean, scene.grains.density
    )
    error = 0.5 * number * overburden.standard_error / overburden.mean
    return Quantity(
        number,
        error,
        "1",
        overburden.correlation_time,
        overburden.n_independent,
        overburden.converged,
    )


def _doubtful(quantity: Quantity) -> bool:
    return not quantity.converged and quantity.standard_error > NOTICED * abs(quantity.mean)


def _warnings(quantities: dict[str, Quantity], window: SteadyWindow) -> Iterator[str]:
    yield from shortcomings({name: quantities[name] for name in ("drag", "lift")}, window)
    drifting = [name for name in _FAR_FIELD if _doubtful(quantities[name])]
    if drifting:
        yield (
            f"The far field changes slowly: the errors of {', '.join(drifting)} are guesses, "
            "from few correlation times."
        )
    speed = quantities["bed_speed_ratio"]
    if abs(speed.mean - 1.0) > SLIP:
        yield (
            f"The bed slips: far from the cylinder it moves at {speed.mean:.3f} of drive.speed, "
            "so drag and lift come out too low; lengthen the tank."
        )
