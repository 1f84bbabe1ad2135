"""The contact law: two scalars in, two scalars out, whatever touches whatever.

Hertz's spring with a dashpot of constant restitution, Mindlin's tangential spring with a
dashpot, and Coulomb's limit: the law of `hertz` and of Table I of Guillard et al. 2014.
"""

from __future__ import annotations

from math import log, pi, sqrt
from typing import NamedTuple

from liftdrag.dem.compiled import compiled


class Law(NamedTuple):
    """Numbers of the law, those that all contacts share.

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


def hertz_mindlin(
    youngs_modulus: float,
    poisson_ratio: float,
    restitution: float,
    friction: float,
    reach: float = 0.0,
) -> Law:
    """The law of grains of one material: modulus (Pa), Poisson ratio, restitution, friction.

    The ratio of the dashpots is that of LIGGGHTS' and Guillard's law, sqrt(2 (1-nu) / (2-nu)).
    """
    decay = -log(restitution) / sqrt(pi**2 + log(restitution) ** 2)
    softness = (1.0 - poisson_ratio) / (2.0 - poisson_ratio)
    return Law(
        stiffness=2.0 / 3.0 * youngs_modulus / (1.0 - poisson_ratio**2),
        tangential=3.0 * softness,
        damping=2.0 * sqrt(5.0 / 6.0) * decay,
        friction=friction,
        tangential_damping=sqrt(2.0 * softness),
        reach=reach,
    )


@compiled()
def pair_numbers(law, radius, other_radius, mass, other_mass):
    """Spring (N/m^1.5) and dashpot (N s/m^1.25) of a contact, from the effective values."""
    effective = radius if other_radius == 0.0 else radius * other_radius / (radius + other_radius)
    inertia = 1.0 / (1.0 / mass + 1.0 / other_mass)
    spring = law.stiffness * sqrt(effective)
    return spring, law.damping * sqrt(1.5 * spring * inertia)


@compiled(inline=True)
def contact_force(law, spring, dashpot, depth, parting, slip, stretch, time_step):
    """Forces of one contact: push N, drag T along the slip, new stretch (m), elastic N.

    `depth` of the overlap (m), `parting` and `slip` the relative velocities along and across
    the normal (m/s), `stretch` of the tangential spring before this step (m).
    """
    root = sqrt(depth)
    elastic = spring * depth * root
    viscous = dashpot * sqrt(root)
    push = elastic - viscous * parting
    stiffness = law.tangential * spring * root
    resistance = law.tangential_damping * viscous * slip
    stretch += slip * time_step
    pull = stiffness * stretch + resistance
    limit = law.friction * abs(push)
    if abs(pull) > limit:
        pull = limit if pull > 0.0 else -limit
        stretch = (pull - resistance) / stiffness
    return push, pull, stretch, elastic
