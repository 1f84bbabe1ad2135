"""The initial bed of a closed box in the plane: grown at random, without pouring or gravity."""

from __future__ import annotations

from dataclasses import replace
from math import sqrt

import numpy as np

from liftdrag.dem import Bed, HertzMindlin, grown, hertz_mindlin
from liftdrag.errors import CaseError
from liftdrag.scene import Drag2DScene


def law_of(scene: Drag2DScene) -> HertzMindlin:
    """The contact law of the grains with each other, the walls and the cylinder."""
    grains = scene.grains
    return hertz_mindlin(
        grains.youngs_modulus, grains.poisson_ratio, grains.restitution, grains.friction
    )


GROWTH_STEP = 0.1
"""Time step of the growth over sqrt(m / (k sqrt(d))), the time scale of deeply squeezed grains."""

GROWTH_DAMPING = 0.02
"""Rate at which motion is slowed, over the same scale: what is slow comes to rest soonest."""


def packed(scene: Drag2DScene, run: int) -> Bed:
    """Packing number `run` at rest, the cylinder, its last body, about to move.

    All packings hold the same grains, in other places; what they weigh, how stiff they are and
    how ellipses touch in the pull makes no difference. Raises CaseError when they do not fit.
    """
    rng = np.random.default_rng([scene.seed, run])
    bed = _bed(scene, rng)
    try:
        scale = sqrt(scene.mass / (scene.grains.stiffness * sqrt(scene.grains.diameter)))
        bed = grown(
            bed,
            law_of(scene),
            GROWTH_STEP * scale,
            GROWTH_DAMPING / scale,
            int(rng.integers(2**31)),
        )
    except ValueError as error:
        raise CaseError(
            "box.solid_fraction",
            scene.box.solid_fraction,
            str(error),
            "lower it, or widen the box",
        ) from None
    return replace(bed, contact=scene.grains.contact if scene.grains.shape == "ellipse" else "disc")


def diameters(scene: Drag2DScene) -> np.ndarray:
    """Diameters (n,) of the discs of the grains' areas, uniform in equal steps, ascending."""
    grains = scene.grains
    place = (np.arange(grains.count) + 0.5) / grains.count
    return np.asarray(grains.diameter * (1.0 + grains.spread * (2.0 * place - 1.0)))


def _bed(scene: Drag2DScene, rng: np.random.Generator) -> Bed:
    """The grains in random order, not yet anywhere, and the cylinder at its start."""
    size = rng.permutation(diameters(scene))
    semi_axes, offset, body = _SHAPES[scene.grains.shape](scene, size)
    count = len(size)
    mass = scene.grains.density * scene.box.thickness * np.pi * size**2 / 4.0
    inertia = mass * _turning_square(semi_axes, offset, body)
    radius = scene.intruder.diameter / 2.0
    position = np.zeros((count + 1, 2))
    position[-1] = scene.box.width / 2.0, scene.intruder.start
    return Bed(
        position=position,
        velocity=np.vstack([np.zeros((count, 2)), [0.0, scene.drive.speed]]),
        angle=np.zeros(count + 1),
        spin=np.zeros(count + 1),
        mass=np.append(mass, np.inf),
        inertia=np.append(inertia, np.inf),
        semi_axes=np.vstack([semi_axes, [radius, radius]]),
        offset=np.vstack([offset, [0.0, 0.0]]),
        body=np.append(body, count),
        contact="common normal" if scene.grains.shape == "ellipse" else "disc",
        walls=(0.0, scene.box.width, 0.0, scene.height),
    )


def _turning_square(semi_axes: np.ndarray, offset: np.ndarray, body: np.ndarray) -> np.ndarray:
    """Square (n,) of the radius of gyration, m^2, of equal parts."""
    own = (semi_axes**2).sum(axis=1) / 4.0 + (offset**2).sum(axis=1)
    return np.asarray(np.bincount(body, own) / np.bincount(body))


def _discs(_scene: Drag2DScene, size: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    count = len(size)
    return np.column_stack([size, size]) / 2.0, np.zeros((count, 2)), np.arange(count)


def _dumbbells(_scene: Drag2DScene, size: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Two discs that touch at the centre, each of half the area."""
    radius = np.repeat(size / (2.0 * sqrt(2.0)), 2)
    side = np.tile([-1.0, 1.0], len(size))
    offset = np.column_stack([side * radius, np.zeros(2 * len(size))])
    return np.column_stack([radius, radius]), offset, np.repeat(np.arange(len(size)), 2)


def _ellipses(scene: Drag2DScene, size: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of area pi a b, 2 sqrt(a b) being the size (the paper's text has a factor misprinted)."""
    stretch = sqrt(scene.grains.aspect_ratio or 1.0)
    count = len(size)
    axes = np.column_stack([stretch * size, size / stretch]) / 2.0
    return axes, np.zeros((count, 2)), np.arange(count)


_SHAPES = {"disc": _discs, "dumbbell": _dumbbells, "ellipse": _ellipses}
