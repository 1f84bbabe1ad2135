"""What grains are made of, and how they collide."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from liftdrag.scene.model import Part
from liftdrag.scene.quantities import Density, Modulus


class Material(Part):
    """Hertz-Mindlin with friction and a constant restitution (Guillard et al. 2014, Table I)."""

    density: Density
    youngs_modulus: Modulus
    poisson_ratio: Annotated[float, Field(ge=0.0, lt=0.5)]
    restitution: Annotated[float, Field(gt=0.0, le=1.0)]
    friction: Annotated[float, Field(ge=0.0, le=10.0)]
