"""The object that the bed flows past."""

from __future__ import annotations

from math import pi

from liftdrag.scene.model import Part
from liftdrag.scene.quantities import Length


class Intruder(Part):
    """A cylinder across the tank: its `diameter`, its centre's `depth` below the free surface."""

    diameter: Length
    depth: Length

    @property
    def section(self) -> float:
        """Area of the cross-section, m^2."""
        return pi * self.diameter**2 / 4.0
