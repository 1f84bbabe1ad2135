"""A shear flow of rods and disks: its case, its numerics and the paper's curves."""

from __future__ import annotations

import tomllib
from math import exp, hypot, pi, sqrt
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from liftdrag import kinetic, liu
from liftdrag.case import Case, load
from liftdrag.errors import CaseError, InputError
from liftdrag.numerics import ShearNumerics, derive
from liftdrag.numerics.bounds import bounds_of
from liftdrag.scene import ShearScene
from liftdrag.study import read

TINY = """
scene = "shear"
seed = 1
[grains]
diameter = "0.238 mm"
density = 2500
youngs_modulus = "8.7 GPa"
poisson_ratio = 0.3
restitution = 0.9
[cell]
solid_fraction = 0.3
count = 60
[[species]]
aspect_ratio = 2
share = 0.5
[[species]]
aspect_ratio = 0.5
share = 0.5
[drive]
shear_rate = "100 Hz"
strain = 1.5
average_from = 0.5
[numerics]
stiffness_factor = 1e-5
"""
"""Sixty stout rods and disks."""


def tiny(**tables: Any) -> Case:
    """The tiny cell, with these keys of its tables changed or added; None leaves one out."""
    base = tomllib.loads(TINY)
    for key, table in tables.items():
        both = base.get(key, {}) | table if isinstance(table, dict) else table
        base[key] = (
            {name: one for name, one in both.items() if one is not None}
            if isinstance(both, dict)
            else both
        )
    return Case("tiny", base)


def scene_of(**tables: Any) -> ShearScene:
    scene = tiny(**tables).scene
    assert isinstance(scene, ShearScene)
    return scene


def numerics_of(**tables: Any) -> ShearNumerics:
    return derive(scene_of(**tables))


PAPER = {"length": "30.25 d_v", "height": "30.25 d", "width": "15.13 d_v", "count": None}
"""The sides of the paper's cell."""


@settings(deadline=None, max_examples=40)
@given(ratio=st.floats(0.05, 20.0), diameter=st.floats(1e-5, 1e-2))
def test_sides_of_a_species_have_the_volume_of_the_sphere(ratio: float, diameter: float):
    scene = scene_of(
        grains={"diameter": diameter},
        species=[{"aspect_ratio": ratio, "share": 1.0}],
        cell={"count": 20_000, "solid_fraction": 0.05},
    )
    across, length = scene.species[0].sides(scene.grains.diameter)
    assert length / across == pytest.approx(ratio)
    assert pi / 4.0 * across**2 * length == pytest.approx(pi / 6.0 * scene.grains.diameter**3)
    assert scene.longest == pytest.approx(hypot(across, length))


def test_cell_of_the_paper_holds_what_its_solid_fraction_says():
    scene = scene_of(cell=PAPER | {"solid_fraction": 0.5})
    room = 30.25 * 30.25 * 15.13
    assert scene.grain_count == round(0.5 * room / (pi / 6.0))
    assert scene.solid_fraction == pytest.approx(0.5, abs=1e-4)
    assert scene.sides == pytest.approx((30.25 * 0.238e-3, 30.25 * 0.238e-3, 15.13 * 0.238e-3))


def test_count_makes_a_cube_at_exactly_the_solid_fraction():
    scene = scene_of(cell={"count": 300, "solid_fraction": 0.45})
    assert len(set(scene.sides)) == 1
    assert scene.solid_fraction == pytest.approx(0.45)
    assert scene.volume == pytest.approx(300 * pi / 6.0 * 0.238e-3**3 / 0.45)


def shares(*parts: float) -> list[dict[str, float]]:
    return [{"aspect_ratio": 1.5 + k, "share": part} for k, part in enumerate(parts)]


def test_numbers_of_the_species_are_the_nearest_to_their_shares():
    """Largest remainders: 3.33, 3.33 and 3.33 of 100 tenths give 34, 33, 33."""
    scene = scene_of(species=shares(1 / 3, 1 / 3, 1 / 3), cell={"count": 100})
    assert scene.counts == (34, 33, 33)
    assert scene_of(species=shares(0.009, 0.991), cell={"count": 100}).counts == (1, 99)
    assert scene_of().rod_fraction == 0.5


