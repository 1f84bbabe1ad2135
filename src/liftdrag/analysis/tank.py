"""The answers of a tank: drag and lift, their coefficients, and what they are measured by."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import pi, sqrt

import numpy as np

from liftdrag import granular
from liftdrag.analysis.errorbars import average
from liftdrag.analysis.quantity import Quantity, ratio, shortcomings
from liftdrag.analysis.steady import SteadyWindow, common_window, steady_window
from liftdrag.analysis.surface import surface_height
from liftdrag.errors import SeriesTooShort
from liftdrag.granular import GRAVITY
from liftdrag.scene import TankScene
from liftdrag.scene.tank import TRANSIENT
from liftdrag.series import Series
from liftdrag.snapshot import Snapshot

SLIP = 0.05
"""Departure of the far bed's speed from the drive's that is warned about."""


@dataclass(frozen=True)
class Answers:
    """The quantities by name, the steady window that they were averaged over, and warnings."""

    quantities: dict[str, Quantity]
    window: SteadyWindow
    warnings: tuple[str, ...]


def answers(scene: TankScene, series: Series, snapshots: Sequence[Snapshot]) -> Answers:
    """The averages of a tank's steady window.

    `series` has the channels drag, lift (N), bed_speed (m/s), solid_fraction and
    overburden (Pa). A force without a trustworthy error is not converged, and a
    warning says so.
    """
    window = _window(scene, series)
    mean = {name: _average(series, name, window) for name in series.channels}
    depth = _depth(scene, snapshots)
    effective = _effective_depth(scene, depth, mean["solid_fraction"])
    quantities = {
        "drag": mean["drag"],
        "lift": mean["lift"],
        **_coefficients(scene, mean, effective),
        "solid_fraction": mean["solid_fraction"],
        "depth": depth,
        "effective_depth": effective,
        "overburden": mean["overburden"],
        "bed_speed_ratio": ratio(mean["bed_speed"], 1.0 / scene.drive.speed, [], "1"),
        "inertial_number": _inertial_number(scene, mean["overburden"]),
    }
    return Answers(quantities, window, tuple(_warnings(quantities, window)))


def _window(scene: TankScene, series: Series) -> SteadyWindow:
    skipped = TRANSIENT * scene.intruder.diameter / scene.drive.speed
    start = int(np.searchsorted(series.time, skipped))
    try:
        return common_window([steady_window(series[name], start) for name in ("drag", "lift")])
    except SeriesTooShort:
        return SteadyWindow(start, len(series), float("nan"), False)


def _average(series: Series, name: str, window: SteadyWindow) -> Quantity:
    """The average of a channel; one too slow for an error bar gets its whole spread as error."""
    values, unit = series[name][window.start : window.stop], series.units[name]
    try:
        return Quantity.of(average(values, series.interval), unit)
    except SeriesTooShort:
        return Quantity(float(values.mean()), float(values.std()), unit, None, 1.0, False)


def _depth(scene: TankScene, snapshots: Sequence[Snapshot]) -> Quantity:
    """Depth of the axis below the far field's free surface, over the snapshots."""
    area = scene.far_length * scene.tank.thickness
    surfaces = []
    for snapshot in snapshots:
        x, z = snapshot.position[:, 0], snapshot.position[:, 2]
        far = (snapshot.kind == 1) & (x % scene.tank.length < scene.far_length)
        surfaces.append(surface_height(z[far], scene.grains.diameter, area, scene.far_band))
    depths = np.array(surfaces) - scene.axis_height
    n = len(depths)
    error = float(depths.std(ddof=1) / sqrt(n)) if n > 1 else float("inf")
    return Quantity(float(depths.mean()), error, "m", None, float(n), n > 1)


def _effective_depth(scene: TankScene, depth: Quantity, fraction: Quantity) -> Quantity:
    """h~ = h + (pi d / 6) rho*/rho, without h where the bulk has no weight."""
    grains, lid = scene.grains, scene.lid
    own = depth.mean if scene.bulk_gravity else 0.0
    own_error = depth.standard_error if scene.bulk_gravity else 0.0
    above, above_error = 0.0, 0.0
    if lid is not None:
        ratio_to_bulk = lid.density_ratio / fraction.mean
        above = granular.lid_depth(grains.diameter, ratio_to_bulk)
        above_error = above * fraction.standard_error / fraction.mean
    error = float(np.hypot(own_error, above_error))
    return Quantity(own + above, error, "m", None, depth.n_independent, depth.converged)


def _coefficients(
    scene: TankScene, mean: dict[str, Quantity], depth: Quantity
) -> dict[str, Quantity]:
    """C_d = F/(rho g h~ D L), C_l = F/(rho g (pi D^2/4) L), and C_d by the measured overburden."""
    front = scene.intruder.diameter * scene.tank.thickness
    section = pi * scene.intruder.diameter**2 / 4.0 * scene.tank.thickness
    weight = scene.grains.density * GRAVITY
    fraction = mean["solid_fraction"]
    return {
        "drag_coefficient": ratio(mean["drag"], 1.0 / (weight * front), [fraction, depth], "1"),
        "lift_coefficient": ratio(mean["lift"], 1.0 / (weight * section), [fraction], "1"),
        "drag_coefficient_overburden": ratio(mean["drag"], 1.0 / front, [mean["overburden"]], "1"),
    }


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


def _warnings(quantities: dict[str, Quantity], window: SteadyWindow) -> Iterator[str]:
    yield from shortcomings({name: quantities[name] for name in ("drag", "lift")}, window)
    speed = quantities["bed_speed_ratio"]
    if abs(speed.mean - 1.0) > SLIP:
        yield (
            f"The bed slips: far from the cylinder it moves at {speed.mean:.3f} of drive.speed, "
            "so drag and lift come out too low; lengthen the tank."
        )
