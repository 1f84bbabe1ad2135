"""The closed bed in the plane: its case, its grains and its numerics, against closed forms."""

from __future__ import annotations

import json
import re
import sys
import tomllib
from collections.abc import Callable
from math import pi, sqrt
from typing import Any

import numpy as np
import pytest
from conftest import tiny_tank
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import beta

from liftdrag import ensemble
from liftdrag.case import Case, load, packaged
from liftdrag.cli import main
from liftdrag.deck.drag2d import contact_of
from liftdrag.dem import Bed
from liftdrag.errors import CaseError, InputError
from liftdrag.numerics import Drag2DNumerics, derive, explained
from liftdrag.packing import drag2d as packing
from liftdrag.packing.drag2d import diameters, law_of, packed
from liftdrag.runner import run
from liftdrag.scene import Drag2DScene

TINY = """
scene = "drag2d"
seed = 1
[grains]
shape = "disc"
count = 60
diameter = "1 mm"
spread = 0.2
density = 2500
youngs_modulus = "100 MPa"
poisson_ratio = 0.3
restitution = 0.5
friction = 0.3
[box]
width = "8 mm"
thickness = "10 mm"
solid_fraction = 0.82
[intruder]
diameter = "2 mm"
start = "2 mm"
[drive]
speed = "2 m/s"
distance = "1.5 mm"
average_from = "0.5 mm"
[ensemble]
runs = 3
"""
"""Sixty discs about a cylinder of twice their size: a packing and its run take some 0.1 s."""

SHAPES: dict[str, dict[str, Any]] = {
    "disc": {},
    "dumbbell": {"shape": "dumbbell"},
    "ellipse": {"shape": "ellipse", "aspect_ratio": 1.375},
}
"""What the table of the grains says of each shape."""

each_shape = pytest.mark.parametrize("shape", SHAPES)


def tiny(**tables: Any) -> Case:
    """The tiny bed, with these keys of its tables changed or added."""
    base = tomllib.loads(TINY)
    return Case("tiny", base | {key: base.get(key, {}) | table for key, table in tables.items()})


def tiny_of(shape: str, **tables: Any) -> Case:
    """The tiny bed of another shape."""
    return tiny(**tables | {"grains": SHAPES[shape] | tables.get("grains", {})})


def numerics_of(**tables: Any) -> Drag2DNumerics:
    return derive(tiny(**tables).scene)


def sizes(count: int, diameter: float, spread: float) -> np.ndarray:
    """The diameters: the middles of `count` equal steps from one end of the range to the other."""
    edges = np.linspace(diameter * (1.0 - spread), diameter * (1.0 + spread), count + 1)
    return (edges[:-1] + edges[1:]) / 2.0


@settings(deadline=None, max_examples=50)
@given(
    count=st.integers(60, 500),
    spread=st.floats(0.0, 0.5),
    fraction=st.floats(0.5, 0.9),
    width=st.floats(7e-3, 9e-3),
)
def test_height_follows_from_the_solid_fraction(
    count: int, spread: float, fraction: float, width: float
):
    """The paper's eq. 18, V_f = V_g / (V_w - V_c), with V_g summed grain by grain."""
    grains = {"count": count, "spread": spread}
    scene = tiny(grains=grains, box={"solid_fraction": fraction, "width": width}).scene
    area = (pi / 4.0 * sizes(count, 1e-3, spread) ** 2).sum()
    assert area / (width * scene.height - pi * 1e-3**2) == pytest.approx(fraction, rel=1e-9)
    assert diameters(scene) == pytest.approx(sizes(count, 1e-3, spread), rel=1e-12)


@pytest.fixture(scope="module")
def bed_of() -> Callable[..., Bed]:
    """Packings of the tiny bed, each made once."""
    made: dict[tuple[str, int], Bed] = {}

    def get(shape: str, number: int = 0) -> Bed:
        if (shape, number) not in made:
            made[shape, number] = packed(tiny_of(shape).scene, number)
        return made[shape, number]

    return get


