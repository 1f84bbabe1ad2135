"""Derived numbers against formulas written out by hand, and when each warning appears."""

from __future__ import annotations

from math import ceil, pi, sqrt

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from liftdrag.case import Case, load, packaged
from liftdrag.errors import CaseError
from liftdrag.numerics import Numerics, derive, explained
from liftdrag.numerics.tank import pressure

PAPER = Case(
    "paper",
    {
        "scene": "tank",
        "seed": 1,
        "grains": {
            "diameter": "1.5 mm",
            "density": "2.5 g/cm^3",
            "youngs_modulus": "5 MPa",
            "poisson_ratio": 0.45,
            "restitution": 0.6,
            "friction": 0.5,
        },
        "tank": {"length": "140 d", "thickness": "10 d", "height": "50 d"},
        "intruder": {"diameter": "3.3 d", "depth": "8 D"},
        "drive": {"speed": 0.02, "distance": "20 D"},
    },
)
"""The paper's box, slow enough to be quasi-static: nothing to warn about."""

D, DENSITY, MODULUS, POISSON, G = 1.5e-3, 2500.0, 5e6, 0.45, 9.81
CYLINDER, DEPTH, HEIGHT = 3.3 * D, 8.0 * 3.3 * D, 50.0 * D
BULK = 0.598 * DENSITY
MASS = DENSITY * pi * D**3 / 6.0
STIFFNESS = MODULUS / (3.0 * (1.0 - POISSON**2)) * sqrt(D)
LID = {"density_ratio": 60.0, "bulk_gravity": True}
WEIGHTLESS = {"density_ratio": 60.0, "bulk_gravity": False}


def under_lid(lid: dict[str, object]) -> Case:
    """The paper's box with a lid at its depth of 16 D."""
    return PAPER.set("tank.height", "60 d").set("intruder.depth", "16 D").set("lid", lid)


def numerics(key: str, value: object) -> Numerics:
    """The numerics of the paper's box with one key changed."""
    return derive(PAPER.set(key, value).scene)


def chain_rate(stiffness: float, masses: np.ndarray, loads: np.ndarray) -> float:
    """Slowest rate (rad/s) of a chain of masses on Hertz springs under `loads` (N), foot fixed."""
    springs = 1.5 * stiffness ** (2.0 / 3.0) * loads ** (1.0 / 3.0)
    inner = np.diag(springs) + np.diag(np.append(springs[1:], 0.0))
    matrix = inner + np.diag(-springs[1:], 1) + np.diag(-springs[1:], -1)
    return float(sqrt(np.linalg.eigvalsh(matrix / np.sqrt(np.outer(masses, masses)))[0]))


def test_time_step_is_a_fraction_of_the_smaller_time():
    wave = 0.1631 * POISSON + 0.8766
    rayleigh = pi * D / 2.0 * sqrt(DENSITY * 2.0 * (1.0 + POISSON) / MODULUS) / wave
    fall = sqrt(2.0 * G * D)
    overlap = (5.0 * (MASS / 2.0) * fall**2 / (4.0 * STIFFNESS)) ** 0.4
    found = derive(PAPER.scene)
    assert found.rayleigh_time.value == pytest.approx(rayleigh, rel=1e-10)
    assert found.hertz_time.value == pytest.approx(2.943275 * overlap / fall, rel=1e-6)
    assert found.time_step.value == pytest.approx(0.15 * rayleigh, rel=0.005)
    assert found.rayleigh_time.value < found.hertz_time.value


def test_fast_drive_shortens_the_impacts():
    slow, fast = derive(PAPER.scene), numerics("drive.speed", 50.0)
    share = (50.0 / sqrt(2.0 * G * D)) ** -0.2
    assert fast.hertz_time.value == pytest.approx(share * slow.hertz_time.value, rel=1e-10)
    assert fast.hertz_time.value < fast.rayleigh_time.value
    assert fast.time_step.value == pytest.approx(0.15 * fast.hertz_time.value, rel=0.005)


