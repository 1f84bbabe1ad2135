"""The images of a periodic box that slides along x from layer to layer in y."""

from __future__ import annotations

import numpy as np

from liftdrag.dem.compiled import compiled

MOST_ALONG = 3
"""Images on either side along x; one on either side along y and z."""

IMAGES = 9 * (2 * MOST_ALONG + 1)


@compiled(inline=True)
def image_number(kx, ky, kz):
    """The number of an image by its steps along x, y and z."""
    return ((kx + MOST_ALONG) * 3 + ky + 1) * 3 + kz + 1


@compiled()
def images(size, shear_rate, shift):
    """What an image is away from its original (IMAGES, 4): x, y, z (m) and velocity along x."""
    away = np.empty((IMAGES, 4))
    for kx in range(-MOST_ALONG, MOST_ALONG + 1):
        for ky in range(-1, 2):
            for kz in range(-1, 2):
                row = away[image_number(kx, ky, kz)]
                row[0] = kx * size[0] + ky * shift
                row[1], row[2] = ky * size[1], kz * size[2]
                row[3] = ky * shear_rate * size[1]
    return away


@compiled()
def wrap(place, move, size, shear_rate, shift):
    """Put the grains that left the box back in, with the jump along x; the new shift."""
    shift -= np.floor(shift / size[0]) * size[0]
    for i in range(len(place)):
        rows = np.floor(place[i, 1] / size[1])
        place[i, 1] -= rows * size[1]
        place[i, 0] -= rows * shift
        move[i, 0] -= rows * shear_rate * size[1]
        for a in (0, 2):
            place[i, a] -= np.floor(place[i, a] / size[a]) * size[a]
    return shift
