"""The numbers of each dialect against closed forms of the contact law and of the engines' own."""

from __future__ import annotations

import re
from dataclasses import replace
from math import log, pi, sqrt
from typing import Any

import numpy as np
import pytest
from conftest import tiny_tank
from hypothesis import given
from hypothesis import strategies as st

from liftdrag import hertz
from liftdrag.deck.dialect import DIALECTS, LAMMPS, LAMMPS_2021, LIGGGHTS, Contact
from liftdrag.errors import CaseError
from liftdrag.tank import prepare

CONTACT = Contact(
    youngs_modulus=5e6, poisson_ratio=0.45, restitution=0.6, friction=0.5, radius=0.75e-3
)
CYLINDER = 2.475e-3
"""Its radius (m) in Guillard et al. 2014."""

WALLS = {
    "plane": CONTACT,
    "cylinder": replace(CONTACT, wall_radius=CYLINDER),
    "rigid plane": replace(CONTACT, rigid=True),
    "rigid cylinder": replace(CONTACT, wall_radius=CYLINDER, rigid=True),
    "stiff and thin": replace(CONTACT, youngs_modulus=7e10, poisson_ratio=0.2, wall_radius=1e-4),
}

each_wall = pytest.mark.parametrize("contact", WALLS.values(), ids=WALLS)
each_lammps = pytest.mark.parametrize(
    "dialect", [LAMMPS, LAMMPS_2021], ids=lambda dialect: dialect.name
)


def asked_normal(contact: Contact) -> float:
    """The law's E* sqrt(R*), both bodies' compliances summed; every wall is a plane."""
    nu, modulus = contact.poisson_ratio, contact.youngs_modulus
    grain = (1.0 - nu**2) / modulus
    wall = 0.0 if contact.rigid else grain
    return sqrt(contact.radius) / (grain + wall)


def asked_tangential(contact: Contact) -> float:
    """The law's 8 G* sqrt(R*), from G / (2 - nu) of both bodies."""
    nu = contact.poisson_ratio
    grain = (2.0 - nu) / (contact.youngs_modulus / (2.0 * (1.0 + nu)))
    wall = 0.0 if contact.rigid else grain
    return 8.0 / (grain + wall) * sqrt(contact.radius)


def curved_root(contact: Contact) -> float:
    """The sqrt(R*) that LAMMPS takes at the wall: 1/R* = 1/R + 1/(2 R_c)."""
    return 1.0 / sqrt(1.0 / contact.radius + 1.0 / (2.0 * contact.wall_radius))


@each_wall
def test_wall_of_lammps_is_as_stiff_as_the_law(contact):
    """LAMMPS takes a wall for one of the grains' material: E* = E / (2 (1 - nu^2))."""
    modulus = LAMMPS.numbers(contact, 2)["wall_modulus"]
    made = modulus / (2.0 * (1.0 - contact.poisson_ratio**2)) * curved_root(contact)
    assert made == pytest.approx(asked_normal(contact), rel=1e-12)


@each_wall
def test_wall_of_lammps_has_the_tangential_stiffness_of_the_law(contact):
    """With NULL it is derived: 8 G*, G* = E / (4 (1 + nu) (2 - nu)) of the wall's modulus."""
    numbers, nu = LAMMPS.numbers(contact, 2), contact.poisson_ratio
    assert numbers["wall_tangential"] == "NULL"
    made = 8.0 * numbers["wall_modulus"] / (4.0 * (1.0 + nu) * (2.0 - nu)) * curved_root(contact)
    assert made == pytest.approx(asked_tangential(contact), rel=1e-12)


@each_wall
def test_wall_of_lammps_2021_is_as_stiff_as_the_law(contact):
    """That LAMMPS has 1 - nu where 1 - nu^2 belongs: E* = E / (2 (1 - nu))."""
    modulus = LAMMPS_2021.numbers(contact, 2)["wall_modulus"]
    made = modulus / (2.0 * (1.0 - contact.poisson_ratio)) * curved_root(contact)
    assert made == pytest.approx(asked_normal(contact), rel=1e-12)


@each_wall
def test_wall_of_lammps_2021_is_given_the_tangential_stiffness_of_the_law(contact):
    made = LAMMPS_2021.numbers(contact, 2)["wall_tangential"] * curved_root(contact)
    assert made == pytest.approx(asked_tangential(contact), rel=1e-12)


