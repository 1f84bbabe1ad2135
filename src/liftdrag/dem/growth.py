"""A random packing, grown: small grains at random places swell, push each other apart, and rest.

No gravity and no friction; the driven bodies keep their size and stay where they are.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from liftdrag.dem.bed import Bed, Memory, advance
from liftdrag.dem.compiled import compiled
from liftdrag.dem.contacts import contacts, forces
from liftdrag.dem.law import HertzMindlin
from liftdrag.dem.motion import FINE

SMALL = (0.5, 0.35, 0.25)
"""Sizes at which the grains are placed, over their own: the first that leaves them room."""

STAGES = 40
"""Steps in which they grow, in equal parts of area."""

STAGE_STEPS = 100
"""Time steps of a stage."""

REST_STAGES = 400
"""Stages, at most, in which the full-grown packing comes to rest."""

LOOK_EVERY = 10
"""Stages from one look at the forces to the next."""

AT_REST = 1e-3
"""Net force on a grain over the mean force of a contact, at which a packing is at rest."""

SLIGHT = 0.01
"""Overlap over the radius below which contacts are slight, and their packing is loose."""

CRUSHED = 0.5
"""Overlap over the smaller radius above which grains do not fit."""

MOST_TRIES = 1000


def grown(bed: Bed, law: HertzMindlin, time_step: float, damping_rate: float, seed: int) -> Bed:
    """The bed packed at random between its walls, at rest, without memory of contacts.

    What still moves after REST_STAGES is stopped where it is.

    Places and velocities of the free bodies are not used; the driven ones have their velocities
    again at the end. Raises ValueError when the grains do not fit, or the box is open.
    """
    if not np.isfinite(bed.walls).all():
        raise ValueError("a packing needs four walls")
    rng = np.random.default_rng(seed)
    smooth = law._replace(friction=0.0)
    velocity, spin, driven = bed.velocity, bed.spin, ~np.isfinite(bed.mass)
    bed = _stilled(bed)
    bed, small = _sown(bed, rng)
    for area in np.linspace(small**2, 1.0, STAGES):
        bed = _stage(bed, np.sqrt(area), smooth, time_step, damping_rate)
    for _ in range(0, REST_STAGES, LOOK_EVERY):
        if _rests(bed, smooth):
            break
        bed = _stage(bed, 1.0, smooth, time_step, damping_rate, LOOK_EVERY)
    _refuse_crushed(bed, smooth)
    return replace(
        _stilled(bed),
        velocity=np.where(driven[:, None], velocity, 0.0),
        spin=np.where(driven, spin, 0.0),
    )


def _stilled(bed: Bed) -> Bed:
    """The bed at rest, without memory."""
    still = np.zeros_like(bed.velocity)
    return replace(bed, velocity=still, spin=np.zeros_like(bed.spin), memory=Memory())


def _refuse_crushed(bed: Bed, law: HertzMindlin) -> None:
    found = contacts(bed, law)
    smaller = bed.radius[found.pair].min(axis=1)
    if (found.depth > CRUSHED * smaller).any():
        raise ValueError("the grains do not fit into the box: they would crush each other")


def _rests(bed: Bed, law: HertzMindlin) -> bool:
    """Whether the contacts of a bed, were it still, balance."""
    still = _stilled(bed)
    net = forces(still, law)[np.isfinite(bed.mass), :2]
    found, radius = contacts(still, law), bed.radius
    one, other = radius[found.pair].T
    push = law.stiffness * np.sqrt(one * other / (one + other)) * found.depth**1.5
    typical = float(radius.mean())
    slight = law.stiffness * np.sqrt(typical / 2.0) * (SLIGHT * typical) ** 1.5
    least = max(float(push.mean()) if len(push) else 0.0, slight)
    return bool(np.sqrt((net**2).sum(axis=1).mean()) < AT_REST * least)


def _stage(
    bed: Bed, size: float, law: HertzMindlin, time_step: float, damping_rate: float, stages: int = 1
) -> Bed:
    """The bed some steps later with its grains at this share of their size."""
    steps = stages * STAGE_STEPS
    run = advance(
        _scaled(bed, size), law, time_step, 1, steps, damping_rate=damping_rate, deepest=10.0
    )
    if run.status != FINE:
        raise ValueError("the grains do not fit into the box: the packing burst as it grew")
    return _scaled(run.bed, 1.0 / size)


def _scaled(bed: Bed, size: float) -> Bed:
    """The bed with its free bodies at another size, where they are."""
    scale = np.where(np.isfinite(bed.mass), size, 1.0)[bed.body][:, None]
    return replace(bed, semi_axes=bed.semi_axes * scale, offset=bed.offset * scale)


def _sown(bed: Bed, rng: np.random.Generator) -> tuple[Bed, float]:
    """The free bodies at random places and angles, none touching another at the small size.

    That size comes with them.
    """
    free = np.isfinite(bed.mass)
    extent = np.zeros(len(bed.mass))
    reach = np.hypot(*bed.offset.T) + bed.semi_axes[:, 0]
    np.maximum.at(extent, bed.body, reach)
    position = bed.position.copy()
    order = np.concatenate([np.flatnonzero(~free), np.flatnonzero(free)])
    fixed, walls = int((~free).sum()), np.array(bed.walls)
    angle = np.where(free, rng.uniform(0.0, 2.0 * np.pi, len(free)), bed.angle)
    for small in SMALL:
        size = np.where(free, small * extent, extent)
        if _sow(position, size, order, fixed, walls, rng.integers(2**31)):
            return replace(bed, position=position, angle=angle), small
    raise ValueError("the grains do not fit into the box even at a quarter of their size")


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
