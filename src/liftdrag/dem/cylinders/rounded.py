"""Where a sphere touches another, or a cylinder: at the point that is nearest to its centre."""

from __future__ import annotations

from math import sqrt

from liftdrag.dem.compiled import compiled
from liftdrag.dem.cylinders.kinds import BAND_SPHERE, EDGE_SPHERE, FACE_SPHERE, SPHERES
from liftdrag.dem.cylinders.meeting import across


@compiled(inline=True)
def direction(x, y, z):
    """The length of a vector and its direction, z of none."""
    size = sqrt(x * x + y * y + z * z)
    return (size, x / size, y / size, z / size) if size > 0.0 else (0.0, 0.0, 0.0, 1.0)


@compiled(inline=True)
def outward(r, a, x, z):
    """Type, distance and normal (x, z) from a cylinder about z to a point at x, z >= 0.

    The distance is negative inside, from the nearer of face and band.
    """
    beside, above = x - r, z - a
    if beside > 0.0 and above > 0.0:
        away = sqrt(beside * beside + above * above)
        return EDGE_SPHERE, away, beside / away, above / away
    if above >= beside:
        return FACE_SPHERE, above, 0.0, 1.0
    return BAND_SPHERE, beside, 1.0, 0.0


@compiled()
def on_cylinder(place, i, j, dx, dy, dz):
    """The contact of cylinder i and sphere j, as `meeting` has it."""
    ux, uy, uz = place[i, 3], place[i, 4], place[i, 5]
    along = ux * dx + uy * dy + uz * dz
    if along < 0.0:
        ux, uy, uz, along = -ux, -uy, -uz, -along
    _, x, y, z = across(ux, uy, uz, 0.0, 0.0, 0.0, dx, dy, dz)
    kind, gap, out, up = outward(place[i, 6], place[i, 7], x * dx + y * dy + z * dz, along)
    nx, ny, nz = out * x + up * ux, out * y + up * uy, out * z + up * uz
    depth = place[j, 6] - gap
    arm = place[j, 6] - 0.5 * depth
    return depth, kind, nx, ny, nz, dx - arm * nx, dy - arm * ny, dz - arm * nz


@compiled()
def rounded(place, i, j, dx, dy, dz):
    """The contact of grains i and j, d apart, one of which is a sphere, as `meeting` has it."""
    if place[i, 7] > 0.0:
        return on_cylinder(place, i, j, dx, dy, dz)
    if place[j, 7] > 0.0:
        depth, kind, nx, ny, nz, px, py, pz = on_cylinder(place, j, i, -dx, -dy, -dz)
        return depth, kind, -nx, -ny, -nz, dx + px, dy + py, dz + pz
    away, nx, ny, nz = direction(dx, dy, dz)
    depth = place[i, 6] + place[j, 6] - away
    arm = place[i, 6] - 0.5 * depth
    return depth, SPHERES, nx, ny, nz, arm * nx, arm * ny, arm * nz
