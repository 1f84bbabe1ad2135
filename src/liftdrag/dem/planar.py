"""In the plane: rigid bodies of discs or ellipses between four walls, with one slip and one spin.

A body moves as a whole; its parts have the contacts.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba.extending import overload

from liftdrag.dem.compiled import compiled
from liftdrag.dem.forces import forget, met_forces, wall_forces
from liftdrag.dem.law import contact_force
from liftdrag.dem.motion import (
    ESCAPED,
    FINE,
    bind,
    close,
    drift,
    gathered,
    inside,
    kinetic,
)
from liftdrag.dem.neighbours import near_walls, remembered_walls
from liftdrag.dem.shapes import Discs, Ellipses, PaperEllipses, meet, wall_touch

PLANAR = (Discs, Ellipses, PaperEllipses)


class Bodies(NamedTuple):
    """Rigid bodies: `position` and `velocity` (b, 2), `angle` and `spin` (b,), one over mass and
    inertia (b,), zero for a driven one; and their parts: body k owns the parts from `first[k]`
    to `first[k + 1]`, at `offset` (p, 2) from its centre when its angle is zero. `turning` says
    whether the axes of the parts matter."""

    position: np.ndarray
    velocity: np.ndarray
    angle: np.ndarray
    spin: np.ndarray
    mobility: np.ndarray
    turnability: np.ndarray
    first: np.ndarray
    offset: np.ndarray
    turning: bool


class Box(NamedTuple):
    """Four walls, infinitely far where there is none: x of left and right, y of bottom and top."""

    at: np.ndarray


@overload(forget)
def _forget(shape, stretch, memory, k):
    if shape.instance_class not in PLANAR:
        return None

    def forget_stretch(shape, stretch, memory, k):
        stretch[k, 0] = 0.0

    return forget_stretch


@overload(met_forces)
def _met_forces(shape, scene, radius, law, time_step, pairs, meetings, begin, end, force):
    return _planar_forces if shape.instance_class in PLANAR else None


def _planar_forces(shape, scene, radius, law, time_step, pairs, meetings, begin, end, force):
    place, move, axis = scene
    _, _, stretches, memory, spring, dashpot = pairs
    meet(shape, place, axis, memory, meetings, begin, end)
    pair, one, other, depths, nxs, nys, alongs, acrosses = meetings
    energy, deepest = 0.0, 0.0
    for m in range(begin, end):
        k, i, j = pair[m], one[m], other[m]
        depth = depths[m]
        if depth <= 0.0:
            stretches[k, 0] = 0.0
            continue
        nx, ny, along, across = nxs[m], nys[m], alongs[m], acrosses[m]
        dx, dy = place[j, 0] - place[i, 0], place[j, 1] - place[i, 1]
        other_along = dx * nx + dy * ny - along
        other_across = across + dx * ny - dy * nx
        vx, vy = move[j, 0] - move[i, 0], move[j, 1] - move[i, 1]
        spin, other_spin = move[i, 2], move[j, 2]
        longer = 0.5 * law.reach * depth
        parting = vx * nx + vy * ny + spin * across - other_spin * other_across
        slip = vy * nx - vx * ny - spin * (along + longer) - other_spin * (other_along + longer)
        push, pull, stretches[k, 0], elastic = contact_force(
            law, spring[k], dashpot[k], depth, parting, slip, stretches[k, 0], time_step
        )
        px, py = -push * nx - pull * ny, -push * ny + pull * nx
        force[i, 0] += px
        force[i, 1] += py
        force[i, 2] += pull * along + push * across
        force[j, 0] -= px
        force[j, 1] -= py
        force[j, 2] += pull * other_along - push * other_across
        energy += elastic
        smaller = min(radius[i], radius[j])
        if depth > deepest * smaller:
            deepest = depth / smaller
    return energy, deepest


@overload(wall_forces)
def _wall_forces(shape, scene, radius, law, time_step, walls, pairs, begin, end, force, load):
    return _box_forces if walls.instance_class is Box else None


def _box_forces(shape, scene, radius, law, time_step, walls, pairs, begin, end, force, load):
    """The law's reach lengthens the arm of the torque as well, as LAMMPS has it at walls.

    `load` is the push on each wall.
    """
    place, move, axis = scene
    part, wall, stretches, _, spring, dashpot = pairs
    at = walls.at
    energy, deepest = 0.0, 0.0
    for k in range(begin, end):
        i, w = part[k], wall[k]
        side = 1.0 if w % 2 else -1.0
        nx, ny = (side, 0.0) if w < 2 else (0.0, side)
        room = side * (at[w] - place[i, w // 2])
        depth, along, across = wall_touch(shape, i, room, nx, ny, axis)
        if depth <= 0.0:
            stretches[k, 0] = 0.0
            continue
        spin, arm = move[i, 2], along + 0.5 * law.reach * depth
        parting = spin * across - move[i, 0] * nx - move[i, 1] * ny
        slip = move[i, 0] * ny - move[i, 1] * nx - spin * arm
        push, pull, stretches[k, 0], elastic = contact_force(
            law, spring[k], dashpot[k], depth, parting, slip, stretches[k, 0], time_step
        )
        force[i, 0] += -push * nx - pull * ny
        force[i, 1] += -push * ny + pull * nx
        force[i, 2] += pull * arm + push * across
        load[w] += push
        energy += elastic
        deepest = max(deepest, depth / radius[i])
    return energy, deepest


@overload(near_walls)
def _near_walls(parts, place, skin, law, walls, old):
    return _box_neighbours if walls.instance_class is Box else None


def _box_neighbours(parts, place, skin, law, walls, old):
    bound, _, mass, _ = parts
    n = len(bound)
    at = walls.at
    part, wall = np.empty(4 * n, np.int32), np.empty(4 * n, np.int32)
    count = 0
    for i in range(n):
        for w in range(4):
            room = at[w] - place[i, w // 2]
            if w % 2 == 0:
                room = -room
            if room < bound[i] + 0.5 * skin and mass[i] < np.inf:
                part[count], wall[count] = i, w
                count += 1
    return remembered_walls(parts, law, part[:count].copy(), wall[:count].copy(), old, 4)


@overload(drift)
def _drift(bodies, scene, forces, kick, time_step, damping, low, high, origin):
    return _planar_drift if bodies.instance_class is Bodies else None


def _planar_drift(bodies, scene, forces, kick, time_step, damping, low, high, origin):
    place, move, axis = scene
    position, velocity, angle, spins, mobility, turnability, first, offset, turning = bodies
    force = forces[0]
    farthest = 0.0
    for k in range(low, high):
        fx, fy, torque = _on_body(first, position, place, force, k)
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
def _on_body(first, position, place, force, k):
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


@overload(bind)
def _bind(bodies, force):
    if bodies.instance_class is not Bodies:
        return None

    def nothing(bodies, force):
        pass

    return nothing


@overload(gathered)
def _gathered(bodies, scene, force, k):
    if bodies.instance_class is not Bodies:
        return None

    def on_body(bodies, scene, force, k):
        return _on_body(bodies.first, bodies.position, scene.place, force, k)

    return on_body


@overload(close)
def _close(bodies, scene, force, kick):
    return _planar_close if bodies.instance_class is Bodies else None


def _planar_close(bodies, scene, force, kick):
    position, velocity, _, spins, mobility, turnability, first, _, _ = bodies
    place = scene.place
    for k in range(len(spins)):
        fx, fy, torque = _on_body(first, position, place, force, k)
        velocity[k, 0] += kick * fx * mobility[k]
        velocity[k, 1] += kick * fy * mobility[k]
        spins[k] += kick * torque * turnability[k]


@overload(kinetic)
def _kinetic(bodies, scene, force, kick):
    return _planar_kinetic if bodies.instance_class is Bodies else None


def _planar_kinetic(bodies, scene, force, kick):
    position, velocity, _, spins, mobility, turnability, first, _, _ = bodies
    place, energy = scene.place, 0.0
    for k in range(len(spins)):
        fx, fy, torque = _on_body(first, position, place, force, k)
        if mobility[k] > 0.0:
            vx = velocity[k, 0] + kick * fx * mobility[k]
            vy = velocity[k, 1] + kick * fy * mobility[k]
            energy += 0.5 * (vx * vx + vy * vy) / mobility[k]
        if turnability[k] > 0.0:
            spin = spins[k] + kick * torque * turnability[k]
            energy += 0.5 * spin * spin / turnability[k]
    return energy


@overload(inside)
def _inside(walls, place):
    return _in_box if walls.instance_class is Box else None


def _in_box(walls, place):
    at = walls.at
    for i in range(len(place)):
        if place[i, 0] < at[0] or place[i, 0] > at[1]:
            return ESCAPED
        if place[i, 1] < at[2] or place[i, 1] > at[3]:
            return ESCAPED
    return FINE
