"""What the profiles of a column in a tube say: solid fraction, Janssen's K, the wall's friction."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import hypot, pi, sqrt
from typing import TYPE_CHECKING

import numpy as np

from liftdrag import granular
from liftdrag.analysis.correlated import mean_of, ratio_of_means
from liftdrag.analysis.quantity import Quantity
from liftdrag.profile import Profile
from liftdrag.scene import JanssenScene

if TYPE_CHECKING:
    import pandas as pd

ENDS = 3.0
"""Height in d above the piston and below the top of a column that is not its bulk."""

STRAY = 0.05
"""Grains of a slice, over those of the fullest, up to which they lie about on the top."""

CUT = 0.3
"""Scatter of the grains that a slice's face puts above it, over the root of those in a layer."""

FEWEST_BLOCKS = 10.0
"""Independent blocks from which on the error of their mean is more than a guess."""


@dataclass(frozen=True)
class ColumnProfile:
    """Means over a fill in each slice that holds grains, all (b,), from the piston upward.

    `height` (m) of the middle; `vertical_stress` and `radial_stress` on the wall (Pa) with their
    standard errors; `ratio` of the radial to the vertical one; over the grains at the wall the
    mean `mobilisation` |T|/(mu_w N), the share `sliding`, and the `spin` (rad/s) of rolling along
    a tube that moves upward; `solid_fraction`; `wall_contacts`. Not a number: nothing to divide.
    """

    height: np.ndarray
    vertical_stress: np.ndarray
    vertical_error: np.ndarray
    radial_stress: np.ndarray
    radial_error: np.ndarray
    ratio: np.ndarray
    mobilisation: np.ndarray
    sliding: np.ndarray
    solid_fraction: np.ndarray
    wall_contacts: np.ndarray
    spin: np.ndarray

    def to_pandas(self) -> pd.DataFrame:
        """A row for each slice, the units in the names of the columns."""
        import pandas as pd

        return pd.DataFrame(
            {
                "height (m)": self.height,
                "vertical stress (Pa)": self.vertical_stress,
                "vertical stress standard error (Pa)": self.vertical_error,
                "radial stress (Pa)": self.radial_stress,
                "radial stress standard error (Pa)": self.radial_error,
                "ratio (1)": self.ratio,
                "mobilisation (1)": self.mobilisation,
                "sliding (1)": self.sliding,
                "solid fraction (1)": self.solid_fraction,
                "wall contacts (1)": self.wall_contacts,
                "spin (rad/s)": self.spin,
            }
        )


