"""The loop over the pairs: from where the cylinders are to the forces on them."""

from __future__ import annotations

from math import sqrt

from liftdrag.dem.compiled import compiled
from liftdrag.dem.cylinders.kinds import APART, KINDS
from liftdrag.dem.cylinders.meeting import meeting
from liftdrag.dem.cylinders.rounded import rounded
from liftdrag.dem.law import spring_force

ELASTIC, STRESS, DEEPEST, COUNTS, JUMPS, TALLIES = 0, 1, 10, 11, 11 + len(KINDS), 12 + len(KINDS)
"""Places of what is summed over contacts: energy, F l (9), the largest depth over the smaller
radius or half length, contacts by type, and those whose normal jumped."""

JUMP = 0.98
"""Cosine of the angle by which a normal turns within one step when it jumps."""


@compiled(inline=True)
def overlap_along(place, i, j, dx, dy, dz, nx, ny, nz):
    """The overlap (m) of two cylinders along a direction: not positive where it separates them."""
    u = abs(nx * place[i, 3] + ny * place[i, 4] + nz * place[i, 5])
    w = abs(nx * place[j, 3] + ny * place[j, 4] + nz * place[j, 5])
    one = place[i, 7] * u + place[i, 6] * sqrt(max(1.0 - u * u, 0.0))
    two = place[j, 7] * w + place[j, 6] * sqrt(max(1.0 - w * w, 0.0))
    return one + two - nx * dx - ny * dy - nz * dz


@compiled(inline=True)
def contact_of(place, i, j, dx, dy, dz):
    """The contact of grains i and j, d apart, as `meeting` has it."""
    if place[i, 7] * place[j, 7] == 0.0:
        return rounded(place, i, j, dx, dy, dz)
    return meeting(
        place[i, 6],
        place[i, 7],
        place[j, 6],
        place[j, 7],
        dx,
        dy,
        dz,
        place[i, 3],
        place[i, 4],
        place[i, 5],
        place[j, 3],
        place[j, 4],
        place[j, 5],
    )


@compiled(inline=True)
def parting(move, i, j, slide, nx, ny, nz, px, py, pz, qx, qy, qz):
    """How fast j leaves i along n at a point p from i's centre and q from j's; slide is j's."""
    vx = move[j, 0] + slide - move[i, 0]
    vx += move[j, 7] * qz - move[j, 8] * qy - move[i, 7] * pz + move[i, 8] * py
    vy = move[j, 1] - move[i, 1]
    vy += move[j, 8] * qx - move[j, 6] * qz - move[i, 8] * px + move[i, 6] * pz
    vz = move[j, 2] - move[i, 2]
    vz += move[j, 6] * qy - move[j, 7] * qx - move[i, 6] * py + move[i, 7] * px
    return vx * nx + vy * ny + vz * nz


@compiled(inline=True)
def push_apart(force, i, j, fx, fy, fz, px, py, pz, qx, qy, qz):
    """Add a force on j at a point p from i's centre and q from j's, and its reaction on i."""
    force[i, 0] -= fx
    force[i, 1] -= fy
    force[i, 2] -= fz
    force[i, 3] -= py * fz - pz * fy
    force[i, 4] -= pz * fx - px * fz
    force[i, 5] -= px * fy - py * fx
    force[j, 0] += fx
    force[j, 1] += fy
    force[j, 2] += fz
    force[j, 3] += qy * fz - qz * fy
    force[j, 4] += qz * fx - qx * fz
    force[j, 5] += qx * fy - qy * fx


@compiled(inline=True)
def add_stress(tally, fx, fy, fz, dx, dy, dz):
    """Add force times the way from centre to centre."""
    tally[STRESS] += fx * dx
    tally[STRESS + 1] += fx * dy
    tally[STRESS + 2] += fx * dz
    tally[STRESS + 3] += fy * dx
    tally[STRESS + 4] += fy * dy
    tally[STRESS + 5] += fy * dz
    tally[STRESS + 6] += fz * dx
    tally[STRESS + 7] += fz * dy
    tally[STRESS + 8] += fz * dz


@compiled(inline=True)
def extent(place, i):
    """The smaller of radius and half length of a cylinder, the radius of a sphere."""
    return place[i, 6] if place[i, 7] == 0.0 else min(place[i, 6], place[i, 7])


@compiled(inline=True)
def least_extent(place, i, j):
    """The smaller extent of two grains."""
    return min(extent(place, i), extent(place, j))


@compiled()
def pair_forces(place, move, pairs, away, law, low, high, force, tally):
    """Add forces and torques of the near pairs under the grains low to high, and what is summed.

    Each pair has a direction that separated it last, tried first, or the normal that it had.
    """
    grain, first, last, _, other, image, spring, dashpot, normal, kind = pairs
    for p in range(low, high):
        i = grain[p]
        for k in range(first[p], last[p]):
            j, m = other[k], image[k]
            dx = place[j, 0] + away[m, 0] - place[i, 0]
            dy = place[j, 1] + away[m, 1] - place[i, 1]
            dz = place[j, 2] + away[m, 2] - place[i, 2]
            ox, oy, oz = normal[k, 0], normal[k, 1], normal[k, 2]
            if overlap_along(place, i, j, dx, dy, dz, ox, oy, oz) <= 0.0:
                kind[k] = APART
                continue
            depth, found, nx, ny, nz, px, py, pz = contact_of(place, i, j, dx, dy, dz)
            normal[k, 0], normal[k, 1], normal[k, 2] = nx, ny, nz
            if depth <= 0.0:
                kind[k] = APART
                continue
            qx, qy, qz = px - dx, py - dy, pz - dz
            speed = parting(move, i, j, away[m, 3], nx, ny, nz, px, py, pz, qx, qy, qz)
            push, stored, _, _ = spring_force(law, spring[k], dashpot[k], depth, speed)
            fx, fy, fz = push * nx, push * ny, push * nz
            push_apart(force, i, j, fx, fy, fz, px, py, pz, qx, qy, qz)
            add_stress(tally, fx, fy, fz, dx, dy, dz)
            tally[ELASTIC] += stored
            tally[DEEPEST] = max(tally[DEEPEST], depth / least_extent(place, i, j))
            tally[COUNTS + found] += 1.0
            if kind[k] != APART and ox * nx + oy * ny + oz * nz < JUMP:
                tally[JUMPS] += 1.0
            kind[k] = found
