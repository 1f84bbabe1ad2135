"""Where two cylinders touch: the types of Table A1 of Liu et al. 2020, Energies 13, 1841.

Each type is a direction: along the axis of one (its face on something), across the axis of one
(its band on an edge), across both (bands), or across the tangents of two edges. The overlap in a
direction n is h_1 + h_2 - r . n, with h the support function of a cylinder and r the vector from
centre to centre; no direction has a smaller one than the contact has. A direction without
overlap separates the two. A point of one that lies in the other, nowhere nearer to its surface
than where the contact is, proves that no direction is better.

All is seen from the first cylinder: z is its axis, x is across both axes, and the second is at
(x, y, z), where neither x nor z is negative, with axis (0, s, c). Neither is c negative.
"""

from __future__ import annotations

from math import sqrt

from liftdrag.dem.compiled import compiled
from liftdrag.dem.cylinders.edges import edge_to_axis, edge_to_edge, unit
from liftdrag.dem.cylinders.kinds import (
    BAND_EDGE,
    EDGE_EDGE,
    FACE_BAND,
    FACE_EDGE,
    FACE_FACE,
    PARALLEL_BANDS,
    SKEWED_BANDS,
)

PARALLEL = 1e-6
"""Sine of the angle below which two axes are parallel, and cosine of that of perpendicular ones."""

SEPARATE = 1e-6
"""Distance of two edges over a radius from which on their normal is along it."""

FAR = 1e300


@compiled(inline=True)
def proof(room, shallow):
    """The room as far as it proves anything: a contact that is not shallow has none to spare."""
    return room if shallow else min(room, 0.0)


@compiled()
def on_face(r1, a1, r2, a2, x, y, z, s, c):
    """The first one's face on the other's edge, or its band where it lies flat.

    A contact is depth, type, normal, point, and room: how far the point of the other cylinder is
    from the first one's surface elsewhere, negative when it is not over it.
    """
    depth = a1 + a2 * c + r2 * s - z
    kind, ey = FACE_EDGE, y - a2 * s + r2 * c
    if c <= PARALLEL:
        half = sqrt(max(r1 * r1 - x * x, 0.0))
        low, high = max(y - a2, -half), min(y + a2, half)
        kind, ey = FACE_BAND, 0.5 * (low + high)
        if low > high:
            ey = y - a2 if y > 0.0 else y + a2
    room = r1 - sqrt(x * x + ey * ey)
    return depth, kind, 0.0, 0.0, 1.0, x, ey, a1 - 0.5 * depth, proof(room, depth <= a1)


@compiled()
def on_band(r1, a1, r2, a2, x, y, z, s, c):
    """The first one's band on the other's edge."""
    dx, dy, rise = edge_to_axis(r2, a2, x, y, s, c)
    away = sqrt(dx * dx + dy * dy)
    if away == 0.0:
        return FAR, BAND_EDGE, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, -FAR
    nx, ny, depth, ez = dx / away, dy / away, r1 - away, z + rise
    arm = away + 0.5 * depth
    return depth, BAND_EDGE, nx, ny, 0.0, arm * nx, arm * ny, ez, a1 - abs(ez)


@compiled(inline=True)
def between_bands(r1, a1, r2, a2, x, y, z, s, c):
    """The two bands, where the axes pass each other."""
    up, on = z - y * c / s, -y / s
    one, two, depth = a1 - abs(up), a2 - abs(on), r1 + r2 - x
    room = max(one, two) if one >= 0.0 and two >= 0.0 else min(one, two)
    room = proof(room, x >= r1 and x >= r2)
    return depth, SKEWED_BANDS, 1.0, 0.0, 0.0, r1 - 0.5 * depth, 0.0, up, room


