"""Which cylinders may touch: Verlet lists from a grid of cells, in a box that is sheared."""

from __future__ import annotations

from math import sqrt
from typing import NamedTuple

import numpy as np

from liftdrag.dem.compiled import compiled
from liftdrag.dem.cylinders.forces import contact_of, overlap_along
from liftdrag.dem.cylinders.images import images
from liftdrag.dem.cylinders.kinds import APART
from liftdrag.dem.law import pair_numbers


class Pairs(NamedTuple):
    """Neighbours of grain i: `other[first[i]:first[i + 1]]`, each as one of its `image`s.

    `spring` and `dashpot` are of the law; `normal` (m, 3) is a direction that may separate the
    pair, and `kind` the type of its contact.
    """

    first: np.ndarray
    other: np.ndarray
    image: np.ndarray
    spring: np.ndarray
    dashpot: np.ndarray
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


@compiled()
def nearest_direction(place, i, j, dx, dy, dz, skin):
    """Whether a pair may be nearer than the skin, and the direction that separates it most.

    Of that from centre to centre, their axes, and the one that `meeting` finds, tried last.
    """
    best, bx, by, bz = 1e300, 1.0, 0.0, 0.0
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
        overlap = overlap_along(place, i, j, dx, dy, dz, nx, ny, nz)
        if overlap < best:
            best, bx, by, bz = overlap, nx, ny, nz
        if best <= -skin:
            return False, bx, by, bz
    return True, bx, by, bz


@compiled(inline=True)
def cells_between(low, high, size, count):
    """The first and last cell of a range of coordinates, the last less where it is outside."""
    if high < 0.0 or low > size:
        return 0, -1
    return cell_at(low, size, count), cell_at(high, size, count)


@compiled()
def candidates(place, bound, size, away, cells, i, skin, largest, found):
    """List the grains above i, each as an image `away` (4,), whose bounding spheres are near."""
    start, order, shape = cells
    x, y, z = place[i, 0] - away[0], place[i, 1] - away[1], place[i, 2] - away[2]
    far, count = bound[i] + largest + skin, 0
    bottom, top = cells_between(z - far, z + far, size[2], shape[2])
    front, back = cells_between(y - far, y + far, size[1], shape[1])
    left, right = cells_between(x - far, x + far, size[0], shape[0])
    if left > right:
        return 0
    for layer in range(bottom, top + 1):
        for row in range(front, back + 1):
            line = (layer * shape[1] + row) * shape[0]
            for q in range(start[line + left], start[line + right + 1]):
                j = order[q]
                dx, dy, dz = place[j, 0] - x, place[j, 1] - y, place[j, 2] - z
                reach = bound[i] + bound[j] + skin
                if j > i and dx * dx + dy * dy + dz * dz < reach * reach:
                    found[count] = j
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
def more(room, other, image, normal):
    """The list with this much room."""
    longer, images_of, normals = (
        np.empty(room, np.int32),
        np.empty(room, np.int8),
        np.empty((room, 3)),
    )
    for k in range(len(other)):
        longer[k], images_of[k] = other[k], image[k]
        for a in range(3):
            normals[k, a] = normal[k, a]
    return longer, images_of, normals


@compiled()
def neighbours(place, ease, size, shear_rate, shift, skin, law):
    """The pairs that are nearer than the skin (m) or overlap, each once for each image.

    All grains are in the box, whose sides are longer than any grain with the skin.
    """
    n = len(place)
    away, cells = images(size, shear_rate, shift), grid(place, size)
    bound, largest, found, count = np.empty(n), largest_bound(place), np.empty(n, np.int64), 0
    for i in range(n):
        bound[i] = sqrt(place[i, 6] ** 2 + place[i, 7] ** 2)
    first, other, image = np.zeros(n + 1, np.int64), np.empty(n, np.int32), np.empty(n, np.int8)
    normal = np.empty((n, 3))
    for i in range(n):
        for m in range(len(away)):
            for q in range(candidates(place, bound, size, away[m], cells, i, skin, largest, found)):
                j = found[q]
                dx = place[j, 0] + away[m, 0] - place[i, 0]
                dy = place[j, 1] + away[m, 1] - place[i, 1]
                dz = place[j, 2] + away[m, 2] - place[i, 2]
                near, nx, ny, nz = nearest_direction(place, i, j, dx, dy, dz, skin)
                if not near:
                    continue
                if count == len(other):
                    other, image, normal = more(2 * count, other, image, normal)
                other[count], image[count] = j, m
                normal[count, 0], normal[count, 1], normal[count, 2] = nx, ny, nz
                count += 1
        first[i + 1] = count
    return with_law(place, ease, law, first, other, image, normal)


@compiled()
def with_law(place, ease, law, first, other, image, normal):
    """The pairs with what the law says of each."""
    count = first[-1]
    spring, dashpot = np.empty(count), np.empty(count)
    for i in range(len(first) - 1):
        for k in range(first[i], first[i + 1]):
            j = other[k]
            spring[k], dashpot[k] = pair_numbers(
                law, place[i, 6], place[j, 6], 1.0 / ease[i, 0], 1.0 / ease[j, 0]
            )
    kind = np.empty(count, np.int8)
    kind[:] = APART
    return Pairs(first, other, image, spring, dashpot, normal, kind)
