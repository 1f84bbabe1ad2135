"""Velocity Verlet: the bodies forward in time, and what is sampled on the way.

The two half kicks between one drift and the next are given at once. Velocities in the contacts
are those half a step before the positions, as in LAMMPS and LIGGGHTS.
"""

from __future__ import annotations

from math import isfinite
from typing import NamedTuple

import numpy as np
from numba import prange

from liftdrag.dem.compiled import compiled
from liftdrag.dem.forces import pair_forces, wall_forces
from liftdrag.dem.neighbours import Pairs, neighbours, room_for_meetings, wall_neighbours
from liftdrag.dem.shapes import Meetings


class Bodies(NamedTuple):
    """Rigid bodies: `position` and `velocity` (b, 2), `angle` and `spin` (b,), one over mass and
    inertia (b,), zero for a driven one; and their parts: body k owns the parts from `first[k]`
    to `first[k + 1]`, at `offset` (p, 2) from its centre when its angle is zero."""

    position: np.ndarray
    velocity: np.ndarray
    angle: np.ndarray
    spin: np.ndarray
    mobility: np.ndarray
    turnability: np.ndarray
    first: np.ndarray
    offset: np.ndarray


SAMPLES = 11
"""Columns of a row of samples: force on the watched body (x, y, torque), push on the walls (left,
right, bottom, top), kinetic and elastic energy, deepest overlap, lists rebuilt."""

FARTHEST = 1e100
"""Coordinate (m) beyond which a part is nowhere."""

FINE, TOO_DEEP, NOT_FINITE, ESCAPED = 0, 1, 2, 3


@compiled()
def _drift(bodies, scene, forces, turning, kick, time_step, damping, low, high, origin):
    """Kick and move the bodies low to high, place their parts, and clear the forces.

    `turning` says whether the axes of the parts matter. Returns the largest squared distance
    of a part from its `origin`.
    """
    place, move, axis = scene
    position, velocity, angle, spins, mobility, turnability, first, offset = bodies
    force = forces[0]
    farthest = 0.0
    for k in range(low, high):
        fx, fy, torque = _gathered(first, position, place, force, k)
        slow = damping if mobility[k] > 0.0 else 1.0
        vx = slow * (velocity[k, 0] + kick * fx * mobility[k])
        vy = slow * (velocity[k, 1] + kick * fy * mobility[k])
        spin = slow * (spins[k] + kick * torque * turnability[k])
        velocity[k, 0], velocity[k, 1], spins[k] = vx, vy, spin
        x, y = position[k, 0] + vx * time_step, position[k, 1] + vy * time_step
        position[k, 0], position[k, 1] = x, y
        angle[k] += spin * time_step
        c, s = 1.0, 0.0
        if turning:
            c, s = _turned(axis[first[k], 0], axis[first[k], 1], spin * time_step)
        for p in range(first[k], first[k + 1]):
            ox, oy = 0.0, 0.0
            if turning:
                ox = c * offset[p, 0] - s * offset[p, 1]
                oy = s * offset[p, 0] + c * offset[p, 1]
                axis[p, 0], axis[p, 1] = c, s
            place[p, 0], place[p, 1] = x + ox, y + oy
            move[p, 0], move[p, 1], move[p, 2] = vx - spin * oy, vy + spin * ox, spin
            dx, dy = place[p, 0] - origin[p, 0], place[p, 1] - origin[p, 1]
            farthest = max(farthest, dx * dx + dy * dy)
            force[p, 0], force[p, 1], force[p, 2] = 0.0, 0.0, 0.0
    return farthest


@compiled()
def _reduce(forces, low, high):
    """The sum over the threads of the forces on the parts low to high, into the first's."""
    for t in range(1, len(forces)):
        for p in range(low, high):
            for m in range(3):
                forces[0, p, m] += forces[t, p, m]
                forces[t, p, m] = 0.0


@compiled()
def _gathered(first, position, place, force, k):
    """Force and torque on body k from its parts."""
    fx, fy, torque = 0.0, 0.0, 0.0
    for p in range(first[k], first[k + 1]):
        px, py = force[p, 0], force[p, 1]
        fx += px
        fy += py
        torque += force[p, 2]
        torque += (place[p, 0] - position[k, 0]) * py - (place[p, 1] - position[k, 1]) * px
    return fx, fy, torque


