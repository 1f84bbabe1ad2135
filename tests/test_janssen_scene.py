"""The piston: its case, its column and its numerics, against closed forms."""

from __future__ import annotations

import json
import tomllib
from itertools import pairwise
from math import e, exp, pi, sqrt
from typing import Any

import numpy as np
import pytest
from scipy.spatial import cKDTree
from typer.testing import CliRunner

from liftdrag import granular, hertz
from liftdrag.case import Case, load, packaged
from liftdrag.cli import app
from liftdrag.errors import CaseError
from liftdrag.granular import GRAVITY, janssen_stress
from liftdrag.numerics import JanssenNumerics, derive, explained
from liftdrag.numerics.janssen import BLOCKS, PROFILES, ROWS
from liftdrag.packing.relaxation import TOLERANCE
from liftdrag.packing.tube import packed_column
from liftdrag.scene import JanssenScene

TINY = """
scene = "janssen"
seed = 1
[grains]
diameter = "3 mm"
density = 2500
restitution = 0.6
friction = 0.5
contact = "linear"
[tube]
diameter = "6 d"
height = "60 mm"
friction = 0.4
[fill]
mass = "6 g"
levels = 3
[drive]
motion = "piston down"
speed = "20 mm/s"
distance = "0.2 d"
mobilise = "0.2 d"
[numerics]
settle_time = "60 ms"
"""
"""Some 170 grains in a tube six wide, filled in three steps."""

D = 3e-3

FRACTION = 0.62 * (1 - 1 / 12) ** 2
"""Solid fraction expected in a tube six grains wide."""


def tiny(**tables: Any) -> Case:
    """The tiny column, with these keys of its tables changed or, where None, left out."""
    base = tomllib.loads(TINY)
    for key, table in tables.items():
        changed = base.get(key, {}) | table
        base[key] = {name: value for name, value in changed.items() if value is not None}
    return Case("tiny", base)


def scene_of(**tables: Any) -> JanssenScene:
    scene = tiny(**tables).scene
    assert isinstance(scene, JanssenScene)
    return scene


def numerics_of(**tables: Any) -> JanssenNumerics:
    return derive(scene_of(**tables))


def test_fill_by_mass_or_height():
    by_mass = scene_of()
    grain = 2500 * pi * D**3 / 6
    assert by_mass.grains.mass == pytest.approx(grain)
    assert by_mass.grain_count == round(6e-3 / grain)
    assert by_mass.counts == tuple(round(by_mass.grain_count * k / 3) for k in (1, 2, 3))
    height = 20e-3
    by_height = scene_of(fill={"mass": None, "height": height})
    volume = by_height.grain_count * pi * D**3 / 6
    assert volume / (pi * (6 * D) ** 2 / 4 * height) == pytest.approx(FRACTION, rel=1e-2)
    assert scene_of(fill={"curve": False}).counts == (by_mass.grain_count,)


def test_tube_up_is_piston_down_in_the_frame_of_the_piston():
    down, up = scene_of(), scene_of(drive={"motion": "tube up"})
    assert down.wall_speed == up.wall_speed == 0.02
    assert scene_of(drive={"motion": "piston up"}).wall_speed == -0.02
    still = {"motion": "none", "speed": None, "distance": None, "mobilise": None, "duration": 0.1}
    assert scene_of(drive=still).wall_speed == 0.0


WRONG: dict[str, tuple[dict[str, Any], str, str]] = {
    "thin tube": ({"tube": {"diameter": "1.9 d"}}, "tube.diameter", "0.006"),
    "overfull": ({"fill": {"mass": "60 g"}}, "fill.mass", "raise tube.height"),
    "both fills": ({"fill": {"height": "1 cm"}}, "fill", "one of the two"),
    "no fill": ({"fill": {"mass": None}}, "fill", "one of the two"),
    "less than a grain": ({"fill": {"mass": "1 mg"}}, "fill.mass", "kg"),
    "e above 1": ({"grains": {"restitution": 1.2}}, "grains.restitution", "1"),
    "e zero": ({"grains": {"restitution": 0.0}}, "grains.restitution", "0"),
    "mu_w negative": ({"tube": {"friction": -0.1}}, "tube.friction", "0"),
    "no speed": ({"drive": {"speed": None}}, "drive.speed", "add it"),
    "a speed at rest": (
        {"drive": {"motion": "none", "duration": 1.0}},
        "drive.speed",
        "leave it out",
    ),
    "duration in motion": ({"drive": {"duration": 1.0}}, "drive.duration", "leave it out"),
    "modulus of a spring": ({"grains": {"youngs_modulus": 1e6}}, "grains.youngs_modulus", "leave"),
    "stiffness of Hertz": (
        {"grains": {"contact": "hertz", "poisson_ratio": 0.3, "stiffness": 1e4}},
        "grains.stiffness",
        "leave it out",
    ),
    "Hertz without ratio": ({"grains": {"contact": "hertz"}}, "grains.poisson_ratio", "add it"),
    "lid in a narrow tube": (
        {"tube": {"diameter": "3 d"}, "fill": {"mass": "1 g"}, "overload": {"mass": "1 g"}},
        "tube.diameter",
        "four grains",
    ),
}


