"""`Cylinders` in a `Cell`: what moves and the box that it moves in."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Cell:
    """A periodic box, sheared where `shear_rate` (1/s) is not zero: velocity along x, shear in y.

    `size` (3,) in m. An image above, at y + size[1], is `shift` (m) farther along x and faster
    by shear_rate size[1] (Lees and Edwards 1972).
    """

    size: np.ndarray
    shear_rate: float = 0.0
    shift: float = 0.0

    @property
    def volume(self) -> float:
        """Volume, m^3."""
        return float(np.prod(self.size))


@dataclass(frozen=True)
class Cylinders:
    """Flat-ended cylinders, SI units: rods where they are longer than wide, disks elsewhere.

    A sphere is one of no half length, whose axis is zero: it has none.

    `position`, `velocity`, `axis` (a unit vector, or zero) and `spin` (rad/s) are (n, 3); `radius`,
    `half_length` and `mass` (n,). The angle about the axis is left out: nothing depends on it.
    """

    position: np.ndarray
    velocity: np.ndarray
    axis: np.ndarray
    spin: np.ndarray
    radius: np.ndarray
    half_length: np.ndarray
    mass: np.ndarray

    @property
    def volume(self) -> np.ndarray:
        """Volume of each (n,), m^3."""
        return volumes(self.radius, self.half_length)

    @property
    def is_sphere(self) -> np.ndarray:
        """Which are spheres (n,)."""
        return np.asarray(self.half_length == 0.0)

    @property
    def extent(self) -> np.ndarray:
        """The smaller of radius and half length, a sphere's radius (n,), m."""
        least = np.minimum(self.radius, self.half_length)
        return np.where(self.is_sphere, self.radius, least)

    @property
    def inertia(self) -> np.ndarray:
        """Moments of inertia (n, 2) across and about the axis, kg m^2."""
        square = self.radius**2
        across = self.mass * (square / 4.0 + self.half_length**2 / 3.0)
        both = np.column_stack([across, 0.5 * self.mass * square])
        return np.where(self.is_sphere[:, None], 0.4 * (self.mass * square)[:, None], both)

    @property
    def angular_momentum(self) -> np.ndarray:
        """Angular momentum of each about its centre (n, 3), kg m^2/s."""
        across, about = self.inertia.T[:, :, None]
        along = (self.spin * self.axis).sum(axis=1, keepdims=True) * self.axis
        return np.asarray(across * (self.spin - along) + about * along)


def volumes(radius: np.ndarray, half_length: np.ndarray) -> np.ndarray:
    """Volumes (n,), m^3, of cylinders of these radii and half lengths (n,), 0 of a sphere, in m."""
    reach = np.where(half_length == 0.0, 2.0 / 3.0 * radius, half_length)
    return np.asarray(2.0 * np.pi * radius**2 * reach)


def same_volume(aspect: np.ndarray, diameter: float) -> tuple[np.ndarray, np.ndarray]:
    """Radii and half lengths (m) of cylinders as large as a sphere of a diameter (m).

    `aspect` (n,) is length over diameter, 0 of a sphere.
    """
    radius = (
        0.5 * diameter * (2.0 / (3.0 * np.where(aspect > 0.0, aspect, 2.0 / 3.0))) ** (1.0 / 3.0)
    )
    return radius, radius * aspect
