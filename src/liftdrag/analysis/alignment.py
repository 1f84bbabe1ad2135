"""How far cylinders lie alike: the order parameter of their axes (Liu et al. 2020, eq. 18)."""

from __future__ import annotations

import numpy as np


def orientation_tensor(axes: np.ndarray) -> np.ndarray:
    """Q (3, 3) of unit vectors (n, 3): 3/2 of the mean of a a - 1/3; no matter which way a is."""
    mean = axes.T @ axes / len(axes)
    return np.asarray(1.5 * (mean - np.eye(3) / 3.0))


def order_parameter(axes: np.ndarray) -> float:
    """S of unit vectors (n, 3), the largest eigenvalue of Q: 1 where all are parallel.

    For n axes at random it is near 0.9/sqrt(n), and never below 0.
    """
    return float(np.linalg.eigvalsh(orientation_tensor(axes))[-1])


def director(axes: np.ndarray) -> np.ndarray:
    """The direction (3,) that unit vectors (n, 3) lie along, with a component along x >= 0."""
    found = np.linalg.eigh(orientation_tensor(axes))[1][:, -1]
    return np.asarray(-found if found[0] < 0.0 else found)
