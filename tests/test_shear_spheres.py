"""Sheared spheres beside what is known of them: Hertz, kinetic theory, and LAMMPS."""

from __future__ import annotations

from itertools import islice
from math import exp, hypot, log, pi, sqrt
from pathlib import Path

import gas_on_lammps
import numpy as np
import pytest
from gas import Gas, quantities
from test_dem_cylinders_motion import BIG, cylinders, last, law_of

from liftdrag import kinetic
from liftdrag.analysis.correlated import ratio_of_means
from liftdrag.dem.cylinders import shear
from liftdrag.kinetic import at_contact, steady_shear

MASSES, RADII, SPEED = [1.0, 0.7], [0.6, 0.3], 1.0


def head_on() -> tuple:
    """Two spheres about to meet, and the largest overlap and the duration by Hertz."""
    mass, radius = 0.7 / 1.7, 0.6 * 0.3 / 0.9
    stiffness = law_of().stiffness * sqrt(radius)
    depth = (5.0 * mass * SPEED**2 / (4.0 * stiffness)) ** 0.4
    away = [0.0, 0.0, 0.9 + 0.01 * depth]
    velocity = [[0.0, 0.0, 0.4 * SPEED], [0.0, 0.0, -0.6 * SPEED]]
    pair = cylinders([[0, 0, 0], away], [0, 0, 1], RADII, 0.0, velocity, mass=MASSES)
    return pair, depth, 2.9432 * depth / SPEED


def test_a_sphere_has_its_volume_and_inertia():
    pair, _, _ = head_on()
    assert pair.volume == pytest.approx([4.0 / 3.0 * pi * radius**3 for radius in RADII])
    both = np.array([0.4 * mass * radius**2 for mass, radius in zip(MASSES, RADII, strict=True)])
    assert pair.inertia == pytest.approx(np.column_stack([both, both]))
    assert pair.extent == pytest.approx(RADII)


def test_two_spheres_touch_as_long_and_as_deep_as_hertz_says():
    """Elastic, of other radii and masses; they part as fast as they met, and do not turn."""
    pair, depth, duration = head_on()
    run = list(islice(shear(pair, BIG, law_of(), duration / 200.0, 1), 220))
    touching = sum(sample.counts.sum() for sample in run) / 200.0
    assert touching == pytest.approx(1.0, abs=0.011)
    assert max(sample.overlap for sample in run) == pytest.approx(depth / 0.3, rel=2e-4)
    parted = run[-1].grains.velocity[1, 2] - run[-1].grains.velocity[0, 2]
    assert parted == pytest.approx(SPEED, rel=1e-4)
    assert np.array(MASSES) @ run[-1].grains.velocity[:, 2] == pytest.approx(0.4 - 0.42)
    assert not run[-1].grains.spin.any()


@pytest.mark.parametrize("restitution", [0.9, 0.6])
def test_restitution_of_two_spheres_is_that_of_the_law(restitution: float):
    """Exact for this dashpot (Antypov and Elliott, EPL 94 (2011) 50004), but for the step."""
    pair, _, duration = head_on()
    for fold in (1, 4, 16):
        step, law = duration / (50.0 * fold), law_of(restitution)
        after = last(1, pair, BIG, law, step, 90 * fold).grains.velocity
        rebound = (after[1, 2] - after[0, 2]) / SPEED
        assert rebound == pytest.approx(restitution, abs=3e-3 / fold)


def test_a_sphere_off_the_middle_of_a_face_rebounds_less():
    """The dashpot is that of both masses, what is pushed the inertia at the point, which is less.

    So the damping ratio is larger by the root of their ratio: 0.9 becomes 0.88, in closed form.
    """
    speed, arm = 1e-3, 0.6
    velocity = [[0.0, 0.0, 0.0], [0.0, 0.0, -speed]]
    pair = cylinders(
        [[0, 0, 0], [arm, 0, 0.8]], [0, 0, 1], [1.0, 0.3], [0.5, 0.0], velocity, mass=MASSES
    )
    free = 1.0 + 1.0 / 0.7
    pushed = free + arm**2 / pair.inertia[0, 0]
    ratio = -log(0.9) / hypot(pi, log(0.9)) * sqrt(pushed / free)
    stiffness = law_of().stiffness * sqrt(0.3 / 1.3)
    duration = 2.9432 * (5.0 * speed**2 / pushed / (4.0 * stiffness)) ** 0.4 / speed
    after = last(1, pair, BIG, law_of(0.9), duration / 800.0, 1500).grains
    face = after.velocity[0, 2] - after.spin[0, 1] * arm
    rebound = (after.velocity[1, 2] - face) / speed
    assert rebound == pytest.approx(exp(-pi * ratio / sqrt(1.0 - ratio**2)), abs=5e-4)
    assert rebound < 0.89


