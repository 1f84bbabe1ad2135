"""What the live table says: how long a study will still take, and what its runs answer so far."""

from __future__ import annotations

import logging
import math
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from conftest import tiny_tank

from liftdrag.analysis.quantity import Quantity
from liftdrag.analysis.tank import forces
from liftdrag.case import load
from liftdrag.cost import foresee
from liftdrag.engines import engine
from liftdrag.numerics import derive
from liftdrag.result import Result
from liftdrag.scene import TankScene
from liftdrag.study import early, forecast
from liftdrag.study.early import Early, so_far
from liftdrag.study.forecast import Forecast, foreseen_s
from liftdrag.study.pool import Row, View
from liftdrag.study.tasks import Task
from liftdrag.sweeping import table

TASKS = {name: Task(name, tiny_tank(), "lammps") for name in "abcdef"}


@pytest.fixture
def costs(monkeypatch: pytest.MonkeyPatch) -> dict[str, float | None]:
    """The foreseen seconds by name, which a test may change; b takes ten times the others."""
    found: dict[str, float | None] = dict.fromkeys(TASKS, 100.0) | {"b": 1000.0}
    monkeypatch.setattr(forecast, "foreseen_s", lambda task, _ranks: found[task.name])
    return found


def going(name: str, went_s: float, stage_left_s: float | None = None) -> Row:
    return Row(name, "drive", 0.5, stage_left_s, TASKS[name], went_s)


def view(rows: list[Row], waiting: str = "", took: dict[str, float] | None = None) -> View:
    ended = [(TASKS[name], seconds) for name, seconds in (took or {}).items()]
    many = len(rows) + len(waiting) + len(ended)
    return View(rows, len(ended), many, [TASKS[name] for name in waiting], ended, 2)


@pytest.mark.parametrize(
    ("rows", "waiting", "took", "expected"),
    [
        ([], "", {}, 0.0),
        ([going("a", 30.0)], "", {}, 70.0),
        ([going("a", 30.0), going("c", 50.0)], "de", {}, (70.0 + 50.0 + 200.0) / 2),
        ([going("a", 30.0)], "bc", {}, 1000.0),
        ([going("a", 30.0)], "c", {"d": 150.0, "e": 250.0}, 200.0),
        ([going("a", 130.0, 25.0)], "", {}, 25.0),
        ([going("a", 30.0), Row("x", "elsewhere", None, None)], "", {}, 70.0),
    ],
)
@pytest.mark.usefixtures("costs")
def test_time_left_is_that_of_the_sum_by_hand(rows, waiting, took, expected):
    assert Forecast().left_s(view(rows, waiting, took)) == pytest.approx(expected)


def test_nothing_is_said_while_any_cost_is_unknown(costs: dict[str, float | None]):
    """The run itself then has the time left of its stage."""
    costs["a"] = None
    found = Forecast()
    assert found.left_s(view([going("a", 30.0, 12.0)], "c")) is None
    assert found.run_left_s(going("a", 30.0, 12.0), view([])) == 12.0


def test_costs_are_foreseen_once_and_a_few_at_a_time(monkeypatch: pytest.MonkeyPatch):
    asked = list[str]()

    def foreseen(task: Task, _ranks: int) -> float:
        asked.append(task.name)
        return 100.0

    monkeypatch.setattr(forecast, "foreseen_s", foreseen)
    monkeypatch.setattr(forecast, "PATIENCE_S", -1.0)
    found, pool = Forecast(), view([], "abcdef")
    assert found.left_s(pool) is None
    monkeypatch.setattr(forecast, "PATIENCE_S", 60.0)
    assert [found.left_s(pool), found.left_s(pool)] == [300.0, 300.0]
    assert asked == list("abcdef")


def test_cost_of_a_task_is_that_which_its_run_foresees(caplog: pytest.LogCaptureFixture):
    """And nothing is said of it."""
    scene = tiny_tank().scene
    with caplog.at_level(logging.INFO):
        seconds = foreseen_s(TASKS["a"], 1)
    assert caplog.text == ""
    times = foresee(scene, derive(scene), engine("lammps"), 1).times
    assert seconds == pytest.approx(times.packing_s + times.wall_s)
    assert foreseen_s(Task("x", tiny_tank().set("seed", -1), "lammps"), 1) is None


def test_answer_so_far_is_that_of_the_series_so_far(
    result_of: Callable[[str], Result], tmp_path: Path
):
    """Of a run cut in the middle of a row, that row is left out; of a dead or young one, none."""
    whole = result_of("free surface")
    folder = shutil.copytree(whole.folder, tmp_path / "run")
    task = Task("a", tiny_tank(), "lammps")
    assert so_far(task, folder)["drag"].mean == pytest.approx(whole.quantities["drag"].mean, 0.02)
    rows = (folder / "forces.dat").read_text().splitlines(keepends=True)
    half = len(rows) * 3 // 4
    (folder / "forces.dat").write_text("".join(rows[:half]) + rows[half][:9])
    kept = half - sum(row.startswith("#") for row in rows) - 1
    scene = task.case.scene
    assert isinstance(scene, TankScene)
    assert so_far(task, folder) == forces(scene, whole.series.first(kept))
    (folder / "forces.dat").write_text("".join(rows[:5]))
    assert so_far(task, folder) == {}
    assert so_far(task, tmp_path / "none") == {}
    assert so_far(Task("s", load("shear/quick"), "dem"), folder) == {}


def test_runs_are_looked_at_in_turn(monkeypatch: pytest.MonkeyPatch):
    asked = list[str]()

    def so_far(task: Task, _folder: Path) -> dict[str, Quantity]:
        asked.append(task.name)
        return {}

    monkeypatch.setattr(early, "so_far", so_far)
    found, pool = Early(), view([going(name, 1.0) for name in "abc"])
    found.look(pool)
    assert asked == []
    monkeypatch.setattr(early, "LEAST_S", 0.0)
    monkeypatch.setattr(early, "SHARE", math.inf)
    found = Early()
    for _ in range(4):
        found.look(pool)
    found.look(view([going("c", 1.0)]))
    assert asked == [*"abca", "c"]
    assert list(found.answers) == ["c"]


@pytest.mark.usefixtures("costs")
def test_live_table_has_a_row_for_each_run_that_goes_on(tmp_path: Path):
    from rich.console import Console

    rows = [going("a", 10.0), Row("b", "starting", None, None, TASKS["b"], 1.0)]
    with (tmp_path / "said").open("w") as file:
        found = Early()
        found.answers["a"] = {
            "drag": Quantity(1.234, 0.056, "N", 1.0, 30.0, True),
            "lift": Quantity(0.1234, 0.1, "N", 1.0, 3.0, False),
        }
        shown = table(view(rows, "c", {"d": 100.0}), Forecast(), found)
        Console(file=file, width=100).print(shown)
    said = (tmp_path / "said").read_text()
    assert "50 %" in said
    assert "90 s" in said
    assert "drag 1.234 ± 0.056 N, lift ~ 0.12 N" in said
    assert "1 of 4 have ended, about 17 min left" in said
