"""Beds that are kept: what their names depend on, what is found again, what runs make of it."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from math import hypot
from pathlib import Path

import numpy as np
import pytest
from conftest import EXPERIMENTS, tiny_tank, with_lid

from liftdrag import beds
from liftdrag.analysis.surface import surface_height
from liftdrag.case import load
from liftdrag.deck.dialect import LIGGGHTS
from liftdrag.deck.tank import Bed, build, packed
from liftdrag.engines import ENGINES, engine
from liftdrag.engines.base import silent
from liftdrag.engines.family import read_dump
from liftdrag.numerics import Value, derive
from liftdrag.runner import run
from liftdrag.scene import TankScene

TINY = tiny_tank()


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder for beds alone: what probes found stays where it is."""
    monkeypatch.setattr(beds, "_folder", lambda: tmp_path / "beds")
    return tmp_path / "beds"


@pytest.fixture
def packings(monkeypatch: pytest.MonkeyPatch) -> list[TankScene]:
    """The scenes that were packed; their grains are scattered, which is quick."""
    asked: list[TankScene] = []

    def scattered(scene: TankScene) -> Bed:
        asked.append(scene)
        places = np.random.default_rng(len(asked)).uniform(0.0, 1e-3, (7, 3))
        return Bed(places, np.array([1, 1, 1, 1, 1, 2, 2]))

    monkeypatch.setattr(beds, "packed", scattered)
    return asked


def settle(scene: TankScene, places: np.ndarray, folder: Path) -> None:
    """Keep a bed as if a run had settled it at these places (n, 3)."""
    found = beds.find(scene)
    rows = np.column_stack([np.arange(1, 8), found.bed.types, places, np.zeros((7, 3))])
    folder.mkdir(exist_ok=True)
    head = (
        "ITEM: TIMESTEP\n900\nITEM: NUMBER OF ATOMS\n7\nITEM: BOX BOUNDS pp pp ff\n" + "0 1\n" * 3
    )
    with (folder / "settled.dump").open("w") as file:
        file.write(f"{head}ITEM: ATOMS id type x y z vx vy vz\n")
        np.savetxt(file, rows, fmt="%d %d" + " %.15g" * 6)
    beds.keep(found, scene, folder)


SAME = {
    "drive.speed": 0.3,
    "drive.distance": "9 D",
    "numerics.time_step": 1e-5,
    "numerics.skin": "0.2 d",
    "numerics.sample_every": 3,
    "numerics.pair_law": "hertz/history",
    "stop": {"quantity": "drag", "relative_error": 0.05},
}
OTHER_SETTLED = {
    "grains.density": 2500.001,
    "grains.youngs_modulus": 5.00001e6,
    "grains.poisson_ratio": 0.450001,
    "grains.restitution": 0.600001,
    "grains.friction": 0.500001,
    "numerics.settle_time": 0.5,
}
OTHER_PACKED = {
    "seed": 2,
    "grains.diameter": 1.50001e-3,
    "tank.length": "16.001 d",
    "tank.thickness": "3.001 d",
    "tank.height": "12.001 d",
    "intruder.diameter": "1.5001 d",
    "intruder.depth": "4.0001 D",
}


@pytest.mark.usefixtures("cache")
@pytest.mark.parametrize(
    ("changes", "settled_anew", "packed_anew"),
    [(SAME, False, False), (OTHER_SETTLED, True, False), (OTHER_PACKED, True, True)],
    ids=["drive and steps", "contacts and rest", "packing"],
)
def test_a_bed_is_another_when_what_it_depends_on_is_another(
    changes: dict, settled_anew: bool, packed_anew: bool, packings: list[TankScene]
):
    first = beds.find(TINY.scene)
    for key, value in changes.items():
        before = len(packings)
        other = beds.find(TINY.set(key, value).scene)
        assert (other.key != first.key) == settled_anew, key
        assert len(packings) - before == packed_anew, key
        assert np.array_equal(other.bed.positions, first.bed.positions) != packed_anew, key


