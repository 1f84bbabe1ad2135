"""In space: spheres in an upright tube on a piston, with a slip across the contact.

The piston is the plane z = 0, at rest. The wall of the tube moves along its axis, x = y = 0.
"""

from __future__ import annotations

from math import sqrt
from typing import Any, NamedTuple

import numpy as np
from numba.extending import overload

from liftdrag.dem.compiled import compiled
from liftdrag.dem.forces import forget, met_forces, wall_forces
from liftdrag.dem.law import WaltonBraun, gradual_stiffness, latching_push, spring_force
from liftdrag.dem.motion import ESCAPED, FINE, bind, close, drift, gathered, inside, kinetic
from liftdrag.dem.neighbours import near_walls, remembered_walls

TUBE, PISTON = 0, 1
"""The walls."""


class Spheres(NamedTuple):
    """Spheres of `radius` (n,), m."""

    radius: np.ndarray


class Balls(NamedTuple):
    """What moves the spheres: one over mass (n,), `sideways` and upward (`mobility`), zero where
    one may not move so, one over inertia (n,), and `gravity` downward (n,), m/s^2. Those in `lid`
    (m,), of equal mass, move as one."""

    mobility: np.ndarray
    sideways: np.ndarray
    turnability: np.ndarray
    gravity: np.ndarray
    lid: np.ndarray


class TubeWalls(NamedTuple):
    """The tube's inner `radius` (m), its velocity `lift` (m/s) upward, and what rubs on both."""

    radius: float
    lift: float
    tube_friction: float
    piston_friction: float


def touch(
    law: Any,
    friction: float,
    spring: float,
    dashpot: float,
    depth: float,
    parting: float,
    normal: Any,
    slip: Any,
    stretch: Any,
    memory: Any,
    k: int,
    time_step: float,
) -> Any:
    """Push (N), pull (N, 3) along the slip, and stored energy (J) of contact k.

    `normal` (3) and `slip` (3, m/s) across it; changes what `stretch` and `memory` hold of it.
    """
    raise NotImplementedError("this is compiled")


@overload(touch)
def _touch(
    law, friction, spring, dashpot, depth, parting, normal, slip, stretch, memory, k, time_step
):
    return _latching_touch if law.instance_class is WaltonBraun else _spring_touch


def _spring_touch(
    law, friction, spring, dashpot, depth, parting, normal, slip, stretch, memory, k, time_step
):
    push, stored, stiffness, resistance = spring_force(law, spring, dashpot, depth, parting)
    x, y, z = turned_across(stretch[k, 0], stretch[k, 1], stretch[k, 2], normal)
    x, y, z = x + slip[0] * time_step, y + slip[1] * time_step, z + slip[2] * time_step
    px = stiffness * x + resistance * slip[0]
    py = stiffness * y + resistance * slip[1]
    pz = stiffness * z + resistance * slip[2]
    limit, size = friction * abs(push), px * px + py * py + pz * pz
    if size > limit * limit:
        share = limit / sqrt(size)
        px, py, pz = px * share, py * share, pz * share
        x = (px - resistance * slip[0]) / stiffness
        y = (py - resistance * slip[1]) / stiffness
        z = (pz - resistance * slip[2]) / stiffness
    stretch[k, 0], stretch[k, 1], stretch[k, 2] = x, y, z
    return push, px, py, pz, stored


