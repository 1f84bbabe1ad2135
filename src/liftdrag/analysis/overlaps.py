"""How deep grains are in each other and in the cylinder, from where they are at one time."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from liftdrag.dem import Bed
from liftdrag.scene import TankScene
from liftdrag.snapshot import Snapshot

GRAINS = 1
"""Type of the grains of a tank; those of another type move as one, and do not touch their like."""


def deepest_in_tank(scene: TankScene, snapshot: Snapshot) -> float:
    """The largest overlap (m) of grains, periodic in x and y, or of a grain and the cylinder."""
    d, kind, place = scene.grains.diameter, snapshot.kind, snapshot.position.copy()
    sides = np.array([scene.tank.length, scene.tank.thickness])
    place[:, :2] = _within(place[:, :2], sides)
    tree = cKDTree(place, boxsize=np.append(sides, 0.0))
    one, other = tree.query_pairs(d, output_type="ndarray").T
    apart = np.abs(place[one] - place[other])
    apart[:, :2] = np.minimum(apart[:, :2], sides - apart[:, :2])
    meets = (kind[one] != kind[other]) | (kind[one] == GRAINS)
    between = d - np.linalg.norm(apart[meets], axis=1)
    x, _, z = place[kind == GRAINS].T
    from_axis = np.hypot(x - scene.axis_x, z - scene.axis_height)
    inside = (d + scene.intruder.diameter) / 2.0 - from_axis
    return float(max(between.max(initial=0.0), inside.max(initial=0.0)))


def _within(place: np.ndarray, sides: np.ndarray) -> np.ndarray:
    """Places in [0, side) of each direction; the rounding of a remainder may give the side."""
    folded = place % sides
    return np.where(folded < sides, folded, 0.0)


def deepest_in_plane(bed: Bed, snapshot: Snapshot) -> float:
    """The largest overlap of discs of different bodies over the radius of the smaller.

    `snapshot` has the parts of the bed in its order. Raises ValueError for ellipses.
    """
    if bed.contact != "disc":
        raise ValueError("the overlap of ellipses is not that of discs")
    place, radius = snapshot.position[:, :2], bed.radius
    pairs = cKDTree(place).query_pairs(2.0 * np.sort(radius)[:-1].max(), output_type="ndarray")
    wide = int(radius.argmax())
    rest = np.delete(np.arange(len(radius)), wide)
    pairs = np.concatenate([pairs, np.column_stack([rest, np.full(len(rest), wide)])])
    one, other = pairs[bed.body[pairs[:, 0]] != bed.body[pairs[:, 1]]].T
    depth = radius[one] + radius[other] - np.linalg.norm(place[one] - place[other], axis=1)
    return float((depth / np.minimum(radius[one], radius[other])).max(initial=0.0))