@pytest.mark.usefixtures("cache")
def test_lids_share_the_packing_but_not_the_settled_bed(packings: list[TankScene]):
    heavy = with_lid(True).set("lid.density_ratio", 60.001)
    lids = (with_lid(True), with_lid(False), heavy)
    keys = {beds.find(lid.set("numerics.settle_time", 0.1).scene).key for lid in lids}
    assert len(keys) == 3
    assert len(packings) == 1


@pytest.mark.usefixtures("cache")
def test_bed_found_is_the_bed_packed_to_the_bit():
    first, again = beds.find(TINY.scene), beds.find(TINY.set("grains.friction", 0.1).scene)
    assert np.array_equal(again.bed.positions, packed(TINY.scene).positions)
    assert np.array_equal(again.bed.types, first.bed.types)
    assert not again.bed.settled
    assert again.provenance == {"key": again.key, "reused": False}


@pytest.mark.usefixtures("cache", "packings")
def test_settled_bed_is_found_inside_its_box(tmp_path: Path):
    scene = TINY.scene
    places = np.random.default_rng(3).uniform(0.0, 3e-3, (7, 3))
    outside = places + [[scene.tank.length, -scene.tank.thickness, 0.0]] * 7
    settle(scene, outside, tmp_path / "run")
    found = beds.find(scene)
    assert found.provenance == {"key": found.key, "reused": True}
    assert found.warnings == ()
    assert found.bed.types.tolist() == [1, 1, 1, 1, 1, 2, 2]
    assert found.bed.positions == pytest.approx(places, abs=1e-16)


@pytest.mark.usefixtures("cache")
@pytest.mark.parametrize("wrong", ["a grain is missing", "a place is no number"])
def test_what_no_run_has_settled_is_not_kept(wrong: str, tmp_path: Path, packings: list[TankScene]):
    places = np.full((7, 3), 1e-3)
    if wrong == "a place is no number":
        places[2, 1] = np.nan
    settle(TINY.scene, places, tmp_path)
    assert beds.find(TINY.scene).bed.settled == (wrong != "a place is no number")
    found = beds.find(TINY.set("grains.friction", 0.2).scene)
    rows = (tmp_path / "settled.dump").read_text().splitlines()[:-1]
    (tmp_path / "settled.dump").write_text("\n".join(rows) + "\n")
    beds.keep(found, TINY.scene, tmp_path)
    assert not beds.find(TINY.set("grains.friction", 0.2).scene).bed.settled
    assert len(packings) == 1


def flipped(content: bytes) -> bytes:
    return content[:50] + bytes([content[50] ^ 1]) + content[51:]


DAMAGE = {
    "a bit": flipped,
    "the end": lambda content: content[:-8],
    "all but its seal": lambda content: content[:32],
    "everything": lambda _: b"",
    "a foreign file": lambda _: b"\x89PNG\r\n" + bytes(4000),
}


@pytest.mark.parametrize("damage", DAMAGE.values(), ids=DAMAGE)
def test_damaged_beds_are_left_out_with_a_warning_and_replaced(
    damage, cache: Path, tmp_path: Path, packings: list[TankScene]
):
    settle(TINY.scene, np.full((7, 3), 1e-3), tmp_path / "run")
    for file in cache.iterdir():
        file.write_bytes(damage(file.read_bytes()))
    found = beds.find(TINY.scene)
    assert not found.bed.settled
    assert len(packings) == 2
    assert [str(cache) in warning and "damaged" in warning for warning in found.warnings] == [
        True,
        True,
    ]
    assert beds.find(TINY.set("grains.friction", 0.2).scene).warnings == ()
    beds.keep(found, TINY.scene, tmp_path / "run")
    assert beds.find(TINY.scene).bed.settled