SPHERES = [{"shape": "sphere", "share": 1.0}]


def test_sphere_is_that_of_the_volume():
    """Its diameter is every side of it, and the paper's critical time is that of Rayleigh."""
    scene = scene_of(species=SPHERES)
    d = scene.grains.diameter
    assert scene.species[0].sides(d) == (d, d)
    assert scene.longest == d
    assert scene.rod_fraction == 0.0
    rayleigh = pi * 0.5 * d / (0.1631 * 0.3 + 0.8766) * sqrt(2500.0 / (8.7e4 / 2.6))
    assert derive(scene).critical_time.value == pytest.approx(rayleigh)


REFUSED = {
    "nothing": ({"species": []}, "species"),
    "shares short of one": ({"species": shares(0.5, 0.4)}, "sum to 0.9"),
    "shares beyond one": ({"species": shares(0.7, 0.4)}, "sum to 1.1"),
    "spheres twice": ({"species": [{"shape": "sphere", "share": 0.5}] * 2}, "or are spheres"),
    "a long sphere": (
        {"species": [{"shape": "sphere", "aspect_ratio": 1, "share": 1.0}]},
        r"species\.0\.aspect_ratio = 1.*a sphere has none",
    ),
    "no ratio": ({"species": [{"share": 1.0}]}, r"species\.0\.aspect_ratio: a cylinder needs it"),
    "a cube": ({"species": [{"shape": "cube", "share": 1.0}]}, r"species\.0\.shape"),
    "a ratio twice": ({"species": [{"aspect_ratio": 2, "share": 0.5}] * 2}, "one aspect_ratio"),
    "too flat": ({"species": [{"aspect_ratio": 0.01, "share": 1.0}]}, "aspect_ratio"),
    "too long": ({"species": [{"aspect_ratio": 50, "share": 1.0}]}, "aspect_ratio"),
    "no strain": ({"drive": {"strain": 0}}, "drive.strain"),
    "no mean": ({"drive": {"average_from": 2}}, "nothing is left to average"),
    "no transient": ({"drive": {"average_from": None}}, "drive.average_from"),
    "no size": ({"cell": {"count": None}}, "cell.length"),
    "two sizes": ({"cell": {"length": "30 d"}}, "cell.count"),
    "half a size": ({"cell": {"count": None, "length": "9 d", "width": "9 d"}}, "cell.height"),
    "too full": ({"cell": {"solid_fraction": 0.65}}, "cell.solid_fraction"),
    "empty": ({"cell": PAPER | {"solid_fraction": 0.002, "width": "3 d"}}, "would hold 10"),
    "narrow": ({"cell": PAPER | {"width": "1.5 d"}}, "its own image"),
    "few": ({"species": [{"aspect_ratio": 20, "share": 1.0}]}, "its own image"),
    "a grain of none": ({"species": shares(0.999, 0.001)}, "less than one"),
    "a stop by what is not": (
        {"stop": {"quantity": "drag", "relative_error": 0.1}},
        "no run can be stopped by this",
    ),
    "a rate in metres": ({"drive": {"shear_rate": "1 m"}}, "does not measure this"),
    "friction": ({"grains": {"friction": 0.5}}, "grains.friction"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_bad_cell_is_refused_in_a_sentence(name: str):
    tables, says = REFUSED[name]
    with pytest.raises(InputError, match=says) as caught:
        scene_of(**tables)
    assert "\n" not in str(caught.value)
    assert str(caught.value).endswith(".")


def test_time_step_is_a_tenth_of_the_papers_critical_one():
    """Eq. 13 by hand, for the softened modulus and the least side of all species."""
    numerics = numerics_of(numerics={"stiffness_factor": 1e-3})
    across = 0.238e-3 * (2.0 / (3.0 * 0.5)) ** (1.0 / 3.0)
    modulus = 8.7e9 * 1e-3 / (2.0 * 1.3)
    critical = pi * 0.5 * across / (0.3262 * 0.3 + 1.7532) * sqrt(2500.0 / modulus)
    assert numerics.critical_time.value == pytest.approx(critical)
    assert 0.09 * critical < numerics.time_step.value <= 0.1 * critical
    soft = numerics_of(numerics={"stiffness_factor": 1e-5})
    assert soft.critical_time.value == pytest.approx(10.0 * critical)


@pytest.mark.parametrize("chosen", [{}, {"sample_every": 7}, {"time_step": 1e-6}])
def test_rows_and_frames_end_at_the_strain(chosen: dict[str, Any]):
    numerics = numerics_of(numerics=chosen | {"stiffness_factor": 1e-5})
    steps, row, frame = (
        getattr(numerics, name).value for name in ("drive_steps", "row_every", "frame_every")
    )
    assert steps * numerics.time_step.value * 100.0 == pytest.approx(1.5)
    assert steps % frame == frame % row == 0
    assert row == chosen.get("sample_every", row)
    assert numerics.time_step.value <= chosen.get("time_step", 1.0)


def test_step_that_resolves_no_contact_is_refused_and_a_long_one_warned_of():
    critical = numerics_of().critical_time.value
    with pytest.raises(CaseError, match="no contact is resolved"):
        numerics_of(numerics={"time_step": 1.01 * critical})
    warned = numerics_of(numerics={"time_step": 0.35 * critical}).warnings
    assert any("time step set by hand" in warning for warning in warned)
    with pytest.raises(CaseError, match="steps"):
        numerics_of(numerics={"time_step": 1e-12}, drive={"strain": 100})


def test_overlap_to_expect_is_of_load_and_impact():
    """Hertz by hand: (P d^2/k)^(2/3) + (5 m/2 v^2 / 4k)^(2/5), k of two disks' or rods' radii."""
    scene = scene_of(cell={"solid_fraction": 0.5, "count": 60})
    numerics = derive(scene)
    radius = 0.5 * 0.238e-3 * (2.0 / (3.0 * 2.0)) ** (1.0 / 3.0)
    k = 4.0 / 3.0 * 8.7e4 / (2.0 * (1.0 - 0.09)) * sqrt(radius / 2.0)
    pressure = 2500.0 * (0.238e-3 * 100.0) ** 2 * exp(-3.3785 * 0.5 + 2.8122)
    static = (pressure * 0.238e-3**2 / k) ** (2.0 / 3.0)
    impact = (5.0 * scene.mass / 2.0 * (100.0 * scene.longest) ** 2 / (4.0 * k)) ** 0.4
    side = 0.5 * 0.238e-3 * (2.0 / (3.0 * 0.5)) ** (1.0 / 3.0)
    assert numerics.pressure.value == pytest.approx(pressure)
    assert numerics.overlap_ratio.value == pytest.approx((static + impact) / side)
    assert any("Soft grains" in warning for warning in numerics.warnings)
    assert not any("Soft" in w for w in numerics_of(numerics={"stiffness_factor": 1.0}).warnings)


def test_cell_has_room_for_the_longest_grain_and_the_skin_of_its_lists():
    """A side of the longest grain and half a d_v is refused, a hair more is not."""
    least = scene_of().longest + 0.5 * 0.238e-3
    wide = {"count": None, "length": "30 d_v", "height": "30 d_v"}
    with pytest.raises(CaseError, match="its own image"):
        scene_of(cell=wide | {"width": least * (1.0 - 1e-9)})
    assert scene_of(cell=wide | {"width": least * (1.0 + 1e-9)}).grain_count > 0


def test_small_cell_is_warned_of():
    rods = [{"aspect_ratio": 6, "share": 1.0}]
    small = numerics_of(species=rods, cell={"count": 100, "solid_fraction": 0.5})
    large = numerics_of(species=rods, cell={"count": 400, "solid_fraction": 0.5})
    assert any("own images" in warning for warning in small.warnings)
    assert not any("own images" in warning for warning in large.warnings)


def test_few_grains_are_warned_of_where_cylinders_are_dense():
    def warned(**changes) -> bool:
        return any("Few grains" in warning for warning in numerics_of(**changes).warnings)

    few, many = {"count": 1999, "solid_fraction": 0.4}, {"count": 2000, "solid_fraction": 0.4}
    assert warned(cell=few)
    assert not warned(cell=many)
    assert not warned(cell=few | {"solid_fraction": 0.39})
    assert not warned(cell=few, species=[{"shape": "sphere", "share": 1.0}])


def test_step_is_far_below_what_breaks_a_crowd_of_grains():
    bounds = bounds_of(scene_of())
    assert bounds.own < bounds.earliest < bounds.expected


@pytest.mark.parametrize("name", ["shear_stress", "pressure"])
def test_curves_of_both_tables_agree_at_half(name: str):
    """Table 3, its two rows swapped, gives Table 2 within 15 % of the stress over S > 0.5."""
    order = np.linspace(0.5, 0.8, 7)
    at_half, beside = liu.curve(name, 0.5), liu.curve(name, 0.494)
    assert at_half is not None
    assert beside is not None
    fitted = [float(np.polyval(row, 0.5)) for row in liu.TABLE_3[name]]
    assert liu.Curve(*fitted)(order) == pytest.approx(at_half(order), rel=0.3)
    assert (beside(order) < at_half(order) * 1.3).all()


def test_curve_at_half_is_that_of_the_paper():
    found = liu.curve("shear_stress", 0.5), liu.curve("pressure", 0.5)
    assert [float(one(np.array(0.7))) for one in found if one] == pytest.approx(
        [exp(-5.0174 * 0.7 + 2.2389), exp(-3.3785 * 0.7 + 2.8122)]
    )
    friction = liu.curve("bulk_friction", 0.5)
    assert friction is not None
    assert float(friction(np.array(0.7))) == pytest.approx(exp(-1.6389 * 0.7 - 0.5733))
    for name in ("pressure", "bulk_friction"):
        assert liu.curve(name, 0.3) is None
        assert liu.curve(name, 0.6) is None


@pytest.mark.parametrize("name", ["shear/quick", "shear/spheres", "liu2020/rods"])
def test_packaged_case_is_a_good_one(name: str):
    scene = load(name).scene
    assert isinstance(scene, ShearScene)
    assert derive(scene).warnings is not None


def test_study_runs_what_its_names_say():
    """nu050-c025 is a solid fraction of 0.5 and a quarter of rods of 6 among disks of 0.3."""
    plan = read("liu2020/rods-and-disks")
    for name, one in plan.runs.items():
        case = load(one.case)
        for key, value in (plan.set | one.set).items():
            case = case.set(key, value)
        scene = case.scene
        assert isinstance(scene, ShearScene)
        fraction, rods = (int(part[-3:]) / 100.0 for part in name.split("-"))
        assert (scene.cell.solid_fraction, scene.rod_fraction) == (fraction, rods)
        assert {one.aspect_ratio for one in scene.species} <= {6, 0.3}
    assert len({one.set["seed"] for one in plan.runs.values()}) == len(plan.runs) == 20


def test_pressure_of_spheres_is_that_of_kinetic_theory():
    """Hot grains press the more; where there is no steady flow, and among rods, the curve does."""
    balls = [{"shape": "sphere", "share": 1}]
    expected = {}
    for e in (0.9, 0.99, 1.0 - 1e-12):
        scene = scene_of(species=balls, grains={"restitution": e}, cell={"solid_fraction": 0.3})
        expected[e] = derive(scene).pressure.value / scene.stress_scale
    assert expected[0.9] == pytest.approx(kinetic.steady_shear(0.3, 0.9).pressure)
    assert expected[0.99] > 5.0 * expected[0.9]
    curve = liu.curve("pressure", 0.4)
    assert curve is not None
    assert expected[1.0 - 1e-12] == pytest.approx(float(curve(np.array(0.5))))
