"""The contact law of the engine against closed forms of Hertz, Mindlin and Coulomb."""

from __future__ import annotations

from dataclasses import replace
from math import log, pi, sqrt
from typing import Any

import numpy as np
import pytest
from beds import MODULUS, POISSON, grains, law_of
from scipy.special import beta

from liftdrag.dem import FINE, Bed, Law, Memory, advance, contacts, forces, hertz_mindlin


def hertz_time(stiffness: float, mass: float, speed: float) -> float:
    """Duration of an elastic head-on collision, 2 integral of d(depth) / speed."""
    return 2.0 * 0.4 * float(beta(0.4, 0.5)) * hertz_depth(stiffness, mass, speed) / speed


def hertz_depth(stiffness: float, mass: float, speed: float) -> float:
    """Its largest overlap, where all kinetic energy is in the spring."""
    return float((1.25 * mass * speed**2 / stiffness) ** 0.4)


def head_on(contact: str, radii: tuple[float, float], axes: Any, speed: float) -> Bed:
    """Two grains about to meet on the x axis, the first at rest."""
    return grains([[0, 0], [sum(radii) + 1e-9, 0]], axes, [[0, 0], [-speed, 0]], contact=contact)


MEETINGS = {
    "discs": head_on("disc", (1.0, 0.6), [[1.0], [0.6]], 0.5),
    "ellipses": head_on("common normal", (1.5, 0.4), [[1.5, 0.8], [0.4, 0.3]], 0.5),
    "paper": head_on("paper", (1.5, 0.4), [[1.5, 0.8], [0.4, 0.3]], 0.5),
}


def effective(bed: Bed, law: Law) -> tuple[float, float]:
    """Spring and reduced mass of the two grains of a bed."""
    one, two = bed.radius
    stiffness = law.stiffness * sqrt(one * two / (one + two))
    return stiffness, float(1.0 / (1.0 / bed.mass).sum())


@pytest.mark.parametrize("restitution", [0.3, 0.6, 0.9, 1.0])
@pytest.mark.parametrize("meeting", ["discs", "ellipses"])
def test_head_on_pair_parts_with_the_restitution_asked_for(meeting: str, restitution: float):
    bed, law = MEETINGS[meeting], law_of(restitution)
    duration = hertz_time(*effective(bed, law), 0.5)
    run = advance(bed, law, duration / 20000, 1, 40000)
    after = run.bed.velocity
    assert run.elastic[-1] == 0.0
    assert after[1, 0] - after[0, 0] == pytest.approx(0.5 * restitution, rel=5e-5)
    assert abs(after[:, 1]).max() < 1e-12
    assert bed.mass @ after[:, 0] == pytest.approx(bed.mass @ bed.velocity[:, 0], rel=1e-13)


@pytest.mark.parametrize("meeting", MEETINGS)
def test_head_on_pair_is_hertzian_in_depth_and_duration(meeting: str):
    """Against (5 m v^2 / 4 k)^0.4 and 2.943275 times that over v."""
    bed, law = MEETINGS[meeting], law_of()
    spring, mass = effective(bed, law)
    depth, duration = hertz_depth(spring, mass, 0.5), hertz_time(spring, mass, 0.5)
    assert duration == pytest.approx(2.943275 * depth / 0.5, rel=1e-6)
    run = advance(bed, law, duration / 10000, 10500)
    touching = np.count_nonzero(run.elastic > 0.0)
    assert touching / 10000 == pytest.approx(1.0, abs=1.5e-4)
    smaller = bed.radius.min()
    assert run.overlap.max() * smaller == pytest.approx(depth, rel=1e-7)
    assert run.elastic.max() == pytest.approx(0.5 * mass * 0.25, rel=1e-6)


@pytest.mark.parametrize("reach", [0.0, 1.0])
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_disc_sliding_off_a_wall_has_the_impulses_of_coulomb(side: float, reach: float):
    """Against e_t = 1 - mu (1 + e) / tan(incidence), and the integral of mu N (r - depth/2).

    Where the slip is taken at the surface, a wall's torque has the arm r.
    """
    friction, speed = 0.1, np.array([1.0 * side, -0.5])
    law = law_of(friction=friction, reach=reach)
    bed = grains([[0.0, 1.0]], 1.0, [speed], walls=(-9.0, 9.0, 0.0, 9.0))
    duration = hertz_time(law.stiffness, bed.mass[0], 0.5)
    after = advance(bed, law, duration / 20000, 1, 20100).bed
    sliding = 1.0 - friction * 2.0 * 0.5 / 1.0
    assert after.velocity[0] == pytest.approx([sliding * side, 0.5], rel=1e-6)
    depth = hertz_depth(law.stiffness, bed.mass[0], 0.5)
    lever = 2.0 * law.stiffness * depth**3.5 / 0.5 * 0.4 * beta(1.4, 0.5)
    shorter = 0.5 * (1.0 - reach) * lever
    turn = friction * (2.0 * bed.mass[0] * 0.5 - shorter) / (0.5 * bed.mass[0])
    assert after.spin[0] == pytest.approx(-turn * side, rel=1e-6)


