"""Run time against error: what is run next, what is judged, recommended, written and kept."""

from __future__ import annotations

import json
import os
import sys
import threading
import time
import tomllib
from concurrent.futures import ThreadPoolExecutor
from math import hypot, pi, sqrt
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from conftest import tiny_tank
from hypothesis import given
from hypothesis import strategies as st
from test_drag2d_scene import TINY, tiny
from test_shear_scene import tiny as tiny_cell
from typer.testing import CliRunner

from liftdrag.analysis.biases import Biases, read_biases
from liftdrag.analysis.precision import (
    Deviation,
    deviation,
    front,
    hidden_scatter,
    paired_deviation,
    pooled,
)
from liftdrag.analysis.quantity import Quantity
from liftdrag.bench import bench, runs, seconds
from liftdrag.bench.axes import Axis, Setting, axes_of
from liftdrag.bench.block import block
from liftdrag.bench.judged import CASE, best, biases, judge
from liftdrag.bench.points import Point, Task, points_of, reference
from liftdrag.bench.recommendation import advise
from liftdrag.bench.runs import Run
from liftdrag.bench.schedule import State, left_out, next_task
from liftdrag.bench.working import spent
from liftdrag.case import Case, load
from liftdrag.cli import app
from liftdrag.engines.process import start, watch
from liftdrag.errors import InputError
from liftdrag.numerics import derive
from liftdrag.runner import run

RNG = np.random.default_rng(1)


def quantity(mean: float, error: float) -> Quantity:
    return Quantity(mean, error, "1", None, 9.0, True)


def run_of(
    key: tuple[str, str], mean: float, error: float, cpu: float = 1.0, replica: int = 1, **rest: Any
) -> Run:
    answers = {"drag": quantity(mean, error)}
    return Run(*key, replica, "finished", "", cpu, cpu, 1.0, 1.0, answers, **rest)


class TestPrecision:
    def test_scatter_that_errors_do_not_show_is_found_and_is_in_the_pooled_error(self):
        """Of 4000 groups: hidden 3 beside a shown 2 to 2 %, and pooled errors as large as the
        scatter of the means; hidden 0 gives none."""
        shown, hidden, n = 2.0, 3.0, 4
        drawn = RNG.normal(10.0, hypot(shown, hidden), (4000, n))
        groups = [[quantity(x, shown) for x in row] for row in drawn]
        found = hidden_scatter(groups)
        assert found == pytest.approx(hidden, rel=0.02)
        error = pooled(groups[0], found).standard_error
        assert error == pytest.approx(drawn.mean(axis=1).std(), rel=0.04)
        alike = [[quantity(x, shown) for x in row] for row in RNG.normal(0.0, 1.9, (4000, n))]
        assert hidden_scatter(alike) == 0.0
        assert hidden_scatter([[quantity(1.0, 0.1)]]) == 0.0

    def test_replicas_weigh_the_same_whatever_their_errors(self):
        found = pooled([quantity(1.0, 0.1), quantity(4.0, 0.5)], 0.0)
        assert found.mean == 2.5
        assert found.standard_error == pytest.approx(sqrt(0.1**2 + 0.5**2) / 2.0)
        assert found.n_independent == 18.0

    def test_deviation_has_the_error_of_both_means(self):
        """Against a million draws of both, to 1 %; reversed it is that of the other from the one,
        exactly."""
        one, other = quantity(6.0, 0.12), quantity(5.0, 0.15)
        found = deviation(one, other)
        drawn = RNG.normal(6.0, 0.12, 10**6) / RNG.normal(5.0, 0.15, 10**6) - 1.0
        assert found.relative == pytest.approx(0.2)
        assert found.standard_error == pytest.approx(drawn.std(), rel=0.01)
        back = deviation(other, one)
        assert found.reversed.relative == pytest.approx(back.relative)
        assert found.reversed.standard_error == pytest.approx(back.standard_error)
        with pytest.raises(ValueError, match="zero"):
            deviation(one, quantity(0.0, 1.0))

    def test_pairs_that_began_alike_differ_by_less_than_they_scatter(self):
        """A shift by 1 % with a noise of 0.1 %, in pairs that scatter by 20 %."""
        base = RNG.normal(10.0, 2.0, 50)
        one = 1.01 * base + RNG.normal(0.0, 0.01, 50)
        found = paired_deviation(one, base)
        assert found.relative == pytest.approx(0.01, abs=4.0 * found.standard_error)
        assert found.standard_error == pytest.approx(0.001 / sqrt(50), rel=0.3)

    def test_bias_is_what_the_error_does_not_explain(self):
        assert Deviation(0.05, 0.03).bias == pytest.approx(0.04)
        assert Deviation(-0.02, 0.03).bias == 0.0

    @given(st.lists(st.tuples(st.integers(1, 9), st.integers(1, 9)), min_size=1, max_size=12))
    def test_front_is_that_of_a_naive_search(self, pairs: list[tuple[int, int]]):
        found = front([c for c, _ in pairs], [e for _, e in pairs])
        naive = {
            (c, e)
            for c, e in pairs
            if not any((c2, e2) != (c, e) and c2 <= c and e2 <= e for c2, e2 in pairs)
        }
        assert {pairs[k] for k in found} == naive
        assert len(found) == len(naive)
        assert [pairs[k] for k in found] == sorted(naive)


