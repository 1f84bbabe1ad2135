"""Stacks of rods or disks, close and alike in how they lie (Liu et al. 2020, eqs. 14 to 17)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

REACH = {"rod": 1.25, "disk": 1.5}
"""Distance of two centres in a stack at the most, over the diameter of rods, length of disks."""

ANGLE = np.radians(10.0)
"""Angle (rad) of two axes in a stack at the most."""


@dataclass(frozen=True)
class Stacks:
    """The numbers of grains of each stack (k,), of all `grains`."""

    sizes: np.ndarray
    grains: int

    @property
    def mean_size(self) -> float:
        """R_ave, grains a stack; 1, a grain alone, where there is none."""
        return float(self.sizes.mean()) if len(self.sizes) else 1.0

    @property
    def fraction(self) -> float:
        """P, the share of the grains that are in a stack."""
        return float(self.sizes.sum()) / self.grains


@dataclass(frozen=True)
class SlidingCell:
    """A cell of `sides` (3,), m, whose neighbour above is ahead along x by `offset` (m)."""

    sides: np.ndarray
    offset: float

    def images(self, position: np.ndarray, margin: float) -> tuple[np.ndarray, np.ndarray]:
        """The grains (n, 3) and their images up to `margin` (m) outside: where, and of which."""
        length, height, width = self.sides
        rows = np.floor(position[:, 1] / height)
        places = position - rows[:, None] * np.array([self.offset, height, 0.0])
        owners = np.arange(len(places))
        for axis, step in (
            (1, (self.offset, height, 0.0)),
            (0, (length, 0, 0)),
            (2, (0, 0, width)),
        ):
            if axis != 1:
                places[:, axis] %= self.sides[axis]
            low = places[:, axis] < margin
            high = places[:, axis] > self.sides[axis] - margin
            places = np.concatenate([places, places[low] + step, places[high] - step])
            owners = np.concatenate([owners, owners[low], owners[high]])
        return places, owners


def stacks(position: np.ndarray, axes: np.ndarray, cell: SlidingCell, reach: float) -> Stacks:
    """The stacks of grains (n, 3) m, of one species, with unit axes (n, 3).

    Two are in one where their centres are `reach` (m) apart at the most, and their axes ANGLE.
    """
    places, owners = cell.images(position, reach)
    pairs = cKDTree(places).query_pairs(reach, output_type="ndarray")
    one, other = owners[pairs].T
    alike = abs(np.einsum("ij,ij->i", axes[one], axes[other])) >= np.cos(ANGLE)
    joined = (one != other) & alike
    count = len(position)
    links = (np.ones(joined.sum()), (one[joined], other[joined]))
    labels = connected_components(coo_array(links, (count, count)), directed=False)[1]
    sizes = np.bincount(labels)
    return Stacks(sizes[sizes > 1], count)