@pytest.mark.parametrize("poisson", [0.0, 0.3, 0.45])
def test_law_of_a_material_is_that_of_hertz_mindlin_and_tsuji(poisson: float):
    """Against G* and E* written out; the ratio of dashpots is sqrt(S_t / S_n)."""
    law = hertz_mindlin(5e6, poisson, 0.6, 0.5, 1.0)
    normal = 5e6 / (2.0 * (1.0 - poisson**2))
    shear = 5e6 / (2.0 * (1.0 + poisson)) / (2.0 * (2.0 - poisson))
    assert law.stiffness == pytest.approx(4.0 / 3.0 * normal)
    assert law.tangential * law.stiffness == pytest.approx(8.0 * shear)
    assert law.tangential_damping == pytest.approx(sqrt(8.0 * shear / (2.0 * normal)))
    assert law.damping == pytest.approx(law_of(0.6).damping)
    assert (law.friction, law.reach) == (0.5, 1.0)


def stretched(depth: float, stretch: float, axes: Any = ((1.0,), (0.5,))) -> Bed:
    """Two discs whose spring is stretched already."""
    bed = grains([[0.0, 0.0], [1.5 - depth, 0.0]], np.array(axes))
    memory = Memory(np.array([[0, 1]]), np.array([stretch]), np.full((1, 2), np.nan))
    return replace(bed, memory=memory)


@pytest.mark.parametrize("depth", [0.001, 0.03, 0.2])
def test_tangential_spring_is_mindlins(depth: float):
    """Against T = 8 G* sqrt(R* depth) s, with torques T (r - depth/2) on both."""
    shear = MODULUS / (2.0 * (1.0 + POISSON)) / (2.0 * (2.0 - POISSON))
    stretch, effective_radius = 1e-4, 0.5 / 1.5
    expected = 8.0 * shear * sqrt(effective_radius * depth) * stretch
    pull = forces(stretched(depth, stretch), law_of(friction=10.0))
    assert pull[:, 1] == pytest.approx([expected, -expected], rel=1e-12)
    levers = np.array([1.0, 0.5]) - 0.5 * depth
    assert pull[:, 2] == pytest.approx(expected * levers, rel=1e-12)


@pytest.mark.parametrize("share", [-1e3, -1.001, -0.999, 0.999, 1.001, 1e3])
def test_pull_is_the_spring_below_the_limit_of_coulomb_and_the_limit_above(share: float):
    law, depth = law_of(friction=0.4), 0.05
    limit = 0.4 * law.stiffness * sqrt(1.0 / 3.0) * depth**1.5
    slipping = 0.4 * depth / law.tangential
    push, pull, _ = forces(stretched(depth, share * slipping), law)[0]
    assert push == pytest.approx(-limit / 0.4, rel=1e-12)
    assert pull == pytest.approx(limit * np.clip(share, -1.0, 1.0), rel=1e-12)


def test_dashpots_take_restitution_and_reach_from_their_formulas():
    """Against 2 sqrt(5/6) beta sqrt(S m*) v for both, the slip at the point or at the surfaces."""
    depth, spin, parting = 0.05, np.array([0.02, 0.03]), 0.01
    moving = replace(
        stretched(depth, 0.0), velocity=np.array([[0.0, 0.0], [parting, 0.1]]), spin=spin
    )
    for reach in (0.0, 1.0):
        law = law_of(0.5, friction=50.0, reach=reach, tangential_damping=0.7)
        spring, mass = effective(moving, law)
        beta_of_e = log(2.0) / sqrt(pi**2 + log(2.0) ** 2)
        dashpot = 2 * sqrt(5 / 6) * beta_of_e * sqrt(1.5 * spring * sqrt(depth) * mass)
        arms = np.array([1.0, 0.5]) - 0.5 * depth * (1.0 - reach)
        push, pull, _ = forces(moving, law)[0]
        assert -push == pytest.approx(spring * depth**1.5 - dashpot * parting, rel=1e-12)
        assert pull == pytest.approx(0.7 * dashpot * (0.1 - spin @ arms), rel=1e-12)


