"""Spheres about the points of a grid, and how much of a grain or of a branch lies in each.

A window is a sphere. It weighs a grain by the volume that the two have in common, and a branch (the
line between two grains in contact) by the share of its length inside: both in closed form. The
sums are over all windows along y, for nothing but chance depends on it.
"""

import numpy as np

from liftdrag.dem.compiled import compiled


@compiled()
def common_volume(distance, radius, grain):
    """Volume (m^3) that two spheres of these radii (m) share at a distance (m)."""
    if distance >= radius + grain:
        return 0.0
    smaller = min(radius, grain)
    if distance <= abs(radius - grain):
        return 4.0 * np.pi / 3.0 * smaller**3
    reach = radius + grain - distance
    lens = distance * (distance + 2.0 * (radius + grain)) - 3.0 * (radius - grain) ** 2
    return np.pi * reach**2 * lens / (12.0 * distance)


@compiled()
def share_inside(x, y, z, bx, by, bz, radius):
    """Share of the branch b from (x, y, z), all in m, inside a sphere about the origin."""
    a = bx * bx + by * by + bz * bz
    half = x * bx + y * by + z * bz
    c = x * x + y * y + z * z - radius * radius
    root = half * half - a * c
    if root <= 0.0 or a == 0.0:
        return 0.0
    root = np.sqrt(root)
    begin, end = (-half - root) / a, (-half + root) / a
    return max(0.0, min(end, 1.0) - max(begin, 0.0))


@compiled()
def spread_grains(position, velocity, grain, radius, origin, step, shape, out):
    """Add to `out` (nx, nz, 10): common volumes (m^3), times velocity, times its products.

    `position` and `velocity` (n, 3) of grains of radius `grain`; `origin`, `step` and `shape` (3,)
    of the grid, periodic in x and y. The products are xx, yy, zz, xy, xz and yz.
    """
    reach = radius + grain
    weights = np.empty(10)
    for k in range(len(position)):
        p, v = position[k], velocity[k]
        weights[:] = (
            1.0,
            v[0],
            v[1],
            v[2],
            v[0] * v[0],
            v[1] * v[1],
            v[2] * v[2],
            v[0] * v[1],
            v[0] * v[2],
            v[1] * v[2],
        )
        low = np.ceil((p - reach - origin) / step)
        high = np.floor((p + reach - origin) / step)
        for i in range(int(low[0]), int(high[0]) + 1):
            x = p[0] - origin[0] - i * step[0]
            for m in range(max(int(low[2]), 0), min(int(high[2]), shape[2] - 1) + 1):
                z = p[2] - origin[2] - m * step[2]
                volume = 0.0
                for j in range(int(low[1]), int(high[1]) + 1):
                    y = p[1] - origin[1] - j * step[1]
                    volume += common_volume(np.sqrt(x * x + y * y + z * z), radius, grain)
                out[i % shape[0], m] += volume * weights


@compiled()
def spread_branches(start, branch, force, radius, origin, step, shape, out):
    """Add to `out` (nx, nz, 9) the share of each branch inside, times force (x) branch, in J.

    A branch (n, 3) leads from `start` (n, 3), along which the `force` (n, 3) is passed on; the
    grid is as for `spread_grains`. Component 3 a + b is force a times branch b.
    """
    for k in range(len(start)):
        p, b, f = start[k], branch[k], force[k]
        low = np.ceil((np.minimum(p, p + b) - radius - origin) / step)
        high = np.floor((np.maximum(p, p + b) + radius - origin) / step)
        for i in range(int(low[0]), int(high[0]) + 1):
            x = p[0] - origin[0] - i * step[0]
            for m in range(max(int(low[2]), 0), min(int(high[2]), shape[2] - 1) + 1):
                z = p[2] - origin[2] - m * step[2]
                share = 0.0
                for j in range(int(low[1]), int(high[1]) + 1):
                    y = p[1] - origin[1] - j * step[1]
                    share += share_inside(x, y, z, b[0], b[1], b[2], radius)
                if share > 0.0:
                    cell = out[i % shape[0], m]
                    for row in range(3):
                        for column in range(3):
                            cell[3 * row + column] += share * f[row] * b[column]
