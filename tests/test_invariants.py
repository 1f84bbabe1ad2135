"""What every run is watched by: overlaps against naive loops, momentum, energy and weight."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import combinations, product
from math import hypot, inf, nan, sqrt

import numpy as np
import pytest
from beds import clumps, grains
from conftest import EXPERIMENTS, tiny_tank
from test_drag2d_scene import tiny

from liftdrag.analysis.invariants import (
    Invariant,
    check_sound,
    column_invariants,
    plane_invariants,
    tank_invariants,
    watched,
)
from liftdrag.analysis.overlaps import deepest_in_plane, deepest_in_tank
from liftdrag.analysis.quantity import Quantity
from liftdrag.case import load
from liftdrag.dem import Bed
from liftdrag.engines import engine
from liftdrag.errors import RunFailed
from liftdrag.folder import Record
from liftdrag.numerics.bounds import bounds_of
from liftdrag.result import Result
from liftdrag.runner import run
from liftdrag.series import Series
from liftdrag.snapshot import Snapshot

RNG = np.random.default_rng(3)


def scattered(count: int = 120) -> Snapshot:
    """Grains, some of the bottom layer, anywhere in the tiny tank and a little beside it."""
    box = tiny_tank().scene.tank
    sides = np.array([box.length, box.thickness, box.height])
    place = RNG.uniform(-0.1, 1.1, (count, 3)) * sides
    return Snapshot(0.0, RNG.integers(1, 3, count), place, np.zeros((count, 3)))


@pytest.mark.parametrize("clear", [False, True], ids=["cylinder", "grains"])
def test_overlap_in_a_tank_is_that_of_a_naive_loop(clear: bool):
    """Over the images, without pairs of the bottom layer; the cylinder touches grains alone."""
    scene, found = tiny_tank().scene, scattered()
    if clear:
        away = np.hypot(*(found.position[:, [0, 2]] - [scene.axis_x, scene.axis_height]).T)
        keep = away > 2.0 * scene.intruder.diameter
        found = replace(found, kind=found.kind[keep], position=found.position[keep])
    d, depths = scene.grains.diameter, [0.0]
    shifts = [
        np.array([i * scene.tank.length, j * scene.tank.thickness, 0.0])
        for i, j in product((-2, -1, 0, 1, 2), repeat=2)
    ]
    for i, j in combinations(range(len(found.kind)), 2):
        if found.kind[i] == found.kind[j] == 2:
            continue
        apart = found.position[i] - found.position[j]
        depths += [d - float(np.linalg.norm(apart + shift)) for shift in shifts]
    for kind, (x, _, z) in zip(found.kind, found.position, strict=True):
        if kind == 1:
            x = x % scene.tank.length
            away = hypot(x - scene.axis_x, z - scene.axis_height)
            depths.append((d + scene.intruder.diameter) / 2.0 - away)
    assert deepest_in_tank(scene, found) == pytest.approx(max(depths), rel=1e-9)


@pytest.mark.parametrize("place", [(-0.2, 0.0), (0.0, -0.2), (-0.1, -0.1)])
def test_overlap_in_a_tank_is_seen_across_its_periodic_sides(place: tuple[float, float]):
    """Of a grain at the corner and of one a little beyond the sides, or back inside them."""
    scene = tiny_tank().scene
    d, box = scene.grains.diameter, scene.tank
    beyond = np.array([*place, 0.0]) * d
    for i, j in product((0, 1), repeat=2):
        other = beyond + np.array([i * box.length, j * box.thickness, 0.0])
        pair = np.array([[0.0, 0.0, 0.0], other])
        found = deepest_in_tank(scene, Snapshot(0.0, np.ones(2), pair, 0.0 * pair))
        assert found == pytest.approx(d * (1.0 - hypot(*place)))


def as_seen(bed: Bed) -> Snapshot:
    still = np.zeros((len(bed.place), 3))
    place = np.column_stack([bed.place, still[:, 0]])
    return Snapshot(0.0, np.ones(len(still)), place, still)


def test_overlap_in_the_plane_is_that_of_a_naive_loop():
    """Of discs of many sizes, one of them large; of dumbbells, whose own discs touch."""
    radius = np.append(RNG.uniform(0.8, 1.2, 60), 5.0)
    bed = grains(RNG.uniform(0.0, 60.0, (61, 2)), radius[:, None])
    depths = [
        (radius[i] + radius[j] - np.linalg.norm(bed.place[i] - bed.place[j]))
        / min(radius[i], radius[j])
        for i, j in combinations(range(61), 2)
    ]
    assert max(depths) > 0.0
    assert deepest_in_plane(bed, as_seen(bed)) == pytest.approx(max(depths))
    pair = [[0.9, 0.0], [-0.9, 0.0]]
    apart = clumps([[0.0, 0.0], [3.7, 0.0]], pair, [1.0, 1.0])
    assert deepest_in_plane(apart, as_seen(apart)) == pytest.approx(0.1)


class TestMomentum:
    @pytest.mark.parametrize("name", EXPERIMENTS)
    def test_of_a_tank_balances_to_a_percent(self, name: str, result_of: Callable[[str], Result]):
        """Forces on the layers, drag, lift and weight against the change from bed to bed; a drag
        or a weight that is off by 3 % does not."""
        result, scene = result_of(name), EXPERIMENTS[name].scene
        stored = result.record["invariants"]
        assert all(one["holds"] for one in stored.values())
        assert stored.keys() == {
            "largest_overlap",
            "agitation",
            "horizontal_balance",
            "vertical_balance",
        }
        record = Record.read(result.folder)
        beds = list(engine("lammps").snapshots(record.plan, result.folder))
        channels, units = dict(result.series.channels), result.series.units
        more_drag = channels | {"drag": 1.03 * channels["drag"]}
        found = tank_invariants(scene, Series(result.series.time, more_drag, units), beds)
        assert not found["horizontal_balance"].holds
        assert found["vertical_balance"].holds
        heavier = channels | {"floor_lift": 1.03 * channels["floor_lift"]}
        found = tank_invariants(scene, Series(result.series.time, heavier, units), beds)
        assert not found["vertical_balance"].holds
        pushed = replace(beds[-1], velocity=beds[-1].velocity + np.array([0.02, 0.0, 0.0]))
        found = tank_invariants(scene, result.series, [beds[0], pushed])
        assert not found["horizontal_balance"].holds

    @pytest.mark.needs("lmp", "liggghts")
    @pytest.mark.parametrize("name", ["lmp", "liggghts"])
    def test_balances_on_the_programs_too(self, name: str, out):
        found = run(tiny_tank(), out, name).record["invariants"]
        assert found["horizontal_balance"]["holds"]
        assert found["vertical_balance"]["holds"]


class TestEnergy:
    def test_of_a_plane_is_less_than_what_the_cylinder_gave(self, out):
        """And one that grows by itself is seen: of the same run with less work done."""
        case = tiny()
        result = run(case, out)
        stored = result.record["invariants"]
        assert stored.keys() == {"largest_overlap", "energy_created", "agitation"}
        assert all(one["holds"] for one in stored.values())
        pushed = dict(result.series.channels) | {"drag": -result.series["drag"]}
        series = Series(result.series.time, pushed, result.series.units)
        assert not plane_invariants(case.scene, [series], 0.1)["energy_created"].holds

    def test_created_is_that_of_the_definition(self):
        scene = tiny().scene
        names = dict.fromkeys(("kinetic", "elastic", "drag"), "J")
        rows = {"kinetic": [1.0, 2.0, 9.0], "elastic": [1.0, 1.0, 2.0], "drag": [7.0, 3.0, 1.0]}
        step = 1.0 / scene.drive.speed
        channels = {name: np.array(values) for name, values in rows.items()}
        series = Series(step * np.arange(1.0, 4.0), channels, names)
        found = plane_invariants(scene, [series], 0.4)
        assert found["energy_created"].value == pytest.approx(11.0 - 2.0 - 4.0)
        bounds = bounds_of(scene)
        share = (bounds.own / bounds.expected) ** 2
        assert found["energy_created"].bound == pytest.approx(2.0 * share)
        assert found["largest_overlap"].value == pytest.approx(0.2)


def test_column_is_watched_by_its_weight_agitation_and_overlap():
    scene = load("janssen/quick").scene
    speed = 0.1
    energy = 0.5 * scene.grains.mass * speed**2
    channels = {"kinetic": np.full(40, energy), "overlap": np.linspace(0.0, 0.01, 40)}
    series = Series(np.arange(40.0), channels, {"kinetic": "J", "overlap": "1"})
    found = column_invariants(scene, series, Quantity(1.02, 1e-4, "1", None, None, True))
    assert found["agitation"].value == pytest.approx(speed)
    assert found["largest_overlap"].value == pytest.approx(0.005)
    assert not found["weight_balance"].holds
    noisy = column_invariants(scene, series, Quantity(1.02, 0.01, "1", None, None, True))
    assert noisy["weight_balance"].holds


def test_overlap_beyond_its_bound_ends_a_run_and_others_only_warn():
    record = {"status": "finished", "warnings": ["as before"]}
    sound = watched(record, {"largest_overlap": Invariant(0.1, 0.2, "d")})
    assert sound["status"] == "finished"
    assert sound["warnings"] == ["as before"]
    check_sound(sound)
    warned = watched(record, {"vertical_balance": Invariant(-3.0, 2.0, "N")})
    assert warned["status"] == "finished"
    assert warned["warnings"][0].startswith("INVARIANT BROKEN: vertical_balance is -3 N")
    deep = watched(record, {"largest_overlap": Invariant(0.3, 0.2, "d")})
    with pytest.raises(RunFailed, match=r"0\.3 d, more than the 0\.2 d") as caught:
        check_sound(deep)
    assert caught.value.status == deep["status"] == "overlap_exceeded"
    assert not any(Invariant(bad, 1.0, "N").holds for bad in (nan, inf, -1.1))


def test_overlap_bound_of_a_tank_is_of_load_and_impact():
    """It falls as E^-2/3 where the load decides, and E^-2/5 where impacts do."""
    case = tiny_tank()
    soft = bounds_of(case.scene).overlap
    stiff = bounds_of(case.set("grains.youngs_modulus", 5e9).scene).overlap
    assert 1e3 ** (2.0 / 5.0) < soft / stiff < 1e3 ** (2.0 / 3.0)
    fast = bounds_of(case.set("drive.speed", "2 m/s").scene)
    slow = bounds_of(case.set("drive.speed", "0.02 m/s").scene)
    assert fast.overlap > slow.overlap
    assert fast.agitation == 2.0
    assert slow.agitation == pytest.approx(sqrt(2.0 * 9.81 * case.scene.grains.diameter), rel=1e-3)