@each_shape
@pytest.mark.parametrize("number", [0, 1])
def test_grains_of_every_packing_have_the_area_of_eq_18(
    shape: str, number: int, bed_of: Callable[..., Bed]
):
    bed, parts = bed_of(shape, number), slice(None, -1)
    area = (pi * bed.semi_axes[parts].prod(axis=1)).sum()
    left, right, bottom, top = bed.walls
    room = (right - left) * (top - bottom) - pi * 2e-3**2 / 4.0
    assert area / room == pytest.approx(0.82, rel=1e-12)


@each_shape
def test_cylinder_is_the_last_body_and_alone_moves(shape: str, bed_of: Callable[..., Bed]):
    bed = bed_of(shape)
    assert bed.position[-1].tolist() == [4e-3, 2e-3]
    assert bed.semi_axes[-1].tolist() == [1e-3, 1e-3]
    assert bed.velocity[-1].tolist() == [0.0, 2.0]
    assert not bed.velocity[:-1].any()
    assert not bed.spin.any()
    assert bed.mass[-1] == bed.inertia[-1] == np.inf
    assert bed.walls == (0.0, 8e-3, 0.0, tiny().scene.height)


@each_shape
def test_packings_hold_the_same_grains_in_other_places(shape: str, bed_of: Callable[..., Bed]):
    one, other = bed_of(shape, 0), bed_of(shape, 1)
    assert np.array_equal(np.sort(one.mass), np.sort(other.mass))
    assert not np.array_equal(one.mass, other.mass)
    nearest = np.hypot(*(one.position[:-1, None] - other.position[:-1]).T).min(axis=0)
    assert nearest.mean() > 0.05e-3


def test_packing_depends_on_the_seed_and_its_number_alone(bed_of: Callable[..., Bed]):
    again = packed(tiny().scene, 1)
    assert np.array_equal(again.position, bed_of("disc", 1).position)
    other = packed(Case("tiny", {**tiny().tables, "seed": 2}).scene, 1)
    assert abs(other.position - again.position).max() > 0.1e-3


def test_dumbbell_is_two_discs_that_touch_at_its_centre(bed_of: Callable[..., Bed]):
    """Of diameter sqrt(2) D/2: together they have the area of a disc of diameter D."""
    bed = bed_of("dumbbell")
    radius, place, body = bed.radius[:-1], bed.place[:-1], bed.body[:-1]
    assert body.tolist() == np.repeat(np.arange(60), 2).tolist()
    one, other = place[0::2], place[1::2]
    assert np.hypot(*(one - other).T) == pytest.approx(radius[0::2] + radius[1::2], rel=1e-12)
    assert (one + other) / 2.0 == pytest.approx(bed.position[:-1], rel=1e-12)
    expected = np.repeat(sqrt(2.0) / 2.0 * sizes(60, 1e-3, 0.2), 2)
    assert 2.0 * np.sort(radius) == pytest.approx(expected, rel=1e-12)


def test_ellipse_has_its_size_and_its_aspect_ratio(bed_of: Callable[..., Bed]):
    a, b = bed_of("ellipse").semi_axes[:-1].T
    assert np.sort(2.0 * np.sqrt(a * b)) == pytest.approx(sizes(60, 1e-3, 0.2), rel=1e-12)
    assert a / b == pytest.approx(1.375, rel=1e-12)


@each_shape
def test_masses_are_density_times_area_times_thickness(shape: str, bed_of: Callable[..., Bed]):
    mass = np.sort(bed_of(shape).mass[:-1])
    expected = 2500.0 * 0.01 * pi * sizes(60, 1e-3, 0.2) ** 2 / 4.0
    assert mass == pytest.approx(expected, rel=1e-12)


def disc_inertia(bed: Bed) -> np.ndarray:
    return bed.mass[:-1] * bed.radius[:-1] ** 2 / 2.0


def dumbbell_inertia(bed: Bed) -> np.ndarray:
    """Of two discs, each turning about its rim."""
    mass, radius = bed.mass[:-1] / 2.0, bed.radius[:-1:2]
    return 2.0 * (mass * radius**2 / 2.0 + mass * radius**2)


