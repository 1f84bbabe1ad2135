"""The loops: from the places of the parts to the forces on them.

Each of several threads has a range of parts, whose pairs it goes through in order, and sums
into an array of its own: the same number of threads gives the same bits.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from liftdrag.dem.compiled import compiled
from liftdrag.dem.law import contact_force
from liftdrag.dem.shapes import meet, wall_touch


class Scene(NamedTuple):
    """Where the parts are: `place` (p, 3) x, y and bound; `move` (p, 3) velocity and spin;
    `axis` (p, 2) direction of the long axis."""

    place: np.ndarray
    move: np.ndarray
    axis: np.ndarray


BLOCK = 256
"""Parts whose meetings are listed and used before those of the next: they stay in the cache."""


@compiled()
def near_pairs(place, pairs, meetings, low, high, begin):
    """List the meetings of the parts low to high from `begin` on; returns their end.

    The contacts of the other pairs are forgotten.
    """
    first, other, stretch, _, _, _ = pairs
    pair, one, two = meetings.pair, meetings.one, meetings.other
    count = begin
    for i in range(low, high):
        x, y, bound = place[i, 0], place[i, 1], place[i, 2]
        for k in range(first[i], first[i + 1]):
            j = other[k]
            dx, dy = place[j, 0] - x, place[j, 1] - y
            reach = bound + place[j, 2]
            pair[count], one[count], two[count] = k, i, j
            if dx * dx + dy * dy < reach * reach:
                count += 1
            else:
                stretch[k] = 0.0
    return count


@compiled()
def pair_forces(shape, scene, radius, law, time_step, pairs, meetings, low, high, force):
    """Add the forces and torques of the pairs under the parts low to high to `force` (p, 3).

    Returns the elastic energy (J) and the largest depth over the smaller radius.
    """
    energy, deepest = 0.0, 0.0
    begin = pairs.first[low]
    for block in range(low, high, BLOCK):
        end = near_pairs(scene.place, pairs, meetings, block, min(block + BLOCK, high), begin)
        meet(shape, scene.place, scene.axis, pairs.memory, meetings, begin, end)
        elastic, deep = met_forces(
            scene, radius, law, time_step, pairs, meetings, begin, end, force
        )
        energy += elastic
        deepest = max(deepest, deep)
    return energy, deepest


@compiled()
def met_forces(scene, radius, law, time_step, pairs, meetings, begin, end, force):
    """Add the forces and torques of the meetings from `begin` to `end`; returns as above."""
    place, move, _ = scene
    _, _, stretches, _, spring, dashpot = pairs
    pair, one, other, depths, nxs, nys, alongs, acrosses = meetings
    energy, deepest = 0.0, 0.0
    for m in range(begin, end):
        k, i, j = pair[m], one[m], other[m]
        depth = depths[m]
        if depth <= 0.0:
            stretches[k] = 0.0
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
        push, pull, stretches[k], elastic = contact_force(
            law, spring[k], dashpot[k], depth, parting, slip, stretches[k], time_step
        )
        px, py = -push * nx - pull * ny, -push * ny + pull * nx
        force[i, 0] += px
        force[i, 1] += py
        force[i, 2] += pull * along + push * across
        force[j, 0] -= px
        force[j, 1] -= py
        force[j, 2] += pull * other_along - push * other_across
        energy += 0.4 * elastic * depth
        smaller = min(radius[i], radius[j])
        if depth > deepest * smaller:
            deepest = depth / smaller
    return energy, deepest


@compiled()
def wall_forces(shape, scene, radius, law, time_step, walls, pairs, force, load):
    """Add the forces of the walls to `force` (p, 3), and the push on each wall to `load` (4,).

    The law's reach lengthens the arm of the torque as well, as LAMMPS has it at walls.
    Returns the elastic energy (J) and the largest depth over the radius.
    """
    place, move, axis = scene
    part, wall, stretches, spring, dashpot = pairs
    energy, deepest = 0.0, 0.0
    for k in range(len(part)):
        i, w = part[k], wall[k]
        side = 1.0 if w % 2 else -1.0
        nx, ny = (side, 0.0) if w < 2 else (0.0, side)
        room = side * (walls[w] - place[i, w // 2])
        depth, along, across = wall_touch(shape, i, room, nx, ny, axis)
        if depth <= 0.0:
            stretches[k] = 0.0
            continue
        spin, arm = move[i, 2], along + 0.5 * law.reach * depth
        parting = spin * across - move[i, 0] * nx - move[i, 1] * ny
        slip = move[i, 0] * ny - move[i, 1] * nx - spin * arm
        push, pull, stretch, elastic = contact_force(
            law,
            spring[k],
            dashpot[k],
            depth,
            parting,
            slip,
            stretches[k],
            time_step,
        )
        stretches[k] = stretch
        force[i, 0] += -push * nx - pull * ny
        force[i, 1] += -push * ny + pull * nx
        force[i, 2] += pull * arm + push * across
        load[w] += push
        energy += 0.4 * elastic * depth
        deepest = max(deepest, depth / radius[i])
    return energy, deepest