@compiled()
def between_edges(r1, a1, r2, a2, x, y, z, s, c, near):
    """The two edges that a contact is nearest to, where they are nearest to each other.

    The depth is FAR when their normal leads into one of the cylinders.
    """
    _, _, _, ny, nz, hx, hy, hz, _ = near
    px, py = unit(hx, hy)
    end = a1 if (nz if nz != 0.0 else hz) > 0.0 else -a1
    facing = ny * s + nz * c
    away = a2 if (-facing if abs(facing) > PARALLEL else (hy - y) * s + (hz - z) * c) > 0.0 else -a2
    bx, by, bz = x, y + away * s, z + away * c
    px, py, qx, qy = edge_to_edge(r1, r2, px, py, bx, by, bz - end, s, c)
    nx, ny, nz, gap = edge_normal(r1, r2, px, py, qx, qy, bx, by, bz - end, s, c)
    outward, tip = nx * px + ny * py, nx * qx + (ny * c - nz * s) * qy
    if outward + nz * end / a1 < 0.0:
        nx, ny, nz, gap, outward, tip = -nx, -ny, -nz, -gap, -outward, -tip
    middle = 0.5 * (r2 * qy * c + by + r1 * py)
    found = 0.5 * (r2 * qx + bx + r1 * px), middle, 0.5 * (bz - r2 * qy * s + end)
    if outward < 0.0 or nz * end < 0.0 or tip > 0.0 or (ny * s + nz * c) * away > 0.0:
        return FAR, EDGE_EDGE, nx, ny, nz, found[0], found[1], found[2], -FAR
    return -gap, EDGE_EDGE, nx, ny, nz, found[0], found[1], found[2], 0.0


@compiled(inline=True)
def edge_normal(r1, r2, px, py, qx, qy, x, y, z, s, c):
    """The direction across two edges, and the way along it from the first to the second."""
    dx, dy, dz = x + r2 * qx - r1 * px, y + r2 * qy * c - r1 * py, z - r2 * qy * s
    size = sqrt(dx * dx + dy * dy + dz * dz)
    if size > SEPARATE * r1:
        return dx / size, dy / size, dz / size, size
    nx, ny, nz = -px * qx * s, -py * qx * s, px * qy - py * qx * c
    size = sqrt(nx * nx + ny * ny + nz * nz)
    nx, ny, nz = nx / size, ny / size, nz / size
    return nx, ny, nz, nx * dx + ny * dy + nz * dz


@compiled(inline=True)
def mirrored(side, s, c, x, y, z):
    """A vector as the second cylinder sees it, as the first one does."""
    return -x, side * (c * y - s * z), -side * (s * y + c * z)


@compiled(inline=True)
def seen_by_first(found, side, x, y, z, s, c):
    """A contact that the second cylinder sees, as the first one does."""
    depth, kind, nx, ny, nz, px, py, pz, room = found
    nx, ny, nz = mirrored(side, s, c, nx, ny, nz)
    px, py, pz = mirrored(side, s, c, px, py, pz)
    return depth, kind, -nx, -ny, -nz, x + px, y + py, z + pz, room


@compiled(inline=True)
def decided(contact):
    """Whether a direction separates, or no other has a smaller overlap."""
    return contact[0] <= 0.0 or contact[0] <= contact[8]


@compiled(inline=True)
def shallower(one, other):
    """That of the smaller depth."""
    return other if other[0] < one[0] else one


@compiled(inline=True)
def real(contact):
    """The contact, out of reach when its point is not over the surface that it is said to be on."""
    depth, kind, nx, ny, nz, px, py, pz, room = contact
    return (depth if room >= 0.0 else FAR), kind, nx, ny, nz, px, py, pz, room


