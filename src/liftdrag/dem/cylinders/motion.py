"""How cylinders move: velocity Verlet, with the free turning of a symmetric top in closed form.

A free top turns about its angular momentum L at the rate |L| over its moment of inertia across
the axis; that moves the axis exactly, and torques change L at once, so that the scheme is
symplectic and of second order. Velocities in the contacts are those half a step before.
"""

from __future__ import annotations

from math import cos, sin, sqrt

from liftdrag.dem.compiled import compiled

TINY = 1e-300

SMALL = 0.05
"""Angle (rad) below which sine and cosine are those of a series, exact to rounding."""


@compiled(inline=True)
def turning(square):
    """Sine over angle, and one minus cosine over its square, from the square of the angle."""
    if square < SMALL * SMALL:
        return (
            1.0 - square / 6.0 * (1.0 - square / 20.0 * (1.0 - square / 42.0)),
            0.5 - square / 24.0 * (1.0 - square / 30.0 * (1.0 - square / 56.0)),
        )
    angle = sqrt(square)
    return sin(angle) / angle, (1.0 - cos(angle)) / square


@compiled(inline=True)
def turned(ux, uy, uz, x, y, z):
    """A unit vector turned by the vector of an angle (rad), or none."""
    sine, cosine = turning(x * x + y * y + z * z)
    px, py, pz = y * uz - z * uy, z * ux - x * uz, x * uy - y * ux
    qx, qy, qz = y * pz - z * py, z * px - x * pz, x * py - y * px
    ux += sine * px + cosine * qx
    uy += sine * py + cosine * qy
    uz += sine * pz + cosine * qz
    scale = 1.0 / sqrt(max(ux * ux + uy * uy + uz * uz, TINY))
    return ux * scale, uy * scale, uz * scale


@compiled(inline=True)
def set_spin(place, move, ease, i):
    """The spin of grain i from its angular momentum and axis."""
    along = move[i, 3] * place[i, 3] + move[i, 4] * place[i, 4] + move[i, 5] * place[i, 5]
    for a in range(3):
        move[i, 6 + a] = ease[i, 1] * move[i, 3 + a] + ease[i, 2] * along * place[i, 3 + a]


@compiled(inline=True)
def turn(place, move, angle, i):
    """Turn the axis of grain i about its angular momentum, by this times that (rad)."""
    place[i, 3], place[i, 4], place[i, 5] = turned(
        place[i, 3],
        place[i, 4],
        place[i, 5],
        angle * move[i, 3],
        angle * move[i, 4],
        angle * move[i, 5],
    )


@compiled(inline=True)
def farthest_of(place, origin, slide, middle, i):
    """The farthest that a point of grain i is from where it was, less what slides with its y."""
    x = place[i, 0] - origin[i, 0] - slide * (origin[i, 1] - middle)
    y, z = place[i, 1] - origin[i, 1], place[i, 2] - origin[i, 2]
    tilted = 0.0
    for a in range(3, 6):
        tilted += (place[i, a] - origin[i, a]) ** 2
    reach = place[i, 6] * place[i, 6] + place[i, 7] * place[i, 7]
    return sqrt(x * x + y * y + z * z) + sqrt(tilted * reach)


@compiled()
def drift(place, move, ease, force, origin, time_step, slide, middle, low, high):
    """Kick the grains low to high by half a step, and move them by one.

    `place` (n, 8) position, axis, radius and half length; `move` (n, 9) velocity, angular
    momentum and spin; `ease` (n, 3) one over the mass, one over the moment of inertia across,
    and what one over that about the axis has more; `force` (n, 6) force and torque. Returns the
    farthest that a point of a grain is from its `origin` (n, 8), less what slides: `slide` m
    along x for each m of y above the middle.
    """
    half, farthest = 0.5 * time_step, 0.0
    for i in range(low, high):
        for a in range(3):
            move[i, a] += half * ease[i, 0] * force[i, a]
            move[i, 3 + a] += half * force[i, 3 + a]
            place[i, a] += time_step * move[i, a]
        turn(place, move, time_step * ease[i, 1], i)
        set_spin(place, move, ease, i)
        farthest = max(farthest, farthest_of(place, origin, slide, middle, i))
    return farthest


@compiled()
def settle(place, move, ease, force, fresh, kick, low, high):
    """Sum the `fresh` forces (b, n, 6) over b into those of the grains low to high, and kick them.

    By `kick` (s), half a step. The fresh forces are cleared.
    """
    for i in range(low, high):
        for a in range(6):
            total = 0.0
            for b in range(len(fresh)):
                total += fresh[b, i, a]
                fresh[b, i, a] = 0.0
            move[i, a] += kick * (ease[i, 0] if a < 3 else 1.0) * total
            force[i, a] = total
        set_spin(place, move, ease, i)


KINETIC = 11
"""Numbers that `add_kinetic` adds to."""


@compiled()
def add_kinetic(place, move, ease, shear_rate, middle, low, high, sums):
    """Add energies of translation and rotation, and m V V (9), of the grains low to high.

    V is the velocity less that of the shear, which is zero in the middle.
    """
    for i in range(low, high):
        mass = 1.0 / ease[i, 0]
        vx = move[i, 0] - shear_rate * (place[i, 1] - middle)
        vy, vz = move[i, 1], move[i, 2]
        sums[0] += 0.5 * mass * (vx * vx + vy * vy + vz * vz)
        for a in range(3):
            sums[1] += 0.5 * move[i, 3 + a] * move[i, 6 + a]
        sums[2] += mass * vx * vx
        sums[3] += mass * vx * vy
        sums[4] += mass * vx * vz
        sums[6] += mass * vy * vy
        sums[7] += mass * vy * vz
        sums[10] += mass * vz * vz
    sums[5], sums[8], sums[9] = sums[3], sums[4], sums[7]
