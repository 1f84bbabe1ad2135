"""The average of a fill ends when its load is known: the rule, the decks, and each engine."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import replace
from difflib import ndiff
from itertools import accumulate
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter
from test_janssen_answers import STEP, found_of, make_fills, make_scene, make_series
from test_janssen_scene import scene_of, tiny

from liftdrag.analysis import janssen_stop
from liftdrag.analysis.janssen_curve import curve_points
from liftdrag.analysis.janssen_stop import LEAST_WAY, FillStopping, load
from liftdrag.case import Case
from liftdrag.deck import Plan
from liftdrag.deck.column import START
from liftdrag.deck.commands import check_commands
from liftdrag.deck.dialect import DIALECTS, IN_HOUSE, LIGGGHTS, Dialect
from liftdrag.engines import engine, stopper
from liftdrag.engines.base import Enough, Outcome, silent
from liftdrag.engines.fills import read_fills
from liftdrag.errors import CaseError
from liftdrag.granular import GRAVITY
from liftdrag.piston import prepare
from liftdrag.runner import analyze, run
from liftdrag.scene import JanssenScene
from liftdrag.series import Series

STOP = {"quantity": "apparent_mass", "relative_error": 0.02}
FAMILY = ("lammps", "lmp", "liggghts")
each_engine = pytest.mark.parametrize("name", ["dem", *FAMILY])
on_each = pytest.mark.parametrize("name", FAMILY)
each_dialect = pytest.mark.parametrize("dialect", DIALECTS, ids=lambda dialect: dialect.name)

ROW = 0.1
"""Way between two rows, in d, of the synthetic series."""


def stoppable(distance: str) -> JanssenScene:
    return scene_of(drive={"distance": distance}, stop=STOP)


def shaking(
    rng: np.random.Generator, rows: int, slow: float = 0.04, memory: float = 0.37
) -> Series:
    """A load of 1 N that forgets itself, to 4 %, over a way of `memory` d, and shakes by 2 %."""
    tau = memory / ROW
    phi = (tau - 1.0) / (tau + 1.0)
    noise = lfilter([np.sqrt(1.0 - phi**2)], [1.0, -phi], rng.standard_normal(rows + 100))[100:]
    values = 1.0 + slow * noise + 0.02 * rng.standard_normal(rows)
    interval = ROW * 3e-3 / 0.02
    return Series(interval * np.arange(1.0, rows + 1.0), {"piston": values}, {"piston": "N"})


def end_of(rule: Enough, series: Series) -> int:
    """Rows after which the rule has enough, zero where it never has."""
    return next((n for n in range(10, len(series) + 1, 10) if rule(series.first(n))), 0)


def test_rule_covers_the_load_that_remembers_its_packing():
    """Averages that end early hold the truth in their interval in 90 of 100; none is short."""
    rng, hits, ends = np.random.default_rng(1), 0, list[int]()
    scene = stoppable("40 d")
    for _ in range(200):
        series = shaking(rng, 400)
        if end := end_of(FillStopping(scene), series):
            low, high = load(series.first(end))["apparent_mass"].interval_95
            hits += low < 1.0 / GRAVITY < high
            ends.append(end)
    assert len(ends) > 150
    assert hits / len(ends) > 0.9
    assert min(ends) * ROW >= LEAST_WAY
    assert np.median(ends) * ROW < 20.0


def test_rule_begins_anew_with_each_fill():
    """A fill that is known says nothing of the next one, which may never be."""
    rng = np.random.default_rng(2)
    first, second = shaking(rng, 400, slow=0.01), shaking(rng, 400, slow=0.3, memory=3.0)
    later = replace(second, time=second.time + 1e3)
    rule = FillStopping(stoppable("40 d"))
    end = end_of(rule, first)
    assert 0 < end < 400
    assert not rule(later.first(end))
    assert end_of(rule, later) == end_of(FillStopping(stoppable("40 d")), second) == 0


def test_rule_sees_the_load_that_the_curve_will_hold():
    scene = make_scene()
    series, fills = make_series(scene, noise=0.02), make_fills(scene)
    for fill, point in zip(fills, curve_points(scene, series, fills), strict=True):
        inside = slice(round(fill.begin / STEP), round(fill.end / STEP))
        channels = {name: values[inside] for name, values in series.channels.items()}
        found = load(Series(series.time[inside], channels, series.units))["apparent_mass"]
        assert found.mean == pytest.approx(point.apparent_mass.mean)
        assert found.standard_error == pytest.approx(point.apparent_mass.standard_error)
        assert found.correlation_time == pytest.approx(point.apparent_mass.correlation_time)


def test_column_at_rest_has_no_way_to_wait_for():
    rest = {"motion": "none", "speed": None, "distance": None, "mobilise": None, "duration": 0.02}
    series = shaking(np.random.default_rng(3), 60, slow=0.0)
    assert end_of(FillStopping(scene_of(drive=rest, stop=STOP)), series) == 30
    assert end_of(FillStopping(stoppable("40 d")), series) == 0


def test_fills_that_miss_their_target_are_named():
    """Those whose errors are too large; none without a stop; all where the way is too short."""
    tight = {"quantity": "apparent_mass", "absolute_error": 1e-4}
    long = {"drive": {"distance": 0.03}}
    scene = make_scene(stop=tight, **long)
    found = found_of(scene, noise=0.02)
    errors = [point.apparent_mass.standard_error for point in found.curve]
    short = [str(k) for k, error in enumerate(errors, start=1) if error > 1e-4]
    (said,) = [text for text in found.warnings if "[stop]" in text]
    assert 0 < len(short) < len(errors)
    assert f"fills {', '.join(short)} of 8" in said
    assert f"{max(errors):.3g} kg; raise drive.distance" in said
    assert not any("[stop]" in text for text in found_of(make_scene(**long)).warnings)
    (said,) = [text for text in found_of(make_scene(stop=tight)).warnings if "[stop]" in text]
    assert "no effect" in said
    assert "drive.distance is 1 d" in said


def test_fit_cannot_be_watched():
    with pytest.raises(CaseError, match=r"stop.quantity = 'saturation_mass'.*apparent_mass"):
        scene_of(stop=STOP | {"quantity": "saturation_mass"})


def texts_of(dialect: Dialect, **tables: object) -> dict[str, str]:
    return dict(prepare(tiny(**tables), dialect)[1].texts)


@each_dialect
def test_stop_changes_nothing_but_the_averages(dialect: Dialect):
    """Each `run` of an average is another, and the steps of a fill are not promised."""
    plain, watched = texts_of(dialect), texts_of(dialect, stop=STOP)
    files = [f"stop-{k}.lmp" for k in (1, 2, 3)] if dialect is LIGGGHTS else []
    assert sorted(watched.keys() - plain.keys()) == files
    assert plain["column.data"] == watched["column.data"]
    lines = ndiff(plain["in.janssen"].splitlines(), watched["in.janssen"].splitlines())
    gone = [line[2:] for line in lines if line.startswith("- ")]
    assert [line.split()[0] for line in gone] == ["#", "run"] * 3
    assert all(line.endswith("# averaged") for line in gone[1::2])
    assert not re.search("halt|STOP|stop-|LIFTDRAG FILL", plain["in.janssen"])


def test_deck_in_house_is_the_same_with_a_stop():
    assert texts_of(IN_HOUSE) == texts_of(IN_HOUSE, stop=STOP)


@pytest.mark.parametrize(
    "line",
    [
        "include stop-1.lmp.sh",
        "include ../stop-1.lmp",
        "include stop-x.lmp",
        "include stop-1.lmp stop-2.lmp",
        "next piece_1 piece_2",
        "jump in.evil average_1",
        "jump SELF average_1 more",
    ],
)
def test_piece_of_a_fill_is_allowed_to_the_letter(line: str):
    check_commands("include stop-12.lmp\nnext piece_12\njump SELF average_12\n", START)
    with pytest.raises(ValueError, match="which is not allowed"):
        check_commands(line, START)


@pytest.fixture
def eager(monkeypatch: pytest.MonkeyPatch) -> None:
    """Look at the series whenever there is a chance."""
    monkeypatch.setattr(stopper, "LEAST_S", 0.0)
    monkeypatch.setattr(stopper, "MOST_S", 0.0)


class Watch:
    """Has enough at so many rows; keeps the time of the first row and the number of rows seen."""

    def __init__(self, rows: int):
        self.rows, self.seen = rows, dict[float, int]()

    def __call__(self, series: Series) -> bool:
        self.seen[series.time[0]] = len(series)
        return len(series) >= self.rows


def in_two_fills(distance: str, settle: str = "20 ms") -> Case:
    """The tiny column, laid on in haste unless it may settle."""
    return tiny(
        fill={"levels": 2},
        drive={"distance": distance},
        stop=STOP | {"relative_error": 0.05},
        numerics={"settle_time": settle},
    )


def carried_out(
    name: str,
    folder: Path,
    enough: Enough | None = None,
    distance: str = "0.2 d",
    change: Callable[[str], str] = str,
) -> tuple[Plan, Outcome]:
    """The tiny column in two fills that may end early, its deck changed."""
    chosen = engine(name)
    _, deck = prepare(in_two_fills(distance), chosen.dialect)
    deck.write(folder)
    start = folder / deck.plan.start
    start.write_text(change(start.read_text()))
    return deck.plan, chosen.run(deck.plan, folder, silent, enough=enough)


def boundaries(folder: Path) -> set[int]:
    """The steps at which the runs of a deck ended, by the loops of the log."""
    log = next(folder.glob("log.*")).read_text()
    return set(accumulate(int(n) for n in re.findall(r"Loop time of .* for (\d+) steps", log)))


@each_engine
@pytest.mark.usefixtures("eager")
def test_windows_are_what_the_engine_did(name: str, tmp_path: Path):
    """Fills end early at whole blocks, each as long after its start as planned."""
    watch = Watch(45)
    plan, outcome = carried_out(name, tmp_path, watch, "6 d")
    assert (outcome.status, outcome.stopped_by) == ("finished", "precision"), outcome.evidence
    fills, block = read_fills(tmp_path), 10 * plan.row_every
    now = 0
    for (count, start, mobilised, end), was in zip(plan.fills, fills, strict=True):
        assert was[:3] == (count, now, now + mobilised - start)
        assert 45 * plan.row_every < was[3] - was[2] < end - mobilised
        assert was[3] % block == 0
        now = was[3]
    assert outcome.steps == now < plan.stages["drive"]
    firsts = [(was[2] + plan.row_every) * plan.time_step for was in fills]
    assert list(watch.seen) == pytest.approx(firsts)
    assert len(engine(name).series(plan, tmp_path)) == now // plan.row_every
    profiles = list(engine(name).profiles(plan, tmp_path))
    assert profiles[-1].time == pytest.approx(now * plan.time_step)
    if name in FAMILY:
        assert boundaries(tmp_path) >= {step for was in fills for step in was[2:]}


@on_each
def test_fill_of_a_run_that_never_has_enough_is_as_planned(name: str, tmp_path: Path):
    plan, outcome = carried_out(name, tmp_path, lambda _: False)
    assert (outcome.status, outcome.stopped_by) == ("finished", "distance")
    assert read_fills(tmp_path) == list(plan.fills)


def test_column_is_the_same_until_its_first_fill_ends(tmp_path: Path):
    chosen, series = engine("dem"), list[Series]()
    for folder, enough in ((tmp_path / "early", Watch(60)), (tmp_path / "whole", None)):
        plan, outcome = carried_out("dem", folder, enough)
        series.append(chosen.series(plan, folder))
        assert (outcome.stopped_by == "distance") == (enough is None)
    rows = slice(0, read_fills(tmp_path / "early")[0][3] // plan.row_every)
    early, whole = (found["piston"] for found in series)
    assert (early[rows] == whole[rows]).all()
    assert rows.stop * plan.row_every == plan.fills[0][2] + 60 * plan.row_every
    assert abs(whole[: len(early)] - early).max() > 0.0


def test_file_of_a_user_ends_one_fill(tmp_path: Path):
    (tmp_path / "STOP-2").touch()
    plan, outcome = carried_out("lammps", tmp_path)
    assert (outcome.status, outcome.stopped_by) == ("finished", "distance")
    first, (_, start, mobilised, end) = read_fills(tmp_path)
    assert first == plan.fills[0]
    assert (start, end - mobilised) == (first[3], 10 * plan.row_every)
    (tmp_path / "STOP-1").touch()
    assert carried_out("lammps", tmp_path)[1].stopped_by == "request"


def test_fill_that_ends_early_without_its_file_is_no_finished_run(tmp_path: Path):
    (tmp_path / "STOP-1").touch()
    gone = 'shell        rm STOP-1\nprint        "LIFTDRAG FILL 1'
    _, outcome = carried_out(
        "lammps",
        tmp_path,
        change=lambda deck: deck.replace('print        "LIFTDRAG FILL 1', gone),
    )
    assert outcome.status == "engine_error"
    assert "ended at step" in outcome.reason


def test_answers_are_of_the_fills_as_they_were(monkeypatch: pytest.MonkeyPatch, out: Path):
    """Those of the run, and those of `analyze`."""
    monkeypatch.setattr(janssen_stop, "LEAST_WAY", 0.0)
    found = run(in_two_fills("0.5 d", "60 ms"), out, "dem")
    plan = json.loads((out / "run.json").read_text())["plan"]
    fills = read_fills(out)
    assert found.record["stopped_by"] == "precision"
    assert [tuple(fill) for fill in plan["fills"]] == fills
    assert plan["stages"] == {"drive": found.record["steps"]} == {"drive": fills[-1][3]}
    rows = slice(fills[-1][2] // plan["row_every"], fills[-1][3] // plan["row_every"])
    weighed = found.quantities["apparent_mass"]
    assert weighed.mean == pytest.approx(found.series["piston"][rows].mean() / GRAVITY)
    assert weighed.standard_error <= 0.05 * weighed.mean
    assert analyze(out).quantities == found.quantities
