"""The grains of a bed in three dimensions."""

from __future__ import annotations

from liftdrag import granular, hertz
from liftdrag.scene.material import Material
from liftdrag.scene.quantities import Length


class Grains(Material):
    """Monodisperse spheres of one material."""

    diameter: Length

    @property
    def mass(self) -> float:
        """Mass of a grain, kg."""
        return self.density * granular.sphere_volume(self.diameter)

    @property
    def stiffness(self) -> float:
        """Hertz stiffness of a contact of two grains, N/m^1.5."""
        return hertz.pair_stiffness(self.youngs_modulus, self.poisson_ratio, self.diameter)
