"""`Bed`: a state of grains in a box, and `advance`: the same some steps later.

Within a call the grains are put in the order of their places, so that neighbours in the box are
neighbours in memory; what comes back has the order of what went in.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from liftdrag.dem.forces import Scene
from liftdrag.dem.law import Law
from liftdrag.dem.motion import advance_alone, advance_together
from liftdrag.dem.neighbours import Pairs, Parts, WallPairs, neighbours, wall_neighbours
from liftdrag.dem.planar import Bodies, Box
from liftdrag.dem.shapes import Discs, Ellipses, PaperEllipses, Shape

NO_WALLS = (-np.inf, np.inf, -np.inf, np.inf)

DEEPEST = 1.0
"""Overlap over the smaller radius at which a run stops: a grain has gone half-way through."""

SHAPES: dict[str, type[Shape]] = {
    "disc": Discs,
    "common normal": Ellipses,
    "paper": PaperEllipses,
}
"""How parts touch: as discs, as ellipses by their common normal, or as Zhou et al. read it."""


@dataclass(frozen=True)
class Memory:
    """What contacts remember: `pair` (m, 2) parts, `stretch` (m,) in m of the tangential spring,
    `search` (m, 2) of the geometry; and of walls `wall_pair` (k, 2) part and wall, stretch."""

    pair: np.ndarray = field(default_factory=lambda: np.zeros((0, 2), np.int64))
    stretch: np.ndarray = field(default_factory=lambda: np.zeros(0))
    search: np.ndarray = field(default_factory=lambda: np.zeros((0, 2)))
    wall_pair: np.ndarray = field(default_factory=lambda: np.zeros((0, 2), np.int64))
    wall_stretch: np.ndarray = field(default_factory=lambda: np.zeros(0))


@dataclass(frozen=True)
class Bed:
    """Rigid bodies of one or more parts, discs or ellipses, between four walls. SI units.

    Bodies: `position` and `velocity` (b, 2), `angle` and `spin` (b,), `mass` and `inertia`
    (b,), infinite for a body that is driven. Parts: `semi_axes` (p, 2), the long one first,
    `offset` (p, 2) from the body's centre when its angle is zero, `body` (p,) in order.
    `contact` is a key of SHAPES. `walls`: x of the left and right, y of the bottom and top one.
    """

    position: np.ndarray
    velocity: np.ndarray
    angle: np.ndarray
    spin: np.ndarray
    mass: np.ndarray
    inertia: np.ndarray
    semi_axes: np.ndarray
    offset: np.ndarray
    body: np.ndarray
    contact: str = "disc"
    walls: tuple[float, float, float, float] = NO_WALLS
    memory: Memory = field(default_factory=Memory)

    @property
    def radius(self) -> np.ndarray:
        """Radius (p,) of the disc of each part's area, m."""
        return np.asarray(np.sqrt(self.semi_axes[:, 0] * self.semi_axes[:, 1]))

    @cached_property
    def place(self) -> np.ndarray:
        """Centres (p, 2) of the parts, m."""
        c, s = np.cos(self.angle[self.body]), np.sin(self.angle[self.body])
        x, y = self.offset.T
        turned = np.column_stack([c * x - s * y, s * x + c * y])
        return np.asarray(self.position[self.body] + turned)

    @property
    def kinetic_energy(self) -> float:
        """Kinetic energy of the free bodies, J."""
        free, turning = np.isfinite(self.mass), np.isfinite(self.inertia)
        straight = self.mass[free] * (self.velocity[free] ** 2).sum(axis=1)
        return 0.5 * float(straight.sum() + (self.inertia * self.spin**2)[turning].sum())


