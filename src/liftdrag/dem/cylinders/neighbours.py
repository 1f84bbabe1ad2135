"""Which cylinders may touch: those of the candidates that no direction tried holds apart."""

from __future__ import annotations

from math import sqrt

from liftdrag.dem.compiled import compiled
from liftdrag.dem.cylinders.forces import contact_of, overlap_along
from liftdrag.dem.cylinders.kinds import APART


@compiled()
def neighbours(place, pairs, away, skin, low, high):
    """List which pairs under the grains from low to high are nearer than the skin (m) or overlap.

    The images are `away` (IMAGES, 4). The direction that separated a pair last is tried first.
    """
    grain, first, last, near, other, image, _, _, normal, kind = pairs
    for p in range(low, high):
        i, count = grain[p], first[p]
        for k in range(first[p], first[p + 1]):
            j, m = other[k], image[k]
            dx = place[j, 0] + away[m, 0] - place[i, 0]
            dy = place[j, 1] + away[m, 1] - place[i, 1]
            dz = place[j, 2] + away[m, 2] - place[i, 2]
            nx, ny, nz = normal[k, 0], normal[k, 1], normal[k, 2]
            gap = -overlap_along(place, i, j, dx, dy, dz, nx, ny, nz)
            if gap >= skin:
                continue
            if gap <= 0.0 and kind[k] == APART:
                gap, nx, ny, nz = widest_gap(place, i, j, dx, dy, dz, gap, nx, ny, nz, skin)
                normal[k, 0], normal[k, 1], normal[k, 2] = nx, ny, nz
                if gap >= skin:
                    continue
            near[count] = k
            count += 1
        last[p] = count


@compiled()
def widest_gap(place, i, j, dx, dy, dz, gap, gx, gy, gz, skin):
    """The gap (m) between two cylinders in the direction in which it is widest, and this.

    Of the one known, that from centre to centre, their axes, and the one that `meeting` finds,
    until it is wider than the skin.
    """
    for trial in range(4):
        if trial == 0:
            nx, ny, nz = dx, dy, dz
        elif trial == 3:
            _, _, nx, ny, nz, _, _, _ = contact_of(place, i, j, dx, dy, dz)
        else:
            k = i if trial == 1 else j
            nx, ny, nz = place[k, 3], place[k, 4], place[k, 5]
        along, size = nx * dx + ny * dy + nz * dz, sqrt(nx * nx + ny * ny + nz * nz)
        if size == 0.0:
            continue
        scale = 1.0 / size if along >= 0.0 else -1.0 / size
        nx, ny, nz = nx * scale, ny * scale, nz * scale
        found = -overlap_along(place, i, j, dx, dy, dz, nx, ny, nz)
        if found > gap:
            gap, gx, gy, gz = found, nx, ny, nz
        if gap >= skin:
            break
    return gap, gx, gy, gz
