"""A dense state of any mixture, grown: small cylinders fly about, meet, and swell meanwhile.

Their speed is kept while they grow, to a little more than their size; then their contacts damp
it, until they shrink to their size and none touches another.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from liftdrag.dem.cylinders.flow import Sample, shear
from liftdrag.dem.cylinders.state import Cell, Cylinders, volumes
from liftdrag.dem.cylinders.touching import touching
from liftdrag.dem.law import HertzMindlin, hertz_mindlin

SMALL = 0.25
"""Size over their own at which the grains are placed, at random."""

LARGEST, SMALLEST = 0.01, 5e-5
"""How much they grow in a stage, over their size: less when that heats them, and then more."""

WARM, HOT = 1.2, 4.0
"""Energy over what it was before a stage: when they grow too fast, and when they are stuck."""

CROWDED, ALIGNED = 0.53, 3.0
"""Solid fraction above which rods in no order jam; axes then lie about those of the flow, along it
and across its layers: by how much more than at random, in any direction."""

STAGE_STEPS = 40

REST_STAGES = 400
"""Stages, at most, until they can shrink; as many more from rest, where few meet to lose speed."""

SPARE = 0.004
"""By how much they outgrow their size, and the overlap, over an extent, that they lose again."""

GIVE = 0.03
"""Overlap of two that meet, over the smallest of their extents."""

PER_MEETING = 20
"""Time steps in the time for which they touch."""


MISFIT = "the grains do not fit into the box: they press on each other"


def grown(
    radius: np.ndarray,
    half_length: np.ndarray,
    mass: np.ndarray,
    size: np.ndarray,
    seed: int,
    threads: int = 1,
) -> Cylinders:
    """Cylinders of these radii, half lengths (m) and masses (kg) at rest in a box, none touching.

    Spheres where the half length is 0.
    `size` (3,) of the box in m; each argument is (n,) else. Raises ValueError where they do not
    fit.
    """
    cell = Cell(np.asarray(size, float))
    grains = swollen(
        sown(radius, half_length, cell.size, np.random.default_rng(seed)), cell, threads
    )
    for count in range(2 * REST_STAGES):
        if count == REST_STAGES:
            grains = still(grains)
        now = stage(grains, cell, 0.5, threads)
        grains, small = now.grains, scaled(now.grains, radius, half_length, 1.0)
        if now.overlap < SPARE and len(touching(small, cell).pair) == 0:
            inside = replace(small, position=small.position % cell.size)
            return replace(still(inside), mass=np.asarray(mass, float))
    raise ValueError(MISFIT)


def still(grains: Cylinders) -> Cylinders:
    """The grains at rest."""
    zero = np.zeros_like(grains.position)
    return replace(grains, velocity=zero, spin=zero.copy())


def swollen(grains: Cylinders, cell: Cell, threads: int) -> Cylinders:
    """The grains grown from SMALL to SPARE more than their size."""
    radius, half_length = grains.radius, grains.half_length
    scale, growth = SMALL, LARGEST
    while scale < 1.0 + SPARE:
        scale = min(scale + growth, 1.0 + SPARE)
        now = stage(scaled(grains, radius, half_length, scale), cell, 1.0, threads)
        heat = 2.0 * (now.translational + now.rotational + now.elastic) / len(radius)
        if growth <= SMALLEST and not heat < HOT:
            raise ValueError(MISFIT)
        growth = max(0.7 * growth, SMALLEST) if heat > WARM else min(1.1 * growth, LARGEST)
        grains = warmed(now.grains)
    return grains


def scaled(
    grains: Cylinders, radius: np.ndarray, half_length: np.ndarray, scale: float
) -> Cylinders:
    """The grains at another size, where they are."""
    return replace(grains, radius=scale * radius, half_length=scale * half_length)


def sown(
    radius: np.ndarray, half_length: np.ndarray, size: np.ndarray, rng: np.random.Generator
) -> Cylinders:
    """Cylinders of unit mass anywhere in a box, as fast as `warmed` makes them.

    With any axis, or in a crowd with axes about those of a flow.
    """
    n = len(radius)
    axis = rng.normal(size=(n, 3))
    if volumes(radius, half_length).sum() > CROWDED * np.prod(size):
        axis[np.arange(n), np.where(half_length > radius, 0, 1)] += ALIGNED
    axis /= np.linalg.norm(axis, axis=1)[:, None]
    axis[half_length == 0.0] = 0.0
    position = rng.uniform(size=(n, 3)) * size
    velocity, spin = rng.normal(size=(n, 3)), np.zeros((n, 3))
    return warmed(Cylinders(position, velocity, axis, spin, radius, half_length, np.ones(n)))


def warmed(grains: Cylinders) -> Cylinders:
    """The grains with their speeds scaled: one, squared, in the mean over all motions."""
    turning = (grains.spin * grains.angular_momentum).sum()
    speed = np.sqrt(((grains.velocity**2).sum() + turning) / len(grains.mass))
    return replace(grains, velocity=grains.velocity / speed, spin=grains.spin / speed)


def stage(grains: Cylinders, cell: Cell, restitution: float, threads: int) -> Sample:
    """The grains a few steps later, so soft that those of unit speed overlap by GIVE."""
    extent = float(grains.extent.min())
    give = GIVE * extent
    law = soft(give, float(grains.radius.mean()), restitution)
    run = shear(
        grains,
        cell,
        law,
        2.9432 * give / PER_MEETING,
        STAGE_STEPS,
        threads=threads,
        deepest=np.inf,
    )
    return next(run)


def soft(give: float, radius: float, restitution: float) -> HertzMindlin:
    """The law of grains of a radius (m), unit mass and speed that overlap by `give` (m)."""
    stiffness = 5.0 * 0.5 * 1.0 / (4.0 * give**2.5) / np.sqrt(0.5 * radius)
    return hertz_mindlin(1.5 * stiffness, 0.0, restitution, 0.0)