class TestAxes:
    @pytest.mark.parametrize(
        ("name", "refused"),
        [
            ("quick", ["thickness x0.6", "height x0.75"]),
            ("guillard2014/lid", []),
            ("zhou/c1", []),
            ("janssen/quick", []),
            ("shear/quick", []),
        ],
    )
    def test_every_value_of_a_packaged_case_changes_what_it_says(
        self, name: str, refused: list[str]
    ):
        """And nothing else of the scene; a lid still fits."""
        case = load(name)
        axes = axes_of(case, "lammps")
        points, notes = points_of(case, axes)
        assert [" ".join(key) for key in notes] == refused
        assert len({point.key for point in points}) == len(points)
        known = {
            (axis.name, setting.name): (axis, setting) for axis in axes for setting in axis.settings
        }
        for point in points:
            axis, setting = known[point.key]
            changed = _differences(case, point.case)
            assert changed == set(setting.changes)
            assert point.ranks == setting.ranks
            if axis.name != "ranks":
                assert _value(point.case, axis.key) == pytest.approx(setting.at)
                assert setting.at != axis.own

    def test_larger_cell_has_the_same_proportions(self):
        sides = {"length": "6 d_v", "height": "5 d_v", "width": "4 d_v", "count": None}
        case = tiny_cell(cell=sides)
        (axis,) = (axis for axis in axes_of(case, "dem") if axis.name == "size")
        points, _ = points_of(case, [axis])
        for point, share in zip(points, (0.5, 2.0), strict=True):
            found = np.array(point.case.scene.sides) / np.array(case.scene.sides)
            assert found == pytest.approx(share ** (1 / 3), rel=1e-5)

    def test_axes_of_each_scene(self):
        of = {name: [a.name for a in axes_of(load(name), "lammps")] for name in CASES}
        assert of == CASES
        assert "pair_law" not in [axis.name for axis in axes_of(load("quick"), "liggghts")]

    @pytest.mark.parametrize(("speed", "rayleigh"), [(0.2, True), (50.0, False)])
    def test_time_steps_of_a_tank_are_shares_of_the_smaller_time(
        self, speed: float, rayleigh: bool
    ):
        case = load("quick").set("drive.speed", speed)
        numerics = derive(case.scene)
        smaller, larger = numerics.rayleigh_time.value, numerics.hertz_time.value
        assert (smaller < larger) == rayleigh
        smaller = min(smaller, larger)
        (axis,) = (axis for axis in axes_of(case, "lammps") if axis.name == "time_step")
        for setting in axis.settings:
            assert setting.at == pytest.approx(float(setting.name) * smaller, rel=1e-3)
        assert axis.own == numerics.time_step.value

    def test_wider_box_in_the_plane_is_as_full_and_as_high(self):
        case = load("zhou/c1")
        points, _ = points_of(case, axes_of(case, "dem"))
        (wide,) = (point.case.scene for point in points if point.axis == "width")
        area = wide.box.width * wide.height - pi * wide.intruder.diameter**2 / 4.0
        assert wide.grains.area / area == pytest.approx(case.scene.box.solid_fraction)
        assert 1.0 <= wide.height / case.scene.height < 1.005

    def test_value_that_the_scene_refuses_is_left_out_with_its_reason(self):
        case = tiny_tank()
        points, notes = points_of(case, axes_of(case, "lammps"))
        assert ("thickness", "x0.6") not in {point.key for point in points}
        assert "three grain diameters" in notes["thickness", "x0.6"]

    def test_replicas_have_seeds_of_their_own(self):
        task = Task(reference(load("quick")), 3)
        assert task.case.scene.seed == load("quick").scene.seed + 2


