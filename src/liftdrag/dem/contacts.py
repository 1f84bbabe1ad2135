"""A bed at one moment: where its parts touch, and the force on each body."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from liftdrag.dem.bed import Bed, arrays, pairs_of, wall_pairs_of
from liftdrag.dem.compiled import compiled
from liftdrag.dem.forces import near_pairs, pair_forces, room_for_meetings, wall_forces
from liftdrag.dem.law import Law
from liftdrag.dem.neighbours import neighbours, wall_neighbours
from liftdrag.dem.planar import Box
from liftdrag.dem.shapes import meet

CONCENTRIC = 1e-3
"""Distance of two centres, over the smaller semi-axis, below which no normal is defined."""


@dataclass(frozen=True)
class Contacts:
    """Parts in contact: `pair` (m, 2), `depth` (m,), `normal` (m, 2) from the first to the
    second, and `point` (m, 2) in the middle of the overlap; in m."""

    pair: np.ndarray
    depth: np.ndarray
    normal: np.ndarray
    point: np.ndarray


def contacts(bed: Bed, law: Law) -> Contacts:
    """The contacts between parts. Raises ValueError for parts that are nearly concentric."""
    shape, _, parts, scene = arrays(bed)
    pairs = neighbours(parts, scene.place, 0.0, law, pairs_of(bed))
    found, count = _met(shape, scene.place, scene.axis, pairs)
    one, other, depth = found.one[:count], found.other[:count], found.depth[:count]
    _refuse_concentric(bed, one, other)
    keep = depth > 0.0
    normal = np.column_stack([found.nx, found.ny])[:count][keep]
    across = found.across[:count][keep, None] * np.column_stack([-normal[:, 1], normal[:, 0]])
    point = bed.place[one[keep]] + found.along[:count][keep, None] * normal + across
    return Contacts(np.column_stack([one, other])[keep], depth[keep], normal, point)


@compiled()
def _met(shape, place, axis, pairs):
    meetings = room_for_meetings(pairs)
    end = near_pairs(shape, place, pairs, meetings, 0, len(place), 0)
    meet(shape, place, axis, pairs.memory, meetings, 0, end)
    return meetings, end


def _refuse_concentric(bed: Bed, one: np.ndarray, other: np.ndarray) -> None:
    distance = np.hypot(*(bed.place[other] - bed.place[one]).T)
    smaller = np.minimum(bed.semi_axes[one, 1], bed.semi_axes[other, 1])
    for k in np.flatnonzero(distance < CONCENTRIC * smaller)[:1]:
        raise ValueError(
            f"parts {one[k]} and {other[k]} are nearly concentric, {distance[k]:.3g} m apart: "
            "no normal is defined"
        )


def forces(bed: Bed, law: Law) -> np.ndarray:
    """Force (N) and torque (N m) on each body, (b, 3), the springs stretched as remembered.

    Raises ValueError for parts that are nearly concentric.
    """
    contacts(bed, law)
    shape, _, parts, scene = arrays(bed)
    pairs = neighbours(parts, scene.place, 0.0, law, pairs_of(bed))
    walls = Box(np.array(bed.walls))
    wall_pairs = wall_neighbours(parts, scene.place, 0.0, law, walls, wall_pairs_of(bed))
    on_parts = _summed(shape, scene, parts.radius, law, walls, pairs, wall_pairs)
    arm = bed.place - bed.position[bed.body]
    torque = on_parts[:, 2] + arm[:, 0] * on_parts[:, 1] - arm[:, 1] * on_parts[:, 0]
    total = np.zeros((len(bed.mass), 3))
    np.add.at(total, bed.body, np.column_stack([on_parts[:, :2], torque]))
    return total


@compiled()
def _summed(shape, scene, radius, law, walls, pairs, wall_pairs):
    n = len(radius)
    force, load = np.zeros((n, 3)), np.zeros(4)
    meetings = room_for_meetings(pairs)
    pair_forces(shape, scene, radius, law, 0.0, pairs, meetings, 0, n, force)
    count = len(wall_pairs.part)
    wall_forces(shape, scene, radius, law, 0.0, walls, wall_pairs, 0, count, force, load)
    return force
