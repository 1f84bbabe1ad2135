"""`Column`: a state of spheres in a tube on a piston, and `fall`: the same some steps later.

Within a call the grains are put in the order of their places, so that neighbours in the tube are
neighbours in memory; what comes back has the order of what went in.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from liftdrag.dem.forces import Scene
from liftdrag.dem.law import Law
from liftdrag.dem.motion import advance_alone, advance_together
from liftdrag.dem.neighbours import Pairs, Parts, WallPairs, neighbours, wall_neighbours
from liftdrag.dem.spheres import Balls, Spheres, TubeWalls

DEEPEST = 1.0
"""Overlap over the radius at which a run stops: a grain has gone half-way through."""


def _none(*shape: int) -> np.ndarray:
    return np.zeros(shape)


@dataclass(frozen=True)
class ColumnMemory:
    """What contacts remember: `pair` (m, 2) grains; `stretch` (m, 3), the tangential spring's
    (m), or the force (N) of a latching one on the first grain; `state` (m, 3) of the law. Of the
    walls `wall_pair` (k, 2) grain and wall (0 tube, 1 piston), stretch and state alike."""

    pair: np.ndarray = field(default_factory=lambda: np.zeros((0, 2), np.int64))
    stretch: np.ndarray = field(default_factory=lambda: _none(0, 3))
    state: np.ndarray = field(default_factory=lambda: _none(0, 3))
    wall_pair: np.ndarray = field(default_factory=lambda: np.zeros((0, 2), np.int64))
    wall_stretch: np.ndarray = field(default_factory=lambda: _none(0, 3))
    wall_state: np.ndarray = field(default_factory=lambda: _none(0, 3))


@dataclass(frozen=True)
class Column:
    """Spheres in a tube about x = y = 0 on a piston at z = 0. SI units.

    `position`, `velocity` and `spin` (n, 3), `radius` and `mass` (n,). Grains that are `upright`
    (n,), of equal mass, are a lid: they neither move sideways nor turn, and move as one. `walls`
    are the tube's and the piston's; `gravity` (m/s^2) points downward.
    """

    position: np.ndarray
    velocity: np.ndarray
    spin: np.ndarray
    radius: np.ndarray
    mass: np.ndarray
    upright: np.ndarray
    walls: TubeWalls
    gravity: float
    memory: ColumnMemory = field(default_factory=ColumnMemory)

    @property
    def kinetic_energy(self) -> float:
        """Kinetic energy, J."""
        straight = self.mass * (self.velocity**2).sum(axis=1)
        turning = 0.4 * self.mass * self.radius**2 * (self.spin**2).sum(axis=1)
        return 0.5 * float(straight.sum() + turning[~self.upright].sum())


@dataclass(frozen=True)
class Fallen:
    """A column some steps later, and what was sampled on the way, a row every so many steps.

    `piston`, `tube`, `wall_normal` (r,): mean load on the piston, force of the tube on the
    grains, upward, and push across it (N). `kinetic`, `elastic` (r,): energies at the end of
    the row (J). `overlap` (r,): the largest over the smaller radius. `status`: FINE, TOO_DEEP,
    NOT_FINITE or ESCAPED, where the rows end before they should. `rebuilt`: how often the
    neighbours were listed anew.
    """

    column: Column
    piston: np.ndarray
    tube: np.ndarray
    wall_normal: np.ndarray
    kinetic: np.ndarray
    elastic: np.ndarray
    overlap: np.ndarray
    status: int
    rebuilt: int


def fall(
    column: Column,
    law: Law,
    time_step: float,
    rows: int,
    row_every: int = 1,
    skin: float | None = None,
    damping_rate: float = 0.0,
    deepest: float = DEEPEST,
    threads: int = 1,
) -> Fallen:
    """The column after `rows` times `row_every` steps of `time_step` (s).

    `skin` (m) of the neighbour lists, 0.3 mean radii by default; `damping_rate` (1/s) slows
    every motion; `deepest` is the overlap over the smaller radius that ends the run. Raises
    ValueError for numbers that make no sense.
    """
    skin = 0.3 * float(column.radius.mean()) if skin is None else skin
    if not (time_step > 0.0 and rows >= 0 and row_every >= 1 and skin >= 0.0 and threads >= 1):
        raise ValueError(
            f"no run of {rows} rows of {row_every} steps of {time_step} s with a skin of {skin} m "
            f"on {threads} threads"
        )
    order = upward_order(column)
    inside = permuted(column, order)
    shape, bodies, parts, scene = arrays(inside)
    pairs = neighbours(parts, scene.place, skin, law, pairs_of(inside))
    at_walls = wall_pairs_of(inside)
    at_walls = wall_neighbours(parts, scene.place, skin, law, column.walls, at_walls)
    move = advance_together if threads > 1 else advance_alone
    samples, done, pairs, at_walls, status = move(
        shape,
        bodies,
        parts,
        scene,
        law,
        column.walls,
        pairs,
        at_walls,
        time_step,
        rows,
        row_every,
        skin,
        float(np.exp(-damping_rate * time_step)),
        deepest,
        -1,
        threads,
    )
    after = replace(
        inside,
        position=scene.place[:, :3].copy(),
        velocity=scene.move[:, :3].copy(),
        spin=scene.move[:, 3:].copy(),
        memory=_memory(pairs, at_walls),
    )
    samples = samples[:done]
    return Fallen(
        column=permuted(after, np.argsort(order)),
        piston=samples[:, 3],
        tube=samples[:, 4],
        wall_normal=samples[:, 5],
        kinetic=samples[:, 7],
        elastic=samples[:, 8],
        overlap=samples[:, 9],
        status=int(status),
        rebuilt=int(samples[-1, 10]) if done else 0,
    )


def upward_order(column: Column) -> np.ndarray:
    """The grains (n,) layer by layer and row by row of cells about as wide as a grain."""
    size = 2.0 * float(np.median(column.radius))
    cell = np.floor((column.position - column.position.min(axis=0)) / size)
    return np.lexsort([cell[:, 0], cell[:, 1], cell[:, 2]])


def permuted(column: Column, order: np.ndarray) -> Column:
    """The same column with its grains in another order."""
    rank, memory = np.argsort(order), column.memory
    pair = rank[memory.pair]
    swapped = pair[:, 0] > pair[:, 1]
    wall_grain = rank[memory.wall_pair[:, 0]]
    return replace(
        column,
        **{
            name: getattr(column, name)[order].copy()
            for name in ("position", "velocity", "spin", "radius", "mass", "upright")
        },
        memory=replace(
            memory,
            pair=np.sort(pair, axis=1),
            stretch=np.where(swapped[:, None], -memory.stretch, memory.stretch),
            wall_pair=np.column_stack([wall_grain, memory.wall_pair[:, 1]]),
        ),
    )


def arrays(column: Column) -> tuple[Spheres, Balls, Parts, Scene]:
    """The column as the loops have it."""
    radius, count = np.ascontiguousarray(column.radius), len(column.mass)
    free = ~column.upright
    bodies = Balls(
        1.0 / column.mass,
        free / column.mass,
        free / (0.4 * column.mass * column.radius**2),
        np.full(count, column.gravity),
        np.flatnonzero(column.upright),
    )
    scene = Scene(
        np.column_stack([column.position, radius]),
        np.column_stack([column.velocity, column.spin]),
        np.zeros((0, 2)),
    )
    return Spheres(radius), bodies, Parts(radius, radius, column.mass, np.arange(count)), scene


def pairs_of(column: Column) -> Pairs:
    """The contacts that the column remembers, as a list of pairs."""
    memory = column.memory
    order = np.lexsort([memory.pair[:, 1], memory.pair[:, 0]])
    first = np.searchsorted(memory.pair[order, 0], np.arange(len(column.mass) + 1))
    other = memory.pair[order, 1].astype(np.int32)
    unused = np.zeros(len(order))
    return Pairs(first, other, memory.stretch[order], memory.state[order], unused, unused)


def wall_pairs_of(column: Column) -> WallPairs:
    """The same of the walls."""
    memory = column.memory
    part, wall = np.ascontiguousarray(memory.wall_pair.T.astype(np.int32))
    unused = np.zeros(len(part))
    return WallPairs(part, wall, memory.wall_stretch, memory.wall_state, unused, unused)


def _memory(pairs: Pairs, at_walls: WallPairs) -> ColumnMemory:
    part = np.repeat(np.arange(len(pairs.first) - 1), np.diff(pairs.first))
    return ColumnMemory(
        np.column_stack([part, pairs.other]).astype(np.int64),
        pairs.stretch,
        pairs.memory,
        np.column_stack([at_walls.part, at_walls.wall]).astype(np.int64),
        at_walls.stretch,
        at_walls.memory,
    )
