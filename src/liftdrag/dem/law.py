"""The contact laws: scalars in, scalars out, whatever touches whatever.

Each law is a named tuple of the numbers that all contacts share; its type chooses the functions
below when the loops are compiled. Springs have a dashpot of constant restitution, a tangential
spring with a dashpot, and Coulomb's limit: Hertz and Mindlin's, that of `hertz` and of Table I of
Guillard et al. 2014, or linear ones. Walton and Braun's partially latching spring has no dashpot:
it is stiffer in unloading, and its tangential stiffness falls as the limit comes near.
"""

from __future__ import annotations

from math import log, pi, sqrt
from typing import Any, NamedTuple

from numba.extending import overload

from liftdrag.dem.compiled import compiled

GRADUAL = 1.0 / 3.0
"""Exponent of Walton and Braun's tangential stiffness."""

INITIAL_RATIO = 0.8
"""Walton and Braun's initial tangential stiffness over the normal one in loading."""


class HertzMindlin(NamedTuple):
    """Springs and dashpots of Hertz and Mindlin.

    `stiffness` is 4/3 E* (Pa), `tangential` the tangential over the normal spring's force per
    length over sqrt(depth), `damping` is 2 sqrt(5/6) |ln e| / sqrt(pi^2 + ln^2 e), and
    `tangential_damping` the ratio of the two dashpots. `reach` says where the slip is taken:
    0 at the contact point, as LIGGGHTS does; 1 at each body's own surface, as LAMMPS does.
    """

    stiffness: float
    tangential: float
    damping: float
    friction: float
    tangential_damping: float
    reach: float


class LinearSpring(NamedTuple):
    """Linear springs and dashpots: `stiffness` (N/m), `damping` 2 |ln e| / sqrt(pi^2 + ln^2 e),
    the ratios of `tangential` to normal spring and of their dashpots, `reach` as above."""

    stiffness: float
    tangential: float
    damping: float
    friction: float
    tangential_damping: float
    reach: float


class WaltonBraun(NamedTuple):
    """Partially latching springs: stiffness (N/m) in `loading`, K1, and `unloading`, K2, and the
    initial `tangential` one, K0; the restitution is sqrt(K1/K2) at any speed."""

    loading: float
    unloading: float
    tangential: float
    friction: float
    reach: float


Law = HertzMindlin | LinearSpring | WaltonBraun


def hertz_mindlin(
    youngs_modulus: float,
    poisson_ratio: float,
    restitution: float,
    friction: float,
    reach: float = 0.0,
) -> HertzMindlin:
    """The law of grains of one material: modulus (Pa), Poisson ratio, restitution, friction.

    The ratio of the dashpots is that of LIGGGHTS' and Guillard's law, sqrt(2 (1-nu) / (2-nu)).
    """
    softness = (1.0 - poisson_ratio) / (2.0 - poisson_ratio)
    return HertzMindlin(
        stiffness=2.0 / 3.0 * youngs_modulus / (1.0 - poisson_ratio**2),
        tangential=3.0 * softness,
        damping=2.0 * sqrt(5.0 / 6.0) * _decay(restitution),
        friction=friction,
        tangential_damping=sqrt(2.0 * softness),
        reach=reach,
    )


def linear_spring(
    stiffness: float,
    restitution: float,
    friction: float,
    tangential: float,
    reach: float = 0.0,
) -> LinearSpring:
    """Linear springs (N/m), the `tangential` one over the normal one a ratio.

    Both are damped alike: the ratio of the dashpots is the root of that of the springs.
    """
    return LinearSpring(
        stiffness, tangential, 2.0 * _decay(restitution), friction, sqrt(tangential), reach
    )


def walton_braun(
    stiffness: float, restitution: float, friction: float, reach: float = 0.0
) -> WaltonBraun:
    """Latching springs of a stiffness (N/m) in loading, e^2 times that in unloading."""
    return WaltonBraun(
        stiffness, stiffness / restitution**2, INITIAL_RATIO * stiffness, friction, reach
    )


def _decay(restitution: float) -> float:
    return -log(restitution) / sqrt(pi**2 + log(restitution) ** 2)