def _latching_touch(
    law, friction, spring, dashpot, depth, parting, normal, slip, stretch, memory, k, time_step
):
    """The memory: deepest overlap (m), drag at the last reversal (N), negative while it falls.

    Beyond the limit the drag has the direction of one that is as stiff along as across.
    """
    deepest, reversal, falling = memory[k, 0], memory[k, 1], memory[k, 2] < 0.0
    push = latching_push(law, depth, deepest)
    limit = friction * push
    x, y, z = turned_across(stretch[k, 0], stretch[k, 1], stretch[k, 2], normal)
    sx, sy, sz = slip[0] * time_step, slip[1] * time_step, slip[2] * time_step
    stiff = law.tangential
    tx, ty, tz = x + stiff * sx, y + stiff * sy, z + stiff * sz
    drag, way = sqrt(x * x + y * y + z * z), sqrt(sx * sx + sy * sy + sz * sz)
    if way > 0.0:
        ux, uy, uz = sx / way, sy / way, sz / way
        if drag > 0.0:
            ux, uy, uz = x / drag, y / drag, z / drag
        along = sx * ux + sy * uy + sz * uz
        if (along < 0.0) != falling:
            reversal, falling = drag, along < 0.0
        held = drag + gradual_stiffness(law, drag, reversal, not falling, limit) * along
        x = held * ux + stiff * (sx - along * ux)
        y = held * uy + stiff * (sy - along * uy)
        z = held * uz + stiff * (sz - along * uz)
        if held < 0.0:
            reversal, falling = -reversal, False
    trial = tx * tx + ty * ty + tz * tz
    if x * x + y * y + z * z > limit * limit and trial > 0.0:
        share = limit / sqrt(trial)
        x, y, z = tx * share, ty * share, tz * share
    stretch[k, 0], stretch[k, 1], stretch[k, 2] = x, y, z
    memory[k, 0], memory[k, 1] = max(deepest, depth), reversal
    memory[k, 2] = -1.0 if falling else 1.0
    return push, x, y, z, 0.5 * push * push / law.unloading


@compiled(inline=True)
def turned_across(x, y, z, normal):
    """A vector across a contact, turned with it: across its new normal, as long as it was."""
    off = x * normal[0] + y * normal[1] + z * normal[2]
    before = x * x + y * y + z * z
    after = before - off * off
    if off == 0.0 or after <= 0.0:
        return x, y, z
    scale = sqrt(before / after)
    return (
        (x - off * normal[0]) * scale,
        (y - off * normal[1]) * scale,
        (z - off * normal[2]) * scale,
    )


@overload(forget)
def _forget(shape, stretch, memory, k):
    if shape.instance_class is not Spheres:
        return None

    def forget_all(shape, stretch, memory, k):
        stretch[k, 0], stretch[k, 1], stretch[k, 2] = 0.0, 0.0, 0.0
        memory[k, 0], memory[k, 1], memory[k, 2] = 0.0, 0.0, 0.0

    return forget_all


@compiled(inline=True)
def pair_contact(place, move, radius, law, k, i, j, pairs, time_step):
    """Contact k of spheres i and j: depth, normal from i to j, push, pull on i, energy."""
    _, _, stretch, memory, spring, dashpot = pairs
    dx, dy, dz = place[j, 0] - place[i, 0], place[j, 1] - place[i, 1], place[j, 2] - place[i, 2]
    distance = sqrt(dx * dx + dy * dy + dz * dz)
    scale = 1.0 / distance
    nx, ny, nz = dx * scale, dy * scale, dz * scale
    depth = radius[i] + radius[j] - distance
    vx, vy, vz = move[j, 0] - move[i, 0], move[j, 1] - move[i, 1], move[j, 2] - move[i, 2]
    parting = vx * nx + vy * ny + vz * nz
    shorter = 0.5 * (1.0 - law.reach) * depth
    one, two = radius[i] - shorter, radius[j] - shorter
    wx = one * move[i, 3] + two * move[j, 3]
    wy = one * move[i, 4] + two * move[j, 4]
    wz = one * move[i, 5] + two * move[j, 5]
    sx = vx - parting * nx - (wy * nz - wz * ny)
    sy = vy - parting * ny - (wz * nx - wx * nz)
    sz = vz - parting * nz - (wx * ny - wy * nx)
    push, px, py, pz, stored = touch(
        law,
        law.friction,
        spring[k],
        dashpot[k],
        depth,
        parting,
        (nx, ny, nz),
        (sx, sy, sz),
        stretch,
        memory,
        k,
        time_step,
    )
    return depth, nx, ny, nz, push, px, py, pz, stored


@overload(met_forces)
def _met_forces(shape, scene, radius, law, time_step, pairs, meetings, begin, end, force):
    return _sphere_forces if shape.instance_class is Spheres else None


