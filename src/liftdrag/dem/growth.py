"""A random packing, grown: small grains at random places swell, push each other apart, and rest.

No gravity and no friction; the driven bodies keep their size and stay where they are.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from liftdrag.dem.bed import Bed, Memory, advance
from liftdrag.dem.compiled import compiled
from liftdrag.dem.law import Law
from liftdrag.dem.motion import FINE

SMALL = 0.5
"""Size at which the grains are placed, over their own."""

STAGES = 80
"""Steps in which they grow, in equal parts of area."""

STAGE_STEPS = 100
"""Time steps of a stage."""

REST_STAGES = 60
"""Stages, at most, in which the full-grown packing comes to rest."""

AT_REST = 1e-6
"""Kinetic over elastic energy at which it has."""

MOST_TRIES = 1000


def grown(bed: Bed, law: Law, time_step: float, damping_rate: float, seed: int) -> Bed:
    """The bed packed at random between its walls, at rest, without memory of contacts.

    The places of the free bodies are not used. Raises ValueError when they do not fit.
    """
    rng = np.random.default_rng(seed)
    smooth = law._replace(friction=0.0)
    bed = _sown(bed, rng)
    for area in np.linspace(SMALL**2, 1.0, STAGES):
        bed = _stage(bed, np.sqrt(area), smooth, time_step, damping_rate)[0]
    for _ in range(REST_STAGES):
        bed, rest = _stage(bed, 1.0, smooth, time_step, damping_rate)
        if rest < AT_REST:
            break
    still = np.zeros_like(bed.velocity)
    return replace(bed, velocity=still, spin=np.zeros_like(bed.spin), memory=Memory())


def _stage(
    bed: Bed, size: float, law: Law, time_step: float, damping_rate: float
) -> tuple[Bed, float]:
    """The bed some steps later with its grains at this share of their size; its restlessness."""
    run = advance(
        _scaled(bed, size), law, time_step, 1, STAGE_STEPS, damping_rate=damping_rate, deepest=10.0
    )
    if run.status != FINE:
        raise ValueError("the grains do not fit into the box: the packing burst as it grew")
    elastic = float(run.elastic[-1])
    rest = float(run.kinetic[-1]) / elastic if elastic > 0.0 else 0.0
    return _scaled(run.bed, 1.0 / size), rest


def _scaled(bed: Bed, size: float) -> Bed:
    """The bed with its free bodies at another size, where they are."""
    scale = np.where(np.isfinite(bed.mass), size, 1.0)[bed.body][:, None]
    return replace(bed, semi_axes=bed.semi_axes * scale, offset=bed.offset * scale)


def _sown(bed: Bed, rng: np.random.Generator) -> Bed:
    """The free bodies at random places and angles, none touching another at the small size."""
    free = np.isfinite(bed.mass)
    extent = np.zeros(len(bed.mass))
    reach = np.hypot(*bed.offset.T) + bed.semi_axes[:, 0]
    np.maximum.at(extent, bed.body, reach)
    extent[free] *= SMALL
    position = bed.position.copy()
    order = np.concatenate([np.flatnonzero(~free), np.flatnonzero(free)])
    fixed = int((~free).sum())
    walls = np.array(bed.walls)
    if not _sow(position, extent, order, fixed, walls, rng.integers(2**31)):
        raise ValueError("the grains do not fit into the box even at half their size")
    angle = np.where(free, rng.uniform(0.0, 2.0 * np.pi, len(free)), bed.angle)
    return replace(bed, position=position, angle=angle)


@compiled()
def _sow(position, extent, order, fixed, walls, seed):
    """Places without overlap, one body after the other, on a grid of the bodies placed."""
    np.random.seed(seed)  # noqa: NPY002 - the generator of compiled code
    count = len(order)
    size = 2.0 * extent[order[fixed:]].max()
    columns, rows = int((walls[1] - walls[0]) / size) + 1, int((walls[3] - walls[2]) / size) + 1
    head, following = np.full(columns * rows, -1), np.full(count, -1)
    for m in range(fixed, count):
        k = order[m]
        for attempt in range(MOST_TRIES + 1):
            if attempt == MOST_TRIES:
                return False
            x = np.random.uniform(walls[0] + extent[k], walls[1] - extent[k])  # noqa: NPY002
            y = np.random.uniform(walls[2] + extent[k], walls[3] - extent[k])  # noqa: NPY002
            column, row = int((x - walls[0]) / size), int((y - walls[2]) / size)
            if _is_free(
                position, extent, order[:fixed], head, following, columns, column, row, x, y, k
            ):
                break
        position[k, 0], position[k, 1] = x, y
        cell = row * columns + column
        following[k], head[cell] = head[cell], k
    return True


@compiled()
def _is_free(position, extent, fixed, head, following, columns, column, row, x, y, k):
    for other in fixed:
        if _clash(position, extent, other, x, y, k):
            return False
    rows = len(head) // columns
    for r in range(max(row - 1, 0), min(row + 2, rows)):
        for c in range(max(column - 1, 0), min(column + 2, columns)):
            other = head[r * columns + c]
            while other >= 0:
                if _clash(position, extent, other, x, y, k):
                    return False
                other = following[other]
    return True


@compiled()
def _clash(position, extent, other, x, y, k):
    reach = extent[other] + extent[k]
    return (position[other, 0] - x) ** 2 + (position[other, 1] - y) ** 2 < reach**2
