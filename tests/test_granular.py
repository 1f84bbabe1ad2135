"""Numbers of granular beds against weights and forces put together by hand."""

from __future__ import annotations

from math import pi

import pytest
from hypothesis import given
from hypothesis import strategies as st

from liftdrag import granular

DIAMETER, DENSITY, BULK = 1.5e-3, 2500.0, 1500.0


def test_sphere_volume_fills_its_share_of_a_cube():
    assert granular.sphere_volume(2.0) == pytest.approx(4.0 / 3.0 * pi, rel=1e-15)


def test_inertial_number_compares_the_rate_with_a_grains_fall_under_pressure():
    speed, intruder, depth = 0.02, 3.3 * DIAMETER, 26.4 * DIAMETER
    pressure = BULK * 9.81 * depth
    number = granular.inertial_number(speed / intruder, DIAMETER, pressure, DENSITY)
    fall = DIAMETER * (DENSITY / pressure) ** 0.5
    assert number == pytest.approx(speed / intruder * fall, rel=1e-12)
    assert number == pytest.approx(0.0126, rel=0.01)


@given(st.floats(0.1, 10.0))
def test_inertial_number_is_proportional_to_speed_and_falls_with_pressure(factor: float):
    number = granular.inertial_number(1.0, DIAMETER, 500.0, DENSITY)
    faster = granular.inertial_number(factor, DIAMETER, 500.0, DENSITY)
    pressed = granular.inertial_number(1.0, DIAMETER, 500.0 * factor, DENSITY)
    assert faster == pytest.approx(factor * number, rel=1e-12)
    assert pressed == pytest.approx(number / factor**0.5, rel=1e-12)


@pytest.mark.parametrize("ratio", [60.0, 210.0])
def test_lid_weighs_as_much_as_bed_of_its_depth(ratio: float):
    depth = granular.lid_depth(DIAMETER, ratio * DENSITY / BULK)
    one_grain = ratio * DENSITY * pi * DIAMETER**3 / 6.0
    assert depth * BULK * DIAMETER**2 == pytest.approx(one_grain, rel=1e-12)


def test_papers_lightest_lid_is_worth_sixteen_cylinder_diameters():
    depth = granular.lid_depth(DIAMETER, 60.0 * DENSITY / BULK)
    assert depth / (3.3 * DIAMETER) == pytest.approx(16.0, rel=0.01)


def test_grip_is_the_drag_over_the_friction_of_the_bottom():
    depth, intruder, height, length, thickness = 0.04, 0.005, 0.075, 0.21, 0.015
    drag = 10.0 * BULK * 9.81 * depth * intruder * thickness
    friction = 0.36 * BULK * 9.81 * height * length * thickness
    share = granular.grip(10.0, depth, intruder, 0.36, height * length)
    assert share == pytest.approx(drag / friction, rel=1e-12)
