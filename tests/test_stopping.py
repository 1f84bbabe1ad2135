"""A run ends when its answer is good enough: the rule, its coverage, and each engine."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from conftest import tiny_tank
from scipy.signal import lfilter

from liftdrag.analysis import stopping
from liftdrag.analysis.drag2d import ensemble_mean
from liftdrag.analysis.errorbars import average
from liftdrag.analysis.quantity import Quantity
from liftdrag.analysis.steady import steady_window
from liftdrag.analysis.stopping import EnsembleStopping, Stopping, missed
from liftdrag.case import load
from liftdrag.deck.dialect import Dialect
from liftdrag.engines import engine, stopper
from liftdrag.engines.base import silent
from liftdrag.errors import CaseError, InputError, SeriesTooShort
from liftdrag.runner import analyze, run
from liftdrag.scene.stop import Stop, Target
from liftdrag.series import Series
from liftdrag.tank import prepare

FIVE_PERCENT = {"drag": Target(0.05, 0.0)}
LENGTH = 8000


def series_of(values: np.ndarray) -> Series:
    return Series(np.arange(1.0, len(values) + 1.0), {"drag": values}, {"drag": "N"})


def estimate(series: Series) -> dict[str, Quantity]:
    """The steady mean, as the answers of a tank make it."""
    try:
        window = steady_window(series["drag"], 0)
        return {"drag": Quantity.of(average(series["drag"][window.start :], 1.0), "N")}
    except SeriesTooShort as error:
        raise InputError(str(error)) from None


def filtered(noise: np.ndarray, *past: float) -> np.ndarray:
    """Unit deviation, the first samples left out."""
    values = lfilter([1.0], [1.0, *past], noise, axis=-1)[500:]
    return values / values.std()


def ar1(rng):
    return filtered(rng.standard_normal(LENGTH + 500), -0.8)


KINDS = {
    "AR(1)": ar1,
    "AR(2)": lambda rng: filtered(rng.standard_normal(LENGTH + 500), -1.5, 0.7),
    "drift": lambda rng: ar1(rng) + 2.0 * np.exp(-np.arange(LENGTH) / 60.0),
    "heavy": lambda rng: filtered(rng.standard_t(3, LENGTH + 500), -0.8),
}


def stopped(values: np.ndarray) -> Quantity:
    """What a run of this series answers that was stopped at 5 %."""
    whole, rule = series_of(values), Stopping(FIVE_PERCENT, estimate)
    while not rule(whole.first(rule.look_at)):
        end = rule.look_at
        assert end <= LENGTH, "the series is too short to be stopped"
    return estimate(whole.first(end))["drag"]


def coverage(kind: str, count: int) -> float:
    """The share of stopped series of mean 1 whose 95 % interval holds it."""
    rng = np.random.default_rng(11)
    found = [stopped(1.0 + 0.42 * KINDS[kind](rng)).interval_95 for _ in range(count)]
    return float(np.mean([low < 1.0 < high for low, high in found]))


@pytest.mark.parametrize("kind", KINDS)
def test_stated_interval_holds_the_truth_in_a_hundred_stopped_series(kind):
    assert 0.90 <= coverage(kind, 100) <= 1.0


@pytest.mark.validate
@pytest.mark.parametrize("kind", KINDS)
def test_stated_interval_holds_the_truth_in_95_of_100_stopped_series(kind, capsys):
    share = coverage(kind, 400)
    with capsys.disabled():
        print(f"\n{kind}: {100 * share:.1f} % of 400 stopped series")
    assert 0.92 <= share <= 0.98


def test_interval_is_students_for_packings_and_normal_without_samples():
    assert ensemble_mean(np.arange(5.0), "N").interval_95 == pytest.approx(
        (0.036757, 3.963243), 1e-4
    )
    assert Quantity(1.0, 0.1, "N", None, None, True).interval_95 == pytest.approx(
        (0.804, 1.196), abs=1e-5
    )


def quantity(error: float, independent: float) -> Quantity:
    return Quantity(1.0, error, "N", 1.0, independent, True)


@pytest.mark.parametrize(
    ("error", "samples_per_independent", "ends"),
    [(0.049, 1.0, 1), (0.051, 1.0, 0), (0.049, 1e3, 0)],
)
def test_ends_only_at_its_target_and_after_enough_correlation_times(
    error, samples_per_independent, ends
):
    rule = Stopping(
        FIVE_PERCENT, lambda s: {"drag": quantity(error, len(s) / samples_per_independent)}
    )
    assert rule(series_of(np.ones(LENGTH))) is bool(ends)


def test_a_lucky_look_is_not_confirmed():
    """Good at one look in two: never three in a row."""
    looks = []

    def flaky(series):
        looks.append(len(series))
        return {"drag": quantity(0.01 if len(looks) % 3 else 1.0, 1e4)}

    assert not Stopping(FIVE_PERCENT, flaky)(series_of(np.ones(LENGTH)))
    assert looks[0] == stopping.FIRST_LOOK
    assert np.allclose(np.diff(looks), 0.1 * np.array(looks[:-1]), atol=1.0)


def test_decision_is_that_of_the_series_however_often_it_is_looked_at():
    values = 1.0 + 0.42 * ar1(np.random.default_rng(5))
    whole, rule = series_of(values), Stopping(FIVE_PERCENT, estimate)
    once = Stopping(FIVE_PERCENT, estimate)
    assert once(whole)
    ends = next(n for n in range(37, LENGTH, 37) if rule(whole.first(n)))
    assert once.look_at == rule.look_at
    assert ends >= rule.look_at / 1.1 - 1


def test_absolute_error_serves_a_lift_of_zero():
    found = {"lift": Quantity(0.0, 0.02, "N", 1.0, 500.0, True)}
    assert stopping.reached({"lift": Target(0.1, 0.03)}, found)
    assert not stopping.reached({"lift": Target(0.1, 0.0)}, found)
    (sentence,) = missed({"lift": Target(0.1, 0.01)}, found, "drive.distance")
    assert "0.02 N" in sentence
    assert "drive.distance" in sentence


def test_ensemble_counts_packings_in_order_and_covers():
    rng = np.random.default_rng(4)
    hits = 0
    for _ in range(300):
        values = 1.0 + 0.11 * rng.standard_normal(200)
        rule = EnsembleStopping(
            {"drag": Target(0.03, 0.0)}, lambda n, v=values: {"drag": ensemble_mean(v[:n], "N")}
        )
        count = next(n for n in map(rule, range(2, 200)) if n)
        assert count >= stopping.LEAST_PACKINGS + stopping.CONFIRMATIONS
        low, high = ensemble_mean(values[:count], "N").interval_95
        hits += low < 1.0 < high
    assert 0.92 <= hits / 300 <= 0.98


@pytest.mark.parametrize(
    ("table", "says"),
    [
        ({"quantity": "darg", "relative_error": 0.1}, "stop.quantity = 'darg'"),
        ({"quantity": ["drag", "lift"]}, "how well the drag must be known"),
        ({"quantity": [], "relative_error": 0.1}, "stop.quantity"),
        ({"relative_error": {"lift": 0.1}}, "stop.relative_error = 'lift'"),
        ({"relative_error": -1.0}, "stop.relative_error = -1: this should be a positive number"),
        ({"relative_error": float("nan")}, "stop.relative_error = nan: this should be a positive"),
        ({"quantity": 3, "relative_error": 0.1}, "stop.quantity = 3: this should be the name"),
        ({"quantity": "drag", "until": 3}, "stop.until"),
    ],
)
def test_bad_stop_is_refused_by_its_key(table, says):
    with pytest.raises(InputError) as caught:
        _ = load("quick").set("stop", table).scene
    assert says in str(caught.value)
    assert len(str(caught.value).splitlines()) == 1


def test_errors_of_several_quantities_are_one_number_or_a_table():
    stop = Stop(quantity=["drag", "lift"], relative_error=0.1, absolute_error={"lift": 0.01})
    known = ("drag", "lift")
    assert stop.targets(known) == {"drag": Target(0.1, 0.0), "lift": Target(0.1, 0.01)}
    assert Stop(relative_error=0.2).targets(known) == {"drag": Target(0.2, 0.0)}
    with pytest.raises(CaseError, match="choose one of apparent_mass"):
        _ = load("janssen/quick").set("stop", {"quantity": "drag", "relative_error": 0.1}).scene


STOPPABLE = {"quantity": "drag", "relative_error": 0.1}
ENGINES = [
    pytest.param(name, marks=[pytest.mark.needs(name)] if name != "lammps" else [])
    for name in ("lammps", "lmp", "liggghts")
]


def deck_in(folder: Path, dialect: Dialect, **tables: object):
    _, deck = prepare(tiny_tank(**tables), dialect=dialect)
    deck.write(folder)
    return deck.plan


@pytest.mark.parametrize("name", ENGINES)
def test_engine_ends_cleanly_when_there_is_enough(name, tmp_path):
    chosen = engine(name)
    plan = deck_in(tmp_path, chosen.dialect, stop=STOPPABLE, drive={"distance": "80 D"})
    outcome = chosen.run(plan, tmp_path, silent, enough=lambda series: len(series) >= 20)
    assert (outcome.status, outcome.stopped_by) == ("finished", "precision"), outcome.evidence
    rows = len(chosen.series(plan, tmp_path))
    assert 20 < rows < plan.stages["drive"] // plan.row_every


@pytest.mark.parametrize("name", ENGINES[2:])
def test_stoppable_run_that_never_has_enough_is_the_same_run(name, tmp_path):
    chosen, found = engine(name), []
    for folder, tables in ((tmp_path / "whole", {}), (tmp_path / "never", {"stop": STOPPABLE})):
        plan = deck_in(folder, chosen.dialect, **tables)
        outcome = chosen.run(plan, folder, silent, enough=lambda _: False)
        assert (outcome.status, outcome.stopped_by) == ("finished", "distance")
        found.append(chosen.series(plan, folder))
    whole, never = found
    assert len(whole) == len(never)
    assert whole["drag"][:10] == pytest.approx(never["drag"][:10], rel=1e-6)


def test_file_of_a_user_ends_a_stoppable_run_by_request_only(tmp_path):
    chosen = engine("lammps")
    for folder, tables, expected in (
        (tmp_path / "stop", {"stop": STOPPABLE}, ("finished", "request")),
        (tmp_path / "none", {}, ("finished", "distance")),
    ):
        plan = deck_in(folder, chosen.dialect, **tables)
        (folder / "STOP").touch()
        outcome = chosen.run(plan, folder, silent)
        assert (outcome.status, outcome.stopped_by) == expected


def test_early_end_without_its_file_is_no_finished_run(tmp_path):
    chosen = engine("lammps")
    plan = deck_in(tmp_path, chosen.dialect, stop=STOPPABLE)
    (tmp_path / "STOP").touch()
    deck = tmp_path / plan.start
    deck.write_text(
        deck.read_text().replace(
            'print        "LIFTDRAG FINISHED', 'shell rm STOP\nprint        "LIFTDRAG FINISHED'
        )
    )
    outcome = chosen.run(plan, tmp_path, silent)
    assert outcome.status == "engine_error"
    assert "ended at step" in outcome.reason


def test_run_answers_from_what_it_has_and_says_what_stopped_it(monkeypatch, out):
    monkeypatch.setattr(stopping, "LEAST_INDEPENDENT", 2)
    monkeypatch.setattr(stopper, "MOST_S", 0.2)
    monkeypatch.setattr("liftdrag.tank.Stopping", lambda *given: Stopping(*given, look_at=45))
    case = tiny_tank(
        stop={"quantity": ["drag", "drag_coefficient"], "relative_error": 2.0},
        drive={"distance": "80 D"},
    )
    found = run(case, out)
    assert found.record["stopped_by"] == "precision"
    again = analyze(out)
    assert again.quantities["drag"] == found.quantities["drag"]
    low, high = json.loads((out / "result.json").read_text())["quantities"]["drag"]["interval_95"]
    assert low < found.quantities["drag"].mean < high


def test_whole_run_that_misses_its_target_says_so(out):
    found = run(tiny_tank(stop={"quantity": "lift", "relative_error": 1e-6}), out)
    assert found.record["stopped_by"] == "distance"
    assert any("lift is not known as well as [stop] asks" in text for text in found.warnings)


def test_ensemble_ends_after_the_packings_that_its_rule_asks_for(out):
    """Two at a time, so that more may have run; those in order are counted and averaged."""
    case = load("zhou/c1").set("ensemble.runs", 15).set("drive.distance", "0.6 mm")
    case = case.set("stop", {"relative_error": 0.4}).set("drive.average_from", "0.2 mm")
    found = run(case, out, ranks=2)
    drags = pd.read_csv(out / "packings.csv")["drag (N)"].to_numpy()
    rule = EnsembleStopping(case.scene.targets, lambda n: {"drag": ensemble_mean(drags[:n], "N")})
    assert found.record["stopped_by"] == "precision"
    assert found.record["packings"] == len(drags) == rule(len(drags)) < 15
    assert found.quantities["drag"].mean == pytest.approx(drags.mean())
    assert analyze(out).quantities["drag"] == found.quantities["drag"]