def ellipse_inertia(bed: Bed) -> np.ndarray:
    a, b = bed.semi_axes[:-1].T
    return bed.mass[:-1] * (a**2 + b**2) / 4.0


@pytest.mark.parametrize(
    ("shape", "expected"),
    [("disc", disc_inertia), ("dumbbell", dumbbell_inertia), ("ellipse", ellipse_inertia)],
)
def test_moments_of_inertia_have_their_closed_forms(
    shape: str, expected: Callable[[Bed], np.ndarray], bed_of: Callable[..., Bed]
):
    bed = bed_of(shape)
    assert bed.inertia[:-1] == pytest.approx(expected(bed), rel=1e-12)


def test_law_and_contact_take_each_number_to_its_place():
    scene = tiny(grains={"youngs_modulus": 7e6, "poisson_ratio": 0.25}).scene
    law, contact = law_of(scene), contact_of(scene)
    assert law.stiffness == pytest.approx(4.0 / 3.0 * 7e6 / (2.0 * (1.0 - 0.25**2)))
    assert law.friction == contact.friction == 0.3
    decay = np.log(2.0) / np.hypot(pi, np.log(2.0))
    assert law.damping == pytest.approx(2.0 * sqrt(5.0 / 6.0) * decay)
    assert law.reach == 0.0
    assert (contact.youngs_modulus, contact.poisson_ratio) == (7e6, 0.25)
    assert (contact.restitution, contact.radius, contact.rigid) == (0.5, 0.5e-3, False)


BAD = {
    "ellipse without a ratio": (
        {"grains": {"shape": "ellipse"}},
        ("grains.aspect_ratio", "an ellipse needs it", "add the long over the short axis"),
    ),
    "disc with a ratio": (
        {"grains": {"aspect_ratio": 1.5}},
        ("grains.aspect_ratio = 1.5", "a disc has none", 'or set grains.shape = "ellipse"'),
    ),
    "dumbbell with a ratio": (
        {"grains": {"shape": "dumbbell", "aspect_ratio": 2.0}},
        ("grains.aspect_ratio = 2", "a dumbbell has none", "leave it out"),
    ),
    "disc with the paper's contact": (
        {"grains": {"contact": "paper"}},
        ("grains.contact = 'paper'", "a disc has one way to touch", "leave it out"),
    ),
    "unknown contact": (
        {"grains": {"contact": "sticky"}},
        ("grains.contact = 'sticky'", "this should be 'common normal' or 'paper'", "schema"),
    ),
    "unknown shape": (
        {"grains": {"shape": "square"}},
        ("grains.shape = 'square'", "'disc', 'dumbbell' or 'ellipse'", "liftdrag schema"),
    ),
    "ratio below one": (
        {"grains": {"shape": "ellipse", "aspect_ratio": 0.8}},
        ("grains.aspect_ratio = 0.8", "greater than or equal to 1", "schema"),
    ),
    "too few grains": ({"grains": {"count": 9}}, ("grains.count = 9", "equal to 10", "schema")),
    "into the ceiling": (
        {"drive": {"distance": "6 mm"}},
        ("drive.distance = 0.006", "would hit the ceiling of the box", "make it at most"),
    ),
    "starting at the ceiling": (
        {"intruder": {"start": "7.9 mm"}},
        ("intruder.start = 0.0079", "would begin in the ceiling", "start lower, or make the box"),
    ),
    "starting in the floor": (
        {"intruder": {"start": "0.9 mm"}},
        ("intruder.start = 0.0009", "would begin in the floor", "at least its radius, 0.001 m"),
    ),
    "average from the end": (
        {"drive": {"average_from": "1.5 mm"}},
        ("drive.average_from = 0.0015", "nothing is left to average", "less than drive.distance"),
    ),
    "narrow box": (
        {"box": {"width": "5.9 mm"}},
        ("box.width = 0.0059", "cannot pass between the cylinder and the walls", "0.006 m"),
    ),
    "small cylinder": (
        {"intruder": {"diameter": "0.9 mm"}},
        ("intruder.diameter = 0.0009", "smaller than a grain", "grains.diameter = 0.001 m"),
    ),
    "one run": ({"ensemble": {"runs": 1}}, ("ensemble.runs = 1", "equal to 2", "schema")),
    "overfull": (
        {"box": {"solid_fraction": 0.96}},
        ("box.solid_fraction = 0.96", "this should be less than 0.95", "schema"),
    ),
    "misspelt key": (
        {"box": {"solid_fractoin": 0.8}},
        ("box.solid_fractoin", "this key is unknown", "did you mean box.solid_fraction"),
    ),
    "time step too large": (
        {"numerics": {"time_step": "1 ms"}},
        ("numerics.time_step = 0.001", "wrong forces without any other sign", "choose at most"),
    ),
    "skin too wide": (
        {"numerics": {"skin": "2.1 mm"}},
        ("numerics.skin = 0.0021", "only costs time", "choose at most 0.002 m"),
    ),
    "too many steps": (
        {"numerics": {"time_step": "1 ps"}},
        (
            "numerics.time_step = 1e-12",
            "this takes 7.5e+08 steps of 1e-12 s",
            "keep it under 1e+08",
        ),
    ),
}
"""Cases that cannot be: the key with its value, the problem and the remedy."""

