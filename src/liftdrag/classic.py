"""The classic contact of LAMMPS, `gran/hertz/history`: Hertz's spring, viscoelastic damping.

F = sqrt(R* a) (k a + m* gamma da/dt), of the overlap a, the modulus k = 4/3 E*, and the effective
radius and mass. Its restitution falls with the speed of the impact: gamma is made for one speed.
In units of that impact, of length D = (m* v^2 / (k sqrt(R*)))^0.4 and time D/v, the motion is
x'' = -x^1.5 - c x^0.5 x', with one number, c = gamma sqrt(R*) D^1.5 / v.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from math import sqrt

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

DEADEST = 5.0
"""The damping number at which nearly nothing rebounds: a restitution of 3e-3."""


@dataclass(frozen=True)
class Classic:
    """The `damping` gamma (1/(m s)) that has the restitution asked for at the closing `speed`."""

    damping: float
    speed: float


def classic(
    restitution: float, stiffness: float, radius: float, mass: float, speed: float
) -> Classic:
    """The damping of two bodies that meet at `speed` (m/s).

    `stiffness` (N/m^1.5) is k sqrt(R*) in F = k sqrt(R*) a^1.5, `radius` (m) and `mass` (kg) are
    the effective ones, `restitution` from 0.05 to 1.
    """
    length = (mass * speed**2 / stiffness) ** 0.4
    return Classic(damping_number(restitution) * speed / (sqrt(radius) * length**1.5), speed)


@cache
def damping_number(restitution: float) -> float:
    """The number c that gives this restitution, from 0.05 to 1."""
    if restitution == 1.0:
        return 0.0
    found: float = brentq(lambda c: rebound(c) - restitution, 0.0, DEADEST, rtol=1e-9)
    return found


def rebound(damping: float) -> float:
    """Speed after a head-on impact over that before, at the damping number c."""

    def motion(_time: float, state: np.ndarray) -> list[float]:
        overlap, speed = max(float(state[0]), 0.0), float(state[1])
        return [speed, -(overlap**1.5) - damping * sqrt(overlap) * speed]

    def parted(_time: float, state: np.ndarray) -> float:
        return float(state[0])

    parted.terminal, parted.direction = True, -1.0  # type: ignore[attr-defined]
    found = solve_ivp(
        motion, (0.0, 1e6), [0.0, 1.0], "LSODA", events=parted, rtol=1e-10, atol=1e-13
    )
    return float(-found.y[1, -1])