CASES = {
    "quick": "time_step stiffness pair_law speed length thickness height sampling ranks".split(),
    "zhou/c1": "time_step stiffness speed width".split(),
    "janssen/quick": "time_step stiffness speed averaging ranks".split(),
    "shear/quick": "time_step stiffness size averaging ranks".split(),
}


def _value(case: Case, key: str) -> Any:
    found: Any = case.scene
    for name in key.split("."):
        found = getattr(found, name)
    return found


def _differences(case: Case, other: Case) -> set[str]:
    one, two = (dict(_flat(c.scene.model_dump())) for c in (case, other))
    return {key for key in one.keys() | two.keys() if one.get(key) != two.get(key)}


def _flat(tables: dict[str, Any], prefix: str = ""):
    for key, value in tables.items():
        if isinstance(value, dict):
            yield from _flat(value, f"{prefix}{key}.")
        else:
            yield prefix + key, value


def point(axis: str, name: str, hint: float, end: bool = True, ranks: int = 1) -> Point:
    return Point(axis, name, Case("x", {"seed": 1}), ranks, hint, 1.0, end)


THE_CASE = point(*CASE, 1.0)

AXES = [
    point("a", "low", 2.0),
    point("a", "mid", 0.5, end=False),
    point("a", "high", 0.6),
    point("b", "one", 1.5),
]


class World:
    """Runs whose cost and answer are known, on a clock of their own."""

    def __init__(self, points: list[Point], error: float = 0.02, **odd: float):
        self.points, self.error, self.odd = (THE_CASE, *points), error, odd
        self.fails: dict[str, int] = {}
        self.now, self.log = 0.0, list[str]()
        self.lock = threading.Lock()

    def __call__(self, task: Task) -> Run:
        with self.lock:
            self.log.append(f"{task.point.axis} {task.point.name}".strip())
            name, cost = task.point.name, 3.0 * task.point.hint_s
            self.now += cost
        if task.replica == self.fails.get(name):
            return Run(*task.point.key, task.replica, "lost_grains", "a grain left")
        mean = 1.0 + self.odd.get(name, 0.0)
        return run_of(task.point.key, mean, self.error, cost, task.replica)

    def spend(self, budget: float, jobs: int = 1, runs: tuple[Run, ...] = ()) -> list[Run]:
        state = State(self.points, runs, (), {"drag": 0.05}, budget)
        return list(spent(state, self, jobs, threading.Event(), lambda: self.now))


