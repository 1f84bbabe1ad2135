"""Two-body tests of an engine against closed forms and published values.

The impact tests are those of Chung and Ooi, Benchmark tests for verifying discrete element
modelling codes at particle impact level, Granular Matter 13, 643 (2011).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from math import isfinite
from pathlib import Path
from typing import Any, Literal

import numpy as np

from liftdrag import hertz
from liftdrag.deck.dialect import Contact
from liftdrag.engines import engine as engine_called
from liftdrag.engines.base import Engine
from liftdrag.engines.impact import Impact, Throw, impacts, stiffness_and_mass
from liftdrag.errors import InputError

STEP_FRACTION = 0.05
"""Time step over the Rayleigh time, unless given."""

FINE_FRACTION = 0.0125
"""The same for restitutions, whose error is of first order in the time step."""

FRACTIONS = (0.2, 0.1, 0.05, 0.025, 0.0125)
"""Time steps over the Rayleigh time at which the order of convergence shows."""


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
    values = {key: value for key, value in locals().items() if isinstance(value, float | int)}
    _check(values, partner)
    contact = Contact(
        youngs_modulus, poisson_ratio, restitution, friction, radius, rigid=partner == "plane"
    )
    rayleigh = hertz.rayleigh_time(2.0 * radius, density, youngs_modulus, poisson_ratio)
    chosen = engine_called(engine, None if engine_path is None else Path(engine_path))
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


def _check(values: dict[str, float], partner: str) -> None:
    for name, value in values.items():
        words, holds = _RANGES.get(name, ("finite", isfinite))
        if not (isfinite(value) and holds(value)):
            raise InputError(f"{name} = {value} is out of range; make it {words}.")
    if partner not in ("plane", "sphere"):
        raise InputError(f"partner = {partner!r} is neither 'plane' nor 'sphere'.")


@dataclass(frozen=True)
class Check:
    """A measured value beside the one that it should have.

    `bound` is the largest relative error allowed (absolute where 0 is expected), None for
    a value that is only reported.
    """

    test: str
    quantity: str
    unit: str
    measured: float
    expected: float
    source: str
    bound: float | None

    @property
    def error(self) -> float:
        """Relative to the expected value, where it is not zero."""
        return abs(self.measured - self.expected) / (abs(self.expected) or 1.0)

    @property
    def passed(self) -> bool:
        """Whether the error is within its bound, where there is one."""
        return self.bound is None or self.error <= self.bound

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        return asdict(self) | {"error": self.error, "passed": self.passed}


@dataclass(frozen=True)
class Convergence:
    """Relative errors of an elastic impact at time steps given over the Rayleigh time.

    `order` is the slope of the logarithm of the error over that of the time step.
    """

    quantity: str
    fractions: tuple[float, ...]
    errors: tuple[float, ...]

    @property
    def order(self) -> float:
        """Order of convergence in the time step."""
        return float(np.polyfit(np.log(self.fractions), np.log(self.errors), 1)[0])

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        return asdict(self) | {"order": self.order}


@dataclass(frozen=True)
class Verified:
    """What the tests of an engine found."""

    engine: str
    version: str
    checks: tuple[Check, ...]
    convergence: tuple[Convergence, ...]

    @property
    def passed(self) -> bool:
        """Whether every error is within its bound."""
        return all(check.passed for check in self.checks)

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "engine": self.engine,
            "version": self.version,
            "passed": self.passed,
            "checks": [check.to_dict() for check in self.checks],
            "convergence": [row.to_dict() for row in self.convergence],
        }


def verified(engine: Engine, tell: Callable[[str], None] = lambda _: None) -> Verified:
    """Run the tests on an engine; `tell` hears of each. Raises RunFailed when one cannot run."""
    found = []
    for check in checks(engine):
        tell(f"{check.test}: {check.quantity} {check.measured:.6g} {check.unit}")
        found.append(check)
    tell("order of convergence")
    rows = tuple(convergence(engine))
    return Verified(engine.name, engine.about().version, tuple(found), rows)


@dataclass(frozen=True)
class _Material:
    name: str
    radius: float
    youngs_modulus: float
    poisson_ratio: float
    density: float
    speed: float
    published: float = 0.0

    def contact(self, restitution: float, friction: float, rigid: bool) -> Contact:
        return Contact(
            self.youngs_modulus, self.poisson_ratio, restitution, friction, self.radius, rigid=rigid
        )

    @property
    def rayleigh_time(self) -> float:
        return hertz.rayleigh_time(
            2.0 * self.radius, self.density, self.youngs_modulus, self.poisson_ratio
        )


_SPHERES = (
    _Material("limestone", 0.010, 20e9, 0.25, 2500.0, 10.0, 7108.0),
    _Material("glass", 0.010, 48e9, 0.20, 2800.0, 10.0, 10697.0),
)
_ON_PLANE = (
    _Material("magnesium", 0.1, 40e9, 0.35, 1800.0, 0.2, 7233.0),
    _Material("aluminium", 0.1, 70e9, 0.30, 2699.0, 0.2, 11370.0),
)
_ALUMINA = _Material("alumina", 2.5e-3, 380e9, 0.23, 4000.0, 3.9)
_ALUMINIUM = _Material("aluminium", 0.1, 70e9, 0.30, 2699.0, 0.2)
_RESTITUTIONS = (0.2, 0.4, 0.6, 0.8, 1.0)
_OBLIQUE = {5: 0.9481, 10: 0.6870, 20: 0.6161, 40: 0.7809, 60: 0.8929, 80: 0.9662}
"""Tangential restitution by the angle in degrees, test 4."""
_SPINS = {10: -213.0, 20: -510.6, 40: -544.8, 60: -357.5, 80: -126.3}
"""Spin after the impact, rad/s, by the angle in degrees, test 4."""


def checks(engine: Engine) -> Iterator[Check]:
    """Tests 1 to 4 and 7 of Chung and Ooi, one after the other."""
    yield from _elastic(engine, 1, _SPHERES, rigid=False)
    yield from _elastic(engine, 2, _ON_PLANE, rigid=True)
    yield from _restitutions(engine)
    yield from _oblique(engine)
    yield from _spinning(engine)


def _thrown(
    engine: Engine, material: _Material, contact: Contact, throws: list[Throw], fraction: float
) -> list[Impact]:
    step = fraction * material.rayleigh_time
    wall: Literal["plane"] | None = "plane" if contact.rigid else None
    return impacts(engine, contact, material.density, throws, step, wall)


def _closed_form(material: _Material, rigid: bool) -> tuple[float, float, float]:
    """Peak force (N), peak overlap (m) and duration (s) of an elastic impact, by Hertz."""
    contact = material.contact(1.0, 0.0, rigid)
    k, mass = stiffness_and_mass(contact, material.density, "plane" if rigid else None)
    closing = material.speed * (1.0 if rigid else 2.0)
    overlap = hertz.impact_overlap(k, mass, closing)
    return k * overlap**1.5, overlap, hertz.hertz_time(k, mass, closing)


def _elastic(
    engine: Engine, test: int, materials: tuple[_Material, ...], rigid: bool
) -> Iterator[Check]:
    for material in materials:
        contact = material.contact(1.0, 0.0, rigid)
        (found,) = _thrown(engine, material, contact, [Throw(material.speed)], STEP_FRACTION)
        force, overlap, duration = _closed_form(material, rigid)
        name = f"{test} {material.name}"
        yield Check(name, "peak force", "N", found.peak_force, force, "Hertz", 1e-3)
        yield Check(
            name, "peak force", "N", found.peak_force, material.published, "published", 1e-3
        )
        yield Check(name, "peak overlap", "m", found.peak_overlap, overlap, "Hertz", 1e-3)
        yield Check(name, "duration", "s", found.duration, duration, "Hertz", 5e-3)


def _restitutions(engine: Engine) -> Iterator[Check]:
    for asked in _RESTITUTIONS:
        contact = _ALUMINA.contact(asked, 0.0, rigid=True)
        (found,) = _thrown(engine, _ALUMINA, contact, [Throw(_ALUMINA.speed)], FINE_FRACTION)
        got = found.normal_restitution
        yield Check(f"3 e = {asked}", "restitution", "1", got, asked, "asked", 5e-3)


def _oblique(engine: Engine) -> Iterator[Check]:
    restitution, friction = 0.98, 0.092
    contact = _ALUMINA.contact(restitution, friction, rigid=True)
    throws = [Throw(_ALUMINA.speed, float(angle)) for angle in _OBLIQUE]
    found = dict(
        zip(_OBLIQUE, _thrown(engine, _ALUMINA, contact, throws, STEP_FRACTION), strict=True)
    )
    for angle, published in _OBLIQUE.items():
        got, name = found[angle].tangential_restitution, f"4 at {angle} degrees"
        yield Check(name, "tangential restitution", "1", got, published, "published", 0.025)
        slope = np.tan(np.radians(angle))
        if slope > 3.5 * friction * (1.0 + restitution):
            slid = float(1.0 - friction * (1.0 + restitution) / slope)
            yield Check(name, "tangential restitution", "1", got, slid, "gross sliding", 5e-3)
    for throw, (angle, result) in zip(throws, found.items(), strict=True):
        name, arm = f"4 at {angle} degrees", 1e-3 + result.peak_overlap / _ALUMINA.radius
        turned = _turned(throw, result)
        yield Check(name, "spin", "rad/s", result.spin, turned, "angular momentum", arm)
        if angle in _SPINS:
            yield Check(name, "spin", "rad/s", result.spin, _SPINS[angle], "published", None)


def _turned(throw: Throw, found: Impact) -> float:
    """The spin (rad/s) that goes with the loss of tangential velocity: 5 (v' - v) / (2 R).

    The arm is R; an engine may take off the overlap.
    """
    before = throw.speed * float(np.sin(np.radians(throw.angle)))
    return 2.5 * (found.tangential_velocity - before) / _ALUMINA.radius


def _spinning(engine: Engine) -> Iterator[Check]:
    spin = 10.0
    contact = _ALUMINIUM.contact(0.5, 0.4, rigid=False)
    throws = [Throw(_ALUMINIUM.speed, spin=spin)]
    (found,) = _thrown(engine, _ALUMINIUM, contact, throws, STEP_FRACTION)
    ratio, name = found.spin / spin, "7 spinning spheres"
    yield Check(name, "spin after over before", "1", ratio, 1.0, "symmetry", 1e-6)
    got = found.tangential_velocity
    yield Check(name, "tangential velocity", "m/s", got, 0.0, "symmetry", 1e-9)


def convergence(engine: Engine) -> list[Convergence]:
    """Errors of test 2's aluminium against Hertz's closed form, over the time step."""
    force, overlap, duration = _closed_form(_ALUMINIUM, rigid=True)
    contact = _ALUMINIUM.contact(1.0, 0.0, rigid=True)
    errors: dict[str, list[float]] = {"peak force": [], "peak overlap": [], "duration": []}
    for fraction in FRACTIONS:
        (found,) = _thrown(engine, _ALUMINIUM, contact, [Throw(_ALUMINIUM.speed)], fraction)
        errors["peak force"].append(abs(found.peak_force / force - 1.0))
        errors["peak overlap"].append(abs(found.peak_overlap / overlap - 1.0))
        errors["duration"].append(abs(found.duration / duration - 1.0))
    return [Convergence(name, FRACTIONS, tuple(values)) for name, values in errors.items()]
