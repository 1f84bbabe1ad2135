"""The free surface of a bed, from where its grains are."""

from __future__ import annotations

import numpy as np


def solid_fraction_profile(
    heights: np.ndarray, diameter: float, area: float, edges: np.ndarray
) -> np.ndarray:
    """Solid fraction (n,) between the horizontal planes `edges` (n + 1,), exact for spheres.

    `heights` (m,) of the centres, all lengths in metres, `area` in m^2. Each
    sphere is cut by the planes; what lies below each plane is summed.
    """
    radius = diameter / 2.0
    below = np.empty(len(edges))
    for index, edge in enumerate(edges):
        cap = np.clip(edge - heights + radius, 0.0, diameter)
        below[index] = np.sum(np.pi * cap**2 * (radius - cap / 3.0))
    return np.diff(below) / (area * np.diff(edges))


def surface_height(
    heights: np.ndarray, diameter: float, area: float, bulk: tuple[float, float]
) -> float:
    """Height (m) at which the solid fraction falls to half of that in `bulk` (low, high).

    Planes are half a grain apart, and the crossing is interpolated between the
    middles of their layers, from the top down.
    """
    top = float(heights.max()) + 2.0 * diameter
    edges = np.arange(0.0, top, 0.5 * diameter)
    profile = solid_fraction_profile(heights, diameter, area, edges)
    middles = (edges[:-1] + edges[1:]) / 2.0
    inside = (middles > bulk[0]) & (middles < bulk[1])
    half = profile[inside].mean() / 2.0
    last = int(np.flatnonzero(profile >= half)[-1])
    share = (profile[last] - half) / (profile[last] - profile[last + 1])
    return float(middles[last] + share * (middles[last + 1] - middles[last]))
