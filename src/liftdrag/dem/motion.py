"""Velocity Verlet: the bodies forward in time, and what is sampled on the way.

The two half kicks between one drift and the next are given at once. Velocities in the contacts
are those half a step before the positions, as in LAMMPS and LIGGGHTS. What the bodies are, in
`planar` or `spheres`, says how they are moved.
"""

from __future__ import annotations

from math import isfinite
from typing import Any

import numpy as np
from numba import prange

from liftdrag.dem.compiled import compiled
from liftdrag.dem.forces import pair_forces, room_for_meetings, wall_forces
from liftdrag.dem.neighbours import Pairs, WallPairs, neighbours, wall_neighbours
from liftdrag.dem.shapes import Meetings

SAMPLES = 11
"""Columns of a row of samples: force on the watched body (x, y, torque), load on the walls (4),
kinetic and elastic energy, deepest overlap, lists rebuilt."""

FARTHEST = 1e100
"""Coordinate (m) beyond which a part is nowhere."""

FINE, TOO_DEEP, NOT_FINITE, ESCAPED = 0, 1, 2, 3


def drift(
    bodies: Any,
    scene: Any,
    forces: Any,
    kick: float,
    time_step: float,
    damping: float,
    low: int,
    high: int,
    origin: Any,
) -> Any:
    """Kick and move the bodies low to high, place their parts, and clear the forces.

    Returns the largest squared distance of a part from its `origin`.
    """
    raise NotImplementedError("this is compiled")


def bind(bodies: Any, force: Any) -> None:
    """Share the forces of parts that only move together."""
    raise NotImplementedError("this is compiled")


def gathered(bodies: Any, scene: Any, force: Any, k: int) -> Any:
    """Force (x, y) and torque on body k from its parts."""
    raise NotImplementedError("this is compiled")


def close(bodies: Any, scene: Any, force: Any, kick: float) -> None:
    """The half kick that brings the velocities to the time of the positions."""
    raise NotImplementedError("this is compiled")


def kinetic(bodies: Any, scene: Any, force: Any, kick: float) -> Any:
    """Kinetic energy (J) of the free bodies at the time of the positions."""
    raise NotImplementedError("this is compiled")


def inside(walls: Any, place: Any) -> Any:
    """FINE where all parts are between the walls, else ESCAPED."""
    raise NotImplementedError("this is compiled")


@compiled()
def _reduce(forces, low, high):
    """The sum over the threads of the forces on the parts low to high, into the first's."""
    for t in range(1, forces.shape[0]):
        for p in range(low, high):
            for m in range(forces.shape[2]):
                forces[0, p, m] += forces[t, p, m]
                forces[t, p, m] = 0.0


@compiled()
def _placed(place):
    """Whether every part is somewhere."""
    for i in range(len(place)):
        for a in range(3):
            if not abs(place[i, a]) < FARTHEST:
                return False
    return True


@compiled()
def _verdict(place, walls, deepest, bound, energy):
    """Whether the state is one of grains still: FINE, or why not."""
    if not isfinite(energy):
        return NOT_FINITE
    if deepest > bound:
        return TOO_DEEP
    return inside(walls, place)


def _advance(
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
    damping,
    bound,
    watched,
    threads,
):
    """`rows` rows of samples, each the mean over `row_every` steps.

    Changes bodies and scene in place; returns the samples (rows, SAMPLES), the rows done, the
    pairs with their memory, and FINE or the reason why it stopped. Energies and the deepest
    overlap of a row are those at its end, and the largest.
    """
    n, count = len(parts.bound), len(bodies.mobility)
    force, load = np.zeros((threads, n, scene.move.shape[1])), np.zeros((threads, 4))
    energies, depths = np.zeros(threads), np.zeros(threads)
    farthest = np.zeros(threads)
    origin, meetings = scene.place.copy(), room_for_meetings(pairs)
    chunk = _chunks(pairs.first, threads)
    wall_chunk = np.searchsorted(wall_pairs.part, chunk)
    share, share_of_parts = _shares(count, threads), _shares(n, threads)
    samples = np.zeros((rows, SAMPLES))
    kick, rebuilt, step_time, status, done = 0.5 * time_step, 0, 0.0, FINE, 0
    for step in range(rows * row_every + 1):
        if step > 0:
            for t in prange(threads):
                farthest[t] = drift(
                    bodies,
                    scene,
                    force,
                    kick,
                    time_step,
                    damping,
                    share[t],
                    share[t + 1],
                    origin,
                )
            kick, step_time = time_step, time_step
            if 4.0 * farthest.max() > skin * skin:
                if not _placed(scene.place):
                    status = NOT_FINITE
                    break
                pairs = neighbours(parts, scene.place, skin, law, pairs)
                meetings = room_for_meetings(pairs)
                wall_pairs = wall_neighbours(parts, scene.place, skin, law, walls, wall_pairs)
                origin[:] = scene.place
                chunk = _chunks(pairs.first, threads)
                wall_chunk = np.searchsorted(wall_pairs.part, chunk)
                rebuilt += 1
        listed, met = Pairs(*pairs), Meetings(*meetings)
        at_walls = WallPairs(*wall_pairs)
        for t in prange(threads):
            energy, deepest = pair_forces(
                shape,
                scene,
                parts.radius,
                law,
                step_time,
                listed,
                met,
                chunk[t],
                chunk[t + 1],
                force[t],
            )
            wall_energy, wall_deepest = wall_forces(
                shape,
                scene,
                parts.radius,
                law,
                step_time,
                walls,
                at_walls,
                wall_chunk[t],
                wall_chunk[t + 1],
                force[t],
                load[t],
            )
            energies[t], depths[t] = energy + wall_energy, max(deepest, wall_deepest)
        if threads > 1:
            for t in prange(threads):
                _reduce(force, share_of_parts[t], share_of_parts[t + 1])
        bind(bodies, force[0])
        if step == 0:
            load[:] = 0.0
            continue
        row = (step - 1) // row_every
        sample = samples[row]
        if watched >= 0:
            fx, fy, torque = gathered(bodies, scene, force[0], watched)
            sample[0] += fx
            sample[1] += fy
            sample[2] += torque
        sample[9] = max(sample[9], depths.max())
        if step % row_every == 0:
            sample[0:3] /= row_every
            sample[3:7] = load.sum(axis=0) / row_every
            load[:] = 0.0
            sample[7] = kinetic(bodies, scene, force[0], 0.5 * time_step)
            sample[8] = energies.sum()
            sample[10] = rebuilt
            done = row + 1
            status = _verdict(scene.place, walls, sample[9], bound, sample[7])
            if status != FINE:
                break
    if rows > 0:
        close(bodies, scene, force[0], 0.5 * time_step)
    return samples, done, pairs, wall_pairs, status


@compiled()
def _chunks(first, threads):
    """Ranges of parts with equal numbers of pairs."""
    edges = np.zeros(threads + 1, np.int64)
    for t in range(1, threads):
        edges[t] = np.searchsorted(first, t * first[-1] // threads)
    edges[threads] = len(first) - 1
    return edges


@compiled()
def _shares(count, threads):
    edges = np.zeros(threads + 1, np.int64)
    for t in range(threads + 1):
        edges[t] = t * count // threads
    return edges


advance_alone = compiled()(_advance)
"""`_advance` on one thread."""

advance_together = compiled(parallel=True)(_advance)
"""`_advance` on as many threads as it is told."""
