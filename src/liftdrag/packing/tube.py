"""The initial column of a tube: packed at random in full height, then cut into layers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class PackedColumn:
    """Centres of the grains (n, 3), from the piston at z = 0 upward, and of the lid's (m, 3), m.

    The tube's axis is x = y = 0. A layer is a range of the grains: they are in order of z.
    """

    grains: np.ndarray
    lid: np.ndarray
