"""Case files: what they may say, what is refused and in what words."""

from __future__ import annotations

import copy
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from liftdrag.case import MAX_BYTES, Case, load, packaged, parse, with_settings
from liftdrag.errors import CaseError, InputError
from liftdrag.refusals import keys
from liftdrag.scene import TankScene

CASE = Case(
    "small",
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
        "tank": {"length": "60 d", "thickness": "5 d", "height": "22 d"},
        "intruder": {"diameter": "3.3 d", "depth": "3 D"},
        "drive": {"speed": "0.1 m/s", "distance": "12 D"},
    },
)
D = 1.5e-3
CYLINDER = 3.3 * D
NAN, INF = float("nan"), float("inf")
LENGTHS = ["grains.diameter", "tank.length", "intruder.depth", "drive.distance", "numerics.skin"]
QUANTITIES = [*LENGTHS, "grains.density", "grains.youngs_modulus", "drive.speed"]
NUMBERS = ["grains.poisson_ratio", "grains.restitution", "grains.friction", "seed"]


def refusal(case: Case) -> CaseError:
    """The one-sentence refusal of a case with one wrong key."""
    with pytest.raises(CaseError) as caught:
        _ = case.scene
    text = str(caught.value)
    assert "\n" not in text
    assert text.endswith(".")
    assert text.startswith(caught.value.key)
    assert f": {caught.value.problem}; {caught.value.remedy}." in text
    assert caught.value.problem
    assert caught.value.remedy
    return caught.value


def without(key: str) -> Case:
    """The case without a key."""
    tables: dict[str, Any] = copy.deepcopy(dict(CASE.tables))
    *path, last = key.split(".")
    table = tables
    for name in path:
        table = table[name]
    del table[last]
    return Case("short", tables)


@pytest.mark.parametrize("key", QUANTITIES)
@pytest.mark.parametrize("value", [-1, -0.5, "-1", 0, 0.0, "0"])
def test_quantity_that_is_not_positive_is_refused(key: str, value: object):
    assert "greater than 0" in refusal(CASE.set(key, value)).problem


@pytest.mark.parametrize("key", QUANTITIES)
@pytest.mark.parametrize("value", [NAN, INF, -INF, "1e999", 10**400])
def test_quantity_that_is_not_finite_is_refused(key: str, value: object):
    error = refusal(CASE.set(key, value))
    assert error.key == key
    assert "not a finite number" in error.problem


@pytest.mark.parametrize("key", NUMBERS)
@pytest.mark.parametrize("value", [NAN, INF, -INF, -1, True, [1], "1", {}])
def test_number_that_is_none_is_refused(key: str, value: object):
    error = refusal(CASE.set(key, value))
    assert error.key == key
    assert "this should be" in error.problem


@pytest.mark.parametrize("key", QUANTITIES)
@pytest.mark.parametrize("value", [True, False, [1.0], {"value": 1.0}, [[]]])
def test_quantity_of_another_type_is_refused(key: str, value: object):
    error = refusal(CASE.set(key, value))
    assert error.key == key
    assert "not a quantity" in error.problem


@pytest.mark.parametrize(
    "value", ["", " ", "mm", "five mm", "nan", "inf m", "1 m\nshell ls", "1,5"]
)
def test_text_without_a_number_and_unit_is_refused(value: str):
    error = refusal(CASE.set("grains.diameter", value))
    assert repr(value) in str(error)
    assert "1.5 mm" in error.remedy


@pytest.mark.parametrize(
    ("key", "value", "unit"),
    [
        ("grains.diameter", "1.5 kg", "kg"),
        ("grains.density", "2500 kg", "kg"),
        ("grains.density", "3 d", "d"),
        ("grains.youngs_modulus", "5 N", "N"),
        ("drive.speed", "0.1 m", "m"),
        ("numerics.time_step", "1 mm", "mm"),
        ("tank.length", "140 m^2", "m^2"),
    ],
)
def test_unit_of_another_dimension_is_refused(key: str, value: str, unit: str):
    error = refusal(CASE.set(key, value))
    assert (error.key, error.value) == (key, value)
    assert f"{unit!r} does not measure this" in error.problem
    assert "write a plain number in" in error.remedy


