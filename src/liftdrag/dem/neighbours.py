"""Who may touch whom: Verlet lists from a cell grid, with the memory of their contacts.

A pair is listed once, under the part of the smaller index, when its bounding spheres are nearer
than the skin. A few parts much larger than the others are compared with all, not put in cells.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from liftdrag.dem.compiled import compiled
from liftdrag.dem.law import pair_numbers

LARGE = 2.0
"""A part this many times larger than the mean is kept out of the cells."""

MOST_CELLS = 4
"""Cells there are at most, for each part."""


class Pairs(NamedTuple):
    """Neighbours of part i: `other[first[i]:first[i + 1]]`, and per pair what its contact is.

    `stretch` (m, 1 or 3) of the tangential spring (m; of a latching one its force, N), `memory`
    (m, 2 or 3) of the geometry or the law, `spring` and `dashpot` of the law.
    """

    first: np.ndarray
    other: np.ndarray
    stretch: np.ndarray
    memory: np.ndarray
    spring: np.ndarray
    dashpot: np.ndarray


class WallPairs(NamedTuple):
    """Parts near a wall, in order of the parts, and per contact what it is, as in `Pairs`.

    In the plane the walls are 0 left, 1 right, 2 bottom, 3 top; in a tube 0 tube, 1 piston.
    """

    part: np.ndarray
    wall: np.ndarray
    stretch: np.ndarray
    memory: np.ndarray
    spring: np.ndarray
    dashpot: np.ndarray


class Parts(NamedTuple):
    """What of the parts does not change: `bound` and `radius` (m), `mass` and `body`.

    Parts of one body do not touch, and all driven bodies count as one, -1.
    """

    bound: np.ndarray
    radius: np.ndarray
    mass: np.ndarray
    body: np.ndarray


@compiled()
def _cells(parts, place, skin):
    """The parts by cell, `start` of each cell in `order`, and the shape of the grid."""
    bound = parts.bound
    n = len(bound)
    limit = LARGE * bound.mean()
    small, largest = 0, 0.0
    low, high = np.full(3, 1e300), np.full(3, -1e300)
    for i in range(n):
        if bound[i] <= limit:
            small += 1
            largest = max(largest, bound[i])
            for a in range(3):
                low[a], high[a] = min(low[a], place[i, a]), max(high[a], place[i, a])
    size = 2.0 * largest + skin
    most = MOST_CELLS * small + 16
    shape = np.ones(3, np.int64)
    while True:
        cells = 1.0
        for a in range(3):
            cells *= max((high[a] - low[a]) / size, 0.0) + 1.0
        if cells <= most:
            break
        size *= 1.2
    for a in range(3):
        shape[a] = int(max(high[a] - low[a], 0.0) / size) + 1
    cell = np.full(n, -1, np.int64)
    start = np.zeros(shape.prod() + 1, np.int64)
    for i in range(n):
        if bound[i] <= limit:
            number = 0
            for a in range(2, -1, -1):
                number = number * shape[a] + int((place[i, a] - low[a]) / size)
            cell[i] = number
            start[number + 1] += 1
    for c in range(len(start) - 1):
        start[c + 1] += start[c]
    filled = start[:-1].copy()
    order = np.empty(small, np.int64)
    for i in range(n):
        if cell[i] >= 0:
            order[filled[cell[i]]] = i
            filled[cell[i]] += 1
    return cell, start, order, shape


@compiled()
def _recall(first, other, i, j):
    """Where a list has this pair, or -1."""
    for k in range(first[i], first[i + 1]):
        if other[k] == j:
            return k
    return -1


@compiled()
def _near(body, place, skin, i, j):
    reach = place[i, 3] + place[j, 3] + skin
    dx, dy, dz = place[j, 0] - place[i, 0], place[j, 1] - place[i, 1], place[j, 2] - place[i, 2]
    return dx * dx + dy * dy + dz * dz < reach * reach and body[i] != body[j]


@compiled()
def neighbours(parts, place, skin, law, old):
    """The pairs nearer than the skin (m), with the memory that `old` has of them.

    `place` (p, 4): x, y, z and the bounding radius; z is zero in the plane. The memory of a new
    pair in the plane is not a number, in space it is zero.
    """
    body = parts.body
    n = len(body)
    cell, start, order, shape = _cells(parts, place, skin)
    columns, rows, layers = shape[0], shape[1], shape[2]
    large = np.flatnonzero(cell < 0)
    first = np.zeros(n + 1, np.int64)
    other = np.empty(8 * n + 64, np.int32)
    count = 0
    for i in range(n):
        if count + n > len(other):
            other = np.concatenate((other, np.empty(len(other) + n, np.int32)))
        if cell[i] < 0:
            for j in range(i + 1, n):
                if _near(body, place, skin, i, j):
                    other[count] = j
                    count += 1
        else:
            above, column = divmod(cell[i], columns)
            layer, row = divmod(above, rows)
            left, right = max(column - 1, 0), min(column + 1, columns - 1)
            for z in range(max(layer - 1, 0), min(layer + 2, layers)):
                for y in range(max(row - 1, 0), min(row + 2, rows)):
                    line = (z * rows + y) * columns
                    for m in range(start[line + left], start[line + right + 1]):
                        j = order[m]
                        if j > i and _near(body, place, skin, i, j):
                            other[count] = j
                            count += 1
            for m in range(len(large)):
                j = large[m]
                if j > i and _near(body, place, skin, i, j):
                    other[count] = j
                    count += 1
        first[i + 1] = count
    return _remembered(parts, law, old, first, other[:count].copy())


@compiled()
def _remembered(parts, law, old, first, other):
    count = len(other)
    _, radius, mass, _ = parts
    old_first, old_other, old_stretch, old_memory, _, _ = old
    width, depth = old_stretch.shape[1], old_memory.shape[1]
    stretch = np.zeros((count, width))
    memory = np.full((count, depth), np.nan if width == 1 else 0.0)
    spring, dashpot = np.empty(count), np.empty(count)
    for i in range(len(first) - 1):
        for k in range(first[i], first[i + 1]):
            j = other[k]
            spring[k], dashpot[k] = pair_numbers(law, radius[i], radius[j], mass[i], mass[j])
            known = _recall(old_first, old_other, i, j)
            if known >= 0:
                for c in range(width):
                    stretch[k, c] = old_stretch[known, c]
                for c in range(depth):
                    memory[k, c] = old_memory[known, c]
    return Pairs(first, other, stretch, memory, spring, dashpot)


def near_walls(parts: Any, place: Any, skin: float, law: Any, walls: Any, old: Any) -> Any:
    """As `wall_neighbours`; what the walls are chooses the function."""
    raise NotImplementedError("this is compiled")


@compiled()
def wall_neighbours(parts, place, skin, law, walls, old):
    """The parts nearer than half the skin to a wall, with the memory that `old` has of them."""
    return near_walls(parts, place, skin, law, walls, old)


@compiled()
def remembered_walls(parts, law, part, wall, old, walls):
    """Wall pairs of these parts and walls, `walls` of them in all, with what `old` knows."""
    _, radius, mass, _ = parts
    width, depth, count = old.stretch.shape[1], old.memory.shape[1], len(part)
    known = np.full((len(radius), walls), -1, np.int64)
    for k in range(len(old.part)):
        known[old.part[k], old.wall[k]] = k
    stretch, memory = np.zeros((count, width)), np.zeros((count, depth))
    spring, dashpot = np.empty(count), np.empty(count)
    for k in range(count):
        i = part[k]
        spring[k], dashpot[k] = pair_numbers(law, radius[i], 0.0, mass[i], np.inf)
        before = known[i, wall[k]]
        if before >= 0:
            for c in range(width):
                stretch[k, c] = old.stretch[before, c]
            for c in range(depth):
                memory[k, c] = old.memory[before, c]
    return WallPairs(part, wall, stretch, memory, spring, dashpot)
