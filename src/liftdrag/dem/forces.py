"""The loops over the pairs: from the places of the parts to the forces on them.

Each of several threads has a range of parts, whose pairs it goes through in order, and sums
into an array of its own: the same number of threads gives the same bits. What the parts are,
in `planar` or `spheres`, says how a meeting becomes a force.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from liftdrag.dem.compiled import compiled
from liftdrag.dem.shapes import Meetings


class Scene(NamedTuple):
    """Where the parts are: `place` (p, 4) x, y, z and bound; `move` (p, 3) velocity and spin in
    the plane, (p, 6) in space; `axis` (p, 2) direction of the long axis in the plane."""

    place: np.ndarray
    move: np.ndarray
    axis: np.ndarray


BLOCK = 256
"""Parts whose meetings are listed and used before those of the next: they stay in the cache."""


@compiled()
def room_for_meetings(pairs):
    """Meetings of as many pairs, not yet filled in."""
    m = len(pairs.other)
    index = np.int64
    return Meetings(
        np.empty(m, index),
        np.empty(m, index),
        np.empty(m, index),
        np.empty(m),
        np.empty(m),
        np.empty(m),
        np.empty(m),
        np.empty(m),
    )


def forget(shape: Any, stretch: Any, memory: Any, k: int) -> None:
    """Forget the contact of pair k, whose bounding spheres are apart."""
    raise NotImplementedError("this is compiled")


def met_forces(
    shape: Any,
    scene: Any,
    radius: Any,
    law: Any,
    time_step: float,
    pairs: Any,
    meetings: Any,
    begin: int,
    end: int,
    force: Any,
) -> Any:
    """Add forces and torques of the meetings from `begin` to `end` to `force`.

    Returns the elastic energy (J) and the largest depth over the smaller radius.
    """
    raise NotImplementedError("this is compiled")


def wall_forces(
    shape: Any,
    scene: Any,
    radius: Any,
    law: Any,
    time_step: float,
    walls: Any,
    pairs: Any,
    begin: int,
    end: int,
    force: Any,
    load: Any,
) -> Any:
    """Add forces of the wall pairs from `begin` to `end` to `force`, and to `load` (4,).

    Returns as above.
    """
    raise NotImplementedError("this is compiled")


@compiled()
def near_pairs(shape, place, pairs, meetings, low, high, begin):
    """List the meetings of the parts low to high from `begin` on; returns their end.

    The contacts of the other pairs are forgotten.
    """
    first, other, stretch, memory, _, _ = pairs
    pair, one, two = meetings.pair, meetings.one, meetings.other
    count = begin
    for i in range(low, high):
        x, y, z, bound = place[i, 0], place[i, 1], place[i, 2], place[i, 3]
        for k in range(first[i], first[i + 1]):
            j = other[k]
            dx, dy, dz = place[j, 0] - x, place[j, 1] - y, place[j, 2] - z
            reach = bound + place[j, 3]
            pair[count], one[count], two[count] = k, i, j
            if dx * dx + dy * dy + dz * dz < reach * reach:
                count += 1
            else:
                forget(shape, stretch, memory, k)
    return count


@compiled()
def pair_forces(shape, scene, radius, law, time_step, pairs, meetings, low, high, force):
    """Add the forces and torques of the pairs under the parts low to high to `force`.

    Returns the elastic energy (J) and the largest depth over the smaller radius.
    """
    energy, deepest = 0.0, 0.0
    begin = pairs.first[low]
    for block in range(low, high, BLOCK):
        stop = min(block + BLOCK, high)
        end = near_pairs(shape, scene.place, pairs, meetings, block, stop, begin)
        elastic, deep = met_forces(
            shape, scene, radius, law, time_step, pairs, meetings, begin, end, force
        )
        energy += elastic
        deepest = max(deepest, deep)
    return energy, deepest
