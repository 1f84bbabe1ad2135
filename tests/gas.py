"""A sheared cell of spheres of unit diameter and mass, at a rate of one, and what theory says."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import islice
from math import gamma, pi

import numpy as np

from liftdrag.analysis.correlated import mean_of
from liftdrag.analysis.quantity import Quantity
from liftdrag.dem import HertzMindlin, hertz_mindlin
from liftdrag.dem.cylinders import Cell, Cylinders, grown, same_volume, shear, sheared
from liftdrag.kinetic import SteadyShear, steady_shear

EVERY = 0.1
"""Strain of a row."""

PER_CONTACT = 50
"""Time steps of a contact of two that meet at the speed of a grain."""


@dataclass(frozen=True)
class Gas:
    """`count` grains at a solid fraction and a restitution, of one aspect ratio, 0 for spheres.

    `soft`: their effective diameter (Barker and Henderson, J. Chem. Phys. 47 (1967) 4714) is by
    that much less than one, the mean of 1 - exp(-U/T) over the overlap, U the contact's energy.
    At no `rate`, the temperature is one.
    """

    fraction: float
    count: int
    soft: float
    restitution: float = 0.9
    aspect: float = 0.0
    rate: float = 1.0

    @property
    def theory(self) -> SteadyShear:
        """Of hard spheres of the effective diameter, in the units of the others."""
        size = 1.0 - self.soft
        hard = steady_shear(self.fraction * size**3, self.restitution)
        return SteadyShear(hard.kinetic / size, hard.contact / size, hard.energy * size**2)

    @property
    def heat(self) -> float:
        """The temperature to expect."""
        return 2.0 / 3.0 * self.theory.energy if self.rate else 1.0

    @property
    def spring(self) -> float:
        """k of k overlap^1.5 between two spheres."""
        return 2.5 * self.heat * (gamma(1.4) / self.soft) ** 2.5

    @property
    def modulus(self) -> float:
        """Young's modulus, the Poisson ratio being zero."""
        return 3.0 * self.spring

    @property
    def law(self) -> HertzMindlin:
        return hertz_mindlin(self.modulus, 0.0, self.restitution, 0.0)

    @property
    def time_step(self) -> float:
        """A share of the contact of two that meet at the mean square speed."""
        speed = np.sqrt(2.0 * self.heat)
        depth = (5.0 * 0.5 * speed**2 / (4.0 * self.spring)) ** 0.4
        return float(EVERY / np.ceil(EVERY * PER_CONTACT * speed / (2.9432 * depth)))

    @property
    def cell(self) -> Cell:
        return Cell(np.full(3, (self.count * pi / 6.0 / self.fraction) ** (1.0 / 3.0)), self.rate)

    def start(self, seed: int) -> Cylinders:
        """The grains at random, with the velocity of the shear and the heat to expect."""
        radius, half_length = same_volume(np.full(self.count, self.aspect), 1.0)
        still = grown(radius, half_length, np.ones(self.count), self.cell.size, seed)
        grains = sheared(still, self.cell)
        own = np.random.default_rng(seed).normal(size=(self.count, 3)) * np.sqrt(self.heat)
        return replace(grains, velocity=grains.velocity + own - own.mean(axis=0))

    def rows(self, strain: float, every: float = EVERY, seed: int = 1) -> np.ndarray:
        """Kinetic and contact stress (n, 2, 3, 3) of unit density, a row for `every` strain."""
        steps = round(every / self.time_step)
        run = shear(self.start(seed), self.cell, self.law, self.time_step, steps)
        rows = islice(run, round(strain / every))
        return np.array([[row.kinetic, row.contact] for row in rows]) * pi / 6.0


def quantities(rows: np.ndarray, leave: float) -> dict[str, Quantity]:
    """Shear stress, pressure, its kinetic part and xx - yy, from the rows after a strain."""
    kept = rows[round(leave / EVERY) :]
    stress = kept.sum(axis=1)
    series = {
        "shear_stress": -stress[:, 0, 1],
        "pressure": np.trace(stress, axis1=1, axis2=2) / 3.0,
        "kinetic_pressure": np.trace(kept[:, 0], axis1=1, axis2=2) / 3.0,
        "normal_difference": stress[:, 0, 0] - stress[:, 1, 1],
    }
    return {name: mean_of(values, EVERY, "1") for name, values in series.items()}
