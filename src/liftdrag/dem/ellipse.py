"""Where two ellipses touch.

The common normal: with h the support function, the depth is the least value over all
directions n of f(n) = h_1 + h_2 - r . n, r the vector from centre to centre. Turning n by an
angle has f' = h_1' + h_2' - r . t and f'' = rho_1 + rho_2 - f, rho the radii of curvature. A
stationary direction whose f is less than the sum of the least radii of curvature, b^2/a, is the
only such and the global minimum: that is how a search from the last step's answer is believed.
Force and torque are then minus the gradient of an energy of the depth alone.
"""

from __future__ import annotations

from math import atan2, cos, hypot, pi, sin, sqrt

from liftdrag.dem.compiled import compiled

SURE = 1e-4
"""Angle (rad) of the last Newton step, which Taylor's series makes: what it leaves out is 1e-8."""

MOST_STEPS = 12
"""Newton steps before the search starts anew from all directions."""

DIRECTIONS = 96
"""Directions of that search, each valley of which is followed to its bottom."""

GOLDEN = 0.6180339887498949


@compiled()
def support(a, b, c, s, nx, ny):
    """Support function of an ellipse with axis (c, s) in the direction n, and its derivative."""
    along, across = c * nx + s * ny, c * ny - s * nx
    height = sqrt(a * a * along * along + b * b * across * across)
    return height, (b * b - a * a) * along * across / height


@compiled(inline=True)
def gap(dx, dy, a1, b1, c1, s1, a2, b2, c2, s2, nx, ny):
    """f, f', f'' in the direction n, and h_1, h_1', rho_1."""
    u1, u2 = c1 * nx + s1 * ny, c2 * nx + s2 * ny
    b1, b2 = b1 * b1, b2 * b2
    e1, e2 = a1 * a1 - b1, a2 * a2 - b2
    q1, q2 = b1 + e1 * u1 * u1, b2 + e2 * u2 * u2
    h1, h2 = sqrt(q1), sqrt(q2)
    f = h1 + h2 - dx * nx - dy * ny
    inverse = 1.0 / (q1 * q2)
    i1, i2 = h1 * q2 * inverse, h2 * q1 * inverse
    d1, d2 = e1 * u1 * (s1 * nx - c1 * ny) * i1, e2 * u2 * (s2 * nx - c2 * ny) * i2
    rho1, rho2 = b1 * (b1 + e1) * i1 * i1 * i1, b2 * (b2 + e2) * i2 * i2 * i2
    return f, d1 + d2 + dx * ny - dy * nx, rho1 + rho2 - f, h1, d1, rho1


@compiled(inline=True)
def turned(nx, ny, tangent):
    """n turned by the angle of this tangent."""
    square = tangent * tangent
    scale = 1.0 - 0.5 * square if square < 1e-8 else 1.0 / sqrt(1.0 + square)
    return (nx - tangent * ny) * scale, (ny + tangent * nx) * scale


@compiled(inline=True)
def common_normal(dx, dy, a1, b1, c1, s1, a2, b2, c2, s2, nx, ny):
    """Depth (m; not positive where a direction separates them), n, and h_1, h_1' there.

    (dx, dy) leads from ellipse 1 to ellipse 2; n starts from (nx, ny). The last step, smaller
    than SURE, is made by Taylor's series: f is then exact to the fourth order.
    """
    for _ in range(MOST_STEPS):
        f, slope, bend, h1, d1, rho1 = gap(dx, dy, a1, b1, c1, s1, a2, b2, c2, s2, nx, ny)
        if f <= 0.0:
            return f, nx, ny, h1, d1
        if bend <= 0.0 or abs(slope) > bend:
            break
        tangent = -slope / bend
        nx, ny = turned(nx, ny, tangent)
        if abs(tangent) < SURE:
            depth = f + 0.5 * slope * tangent
            if depth < b1 * b1 / a1 + b2 * b2 / a2:
                return depth, nx, ny, h1 + d1 * tangent, d1 + (rho1 - h1) * tangent
            break
    return searched(dx, dy, a1, b1, c1, s1, a2, b2, c2, s2)


@compiled()
def searched(dx, dy, a1, b1, c1, s1, a2, b2, c2, s2):
    """The same from all directions: each valley of f is followed to its bottom by thirds."""
    best, bx, by = 1e300, 1.0, 0.0
    step = 2.0 * pi / DIRECTIONS
    before = gap(dx, dy, a1, b1, c1, s1, a2, b2, c2, s2, cos(-step), sin(-step))[0]
    here = gap(dx, dy, a1, b1, c1, s1, a2, b2, c2, s2, 1.0, 0.0)[0]
    for k in range(DIRECTIONS):
        angle = k * step
        after = gap(dx, dy, a1, b1, c1, s1, a2, b2, c2, s2, cos(angle + step), sin(angle + step))[0]
        if before >= here and here <= after:
            f, nx, ny = lowest(dx, dy, a1, b1, c1, s1, a2, b2, c2, s2, angle - step, angle + step)
            if f < best:
                best, bx, by = f, nx, ny
        before, here = here, after
    f, _, _, h1, d1, _ = gap(dx, dy, a1, b1, c1, s1, a2, b2, c2, s2, bx, by)
    return f, bx, by, h1, d1


