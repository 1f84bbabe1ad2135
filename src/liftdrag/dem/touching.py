"""A column at one moment: its contacts and the forces in them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from liftdrag.dem.column import Column, arrays, pairs_of, wall_pairs_of
from liftdrag.dem.compiled import compiled
from liftdrag.dem.law import Law
from liftdrag.dem.neighbours import neighbours, wall_neighbours
from liftdrag.dem.spheres import pair_contact, wall_contact


@dataclass(frozen=True)
class Touching:
    """Contacts of `pair` (m, 2): two grains, or a grain and a wall (0 tube, 1 piston).

    `depth` (m,) in m; `normal` (m, 3) from the first grain to what it touches; `push` (m,)
    along it, positive in compression, and `pull` (m, 3) across it, on the first grain, in N.
    """

    pair: np.ndarray
    depth: np.ndarray
    normal: np.ndarray
    push: np.ndarray
    pull: np.ndarray


def touching(column: Column, law: Law) -> tuple[Touching, Touching]:
    """The contacts between grains and those with the walls, as the column remembers them."""
    _, _, parts, scene = arrays(column)
    pairs = neighbours(parts, scene.place, 0.0, law, pairs_of(column))
    at_walls = wall_neighbours(parts, scene.place, 0.0, law, column.walls, wall_pairs_of(column))
    between = _between(scene, parts.radius, law, pairs)
    walls = _with_walls(scene, parts.radius, law, column.walls, at_walls)
    return _contacts(*between), _contacts(*walls)


def _contacts(pair: np.ndarray, found: np.ndarray) -> Touching:
    met = found[:, 0] > 0.0
    found = found[met]
    return Touching(pair[met], found[:, 0], found[:, 1:4], found[:, 4], found[:, 5:8])


@compiled()
def _between(scene, radius, law, pairs):
    place, move, _ = scene
    count = len(pairs.other)
    pair, found = np.empty((count, 2), np.int64), np.empty((count, 8))
    for i in range(len(radius)):
        for k in range(pairs.first[i], pairs.first[i + 1]):
            j = pairs.other[k]
            pair[k, 0], pair[k, 1] = i, j
            contact = pair_contact(place, move, radius, law, k, i, j, pairs, 0.0)
            for c in range(8):
                found[k, c] = contact[c]
    return pair, found


@compiled()
def _with_walls(scene, radius, law, walls, pairs):
    place, move, _ = scene
    count = len(pairs.part)
    pair, found = np.empty((count, 2), np.int64), np.empty((count, 8))
    for k in range(count):
        i, w = pairs.part[k], pairs.wall[k]
        pair[k, 0], pair[k, 1] = i, w
        contact = wall_contact(place, move, radius, law, walls, k, i, w, pairs, 0.0)
        for c in range(8):
            found[k, c] = contact[c]
    return pair, found
