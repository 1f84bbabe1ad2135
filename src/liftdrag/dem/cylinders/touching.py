"""The contacts of cylinders at one moment."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from liftdrag.dem.compiled import compiled
from liftdrag.dem.cylinders.candidates import candidates
from liftdrag.dem.cylinders.flow import arrays
from liftdrag.dem.cylinders.forces import contact_of
from liftdrag.dem.cylinders.images import images, wrap
from liftdrag.dem.cylinders.state import Cell, Cylinders


@dataclass(frozen=True)
class Contacts:
    """Contacts of `pair` (m, 2), the first grain and an image of the second.

    `kind` (m,) as in KINDS; `depth` (m,) in m; `normal` (m, 3) from the first to the second;
    `point` and `way` (m, 3), from the centre of the first to the contact, which is half-way in
    the overlap, and to that of the second, in m.
    """

    pair: np.ndarray
    kind: np.ndarray
    depth: np.ndarray
    normal: np.ndarray
    point: np.ndarray
    way: np.ndarray


def touching(grains: Cylinders, cell: Cell) -> Contacts:
    """The contacts between the grains in a cell."""
    place, move, _ = arrays(grains)
    size = np.ascontiguousarray(cell.size, float)
    shift = wrap(place, move, size, 0.0, cell.shift)
    pairs = candidates(place, size, 0.0, shift, 0.0)
    one, other = np.repeat(pairs.grain, np.diff(pairs.first)), pairs.other[: pairs.first[-1]]
    away = images(size, 0.0, shift)[pairs.image[: len(other)], :3]
    way = place[other, :3] + away - place[one, :3]
    pair = np.column_stack([np.minimum(one, other), np.maximum(one, other)])
    return between(place, pair, np.where((one < other)[:, None], way, -way))


def between(place: np.ndarray, pair: np.ndarray, way: np.ndarray) -> Contacts:
    """The contacts of pairs (m, 2) that are these ways (m, 3) apart, of which some touch.

    `place` (n, 8): position, not used, axis, radius and half length.
    """
    kind, found = meetings(place, pair, way)
    met = found[:, 0] > 0.0
    found = found[met]
    return Contacts(pair[met], kind[met], found[:, 0], found[:, 1:4], found[:, 4:], way[met])


@compiled()
def meetings(place, pair, way):
    """Types (m,), and depths, normals and points (m, 7) of pairs, which may be apart."""
    kind, found = np.empty(len(pair), np.int64), np.empty((len(pair), 7))
    for k in range(len(pair)):
        depth, kind[k], nx, ny, nz, px, py, pz = contact_of(
            place, pair[k, 0], pair[k, 1], way[k, 0], way[k, 1], way[k, 2]
        )
        found[k, 0], found[k, 1], found[k, 2], found[k, 3] = depth, nx, ny, nz
        found[k, 4], found[k, 5], found[k, 6] = px, py, pz
    return kind, found