@pytest.mark.parametrize(
    ("key", "value", "name", "expected"),
    [
        ("numerics.time_step", "10 us", "time_step", 1e-5),
        ("numerics.skin", "0.3 d", "skin", 0.3 * D),
        ("numerics.sample_every", 4, "sample_every", 4),
    ],
)
def test_number_set_by_hand_is_kept(key: str, value: object, name: str, expected: float):
    found = getattr(numerics(key, value), name)
    assert found.value == pytest.approx(expected, rel=1e-11)
    assert found.reason.startswith("set by hand")


def test_settling_time_set_by_hand_is_kept():
    found = numerics("numerics.settle_time", "2 s")
    assert found.settle_steps.value == ceil(2.0 / found.time_step.value)
    assert found.settle_steps_max.value >= 3.0 * 2.0 / found.time_step.value


@settings(deadline=None, max_examples=40)
@given(st.floats(1e-3, 2.0), st.floats(0.02, 1.0))
def test_drive_covers_the_distance_and_no_step_more(speed: float, distance: float):
    found = derive(PAPER.set("drive.speed", speed).set("drive.distance", distance).scene)
    step = speed * found.time_step.value
    assert found.drive_steps.value * step >= distance * (1.0 - 1e-9)
    assert (found.drive_steps.value - 1) * step < distance * (1.0 + 1e-9)


@settings(deadline=None, max_examples=40)
@given(st.floats(1e-3, 5.0), st.floats(1e5, 1e9), st.one_of(st.none(), st.integers(1, 1000)))
def test_rows_are_whole_samples_and_samples_catch_each_contact(
    speed: float, modulus: float, chosen: int | None
):
    case = PAPER.set("drive.speed", speed).set("grains.youngs_modulus", modulus)
    if chosen is not None:
        case = case.set("numerics.sample_every", chosen)
    found = derive(case.scene)
    sample, row = found.sample_every.value, found.row_every.value
    assert row % sample == 0
    assert row >= sample >= 1
    assert abs(row * speed * found.time_step.value - 0.05 * D) <= sample * speed * (
        found.time_step.value
    )
    if chosen is None:
        assert 2.0 * sample * found.time_step.value <= found.hertz_time.value


@settings(deadline=None, max_examples=64)
@given(st.integers(1, 64), st.floats(3.1, 400.0))
def test_grid_takes_every_rank_splits_no_height_and_has_the_least_surface(
    ranks: int, thickness: float
):
    scene = PAPER.set("tank.thickness", f"{thickness!r} d").scene
    x, y, z = derive(scene, ranks).processors.value
    assert z == 1
    assert x * y == ranks

    def surface(columns: int) -> float:
        return columns * scene.tank.thickness + ranks // columns * scene.tank.length

    least = min(surface(c) for c in range(1, ranks + 1) if ranks % c == 0)
    assert surface(x) == pytest.approx(least, rel=1e-12)


def test_long_thin_tank_is_cut_along_the_flow():
    assert derive(PAPER.scene, 8).processors.value == (8, 1, 1)


@pytest.mark.parametrize(
    ("case", "expected"),
    [
        (PAPER, BULK * G * DEPTH),
        (under_lid(LID), BULK * G * 16.0 * CYLINDER + 60.0 * DENSITY * G * pi * D / 6.0),
        (under_lid(WEIGHTLESS), 60.0 * DENSITY * G * pi * D / 6.0),
    ],
    ids=["free surface", "lid", "lid alone has weight"],
)
def test_pressure_is_the_weight_above_the_axis(case: Case, expected: float):
    assert pressure(case.scene) == pytest.approx(expected, rel=1e-9)


def test_inertial_number_is_that_of_the_pressure_at_the_axis():
    expected = 0.02 / CYLINDER * D / sqrt(BULK * G * DEPTH / DENSITY)
    assert derive(PAPER.scene).inertial_number.value == pytest.approx(expected, rel=1e-9)