class TestSchedule:
    def test_case_first_then_ends_then_what_is_between_then_more_runs(self):
        world = World(AXES)
        world.spend(1e9)
        assert world.log[:6] == ["reference", "reference", "a high", "b one", "a low", "a mid"]
        more = world.log[6:]
        assert "a mid" in more
        assert "reference" in more

    def test_it_ends_when_nothing_is_in_doubt(self):
        """Each deviation is known to half of what is tolerated, on the front to a quarter; the
        case has more runs than any point."""
        world = World(AXES)
        runs = world.spend(1e9)
        found = judge(runs, "drag")
        errors = {key: one.deviation.standard_error for key, one in found.items() if key != CASE}
        assert max(errors.values()) <= 0.025
        assert min(errors.values()) <= 0.0125
        assert found[CASE].runs > max(one.runs for key, one in found.items() if key != CASE)
        assert len(runs) < 60

    def test_budget_is_not_overrun_but_for_the_case(self):
        """Costs are 3 times the hints, which is learnt from the runs of the case."""
        world = World(AXES)
        runs = world.spend(10.0)
        assert world.log == ["reference", "reference", "a high", "a mid"]
        assert world.now == pytest.approx(3.0 + 3.0 + 1.8 + 1.5)
        state = State(world.points, tuple(runs), (), {"drag": 0.05}, 0.0)
        assert left_out(state)[:2] == ["b one", "a low"]
        assert World(AXES).spend(0.0)[-1].key == CASE

    def test_what_ran_before_is_not_run_again(self):
        first = World(AXES)
        runs = tuple(first.spend(10.0))
        second = World(AXES)
        second.spend(7.0, runs=runs)
        assert second.log == ["b one"]

    @pytest.mark.parametrize("tried", [1, 2])
    def test_point_that_fails_is_a_finding_and_is_left(self, tried: int):
        world = World(AXES)
        world.fails = {"high": tried}
        runs = world.spend(1e9)
        assert world.log.count("a high") == tried
        assert [one.status for one in runs if one.name == "high"][-1] == "lost_grains"
        assert "a high" not in left_out(State(world.points, tuple(runs), (), {"drag": 0.05}, 0.0))

    def test_runs_that_still_go_on_are_told_when_it_is_stopped(self):
        world, halted = World(AXES), threading.Event()
        state = State(world.points, (), (), {"drag": 0.05}, 1e9)
        ended = spent(state, world, 1, halted, lambda: world.now)
        assert next(ended).key == CASE
        assert not halted.is_set()
        ended.close()
        assert halted.is_set()

    def test_case_that_fails_ends_it(self):
        world = World(AXES)
        world.fails = {"": 1}
        assert [one.status for one in world.spend(1e9)] == ["lost_grains"]

    def test_more_runs_go_where_they_tell_most_for_their_time(self):
        """Of two points in doubt the cheap one, and none of what is clearly shifted."""
        points = [point("a", "cheap", 0.5), point("a", "dear", 5.0), point("b", "off", 0.1)]
        world = World(points, error=0.03, off=1.0)
        world.spend(60.0)
        assert world.log.count("b off") == 1
        assert world.log.count("a cheap") > world.log.count("a dear")

    def test_run_on_several_ranks_goes_alone(self):
        points = [point("ranks", "2", 1.0, ranks=2), *AXES]
        pending = (Task(points[1], 1),)
        runs = tuple(run_of(CASE, 1.0, 0.02, replica=k) for k in (1, 2))
        state = State((THE_CASE, *points), runs, pending, {"drag": 0.05}, 1e9)
        assert next_task(state).point.name == "high"
        alone = Alone(points)
        alone.spend(200.0, jobs=2)
        assert alone.beside == {"2": 0}
        assert alone.together == 2


class Alone(World):
    """Notes what goes on while a run on several ranks does, and how many ever do."""

    def __init__(self, points: list[Point]):
        super().__init__(points)
        self.beside: dict[str, int] = {}
        self.together, self.open = 0, 0
        self.both = threading.Event()

    def __call__(self, task: Task) -> Run:
        with self.lock:
            self.open += 1
            self.together = max(self.together, self.open)
            if task.point.ranks > 1:
                self.beside[task.point.name] = self.open - 1
            if self.open == 2:
                self.both.set()
        self.both.wait(5.0)
        time.sleep(0.05)
        found = super().__call__(task)
        with self.lock:
            self.open -= 1
        return found


STEP = Axis(
    "time_step",
    "numerics.time_step",
    0.15,
    tuple(Setting(f"{at:g}", at, {"numerics.time_step": at}) for at in (0.05, 0.2, 0.3, 0.4)),
    "least",
    "of the smaller time",
)
STRIDE = Axis(
    "sampling",
    "numerics.sample_every",
    4.0,
    (Setting("16", 16.0, {"numerics.sample_every": 16}),),
    "least",
)
SPEED = Axis("speed", "drive.speed", 0.2, (Setting("x2", 0.4, {"drive.speed": 0.4}),), "least")