each_bad = pytest.mark.parametrize("wrong", BAD)


def refusal(case: Case) -> CaseError:
    with pytest.raises(CaseError) as caught:
        derive(case.scene)
    return caught.value


@each_bad
def test_bad_case_is_refused_with_its_key_its_problem_and_a_remedy(wrong: str):
    tables, (key, problem, remedy) = BAD[wrong]
    error = refusal(tiny(**tables))
    assert str(error).startswith(f"{key}: ")
    assert problem in error.problem
    assert remedy in error.remedy
    assert len(str(error).splitlines()) == 1
    assert str(error).endswith(".")


Command = Callable[..., tuple[int, str]]


@pytest.fixture
def command(tmp_path, monkeypatch, capsys) -> Command:
    """The command line, in an empty folder: its exit status, and what it said of errors."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("signal.signal", lambda *_: None)

    def call(*words: str) -> tuple[int, str]:
        monkeypatch.setattr(sys, "argv", ["liftdrag", *words])
        with pytest.raises(SystemExit) as ended:
            main()
        return ended.value.code, capsys.readouterr().err

    return call


@each_bad
@pytest.mark.parametrize("words", [("run",), ("run", "--engine", "lammps"), ("build-deck",)])
def test_bad_case_ends_the_command_with_status_2_and_leaves_nothing(
    words: tuple[str, ...], wrong: str, command: Command, tmp_path
):
    tables, (key, *_) = BAD[wrong]
    (tmp_path / "tiny.toml").write_text(TINY)
    changes = [
        f"{table}.{name}={value}" for table in tables for name, value in tables[table].items()
    ]
    settings = [word for change in changes for word in ("--set", change)]
    status, said = command(words[0], "tiny.toml", *words[1:], *settings)
    assert status == 2
    assert said.startswith(key)
    assert len(said.splitlines()) == 1
    assert [path.name for path in tmp_path.iterdir()] == ["tiny.toml"]


def number_in(text: str) -> float:
    """The number before a unit."""
    return float(re.search(r"([\d.]+(?:e[+-]?\d+)?) (?:m|s)\b", text)[1])


@pytest.mark.parametrize(
    ("wrong", "table", "name"),
    [
        ("into the ceiling", "drive", "distance"),
        ("starting in the floor", "intruder", "start"),
        ("narrow box", "box", "width"),
        ("small cylinder", "intruder", "diameter"),
        ("time step too large", "numerics", "time_step"),
        ("skin too wide", "numerics", "skin"),
    ],
)
@pytest.mark.parametrize("size", [1.0, 1.00037, 1.00071])
def test_remedy_may_be_followed_to_the_letter(wrong: str, table: str, name: str, size: float):
    """The number that the sentence names is accepted, though it is rounded."""
    tables, _ = BAD[wrong]
    grown = {"diameter": 1e-3 * size, "youngs_modulus": 1e8 * size}
    cylinder = {"diameter": 2e-3 * size, "start": 2.1e-3} | tables.get("intruder", {})
    bad = tiny(**tables | {"grains": grown, "intruder": cylinder})
    advised = number_in(refusal(bad).remedy)
    assert derive(bad.set(f"{table}.{name}", advised).scene).time_step.value > 0.0


def test_grains_that_do_not_fit_are_refused_before_anything_is_written(
    command: Command, tmp_path, monkeypatch
):
    """As dumbbells of a spread of 0.5 at 0.949 do, in some packings."""

    def bursting(*_):
        raise ValueError("the grains do not fit into the box: the packing burst as it grew")

    monkeypatch.setattr(packing, "grown", bursting)
    (tmp_path / "tiny.toml").write_text(TINY)
    for words in (("run",), ("build-deck",)):
        status, said = command(*words, "tiny.toml")
        assert status == 2
        assert said.startswith("box.solid_fraction = 0.82: the grains do not fit into the box")
        assert said.endswith("lower it, or widen the box.\n")
        assert len(said.splitlines()) == 1
        assert [path.name for path in tmp_path.iterdir()] == ["tiny.toml"]


def test_later_packing_that_does_not_fit_fails_the_run_with_the_same_sentence(
    command: Command, tmp_path, monkeypatch
):
    def crushing(scene: Drag2DScene, number: int) -> Bed:
        if number == 1:
            raise CaseError("box.solid_fraction", 0.82, "the grains do not fit", "lower it")
        return packed(scene, number)

    monkeypatch.setattr(ensemble, "packed", crushing)
    (tmp_path / "tiny.toml").write_text(TINY)
    status, said = command("run", "tiny.toml", "--ranks", "2")
    assert status == 1
    (sentence,) = [line for line in said.splitlines() if "packings" not in line]
    assert sentence.endswith("box.solid_fraction = 0.82: the grains do not fit; lower it.")
    (result,) = tmp_path.glob("runs/*/result.json")
    assert json.loads(result.read_text())["status"] == "engine_error"


@pytest.mark.parametrize("name", ["lammps", "lmp", "liggghts"])
@pytest.mark.parametrize("words", [("run",), ("build-deck",)])
def test_ellipses_on_an_engine_of_discs_are_refused(
    words: tuple[str, ...], name: str, command: Command, tmp_path
):
    ratio = ("--set", "grains.shape=ellipse", "--set", "grains.aspect_ratio=1.1")
    (tmp_path / "tiny.toml").write_text(TINY)
    status, said = command(*words, "tiny.toml", "--engine", name, *ratio)
    assert status == 2
    assert said.startswith("grains.shape = 'ellipse': ")
    assert "has no contact of two ellipses; choose --engine dem, or another shape.\n" in said
    assert len(said.splitlines()) == 1
    assert [path.name for path in tmp_path.iterdir()] == ["tiny.toml"]


def test_tank_on_the_engine_of_the_plane_is_refused(command: Command, tmp_path):
    with pytest.raises(InputError, match=r"beds in the plane.*no tank; choose one of lammps"):
        run(tiny_tank(), tmp_path / "out", engine="dem")
    status, said = command("run", "quick", "--engine", "dem")
    assert status == 2
    assert len(said.splitlines()) == 1
    assert list(tmp_path.iterdir()) == []


@settings(deadline=None, max_examples=50)
@given(
    distance=st.floats(0.6e-3, 4e-3),
    speed=st.floats(0.1, 20.0),
    share=st.none() | st.floats(5e-3, 0.5),
)
def test_time_steps_end_at_the_distance_in_whole_rows_and_frames(
    distance: float, speed: float, share: float | None
):
    drive = {"distance": distance, "speed": speed}
    scales = numerics_of(drive=drive)
    impact, squeezed = scales.hertz_time.value, scales.squeezed_time.value
    chosen = {} if share is None else {"time_step": 0.999 * share * squeezed}
    found = numerics_of(drive=drive, numerics=chosen)
    way = found.time_step.value * found.drive_steps.value * tiny(drive=drive).scene.drive.speed
    assert way == pytest.approx(tiny(drive=drive).scene.drive.distance, rel=1e-12)
    assert found.drive_steps.value == 240 * found.row_every.value
    assert found.drive_steps.value == 4 * found.frame_every.value
    assert found.frame_every.value % found.row_every.value == 0
    largest = chosen.get("time_step", min(0.02 * impact, 0.14 * squeezed))
    assert found.time_step.value <= largest * (1.0 + 1e-8)
    if found.row_every.value > 1:
        assert found.time_step.value > largest * (1.0 - 1.0 / found.row_every.value)


@pytest.mark.parametrize(("shape", "radius"), [("disc", 0.5e-3), ("dumbbell", 0.5e-3 / sqrt(2.0))])
def test_hertz_time_is_that_of_two_grains_that_meet_at_the_drives_speed(shape: str, radius: float):
    """m x'' = -k x^1.5 of the effective mass: twice the integral of dx / x' to the turning."""
    stiffness = 4.0 / 3.0 * 1e8 / (2.0 * (1.0 - 0.09)) * sqrt(radius / 2.0)
    mass = 2500.0 * 0.01 * pi * 0.5e-3**2 / 2.0
    deepest = (5.0 * mass * 2.0**2 / (4.0 * stiffness)) ** 0.4
    expected = 2.0 * deepest / 2.0 * beta(0.4, 0.5) / 2.5
    numerics = derive(tiny_of(shape).scene)
    assert numerics.hertz_time.value == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize(
    ("table", "key", "factor"),
    [
        ("box", "thickness", 4.0),
        ("grains", "density", 4.0),
        ("grains", "youngs_modulus", 0.25),
        ("drive", "speed", 0.5),
    ],
)
def test_hertz_time_scales_with_mass_modulus_and_speed(table: str, key: str, factor: float):
    """As (m / E)^0.4 v^-0.2; the time step follows, and ends at the distance."""
    value = tiny().scene.model_dump()[table][key]
    before, after = numerics_of(), numerics_of(**{table: {key: 32.0 * value}})
    assert after.hertz_time.value == pytest.approx(factor * before.hertz_time.value, rel=1e-9)
    assert after.time_step.value <= 0.02 * after.hertz_time.value


