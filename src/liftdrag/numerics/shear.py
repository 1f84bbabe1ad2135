"""The numerics of a shear flow of cylinders, derived from its scene alone, each with its reason."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import ceil, pi, sqrt

import numpy as np

from liftdrag import hertz, kinetic, liu
from liftdrag.errors import CaseError, at_most
from liftdrag.numerics.value import Numerics, Value
from liftdrag.scene import ShearScene

STEP_FRACTION = 0.1
"""Time step over the critical one: in the paper's Fig. 3a 0.025 to 0.1 give the same stress."""

STEP_BOUND = 0.3
"""The same ratio above which a time step set by hand is warned about."""

STEP_BREAKS = 1.0
"""The ratio beyond which a step is refused: a wave crosses a grain within it."""

ROWS_PER_STRAIN = 10
"""Samples of the stress, means over the time between them, in a strain of one.

More of them would only show the noise of single contacts, in which the slow changes hide from the
estimate of the correlation time.
"""

ROWS_PER_FRAME = 2
"""Samples between two looks at where the grains are and how they lie."""

MOST_ROWS = 20_000
"""A longer run is sampled less often."""

FEWEST_ROWS = 400

SKIN = 0.4
"""Neighbour skin over the mean of each grain's smaller side, at which the engine is fastest."""

MOST_STEPS = 2_000_000_000

MEAN_ALIGNMENT = 0.5
"""Order parameter at which the pressure to expect is read off the paper's curve."""

DEEP = 0.02
"""Overlap to expect, over the least side of a grain, from which on contacts are called soft."""

DENSE, MANY = 0.4, 2000
"""Solid fraction from which on cylinders order, and the grains of a cell below which that moves
the stress: at 0.5 by up to 60 % in one of 500."""

SPEED_HINT = 2e6
"""Grain-steps per second of one core, for the estimate of the cost."""


@dataclass(frozen=True, kw_only=True)
class ShearNumerics(Numerics):
    """Every number that a deck of a sheared cell needs and the scene does not say."""

    cell: Value[tuple[float, ...]]
    counts: Value[tuple[int, ...]]
    solid_fraction: Value[float]
    modulus: Value[float]
    critical_time: Value[float]
    time_step: Value[float]
    drive_steps: Value[int]
    row_every: Value[int]
    frame_every: Value[int]
    skin: Value[float]
    stress_scale: Value[float]
    pressure: Value[float]
    overlap_ratio: Value[float]
    grain_steps: Value[float]
    core_hours: Value[float]


def derive(scene: ShearScene) -> ShearNumerics:
    """The numerics of `scene`. Raises CaseError when they cannot be."""
    step, row_every, rows = _time_step(scene)
    steps, pressure = rows * row_every, expected_pressure(scene)
    overlap = expected_overlap(scene)
    cost = float(scene.grain_count * steps)
    factor = scene.numerics.stiffness_factor
    return ShearNumerics(
        cell=Value(tuple(float(f"{side:.4g}") for side in scene.sides), "m", _size_reason(scene)),
        counts=Value(scene.counts, "grains", "nearest to the shares, in the order of the species"),
        solid_fraction=Value(scene.solid_fraction, "1", "of the whole grains in the cell"),
        modulus=Value(
            factor * scene.grains.youngs_modulus, "Pa", f"{factor:g} of grains.youngs_modulus"
        ),
        critical_time=Value(
            critical_time(scene), "s", "pi l_c / (0.3262 nu + 1.7532) sqrt(rho/G), l_c least side"
        ),
        time_step=step,
        drive_steps=Value(steps, "steps", "strain over rate over time step"),
        row_every=Value(row_every, "steps", f"{rows} rows of stresses over the strain"),
        frame_every=Value(
            ROWS_PER_FRAME * row_every,
            "steps",
            f"the axes of all grains every {ROWS_PER_FRAME} rows",
        ),
        skin=_skin(scene),
        stress_scale=Value(scene.stress_scale, "Pa", "rho d_v^2 rate^2"),
        pressure=Value(pressure, "Pa", f"to expect: {_expected_by(scene)}"),
        overlap_ratio=Value(overlap, "1", "to expect, over the least side: load and impact"),
        grain_steps=Value(cost, "1", "grains times steps, their growth left out"),
        core_hours=Value(
            cost / SPEED_HINT / 3600.0, "h", f"at {SPEED_HINT:.1e} grain-steps per second"
        ),
        warnings=tuple(_warnings(scene, step.value, overlap)),
    )


def least_side(scene: ShearScene) -> float:
    """The paper's l_c (m): the least diameter or length of any species."""
    return min(min(one.sides(scene.grains.diameter)) for one in scene.species)


def critical_time(scene: ShearScene) -> float:
    """The paper's eq. 13 (s) with the modulus of the contacts; G = E / (2 (1 + nu))."""
    grains = scene.grains
    modulus = scene.numerics.stiffness_factor * grains.youngs_modulus
    shear_modulus = modulus / (2.0 * (1.0 + grains.poisson_ratio))
    wave = 0.3262 * grains.poisson_ratio + 1.7532
    return pi * least_side(scene) / wave * sqrt(grains.density / shear_modulus)


def least_stiffness(scene: ShearScene) -> float:
    """k (N/m^1.5) in F = k overlap^1.5 of two grains of the slenderest species."""
    grains = scene.grains
    modulus = scene.numerics.stiffness_factor * grains.youngs_modulus
    radius = min(one.sides(grains.diameter)[0] for one in scene.species) / 2.0
    effective = hertz.effective_modulus(modulus, grains.poisson_ratio)
    return hertz.stiffness(effective, radius / 2.0)