TOLERATED = {"drag": 0.05}


def steps(**deviations: float) -> list[Run]:
    """The case, and time steps that are off by so many of their deviation's errors of 2 %."""
    runs = [run_of(CASE, 1.0, 0.01, cpu=3.0)]
    for name, off in deviations.items():
        at = float(name.removeprefix("s")) / 100.0
        error = 0.02 * off
        own = sqrt(0.02**2 - (0.01 * (1.0 + error)) ** 2)
        runs.append(run_of(("time_step", f"{at:g}"), 1.0 + error, own, cpu=0.45 / at))
    return runs


class TestRecommendation:
    def test_cheapest_that_does_no_harm_is_chosen(self):
        (found,) = advise(steps(s5=0.5, s20=-1.0, s30=1.5), [STEP], TOLERATED)
        assert found.setting.at == 0.3
        assert found.evidence == "drag +3.0 +- 2.0 %, 2 times cheaper"

    @pytest.mark.parametrize("off", [-10.0, -3.1, 3.1, 10.0])
    def test_shifted_value_and_what_lies_beyond_are_not(self, off: float):
        (found,) = advise(steps(s20=0.1, s30=off, s40=0.1), [STEP], TOLERATED)
        assert found.setting.at == 0.2
        assert any("0.3" in words and "it differs" in words for words in found.cheaper)
        assert any("0.4" in words and "beyond" in words for words in found.cheaper)

    def test_failed_value_and_what_lies_beyond_are_not(self):
        runs = [*steps(s40=0.0), Run("time_step", "0.3", 1, "lost_grains", "a grain left")]
        (found,) = advise(runs, [STEP], TOLERATED)
        assert found.setting is None
        assert "no cheaper value" in found.evidence
        assert any("lost_grains" in words for words in found.cheaper)

    def test_noise_that_would_hide_a_shift_is_undecided(self):
        """Of 5 % a shift by twice the error of 2.6 %; that of 2.4 % is seen."""
        for error, chosen in ((0.024, True), (0.026, False)):
            runs = [run_of(CASE, 1.0, 1e-4), run_of(("time_step", "0.3"), 1.0, error, cpu=0.5)]
            (found,) = advise(runs, [STEP], TOLERATED)
            assert (found.setting is not None) == chosen
            assert chosen or "undecided" in found.cheaper[0]

    def test_shift_far_below_what_is_tolerated_is_none(self):
        """Ten errors, but 0.5 % where 5 % are tolerated; 2 % are one."""
        for off, chosen in ((0.005, True), (0.02, False)):
            each = {"drag": tuple(1.0 + off + 0.001 * k for k in (-1, 0, 1, 0))}
            runs = [
                run_of(CASE, 1.0, 0.02, each={"drag": (1.0,) * 4}),
                run_of(("time_step", "0.3"), 1.0 + off, 0.02, cpu=0.5, each=each),
            ]
            (found,) = advise(runs, [STEP], TOLERATED)
            assert (found.setting is not None) == chosen

    def test_value_that_needs_more_runs_for_the_same_error_is_dearer(self):
        """Half the time, but 1.5 times the error: 0.5 x 1.5^2 = 1.1 times the cost. Not so of a
        time step, which does not change the error: there the 1.5 are chance."""
        (found,) = advise(
            [run_of(CASE, 1.0, 0.01), run_of(("sampling", "16"), 1.0, 0.015, cpu=0.5)],
            [STRIDE],
            TOLERATED,
        )
        assert found.setting is None
        assert found.cheaper == ()
        runs = [run_of(CASE, 1.0, 0.01), run_of(("time_step", "0.3"), 1.0, 0.015, cpu=0.5)]
        assert advise(runs, [STEP], TOLERATED)[0].setting.at == 0.3

    def test_nothing_is_said_without_the_case(self):
        assert advise(steps(s30=0.0)[1:], [STEP], TOLERATED) == []

    def test_block_can_be_pasted_into_the_case(self):
        """Keys of [numerics] alone, those that the case has kept; the stride as long in time."""
        runs = [
            *steps(s30=0.0),
            run_of(("sampling", "16"), 1.0, 0.01, cpu=1.0),
            run_of(("speed", "x2"), 1.3, 0.01, cpu=1.0),
        ]
        advice = advise(runs, [STEP, STRIDE, SPEED], TOLERATED)
        text = block("of x", advice, {"skin": "0.1 d", "time_step": 0.15})
        assert tomllib.loads(text) == {
            "numerics": {"skin": "0.1 d", "time_step": 0.3, "sample_every": 8}
        }
        assert "# 0.3 of the smaller time: drag +0.0 +- 2.0 %, 2 times cheaper" in text
        assert "# not speed x2: drag +30.0 +- 1.6 %" in text
        kept = block("of x", advise(steps(s30=9.0), [STEP], TOLERATED), {"time_step": 0.15})
        assert tomllib.loads(kept) == {"numerics": {"time_step": 0.15}}