@pytest.mark.parametrize("wrong", WRONG)
def test_bad_input_names_the_key_and_the_remedy(wrong: str):
    tables, key, remedy = WRONG[wrong]
    with pytest.raises(CaseError) as caught:
        tiny(**tables).scene  # noqa: B018
    assert caught.value.key == key
    assert remedy in str(caught.value)


@pytest.mark.parametrize(
    ("key", "tables"),
    [
        ("numerics.time_step", {"numerics": {"time_step": 1e-3}}),
        ("numerics.skin", {"numerics": {"skin": "2 d"}}),
        ("drive.distance", {"drive": {"distance": "9 km"}}),
        ("drive.distance", {"drive": {"distance": "1e-7 m"}}),
        ("drive.mobilise", {"drive": {"mobilise": "9 km"}}),
        ("numerics.settle_time", {"numerics": {"settle_time": 1e5}}),
        ("grains.stiffness", {"grains": {"stiffness": 1e-2}}),
        (
            "fill.mass",
            {"fill": {"mass": "300 g"}, "tube": {"height": 1}, "drive": {"motion": "piston up"}},
        ),
    ],
)
def test_bad_numerics_name_the_key(key: str, tables: dict[str, Any]):
    with pytest.raises(CaseError) as caught:
        numerics_of(**tables)
    assert caught.value.key == key


def test_janssen_stress_solves_his_equation():
    """d sigma/dz = w - beta sigma, sigma(0) = top, by Euler's steps and in the known limits."""
    for beta in (-30.0, 0.0, 30.0):
        stress, top, steps = 50.0, 50.0, 200_000
        for _ in range(steps):
            stress += (1.5e4 - beta * stress) * 0.1 / steps
        assert janssen_stress(0.1, 1.5e4, beta, top) == pytest.approx(stress, rel=1e-4)
    assert janssen_stress(1e3, 1.5e4, 30.0, 50.0) == pytest.approx(500.0)
    assert janssen_stress(0.1, 1.5e4, 1e-9) == pytest.approx(1500.0)
    assert janssen_stress(1 / 30, 1.5e4, 30.0) == pytest.approx(500 * (1 - 1 / e))


def test_stiffness_comes_from_the_overlap_bound_under_the_largest_load():
    scene, found = scene_of(), numerics_of()
    beta = 4 * 0.4 * 0.4 / (6 * D)
    weight = FRACTION * 2500 * GRAVITY
    depth = scene.grain_count * pi * D**3 / 6 / FRACTION / (pi * (6 * D) ** 2 / 4)
    stress = weight / beta * (1 - exp(-beta * depth))
    assert found.largest_stress.value == pytest.approx(stress)
    force = 5 * 0.9 * stress * D**2
    assert found.stiffness.value == pytest.approx(force / (1e-3 * D), rel=5e-3)
    assert found.overlap_ratio.value == pytest.approx(1e-3, rel=5e-3)
    soft = numerics_of(numerics={"overlap_bound": 4e-3})
    assert soft.stiffness.value == pytest.approx(found.stiffness.value / 4, rel=5e-3)
    grains = {"contact": "hertz", "poisson_ratio": 0.3}
    modulus = numerics_of(grains=grains).stiffness.value
    depth = (force / hertz.pair_stiffness(modulus, 0.3, D)) ** (2 / 3)
    assert depth == pytest.approx(1e-3 * D, rel=5e-3)


def test_upward_load_grows_exponentially():
    down, up = numerics_of(), numerics_of(drive={"motion": "piston up"})
    beta, weight = 4 * 0.4 * 1.2 / (6 * D), FRACTION * 2500 * GRAVITY
    depth = scene_of().height_of(scene_of().grain_count)
    assert up.largest_stress.value == pytest.approx(weight / beta * (exp(beta * depth) - 1))
    assert up.largest_stress.value > 2 * down.largest_stress.value


