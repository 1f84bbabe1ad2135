"""What a run is expected to cost: the arithmetic, what is learnt, and what is said before it."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import tiny_tank

from liftdrag import load
from liftdrag.cost import calibration, estimate, foresee, foresight, history, kind, machine, model
from liftdrag.cost.calibration import calibrate
from liftdrag.cost.estimate import Estimate, Times, counted, duration
from liftdrag.cost.foresight import bed_times, beds_times
from liftdrag.cost.history import Learnt, factor, learn, remembered
from liftdrag.cost.kind import Kind
from liftdrag.cost.memory import needed
from liftdrag.cost.work import Work, work_of
from liftdrag.engines import engine
from liftdrag.engines.base import Engine, Outcome
from liftdrag.errors import InputError
from liftdrag.numerics import derive
from liftdrag.progress import reported
from liftdrag.runner import run
from liftdrag.speed.__main__ import main as measure
from liftdrag.speed.growth import Size, tiled

TANK = Kind("here", "lammps", "1", "tank", "granular", ranks=1, cores=1)
TEN = Work(grains=10_000, steps=1000, grain_steps=1e7)
"""Ten million grain-steps, 2.5 s of the model's machine."""

PLANE = Kind("here", "dem", "1", "drag2d", "disc at 0.84", ranks=2, cores=2)
PULL = Work(grains=400, steps=2000, grain_steps=8e5, beds=5)


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A history of its own for each test."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path / "cache" / "liftdrag" / "rates.json"


def ran(seconds: float, work: Work = TEN, share: float = 1.0, **changes: object) -> Learnt:
    return Learnt(replace(TANK, **changes), work, seconds, share)


def test_work_of_a_tank_is_that_of_its_steps_and_of_settling_a_little_longer_than_the_least():
    scene = tiny_tank().scene
    numerics = derive(scene)
    found = work_of(scene, numerics)
    steps = round(1.2 * numerics.settle_steps.value) + numerics.drive_steps.value
    assert (found.grains, found.steps, found.beds) == (scene.grain_count + 16 * 3, steps, 1)
    assert found.grain_steps == found.grains * steps


def test_work_of_a_column_is_that_of_its_fills_and_of_beds_that_of_each():
    piston, plane = load("janssen/quick").scene, load("zhou/c1").scene
    levels = derive(piston).levels
    found = work_of(piston, derive(piston))
    assert found.grain_steps == sum(level.count * (level.end - level.start) for level in levels)
    assert (found.grains, found.steps) == (piston.grain_count, levels[-1].end)
    steps = derive(plane).drive_steps.value
    assert work_of(plane, derive(plane)) == Work(401, steps, 401.0 * steps, beds=5)


def test_a_grain_step_takes_longer_in_larger_beds_and_ranks_share_it():
    assert model.seconds_of(TANK, TEN) == pytest.approx(1e7 * 250e-9)
    million = Work(1_000_000, 10, 1e7)
    largest = dict(model.GROWTH)[1e6]
    assert model.seconds_of(TANK, million) == pytest.approx(2.5 * largest)
    low, high = dict(model.GROWTH)[1e4], dict(model.GROWTH)[1e5]
    assert model.slower(10**4.5) == pytest.approx((low + high) / 2.0)
    assert model.slower(10.0) == model.GROWTH[0][1]
    shared = 1.0 + model.SHARED + model.FEW * 2 / 10_000
    two = replace(TANK, ranks=2, cores=2)
    assert model.expected_s(two, TEN) == pytest.approx(2.5 * shared / 2)
    assert model.expected_s(replace(two, cores=1), TEN) == pytest.approx(2.5)


def test_the_times_of_a_bed_add_up():
    two = replace(TANK, ranks=2, cores=2)
    loop = 3.0 * model.expected_s(two, TEN)
    found = bed_times(two, TEN, slower=3.0, cold=False, packed=False)
    assert found.packing_s == pytest.approx(3.0 * model.PACKING_S["tank"] * 10_000)
    assert found.wall_s == pytest.approx(model.START_S["lammps"] + loop)
    assert found.cpu_s == pytest.approx(2.0 * found.wall_s)
    assert found.rate == pytest.approx(1e7 / loop / 2)
    assert bed_times(two, TEN, 3.0, cold=False, packed=True).packing_s == 0.0
    cold = bed_times(two, TEN, slower=3.0, cold=True, packed=True)
    assert cold.wall_s - found.wall_s == pytest.approx(3.0 * model.COMPILE_S) == cold.compile_s


