"""`Snapshot`: where the grains are and how fast they move, at one time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Snapshot:
    """Grains at `time` (s): `kind` (n,) type, `position` and `velocity` (n, 3) in m and m/s.

    `angle` (n,) of the long axis (rad), in the plane, or `axis` (n, 3), a unit vector, where
    grains have one and the engine tells it.
    """

    time: float
    kind: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    angle: np.ndarray | None = None
    axis: np.ndarray | None = None