@pytest.mark.parametrize("value", ["1.5 furlongz", "140 diameters", "3 xD", "2 Dd"])
def test_unknown_unit_is_refused(value: str):
    error = refusal(CASE.set("tank.length", value))
    assert f"{value.split()[1]!r} is not a known unit" in error.problem


@pytest.mark.parametrize("value", ["1 __class__", "1 m; import os", "1 m**9**9**9", "1 (m)", "1 1"])
def test_unit_that_is_code_is_refused(value: str):
    assert "is not a unit" in str(refusal(CASE.set("tank.length", value)))


@pytest.mark.parametrize("value", ["x" * 100_000, "1" * 100_000])
def test_huge_text_is_refused_without_being_repeated(value: str):
    error = refusal(CASE.set("grains.diameter", value))
    assert error.key == "grains.diameter"
    assert len(str(error)) < 300


@pytest.mark.parametrize(
    ("key", "value", "symbol"),
    [("grains.diameter", "1 d", "d"), ("intruder.diameter", "2 D", "D")],
)
def test_diameter_in_terms_of_itself_is_refused(key: str, value: str, symbol: str):
    assert f"{symbol!r} stands for {key}" in refusal(CASE.set(key, value)).problem


@pytest.mark.parametrize(
    ("key", "nearest"),
    [
        ("grains.diametre", "grains.diameter"),
        ("intruder.dept", "intruder.depth"),
        ("numerics.timestep", "numerics.time_step"),
        ("sed", "seed"),
        ("tanc", "tank"),
    ],
)
def test_unknown_key_is_refused_with_a_suggestion(key: str, nearest: str):
    error = refusal(CASE.set(key, 1))
    assert (error.key, error.problem) == (key, "this key is unknown")
    assert error.remedy == f"did you mean {nearest}"


def test_unknown_key_like_no_other_points_to_the_schema():
    assert "liftdrag schema tank" in refusal(CASE.set("zzzzzzzz", 1)).remedy


REQUIRED = [
    "seed",
    "grains.density",
    "grains.youngs_modulus",
    "grains.poisson_ratio",
    "grains.restitution",
    "grains.friction",
    "tank",
    "tank.length",
    "tank.thickness",
    "tank.height",
    "intruder.depth",
    "drive",
    "drive.speed",
    "drive.distance",
]


@pytest.mark.parametrize("key", REQUIRED)
def test_missing_key_is_refused(key: str):
    error = refusal(without(key))
    assert (error.key, error.problem) == (key, "this key is missing")
    assert error.remedy.startswith("add it")


def test_lid_must_say_whether_the_bed_has_weight():
    error = refusal(CASE.set("lid.density_ratio", 60.0))
    assert (error.key, error.problem) == ("lid.bulk_gravity", "this key is missing")


def test_each_wrong_key_has_its_own_sentence():
    with pytest.raises(InputError) as caught:
        _ = CASE.set("grains.friction", -1.0).set("seed", -1).set("drive.speed", "1 kg").scene
    lines = str(caught.value).splitlines()
    assert sorted(line.split()[0] for line in lines) == ["drive.speed", "grains.friction", "seed"]


@pytest.mark.parametrize("name", ["tnak", "", 3, ["tank"], True, None])
def test_scene_that_does_not_exist_is_refused(name: object):
    error = refusal(CASE.set("scene", name))
    assert (error.key, error.remedy) == (
        "scene",
        "choose one of 'tank', 'drag2d', 'janssen', 'shear'",
    )