def _sphere_forces(shape, scene, radius, law, time_step, pairs, meetings, begin, end, force):
    place, move, _ = scene
    pair, ones, others, _, _, _, _, _ = meetings
    energy, deepest = 0.0, 0.0
    for m in range(begin, end):
        k, i, j = pair[m], ones[m], others[m]
        depth, nx, ny, nz, push, px, py, pz, stored = pair_contact(
            place, move, radius, law, k, i, j, pairs, time_step
        )
        qx, qy, qz = ny * pz - nz * py, nz * px - nx * pz, nx * py - ny * px
        fx, fy, fz = px - push * nx, py - push * ny, pz - push * nz
        one, other = radius[i] - 0.5 * depth, radius[j] - 0.5 * depth
        force[i, 0] += fx
        force[i, 1] += fy
        force[i, 2] += fz
        force[i, 3] += one * qx
        force[i, 4] += one * qy
        force[i, 5] += one * qz
        force[j, 0] -= fx
        force[j, 1] -= fy
        force[j, 2] -= fz
        force[j, 3] += other * qx
        force[j, 4] += other * qy
        force[j, 5] += other * qz
        energy += stored
        smaller = min(radius[i], radius[j])
        if depth > deepest * smaller:
            deepest = depth / smaller
    return energy, deepest


@compiled(inline=True)
def wall_contact(place, move, radius, law, walls, k, i, w, pairs, time_step):
    """Contact k of sphere i with wall w, as `pair_contact` has it; not deep when apart."""
    _, _, stretch, memory, spring, dashpot = pairs
    x, y, z = place[i, 0], place[i, 1], place[i, 2]
    nx, ny, nz, lift, room, friction = 0.0, 0.0, -1.0, 0.0, z, walls.piston_friction
    if w == TUBE:
        away = sqrt(x * x + y * y)
        nx, ny, nz = (x / away, y / away, 0.0) if away > 0.0 else (1.0, 0.0, 0.0)
        lift, room, friction = walls.lift, walls.radius - away, walls.tube_friction
    depth = radius[i] - room
    if depth <= 0.0:
        stretch[k, 0], stretch[k, 1], stretch[k, 2] = 0.0, 0.0, 0.0
        memory[k, 0], memory[k, 1], memory[k, 2] = 0.0, 0.0, 0.0
        return depth, nx, ny, nz, 0.0, 0.0, 0.0, 0.0, 0.0
    vx, vy, vz = -move[i, 0], -move[i, 1], lift - move[i, 2]
    parting = vx * nx + vy * ny + vz * nz
    arm = radius[i] - (1.0 - law.reach) * depth
    wx, wy, wz = arm * move[i, 3], arm * move[i, 4], arm * move[i, 5]
    sx = vx - parting * nx - (wy * nz - wz * ny)
    sy = vy - parting * ny - (wz * nx - wx * nz)
    sz = vz - parting * nz - (wx * ny - wy * nx)
    push, px, py, pz, stored = touch(
        law,
        friction,
        spring[k],
        dashpot[k],
        depth,
        parting,
        (nx, ny, nz),
        (sx, sy, sz),
        stretch,
        memory,
        k,
        time_step,
    )
    return depth, nx, ny, nz, push, px, py, pz, stored


@overload(wall_forces)
def _wall_forces(shape, scene, radius, law, time_step, walls, pairs, begin, end, force, load):
    return _tube_forces if walls.instance_class is TubeWalls else None


def _tube_forces(shape, scene, radius, law, time_step, walls, pairs, begin, end, force, load):
    """`load`: on the piston downward; of the tube on the grains, upward; across the tube (N)."""
    place, move, _ = scene
    part, wall, _, _, _, _ = pairs
    energy, deepest = 0.0, 0.0
    for k in range(begin, end):
        i, w = part[k], wall[k]
        depth, nx, ny, nz, push, px, py, pz, stored = wall_contact(
            place, move, radius, law, walls, k, i, w, pairs, time_step
        )
        if depth <= 0.0:
            continue
        arm = radius[i] - (1.0 - law.reach) * depth
        force[i, 0] += px - push * nx
        force[i, 1] += py - push * ny
        force[i, 2] += pz - push * nz
        force[i, 3] += arm * (ny * pz - nz * py)
        force[i, 4] += arm * (nz * px - nx * pz)
        force[i, 5] += arm * (nx * py - ny * px)
        if w == PISTON:
            load[0] += push
        else:
            load[1] += pz
            load[2] += push
        energy += stored
        deepest = max(deepest, depth / radius[i])
    return energy, deepest


@overload(near_walls)
def _near_walls(parts, place, skin, law, walls, old):
    return _tube_neighbours if walls.instance_class is TubeWalls else None


