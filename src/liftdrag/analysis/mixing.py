"""How irregular a flow is: the motion that no local deformation explains."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

LEAST_NEIGHBOURS = 3


def irregularity(before: np.ndarray, after: np.ndarray, reach: float) -> float:
    """Root mean square (m) of the displacements that are not affine among neighbours.

    `before` and `after` (n, 2) are the centres; the neighbours of a grain are those nearer than
    `reach` (m) before. For each grain the linear map that best turns their old positions about
    it into the new ones is taken off (Falk and Langer, Phys. Rev. E 57 (1998) 7192, D^2_min per
    neighbour). Zero for any motion that is linear in space. Raises ValueError when no grain
    has LEAST_NEIGHBOURS neighbours.
    """
    near = cKDTree(before).query_ball_point(before, reach)
    left = [
        _residual(before[others] - before[i], after[others] - after[i])
        for i, found in enumerate(near)
        if len(others := [j for j in found if j != i]) >= LEAST_NEIGHBOURS
    ]
    if not left:
        raise ValueError("no grain has enough neighbours to compare its motion with")
    return float(np.sqrt(np.mean(left)))


def _residual(old: np.ndarray, new: np.ndarray) -> float:
    """Mean square of what the best linear map leaves."""
    best, *_ = np.linalg.lstsq(old, new, rcond=None)
    return float(((new - old @ best) ** 2).sum(axis=1).mean())