@dataclass(frozen=True)
class Column:
    """The profiles of one fill, blocks of `interval` (s)."""

    scene: JanssenScene
    profiles: Sequence[Profile]
    interval: float

    def blocks(self, name: str) -> np.ndarray:
        """A sum of the profiles in each block and slice, (blocks, b)."""
        return np.array([getattr(profile, name) for profile in self.profiles], dtype=float)

    @property
    def height(self) -> np.ndarray:
        """Height (m) of the middle of each slice, (b,)."""
        return self.profiles[0].height

    @property
    def thickness(self) -> float:
        """Height (m) of a slice; the first stands on the piston."""
        return 2.0 * float(self.height[0])

    @property
    def top(self) -> float:
        """Height (m) of the column: its grains over those of a metre of its full slices."""
        count = self.blocks("count").mean(axis=0)
        return self.thickness * float(count.sum() / np.median(count[self._whole]))

    @property
    def filled(self) -> np.ndarray:
        """Which slices (b,) hold grains."""
        return np.asarray(self.blocks("count").mean(axis=0) > 0.0)

    @property
    def bulk(self) -> np.ndarray:
        """Which slices (b,) are clear of both ends; of a low column the whole ones, or all."""
        return self._clear_of_ends(ENDS) if self.has_bulk else self._whole

    @property
    def has_bulk(self) -> bool:
        """Whether any slice is clear of both ends."""
        return bool(self._clear_of_ends(ENDS).any())

    @property
    def _whole(self) -> np.ndarray:
        """Those below the highest, which grains fill in part; all when there is but that one."""
        count = self.blocks("count").mean(axis=0)
        held = np.flatnonzero(count > STRAY * count.max())
        whole = np.zeros(len(count), bool)
        whole[held[:-1] if len(held) > 1 else held] = True
        return whole

    def _clear_of_ends(self, diameters: float) -> np.ndarray:
        half, clear = self.thickness / 2.0, diameters * self.scene.grains.diameter
        slack = 1e-6 * self.thickness
        above = self.height - half >= clear - slack
        return np.asarray(above & (self.height + half <= self.top - clear + slack))

    @property
    def solid_fraction(self) -> Quantity:
        """Solid fraction of the bulk; its error has that of grains that the ends of it cut."""
        bulk = self.bulk
        count = self.blocks("count")[:, bulk].mean(axis=1)
        found = mean_of(self._grain_share * count, self.interval, "1")
        layer = count.mean() * self.scene.grains.diameter / self.thickness
        cut = CUT * sqrt(2.0 * layer) * self._grain_share / bulk.sum()
        return self._enough(replace(found, standard_error=hypot(found.standard_error, cut)))

    @property
    def _grain_share(self) -> float:
        """Volume of a grain over that of a slice."""
        volume = granular.sphere_volume(self.scene.grains.diameter)
        return volume / (self.scene.tube.section * self.thickness)

    @property
    def janssen_ratio(self) -> Quantity | None:
        """Normal stress on the wall over the vertical stress, both summed over the bulk.

        N/(pi D h) over virial/(pi D^2/4 h).
        """
        bulk = self.bulk
        radial = self.blocks("wall_normal")[:, bulk].sum(axis=1) * self.scene.tube.diameter / 4.0
        return self._ratio(radial, self.blocks("virial")[:, bulk].sum(axis=1))

    @property
    def wall_mobilisation(self) -> Quantity | None:
        """Mean of |T|/(mu_w N) over the contacts with the tube."""
        return self._at_wall("mobilisation")

    @property
    def wall_sliding(self) -> Quantity | None:
        """Share of the contacts with the tube that slide."""
        return self._at_wall("sliding")

    @property
    def wall_rolling(self) -> Quantity | None:
        """Mean spin of the grains at the tube times d/2 over its speed: 1 rolls, 0 slides."""
        speed = self.scene.wall_speed
        if not speed:
            return None
        return self._at_wall("spin", self.scene.grains.diameter / 2.0 / speed)

    def _at_wall(self, name: str, scale: float = 1.0) -> Quantity | None:
        contacts = self.blocks("wall_contacts").sum(axis=1)
        return self._ratio(scale * self.blocks(name).sum(axis=1), contacts)

    def _ratio(self, numerator: np.ndarray, denominator: np.ndarray) -> Quantity | None:
        found = ratio_of_means(numerator, denominator, self.interval)
        return None if found is None else self._enough(found)

    def _enough(self, quantity: Quantity) -> Quantity:
        """Blocks are means of many samples: fewer of them than samples of a series will do."""
        enough = (quantity.n_independent or 0.0) >= FEWEST_BLOCKS
        return replace(quantity, converged=enough)

    @property
    def profile(self) -> ColumnProfile:
        """The slices that hold grains, averaged over the blocks."""
        filled = self.filled
        names = ("count", "wall_contacts", "mobilisation", "sliding", "spin")
        mean = {name: self.blocks(name)[:, filled].mean(axis=0) for name in names}
        diameter, section = self.scene.tube.diameter, self.scene.tube.section
        vertical, vertical_error = self._slices("virial", section * self.thickness)
        radial, radial_error = self._slices("wall_normal", pi * diameter * self.thickness)
        return ColumnProfile(
            self.height[filled],
            vertical,
            vertical_error,
            radial,
            radial_error,
            _quotient(radial, vertical),
            _quotient(mean["mobilisation"], mean["wall_contacts"]),
            _quotient(mean["sliding"], mean["wall_contacts"]),
            self._grain_share * mean["count"],
            mean["wall_contacts"],
            _quotient(mean["spin"], mean["wall_contacts"]),
        )

    def _slices(self, name: str, scale: float) -> tuple[np.ndarray, np.ndarray]:
        """Mean and standard error over the blocks of a sum over `scale`, each (b,)."""
        values = self.blocks(name)[:, self.filled].T / scale
        found = [mean_of(value, self.interval, "Pa") for value in values]
        means = np.array([quantity.mean for quantity in found])
        return means, np.array([quantity.standard_error for quantity in found])


def _quotient(numerator: np.ndarray, denominator: np.ndarray) -> np.ndarray:
    """Quotient (b,), not a number where the denominator is zero."""
    empty = np.full(len(numerator), np.nan)
    return np.asarray(np.divide(numerator, denominator, out=empty, where=denominator != 0.0))
