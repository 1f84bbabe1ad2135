"""Which cylinders may meet for a while: those with bounding spheres near, in a sheared box."""

from __future__ import annotations

from math import sqrt
from typing import NamedTuple

import numpy as np

from liftdrag.dem.compiled import compiled
from liftdrag.dem.cylinders.images import images
from liftdrag.dem.cylinders.kinds import APART


class Candidates(NamedTuple):
    """Pairs (m,), each once for each image, in the order of a grid so that near ones are together.

    Those from `first[p]` to `first[p + 1]` are of `grain[p]` and the `image` of an `other`;
    `normal` (m, 3) is a direction that may separate the pair, zero when none was tried, and
    `kind` the type of its contact.
    """

    grain: np.ndarray
    first: np.ndarray
    other: np.ndarray
    image: np.ndarray
    normal: np.ndarray
    kind: np.ndarray


@compiled()
def grid(place, size):
    """The grains by cell: `start` of each cell in `order`, and the shape of the grid."""
    n = len(place)
    spacing = (size[0] * size[1] * size[2] / n) ** (1.0 / 3.0)
    shape = np.empty(3, np.int64)
    for a in range(3):
        shape[a] = max(int(size[a] / spacing), 1)
    cell = np.empty(n, np.int64)
    start = np.zeros(shape[0] * shape[1] * shape[2] + 1, np.int64)
    for i in range(n):
        number = 0
        for a in range(2, -1, -1):
            number = number * shape[a] + cell_at(place[i, a], size[a], shape[a])
        cell[i] = number
        start[number + 1] += 1
    for k in range(len(start) - 1):
        start[k + 1] += start[k]
    filled, order = start[:-1].copy(), np.empty(n, np.int64)
    for i in range(n):
        order[filled[cell[i]]] = i
        filled[cell[i]] += 1
    return start, order, shape


@compiled(inline=True)
def cell_at(x, size, count):
    """The cell of a coordinate, the nearest of those outside."""
    return min(max(int(x / size * count), 0), count - 1)


@compiled(inline=True)
def reaches(at, size, away, p, m, far):
    """Whether the box is nearer than `far` (m) to a grain as an image sees it."""
    for a in range(3):
        x = at[p, a] - away[m, a]
        if x < -far or x > size[a] + far:
            return False
    return True


@compiled()
def beside(at, size, away, cells, p, far, skin, found):
    """List the grains after the p-th, each as an image `away` (4,), whose spheres are near.

    `at` (n, 4) is centre and radius of each sphere, in the order of the cells.
    """
    start, shape = cells
    x, y, z = at[p, 0] - away[0], at[p, 1] - away[1], at[p, 2] - away[2]
    count = 0
    left, right = cell_at(x - far, size[0], shape[0]), cell_at(x + far, size[0], shape[0])
    front, back = cell_at(y - far, size[1], shape[1]), cell_at(y + far, size[1], shape[1])
    bottom, top = cell_at(z - far, size[2], shape[2]), cell_at(z + far, size[2], shape[2])
    for layer in range(bottom, top + 1):
        for row in range(front, back + 1):
            line = (layer * shape[1] + row) * shape[0]
            for q in range(max(start[line + left], p + 1), start[line + right + 1]):
                dx, dy, dz = at[q, 0] - x, at[q, 1] - y, at[q, 2] - z
                reach = at[p, 3] + at[q, 3] + skin
                if dx * dx + dy * dy + dz * dz < reach * reach:
                    found[count] = q
                    count += 1
    return count


@compiled()
def largest_bound(place):
    """The radius (m) of the largest bounding sphere."""
    largest = 0.0
    for i in range(len(place)):
        largest = max(largest, place[i, 6] * place[i, 6] + place[i, 7] * place[i, 7])
    return sqrt(largest)


@compiled()
def spheres(place, order):
    """Centres and radii (n, 4) of the bounding spheres, in this order."""
    at = np.empty((len(order), 4))
    for p in range(len(order)):
        i = order[p]
        at[p, 0], at[p, 1], at[p, 2] = place[i, 0], place[i, 1], place[i, 2]
        at[p, 3] = sqrt(place[i, 6] * place[i, 6] + place[i, 7] * place[i, 7])
    return at


@compiled()
def more(room, values):
    """The values with this much room."""
    longer = np.empty(room, values.dtype)
    longer[: len(values)] = values
    return longer


@compiled()
def candidates(place, size, shear_rate, shift, skin):
    """The pairs whose bounding spheres are nearer than the skin (m) or overlap.

    All grains are in the box, whose sides are longer than any grain with the skin.
    """
    n, count = len(place), 0
    away = images(size, shear_rate, shift)
    start, order, shape = grid(place, size)
    at, largest, found = spheres(place, order), largest_bound(place), np.empty(n, np.int64)
    first, other, image = np.zeros(n + 1, np.int64), np.empty(n, np.int32), np.empty(n, np.int8)
    for p in range(n):
        far = at[p, 3] + largest + skin
        for m in range(len(away)):
            if not reaches(at, size, away, p, m, far):
                continue
            some = beside(at, size, away[m], (start, shape), p, far, skin, found)
            while count + some > len(other):
                other, image = more(2 * len(other), other), more(2 * len(other), image)
            for q in range(some):
                other[count + q], image[count + q] = order[found[q]], m
            count += some
        first[p + 1] = count
    normal, kind = np.zeros((count, 3)), np.empty(count, np.int8)
    kind[:] = APART
    return Candidates(order, first, other, image, normal, kind)
