"""`Profile`: a column of grains in a tube, slice by slice."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Profile:
    """Sums over the grains of each slice of the column, averaged over the time up to `time` (s).

    All (b,), a value for each slice, from the piston upward. `height` (m) of its middle; `count`
    of grains; `virial` (J): the vertical stress of the contacts between grains times the volume,
    positive in compression; `wall_normal` (N): what presses on the tube; `wall_shear` (N): what
    the tube lifts; `wall_contacts`: grains that press on the tube; and over these `mobilisation`:
    the sum of |T|/(mu_w N); `sliding`: how many have it above 0.99; `spin` (rad/s): the sum of
    the spin with which a grain rolls along a tube that moves upward.
    """

    time: float
    height: np.ndarray
    count: np.ndarray
    virial: np.ndarray
    wall_normal: np.ndarray
    wall_shear: np.ndarray
    wall_contacts: np.ndarray
    mobilisation: np.ndarray
    sliding: np.ndarray
    spin: np.ndarray


SLIDING = 0.99
"""|T|/(mu_w N) above which a contact slides."""
