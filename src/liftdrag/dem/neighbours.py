"""Who may touch whom: Verlet lists from a cell grid, with the memory of their contacts.

A pair is listed once, under the part of the smaller index, when its bounding circles are nearer
than the skin. A few parts much larger than the others are compared with all, not put in cells.
"""

from __future__ import annotations

from math import sqrt
from typing import NamedTuple

import numpy as np

from liftdrag.dem.compiled import compiled
from liftdrag.dem.law import pair_numbers
from liftdrag.dem.shapes import Meetings

LARGE = 2.0
"""A part this many times larger than the mean is kept out of the cells."""


class Pairs(NamedTuple):
    """Neighbours of part i: `other[first[i]:first[i + 1]]`, and per pair what its contact is.

    `stretch` of the tangential spring (m), `memory` (m, 2) of the geometry, `spring` and
    `dashpot` of the law.
    """

    first: np.ndarray
    other: np.ndarray
    stretch: np.ndarray
    memory: np.ndarray
    spring: np.ndarray
    dashpot: np.ndarray


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


class WallPairs(NamedTuple):
    """Parts near a wall (0 left, 1 right, 2 bottom, 3 top), and per contact what it is."""

    part: np.ndarray
    wall: np.ndarray
    stretch: np.ndarray
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
    """Size of a cell, its grid, and the parts by cell: `start` of each cell in `order`."""
    bound = parts.bound
    n = len(bound)
    limit = LARGE * bound.mean()
    small, largest = 0, 0.0
    x0, y0, x1, y1 = 1e300, 1e300, -1e300, -1e300
    for i in range(n):
        if bound[i] <= limit:
            small += 1
            largest = max(largest, bound[i])
            x0, x1 = min(x0, place[i, 0]), max(x1, place[i, 0])
            y0, y1 = min(y0, place[i, 1]), max(y1, place[i, 1])
    size = max(2.0 * largest + skin, sqrt((x1 - x0) * (y1 - y0) / (4.0 * small + 16.0)))
    size = max(size, max(x1 - x0, y1 - y0) / (4.0 * small + 16.0))
    columns, rows = int((x1 - x0) / size) + 1, int((y1 - y0) / size) + 1
    cell = np.full(n, -1, np.int64)
    start = np.zeros(columns * rows + 1, np.int64)
    for i in range(n):
        if bound[i] <= limit:
            column, row = int((place[i, 0] - x0) / size), int((place[i, 1] - y0) / size)
            cell[i] = row * columns + column
            start[cell[i] + 1] += 1
    for c in range(columns * rows):
        start[c + 1] += start[c]
    filled = start[:-1].copy()
    order = np.empty(small, np.int64)
    for i in range(n):
        if cell[i] >= 0:
            order[filled[cell[i]]] = i
            filled[cell[i]] += 1
    return cell, start, order, columns, rows


@compiled()
def _recall(first, other, i, j):
    """Where a list has this pair, or -1."""
    for k in range(first[i], first[i + 1]):
        if other[k] == j:
            return k
    return -1


@compiled()
def _near(body, place, skin, i, j):
    reach = place[i, 2] + place[j, 2] + skin
    dx, dy = place[j, 0] - place[i, 0], place[j, 1] - place[i, 1]
    return dx * dx + dy * dy < reach * reach and body[i] != body[j]


@compiled()
def neighbours(parts, place, skin, law, old):
    """The pairs nearer than the skin (m), with the memory that `old` has of them.

    `place` (p, 3): x, y and the bounding radius. The memory of a new pair is not a number.
    """
    body = parts.body
    n = len(body)
    cell, start, order, columns, rows = _cells(parts, place, skin)
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
            row, column = divmod(cell[i], columns)
            for r in range(max(row - 1, 0), min(row + 2, rows)):
                low, high = max(column - 1, 0), min(column + 1, columns - 1)
                for m in range(start[r * columns + low], start[r * columns + high + 1]):
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
    stretch, memory = np.zeros(count), np.full((count, 2), np.nan)
    spring, dashpot = np.empty(count), np.empty(count)
    _, radius, mass, _ = parts
    old_first, old_other, old_stretch, old_memory, _, _ = old
    for i in range(len(first) - 1):
        for k in range(first[i], first[i + 1]):
            j = other[k]
            spring[k], dashpot[k] = pair_numbers(law, radius[i], radius[j], mass[i], mass[j])
            known = _recall(old_first, old_other, i, j)
            if known >= 0:
                stretch[k] = old_stretch[known]
                memory[k, 0], memory[k, 1] = old_memory[known, 0], old_memory[known, 1]
    return Pairs(first, other, stretch, memory, spring, dashpot)


@compiled()
def wall_neighbours(parts, place, skin, law, walls, old):
    """The parts nearer than half the skin to a wall, with the memory that `old` has of them.

    `walls` (4,): x of left and right, y of bottom and top, infinite where there is none.
    """
    bound, radius, mass, _ = parts
    n = len(bound)
    known = np.zeros((n, 4))
    for k in range(len(old.part)):
        known[old.part[k], old.wall[k]] = old.stretch[k]
    part, wall = np.empty(4 * n, np.int32), np.empty(4 * n, np.int32)
    count = 0
    for i in range(n):
        for w in range(4):
            room = walls[w] - place[i, w // 2]
            if w % 2 == 0:
                room = -room
            if room < bound[i] + 0.5 * skin and mass[i] < np.inf:
                part[count], wall[count] = i, w
                count += 1
    stretch, spring, dashpot = np.zeros(count), np.empty(count), np.empty(count)
    for k in range(count):
        i = part[k]
        stretch[k] = known[i, wall[k]]
        spring[k], dashpot[k] = pair_numbers(law, radius[i], 0.0, mass[i], np.inf)
    return WallPairs(part[:count].copy(), wall[:count].copy(), stretch, spring, dashpot)
