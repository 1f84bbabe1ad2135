"""Two-body tests with published values.

The impact tests 1 to 4 and 7 of Chung and Ooi, Benchmark tests for verifying discrete element
modelling codes at particle impact level, Granular Matter 13, 643 (2011).
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from liftdrag.engines.base import Engine
from liftdrag.engines.impact import Impact, Throw
from liftdrag.verify.check import Check
from liftdrag.verify.impact import STEP_FRACTION
from liftdrag.verify.material import ALUMINIUM, Material, closed_form, thrown

FINE_FRACTION = 0.0125
"""Time step over the Rayleigh time for restitutions, whose error is of first order in it."""

_SPHERES = (
    Material("limestone", 0.010, 20e9, 0.25, 2500.0, 10.0, 7108.0),
    Material("glass", 0.010, 48e9, 0.20, 2800.0, 10.0, 10697.0),
)
_ON_PLANE = (
    Material("magnesium", 0.1, 40e9, 0.35, 1800.0, 0.2, 7233.0),
    ALUMINIUM,
)
_ALUMINA = Material("alumina", 2.5e-3, 380e9, 0.23, 4000.0, 3.9)
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


def _elastic(
    engine: Engine, test: int, materials: tuple[Material, ...], rigid: bool
) -> Iterator[Check]:
    for material in materials:
        contact = material.contact(1.0, 0.0, rigid)
        (found,) = thrown(engine, material, contact, [Throw(material.speed)], STEP_FRACTION)
        force, overlap, duration = closed_form(material, rigid)
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
        (found,) = thrown(engine, _ALUMINA, contact, [Throw(_ALUMINA.speed)], FINE_FRACTION)
        got = found.normal_restitution
        yield Check(f"3 e = {asked}", "restitution", "1", got, asked, "asked", 5e-3)


def _oblique(engine: Engine) -> Iterator[Check]:
    restitution, friction = 0.98, 0.092
    contact = _ALUMINA.contact(restitution, friction, rigid=True)
    throws = [Throw(_ALUMINA.speed, float(angle)) for angle in _OBLIQUE]
    found = dict(
        zip(_OBLIQUE, thrown(engine, _ALUMINA, contact, throws, STEP_FRACTION), strict=True)
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
    contact = ALUMINIUM.contact(0.5, 0.4, rigid=False)
    throws = [Throw(ALUMINIUM.speed, spin=spin)]
    (found,) = thrown(engine, ALUMINIUM, contact, throws, STEP_FRACTION)
    ratio, name = found.spin / spin, "7 spinning spheres"
    yield Check(name, "spin after over before", "1", ratio, 1.0, "symmetry", 1e-6)
    got = found.tangential_velocity
    yield Check(name, "tangential velocity", "m/s", got, 0.0, "symmetry", 1e-9)