def test_other_numbers_are_those_of_their_reasons():
    found = numerics_of(grains={"count": 100}, ensemble={"runs": 7})
    shear = 1e8 / 2.6
    wave = pi * 0.5e-3 * sqrt(2500.0 / shear) / (0.1631 * 0.3 + 0.8766)
    assert found.rayleigh_time.value == pytest.approx(wave)
    assert found.inertial_force.value == pytest.approx(2500.0 * 2.0**2 * 2e-3 * 0.01)
    assert found.skin.value == pytest.approx(0.15e-3)
    assert found.grain_steps.value == 700 * (found.drive_steps.value + 15_000)
    stiffness = 4.0 / 3.0 * 1e8 / (2.0 * 0.91) * sqrt(0.25e-3)
    smallest = 2500.0 * 0.01 * pi * (0.5e-3 * (1.0 - tiny().scene.grains.spread)) ** 2
    squeezed = sqrt(smallest / (1.5 * stiffness * sqrt(0.1e-3)))
    assert found.squeezed_time.value == pytest.approx(squeezed)
    assert found.box_height.value == tiny(grains={"count": 100}).scene.height
    assert numerics_of(numerics={"skin": "0.4 mm"}).skin.value == 0.4e-3


def test_every_number_is_explained_with_its_unit():
    found = numerics_of()
    lines = explained(found).splitlines()
    assert [line.split()[0] for line in lines] == [name for name, _ in found.rows()]
    for line, (_, value) in zip(lines, found.rows(), strict=True):
        assert value.unit in line.split()
        assert line.endswith(value.reason)