def test_front_of_a_bench_is_of_time_and_error_with_bias():
    """A cheap point that is 20 % off is beaten by the case; one that is not joins the front."""
    runs = [
        run_of(CASE, 1.0, 0.01, cpu=4.0),
        run_of(("speed", "x2"), 1.2, 0.01, cpu=4.5),
        run_of(("time_step", "0.3"), 1.0, 0.02, cpu=2.0),
    ]
    assert best(runs, "drag") == [("time_step", "0.3"), CASE]
    off = judge(runs, "drag")["speed", "x2"]
    error = hypot(0.01, 1.2 * 0.01)
    assert off.total_error == pytest.approx(hypot(0.01, sqrt(0.2**2 - error**2)))


def test_scatter_of_runs_is_a_share_of_the_mean_and_that_of_answers_alike():
    """Runs of the case and of a point like it scatter by 2 % more than their errors say; one far
    off, whose runs scatter by half, has no part in that, and the 2 % are of its own mean."""
    other, far = ("speed", "x2"), ("stiffness", "x10")
    runs = [
        *(run_of(CASE, 1.0 + 0.02 * s, 1e-6, replica=k) for k, s in enumerate((-1, 1), 1)),
        *(run_of(other, 1.2 + 0.02 * s, 1e-6, replica=k) for k, s in enumerate((-1, 1), 1)),
        *(run_of(far, 10.0 + 5.0 * s, 1e-6, replica=k) for k, s in enumerate((-1, 1), 1)),
    ]
    found = judge(runs, "drag")
    hidden = 0.02 * sqrt(2.0)
    for key, mean in ((CASE, 1.0), (other, 1.2), (far, 10.0)):
        error = found[key].answer.standard_error
        assert error == pytest.approx(hidden * mean / sqrt(2.0), rel=1e-3)


class TestBiases:
    def test_case_against_the_most_careful_value_measured(self):
        """(1.0 - 1.25) / 1.25, with the errors of both; not against what is less careful."""
        slow = Axis(
            "speed",
            "drive.speed",
            0.2,
            tuple(Setting(f"x{s:g}", 0.2 * s, {}) for s in (0.25, 0.5, 2.0)),
            "least",
        )
        runs = [
            run_of(CASE, 1.0, 0.01),
            run_of(("speed", "x0.5"), 1.25, 0.05),
            run_of(("speed", "x2"), 0.5, 0.05),
            run_of(("time_step", "0.2"), 1.0, 0.01),
        ]
        found = biases(runs, [slow, STEP], ["drag"])
        assert list(found["drag"]) == ["speed"]
        one = found["drag"]["speed"]
        assert one.relative == pytest.approx(-0.2)
        assert one.standard_error == pytest.approx(hypot(0.01, 0.8 * 0.05) / 1.25)
        assert (one.at, one.against) == (0.2, 0.1)

    def test_they_are_read_as_they_were_written(self, tmp_path: Path):
        found = biases([*steps(s5=1.0)], [STEP], ["drag"])
        written = Biases("x", "dem", {"seed": 1, "grains": {"diameter": "1 mm"}}, found)
        (tmp_path / "bench.json").write_text(json.dumps(written.to_dict() | {"more": 1}))
        assert read_biases(tmp_path) == written
        (tmp_path / "bench.json").write_text('{"biases": {"drag": 1}}')
        with pytest.raises(InputError, match="damaged"):
            read_biases(tmp_path)
        with pytest.raises(InputError, match="run liftdrag bench"):
            read_biases(tmp_path / "none")


