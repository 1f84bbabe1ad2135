"""What the grains are made of, and where they touch.

A shape is a named tuple of arrays over the parts; its type chooses the functions below when the
loops are compiled, so that each shape has loops of its own from one text.
"""

from __future__ import annotations

from math import isnan, sqrt
from typing import Any, NamedTuple

import numpy as np
from numba.extending import overload

from liftdrag.dem.ellipse import SURE, common_normal, facing, gap, paper_contact, support


class Discs(NamedTuple):
    """Discs of `radius` (p,), m."""

    radius: np.ndarray


class Ellipses(NamedTuple):
    """Ellipses of semi-axes `a` >= `b` (p,), m, in contact by their common normal.

    `tip` is b^2/a, the least radius of curvature.
    """

    a: np.ndarray
    b: np.ndarray
    tip: np.ndarray


class PaperEllipses(NamedTuple):
    """Ellipses of semi-axes `a` >= `b` (p,), m, in contact as Zhou et al. read it."""

    a: np.ndarray
    b: np.ndarray


Shape = Discs | Ellipses | PaperEllipses


class Meetings(NamedTuple):
    """The pairs whose bounding circles overlap, and where their parts touch.

    `pair` (m,) is the place in the neighbour list, `one` and `other` (m,) the parts.
    `depth` (m,), not positive where they are apart; normal `nx`, `ny` from one to the other;
    the contact point from the centre of the first, `along` and `across` the normal; all in m.
    """

    pair: np.ndarray
    one: np.ndarray
    other: np.ndarray
    depth: np.ndarray
    nx: np.ndarray
    ny: np.ndarray
    along: np.ndarray
    across: np.ndarray


def meet(
    shape: Shape, place: Any, axis: Any, memory: Any, meetings: Meetings, low: int, high: int
) -> None:
    """Fill in the meetings low to high: where the parts at `place` (p, 3) touch.

    `axis` (p, 2) are the directions of the long axes. `memory` (n, 2) is where the search of
    each pair of the list starts and what it finds, not a number when nothing is known.
    """
    raise NotImplementedError("this is compiled")


def wall_touch(shape: Shape, i: int, room: float, nx: float, ny: float, axis: Any) -> Any:
    """Depth of part i in a wall at a distance `room` along n, the contact point as above."""
    raise NotImplementedError("this is compiled")


@overload(meet)
def _meet(shape, place, axis, memory, meetings, low, high):
    return {Discs: _discs, Ellipses: _ellipses, PaperEllipses: _paper}[shape.instance_class]


@overload(wall_touch, inline="always")
def _wall_touch(shape, i, room, nx, ny, axis):
    return _disc_wall if shape.instance_class is Discs else _ellipse_wall


def _discs(shape, place, axis, memory, meetings, low, high):
    radius = shape.radius
    _, one, other, depth, nx, ny, along, across = meetings
    for m in range(low, high):
        i, j = one[m], other[m]
        dx, dy = place[j, 0] - place[i, 0], place[j, 1] - place[i, 1]
        distance = sqrt(dx * dx + dy * dy)
        scale = 1.0 / distance
        deep = radius[i] + radius[j] - distance
        depth[m], nx[m], ny[m] = deep, dx * scale, dy * scale
        along[m], across[m] = radius[i] - 0.5 * deep, 0.0


def _ellipses(shape, place, axis, memory, meetings, low, high):
    """One Newton step from the last answer for all; those it does not settle search on."""
    a, b, tip = shape
    pair, one, other, depth, nx, ny, along, across = meetings
    for m in range(low, high):
        i, j = one[m], other[m]
        dx, dy = place[j, 0] - place[i, 0], place[j, 1] - place[i, 1]
        k = pair[m]
        n0, n1 = memory[k, 0], memory[k, 1]
        f, slope, bend, h, d, rho = gap(
            dx, dy, a[i], b[i], axis[i, 0], axis[i, 1], a[j], b[j], axis[j, 0], axis[j, 1], n0, n1
        )
        t = -slope / bend
        deep = f + 0.5 * slope * t
        apart = f <= 0.0
        sure = (t * t < SURE * SURE) & (bend > 0.0) & (deep < tip[i] + tip[j])
        scale = 1.0 - 0.5 * t * t
        depth[m] = deep if sure else (f if apart else np.nan)
        nx[m] = (n0 - t * n1) * scale if sure else n0
        ny[m] = (n1 + t * n0) * scale if sure else n1
        along[m] = h + d * t - 0.5 * deep
        across[m] = d + (rho - h) * t
    for m in range(low, high):
        k = pair[m]
        if isnan(depth[m]):
            i, j = one[m], other[m]
            dx, dy = place[j, 0] - place[i, 0], place[j, 1] - place[i, 1]
            n0, n1 = memory[k, 0], memory[k, 1]
            if isnan(n0):
                scale = 1.0 / sqrt(dx * dx + dy * dy)
                n0, n1 = dx * scale, dy * scale
            depth[m], nx[m], ny[m], height, across[m] = common_normal(
                dx,
                dy,
                a[i],
                b[i],
                axis[i, 0],
                axis[i, 1],
                a[j],
                b[j],
                axis[j, 0],
                axis[j, 1],
                n0,
                n1,
            )
            along[m] = height - 0.5 * depth[m]
        memory[k, 0], memory[k, 1] = nx[m], ny[m]


def _paper(shape, place, axis, memory, meetings, low, high):
    a, b = shape
    pair, one, other, depth, nx, ny, along, across = meetings
    for m in range(low, high):
        i, j = one[m], other[m]
        dx, dy = place[j, 0] - place[i, 0], place[j, 1] - place[i, 1]
        k = pair[m]
        alpha, beta = memory[k, 0], memory[k, 1]
        if isnan(alpha):
            alpha = facing(dx, dy, a[i], b[i], axis[i, 0], axis[i, 1])
            beta = facing(-dx, -dy, a[j], b[j], axis[j, 0], axis[j, 1])
        depth[m], nx[m], ny[m], along[m], across[m], memory[k, 0], memory[k, 1] = paper_contact(
            dx,
            dy,
            a[i],
            b[i],
            axis[i, 0],
            axis[i, 1],
            a[j],
            b[j],
            axis[j, 0],
            axis[j, 1],
            alpha,
            beta,
        )


def _disc_wall(shape, i, room, nx, ny, axis):
    depth = shape.radius[i] - room
    return depth, shape.radius[i] - 0.5 * depth, 0.0


def _ellipse_wall(shape, i, room, nx, ny, axis):
    height, side = support(shape.a[i], shape.b[i], axis[i, 0], axis[i, 1], nx, ny)
    return height - room, height - 0.5 * (height - room), side