@compiled()
def skewed(r1, a1, r2, a2, x, y, z, s, c):
    """The contact of two cylinders whose axes are not parallel."""
    along = s * y + c * z
    side = 1.0 if along >= 0.0 else -1.0
    v, w = side * (s * z - c * y), abs(along)
    face = on_face(r1, a1, r2, a2, x, y, z, s, c)
    if decided(face):
        return face
    back = on_face(r2, a2, r1, a1, x, v, w, s, c)
    back = seen_by_first(back, side, x, y, z, s, c)
    if decided(back):
        return back
    bands = between_bands(r1, a1, r2, a2, x, y, z, s, c)
    if decided(bands):
        return bands
    band = on_band(r1, a1, r2, a2, x, y, z, s, c)
    if decided(band):
        return band
    under = on_band(r2, a2, r1, a1, x, v, w, s, c)
    under = seen_by_first(under, side, x, y, z, s, c)
    if decided(under):
        return under
    best = shallower(shallower(shallower(face, back), shallower(band, under)), bands)
    edges = between_edges(r1, a1, r2, a2, x, y, z, s, c, best)
    edges = shallower(edges, between_edges(r1, a1, r2, a2, x, y, z, s, c, face))
    edges = shallower(edges, between_edges(r1, a1, r2, a2, x, y, z, s, c, back))
    if edges[0] <= 0.0:
        return edges
    faces = shallower(real(face), real(back))
    sides = shallower(shallower(real(band), real(under)), real(bands))
    found = shallower(shallower(faces, sides), edges)
    return found if found[0] < FAR else best


@compiled(inline=True)
def parallel(r1, a1, r2, a2, x, z):
    """The contact of two cylinders along each other, the second at x across and z along."""
    depth, band = a1 + a2 - z, r1 + r2 - x
    if depth <= band:
        px = 0.5 * (max(-r1, x - r2) + min(r1, x + r2))
        return depth, FACE_FACE, 0.0, 0.0, 1.0, px, 0.0, a1 - 0.5 * depth, 0.0
    pz = 0.5 * (max(-a1, z - a2) + min(a1, z + a2))
    return band, PARALLEL_BANDS, 1.0, 0.0, 0.0, r1 - 0.5 * band, 0.0, pz, 0.0


@compiled(inline=True)
def across(ux, uy, uz, wx, wy, wz, dx, dy, dz):
    """The sine between two axes, and a unit vector across both, or to d across the first."""
    x, y, z = uy * wz - uz * wy, uz * wx - ux * wz, ux * wy - uy * wx
    s = sqrt(x * x + y * y + z * z)
    if s > PARALLEL:
        return s, x / s, y / s, z / s
    along = dx * ux + dy * uy + dz * uz
    x, y, z = dx - along * ux, dy - along * uy, dz - along * uz
    size = sqrt(x * x + y * y + z * z)
    if size == 0.0:
        x, y, z = (0.0, -uz, uy) if abs(ux) < 0.9 else (uz, 0.0, -ux)
        size = sqrt(x * x + y * y + z * z)
    return s, x / size, y / size, z / size


@compiled()
def meeting(r1, a1, r2, a2, dx, dy, dz, ux, uy, uz, wx, wy, wz):
    """Depth (m), type, normal and point (m) of the contact of two cylinders.

    Radii and half lengths r, a (m); d leads from the first's centre to the second's, u and w are
    their axes. The normal leads to the second, the point starts at the first's centre. Where the
    depth is not positive they are apart, and a plane across the normal is between them.
    """
    along = ux * dx + uy * dy + uz * dz
    if along < 0.0:
        ux, uy, uz, along = -ux, -uy, -uz, -along
    c = ux * wx + uy * wy + uz * wz
    if c < 0.0:
        wx, wy, wz, c = -wx, -wy, -wz, -c
    s, tx, ty, tz = across(ux, uy, uz, wx, wy, wz, dx, dy, dz)
    x = tx * dx + ty * dy + tz * dz
    vx, vy, vz = ty * uz - tz * uy, tz * ux - tx * uz, tx * uy - ty * ux
    if x < 0.0:
        x, tx, ty, tz = -x, -tx, -ty, -tz
    if s > PARALLEL:
        y = vx * dx + vy * dy + vz * dz
        found = skewed(r1, a1, r2, a2, x, y, along, s, c)
    else:
        found = parallel(r1, a1, r2, a2, x, along)
    depth, kind, nx, ny, nz, px, py, pz, _ = found
    return (
        depth,
        kind,
        nx * tx + ny * vx + nz * ux,
        nx * ty + ny * vy + nz * uy,
        nx * tz + ny * vz + nz * uz,
        px * tx + py * vx + pz * ux,
        px * ty + py * vy + pz * uy,
        px * tz + py * vz + pz * uz,
    )