def test_overlap_ratio_inverts_the_contact_force_in_front():
    ratio = derive(PAPER.scene).overlap_ratio.value
    force = STIFFNESS * (ratio * D) ** 1.5
    assert force == pytest.approx(15.0 * BULK * G * DEPTH * D**2, rel=1e-9)


@pytest.mark.parametrize("length", ["60 d", "140 d"])
def test_grip_is_the_drag_over_the_friction_of_the_bottom(length: str):
    reach = float(length.split()[0]) * D
    expected = 10.0 * DEPTH * CYLINDER / (0.36 * HEIGHT * reach)
    assert numerics("tank.length", length).grip.value == pytest.approx(expected, rel=1e-9)


def test_grip_under_a_lid_counts_both_driven_layers():
    lid = pi * D / 6.0 * 60.0 / 0.598
    drag = 10.0 * lid * CYLINDER
    expected = drag / (0.36 * 2.0 * lid * 140.0 * D)
    assert derive(under_lid(WEIGHTLESS).scene).grip.value == pytest.approx(expected, rel=1e-9)


def test_short_tank_is_warned_about_slip_and_the_papers_is_not():
    low = PAPER.set("tank.height", "35 d").set("drive.distance", "10 D")
    short, long = (derive(low.set("tank.length", x).scene) for x in ("18 D", "42 D"))
    assert short.grip.value > 1.0
    assert [w.split(":")[0] for w in short.warnings] == ["The driven layers may slip"]
    assert long.warnings == ()


def test_bed_breathes_like_a_chain_of_grains_under_its_weight():
    column = BULK * D**3
    loads = column * G * (np.arange(50, 0, -1) - 0.5)
    rate = derive(PAPER.scene).settle_damping.value / MASS
    exact = chain_rate(STIFFNESS, np.full(50, column), loads)
    assert 0.6 * exact < rate < exact


def test_weightless_bed_breathes_like_a_chain_under_a_heavy_grain():
    column, lid = BULK * D**3, 60.0 * DENSITY * pi * D**3 / 6.0
    masses = np.append(np.full(60, column), lid)
    exact = chain_rate(STIFFNESS, masses, np.full(61, lid * G))
    rate = derive(under_lid(WEIGHTLESS).scene).settle_damping.value / MASS
    assert 0.6 * exact < rate < exact


def test_settling_lasts_a_period_and_twenty_at_most():
    found = derive(PAPER.scene)
    period = 2.0 * pi * MASS / found.settle_damping.value / found.time_step.value
    assert found.settle_steps.value == ceil(period)
    assert found.settle_steps_max.value == pytest.approx(20.0 * period, abs=1.0)


def test_settled_grains_creep():
    energy = derive(PAPER.scene).settle_energy.value
    assert energy == pytest.approx(1e-4 * MASS * G * D, rel=1e-9)


@pytest.mark.parametrize("distance", ["4 D", "5 D", "12 D", "100 D"])
def test_snapshots_are_a_handful(distance: str):
    found = numerics("drive.distance", distance)
    count = found.drive_steps.value // found.snapshot_every.value
    assert count == min(max(ceil(float(distance.split()[0]) / 4.0), 2), 6)


@pytest.mark.parametrize(("length", "ranks"), [("140 d", 1), ("140 d", 4), ("14000 d", 4)])
def test_restart_files_take_a_hundredth_of_a_run_and_come_every_minute_at_most(length, ranks):
    """At 4 million grain-steps a second and rank, and 100 000 grains written in one."""
    found = derive(PAPER.set("tank.length", length).scene, ranks)
    every, row = found.restart_every.value, found.row_every.value
    grains = found.grain_steps.value / (found.settle_steps.value + found.drive_steps.value)
    apart = every * grains / (4e6 * ranks)
    assert every % row == 0
    assert apart == pytest.approx(max(60.0, grains / 1e5 / 0.01), abs=row * grains / (4e6 * ranks))


def test_restart_files_set_by_hand_come_after_whole_rows():
    found = numerics("numerics.restart_every", 500)
    row = found.row_every.value
    assert found.restart_every.value == row * ceil(500 / row)