@compiled()
def _turned(c, s, angle):
    """A direction turned by a small angle: a rotation to rounding, its angle to the fifth order."""
    half = 0.5 * angle
    half += half * half * half * (1.0 / 3.0)
    square = half * half
    scale = 1.0 - square + square * square if square < 1e-6 else 1.0 / (1.0 + square)
    c1, s1 = (1.0 - square) * scale, 2.0 * half * scale
    return c * c1 - s * s1, s * c1 + c * s1


@compiled()
def _close(bodies, scene, force, kick):
    """The half kick that brings the velocities to the time of the positions."""
    position, velocity, _, spins, mobility, turnability, first, _ = bodies
    place = scene.place
    for k in range(len(spins)):
        fx, fy, torque = _gathered(first, position, place, force, k)
        velocity[k, 0] += kick * fx * mobility[k]
        velocity[k, 1] += kick * fy * mobility[k]
        spins[k] += kick * torque * turnability[k]


@compiled()
def _kinetic(bodies, scene, force, kick):
    """Kinetic energy (J) of the free bodies at the time of the positions."""
    position, velocity, _, spins, mobility, turnability, first, _ = bodies
    place, energy = scene.place, 0.0
    for k in range(len(spins)):
        fx, fy, torque = _gathered(first, position, place, force, k)
        if mobility[k] > 0.0:
            vx = velocity[k, 0] + kick * fx * mobility[k]
            vy = velocity[k, 1] + kick * fy * mobility[k]
            energy += 0.5 * (vx * vx + vy * vy) / mobility[k]
        if turnability[k] > 0.0:
            spin = spins[k] + kick * torque * turnability[k]
            energy += 0.5 * spin * spin / turnability[k]
    return energy


@compiled()
def _placed(place):
    """Whether every part is somewhere."""
    for i in range(len(place)):
        if not (abs(place[i, 0]) < FARTHEST and abs(place[i, 1]) < FARTHEST):
            return False
    return True


@compiled()
def _verdict(place, walls, deepest, bound, energy):
    """Whether the state is one of grains still: FINE, or why not."""
    if not isfinite(energy):
        return NOT_FINITE
    if deepest > bound:
        return TOO_DEEP
    for i in range(len(place)):
        if place[i, 0] < walls[0] or place[i, 0] > walls[1]:
            return ESCAPED
        if place[i, 1] < walls[2] or place[i, 1] > walls[3]:
            return ESCAPED
    return FINE


def _advance(
    shape,
    bodies,
    parts,
    scene,
    law,
    walls,
    turning,
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
    n, count = len(parts.bound), len(bodies.angle)
    force, load = np.zeros((threads, n, 3)), np.zeros(4)
    energies, depths = np.zeros(threads), np.zeros(threads)
    farthest = np.zeros(threads)
    origin, meetings = scene.place.copy(), room_for_meetings(pairs)
    chunk = _chunks(pairs.first, threads)
    share, share_of_parts = _shares(count, threads), _shares(n, threads)
    samples = np.zeros((rows, SAMPLES))
    kick, rebuilt, step_time, status, done = 0.5 * time_step, 0, 0.0, FINE, 0
    for step in range(rows * row_every + 1):
        if step > 0:
            for t in prange(threads):
                farthest[t] = _drift(
                    bodies,
                    scene,
                    force,
                    turning,
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
                rebuilt += 1
        listed, met = Pairs(*pairs), Meetings(*meetings)
        for t in prange(threads):
            energies[t], depths[t] = pair_forces(
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
        if threads > 1:
            for t in prange(threads):
                _reduce(force, share_of_parts[t], share_of_parts[t + 1])
        energy, deepest = wall_forces(
            shape, scene, parts.radius, law, step_time, walls, wall_pairs, force[0], load
        )
        if step == 0:
            load[:] = 0.0
            continue
        row = (step - 1) // row_every
        sample = samples[row]
        if watched >= 0:
            fx, fy, torque = _gathered(
                bodies.first, bodies.position, scene.place, force[0], watched
            )
            sample[0] += fx
            sample[1] += fy
            sample[2] += torque
        sample[9] = max(sample[9], max(deepest, depths.max()))
        if step % row_every == 0:
            sample[0:3] /= row_every
            sample[3:7] = load / row_every
            load[:] = 0.0
            sample[7] = _kinetic(bodies, scene, force[0], 0.5 * time_step)
            sample[8] = energy + energies.sum()
            sample[10] = rebuilt
            done = row + 1
            status = _verdict(scene.place, walls, sample[9], bound, sample[7])
            if status != FINE:
                break
    if rows > 0:
        _close(bodies, scene, force[0], 0.5 * time_step)
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
