"""Beds and laws that the tests of the in-house engine share."""

from __future__ import annotations

from dataclasses import replace
from math import log, pi, sqrt
from typing import Any

import numpy as np

from liftdrag.dem import Bed, HertzMindlin
from liftdrag.dem.bed import NO_WALLS

MODULUS, POISSON = 1e4, 0.3
"""Young's modulus and Poisson's ratio of all grains here; lengths are of order one, density 1."""


def law_of(
    restitution: float = 1.0,
    friction: float = 0.0,
    reach: float = 0.0,
    tangential_damping: float = 1.0,
    modulus: float = MODULUS,
) -> HertzMindlin:
    """The law of these grains, its numbers from the formulas of Hertz, Mindlin and Tsuji."""
    effective = modulus / (2.0 * (1.0 - POISSON**2))
    lost = abs(log(restitution))
    return HertzMindlin(
        stiffness=4.0 / 3.0 * effective,
        tangential=3.0 * (1.0 - POISSON) / (2.0 - POISSON),
        damping=2.0 * sqrt(5.0 / 6.0) * lost / sqrt(pi**2 + lost**2),
        friction=friction,
        tangential_damping=tangential_damping,
        reach=reach,
    )


def grains(
    position: Any,
    semi_axes: Any = 1.0,
    velocity: Any = 0.0,
    angle: Any = 0.0,
    spin: Any = 0.0,
    contact: str = "disc",
    walls: tuple[float, float, float, float] = NO_WALLS,
) -> Bed:
    """One part to a body, of density 1; `semi_axes` a number, (b, 1) or (b, 2)."""
    position = np.array(position, float)
    count = len(position)
    axes = np.array(semi_axes * np.ones((count, 2)))
    mass = pi * axes.prod(axis=1)
    return Bed(
        position,
        np.array(velocity * np.ones((count, 2))),
        np.array(angle * np.ones(count)),
        np.array(spin * np.ones(count)),
        mass,
        0.25 * mass * (axes**2).sum(axis=1),
        axes,
        np.zeros((count, 2)),
        np.arange(count),
        contact,
        walls,
    )


def clumps(
    position: Any,
    offset: Any,
    radius: Any,
    velocity: Any = 0.0,
    angle: Any = 0.0,
    spin: Any = 0.0,
    walls: tuple[float, float, float, float] = NO_WALLS,
) -> Bed:
    """Bodies that are all the same clump of discs, of mass 1 and inertia 0.7 each."""
    bodies = grains(position, 1.0, velocity, angle, spin, "disc", walls)
    count, parts = len(bodies.mass), len(offset)
    return replace(
        bodies,
        mass=np.ones(count),
        inertia=np.full(count, 0.7),
        semi_axes=np.tile(np.column_stack([radius, radius]).astype(float), (count, 1)),
        offset=np.tile(np.array(offset, float), (count, 1)),
        body=np.repeat(np.arange(count), parts),
    )