@pytest.mark.parametrize(("text", "found"), [("90s", 90.0), ("30m", 1800.0), ("1.5h", 5400.0)])
def test_budget_in_words(text: str, found: float):
    assert seconds(text) == found


@pytest.mark.parametrize("text", ["", "30", "m", "-3m", "0s", "3d", "1h30m", "nan s"])
def test_budget_that_is_no_time_is_refused(text: str):
    with pytest.raises(InputError, match="--budget"):
        seconds(text)


BUSY = "import time\nwhile time.process_time() < 0.3: pass"
WAITS = f"import subprocess, sys; subprocess.run([sys.executable, '-c', {BUSY!r}])"
IDLE = "import pathlib, time\nwhile not pathlib.Path('over').exists(): time.sleep(0.05)"


def test_processor_time_is_that_of_the_child_and_its_children_alone(tmp_path: Path):
    """Of a child that begins before two busy ones and ends after them, its own little."""

    def used(code: str) -> float:
        child = start([sys.executable, "-c", code], tmp_path, os.environ, "said")
        ended = watch(child, tmp_path, lambda: None)
        assert ended.code == 0
        return ended.cpu_s

    with ThreadPoolExecutor(1) as aside:
        idle = aside.submit(used, IDLE)
        assert used(BUSY) >= 0.3
        assert used(WAITS) >= 0.3
        (tmp_path / "over").touch()
        assert idle.result() < 0.3


@pytest.fixture
def plane(tmp_path: Path) -> Path:
    file = tmp_path / "plane.toml"
    file.write_text(TINY.replace("runs = 3", "runs = 4"))
    return file


def invoke(*words: str) -> Any:
    return CliRunner().invoke(app, ["bench", *words])


