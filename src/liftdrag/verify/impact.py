"""One impact of two bodies, as an engine computes it."""

from __future__ import annotations

from collections.abc import Callable
from math import isfinite
from numbers import Real
from pathlib import Path
from typing import Literal

from liftdrag import hertz
from liftdrag.deck.dialect import Contact
from liftdrag.engines import spatial
from liftdrag.engines.impact import Impact, Throw, impacts
from liftdrag.errors import InputError

STEP_FRACTION = 0.05
"""Time step over the Rayleigh time, unless given."""


def impact(
    engine: str = "lammps",
    *,
    radius: float,
    youngs_modulus: float,
    poisson_ratio: float,
    density: float,
    restitution: float = 1.0,
    friction: float = 0.0,
    speed: float,
    angle: float = 0.0,
    spin: float = 0.0,
    partner: Literal["plane", "sphere"] = "plane",
    time_step: float | None = None,
    engine_path: str | Path | None = None,
) -> Impact:
    """The impact of a sphere on a rigid plane, or on an equal sphere, as an engine computes it.

    Args:
        engine: lammps, lmp or liggghts; `engine_path` the program, when not on the PATH.
        radius: m.
        youngs_modulus: Pa, of the spheres.
        poisson_ratio: from 0 to 0.5.
        density: kg/m^3.
        restitution: normal, above 0 up to 1, the same at any speed.
        friction: Coulomb's coefficient.
        speed: m/s; an equal sphere comes with the opposite velocity.
        angle: of the velocity to the normal, degrees, from 0 to under 90.
        spin: rad/s about tangent x normal (forward rolling is negative); an equal sphere
            comes with the opposite spin.
        partner: "plane" or "sphere".
        time_step: s; by default 0.05 Rayleigh times.

    Raises InputError for a value out of range or an engine that is missing, RunFailed when
    the engine fails.
    """
    _check(
        partner,
        radius=radius,
        youngs_modulus=youngs_modulus,
        poisson_ratio=poisson_ratio,
        density=density,
        restitution=restitution,
        friction=friction,
        speed=speed,
        angle=angle,
        spin=spin,
        time_step=time_step,
    )
    contact = Contact(
        youngs_modulus, poisson_ratio, restitution, friction, radius, rigid=partner == "plane"
    )
    rayleigh = hertz.rayleigh_time(2.0 * radius, density, youngs_modulus, poisson_ratio)
    chosen = spatial(engine, None if engine_path is None else Path(engine_path))
    (found,) = impacts(
        chosen,
        contact,
        density,
        [Throw(speed, angle, spin)],
        time_step or STEP_FRACTION * rayleigh,
        "plane" if partner == "plane" else None,
    )
    return found


_RANGES: dict[str, tuple[str, Callable[[float], bool]]] = {
    "radius": ("above 0", lambda x: x > 0.0),
    "youngs_modulus": ("above 0", lambda x: x > 0.0),
    "poisson_ratio": ("from 0 to under 0.5", lambda x: 0.0 <= x < 0.5),
    "density": ("above 0", lambda x: x > 0.0),
    "restitution": ("above 0, at most 1", lambda x: 0.0 < x <= 1.0),
    "friction": ("at least 0", lambda x: x >= 0.0),
    "speed": ("above 0", lambda x: x > 0.0),
    "angle": ("from 0 to under 90 degrees", lambda x: 0.0 <= x < 90.0),
    "time_step": ("above 0", lambda x: x > 0.0),
}


def _check(partner: str, time_step: float | None, **values: float) -> None:
    given: dict[str, object] = dict(values)
    if time_step is not None:
        given["time_step"] = time_step
    for name, value in given.items():
        words, holds = _RANGES.get(name, ("finite", isfinite))
        if not (isinstance(value, Real) and isfinite(value) and holds(float(value))):
            raise InputError(f"{name} = {value} is out of range; make it {words}.")
    if partner not in ("plane", "sphere"):
        raise InputError(f"partner = {partner!r} is neither 'plane' nor 'sphere'.")