def test_cost_counts_driven_layers_too():
    found = derive(PAPER.scene)
    grains = PAPER.scene.grain_count + 140 * 10
    steps = found.settle_steps.value + found.drive_steps.value
    assert found.grain_steps.value == pytest.approx(grains * steps, rel=1e-9)
    assert found.core_hours.value == pytest.approx(grains * steps / 4e6 / 3600.0, rel=1e-9)


def test_papers_box_is_quiet():
    assert derive(PAPER.scene).warnings == ()


SMALLER = derive(PAPER.scene).rayleigh_time.value
BORDERLINE_SPEED = 0.02 / derive(PAPER.scene).inertial_number.value * 0.02
BORDERLINE_MODULUS = MODULUS * (derive(PAPER.scene).overlap_ratio.value / 0.05) ** 1.5
BORDERLINE_LENGTH = 140.0 * derive(PAPER.scene).grip.value / 0.5


@pytest.mark.parametrize(
    ("key", "quiet", "loud", "warning"),
    [
        ("numerics.time_step", 0.199 * SMALLER, 0.201 * SMALLER, "The time step set by hand"),
        ("drive.speed", 0.999 * BORDERLINE_SPEED, 1.001 * BORDERLINE_SPEED, "Not quasi-static"),
        ("tank.thickness", "8.01 d", "7.99 d", "The box is thin"),
        ("drive.distance", "83.9 d", "84.1 d", "The far field will hold grains that have passed"),
        (
            "tank.length",
            f"{1.001 * BORDERLINE_LENGTH!r} d",
            f"{0.999 * BORDERLINE_LENGTH!r} d",
            "The driven layers may slip",
        ),
        (
            "grains.youngs_modulus",
            1.001 * BORDERLINE_MODULUS,
            0.999 * BORDERLINE_MODULUS,
            "Soft grains",
        ),
    ],
)
def test_warning_appears_just_when_its_condition_holds(
    key: str, quiet: object, loud: object, warning: str
):
    base = PAPER.set("drive.distance", "50 d") if key == "tank.length" else PAPER
    assert derive(base.set(key, quiet).scene).warnings == ()
    found = derive(base.set(key, loud).scene).warnings
    assert len(found) == 1
    assert found[0].startswith(warning)


def test_a_lid_nearer_than_the_papers_is_warned_about():
    def near(depth: str) -> list[str]:
        found = derive(under_lid(LID).set("intruder.depth", depth).scene).warnings
        return [warning for warning in found if warning.startswith("The lid is near")]

    assert near("16 D") == []
    assert len(near("15.9 D")) == 1


@pytest.mark.parametrize(("distance", "warning"), [("139.9 d", "far field"), ("140.1 d", "wake")])
def test_a_second_pass_is_worse_than_a_spoilt_far_field(distance: str, warning: str):
    found = numerics("drive.distance", distance).warnings
    assert len(found) == 1
    assert warning in found[0]


@pytest.mark.parametrize("name", sorted(packaged()))
def test_every_value_has_a_unit_and_a_reason(name: str):
    rows = dict(derive(load(name).scene).rows())
    assert len(rows) >= 12
    assert all(value.reason.strip() and value.unit.strip() for value in rows.values())
    assert all(np.all(np.asarray(value.value) > 0) for value in rows.values())


def test_explanation_names_each_value_with_its_reason_and_the_warnings():
    found = numerics("drive.speed", 1.0)
    lines = explained(found).splitlines()
    for name, value in found.rows():
        (line,) = (x for x in lines if x.split()[0] == name)
        assert line.endswith(value.reason)
        assert f" {value.unit} " in line
    assert lines[-len(found.warnings) :] == [f"WARNING: {text}" for text in found.warnings]
    assert found.warnings


def test_grains_too_soft_to_be_grains_are_refused():
    with pytest.raises(
        CaseError, match=r"^grains\.youngs_modulus = 1000: .* at least 1\.\d+e\+0[56] Pa"
    ):
        numerics("grains.youngs_modulus", 1e3)
