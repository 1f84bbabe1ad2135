"""The initial bed of a tank, about its cylinder and on its bottom layer, made without pouring.

Grains start at random inside the volume that the settled bed will fill, and are pushed apart.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from liftdrag.errors import InputError
from liftdrag.packing.relaxation import TooTight, relaxed


@dataclass(frozen=True)
class Container:
    """The volume that the grains fill: x and y periodic, z between two planes.

    Lengths in grain diameters. `floor` holds the centres (m, 3) of the fixed
    bottom layer; the cylinder's axis is along y at (x, z) = `axis`.
    """

    length: float
    thickness: float
    bottom: float
    top: float
    axis: tuple[float, float]
    radius: float
    floor: np.ndarray

    @property
    def period(self) -> np.ndarray:
        """Periods (3,), none along z."""
        return np.array([self.length, self.thickness, 0.0])

    @property
    def fixed(self) -> np.ndarray:
        """The grains (m, 3) that do not move."""
        return self.floor

    def near(self, centres: np.ndarray, reach: float) -> np.ndarray:
        """Pairs (p, 2) of the centres nearer than `reach`."""
        every = centres.copy()
        every[:, :2] %= self.period[:2]
        every[:, 2] += 1.0
        tree = cKDTree(every, boxsize=np.array([self.length, self.thickness, 4.0 * self.top + 8.0]))
        return np.asarray(tree.query_pairs(reach, output_type="ndarray"))

    def push(self, x: np.ndarray, force: np.ndarray) -> float:
        """Add the forces of floor, ceiling and cylinder; returns the largest overlap."""
        below = np.maximum(self.bottom - x[:, 2], 0.0)
        above = np.maximum(x[:, 2] - (self.top - 0.5), 0.0)
        force[:, 2] += below - above
        dx = x[:, 0] - self.axis[0]
        dx -= self.length * np.rint(dx / self.length)
        dz = x[:, 2] - self.axis[1]
        distance = np.maximum(np.hypot(dx, dz), 1e-12)
        inside = np.maximum(self.radius + 0.5 - distance, 0.0)
        force[:, 0] += inside * dx / distance
        force[:, 2] += inside * dz / distance
        return float(max(below.max(), above.max(), inside.max()))


def square_layer(length: float, thickness: float, height: float) -> np.ndarray:
    """Centres (m, 3) of a square monolayer at `height`, commensurate with the periodic box.

    Lengths in grain diameters; the spacing is the smallest that is no less
    than one diameter and divides the box, so no grain overlaps its image.
    """
    columns, rows = int(length + 1e-9), int(thickness + 1e-9)
    x = (np.arange(columns) + 0.5) * length / columns
    y = (np.arange(rows) + 0.5) * thickness / rows
    grid = np.stack(np.meshgrid(x, y, [height], indexing="ij"), axis=-1)
    return grid.reshape(-1, 3)


def random_bed(container: Container, count: int, rng: np.random.Generator) -> np.ndarray:
    """Centres (count, 3) of a dense random bed, in grain diameters.

    No two grains, nor a grain and the floor or the cylinder, overlap by more
    than `relaxation.TOLERANCE` diameters. Raises InputError when the grains do not fit.
    """
    try:
        return relaxed(container, _scatter(container, count, rng))
    except TooTight as error:
        raise InputError(
            f"The bed cannot be packed: its {count} {error}; "
            "make the tank larger about the cylinder."
        ) from None


def _scatter(box: Container, count: int, rng: np.random.Generator) -> np.ndarray:
    """One grain in each of `count` random cells of a grid over the free volume."""
    volume = np.array([box.length, box.thickness, box.top - box.bottom])
    spacing = (volume.prod() / count) ** (1.0 / 3.0)
    while True:
        cells = np.ceil(volume / spacing).astype(int)
        grid = np.stack(np.meshgrid(*map(np.arange, cells), indexing="ij"), axis=-1).reshape(-1, 3)
        jittered = (grid + rng.uniform(0.0, 1.0, grid.shape)) / cells
        points = jittered * volume + [0.0, 0.0, box.bottom]
        away = np.hypot(points[:, 0] - box.axis[0], points[:, 2] - box.axis[1])
        points = points[away > box.radius]
        if len(points) >= count:
            return rng.permutation(points)[:count]
        spacing *= 0.99