@dataclass(frozen=True)
class Advanced:
    """A bed some steps later, and what was sampled on the way, a row every so many steps.

    `force` (r, 3): mean force (N) and torque (N m) on the watched body. `load` (r, 4): mean
    push on the left, right, bottom and top wall (N). `kinetic`, `elastic` (r,): energies at
    the end of the row (J). `overlap` (r,): the largest over the smaller radius. `status`: FINE,
    TOO_DEEP, NOT_FINITE or ESCAPED, where the rows end before they should. `rebuilt`: how often
    the neighbours were listed anew.
    """

    bed: Bed
    force: np.ndarray
    load: np.ndarray
    kinetic: np.ndarray
    elastic: np.ndarray
    overlap: np.ndarray
    status: int
    rebuilt: int


def advance(
    bed: Bed,
    law: Law,
    time_step: float,
    rows: int,
    row_every: int = 1,
    skin: float | None = None,
    damping_rate: float = 0.0,
    deepest: float = DEEPEST,
    watched: int = -1,
    threads: int = 1,
) -> Advanced:
    """The bed after `rows` times `row_every` steps of `time_step` (s).

    `skin` (m) of the neighbour lists, 0.3 mean radii by default; `damping_rate` (1/s) slows
    every motion; `deepest` is the overlap over the smaller radius that ends the run;
    `watched` is the body whose force is sampled, none when negative. Raises ValueError for
    numbers that make no sense, or for discs that are none.
    """
    skin = 0.3 * float(bed.radius.mean()) if skin is None else skin
    _check(bed, time_step, rows, row_every, skin, threads)
    order = spatial_order(bed)
    inside = _permuted(bed, order)
    shape, bodies, parts, scene = arrays(inside)
    walls = Box(np.array(bed.walls, float))
    pairs = neighbours(parts, scene.place, skin, law, pairs_of(inside))
    wall_pairs = wall_neighbours(parts, scene.place, skin, law, walls, wall_pairs_of(inside))
    own_watched = -1 if watched < 0 else int(np.flatnonzero(order == watched)[0])
    move = advance_together if threads > 1 else advance_alone
    samples, done, pairs, wall_pairs, status = move(
        shape,
        bodies,
        parts,
        scene,
        law,
        walls,
        pairs,
        wall_pairs,
        time_step,
        rows,
        row_every,
        skin,
        float(np.exp(-damping_rate * time_step)),
        deepest,
        own_watched,
        threads,
    )
    after = replace(
        inside,
        position=bodies.position,
        velocity=bodies.velocity,
        angle=bodies.angle,
        spin=bodies.spin,
        memory=_memory(pairs, wall_pairs),
    )
    samples = samples[:done]
    return Advanced(
        bed=_permuted(after, np.argsort(order)),
        force=samples[:, 0:3],
        load=samples[:, 3:7],
        kinetic=samples[:, 7],
        elastic=samples[:, 8],
        overlap=samples[:, 9],
        status=int(status),
        rebuilt=int(samples[-1, 10]) if done else 0,
    )


def _check(
    bed: Bed, time_step: float, rows: int, row_every: int, skin: float, threads: int
) -> None:
    if not (time_step > 0.0 and rows >= 0 and row_every >= 1 and skin >= 0.0 and threads >= 1):
        raise ValueError(
            f"no run of {rows} rows of {row_every} steps of {time_step} s with a skin of {skin} m "
            f"on {threads} threads"
        )
    if bed.contact == "disc" and not np.array_equal(bed.semi_axes[:, 0], bed.semi_axes[:, 1]):
        raise ValueError("the parts are no discs: their semi-axes differ")


def spatial_order(bed: Bed) -> np.ndarray:
    """The bodies (b,) row by row of cells about as wide as a grain."""
    size = 2.0 * float(np.median(bed.semi_axes[:, 0]))
    cell = np.floor((bed.position - bed.position.min(axis=0)) / size)
    return np.lexsort([cell[:, 0], cell[:, 1]])


