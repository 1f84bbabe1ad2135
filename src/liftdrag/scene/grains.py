"""The grains and their contact: Hertz-Mindlin with friction and a constant restitution."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from liftdrag import granular, hertz
from liftdrag.scene.model import Part
from liftdrag.scene.quantities import Density, Length, Modulus


class Grains(Part):
    """Monodisperse spheres of one material (Guillard et al. 2014, Table I)."""

    diameter: Length
    density: Density
    youngs_modulus: Modulus
    poisson_ratio: Annotated[float, Field(ge=0.0, lt=0.5)]
    restitution: Annotated[float, Field(gt=0.0, le=1.0)]
    friction: Annotated[float, Field(ge=0.0, le=10.0)]

    @property
    def mass(self) -> float:
        """Mass of a grain, kg."""
        return self.density * granular.sphere_volume(self.diameter)

    @property
    def stiffness(self) -> float:
        """Hertz stiffness of a contact of two grains, N/m^1.5."""
        return hertz.pair_stiffness(self.youngs_modulus, self.poisson_ratio, self.diameter)