def _tube_neighbours(parts, place, skin, law, walls, old):
    bound, _, _, _ = parts
    n = len(bound)
    part, wall = np.empty(2 * n, np.int32), np.empty(2 * n, np.int32)
    count = 0
    for i in range(n):
        reach = bound[i] + 0.5 * skin
        x, y = place[i, 0], place[i, 1]
        if sqrt(x * x + y * y) > walls.radius - reach:
            part[count], wall[count] = i, TUBE
            count += 1
        if place[i, 2] < reach:
            part[count], wall[count] = i, PISTON
            count += 1
    return remembered_walls(parts, law, part[:count].copy(), wall[:count].copy(), old, 2)


@overload(drift)
def _drift(bodies, scene, forces, kick, time_step, damping, low, high, origin):
    return _sphere_drift if bodies.instance_class is Balls else None


def _sphere_drift(bodies, scene, forces, kick, time_step, damping, low, high, origin):
    mobility, sideways, turnability, gravity, _ = bodies
    place, move, _ = scene
    force = forces[0]
    farthest = 0.0
    for k in range(low, high):
        level, turn = kick * sideways[k], kick * turnability[k]
        vx = damping * (move[k, 0] + level * force[k, 0])
        vy = damping * (move[k, 1] + level * force[k, 1])
        vz = damping * (move[k, 2] + kick * (mobility[k] * force[k, 2] - gravity[k]))
        move[k, 0], move[k, 1], move[k, 2] = vx, vy, vz
        for a in range(3, 6):
            move[k, a] = damping * (move[k, a] + turn * force[k, a])
        place[k, 0] += vx * time_step
        place[k, 1] += vy * time_step
        place[k, 2] += vz * time_step
        dx, dy, dz = (
            place[k, 0] - origin[k, 0],
            place[k, 1] - origin[k, 1],
            place[k, 2] - origin[k, 2],
        )
        farthest = max(farthest, dx * dx + dy * dy + dz * dz)
        for a in range(6):
            force[k, a] = 0.0
    return farthest


@overload(bind)
def _bind(bodies, force):
    return _bind_lid if bodies.instance_class is Balls else None


def _bind_lid(bodies, force):
    lid, total = bodies.lid, 0.0
    for k in lid:
        total += force[k, 2]
    for k in lid:
        force[k, 2] = total / len(lid)


@overload(gathered)
def _gathered(bodies, scene, force, k):
    if bodies.instance_class is not Balls:
        return None

    def nothing(bodies, scene, force, k):
        return 0.0, 0.0, 0.0

    return nothing


@overload(close)
def _close(bodies, scene, force, kick):
    return _sphere_close if bodies.instance_class is Balls else None


def _sphere_close(bodies, scene, force, kick):
    mobility, sideways, turnability, gravity, _ = bodies
    move = scene.move
    for k in range(len(mobility)):
        move[k, 0] += kick * sideways[k] * force[k, 0]
        move[k, 1] += kick * sideways[k] * force[k, 1]
        move[k, 2] += kick * (mobility[k] * force[k, 2] - gravity[k])
        for a in range(3, 6):
            move[k, a] += kick * turnability[k] * force[k, a]


@overload(kinetic)
def _kinetic(bodies, scene, force, kick):
    return _sphere_kinetic if bodies.instance_class is Balls else None


def _sphere_kinetic(bodies, scene, force, kick):
    mobility, sideways, turnability, gravity, _ = bodies
    move, energy = scene.move, 0.0
    for k in range(len(mobility)):
        vx = move[k, 0] + kick * sideways[k] * force[k, 0]
        vy = move[k, 1] + kick * sideways[k] * force[k, 1]
        vz = move[k, 2] + kick * (mobility[k] * force[k, 2] - gravity[k])
        energy += 0.5 * (vx * vx + vy * vy + vz * vz) / mobility[k]
        if turnability[k] > 0.0:
            for a in range(3, 6):
                spin = move[k, a] + kick * turnability[k] * force[k, a]
                energy += 0.5 * spin * spin / turnability[k]
    return energy


@overload(inside)
def _inside(walls, place):
    return _in_tube if walls.instance_class is TubeWalls else None


def _in_tube(walls, place):
    for i in range(len(place)):
        x, y = place[i, 0], place[i, 1]
        if place[i, 2] < 0.0 or x * x + y * y > walls.radius * walls.radius:
            return ESCAPED
    return FINE