def test_plain_wall_of_lammps_is_the_grains_modulus():
    assert LAMMPS.numbers(CONTACT, 2)["wall_modulus"] == CONTACT.youngs_modulus
    rigid = LAMMPS.numbers(WALLS["rigid plane"], 2)["wall_modulus"]
    assert rigid == 2.0 * CONTACT.youngs_modulus


def test_numbers_of_the_papers_cylinder():
    """By hand: 5 MPa sqrt(1 + 0.75 / 4.95), over 1.45 in 2021; 2 E / (1.45 * 1.55) of it."""
    now, then = (dialect.numbers(WALLS["cylinder"], 2) for dialect in (LAMMPS, LAMMPS_2021))
    assert now["wall_modulus"] == pytest.approx(5.36543e6, rel=2e-6)
    assert then["wall_modulus"] == pytest.approx(3.70030e6, rel=2e-6)
    assert then["wall_tangential"] == pytest.approx(4.77458e6, rel=2e-6)


@each_wall
@each_lammps
def test_grains_of_lammps_keep_their_own_law(dialect, contact):
    """Whatever the wall is; Table I's tangential damping is sqrt(k_t / k_n) of the normal one."""
    numbers, nu = dialect.numbers(contact, 2), contact.poisson_ratio
    normal, tangential = 2.0 / (2.0 * (1.0 - nu**2)), 8.0 / (4.0 * (1.0 + nu) * (2.0 - nu))
    for name in ("youngs_modulus", "poisson_ratio", "restitution", "friction"):
        assert numbers[name] == getattr(contact, name)
    assert numbers["tangential_damping"] == pytest.approx(sqrt(tangential / normal), rel=1e-12)


@each_lammps
def test_lammps_has_its_materials_once_for_all_types(dialect):
    assert dialect.numbers(CONTACT, 2) == dialect.numbers(CONTACT, 3)


def test_lammps_damps_by_the_restitution_itself():
    numbers = LAMMPS.numbers(CONTACT, 2)
    assert (numbers["damping"], numbers["pair_restitution"]) == ("coeff_restitution", 0.6)


def tsuji_damping(e: float) -> float:
    """alpha(e) of Tsuji et al. (1992), as LAMMPS documents it, by Horner's scheme."""
    return float(np.polyval([4.8218, -18.022, 27.467, -22.348, 11.087, -4.2783, 1.2728], e))


def wanted_damping(restitution: float) -> float:
    """The factor of sqrt(m k) whose restitution does not depend on the speed.

    With beta = ln e / sqrt(ln^2 e + pi^2), Table I's is 2 sqrt(5/6) |beta| sqrt(S_n m), and the
    tangent stiffness of Hertz is S_n = 3/2 k.
    """
    beta = log(restitution) / sqrt(log(restitution) ** 2 + pi**2)
    return 2.0 * sqrt(5.0 / 6.0) * abs(beta) * sqrt(1.5)


@given(st.floats(1e-3, 1.0))
def test_tsujis_value_gives_the_damping_wanted(restitution: float):
    found = hertz.tsuji_restitution(restitution)
    assert tsuji_damping(found) == pytest.approx(wanted_damping(restitution), abs=1e-11)


@pytest.mark.parametrize("restitution", [0.05, 0.3, 0.6, 0.9, 1.0])
def test_lammps_2021_damps_by_tsujis_value(restitution):
    numbers = LAMMPS_2021.numbers(replace(CONTACT, restitution=restitution), 2)
    assert numbers["damping"] == "tsuji"
    assert numbers["restitution"] == restitution
    damping = tsuji_damping(numbers["pair_restitution"])
    assert damping == pytest.approx(wanted_damping(restitution), abs=1e-11)


def test_grains_that_lose_nothing_are_not_damped():
    """The fit itself leaves 3e-4 at e = 1."""
    assert tsuji_damping(1.0) == pytest.approx(3e-4, abs=1e-8)
    assert abs(tsuji_damping(hertz.tsuji_restitution(1.0))) < 1e-12


def test_tsujis_value_rises_with_the_restitution():
    found = [hertz.tsuji_restitution(e) for e in np.linspace(0.01, 1.0, 397)]
    assert (np.diff(found) > 0.0).all()
    assert -0.5 < found[0] < found[-1] < 1.05


def lists(contact: Contact, types: int) -> dict[str, list[float]]:
    """The lists of LIGGGHTS' materials, read back."""
    numbers: dict[str, Any] = LIGGGHTS.numbers(contact, types)
    names = ("moduli", "poisson_ratios", "restitutions", "frictions")
    return {name: [float(word) for word in numbers[name].split()] for name in names}


