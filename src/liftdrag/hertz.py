"""Scales of the Hertz contact of two like spheres: stiffness, times, overlaps."""

from __future__ import annotations

from math import gamma, log, pi, sqrt

from scipy.optimize import brentq

IMPACT_DURATION = 0.8 * sqrt(pi) * gamma(0.4) / gamma(0.9)
"""Twice the integral of (1 - x^2.5)^-1/2 from 0 to 1, 2.9433."""


def effective_modulus(youngs_modulus: float, poisson_ratio: float) -> float:
    """E* (Pa) of two bodies of one material: E / (2 (1 - nu^2))."""
    return youngs_modulus / (2.0 * (1.0 - poisson_ratio**2))


def stiffness(modulus: float, radius: float) -> float:
    """k (N/m^1.5) in F = k overlap^1.5, of the effective modulus (Pa) and radius (m)."""
    return 4.0 / 3.0 * modulus * sqrt(radius)


def pair_stiffness(youngs_modulus: float, poisson_ratio: float, diameter: float) -> float:
    """k (N/m^1.5) between two like spheres (Guillard et al. 2014, Table I)."""
    return stiffness(effective_modulus(youngs_modulus, poisson_ratio), diameter / 4.0)


def static_overlap(force: float, k: float) -> float:
    """Overlap (m) that carries `force` (N) at stiffness `k` (N/m^1.5)."""
    overlap: float = (force / k) ** (2.0 / 3.0)
    return overlap


def rayleigh_time(
    diameter: float, density: float, youngs_modulus: float, poisson_ratio: float
) -> float:
    """Time (s) of a Rayleigh wave around a sphere: pi R sqrt(rho/G) / (0.1631 nu + 0.8766)."""
    shear_modulus = youngs_modulus / (2.0 * (1.0 + poisson_ratio))
    wave = 0.1631 * poisson_ratio + 0.8766
    return pi * diameter / 2.0 * sqrt(density / shear_modulus) / wave


def impact_overlap(k: float, mass: float, speed: float) -> float:
    """Largest overlap (m) of an elastic impact: (5 m v^2 / (4 k))^0.4.

    `mass` is the effective mass (kg), `speed` the closing speed (m/s).
    """
    overlap: float = (5.0 * mass * speed**2 / (4.0 * k)) ** 0.4
    return overlap


def hertz_time(k: float, mass: float, speed: float) -> float:
    """Duration (s) of an elastic impact: 2.9433 a / v, a the largest overlap (same arguments)."""
    return IMPACT_DURATION * impact_overlap(k, mass, speed) / speed


def tangential_damping(poisson_ratio: float) -> float:
    """Ratio of tangential to normal damping, sqrt(2 (1 - nu) / (2 - nu)).

    It turns a tangential damping proportional to the normal one into that of
    Guillard et al. 2014, Table I: gamma_t = -sqrt(10/3) beta sqrt(m* k_t).
    """
    return sqrt(2.0 * (1.0 - poisson_ratio) / (2.0 - poisson_ratio))


def modulus_as_on_plane(youngs_modulus: float, radius: float, cylinder_radius: float) -> float:
    """Young's modulus (Pa) that undoes LAMMPS' curvature of a convex cylinder wall.

    LAMMPS takes 1/R* = 1/R + 1/(2 R_c) at a cylindrical region; Table I of
    Guillard et al. 2014 treats the cylinder as a plane, R* = R.
    """
    return youngs_modulus * sqrt((radius + 2.0 * cylinder_radius) / (2.0 * cylinder_radius))


def tsuji_restitution(restitution: float) -> float:
    """The value e' that makes Tsuji's damping, fitted for another law, give `restitution`.

    Tsuji, Tanaka and Ishida (1992) damp with alpha(e') sqrt(m k); a restitution that does
    not depend on the speed needs sqrt(5) |ln e| / sqrt(pi^2 + ln^2 e) in its place.
    """
    logarithm = log(restitution)
    wanted = sqrt(5.0) * abs(logarithm) / sqrt(pi**2 + logarithm**2)
    found: float = brentq(lambda e: _tsuji_damping(e) - wanted, -0.5, 1.05, xtol=1e-14)
    return found


def _tsuji_damping(e: float) -> float:
    """alpha(e) as LAMMPS has it."""
    fitted = (1.2728, -4.2783, 11.087, -22.348, 27.467, -18.022, 4.8218)
    return sum(factor * e**power for power, factor in enumerate(fitted))
