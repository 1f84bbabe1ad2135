"""The stability map: what is pushed and how far, what counts as broken, and real breaks."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
from conftest import TINY, tiny_tank
from test_bench import run_of
from test_drag2d_scene import TINY as PLANE
from test_drag2d_scene import tiny
from test_shear_scene import tiny as tiny_cell
from typer.testing import CliRunner

import liftdrag.bench.runs
import liftdrag.stress.axes
import liftdrag.stress.harness
from liftdrag.bench.axes import Axis, Setting
from liftdrag.bench.judged import CASE
from liftdrag.bench.points import Point, Task
from liftdrag.bench.runs import Run, Stand
from liftdrag.bench.schedule import State
from liftdrag.case import Case, load, packaged
from liftdrag.cli import app
from liftdrag.errors import RunFailed
from liftdrag.numerics import derive
from liftdrag.numerics.bounds import bounds_of
from liftdrag.stress import stress
from liftdrag.stress.axes import STEPS, axes_of
from liftdrag.stress.harness import left_out, next_task
from liftdrag.stress.outcome import Tried, outcomes
from liftdrag.stress.shortened import cut
from liftdrag.stress.stressed import Stressed


def invariant(value: float, bound: float = 1.0, unit: str = "d") -> dict[str, Any]:
    return {"value": value, "bound": bound, "unit": unit, "holds": abs(value) <= bound}


def tried(key: tuple[str, str], mean: float = 1.0, error: float = 0.01, **found: Any) -> Tried:
    return Tried(run_of(key, mean, error, replica=found.pop("replica", 1)), found)


STEP, GRIP = ("time_step", "0.5"), ("friction", "1")


class TestAxes:
    @pytest.mark.parametrize("name", ["quick", "guillard2014/lid", "zhou/c1", "janssen/quick"])
    def test_steps_are_what_is_run_as_shares_of_the_scale(self, name: str):
        """From timid to the whole scale, or to where the scene refuses; none twice."""
        case = load(name)
        bounds = bounds_of(case.scene)
        (axis,) = (axis for axis in axes_of(case) if axis.name == "time_step")
        shares = [float(setting.at) / bounds.scale for setting in axis.settings]
        assert shares == sorted(set(shares))
        assert shares[0] < 0.04
        assert shares[-1] == pytest.approx(1.0, rel=1e-5)
        assert all(abs(share / bounds.own - 1.0) > 0.05 for share in shares)
        assert len(shares) <= len(STEPS)
        changed = case.set("numerics.time_step", axis.settings[0].changes["numerics.time_step"])
        assert derive(changed.scene).time_step.value == pytest.approx(axis.settings[0].at)

    def test_axes_of_each_scene(self):
        names = ["time_step", "stiffness", "restitution", "friction", "speed"]
        for case in ("quick", "zhou/c1", "janssen/walton_13"):
            assert [axis.name for axis in axes_of(load(case))] == names
        sheared = ["time_step", "stiffness", "restitution", "shear_rate"]
        assert [axis.name for axis in axes_of(load("shear/quick"))] == sheared
        still = load("janssen/quick").set("drive", {"motion": "none", "duration": "0.1 s"})
        assert [axis.name for axis in axes_of(still)] == names[:-1]

    @pytest.mark.parametrize("share", [0.01, 0.5])
    @pytest.mark.parametrize("name", list(packaged()))
    def test_cut_case_is_no_longer_and_still_one(self, name: str, share: float):
        case = load(name)
        short = cut(case, share).scene
        before = derive(case.scene).grain_steps.value
        assert derive(short).grain_steps.value <= before * 1.001


class TestOutcomes:
    def of(self, *more: Tried) -> list[tuple[str, ...]]:
        own = [
            tried(CASE, 1.0, 0.01, agitation=invariant(0.10), replica=1),
            tried(CASE, 1.0, 0.01, agitation=invariant(0.10), replica=2),
        ]
        found = outcomes([*own, *more], {"drag": 0.05})
        assert [one.causes for one in found[:2]] == [(), ()]
        return [one.causes for one in found[2:]]

    @pytest.mark.parametrize(
        ("status", "cause"),
        [
            ("lost_grains", "lost"),
            ("not_finite", "not finite"),
            ("overlap_exceeded", "overlap"),
            ("engine_error", "failed"),
        ],
    )
    def test_status_is_a_cause(self, status: str, cause: str):
        assert self.of(Tried(Run(*STEP, 1, status, "why"), {})) == [(cause,)]

    def test_bed_that_does_not_come_to_rest_gains_energy(self):
        reason = "the bed did not come to rest: 1 J per grain after 9 steps"
        assert self.of(Tried(Run(*STEP, 1, "engine_error", reason), {})) == [("energy",)]

    def test_broken_invariants_are_causes_on_any_axis(self):
        found = self.of(
            tried(GRIP, agitation=invariant(1.1), largest_overlap=invariant(0.4)),
            tried(GRIP, vertical_balance=invariant(-2.0), largest_overlap=invariant(3.0)),
        )
        assert found == [("energy",), ("overlap", "balance")]

    def test_agitation_and_answer_must_stay_where_the_step_changes_alone(self):
        """Twice the energy; four combined errors, a fifth of what is tolerated and three runs."""
        hot = {"agitation": invariant(0.15)}
        assert self.of(tried(STEP, **hot), tried(GRIP, **hot)) == [("energy",), ()]
        warm = {"agitation": invariant(0.14)}
        assert self.of(tried(STEP, **warm)) == [()]
        for key, mean, count, causes in (
            (STEP, 1.06, 3, ("answer",)),
            (STEP, 1.06, 2, ()),
            (GRIP, 1.06, 3, ()),
            (STEP, 1.03, 3, ()),
        ):
            same = [tried(key, mean, 0.01, replica=k) for k in range(1, count + 1)]
            assert self.of(*same) == [causes] * count
            own = [tried(CASE, 1.0, 0.01, replica=k) for k in (1, 2)]
            doubts = [one.doubtful for one in outcomes([*own, *same], {"drag": 0.05})]
            assert doubts == [False, False, *[(key, mean, count) == (STEP, 1.06, 2)] * count]
        precise = [
            Tried(run_of(key, mean, 0.1, each={"drag": (mean,) * 4}), {})
            for key, mean in ((CASE, 1.0), *(3 * [(STEP, 1.009)]))
        ]
        assert [one.causes for one in outcomes(precise, {"drag": 0.05})] == [()] * 4


def stressed(*steps: tuple[float, str], refused: float = 0.0) -> Stressed:
    """The tiny bed in the plane at these shares of its scale, with these statuses."""
    case = tiny()
    scale = bounds_of(case.scene).scale
    shares = [*(share for share, _ in steps), *([refused] if refused else [])]
    settings = tuple(Setting(f"{s:g}", s * scale, {"numerics.time_step": s}) for s in shares)
    axis = Axis("time_step", "numerics.time_step", 0.05 * scale, settings, "least")
    runs = [
        tried(("time_step", f"{share:g}"))
        if status == "finished"
        else Tried(Run("time_step", f"{share:g}", 1, status), {})
        for share, status in steps
    ]
    refusals = {("time_step", f"{refused:g}"): "too long"} if refused else {}
    stand = Stand(Path(), "dem", "1", None, ("drag",))
    return Stressed(case, case, stand, (axis,), (tried(CASE), *runs), refusals)


class TestMargin:
    def test_is_to_the_largest_step_below_the_first_that_breaks(self):
        ends = [(0.02, "lost_grains"), (0.3, "finished"), (0.45, "not_finite"), (0.6, "finished")]
        margin = stressed(*ends).margin
        assert (margin.largest, margin.breaks) == pytest.approx((0.3, 0.45))
        assert margin.times == pytest.approx(0.3 / margin.own)
        assert "the next that was run, 0.45, breaks (not finite)" in str(margin)

    def test_step_whose_answer_seems_another_is_not_held(self):
        """Two runs 50 errors off are too few to say so, and too many to call it held."""
        found = stressed((0.3, "finished"), (0.4, "finished"))
        off = [tried(("time_step", "0.4"), 1.5, 0.01, replica=k) for k in (1, 2)]
        kept = [one for one in found.tried if one.run.key != ("time_step", "0.4")]
        margin = replace(found, tried=(*kept, *off)).margin
        assert (margin.largest, margin.breaks) == pytest.approx((0.3, 0.4))
        assert "0.4, seems to break (answer?)" in str(margin)

    def test_refused_step_is_no_break(self):
        margin = stressed((0.3, "finished"), refused=0.5).margin
        assert (margin.largest, margin.breaks) == (pytest.approx(0.3), None)
        assert "nothing that was begun broke" in str(margin)


def test_case_comes_first_then_its_seeds_then_the_cheapest():
    points = [Point(*CASE, Case("x", {"seed": 1}), 1, 1.0, 1.0, True)] + [
        Point("a", name, Case("x", {"seed": 1}), 1, hint, 1.0, False)
        for name, hint in (("dear", 5.0), ("cheap", 0.5), ("mid", 2.0))
    ]
    runs: list[Run] = []
    order = []
    while (task := next_task(State(tuple(points), tuple(runs), (), {}, 3.0))) is not None:
        order.append((task.point.name, task.replica))
        runs.append(run_of(task.point.key, 1.0, 0.1, replica=task.replica))
    assert order == [("", 1), ("", 2), ("", 3), ("cheap", 1), ("mid", 1)]
    pending = (Task(points[0], 1),)
    assert next_task(State(tuple(points), (), pending, {}, 3.0)) is None


def test_answer_that_seems_another_is_run_again_before_it_is_believed():
    case = Point(*CASE, Case("x", {"seed": 1}), 1, 1.0, 1.0, True)
    off = Point(*STEP, Case("x", {"seed": 1}), 1, 1.0, 1.0, True)
    runs = [run_of(CASE, 1.0, 0.01, replica=k) for k in (1, 2, 3)]
    runs.append(run_of(STEP, 1.2, 0.01))
    state = State((case, off), tuple(runs), (), {"drag": 0.05}, 9.0)
    assert left_out(state) == ["more runs of time_step 0.5"]
    assert next_task(state) == Task(off, 2)
    chance = (*runs, run_of(STEP, 0.9, 0.01, replica=2))
    assert next_task(replace(state, runs=chance)) is None
    runs += [run_of(STEP, 1.2, 0.01, replica=k) for k in (2, 3)]
    assert next_task(replace(state, runs=tuple(runs))) is None


def invoke(*words: str) -> Any:
    return CliRunner().invoke(app, ["stress", *words])


class TestRealBreaks:
    def test_tank_breaks_at_a_step_of_its_whole_scale(self, tmp_path: Path, monkeypatch):
        """And not at twice its own; what ended is not run again, whole or broken."""
        monkeypatch.setattr(liftdrag.stress.axes, "STEPS", (0.3, 1.0))
        monkeypatch.setattr(liftdrag.stress.harness, "RUNS", 1)
        case, out = tmp_path / "tiny.toml", tmp_path / "out"
        case.write_text(TINY)
        words = [str(case), "--axes", "time_step", "--out", str(out), "--jobs", "1"]
        said = invoke(*words)
        assert said.exit_code == 0, said.output
        assert "Predicted to break at 0.35" in said.output
        table = pd.read_csv(out / "stability.csv", dtype={"value": str}).set_index("value")
        assert table.status["1"] == "lost_grains"
        assert table.causes["1"] == "lost"
        assert not table.broken["0.3"]
        assert table["largest_overlap (d)"]["0.3"] < table["largest_overlap bound (d)"]["0.3"]
        assert (out / "stability.png").stat().st_size > 10_000
        monkeypatch.setattr(liftdrag.bench.runs, "run", None)
        record = json.loads(invoke(*words, "--json").stdout)
        assert record["left_out"] == []
        assert record["margin"]["largest"] == pytest.approx(0.3, rel=1e-3)
        assert record["margin"]["breaks"] == pytest.approx(1.0, rel=1e-3)
        assert record["points"] == json.loads((out / "stress.json").read_text())["points"]

    def test_shear_flow_breaks_by_its_rate_and_not_by_its_step(self, tmp_path: Path, monkeypatch):
        monkeypatch.setattr(liftdrag.stress.axes, "STEPS", (0.25,))
        monkeypatch.setattr(liftdrag.stress.axes, "SPEEDS", (300.0,))
        monkeypatch.setattr(liftdrag.stress.harness, "RUNS", 1)
        asked = ["time_step", "shear_rate"]
        found = stress(tiny_cell(), None, tmp_path / "out", 300.0, 1, asked)
        assert found.short.tables == tiny_cell().tables
        verdicts = {row["axis"]: row["causes"] for row in found.rows()}
        assert verdicts == {"time_step": "", "shear_rate": "overlap", "seeds": ""}
        assert found.margin is not None
        assert found.margin.breaks is None
        record = json.loads((tmp_path / "out" / "stress.json").read_text())
        assert {"shear_stress deviation", "pressure deviation"} <= record["points"][0].keys()

    def test_plane_breaks_by_speed_and_a_step_is_refused(self, tmp_path: Path, monkeypatch):
        monkeypatch.setattr(liftdrag.stress.axes, "STEPS", (0.1, 1.0))
        monkeypatch.setattr(liftdrag.stress.axes, "SPEEDS", (10.0,))
        monkeypatch.setattr(liftdrag.stress.harness, "RUNS", 1)
        file = tmp_path / "plane.toml"
        file.write_text(PLANE)
        words = [str(file), "--out", str(tmp_path / "out")]
        said = invoke(*words, "--axes", "time_step,speed", "--json")
        assert said.exit_code == 0, said.output
        record = json.loads(said.stdout[said.stdout.index("{") :])
        found = {(one["axis"], one["status"]): one for one in record["points"]}
        assert found["speed", "overlap_exceeded"]["broken"]
        assert not found["time_step", "refused"]["broken"]
        assert "squeezed" in found["time_step", "refused"]["reason"]
        assert record["margin"]["breaks"] is None

    @pytest.mark.parametrize(
        ("words", "says"),
        [
            (["--axes", "width"], "choose from time_step, stiffness"),
            (["--jobs", "0"], "--jobs 0"),
            (["--budget", "soon"], "--budget"),
        ],
    )
    def test_what_cannot_be_is_refused(self, words: list[str], says: str, tmp_path: Path):
        case = tmp_path / "tiny.toml"
        case.write_text(TINY)
        found = invoke(str(case), "--out", str(tmp_path / "out"), *words)
        assert says in str(found.exception)
        assert not (tmp_path / "out").exists()

    def test_folder_of_something_else_is_refused(self, tmp_path: Path):
        (tmp_path / "notes").write_text("mine")
        case = tmp_path / "tiny.toml"
        case.write_text(TINY)
        assert "something else" in str(invoke(str(case), "--out", str(tmp_path)).exception)

    def test_case_that_breaks_by_itself_ends_it(self, tmp_path: Path):
        scale = bounds_of(tiny_tank().scene).scale
        case = tiny_tank(numerics={"time_step": 0.95 * scale})
        with pytest.raises(RunFailed, match="The case itself failed"):
            stress(case, "lammps", tmp_path / "out", 60.0, 1, ["seeds"])