@pytest.mark.parametrize(
    ("key", "wrong", "right", "problem"),
    [
        ("intruder.depth", "0.49 D", "0.51 D", "above the surface"),
        ("intruder.depth", "17.4 d", "17.3 d", "does not fit into a bed"),
        ("intruder.diameter", "0.99 d", "1.01 d", "smaller than a grain"),
        ("tank.length", "7.99 D", "8.01 D", "shorter than the wake"),
        ("tank.thickness", "2.99 d", "3.01 d", "touch its own image"),
        ("tank.length", "1 km", "1 m", "the tank would hold"),
        ("drive.distance", "3.99 D", "4.01 D", "the flow is steady after 2 intruder diameters"),
    ],
)
def test_scene_that_cannot_be_is_refused(key: str, wrong: str, right: str, problem: str):
    error = refusal(CASE.set(key, wrong))
    assert error.key == key
    assert problem in error.problem
    assert CASE.set(key, right).scene.scene == "tank"


def test_lid_closer_than_three_diameters_is_refused():
    deep = CASE.set("tank.height", "80 d").set("lid", {"density_ratio": 60.0, "bulk_gravity": True})
    error = refusal(deep.set("intruder.depth", "2.99 D"))
    assert error.key == "intruder.depth"
    assert "the lid is closer" in error.problem
    assert deep.set("intruder.depth", "3 D").scene.lid is not None


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("grains.poisson_ratio", 0.5),
        ("grains.restitution", 0.0),
        ("grains.restitution", 1.01),
        ("grains.friction", 10.1),
        ("seed", 2**31),
        ("seed", 1.0),
        ("numerics.sample_every", 0),
        ("numerics.sample_every", 2.5),
    ],
)
def test_number_out_of_its_range_is_refused(key: str, value: float):
    assert refusal(CASE.set(key, value)).key == key


def files(folder: Path) -> dict[str, Path]:
    """Files that are no case."""
    (folder / "prose.toml").write_text("Dear sir, [[[")
    (folder / "latin.toml").write_bytes('name = "K\xf6ln"'.encode("latin-1"))
    (folder / "folder.toml").mkdir()
    (folder / "big.toml").write_text("#" * (MAX_BYTES + 1))
    (folder / "deep.toml").write_text("a = " + "[\n" * 40_000)
    return {path.stem: path for path in [*folder.iterdir(), folder / "absent.toml"]}


