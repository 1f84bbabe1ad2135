"""When an explicit step breaks a bed of grains: limits derived from stiffness, mass and contacts.

Velocity Verlet with dashpots that see the velocity of half a step before, as LAMMPS, LIGGGHTS and
the in-house engine have it, keeps a mode of rate omega and damping ratio zeta bounded while

    dt < (2 / omega) (sqrt(1 + zeta^2) - zeta),

the step at which the amplification z^2 - (2 - 2 zeta h - h^2) z + (1 - 2 zeta h), h = omega dt,
has a root at -1. Two grains of mass m on a contact of stiffness K have omega_1^2 = 2 K/m.

Several contacts: a spring stretched by u_i - u_j has K (u_i - u_j)^2 <= 2 K (u_i^2 + u_j^2), so the
fastest mode of a bed has omega^2 <= 2 max_i A_i, A_i the largest eigenvalue of grain i's own
stiffness over its inertia, its neighbours held. For Z contacts in all directions of D dimensions,
tangential springs r K and spheres (I = 2/5 m R^2) or discs (I = 1/2 m R^2),

    moving   A = (Z K/m) (1 + (D - 1) r) / D,
    turning  A = (Z K/m) (5/3) r in three dimensions, (Z K/m) 2 r in the plane.

omega^2 / omega_1^2 = A m / K, then, is the crowding below. Without friction it is reached: 3 for
the triangular lattice, 4 for a close packing of spheres. Dashpots in proportion to the springs damp
a mode by zeta = zeta_1 omega/omega_1, where its springs are tangential ones over sqrt(r), since
those are damped by sqrt(r) of the normal ones. A contact that slides has no tangential spring:
the limit errs on the safe side.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import hypot, inf, log, pi, sqrt


@dataclass(frozen=True)
class Crowd:
    """A grain among others: `contacts` of it, in `dimensions`, with the `tangential` springs over
    the normal ones, zero without friction, and the damping `ratio` of two grains alone."""

    contacts: float
    dimensions: int
    tangential: float
    ratio: float

    @property
    def modes(self) -> tuple[tuple[float, float], ...]:
        """Crowding omega^2/omega_1^2 and damping ratio of moving and of turning."""
        d, r = self.dimensions, self.tangential
        moving = self.contacts * (1.0 + (d - 1) * r) / d
        turning = self.contacts * r * (5.0 / 3.0 if d == 3 else 2.0)
        found = ((moving, self.ratio * sqrt(moving)),)
        if r == 0.0:
            return found
        return (*found, (turning, self.ratio * sqrt(turning / r)))

    def step(self, stiffness: float, mass: float) -> float:
        """The largest step (s) for contacts of `stiffness` (N/m) and grains of `mass` (kg)."""
        alone = sqrt(2.0 * stiffness / mass)
        return min(largest_step(alone * sqrt(crowding), damped) for crowding, damped in self.modes)


def largest_step(rate: float, ratio: float = 0.0) -> float:
    """The step (s) below which a mode of `rate` (rad/s) and damping `ratio` stays bounded."""
    return 2.0 / rate * (hypot(1.0, ratio) - ratio) if rate else inf


def damping_ratio(restitution: float) -> float:
    """zeta of a linear spring and dashpot of this restitution; Hertz: sqrt(5/6) of it."""
    return -log(restitution) / hypot(pi, log(restitution))


def hertz_slope(k: float, overlap: float) -> float:
    """dF/da (N/m) of F = k a^1.5 at this overlap (m)."""
    return 1.5 * k * sqrt(overlap)