def test_elastic_spheres_at_rest_press_as_a_fluid_of_hard_ones():
    """1 + 4 nu g0 times their kinetic pressure, in all directions alike, at the same energy."""
    gas = Gas(0.3, 100, 0.01, restitution=1.0, rate=0.0)
    rows = gas.rows(8.0)
    kinetic_part, whole = (
        np.trace(part, axis1=1, axis2=2) for part in (rows[:, 0], rows.sum(axis=1))
    )
    fold = ratio_of_means(whole, kinetic_part, 0.1)
    effective = 0.3 * (1.0 - gas.soft) ** 3
    assert fold is not None
    assert (
        abs(fold.mean - 1.0 - 4.0 * effective * at_contact(effective)) < 3.0 * fold.standard_error
    )


def test_theory_turns_all_work_of_the_shear_into_heat():
    """Closing speeds cubed by themselves: n^2 g0 d^2 m (1 - e^2)/8 of them is what is lost."""
    found, number = steady_shear(0.2, 0.7), 6.0 * 0.2 / pi
    theta = found.kinetic * (6.0 / pi) / number
    cube = kinetic._directions()[1] @ kinetic._closing(theta)[2]
    lost = number**2 * at_contact(0.2) * (1.0 - 0.7**2) / 8.0 * cube * pi / 6.0
    assert found.shear_stress == pytest.approx(lost, rel=1e-9)


def enskog(fraction: float, restitution: float) -> tuple[float, float, float]:
    """Shear stress, pressure and energy of nearly elastic spheres, by Navier and Stokes.

    Garzo and Dufty, Phys. Rev. E 59 (1999) 5895, without their Sonine corrections.
    """
    g0, e = at_contact(fraction), restitution
    cooling = 5.0 / 12.0 * g0 * (1.0 - e**2)
    own = 1.0 - 0.4 * (1.0 + e) * (1.0 - 3.0 * e) * fraction * g0
    own /= g0 * (1.0 - (1.0 - e) ** 2 / 4.0) - cooling / 2.0
    viscosity = own * (1.0 + 0.8 * fraction * g0 * (1.0 + e))
    viscosity += 0.6 * 128.0 / (5.0 * pi) * fraction**2 * g0 * (1.0 + e)
    heat = 25.0 * pi * viscosity / (384.0 * 36.0 * fraction**2 * cooling)
    pressure = fraction * heat * (1.0 + 2.0 * (1.0 + e) * fraction * g0)
    return viscosity * 5.0 / 16.0 * sqrt(heat / pi) * pi / 6.0, pressure, 1.5 * heat


@pytest.mark.parametrize("fraction", [0.01, 0.2, 0.45])
def test_theory_of_nearly_elastic_spheres_is_enskogs(fraction: float):
    """To the first order of 1 - e."""
    errors = []
    for restitution in (0.99, 0.999):
        found, known = steady_shear(fraction, restitution), enskog(fraction, restitution)
        here = np.array([found.shear_stress, found.pressure, found.energy])
        errors.append(abs(here / known - 1.0).max())
    assert errors[0] < 0.03
    assert errors[1] < errors[0] / 8.0


def test_stresses_are_those_of_lammps_digit_by_digit(tmp_path: Path):
    """From the same grains, past the strain of a half at which its box flips; then chaos wins."""
    gas = Gas(0.4, 100, 0.01)
    here = gas.rows(0.6, every=0.6)
    there = gas_on_lammps.rows(gas, 0.6, tmp_path, every=0.6)
    assert here == pytest.approx(there, abs=1e-7)


@pytest.mark.validate
@pytest.mark.parametrize("fraction", [0.3, 0.5])
def test_a_long_flow_has_the_stresses_of_lammps(fraction: float, tmp_path: Path):
    """256 grains to a strain of 100: each stress known to 3 %, the same within three errors."""
    gas = Gas(fraction, 256, 0.01)
    here = quantities(gas.rows(100.0), 5.0)
    there = quantities(gas_on_lammps.rows(gas, 100.0, tmp_path), 5.0)
    for name, found in here.items():
        error = hypot(found.standard_error, there[name].standard_error)
        assert name == "normal_difference" or error < 0.03 * found.mean
        assert abs(found.mean - there[name].mean) < 3.0 * error, name


@pytest.mark.validate
@pytest.mark.parametrize("fraction", [0.05, 0.1])
def test_a_dilute_flow_is_that_of_theory(fraction: float):
    """800 grains, known to 1 or 2 %; Navier's and Stokes' shear stress is over 16 % higher."""
    gas = Gas(fraction, 800, 0.02)
    found, there = quantities(gas.rows(80.0), 10.0), gas.theory
    known = {
        "shear_stress": there.shear_stress,
        "pressure": there.pressure,
        "kinetic_pressure": float(np.trace(there.kinetic)) / 3.0,
    }
    for name, value in known.items():
        assert abs(found[name].mean - value) < 3.0 * found[name].standard_error, name
    assert found["shear_stress"].standard_error < 0.03 * known["shear_stress"]
    assert enskog(fraction, 0.9)[0] > 1.16 * steady_shear(fraction, 0.9).shear_stress