def test_the_first_of_many_beds_is_grown_alone_and_the_others_side_by_side():
    grown = model.GROWN_S["disc"] * 400
    pulled = 8e5 * 60e-9 * model.slower(400)
    found = beds_times(PLANE, PULL, slower=2.0, cold=False)
    rest = (5 * (grown + pulled) - grown) / 2
    assert found.wall_s == pytest.approx(2.0 * (grown + rest))
    assert found.cpu_s == pytest.approx(2.0 * 5 * (grown + pulled))
    assert (found.cores, found.packing_s) == (2, 0.0)
    assert Learnt(PLANE, PULL, 3.0 * found.cpu_s, 1.0).factor == pytest.approx(6.0)
    alone = beds_times(PLANE, replace(PULL, beds=1), slower=1.0, cold=False)
    assert (alone.wall_s, alone.cores) == (pytest.approx(grown + pulled), 1)
    many = replace(PULL, grains=800)
    assert model.packing_s(PLANE, many) == pytest.approx(grown * 2 ** (1 + model.GROWN_POWER))


def test_the_median_of_the_last_five_runs_counts_and_scales_with_the_grains():
    assert factor(TANK) is None
    for seconds in (500.0, 2.5, 10.0, 5.0, 7.5, 12.5):
        learn(ran(seconds))
    assert len(remembered()) == 5
    assert factor(TANK) == (pytest.approx(3.0), "as in 5 such runs here")
    work = Work(1_000_000, 10, 1e7)
    found = bed_times(TANK, work, factor(TANK)[0], cold=False, packed=True)
    assert found.wall_s == pytest.approx(
        model.START_S["lammps"] + 3.0 * 2.5 * dict(model.GROWTH)[1e6]
    )


def test_runs_that_are_more_alike_count_before_others():
    learn(ran(2.5, machine="elsewhere"))
    assert factor(TANK) is None
    others = [("lmp", "tank", "granular", 1, 5.5), ("lammps", "janssen", "linear", 1, 7.2)]
    others += [("lammps", "tank", "hertz/history", 1, 7.2), ("lammps", "tank", "granular", 2, 15.0)]
    for name, scene, contacts, ranks, seconds in others:
        one = ran(seconds, engine=name, scene=scene, contacts=contacts, ranks=ranks, cores=ranks)
        learn(one)
        assert factor(TANK)[0] == pytest.approx(one.factor)
    assert factor(TANK)[1] == "as in 1 such run here, on other ranks"
    learn(ran(2.5))
    assert factor(TANK) == (pytest.approx(1.0), "as in 1 such run here")


def test_disturbed_ranks_and_ranks_that_took_turns_count_only_without_better_runs():
    two, turns = {"ranks": 2, "cores": 2}, {"ranks": 4, "cores": 2}
    kind = replace(TANK, **two)
    learn(ran(50.0, **turns))
    assert factor(kind) is None
    learn(ran(25.0, share=0.4, **two))
    disturbed = factor(kind)[0]
    assert disturbed == pytest.approx(25.0 / model.expected_s(kind, TEN))
    learn(ran(5.0, share=0.4))
    assert factor(kind) == (pytest.approx(2.0), "as in 1 such run here, on other ranks")
    learn(ran(25.0, share=0.95, **two))
    assert factor(kind) == (pytest.approx(disturbed), "as in 1 such run here")
    assert factor(replace(TANK, **turns))[1] == "as in 1 such run here"


def outcome(loop_s: float, cpu_s: float) -> Outcome:
    return Outcome("finished", "", "", "1", Path(), 2, 1000, 10_000, loop_s, cpu_s)


def test_a_run_that_was_disturbed_is_taken_for_what_it_computed():
    two = replace(TANK, ranks=2, cores=2)
    start = model.START_S["lammps"]
    half = Learnt.of(two, TEN, outcome(loop_s=40.0, cpu_s=30.0 + 2 * start))
    assert (half.seconds, half.share) == (pytest.approx(15.0), pytest.approx(0.375))
    assert Learnt.of(two, TEN, outcome(loop_s=1.0, cpu_s=start)).share == 0.1
    alone = Learnt.of(two, TEN, outcome(loop_s=40.0, cpu_s=82.0))
    assert (alone.seconds, alone.share) == (40.0, 1.0)
    assert Learnt.of(PLANE, PULL, outcome(loop_s=1.0, cpu_s=9.0)).seconds == 9.0