def pair_numbers(law: Law, radius: float, other_radius: float, mass: float, other: float) -> Any:
    """Spring and dashpot of a contact from the effective radius and mass; none for latching.

    In N/m^1.5 and N s/m^1.25 for Hertz, N/m and N s/m for linear springs.
    """
    raise NotImplementedError("this is compiled")


@overload(pair_numbers)
def _pair_numbers(law, radius, other_radius, mass, other):
    return {HertzMindlin: _hertz_numbers, LinearSpring: _linear_numbers, WaltonBraun: _no_numbers}[
        law.instance_class
    ]


def _hertz_numbers(law, radius, other_radius, mass, other):
    effective = radius if other_radius == 0.0 else radius * other_radius / (radius + other_radius)
    inertia = 1.0 / (1.0 / mass + 1.0 / other)
    spring = law.stiffness * sqrt(effective)
    return spring, law.damping * sqrt(1.5 * spring * inertia)


def _linear_numbers(law, radius, other_radius, mass, other):
    inertia = 1.0 / (1.0 / mass + 1.0 / other)
    return law.stiffness, law.damping * sqrt(law.stiffness * inertia)


def _no_numbers(law, radius, other_radius, mass, other):
    return 0.0, 0.0


def spring_force(law: Law, spring: float, dashpot: float, depth: float, parting: float) -> Any:
    """Push (N), stored energy (J), stiffness (N/m) and dashpot (N s/m) against the slip."""
    raise NotImplementedError("this is compiled")


@overload(spring_force, inline="always")
def _spring_force(law, spring, dashpot, depth, parting):
    return _hertz_force if law.instance_class is HertzMindlin else _linear_force


def _hertz_force(law, spring, dashpot, depth, parting):
    root = sqrt(depth)
    elastic, viscous = spring * depth * root, dashpot * sqrt(root)
    push, stored = elastic - viscous * parting, 0.4 * elastic * depth
    return push, stored, law.tangential * spring * root, law.tangential_damping * viscous


def _linear_force(law, spring, dashpot, depth, parting):
    elastic = spring * depth
    push, stored = elastic - dashpot * parting, 0.5 * elastic * depth
    return push, stored, law.tangential * spring, law.tangential_damping * dashpot


@compiled(inline=True)
def contact_force(law, spring, dashpot, depth, parting, slip, stretch, time_step):
    """Forces of one contact in the plane: push N, drag T along the slip, new stretch, energy.

    `depth` of the overlap (m), `parting` and `slip` the relative velocities along and across
    the normal (m/s), `stretch` of the tangential spring before this step (m).
    """
    push, stored, stiffness, resistance = spring_force(law, spring, dashpot, depth, parting)
    stretch += slip * time_step
    pull = stiffness * stretch + resistance * slip
    limit = law.friction * abs(push)
    if abs(pull) > limit:
        pull = limit if pull > 0.0 else -limit
        stretch = (pull - resistance * slip) / stiffness
    return push, pull, stretch, stored


@compiled(inline=True)
def latching_push(law, depth, deepest):
    """Push (N) of a latching spring that was `deepest` (m) so far, now at least `depth` (m)."""
    if depth >= deepest:
        return law.loading * depth
    rest = deepest * (1.0 - law.loading / law.unloading)
    return max(law.unloading * (depth - rest), 0.0)


@compiled(inline=True)
def gradual_stiffness(law, drag, reversal, rising, limit):
    """Tangential stiffness (N/m) at a drag (N, not negative) towards its limit.

    `reversal` is the drag where it last began to rise or to fall, and `rising` which of them it
    does: K0 (1 - (T - T*)/(mu N - T*))^(1/3), or K0 (1 - (T* - T)/(mu N + T*))^(1/3).
    """
    turned = min(max(reversal, -limit), limit)
    way = drag - turned if rising else turned - drag
    room = limit - turned if rising else limit + turned
    if way <= 0.0:
        return law.tangential
    if way >= room:
        return 0.0
    return law.tangential * (1.0 - way / room) ** GRADUAL
