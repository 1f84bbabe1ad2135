"""`Snapshot`: where the grains are and how fast they move, at one time, and `ForceSnapshot`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Snapshot:
    """Grains at `time` (s): `kind` (n,) type, `position` and `velocity` (n, 3) in m and m/s.

    `angle` (n,) of the long axis (rad), in the plane, or `axis` (n, 3), a unit vector, where
    grains have one and the engine tells it; zero of a sphere among them.
    """

    time: float
    kind: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    angle: np.ndarray | None = None
    axis: np.ndarray | None = None


@dataclass(frozen=True)
class ForceSnapshot:
    """Grains at `time` (s) and the forces on them, in N.

    `position`, `velocity` and `wall` (n, 3), the force of the cylinder on each grain; `pair`
    (m, 2) two grains in contact by their rows, `force` (m, 3) that of the second on the first.
    """

    time: float
    position: np.ndarray
    velocity: np.ndarray
    wall: np.ndarray
    pair: np.ndarray
    force: np.ndarray