@pytest.mark.usefixtures("packings")
def test_another_bed_under_this_ones_name_is_damage(cache: Path, tmp_path: Path):
    settle(TINY.scene, np.full((7, 3), 1e-3), tmp_path / "run")
    mine = cache / f"{beds.find(TINY.scene).key}.bed"
    settle(TINY.set("grains.friction", 0.2).scene, np.full((7, 3), 2e-3), tmp_path / "run")
    other = cache / f"{beds.find(TINY.set('grains.friction', 0.2).scene).key}.bed"
    mine.write_bytes(other.read_bytes())
    assert len(beds.find(TINY.scene).warnings) == 1


def test_without_a_cache_nothing_fails(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, packings: list[TankScene]
):
    (tmp_path / "file").write_text("no folder")
    monkeypatch.delenv("LIFTDRAG_BEDS")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    settle(TINY.scene, np.full((7, 3), 1e-3), tmp_path / "run")
    assert not beds.find(TINY.scene).bed.settled
    assert len(packings) == 2


@pytest.mark.usefixtures("packings")
def test_beds_are_kept_in_the_users_cache_unless_they_are_off(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    settle(TINY.scene, np.full((7, 3), 1e-3), tmp_path / "run")
    assert not (tmp_path / "cache").exists()
    monkeypatch.delenv("LIFTDRAG_BEDS")
    settle(TINY.scene, np.full((7, 3), 1e-3), tmp_path / "run")
    assert len(list((tmp_path / "cache" / "liftdrag" / "beds").glob("*.bed"))) == 2
    assert beds.find(TINY.scene).bed.settled
    monkeypatch.setenv("LIFTDRAG_BEDS", "off")
    assert not beds.find(TINY.scene).bed.settled


@pytest.mark.usefixtures("packings")
def test_the_bed_longest_unused_goes_first(cache: Path, monkeypatch: pytest.MonkeyPatch):
    scenes = [TINY.set("seed", seed).scene for seed in range(4)]
    for age, scene in enumerate(scenes[:3]):
        new = set(cache.glob("*")) if cache.exists() else set()
        beds.find(scene)
        (file,) = set(cache.glob("*")) - new
        os.utime(file, (1000 + age, 1000 + age))
    monkeypatch.setattr(beds, "LIMIT", 3 * file.stat().st_size)
    beds.find(scenes[0])
    beds.find(scenes[3])
    kept = [beds._read(beds._key(beds._packing(scene))) is not None for scene in scenes]
    assert kept == [True, False, True, True]


@pytest.mark.usefixtures("packings")
def test_a_write_that_fails_leaves_nothing(cache: Path, monkeypatch: pytest.MonkeyPatch):
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "replace", full)
    assert not beds.find(TINY.scene).bed.settled
    assert list(cache.iterdir()) == []


@pytest.mark.usefixtures("cache")
def test_writers_at_once_leave_a_whole_bed():
    places = np.random.default_rng(1).uniform(0.0, 1.0, (20_000, 3))
    bed = Bed(places, np.ones(20_000, int))

    def write(_: int) -> bool:
        beds._write("name", bed)
        return np.array_equal(beds._read("name")[:, :3], places)

    with ThreadPoolExecutor(8) as pool:
        assert all(pool.map(write, range(60)))


def last_settled(folder: Path) -> np.ndarray:
    """Rows (n, 8) of the settled bed."""
    _, rows = next(read_dump(folder / "settled.dump"))
    return rows


def sunk(scene: TankScene, folders: tuple[Path, Path]) -> tuple[float, float]:
    """How far the surface and the mean grain of the second run's settled bed lie lower, over the
    bed's height."""
    one, other = (last_settled(folder) for folder in folders)
    area = scene.tank.length * scene.tank.thickness
    heights = [
        surface_height(rows[rows[:, 1] == 1, 4], scene.grains.diameter, area, scene.far_band)
        for rows in (one, other)
    ]
    mean = 2.0 * (one[:, 4].mean() - other[:, 4].mean())
    return (heights[0] - heights[1]) / scene.tank.height, mean / scene.tank.height