@pytest.mark.parametrize("contact", ["linear", "walton-braun"])
def test_time_step_is_a_part_of_the_shortest_contact(contact: str):
    found = numerics_of(grains={"contact": contact, "stiffness": 5e3})
    steepest = 5e3 / (0.36 if contact == "walton-braun" else 1.0)
    contact_time = pi * sqrt(scene_of().grains.mass / 2 / steepest)
    assert found.contact_time.value == pytest.approx(contact_time)
    assert found.time_step.value <= contact_time / 25 * (1 + 1e-9)
    assert found.time_step.value > 0.9 * contact_time / 25
    average = found.average_steps.value * found.time_step.value
    assert average == pytest.approx(0.2 * D / 0.02)


def test_levels_follow_each_other_in_whole_blocks():
    found = numerics_of()
    levels, block = found.levels, found.block_every.value
    assert [level.count for level in levels] == list(scene_of().counts)
    assert levels[0].start == 0
    assert all(a.end == b.start for a, b in pairwise(levels))
    for level in levels:
        phases = np.diff([level.start, level.settled, level.mobilised, level.end])
        assert (phases % block == 0).all()
        assert phases[0] * found.time_step.value >= 60e-3 * (1 - 1e-9)
        assert phases[1] * found.time_step.value >= 0.2 * D / 0.02 * (1 - 1e-9)
        assert phases[2] == ROWS * found.row_every.value == BLOCKS * block
    assert found.row_every.value % found.sample_every.value == 0
    assert block == PROFILES * found.profile_every.value
    single = numerics_of(fill={"curve": False})
    assert [level.count for level in single.levels] == [scene_of().grain_count]


def test_warnings_of_the_numerics():
    assert numerics_of(drive={"speed": "10 mm/s"}).warnings == ()
    (fast,) = numerics_of(drive={"speed": "0.5 m/s"}).warnings
    half = scene_of().height_of(scene_of().grain_count) / 2
    number = granular.inertial_number(0.5 / D, D, FRACTION * 2500 * GRAVITY * half, 2500)
    assert fast.startswith("Not quasi-static")
    assert f"{number:.2g}" in fast
    slow = {"speed": "10 mm/s"}
    (soft,) = numerics_of(grains={"stiffness": 20}, drive=slow).warnings
    assert soft.startswith("Soft grains")
    (few,) = derive(scene_of(drive=slow), 2).warnings
    assert few.startswith("Few grains to share")
    assert "until the packing is forgotten" in explained(derive(load("janssen/quick").scene))


@pytest.mark.parametrize("diameter", [2.0, 3.3, 13.3])
def test_packed_column_fits_its_tube(diameter: float):
    """No overlap beyond the tolerance, all within the walls, in order of height; by the seed."""
    tables = {"tube": {"diameter": diameter * D, "height": "1 m"}, "fill": {"mass": "2 g"}}
    scene = scene_of(**tables)
    column = packed_column(scene)
    x = column.grains
    assert len(x) == scene.grain_count
    assert (np.diff(x[:, 2]) >= 0).all()
    near = cKDTree(x).query(x, 2)[0][:, 1]
    assert near.min() > (1 - TOLERANCE) * D
    assert np.hypot(x[:, 0], x[:, 1]).max() < (diameter - 1) / 2 * D + TOLERANCE * D
    assert x[:, 2].min() > (0.5 - TOLERANCE) * D
    assert (packed_column(scene).grains == x).all()
    other = packed_column(scene_of(**tables | {"numerics": {}}).model_copy(update={"seed": 2}))
    assert (other.grains != x).any()


def test_lid_is_a_layer_clear_of_the_wall():
    lid = packed_column(scene_of(overload={"mass": "5 g"})).lid
    away = np.hypot(lid[:, 0], lid[:, 1])
    assert away.max() <= 2.0 * D * (1 + 1e-9)
    assert cKDTree(lid).query(lid, 2)[0][:, 1].min() >= D * (1 - 1e-9)
    expected = sum(i * i + j * j <= 4 for i in range(-2, 3) for j in range(-2, 3))
    assert len(lid) == expected
    assert np.ptp(lid[:, 2]) == 0.0
    assert len(packed_column(scene_of()).lid) == 0


def test_cases_and_schema_know_the_piston():
    names = [name for name in packaged() if name.startswith("janssen/")]
    assert names == ["janssen/quick", "janssen/walton_13", "janssen/walton_26"]
    ratios = [load(name).scene.tube.diameter / D for name in names]
    assert ratios == pytest.approx([10.0, 13.333, 26.667], rel=1e-3)
    for name in names:
        scene = load(name).scene
        assert isinstance(derive(scene), JanssenNumerics)
        assert scene.tube.height > scene.height_of(scene.grain_count)
    done = CliRunner().invoke(app, ["schema", "janssen"])
    assert json.loads(done.stdout)["properties"].keys() >= {"tube", "fill", "drive", "overload"}
