"""Contact scales against Guillard et al. 2014, Table I, closed forms and a collision."""

from __future__ import annotations

from math import pi, sqrt

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from liftdrag import hertz

DIAMETER, DENSITY, MODULUS, POISSON = 1.5e-3, 2500.0, 5e6, 0.45
"""The grains of Table I, SI."""

MASS = DENSITY * pi * DIAMETER**3 / 6.0


def rayleigh_speed(poisson_ratio: float) -> float:
    """Exact speed of a Rayleigh wave over the shear wave's, a root of Rayleigh's equation."""
    share = (1.0 - 2.0 * poisson_ratio) / (2.0 * (1.0 - poisson_ratio))

    def equation(x: float) -> float:
        return x**3 - 8.0 * x**2 + 8.0 * x * (3.0 - 2.0 * share) - 16.0 * (1.0 - share)

    return sqrt(brentq(equation, 0.1, 1.0))


def collision_time(k: float, mass: float, speed: float) -> float:
    """Duration of an elastic Hertz collision, by integrating its equation of motion."""

    def motion(_time: float, state: np.ndarray) -> list[float]:
        return [state[1], -k * max(state[0], 0.0) ** 1.5 / mass]

    def parted(_time: float, state: np.ndarray) -> float:
        return state[0]

    parted.terminal, parted.direction = True, -1.0
    scale = (mass / k) ** 0.4 / speed**0.2
    found = solve_ivp(
        motion,
        (0.0, 20.0 * scale),
        [0.0, speed],
        events=parted,
        rtol=1e-10,
        atol=[1e-12 * scale * speed, 1e-12 * speed],
    )
    return float(found.t_events[0][-1])


def test_grains_have_the_stiffness_of_table_i():
    assert hertz.pair_stiffness(MODULUS, POISSON, DIAMETER) == pytest.approx(81e3, rel=0.005)


def test_grain_on_the_cylinder_has_the_stiffness_of_table_i():
    modulus = hertz.effective_modulus(MODULUS, POISSON)
    assert hertz.stiffness(modulus, DIAMETER / 2.0) == pytest.approx(114e3, rel=0.005)


@given(st.floats(1e4, 1e11), st.floats(0.0, 0.49), st.floats(1e-5, 1.0))
def test_pair_stiffness_follows_from_both_bodies(modulus: float, poisson: float, diameter: float):
    compliance = 2.0 * (1.0 - poisson**2) / modulus
    curvature = 2.0 / diameter + 2.0 / diameter
    expected = 4.0 / (3.0 * compliance * sqrt(curvature))
    assert hertz.pair_stiffness(modulus, poisson, diameter) == pytest.approx(expected, rel=1e-12)


def test_time_step_of_the_paper_is_a_tenth_of_the_rayleigh_time():
    time = hertz.rayleigh_time(DIAMETER, DENSITY, MODULUS, POISSON)
    assert 1e-5 / time == pytest.approx(0.106, abs=0.0005)


@pytest.mark.parametrize("poisson_ratio", [0.2, 0.3, 0.4, 0.45, 0.49])
def test_rayleigh_time_is_that_of_the_exact_wave(poisson_ratio: float):
    shear_speed = sqrt(MODULUS / (2.0 * (1.0 + poisson_ratio) * DENSITY))
    exact = pi * DIAMETER / 2.0 / (rayleigh_speed(poisson_ratio) * shear_speed)
    time = hertz.rayleigh_time(DIAMETER, DENSITY, MODULUS, poisson_ratio)
    assert time == pytest.approx(exact, rel=0.005)


@pytest.mark.parametrize("speed", [0.01, 0.1, 1.0])
@pytest.mark.parametrize("scale", [1.0, 1000.0])
def test_hertz_time_is_that_of_an_integrated_collision(speed: float, scale: float):
    k = scale * hertz.pair_stiffness(MODULUS, POISSON, DIAMETER)
    expected = collision_time(k, MASS / 2.0, speed)
    assert hertz.hertz_time(k, MASS / 2.0, speed) == pytest.approx(expected, rel=1e-4)


@given(st.floats(1e-9, 1e3), st.floats(1.0, 1e12))
def test_static_overlap_inverts_the_force(force: float, k: float):
    assert k * hertz.static_overlap(force, k) ** 1.5 == pytest.approx(force, rel=1e-12)


def test_static_overlap_is_where_the_energy_is_least():
    k, force = 81e3, 1e-2
    overlap = hertz.static_overlap(force, k)
    around = overlap * np.linspace(0.9, 1.1, 2001)
    energy = 0.4 * k * around**2.5 - force * around
    assert around[energy.argmin()] == pytest.approx(overlap, rel=2e-4)


def test_tangential_damping_of_the_papers_grains():
    assert hertz.tangential_damping(POISSON) == pytest.approx(0.8424, abs=5e-5)


@given(st.floats(0.0, 0.49))
def test_tangential_damping_is_the_root_of_the_stiffness_ratio(poisson_ratio: float):
    normal = 2.0 / (2.0 * (1.0 - poisson_ratio**2))
    tangential = 8.0 / (2.0 * (1.0 + poisson_ratio)) / (2.0 * (2.0 - poisson_ratio))
    expected = sqrt(tangential / normal)
    assert hertz.tangential_damping(poisson_ratio) == pytest.approx(expected, rel=1e-12)


@given(st.floats(1e-4, 1e-2), st.floats(1e-4, 1.0))
def test_raised_modulus_makes_a_curved_wall_as_stiff_as_a_plane(radius: float, cylinder: float):
    curved = 1.0 / (1.0 / radius + 1.0 / (2.0 * cylinder))
    raised = hertz.modulus_as_on_plane(MODULUS, radius, cylinder)
    assert raised * sqrt(curved) == pytest.approx(MODULUS * sqrt(radius), rel=1e-12)


def test_curvature_costs_seven_per_cent_at_the_papers_cylinder():
    raised = hertz.modulus_as_on_plane(MODULUS, DIAMETER / 2.0, 1.65 * DIAMETER)
    assert MODULUS / raised == pytest.approx(1.0 - 0.068, abs=0.0015)
