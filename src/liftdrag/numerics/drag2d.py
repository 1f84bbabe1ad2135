"""The numerics of drag in a closed bed, derived from its scene alone, each with its reason."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import ceil, sqrt

from liftdrag import hertz
from liftdrag.errors import CaseError, at_most
from liftdrag.numerics.value import Numerics, Value
from liftdrag.scene import Drag2DScene

STEP_FRACTION = 0.02
"""Time step over the Hertz time: the drag of c1 is that of a tenth of the step, within 1 %."""

SQUEEZED_FRACTION = 0.14
"""Time step over the squeezed time, sqrt(m / K) of the smallest grain in a deep contact."""

SQUEEZED_BOUND = 0.3
"""The same ratio above which a time step set by hand is warned about."""

SQUEEZED_BREAKS = 0.5
"""The largest such ratio at which c1's drag was right; from 0.6 on it is wrong without a sign."""

SQUEEZE = 0.1
"""Overlap over the diameter of such a contact, as before the cylinder."""

ROWS = 240
"""Rows of a series, over the whole displacement."""

FRAMES = 5
"""Snapshots of the bed, the first before and the last after the pull."""

SKIN = 0.15
"""Neighbour skin in grain diameters."""

GROWTH_STEPS = 15_000
"""Steps in which a packing grows and comes to rest, roughly."""

SPEED_HINT = 2e7
"""Grain-steps per second of discs on one core, for the estimate of the cost."""

MOST_STEPS = 100_000_000


@dataclass(frozen=True, kw_only=True)
class Drag2DNumerics(Numerics):
    """Every number that a deck of the closed bed needs and the scene does not say."""

    box_height: Value[float]
    rayleigh_time: Value[float]
    hertz_time: Value[float]
    squeezed_time: Value[float]
    time_step: Value[float]
    drive_steps: Value[int]
    row_every: Value[int]
    frame_every: Value[int]
    skin: Value[float]
    inertial_force: Value[float]
    grain_steps: Value[float]
    core_hours: Value[float]


def derive(scene: Drag2DScene) -> Drag2DNumerics:
    """The numerics of `scene`. Raises CaseError when they cannot be."""
    grains, box, speed = scene.grains, scene.box, scene.drive.speed
    impact = hertz.hertz_time(grains.stiffness, scene.mass / 2.0, speed)
    step, row_every = _time_step(scene, impact)
    steps = ROWS * row_every
    cost = float(grains.count * scene.ensemble.runs * (steps + GROWTH_STEPS))
    wave = hertz.rayleigh_time(
        grains.diameter, grains.density, grains.youngs_modulus, grains.poisson_ratio
    )
    inertia = grains.density * speed**2 * scene.intruder.diameter * box.thickness
    return Drag2DNumerics(
        box_height=Value(scene.height, "m", "the grains at the solid fraction, and the cylinder"),
        rayleigh_time=Value(wave, "s", "of a sphere; these grains are heavier, and slower"),
        hertz_time=Value(impact, "s", "an impact of two grains at the drive's speed"),
        squeezed_time=Value(
            _squeezed_time(scene), "s", f"sqrt(m/K) of the smallest grain, squeezed by {SQUEEZE} d"
        ),
        time_step=step,
        drive_steps=Value(steps, "steps", "distance over speed over time step"),
        row_every=Value(row_every, "steps", f"{ROWS} rows of forces over the displacement"),
        frame_every=Value(steps // (FRAMES - 1), "steps", f"{FRAMES} snapshots of the bed"),
        skin=_skin(scene),
        inertial_force=Value(inertia, "N", "rho v^2 D L, of grains pushed out of the way"),
        grain_steps=Value(cost, "1", "grains times steps times packings, their growth included"),
        core_hours=Value(
            cost / SPEED_HINT / 3600.0, "h", f"at {SPEED_HINT:.0e} grain-steps per second"
        ),
        warnings=tuple(_warnings(scene, step.value)),
    )


def _time_step(scene: Drag2DScene, impact: float) -> tuple[Value[float], int]:
    """The time step, shortened so that whole rows end at the distance, and the steps of a row."""
    chosen, squeezed = scene.numerics.time_step, _squeezed_time(scene)
    derived = min(STEP_FRACTION * impact, SQUEEZED_FRACTION * squeezed)
    if chosen is not None and chosen > SQUEEZED_BREAKS * squeezed:
        raise CaseError(
            "numerics.time_step",
            chosen,
            f"above {SQUEEZED_BREAKS} of the squeezed time, {squeezed:.3g} s, a pressurised bed "
            "was seen to give wrong forces without any other sign",
            f"choose at most {at_most(SQUEEZED_BREAKS * squeezed)} s; {derived:.3g} s is derived",
        )
    largest = derived if chosen is None else chosen
    duration = scene.drive.distance / scene.drive.speed
    row_every = ceil(duration / (ROWS * largest) * (1.0 - 1e-9))
    if ROWS * row_every > MOST_STEPS:
        key, value = "drive.distance", scene.drive.distance
        if chosen is not None:
            key, value = "numerics.time_step", chosen
        raise CaseError(
            key,
            value,
            f"this takes {ROWS * row_every:.3g} steps of {largest:.3g} s",
            f"keep it under {MOST_STEPS:.0e} steps",
        )
    step = duration / (ROWS * row_every)
    reason = f"the less of {STEP_FRACTION} Hertz and {SQUEEZED_FRACTION} squeezed times"
    reason = reason if chosen is None else "set by hand"
    return Value(step, "s", f"{reason}; less to end at the distance"), row_every


def _squeezed_time(scene: Drag2DScene) -> float:
    """sqrt(m / K) (s) of the smallest grain, K the stiffness of a contact squeezed by 0.1 d.

    What limits the step of a bed under pressure: unlike an impact, it has no speed.
    """
    stiffness = 1.5 * scene.grains.stiffness * sqrt(SQUEEZE * scene.grains.diameter)
    return sqrt(scene.mass * (1.0 - scene.grains.spread) ** 2 / stiffness)


def _skin(scene: Drag2DScene) -> Value[float]:
    chosen = scene.numerics.skin
    if chosen is None:
        return Value(
            SKIN * scene.grains.diameter, "m", f"{SKIN} d: from 0.1 to 0.6 d the time is the same"
        )
    if chosen > 2.0 * scene.grains.diameter:
        raise CaseError(
            "numerics.skin",
            chosen,
            "a neighbour skin wider than two grains only costs time",
            f"choose at most {at_most(2.0 * scene.grains.diameter)} m; {SKIN} d is derived",
        )
    return Value(chosen, "m", "set by hand")


def _warnings(scene: Drag2DScene, step: float) -> Iterator[str]:
    squeezed = _squeezed_time(scene)
    if step > SQUEEZED_BOUND * squeezed:
        yield (
            f"The time step set by hand, {step:.3g} s, is above {SQUEEZED_BOUND} of the squeezed "
            f"time ({squeezed:.3g} s); from {SQUEEZED_BREAKS} on the forces are wrong."
        )
    if scene.grains.contact == "paper":
        yield (
            'The contact "paper" does not keep the energy of elastic grains; it is here to be '
            "compared with."
        )
