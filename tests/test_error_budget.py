"""What an error is made of: statistics, measured biases, and what nobody has measured."""

from __future__ import annotations

import json

import pytest
from conftest import tiny_tank

from liftdrag.analysis.biases import BENCH, Bias, Biases
from liftdrag.analysis.error_budget import AXES, JUDGED_AS, differences, error_budgets
from liftdrag.analysis.quantity import Quantity
from liftdrag.bench.axes import axes_of
from liftdrag.case import Case, load
from liftdrag.cli import app
from liftdrag.errors import InputError
from liftdrag.runner import analyze, run

TABLES = load("quick").tables
STEP = Bias(0.01, 0.02, 1.4e-5, 1e-6)


def biases_of(case: Case) -> Biases:
    return Biases("quick", "lammps", case.tables, {"drag_coefficient": {"time_step": STEP}})


def test_bias_of_the_coefficient_is_that_of_the_force_and_the_rest_is_not_measured():
    drag = Quantity(-2.0, 0.1, "N", 1.0, 50.0, True)
    found = error_budgets("tank", {"drag": drag, "depth": drag}, biases_of(load("quick")))
    assert list(found) == ["drag"]
    assert found["drag"].statistical == pytest.approx(0.05)
    assert found["drag"].biases == {"time_step": STEP}
    assert found["drag"].not_measured == AXES["tank"][1:]


@pytest.mark.parametrize("name", ["quick", "zhou/c1", "janssen/quick"])
def test_axes_of_the_budget_are_those_that_a_bench_can_measure(name):
    case = load(name)
    ordered = {axis.name for axis in axes_of(case, "lammps") if axis.careful}
    assert ordered - {"sampling", "averaging"} == set(AXES[case.scene.scene])
    assert JUDGED_AS.keys() == AXES.keys()


def test_differences_are_those_that_matter():
    biases = biases_of(load("quick"))
    same = load("quick").set("seed", 9).set("drive.distance", "30 D")
    assert differences(same.set("stop", {"relative_error": 0.1}).tables, biases) == []
    other = same.set("intruder.depth", "4 D").set("numerics.time_step", 1e-5)
    assert differences(other.tables, biases) == ["intruder.depth", "numerics.time_step"]


def test_result_holds_the_budget_and_says_of_which_case_it_is(out, tmp_path, capsys):
    result = run(tiny_tank(), out)
    assert result.record["error_budget"]["lift"]["not_measured"] == list(AXES["tank"])
    folder = tmp_path / "bench"
    folder.mkdir()
    (folder / BENCH).write_text(json.dumps(biases_of(tiny_tank()).to_dict()))
    budget = analyze(out, folder).record["error_budget"]["drag"]
    drag = result.quantities["drag"]
    assert budget["statistical"] == pytest.approx(drag.standard_error / abs(drag.mean))
    assert budget["biases"]["time_step"]["relative"] == 0.01
    assert "time_step" not in budget["not_measured"]
    app(["analyze", str(out), "--bench", str(folder)], standalone_mode=False)
    assert "time_step +1.0 ± 2.0 %" in capsys.readouterr().out
    (folder / BENCH).write_text(json.dumps(biases_of(load("quick")).to_dict()))
    assert any("another case in" in text for text in analyze(out, folder).warnings)
    (folder / BENCH).write_text("{}")
    with pytest.raises(InputError, match="damaged"):
        analyze(out, folder)