@pytest.mark.parametrize(
    ("file", "reason"),
    [
        ("prose", "is not TOML"),
        ("latin", "is not UTF-8"),
        ("folder", "cannot be read: Is a directory"),
        ("absent", "cannot be read: No such file"),
        ("big", "is larger than"),
        ("deep", "is nested too deeply"),
    ],
)
def test_file_that_is_no_case_is_refused(tmp_path: Path, file: str, reason: str):
    path = files(tmp_path)[file]
    with pytest.raises(InputError, match=reason) as caught:
        load(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_empty_file_names_no_scene(tmp_path: Path):
    (tmp_path / "empty.toml").write_text("")
    assert refusal(load(tmp_path / "empty.toml")).key == "scene"


@pytest.mark.parametrize(
    ("name", "nearest"),
    [("quik", "quick"), ("guillard2014/half-heigth", "guillard2014/half-height")],
)
def test_misspelt_packaged_case_is_refused_with_a_suggestion(name: str, nearest: str):
    with pytest.raises(InputError, match=f"no case '{name}': did you mean '{nearest}'"):
        load(name)


@pytest.mark.parametrize("name", ["", "../cases/quick", "/", "__init__"])
def test_name_of_no_packaged_case_is_refused(name: str):
    with pytest.raises(InputError, match="'liftdrag cases' lists the packaged ones"):
        load(name)


@pytest.mark.parametrize("name", sorted(packaged()))
def test_packaged_case_makes_a_scene(name: str):
    case = load(name)
    assert case.name == name
    planar = case.scene.scene == "drag2d"
    assert (case.scene.grains.count if planar else case.scene.grain_count) > 100


def test_case_file_is_named_after_its_file(tmp_path: Path):
    path = tmp_path / "mine.toml"
    path.write_text(packaged()["quick"].read_text("utf-8"), "utf-8")
    assert load(path).name == "mine"
    assert load(str(path)).scene == load("quick").scene


@pytest.mark.parametrize(
    ("key", "text", "expected"),
    [
        ("grains.diameter", "1.5 mm", 1.5e-3),
        ("grains.diameter", "1500 um", 1.5e-3),
        ("grains.diameter", "1500 µm", 1.5e-3),
        ("grains.diameter", ".15cm", 1.5e-3),
        ("grains.diameter", "+1.5e-3", 1.5e-3),
        ("grains.density", "2.5 g/cm^3", 2500.0),
        ("grains.density", "2500 kg/m^3", 2500.0),
        ("grains.density", 2500, 2500.0),
        ("grains.youngs_modulus", "5 MPa", 5e6),
        ("grains.youngs_modulus", "5e6 N/m^2", 5e6),
        ("tank.length", "140 d", 140.0 * D),
        ("tank.length", "12 D", 12.0 * CYLINDER),
        ("intruder.depth", "3.5D", 3.5 * CYLINDER),
        ("drive.speed", "36 m/h", 0.01),
        ("drive.speed", "100 mm/s", 0.1),
        ("numerics.time_step", "10 us", 1e-5),
        ("numerics.skin", "0.2 d", 0.2 * D),
    ],
)
def test_units_are_converted(key: str, text: object, expected: float):
    scene: Any = CASE.set(key, text).scene
    for name in key.split("."):
        scene = getattr(scene, name)
    assert scene == pytest.approx(expected, rel=1e-11)


@settings(deadline=None, max_examples=60)
@given(
    st.floats(0.1, 20.0),
    st.sampled_from([("m", 1.0), ("mm", 1e-3), ("cm", 1e-2), ("km", 1e3), ("d", D)]),
)
def test_length_survives_being_written_in_any_unit(length: float, unit: tuple[str, float]):
    name, size = unit
    scene = CASE.set("drive.distance", f"{length / size!r} {name}").scene
    assert scene.drive.distance == pytest.approx(length, rel=1e-11)


@settings(deadline=None, max_examples=60)
@given(st.floats(1.0, 5.0), st.floats(0.5, 3.0))
def test_intruder_diameters_follow_the_intruder(diameter: float, depth: float):
    case = CASE.set("intruder.diameter", f"{diameter!r} d").set("intruder.depth", f"{depth!r} D")
    scene = case.set("tank.height", "100 d").set("tank.length", "100 d").scene
    assert scene.intruder.depth == pytest.approx(depth * diameter * D, rel=1e-11)


def test_set_returns_a_new_case_and_leaves_the_old():
    before, scene = copy.deepcopy(CASE.tables), CASE.scene
    changed = CASE.set("intruder.depth", "2 D").set("numerics.skin", "0.2 d")
    assert changed is not CASE
    assert CASE.tables == before
    assert CASE.scene is scene
    assert changed.scene.intruder.depth == pytest.approx(2.0 * CYLINDER)
    assert changed.name == CASE.name


@pytest.mark.parametrize("key", ["", ".", "a..b", "grains.", ".seed", "a.b.c.d.e"])
def test_set_refuses_what_is_no_key(key: str):
    with pytest.raises(CaseError, match="not a key of a case file"):
        CASE.set(key, 1)


@pytest.mark.parametrize("key", ["seed.x", "grains.diameter.x"])
def test_set_refuses_a_key_below_a_value(key: str):
    with pytest.raises(CaseError, match="is not a table of the case"):
        CASE.set(key, 1)


@pytest.mark.parametrize(
    ("setting", "key", "expected"),
    [
        ("seed=7", "seed", 7),
        (" seed = 7 ", "seed", 7),
        ("grains.restitution=0.5", "grains.restitution", 0.5),
        ("intruder.depth=8 D", "intruder.depth", "8 D"),
        ('intruder.depth="8 D"', "intruder.depth", "8 D"),
        ("intruder.depth='8 D'", "intruder.depth", "8 D"),
        ("lid.bulk_gravity=true", "lid.bulk_gravity", True),
        ("lid={density_ratio=60.0}", "lid", {"density_ratio": 60.0}),
        ("seed=", "seed", ""),
        ("seed==3", "seed", "=3"),
        ("seed=1\nseed=2", "seed", "1\nseed=2"),
        ("seed=1\nvalue=2", "seed", "1\nvalue=2"),
        ("seed=1\r\nvalue=2", "seed", "1\r\nvalue=2"),
        ("seed=1\n[grains]\nfriction=9.0", "seed", "1\n[grains]\nfriction=9.0"),
    ],
)
def test_setting_of_the_command_line_sets_its_key_alone(setting: str, key: str, expected: object):
    changed = with_settings(CASE, [setting])
    assert changed.tables == CASE.set(key, expected).tables


def test_later_setting_wins():
    assert with_settings(CASE, ["seed=1", "seed=2"]).scene.seed == 2


def test_items_of_a_list_are_set_by_number():
    shear = load("shear/quick")
    changed = with_settings(shear, ["species.1.aspect_ratio=0.2"])
    first, second = shear.tables["species"]
    assert changed.tables["species"] == [first, second | {"aspect_ratio": 0.2}]
    assert shear.tables["species"][1]["aspect_ratio"] == 0.3
    assert changed.scene.species[1].aspect_ratio == 0.2
    whole = shear.set("species.0", {"aspect_ratio": 2.0, "share": 0.5})
    assert whole.scene.species[0].aspect_ratio == 2.0


@pytest.mark.parametrize("many", [10, 4000])
def test_list_of_numbers_may_be_as_long_as_the_file(many: int):
    seeds = list(range(1, many))
    assert parse(f"seed = {seeds} # seeds", "case")["seed"] == seeds
    some = [k / 8.0 for k in seeds]
    assert parse(f"grid = {{ x = {some}, y = [ -1e-5 ,2 ] }}", "case")["grid"]["x"] == some
    assert with_settings(CASE, [f"stop.quantity={seeds}"]).tables["stop"]["quantity"] == seeds


@pytest.mark.parametrize("setting", ["seed", "", "seed 7"])
def test_setting_without_an_equals_sign_is_refused(setting: str):
    with pytest.raises(InputError, match="has no '='; write --set KEY=VALUE") as caught:
        with_settings(CASE, [setting])
    assert repr(setting) in str(caught.value)


@pytest.mark.parametrize("text", ["1\nseed=2", "1\r\nvalue=2", "1\n[tank]", "\x00", "1;2"])
def test_injected_value_is_refused(text: str):
    error = refusal(with_settings(CASE, [f"seed={text}"]))
    assert (error.key, error.value) == ("seed", text)


def properties(schema: dict[str, Any], part: dict[str, Any], prefix: str = "") -> Iterator[str]:
    """Every dotted key of a JSON schema."""
    for name, entry in part["properties"].items():
        yield prefix + name
        for choice in (entry, *entry.get("anyOf", [])):
            if "$ref" in choice:
                table = schema["$defs"][choice["$ref"].rsplit("/", 1)[1]]
                yield from properties(schema, table, f"{prefix}{name}.")


def test_keys_are_those_of_the_schema():
    schema = TankScene.model_json_schema()
    found = list(keys(TankScene))
    assert sorted(found) == sorted(properties(schema, schema))
    assert len(found) == len(set(found)) > 25
    assert {"lid.bulk_gravity", "numerics.time_step", "grains.diameter"} <= set(found)
