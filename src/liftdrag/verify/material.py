"""Spheres to throw, and what Hertz says of their elastic impacts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from liftdrag import hertz
from liftdrag.deck.dialect import Contact
from liftdrag.engines.base import Engine
from liftdrag.engines.impact import Impact, Throw, impacts, stiffness_and_mass


@dataclass(frozen=True)
class Material:
    name: str
    radius: float
    youngs_modulus: float
    poisson_ratio: float
    density: float
    speed: float
    published: float = 0.0

    def contact(self, restitution: float, friction: float, rigid: bool) -> Contact:
        return Contact(
            self.youngs_modulus, self.poisson_ratio, restitution, friction, self.radius, rigid=rigid
        )

    @property
    def rayleigh_time(self) -> float:
        return hertz.rayleigh_time(
            2.0 * self.radius, self.density, self.youngs_modulus, self.poisson_ratio
        )


ALUMINIUM = Material("aluminium", 0.1, 70e9, 0.30, 2699.0, 0.2, 11370.0)


def thrown(
    engine: Engine, material: Material, contact: Contact, throws: list[Throw], fraction: float
) -> list[Impact]:
    step = fraction * material.rayleigh_time
    wall: Literal["plane"] | None = "plane" if contact.rigid else None
    return impacts(engine, contact, material.density, throws, step, wall)


def closed_form(material: Material, rigid: bool) -> tuple[float, float, float]:
    """Peak force (N), peak overlap (m) and duration (s) of an elastic impact, by Hertz."""
    contact = material.contact(1.0, 0.0, rigid)
    k, mass = stiffness_and_mass(contact, material.density, "plane" if rigid else None)
    closing = material.speed * (1.0 if rigid else 2.0)
    overlap = hertz.impact_overlap(k, mass, closing)
    return k * overlap**1.5, overlap, hertz.hertz_time(k, mass, closing)