def test_loop_of_a_contact_is_that_of_a_spring_in_series_with_a_slider():
    """A heavy disc shoved along a wall and back, against T = clip(T + k ds) step by step."""
    law, depth, step = law_of(friction=0.3), 0.05, 1e-3
    bed = grains([[0.0, 1.0 - depth]], walls=(-9.0, 9.0, 0.0, 9.0))
    bed = replace(bed, mass=np.array([1e20]), inertia=np.array([1e20]))
    push = law.stiffness * depth**1.5
    stiffness, limit = law.tangential * law.stiffness * sqrt(depth), 0.3 * push
    slipping = limit / stiffness
    expected, measured, pull = [], [], 0.0
    for stroke in (0.6, 0.9, -0.7, 0.4, -4.0, 1.5, -1.0, 3.0):
        bed = replace(bed, velocity=np.array([[stroke * slipping / 20 / step, 0.0]]))
        run = advance(bed, law, step, 20, watched=0)
        bed = run.bed
        measured.append(run.force[:, 0])
        for _ in range(20):
            pull = np.clip(pull - stiffness * stroke * slipping / 20, -limit, limit)
            expected.append(pull)
    assert np.concatenate(measured) == pytest.approx(np.array(expected), rel=1e-9, abs=1e-12)
    assert np.ptp(expected) == pytest.approx(2.0 * limit)


def box_of_discs(law: Law) -> Bed:
    """Forty discs that rub in a box too narrow for them, with springs stretched."""
    rng = np.random.default_rng(5)
    place = np.stack(np.meshgrid(np.arange(8), np.arange(5)), axis=-1).reshape(-1, 2)
    radius = rng.uniform(0.48, 0.6, (40, 1))
    velocity, spin = rng.normal(size=(40, 2)), rng.normal(size=40)
    bed = grains(place, radius, velocity, 0.0, spin, walls=(-0.45, 7.45, -0.45, 4.45))
    return advance(bed, law, 2e-4, 1, 50).bed


def differences(one: Bed, other: Bed) -> float:
    """The largest of place, velocity and spin; all are of order one."""
    names = ("position", "velocity", "spin")
    return max(float(abs(getattr(one, name) - getattr(other, name)).max()) for name in names)


@pytest.mark.parametrize("reach", [0.0, 1.0])
def test_run_in_pieces_is_the_run_in_one_where_no_dashpot_asks_for_velocities(reach: float):
    """Undamped, forces depend on places and springs alone, which a piece hands on exactly.

    A dashpot would see the velocity of the place's own time at a cut, of half a step before
    elsewhere: there the pieces differ by the order of the step.
    """
    law = law_of(friction=0.5, reach=reach)
    bed = box_of_discs(law)
    whole, piece = advance(bed, law, 2e-4, 1, 400).bed, bed
    for _ in range(8):
        piece = advance(piece, law, 2e-4, 1, 50).bed
    assert differences(whole, bed) > 0.01
    assert differences(whole, piece) < 1e-12
    forgetful = advance(replace(bed, memory=Memory()), law, 2e-4, 1, 400).bed
    assert differences(whole, forgetful) > 1e-4


def test_springs_survive_new_neighbour_lists():
    """Lists made anew in every step, against lists that are never made anew."""
    law = law_of(0.7, friction=0.5)
    bed = box_of_discs(law)
    never, always = (advance(bed, law, 2e-4, 1, 300, skin=skin) for skin in (2.0, 0.0))
    assert (never.rebuilt, always.rebuilt) == (0, 300)
    assert differences(never.bed, always.bed) < 1e-12


def test_springs_are_forgotten_when_a_contact_opens():
    """A disc drawn off a wall and set on it again, against one that never touched."""
    law = law_of(friction=0.5)
    start = grains([[0.0, 0.9]], velocity=[[0.5, 0.0]], walls=(-9.0, 9.0, 0.0, 9.0))
    heavy = replace(start, mass=np.array([1e20]), inertia=np.array([1e20]))
    rubbed = advance(heavy, law, 1e-4, 1, 100).bed
    assert abs(forces(rubbed, law)[0, 0]) > 0.1
    lifted = advance(
        replace(rubbed, velocity=np.array([[0.0, 20.0]])), law, 1e-4, 1, 100, skin=1.0
    ).bed
    lowered = advance(
        replace(lifted, velocity=np.array([[0.0, -20.0]])), law, 1e-4, 1, 100, skin=1.0
    ).bed
    assert forces(lowered, law)[0, 1] == pytest.approx(forces(rubbed, law)[0, 1], rel=1e-9)
    assert abs(forces(lowered, law)[0, 0]) < 1e-9


def test_driven_bodies_that_touch_leave_numbers():
    """Two driven bodies in each other's way move as they are told, and do not feel each other."""
    law = law_of()
    bed = grains([[0.0, 0.0], [1.9, 0.0]], velocity=[[1.0, 0.0], [0.0, 0.0]])
    bed = replace(bed, mass=np.full(2, np.inf), inertia=np.full(2, np.inf))
    assert not len(contacts(bed, law).pair)
    assert not forces(bed, law).any()
    run = advance(bed, law, 1e-3, 1, 10)
    assert run.status == FINE
    assert run.bed.position == pytest.approx(np.array([[0.01, 0.0], [1.9, 0.0]]))
