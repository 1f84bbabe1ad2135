"""Which cylinders may touch: those of the candidates that no direction tried holds apart."""

from __future__ import annotations

from math import sqrt
from typing import NamedTuple

import numpy as np

from liftdrag.dem.compiled import compiled
from liftdrag.dem.cylinders.forces import contact_of, overlap_along
from liftdrag.dem.cylinders.kinds import APART
from liftdrag.dem.law import pair_numbers


class Pairs(NamedTuple):
    """The near ones (m,) of the candidates, `source`, close together in memory.

    Those from `first[p]` to `last[p]` are of `grain[p]` and the `image` of an `other`. `spring`
    and `dashpot` are of the law; `normal` (m, 3) is a direction that may separate the pair, or
    that of its contact, and `kind` the type of this.
    """

    grain: np.ndarray
    first: np.ndarray
    last: np.ndarray
    source: np.ndarray
    other: np.ndarray
    image: np.ndarray
    spring: np.ndarray
    dashpot: np.ndarray
    normal: np.ndarray
    kind: np.ndarray


@compiled()
def no_pairs(possible):
    """Room for as many pairs as are possible, none of them near."""
    first, room = possible.first[:-1].copy(), len(possible.kind)
    return Pairs(
        possible.grain,
        first,
        first.copy(),
        np.empty(room, np.int32),
        np.empty(room, np.int32),
        np.empty(room, np.int8),
        np.empty(room),
        np.empty(room),
        np.empty((room, 3)),
        np.empty(room, np.int8),
    )


@compiled()
def give_back(possible, pairs, low, high):
    """Tell the candidates under the grains low to high what the pairs have found of them."""
    for p in range(low, high):
        for k in range(pairs.first[p], pairs.last[p]):
            c = pairs.source[k]
            possible.kind[c] = pairs.kind[k]
            for a in range(3):
                possible.normal[c, a] = pairs.normal[k, a]


@compiled()
def neighbours(place, ease, law, possible, pairs, away, skin, low, high):
    """List the candidates under the grains low to high nearer than the skin (m), or touching.

    The same grains each time. The images are `away` (IMAGES, 4). The direction that separated a
    pair last is tried first.
    """
    give_back(possible, pairs, low, high)
    grain, first, other, image, normal, kind = possible
    count = first[low]
    for p in range(low, high):
        i, pairs.first[p] = grain[p], count
        for c in range(first[p], first[p + 1]):
            j, m = other[c], image[c]
            dx = place[j, 0] + away[m, 0] - place[i, 0]
            dy = place[j, 1] + away[m, 1] - place[i, 1]
            dz = place[j, 2] + away[m, 2] - place[i, 2]
            nx, ny, nz = normal[c, 0], normal[c, 1], normal[c, 2]
            gap = -overlap_along(place, i, j, dx, dy, dz, nx, ny, nz)
            if gap < skin and kind[c] == APART:
                gap, nx, ny, nz = widest_gap(place, i, j, dx, dy, dz, gap, nx, ny, nz, skin)
                normal[c, 0], normal[c, 1], normal[c, 2] = nx, ny, nz
            if gap >= skin:
                continue
            pairs.source[count], pairs.kind[count] = c, kind[c]
            pairs.other[count], pairs.image[count] = j, m
            pairs.spring[count], pairs.dashpot[count] = pair_numbers(
                law, place[i, 6], place[j, 6], 1.0 / ease[i, 0], 1.0 / ease[j, 0]
            )
            pairs.normal[count, 0], pairs.normal[count, 1], pairs.normal[count, 2] = nx, ny, nz
            count += 1
        pairs.last[p] = count


@compiled()
def widest_gap(place, i, j, dx, dy, dz, gap, gx, gy, gz, skin):
    """The gap (m) between two cylinders in the direction in which it is widest, and this.

    Of the one known, that from centre to centre, their axes, and the one that `meeting` finds,
    until it is wider than the skin.
    """
    for trial in range(4):
        if trial == 0:
            nx, ny, nz = dx, dy, dz
        elif trial == 3:
            _, _, nx, ny, nz, _, _, _ = contact_of(place, i, j, dx, dy, dz)
        else:
            k = i if trial == 1 else j
            nx, ny, nz = place[k, 3], place[k, 4], place[k, 5]
        along, size = nx * dx + ny * dy + nz * dz, sqrt(nx * nx + ny * ny + nz * nz)
        if size == 0.0:
            continue
        scale = 1.0 / size if along >= 0.0 else -1.0 / size
        nx, ny, nz = nx * scale, ny * scale, nz * scale
        found = -overlap_along(place, i, j, dx, dy, dz, nx, ny, nz)
        if found > gap:
            gap, gx, gy, gz = found, nx, ny, nz
        if gap >= skin:
            break
    return gap, gx, gy, gz
