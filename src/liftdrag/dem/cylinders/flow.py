"""`shear`: cylinders in a cell forward in time, a sample every so many steps."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numba
import numpy as np

from liftdrag.dem.cylinders.advance import BLOCKS, FINE, advance_alone, advance_together
from liftdrag.dem.cylinders.forces import COUNTS, DEEPEST, ELASTIC, JUMPS, STRESS
from liftdrag.dem.cylinders.state import Cell, Cylinders
from liftdrag.dem.law import HertzMindlin

DEEPEST_OVERLAP = 0.5
"""Overlap over the smallest radius or half length of the two at which a run stops."""


@dataclass(frozen=True)
class Sample:
    """A flow at one moment, and means over the steps since the sample before.

    `kinetic` and `contact` (3, 3): the two parts of the stress tensor (Pa), positive in
    compression, from the velocities less those of the shear, and from force times way from
    centre to centre (its first index is that of the force). `counts` (11,): contacts by type, in
    the order of KINDS; `jumps`: contacts whose normal turned by more than 11 degrees in a step,
    but for steps in which lists are made. `translational`, `rotational`, `elastic` (J): energies
    at the moment, the first of the velocities less those of the shear. `overlap`: the largest on
    the way, over the smallest radius or half length of the two. `status`: FINE, TOO_DEEP or
    NOT_FINITE, after which no more come. `lists`: how often the neighbours were listed. Grains
    may have left the box since, by a way less than its size. `angular_momentum` (n, 3) about the
    centres (kg m^2/s) is that of the grains before it was rounded into their spin.
    """

    grains: Cylinders
    cell: Cell
    time: float
    kinetic: np.ndarray
    contact: np.ndarray
    counts: np.ndarray
    jumps: float
    translational: float
    rotational: float
    elastic: float
    overlap: float
    status: int
    lists: int
    angular_momentum: np.ndarray

    @property
    def strain(self) -> float:
        """The shear strain since the start."""
        return self.cell.shear_rate * self.time


def sheared(grains: Cylinders, cell: Cell) -> Cylinders:
    """The grains with the velocity of the shear, and no spin."""
    velocity = np.zeros_like(grains.velocity)
    velocity[:, 0] = cell.shear_rate * (grains.position[:, 1] - 0.5 * cell.size[1])
    return replace(grains, velocity=velocity, spin=np.zeros_like(grains.spin))


def shear(
    grains: Cylinders,
    cell: Cell,
    law: HertzMindlin,
    time_step: float,
    every: int,
    skin: float | None = None,
    threads: int = 1,
    deepest: float = DEEPEST_OVERLAP,
    angular_momentum: np.ndarray | None = None,
    time: float = 0.0,
) -> Iterator[Sample]:
    """Samples of the flow, one after every `every` steps of `time_step` (s), without end.

    Hertz's force with the radii of the two cylinders, whatever touches, and without friction:
    that of the law is not used. A sample is a state to go on from: to the same bits from its
    grains and cell with its `angular_momentum`, by default that of the grains, and its `time` (s).
    `skin` (m) of the neighbour lists, two fifths of the mean smaller extent by default. Two threads
    or more all give the same bits. Raises ValueError for numbers that make no sense, and where the
    box is not longer than the longest grain.
    """
    skin = default_skin(grains) if skin is None else skin
    check(grains, cell, time_step, every, skin, threads)
    run = advance_on(threads)
    place, move, ease = arrays(grains)
    if angular_momentum is not None:
        move[:, 3:6] = angular_momentum
    size, rate = np.ascontiguousarray(cell.size, float), cell.shear_rate
    status = FINE
    while status == FINE:
        found = run(place, move, ease, size, rate, cell.shift, law, time_step, every, skin, deepest)
        shift, status, done = found[3], found[5], found[6]
        cell, time = replace(cell, shift=shift), time + done * time_step
        yield sample(grains_of(place, move, grains), cell, time, found, move[:, 3:6].copy())


def advance_on(threads: int) -> Any:
    """The loop over the steps for one thread or several."""
    if threads == 1:
        return advance_alone
    settings: Any = numba.config
    numba.set_num_threads(min(threads, BLOCKS, settings.NUMBA_NUM_THREADS))
    return advance_together


def sample(
    grains: Cylinders, cell: Cell, time: float, found: Any, angular_momentum: np.ndarray
) -> Sample:
    """The sample of what the loop has found."""
    tallies, last, kinetic, _, lists, status, done = found
    share = 1.0 / max(done, 1)
    return Sample(
        grains=grains,
        cell=cell,
        time=time,
        kinetic=kinetic[1, 2:].reshape(3, 3) * (share / cell.volume),
        contact=tallies[STRESS:DEEPEST].reshape(3, 3) * (share / cell.volume),
        counts=tallies[COUNTS:JUMPS] * share,
        jumps=float(tallies[JUMPS] * share),
        translational=float(kinetic[0, 0]),
        rotational=float(kinetic[0, 1]),
        elastic=float(last[ELASTIC]),
        overlap=float(tallies[DEEPEST]),
        status=int(status),
        lists=int(lists),
        angular_momentum=angular_momentum,
    )


def default_skin(grains: Cylinders) -> float:
    """Two fifths of the mean of each grain's smaller of diameter and length (m)."""
    return 0.8 * float(grains.extent.mean())


def check(
    grains: Cylinders, cell: Cell, time_step: float, every: int, skin: float, threads: int
) -> None:
    """Raise ValueError for a run that makes no sense."""
    if grains.axis[grains.is_sphere].any():
        raise ValueError("a sphere has no axis: make it zero")
    if not (time_step > 0.0 and every >= 1 and skin > 0.0 and threads >= 1):
        raise ValueError(
            f"no run of {every} steps of {time_step} s with a skin of {skin} m on {threads} threads"
        )
    longest = 2.0 * float(np.hypot(grains.radius, grains.half_length).max()) + skin
    if not (np.asarray(cell.size) > longest).all():
        raise ValueError(f"a box of {cell.size} m is not longer than a grain of {longest} m")


def arrays(grains: Cylinders) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The grains as the loops have them: place, move and ease, as `drift` says."""
    place = np.column_stack([grains.position, grains.axis, grains.radius, grains.half_length])
    move = np.column_stack([grains.velocity, grains.angular_momentum, grains.spin])
    across, about = grains.inertia.T
    ease = np.column_stack([1.0 / grains.mass, 1.0 / across, 1.0 / about - 1.0 / across])
    return place, move, ease


def grains_of(place: np.ndarray, move: np.ndarray, grains: Cylinders) -> Cylinders:
    """The grains where the loops have brought them."""
    return replace(
        grains,
        position=place[:, :3].copy(),
        velocity=move[:, :3].copy(),
        axis=place[:, 3:6].copy(),
        spin=move[:, 6:].copy(),
    )