@pytest.mark.usefixtures("cache")
@pytest.mark.parametrize(
    "name",
    [
        "free surface",
        pytest.param("lid", marks=pytest.mark.validate),
        pytest.param("lid only", marks=pytest.mark.validate),
    ],
)
def test_a_settled_bed_only_loads_its_springs(name: str, tmp_path: Path):
    """It stays where it was, to 1e-4 of its height; a third run is the second to the bit."""
    case = EXPERIMENTS[name]
    fresh, again = (run(case, tmp_path / word) for word in ("fresh", "again"))
    drive = derive(case.scene).drive_steps.value
    reused = [found.record["provenance"]["settled_bed"]["reused"] for found in (fresh, again)]
    assert reused == [False, True]
    assert "was settled before" in (again.folder / "in.tank").read_text()
    assert again.record["steps"] - drive < 0.25 * (fresh.record["steps"] - drive)
    for measured in sunk(case.scene, (fresh.folder, again.folder)):
        assert abs(measured) < 1e-4
    places = last_settled(fresh.folder)[:, 2:5]
    assert np.mean(places != np.round(places, 10)) > 0.5
    if name == "free surface":
        third = run(case, tmp_path / "third")
        forces = [(r.folder / "forces.dat").read_bytes() for r in (fresh, again, third)]
        assert forces[0] != forces[1] == forces[2]


@pytest.mark.parametrize("name", ENGINES)
def test_a_settled_bed_that_does_not_rest_is_refused(name: str, tmp_path: Path):
    scene = TINY.scene
    bed = packed(scene)
    lifted = bed.positions.copy()
    lifted[bed.types == 1, 2] += scene.grains.diameter
    few = Value(100, "steps", "too few to come to rest")
    numerics = replace(derive(scene, settled=True), settle_steps=few, settle_steps_max=few)
    dialect = engine(name).dialect
    deck = build(scene, numerics, "", "", dialect=dialect, bed=Bed(lifted, bed.types, True))
    deck.write(tmp_path)
    outcome = engine(name).run(deck.plan, tmp_path, silent)
    assert outcome.status == "engine_error"
    assert "did not come to rest" in outcome.reason


def test_liggghts_too_writes_where_grains_settled_to_the_last_digit():
    text = build(TINY.scene, derive(TINY.scene), "", "", dialect=LIGGGHTS).texts["in.tank"]
    (line,) = (line for line in text.splitlines() if line.startswith("write_dump"))
    assert line.endswith('x y z vx vy vz modify sort id format "%d %d %.15g %.15g %.15g %g %g %g"')


def test_numerics_of_a_settled_bed_damp_more_and_rest_for_less():
    fresh, again = derive(TINY.scene), derive(TINY.scene, settled=True)
    assert again.settle_damping.value == pytest.approx(16.0 * fresh.settle_damping.value)
    assert again.settle_steps.value == pytest.approx(0.1 * fresh.settle_steps.value, abs=1.0)
    assert again.settle_energy == fresh.settle_energy
    by_hand = derive(TINY.set("numerics.settle_time", 0.5).scene, settled=True)
    assert by_hand.settle_steps == again.settle_steps


@pytest.mark.validate
@pytest.mark.usefixtures("cache")
def test_the_forces_do_not_tell_a_settled_bed_from_a_fresh_one(
    tmp_path: Path, capsys: pytest.CaptureFixture
):
    """`quick` over 20 D: drag and lift within two combined errors."""
    case = load("quick").set("drive.distance", "20 D")
    fresh, again = (run(case, tmp_path / word) for word in ("fresh", "again"))
    assert again.record["provenance"]["settled_bed"]["reused"]
    with capsys.disabled():
        print("\nsunk", sunk(case.scene, (fresh.folder, again.folder)))
        for key in fresh.quantities:
            for result in (fresh, again):
                q = result.quantities[key]
                print(f"{key} {q.mean:.5g} +- {q.standard_error:.2g} {q.unit}")
    for key, most in (("drag", 0.05), ("lift", 0.2)):
        one, other = fresh.quantities[key], again.quantities[key]
        error = hypot(one.standard_error, other.standard_error)
        assert error < most * one.mean
        assert abs(one.mean - other.mean) < 2.0 * error