@pytest.mark.parametrize(
    "damage",
    [
        lambda text: text[: len(text) // 2],
        lambda _text: "[]",
        lambda _text: '{"runs": 3}',
        lambda text: text.replace('"seconds": 7.5', '"seconds": "long"'),
        lambda text: text.replace('"seconds": 7.5', '"seconds": NaN'),
        lambda text: text.replace('"seconds": 7.5', '"seconds": Infinity'),
        lambda text: text.replace('"seconds": 7.5', '"seconds": 0.0'),
        lambda text: text.replace('"ranks": 1', '"rank": 1'),
        lambda text: text.replace('"grains": 10000', '"grains": "many"'),
    ],
)
def test_what_is_damaged_is_left_out_and_replaced(cache: Path, damage: Callable[[str], str]):
    learn(ran(7.5))
    cache.write_text(damage(cache.read_text()))
    assert factor(TANK) is None
    learn(ran(5.0))
    assert factor(TANK)[0] == pytest.approx(2.0)
    assert [file.name for file in cache.parent.iterdir()] == ["rates.json"]


def test_where_nothing_can_be_written_nothing_is_remembered(cache: Path):
    cache.parent.parent.write_text("a file where a folder should be")
    learn(ran(7.5))
    assert remembered() == []


def test_short_runs_and_those_that_compiled_teach_nothing():
    times = Times(0.0, 0.0, 1.0, 1.0, 1, 1e6)
    found = Estimate(TANK, TEN, times, "", False, ())
    found.compare(outcome(loop_s=0.4, cpu_s=9.0), 1e7)
    replace(found, times=replace(times, compile_s=30.0)).compare(outcome(9.0, 9.0), 1e7)
    assert remembered() == []
    found.compare(outcome(loop_s=9.0, cpu_s=10.0), 1e7)
    assert remembered() == [Learnt(TANK, TEN, 9.0, 1.0)]


def test_the_estimate_is_said_in_words():
    times = Times(200.0, 0.0, 640.0, 1280.0, 2, 3.14e6)
    found = Estimate(TANK, Work(35_012, 280_400, 1e10), times, "as in 2 such runs here", False, ())
    assert str(found) == (
        "About 14 min on 2 cores: 35 000 grains, 280 000 steps, 3.1 million grain-steps a second "
        "and core, as in 2 such runs here."
    )
    assert str(replace(found, stops=True)).startswith("At most 14 min on 2 cores")
    cold = Estimate(PLANE, PULL, replace(times, compile_s=30.0, cores=1), "a guess", False, ())
    assert "on 1 core: 5 packings of 400 grains, 2 000 steps" in str(cold)
    assert "30 s to compile the engine, once, a guess." in str(cold)
    assert [duration(s) for s in (0.2, 99.4, 100.0, 7200.0, 1e6)] == [
        "1 s", "99 s", "2 min", "2 h", "12 days",
    ]  # fmt: skip
    assert counted(1_234_567) == "1 230 000"


def test_a_run_says_and_keeps_its_estimate_and_learns(
    out: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
):
    monkeypatch.setattr(machine, "MEMINFO", tmp_path / "meminfo")
    machine.MEMINFO.write_text("MemTotal: 9000000 kB\nMemAvailable:   195312 kB\n")
    monkeypatch.setattr(estimate, "SHORT_S", 0.0)
    with reported() as progress:
        result = run(tiny_tank(), out, progress=progress)
    said, record = capsys.readouterr().err, json.loads((out / "result.json").read_text())
    assert said.startswith("About ")
    assert " on 1 core: 656 grains, " in said
    assert f"{foresight.GUESS}.\n" in said
    warning = (
        "Too little memory: this needs about 0.366 GB, 0.2 GB are free; the system may end it."
    )
    assert f"\nWARNING: {warning}\n" in said
    assert warning in record["warnings"]
    assert record["estimate"] == result.record["estimate"]
    assert record["estimate"]["basis"] == foresight.GUESS
    assert min(record["estimate"][name] for name in ("wall_s", "packing_s", "cpu_s")) > 0.0
    (learnt,) = remembered()
    assert learnt.work.grain_steps == record["steps"] * record["grains"]


def test_more_ranks_than_cores_are_warned_of(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
):
    monkeypatch.setattr(kind, "cores", lambda: 2)
    scene = tiny_tank().scene
    found = foresee(scene, derive(scene), engine("lammps"), 3)
    warning = "3 ranks on 2 cores take turns: it is done sooner on 2."
    assert found.warnings == (warning,)
    assert f"WARNING: {warning}" in caplog.messages
    assert (found.kind.ranks, found.times.cores) == (3, 2)
    assert foresee(scene, derive(scene), engine("lammps"), 2).warnings == ()


@pytest.mark.parametrize(
    ("name", "settings"),
    [
        ("zhou/c1", {"ensemble.runs": 3}),
        ("janssen/quick", {"fill.mass": "8 g", "fill.levels": 2, "drive.mobilise": "0.1 d"}),
    ],
)
def test_other_scenes_are_foreseen_and_learnt_from(
    out: Path, name: str, settings: dict[str, object], monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(estimate, "SHORT_S", 0.0)
    case = load(name)
    for key, value in settings.items():
        case = case.set(key, value)
    record = run(case, out, engine="dem").record
    (learnt,) = remembered()
    assert learnt.work == work_of(case.scene, derive(case.scene))
    assert record["estimate"]["wall_s"] > 0.0
    assert 0.0 < learnt.seconds <= record["cpu_s"]


def test_memory_grows_with_grains_and_ranks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    many = replace(TEN, grains=1_010_000)
    assert needed(TANK, many) - needed(TANK, TEN) == pytest.approx(1e6 * 1500.0)
    assert needed(replace(TANK, ranks=3), TEN) - needed(TANK, TEN) == pytest.approx(2 * 115e6)
    monkeypatch.setattr(machine, "MEMINFO", tmp_path / "none")
    assert machine.free_memory() is None
    machine.MEMINFO.write_text("MemAvailable: 5 kB\n")
    assert machine.free_memory() == 5 * 1024


def test_an_engine_that_is_new_here_is_calibrated_for_a_long_run_and_not_for_a_short_one(
    monkeypatch: pytest.MonkeyPatch,
):
    asked = []

    def slow(one: Engine) -> bool:
        asked.append(one.name)
        learn(replace(ran(7.5), kind=replace(found.kind, contacts="granular calibration")))
        return True

    monkeypatch.setattr(foresight, "calibrate", slow)
    scene, chosen = tiny_tank().scene, engine("lammps")
    found = foresee(scene, derive(scene), chosen, 1)
    assert asked == []
    longer = tiny_tank(drive={"distance": "2000 D"}).scene
    again = foresee(longer, derive(longer), chosen, 1)
    assert (asked, again.basis) == (["lammps"], "as in 1 run of this scene here")
    assert foresee(longer, derive(longer), chosen, 1).times == again.times
    assert asked == ["lammps"]


def test_a_calibration_is_a_run_of_the_engine(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(calibration, "STEPS", 200)
    assert calibrate(engine("lammps"))
    (learnt,) = remembered()
    assert (learnt.kind.scene, learnt.kind.contacts) == ("tank", "granular calibration")
    assert learnt.work.grain_steps == learnt.work.grains * learnt.work.steps > 1e5
    assert not calibrate(engine("dem"))


def test_a_longer_tank_is_made_of_copies_side_by_side():
    scene = tiny_tank().scene
    bed = Size(scene, _two_grains(), 0.0)
    found = tiled(bed, 3)
    length = scene.tank.length
    assert found.scene.tank.length == pytest.approx(3 * length)
    assert found.grains == 6
    copies = found.bed.positions.reshape(3, 2, 3) - bed.bed.positions
    np.testing.assert_allclose(copies[:, :, 0], np.repeat([[0], [length], [2 * length]], 2, 1))
    assert not copies[:, :, 1:].any()
    assert found.bed.types.tolist() == [1, 2] * 3


def _two_grains():
    from liftdrag.deck.tank import Bed

    return Bed(np.array([[0.1, 0.2, 0.3], [0.4, 0.5, 0.6]]), np.array([1, 2]))


def test_a_measurement_that_there_is_not_is_refused(capsys: pytest.CaptureFixture[str]):
    assert measure(["growth", "speed"]) == 2
    assert capsys.readouterr().err.startswith("There is no measurement 'speed'; choose from ")


def test_the_packages_are_installed_with_the_rest():
    root = Path(__file__).parents[1]
    listed = tomllib.loads((root / "pyproject.toml").read_text())["tool"]["setuptools"]["packages"]
    assert {"liftdrag.cost", "liftdrag.speed"} <= set(listed)
    assert history.LAST == 5


@pytest.mark.parametrize("name", ["quick", "janssen/quick"])
def test_a_folder_in_use_is_refused_before_the_cost_is_said(name, tmp_path, caplog):
    (tmp_path / "mine").touch()
    caplog.set_level("INFO")
    with pytest.raises(InputError, match="not an empty folder"):
        run(load(name), tmp_path)
    assert not caplog.messages
