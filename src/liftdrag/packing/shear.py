"""The initial state of a shear flow: grains grown at random, which move with the mean flow."""

from __future__ import annotations

import numpy as np

from liftdrag.dem.cylinders import Cell, Cylinders, grown, same_volume, sheared
from liftdrag.errors import CaseError
from liftdrag.scene import ShearScene


def grown_cell(scene: ShearScene, threads: int = 1) -> Cylinders:
    """The grains, in the order of the species: none touches, each has the velocity of the shear.

    Raises CaseError when they cannot be packed.
    """
    aspect = np.repeat([one.aspect_ratio or 0.0 for one in scene.species], scene.counts)
    radius, half_length = same_volume(aspect, scene.grains.diameter)
    size, mass = np.array(scene.sides), np.full(scene.grain_count, scene.mass)
    try:
        grains = grown(radius, half_length, mass, size, scene.seed, threads)
    except ValueError as error:
        raise CaseError(
            "cell.solid_fraction", scene.cell.solid_fraction, str(error), "lower it"
        ) from None
    return sheared(grains, Cell(size, scene.drive.shear_rate))
