"""Numbers of granular beds: solid fraction, inertial number, pressure of a lid, slip."""

from __future__ import annotations

from math import exp, expm1, pi, sqrt

GRAVITY = 9.81
"""Acceleration of gravity, m/s^2."""


def sphere_volume(diameter: float) -> float:
    """Volume (m^3) of a sphere of `diameter` (m)."""
    return pi * diameter**3 / 6.0


def inertial_number(rate: float, diameter: float, pressure: float, density: float) -> float:
    """I = rate d / sqrt(P / rho_g), of a shear rate (1/s) and a pressure (Pa)."""
    return rate * diameter / sqrt(pressure / density)


def lid_depth(diameter: float, density_ratio: float) -> float:
    """Height (m) of bed that weighs as much as a square monolayer of heavy grains.

    (pi d / 6) rho* / rho; `density_ratio` is that of the heavy grains to the bulk
    (Guillard et al. 2014, section III A).
    """
    return pi * diameter / 6.0 * density_ratio


def grip(
    drag_coefficient: float, depth: float, intruder: float, friction: float, reach: float
) -> float:
    """Share of the friction available at the driven layers that the drag takes up.

    C_d h D / (mu_bulk H L_x): `reach` is H L_x (m^2), summed over the driven
    layers as effective bed heights. Above one the layers slip under the bed.
    """
    return drag_coefficient * depth * intruder / (friction * reach)


def janssen_stress(depth: float, weight: float, beta: float, top: float = 0.0) -> float:
    """Vertical stress (Pa) at `depth` (m) in a column whose wall friction is mobilised.

    (w/beta)(1 - exp(-beta z)) + top exp(-beta z), of a bulk weight w = rho g (N/m^3), beta =
    4 mu_w K / D (1/m) and a stress at the top (Pa); beta is negative where the wall pushes
    down, zero without friction (Janssen 1895).
    """
    if beta == 0.0:
        return top + weight * depth
    return -weight / beta * expm1(-beta * depth) + top * exp(-beta * depth)