@compiled()
def lowest(dx, dy, a1, b1, c1, s1, a2, b2, c2, s2, low, high):
    """The least f between two angles, by golden section and three Newton steps."""
    left, right = high - GOLDEN * (high - low), low + GOLDEN * (high - low)
    fl = gap(dx, dy, a1, b1, c1, s1, a2, b2, c2, s2, cos(left), sin(left))[0]
    fr = gap(dx, dy, a1, b1, c1, s1, a2, b2, c2, s2, cos(right), sin(right))[0]
    for _ in range(34):
        if fl < fr:
            high, right, fr = right, left, fl
            left = high - GOLDEN * (high - low)
            fl = gap(dx, dy, a1, b1, c1, s1, a2, b2, c2, s2, cos(left), sin(left))[0]
        else:
            low, left, fl = left, right, fr
            right = low + GOLDEN * (high - low)
            fr = gap(dx, dy, a1, b1, c1, s1, a2, b2, c2, s2, cos(right), sin(right))[0]
    nx, ny = cos(0.5 * (low + high)), sin(0.5 * (low + high))
    for _ in range(3):
        _, slope, bend, _, _, _ = gap(dx, dy, a1, b1, c1, s1, a2, b2, c2, s2, nx, ny)
        if bend > 0.0 and abs(slope) < 1e-3 * bend:
            nx, ny = turned(nx, ny, -slope / bend)
    return gap(dx, dy, a1, b1, c1, s1, a2, b2, c2, s2, nx, ny)[0], nx, ny


@compiled()
def facing(dx, dy, a, b, c, s):
    """The parameter alpha of an ellipse's boundary point in the direction of (dx, dy)."""
    return atan2(a * (c * dy - s * dx), b * (c * dx + s * dy))


@compiled()
def inmost(dx, dy, a1, b1, c1, s1, a2, b2, c2, s2, angle):
    """The boundary point of ellipse 1 with the least G of ellipse 2 (Zhou et al., eq. 11).

    Its parameter alpha and G; `angle` is where the search starts. In the frame in which
    ellipse 2 is the unit circle, ellipse 1 is M q + m with q on the unit circle.
    """
    cos12, sin12 = c1 * c2 + s1 * s2, s1 * c2 - c1 * s2
    m11, m12, m21, m22 = a1 * cos12 / a2, -b1 * sin12 / a2, a1 * sin12 / b2, b1 * cos12 / b2
    mx, my = -(c2 * dx + s2 * dy) / a2, (s2 * dx - c2 * dy) / b2
    for _ in range(MOST_STEPS):
        slope, bend = _slope(m11, m12, m21, m22, mx, my, angle)
        if bend <= 0.0 or abs(slope) > bend:
            break
        angle -= slope / bend
        if abs(slope) < SURE * bend:
            return angle, _level(m11, m12, m21, m22, mx, my, angle)
    best, step = 1e300, 2.0 * pi / DIRECTIONS
    for k in range(DIRECTIONS):
        level = _level(m11, m12, m21, m22, mx, my, k * step)
        if level < best:
            best, angle = level, k * step
    low, high = angle - step, angle + step
    for _ in range(50):
        left, right = high - GOLDEN * (high - low), low + GOLDEN * (high - low)
        if _level(m11, m12, m21, m22, mx, my, left) < _level(m11, m12, m21, m22, mx, my, right):
            high = right
        else:
            low = left
    angle = 0.5 * (low + high)
    return angle, _level(m11, m12, m21, m22, mx, my, angle)


@compiled()
def _level(m11, m12, m21, m22, mx, my, angle):
    c, s = cos(angle), sin(angle)
    u, v = m11 * c + m12 * s + mx, m21 * c + m22 * s + my
    return u * u + v * v - 1.0


@compiled()
def _slope(m11, m12, m21, m22, mx, my, angle):
    """Half the first and second derivative of G along the boundary."""
    c, s = cos(angle), sin(angle)
    pu, pv = m11 * c + m12 * s, m21 * c + m22 * s
    du, dv = m12 * c - m11 * s, m22 * c - m21 * s
    u, v = pu + mx, pv + my
    return u * du + v * dv, du * du + dv * dv - u * pu - v * pv


@compiled()
def paper_contact(dx, dy, a1, b1, c1, s1, a2, b2, c2, s2, alpha1, alpha2):
    """The paper's section 2.3: depth, n, arm of ellipse 1 along n and across, both alphas.

    The two boundary points that lie deepest in the other ellipse, in the sense of G; their
    distance is the depth and their line the normal.
    """
    alpha1, level1 = inmost(dx, dy, a1, b1, c1, s1, a2, b2, c2, s2, alpha1)
    alpha2, level2 = inmost(-dx, -dy, a2, b2, c2, s2, a1, b1, c1, s1, alpha2)
    if level1 >= 0.0 or level2 >= 0.0:
        return 0.0, 1.0, 0.0, 0.0, 0.0, alpha1, alpha2
    u1, v1 = a1 * cos(alpha1), b1 * sin(alpha1)
    u2, v2 = a2 * cos(alpha2), b2 * sin(alpha2)
    x1, y1 = c1 * u1 - s1 * v1, s1 * u1 + c1 * v1
    x2, y2 = dx + c2 * u2 - s2 * v2, dy + s2 * u2 + c2 * v2
    depth = hypot(x1 - x2, y1 - y2)
    nx, ny = (x1 - x2) / depth, (y1 - y2) / depth
    mx, my = 0.5 * (x1 + x2), 0.5 * (y1 + y2)
    return depth, nx, ny, mx * nx + my * ny, my * nx - mx * ny, alpha1, alpha2