@pytest.mark.parametrize("types", [1, 2, 3])
def test_liggghts_has_a_value_for_each_type_and_pair_of_types(types):
    assert LIGGGHTS.numbers(CONTACT, types)["types"] == types
    assert lists(CONTACT, types) == {
        "moduli": [5e6] * types,
        "poisson_ratios": [0.45] * types,
        "restitutions": [0.6] * types**2,
        "frictions": [0.5] * types**2,
    }


@pytest.mark.parametrize("types", [2, 3])
def test_only_the_last_type_of_liggghts_is_rigid(types):
    """So stiff that the pair is as stiff as the law to 1e-11: E* of the sum of compliances."""
    rigid = WALLS["rigid plane"]
    *grains, wall = lists(rigid, types)["moduli"]
    assert grains == [5e6] * (types - 1)
    assert wall == 5e18
    compliance = (1.0 - 0.45**2) * (1.0 / grains[0] + 1.0 / wall)
    assert sqrt(rigid.radius) / compliance == pytest.approx(asked_normal(rigid), rel=1e-11)
    assert lists(rigid, types) | {"moduli": []} == lists(CONTACT, types) | {"moduli": []}


def test_walls_of_liggghts_are_planes_whatever_their_curvature():
    assert LIGGGHTS.numbers(WALLS["cylinder"], 2) == LIGGGHTS.numbers(CONTACT, 2)


def test_numbers_of_liggghts_keep_ten_digits():
    contact = replace(CONTACT, youngs_modulus=1.234567891e9, friction=0.1234567891)
    assert lists(contact, 2)["moduli"] == [1.234567891e9] * 2
    assert lists(contact, 2)["frictions"] == [0.1234567891] * 4


@pytest.mark.parametrize(
    ("friction", "word"), [(0.0, "off"), (1e-12, "on"), (0.5, "on"), (2.0, "on")]
)
def test_liggghts_damps_tangentially_unless_there_is_no_friction(friction, word):
    """Without friction its tangential damping would be the only tangential force."""
    numbers = LIGGGHTS.numbers(replace(CONTACT, friction=friction), 2)
    assert numbers["tangential_damping"] == word


@pytest.mark.parametrize("restitution", [0.05, 0.04, 1e-3])
def test_liggghts_refuses_a_restitution_that_it_does_not_have(restitution):
    with pytest.raises(CaseError) as caught:
        LIGGGHTS.numbers(replace(CONTACT, restitution=restitution), 2)
    assert caught.value.key == "grains.restitution"
    assert caught.value.value == restitution
    assert str(caught.value).startswith(f"grains.restitution = {restitution:g}: LIGGGHTS has no")
    assert "make it more than 0.05" in str(caught.value)


def test_liggghts_takes_a_restitution_just_above():
    assert lists(replace(CONTACT, restitution=0.0501), 2)["restitutions"] == [0.0501] * 4


def test_lammps_takes_restitutions_that_liggghts_does_not():
    low = replace(CONTACT, restitution=0.01)
    assert LAMMPS.numbers(low, 2)["pair_restitution"] == 0.01
    damping = tsuji_damping(LAMMPS_2021.numbers(low, 2)["pair_restitution"])
    assert damping == pytest.approx(wanted_damping(0.01), abs=1e-11)


def test_dialects_have_names_of_their_own():
    assert [dialect.name for dialect in DIALECTS] == [
        "lammps",
        "lammps-2023",
        "lammps-2021",
        "liggghts",
    ]
    assert [dialect.program for dialect in DIALECTS] == ["lmp", "lmp", "lmp", "liggghts"]


@pytest.mark.parametrize("dialect", [LAMMPS, LAMMPS_2021], ids=lambda dialect: dialect.name)
def test_wall_of_lammps_2021_is_made_anew_before_the_drive(dialect):
    """It derives the damping of a wall from its last one at each run: 0.53 in a first bounce is
    0.31 in the second, and 0.53 again for a new wall."""
    text = prepare(tiny_tank(), 1, dialect=dialect)[1].texts["in.tank"]
    settle, drive = text.split("# Stage 2")
    (wall,) = re.findall(r"^fix +wall .*$", settle, re.MULTILINE)
    again = re.findall(r"^unfix +wall\n(fix +wall .*)$", drive, re.MULTILINE)
    assert again == ([wall] if dialect is LAMMPS_2021 else [])