def test_sound_case_has_no_warnings():
    assert numerics_of().warnings == ()


@pytest.mark.parametrize(("share", "count"), [(0.29, 0), (0.49, 1)])
def test_large_time_step_set_by_hand_is_warned_about(share: float, count: int):
    hard = {"youngs_modulus": "1 TPa"}
    squeezed = numerics_of(grains=hard).squeezed_time.value
    found = numerics_of(grains=hard, numerics={"time_step": share * squeezed})
    assert found.time_step.reason.startswith("set by hand")
    assert len(found.warnings) == count
    assert all("above 0.3 of the squeezed time" in warning for warning in found.warnings)


def test_contact_of_the_paper_is_warned_about():
    (warning,) = derive(tiny_of("ellipse", grains={"contact": "paper"}).scene).warnings
    assert "does not keep the energy" in warning


LIGHT, HEAVY = 3.9e3, 3.9e4

TABLES: dict[str, tuple[str, float | None, float, float, int]] = {
    "c1": ("disc", None, 1092e-6, LIGHT, 400),
    "d1": ("dumbbell", None, 1092e-6, LIGHT, 400),
    "c2": ("disc", None, 772e-6, LIGHT, 800),
    "e1": ("ellipse", 1.125, 1092e-6, LIGHT, 400),
    "e2": ("ellipse", 1.25, 1092e-6, LIGHT, 400),
    "e3": ("ellipse", 1.375, 1092e-6, LIGHT, 400),
    "c11": ("disc", None, 1092e-6, LIGHT, 400),
    "c12": ("disc", None, 1092e-6, HEAVY, 400),
    "d11": ("dumbbell", None, 1092e-6, LIGHT, 400),
    "d12": ("dumbbell", None, 1092e-6, HEAVY, 400),
    "c21": ("disc", None, 772e-6, LIGHT, 800),
    "c22": ("disc", None, 772e-6, HEAVY, 800),
    "e11": ("ellipse", 1.125, 1092e-6, LIGHT, 400),
    "e12": ("ellipse", 1.125, 1092e-6, HEAVY, 400),
}
"""The paper's Tables 1 and 2: shape, aspect ratio, size (m), density (kg/m^3); and a count."""