def _permuted(bed: Bed, order: np.ndarray) -> Bed:
    """The same bed with its bodies, and so their parts, in another order."""
    rank = np.argsort(order)
    parts = np.argsort(rank[bed.body], kind="stable")
    part_rank = np.argsort(parts)
    memory = bed.memory
    pair = part_rank[memory.pair]
    swapped = pair[:, 0] > pair[:, 1]
    return replace(
        bed,
        **{
            name: getattr(bed, name)[order].copy()
            for name in ("position", "velocity", "angle", "spin", "mass", "inertia")
        },
        semi_axes=bed.semi_axes[parts],
        offset=bed.offset[parts],
        body=rank[bed.body][parts],
        memory=replace(
            memory,
            pair=np.sort(pair, axis=1),
            search=_turned_round(bed.contact, memory.search, swapped),
            wall_pair=np.column_stack([part_rank[memory.wall_pair[:, 0]], memory.wall_pair[:, 1]]),
        ),
    )


def _turned_round(contact: str, search: np.ndarray, swapped: np.ndarray) -> np.ndarray:
    """What the geometry remembers of pairs whose two parts have changed places."""
    other = search[:, ::-1] if contact == "paper" else -search
    return np.where(swapped[:, None], other, search)


def arrays(bed: Bed) -> tuple[Shape, Bodies, Parts, Scene]:
    a, b = np.ascontiguousarray(bed.semi_axes.T)
    bodies = Bodies(
        bed.position,
        bed.velocity,
        bed.angle,
        bed.spin,
        1.0 / bed.mass,
        1.0 / bed.inertia,
        np.searchsorted(bed.body, np.arange(len(bed.mass) + 1)),
        np.ascontiguousarray(bed.offset),
        bool(bed.contact != "disc" or bed.offset.any()),
    )
    owner = np.where(np.isfinite(bed.mass), np.arange(len(bed.mass)), -1)[bed.body]
    parts = Parts(a, bed.radius, bed.mass[bed.body], owner)
    angle, spin = bed.angle[bed.body], bed.spin[bed.body]
    ox, oy = (bed.place - bed.position[bed.body]).T
    vx, vy = bed.velocity[bed.body].T
    scene = Scene(
        np.column_stack([bed.place, np.zeros(len(a)), a]),
        np.column_stack([vx - spin * oy, vy + spin * ox, spin]),
        np.column_stack([np.cos(angle), np.sin(angle)]),
    )
    return _shape(bed.contact, a, b), bodies, parts, scene


def _shape(contact: str, a: np.ndarray, b: np.ndarray) -> Shape:
    shape = SHAPES[contact]
    if shape is Ellipses:
        return Ellipses(a, b, b * b / a)
    return Discs(a) if shape is Discs else PaperEllipses(a, b)


def pairs_of(bed: Bed) -> Pairs:
    memory = bed.memory
    order = np.lexsort([memory.pair[:, 1], memory.pair[:, 0]])
    first = np.searchsorted(memory.pair[order, 0], np.arange(len(bed.body) + 1))
    other = memory.pair[order, 1].astype(np.int32)
    unused = np.zeros(len(order))
    stretch = memory.stretch[order][:, None]
    return Pairs(first, other, stretch, memory.search[order], unused, unused)


def wall_pairs_of(bed: Bed) -> WallPairs:
    part, wall = np.ascontiguousarray(bed.memory.wall_pair.T.astype(np.int32))
    unused = np.zeros(len(part))
    stretch, nothing = bed.memory.wall_stretch[:, None], np.zeros((len(part), 0))
    return WallPairs(part, wall, stretch, nothing, unused, unused)


def _memory(pairs: Pairs, wall_pairs: WallPairs) -> Memory:
    part = np.repeat(np.arange(len(pairs.first) - 1), np.diff(pairs.first))
    return Memory(
        np.column_stack([part, pairs.other]).astype(np.int64),
        pairs.stretch[:, 0],
        pairs.memory,
        np.column_stack([wall_pairs.part, wall_pairs.wall]).astype(np.int64),
        wall_pairs.stretch[:, 0],
    )