def _expected_by(scene: ShearScene) -> str:
    return (
        "kinetic theory" if _is_gas(scene) else f"the paper's curve at an order of {MEAN_ALIGNMENT}"
    )


def _is_gas(scene: ShearScene) -> bool:
    """Whether kinetic theory is of these grains."""
    return scene.is_of_spheres and kinetic.holds(scene.solid_fraction, scene.grains.restitution)


def expected_pressure(scene: ShearScene) -> float:
    """Pressure (Pa) by the paper's curve, of the nearest solid fraction that it has.

    Of spheres that of kinetic theory where it holds.
    """
    if _is_gas(scene):
        there = kinetic.steady_shear(scene.solid_fraction, scene.grains.restitution)
        return scene.stress_scale * there.pressure
    least, most = liu.FRACTIONS
    found = liu.curve("pressure", min(max(scene.solid_fraction, least), most))
    assert found is not None
    return scene.stress_scale * float(found(np.array(MEAN_ALIGNMENT)))


def expected_overlap(scene: ShearScene) -> float:
    """Overlap over the least side: that of a force P d_v^2, and of a meeting at rate x length."""
    k, diameter = least_stiffness(scene), scene.grains.diameter
    static = hertz.static_overlap(expected_pressure(scene) * diameter**2, k)
    speed = scene.drive.shear_rate * scene.longest
    return (static + hertz.impact_overlap(k, scene.mass / 2.0, speed)) / least_side(scene)


def _time_step(scene: ShearScene) -> tuple[Value[float], int, int]:
    """The time step, shortened so that whole frames end at the strain; steps of a row, and rows."""
    chosen, critical = scene.numerics.time_step, critical_time(scene)
    if chosen is not None and chosen > STEP_BREAKS * critical:
        raise CaseError(
            "numerics.time_step",
            chosen,
            f"above {STEP_BREAKS:g} of the critical time, {critical:.3g} s, no contact is resolved",
            f"choose at most {at_most(STEP_BREAKS * critical)} s; "
            f"{STEP_FRACTION * critical:.3g} s is derived",
        )
    largest = STEP_FRACTION * critical if chosen is None else chosen
    duration, rows = scene.drive.strain / scene.drive.shear_rate, _rows(scene)
    every = scene.numerics.sample_every or ceil(duration / (rows * largest) * (1.0 - 1e-9))
    if scene.numerics.sample_every:
        frame = every * ROWS_PER_FRAME
        rows = ROWS_PER_FRAME * ceil(duration / (frame * largest) * (1.0 - 1e-9))
    if rows * every > MOST_STEPS:
        key, value = ("drive.strain", scene.drive.strain)
        if chosen is not None:
            key, value = ("numerics.time_step", chosen)
        raise CaseError(
            key,
            value,
            f"this takes {rows * every:.3g} steps of {largest:.3g} s",
            f"keep it under {MOST_STEPS:.0e} steps",
        )
    step = duration / (rows * every)
    reason = "set by hand" if chosen is not None else f"{STEP_FRACTION} critical times"
    return Value(step, "s", f"{reason}; less to end at the strain"), every, rows


def _rows(scene: ShearScene) -> int:
    """Rows of the series, whole frames of them."""
    wanted = min(max(ROWS_PER_STRAIN * scene.drive.strain, FEWEST_ROWS), MOST_ROWS)
    return ROWS_PER_FRAME * ceil(wanted / ROWS_PER_FRAME)


def _size_reason(scene: ShearScene) -> str:
    if scene.cell.count is None:
        return "as given"
    return f"a cube of {scene.cell.count} grains at the solid fraction"


def _skin(scene: ShearScene) -> Value[float]:
    chosen, diameter = scene.numerics.skin, scene.grains.diameter
    if chosen is None:
        return Value(SKIN * _mean_side(scene), "m", f"{SKIN} of the mean smaller side: fastest")
    if chosen > 2.0 * diameter:
        raise CaseError(
            "numerics.skin",
            chosen,
            "a neighbour skin wider than two grains only costs time",
            f"choose at most {at_most(2.0 * diameter)} m; "
            f"{SKIN * _mean_side(scene):.3g} m is derived",
        )
    return Value(chosen, "m", "set by hand")


def _mean_side(scene: ShearScene) -> float:
    """The smaller of diameter and length (m), in the mean over all grains."""
    smaller = [min(one.sides(scene.grains.diameter)) for one in scene.species]
    return float(np.average(smaller, weights=scene.counts))


def _warnings(scene: ShearScene, step: float, overlap: float) -> Iterator[str]:
    critical, factor = critical_time(scene), scene.numerics.stiffness_factor
    if step > STEP_BOUND * critical:
        yield (
            f"The time step set by hand, {step:.3g} s, is above {STEP_BOUND} of the critical time "
            f"({critical:.3g} s); the paper found the stress unchanged up to {STEP_FRACTION}."
        )
    if overlap > DEEP:
        yield (
            f"Soft grains: overlaps of {overlap:.2g} of the least side of a grain are to be "
            f"expected, above {DEEP}; raise numerics.stiffness_factor, {factor:g}."
        )
    if min(scene.sides) < 2.0 * scene.longest:
        yield (
            f"A small cell: its shortest side, {min(scene.sides):.3g} m, is under two of the "
            f"longest grains ({scene.longest:.3g} m), which may feel their own images."
        )
    dense = scene.solid_fraction > 0.999 * DENSE and not scene.is_of_spheres
    if dense and scene.grain_count < MANY:
        yield (
            f"Few grains: {scene.grain_count} lie in one order across the whole cell, and its "
            f"stress may be off by half; for numbers take {MANY} or more (cell.count)."
        )