each_row = pytest.mark.parametrize("symbol", TABLES)


def zhou(symbol: str) -> Drag2DScene:
    scene = load(f"zhou/{symbol}").scene
    assert isinstance(scene, Drag2DScene)
    return scene


def test_every_row_of_the_papers_tables_is_a_packaged_case():
    assert {name for name in packaged() if name.startswith("zhou/")} == {
        f"zhou/{s}" for s in TABLES
    }


@each_row
def test_packaged_case_is_a_row_of_the_papers_tables(symbol: str):
    grains = zhou(symbol).grains
    row = (grains.shape, grains.aspect_ratio, grains.diameter, grains.density, grains.count)
    assert row == TABLES[symbol]
    assert grains.contact == "common normal"


@each_row
def test_packaged_case_has_the_papers_box_cylinder_and_drive(symbol: str):
    """D_c = 3.175 mm, 2 m/s over 5 mm, averaged from 1 mm; W = 20 mm, V_f = 0.84, +- 20 %."""
    scene = zhou(symbol)
    assert (scene.intruder.diameter, scene.drive.speed, scene.drive.distance) == (
        3.175e-3,
        2.0,
        5e-3,
    )
    assert (scene.box.width, scene.box.solid_fraction) == (20e-3, 0.84)
    assert (scene.drive.average_from, scene.grains.spread) == (1e-3, 0.2)
    assert scene.ensemble.runs == 5
    assert derive(scene).warnings == ()


@each_row
def test_packaged_cases_differ_in_shape_size_count_and_density_alone(symbol: str):
    own = {"shape", "aspect_ratio", "diameter", "density", "count"}

    def common(name: str) -> dict[str, Any]:
        tables = load(f"zhou/{name}").tables
        grains = {key: value for key, value in tables["grains"].items() if key not in own}
        return {**tables, "grains": grains}

    assert common(symbol) == common("c1")


def test_small_discs_are_as_many_as_keep_the_box():
    assert zhou("c2").height == pytest.approx(zhou("c1").height, rel=1e-3)
    assert zhou("d1").height == zhou("e3").height == zhou("c1").height
