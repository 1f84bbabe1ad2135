"""Where the edge of one cylinder is nearest to the axis, or to the edge, of another.

Edges are circles. The first is one cylinder's axis as a point and the other's edge as an ellipse,
seen along the axis; the second two circles in space.
"""

from __future__ import annotations

from math import sqrt

from liftdrag.dem.compiled import compiled

EXACT = 1e-13
"""Relative step of Newton's method at which its answer is taken."""

MOST_STEPS = 30

STRIDE = 0.5
"""Angle (rad) that one step along an edge may have."""


@compiled(inline=True)
def nearest_on_ellipse(a, b, x, y):
    """From an ellipse of semi-axes a > 0 and b >= 0 to a point outside it: the shortest vector.

    x and y are not negative. With it comes where it starts: the sine of the angle along the
    circle that the ellipse is the image of. Newton's method on a function that falls and is
    convex, from its left, so that it never overshoots; zero for a point inside.
    """
    b = max(b, 1e-12 * a)
    if (x * b) ** 2 + (y * a) ** 2 <= (a * b) ** 2:
        return 0.0, 0.0, 0.0
    t = max(a * (x - a), b * (y - b), 0.0)
    for _ in range(MOST_STEPS):
        p, q = 1.0 / (t + a * a), 1.0 / (t + b * b)
        u, v = (a * x * p) ** 2, (b * y * q) ** 2
        step = 0.5 * (u + v - 1.0) / (u * p + v * q)
        t += step
        if step <= EXACT * t:
            break
    return x * t / (t + a * a), y * t / (t + b * b), b * y / (t + b * b)


@compiled(inline=True)
def edge_to_axis(r2, a2, x, y, s, c):
    """From the axis z to the nearest point of the edge of a cylinder: x, y, and z if it is at 0.

    The cylinder, of radius r2 and half length a2, is at (x, y, 0) with x >= 0, and its axis is
    (0, s, c). Zero when its band is nearer than its edge or hides the axis.
    """
    away = abs(y) - a2 * s
    if away <= 0.0:
        return 0.0, 0.0, 0.0
    dx, dy, sine = nearest_on_ellipse(r2, r2 * c, x, away)
    rise = s * r2 * sine - a2 * c
    return (dx, dy, rise) if y > 0.0 else (dx, -dy, -rise)


@compiled(inline=True)
def unit(x, y):
    """The direction of a vector in the plane, (1, 0) of none."""
    size = sqrt(x * x + y * y)
    return (x / size, y / size) if size > 0.0 else (1.0, 0.0)


@compiled(inline=True)
def along_edge(x, y, angle):
    """A unit vector turned by an angle, at most STRIDE, to the second order."""
    angle = min(max(angle, -STRIDE), STRIDE)
    scale = 1.0 / sqrt(1.0 + angle * angle)
    return (x - angle * y) * scale, (y + angle * x) * scale


@compiled()
def edge_to_edge(r1, r2, px, py, x, y, z, s, c):
    """Points of two edges, each nearest to the other, as unit vectors across their axes.

    The first circle, of radius r1, is about z at the origin; the second, of radius r2, is at
    (x, y, z) about (0, s, c), its vectors are on (1, 0, 0) and (0, c, -s). Newton's method along
    the first circle, from (px, py) downhill, for the square of the distance to the second.
    """
    for _ in range(MOST_STEPS):
        mx, my = r1 * px - x, r1 * py - y
        across, along = mx, my * c + z * s
        qx, qy = unit(across, along)
        away = sqrt(across * across + along * along)
        slope = r1 * (mx * -py + my * px - r2 * (qy * c * px - qx * py))
        bend = r1 * (x * px + y * py + r2 * (qx * px + qy * c * py))
        turning = r1 * (py * qy + px * qx * c)
        bend -= r2 * turning * turning / away
        turn = -slope / bend if bend > 0.0 else (STRIDE if slope < 0.0 else -STRIDE)
        px, py = along_edge(px, py, turn)
        if abs(turn) < EXACT:
            break
    return px, py, qx, qy