class TestRealRuns:
    def test_bench_from_the_command_line_goes_on_where_it_was(self, plane: Path, tmp_path: Path):
        """First the case alone, then the time steps; at last only runs that were
        spoilt or are another engine's."""
        out = tmp_path / "out"
        words = [str(plane), "--out", str(out), "--axes", "time_step", "--jobs", "2"]
        first = invoke(*words, "--budget", "0.01s")
        assert first.exit_code == 0
        assert "Left out for the budget of 0.01s" in first.output
        assert "time_step x0.25" in first.output
        assert len(list(out.glob("*/**/result.json"))) == 2
        record = json.loads(invoke(*words, "--budget", "10m", "--json").stdout)
        assert record["left_out"] == []
        assert {(one["axis"], one["value"]) for one in record["points"]} == {
            CASE,
            *(("time_step", name) for name in ("x0.25", "x0.5", "x2", "x3")),
        }
        assert read_biases(out).found["drag"]["time_step"].relative == pytest.approx(0.0, abs=0.01)
        assert (out / "bench.png").read_bytes().startswith(b"\x89PNG")
        advised = tomllib.loads((out / "numerics.toml").read_text())
        assert advised.keys() == {"numerics"}
        assert advised["numerics"].keys() <= {"time_step"}
        self._check_rows(pd.read_csv(out / "bench.csv", keep_default_na=False), out)
        self._check_resumed(words, out)
        other = invoke(str(plane), "--out", str(out), "--set", "seed=5")
        assert "something else" in str(other.exception)

    def _check_resumed(self, words: list[str], out: Path) -> None:
        written = {file: file.stat().st_mtime_ns for file in out.glob("*/**/series.csv")}
        spoilt = {
            out / "reference" / "run-1": {"engine": {"version": "of another day"}},
            out / "reference" / "run-2": {"status": "killed"},
        }
        for place, change in spoilt.items():
            result = json.loads((place / "result.json").read_text()) | change
            (place / "result.json").write_text(json.dumps(result))
        assert invoke(*words, "--budget", "0.01s").exit_code == 0
        changed = {file for file, then in written.items() if file.stat().st_mtime_ns != then}
        assert changed == {file for place in spoilt for file in place.glob("packing-*/series.csv")}
        assert len(changed) == 8

    def _check_rows(self, table: pd.DataFrame, out: Path) -> None:
        """Each row by hand from the runs' own records."""
        for row in table.itertuples():
            place = out / row.axis / row.value if row.value else out / row.axis
            records = [json.loads(f.read_text()) for f in sorted(place.glob("run-*/result.json"))]
            assert row.runs == len(records)
            assert row.cpu_s == pytest.approx(sum(record["cpu_s"] for record in records))
            drags = [record["quantities"]["drag"]["mean"] for record in records]
            assert row.mean == pytest.approx(np.mean(drags))
            steps = sum(record["steps"] * record["grains"] for record in records)
            assert row.grain_steps == pytest.approx(steps)

    def test_interrupted_bench_keeps_what_finished(self, tmp_path: Path, monkeypatch):
        """The engine was warm before the first run, which therefore takes what the others do."""
        begun = []

        def noted(case: Case, folder: Path, *rest: Any) -> Any:
            begun.append(folder.name)
            return run(case, folder, *rest)

        def interrupt(_words: str) -> None:
            raise KeyboardInterrupt

        monkeypatch.setattr(runs, "run", noted)
        with pytest.raises(KeyboardInterrupt):
            bench(tiny(), None, tmp_path / "out", 60.0, 1, ["speed"], None, interrupt)
        record = json.loads((tmp_path / "out" / "bench.json").read_text())
        assert [one["status"] for one in record["runs"]] == ["finished"]
        assert record["biases"] == {"drag": {}}
        assert begun[:2] == ["warm-up", "run-1"]
        assert "warm-up" not in begun[2:]
        assert not (tmp_path / "out" / "warm-up").exists()

    def test_bench_of_a_tank_judges_both_coefficients(self, tmp_path: Path, monkeypatch):
        """On the wheel: two runs at a time, each of which settles its own bed and goes all the
        way, whatever would stop the case."""
        monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
        case = tiny_tank(drive={"distance": "4 D"}, stop={"relative_error": 0.5})
        found = bench(case, "lammps", tmp_path / "out", 1e-3, 2, ["time_step"])
        assert [one.key for one in found.runs] == [CASE, CASE]
        assert set(found.judged("lift_coefficient")) == {CASE}
        assert {one.status for one in found.runs} == {"finished"}
        assert not list((tmp_path / "cache").glob("liftdrag/beds/*"))
        assert "time_step 0.3" in found.left
        steps = {one.grain_steps for one in found.runs}
        records = [json.loads(f.read_text()) for f in tmp_path.glob("out/*/run-*/run.json")]
        assert [record["tables"].keys() & {"stop"} for record in records] == [set(), set()]
        assert min(steps) > 0.9 * derive(case.scene).grain_steps.value

    @pytest.mark.parametrize(
        ("words", "says"),
        [
            (["quick", "--axes", "colour"], "no axis 'colour'"),
            (["zhou/c1", "--axes", "time_step,length"], "no axis 'length'"),
            (["quick", "--budget", "soon"], "--budget 'soon'"),
            (["quick", "--jobs", "0"], "--jobs 0"),
            (["quick", "--engine", "dem"], "no tank"),
            (["none"], "no case"),
        ],
    )
    def test_bad_input_is_refused_before_anything_runs(
        self, words: list[str], says: str, tmp_path: Path, monkeypatch
    ):
        monkeypatch.chdir(tmp_path)
        shown = invoke(*words)
        assert isinstance(shown.exception, InputError)
        assert says in str(shown.exception)
        assert not list(tmp_path.iterdir())

    def test_folder_of_something_else_is_kept(self, plane: Path, tmp_path: Path):
        (tmp_path / "mine").mkdir()
        (tmp_path / "mine" / "thesis.txt").write_text("all of it")
        shown = invoke(str(plane), "--out", str(tmp_path / "mine"))
        assert "something else" in str(shown.exception)
        assert [file.name for file in (tmp_path / "mine").iterdir()] == ["thesis.txt"]
