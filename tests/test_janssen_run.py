"""The piston from a case to its answers, in house and on the wheel: balances, limits, refusals."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from collections.abc import Callable
from math import hypot
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from test_janssen_scene import TINY, D, tiny
from typer.testing import CliRunner

from liftdrag.analysis.claims import difference_of_means, within_of_means
from liftdrag.analysis.quantity import Quantity
from liftdrag.cli import app
from liftdrag.errors import InputError
from liftdrag.granular import GRAVITY
from liftdrag.result import Result
from liftdrag.runner import analyze, build_deck, run
from liftdrag.study import sweep

STILL = {"motion": "none", "speed": None, "distance": None, "mobilise": None, "duration": 0.02}

RUNS: dict[str, tuple[str, dict[str, Any]]] = {
    "dem": ("dem", {}),
    "lammps": ("lammps", {}),
    "latching": ("dem", {"grains": {"contact": "walton-braun", "stiffness": 2e3}}),
    "smooth": ("dem", {"tube": {"friction": 0.0}}),
    "little": ("dem", {"fill": {"mass": "0.5 g", "curve": False}, "tube": {"diameter": "8 d"}}),
    "upward": ("dem", {"drive": {"motion": "piston up"}}),
    "still": ("dem", {"drive": STILL}),
    "loaded": ("dem", {"overload": {"mass": "3 g"}}),
}
"""Engine and changes to the tiny column by name."""


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Result]:
    """The runs by name, each made once."""
    made: dict[str, Result] = {}

    def get(name: str) -> Result:
        if name not in made:
            engine, tables = RUNS[name]
            made[name] = run(tiny(**tables), tmp_path_factory.mktemp("run") / name, engine)
        return made[name]

    return get


def curve_of(result: Result) -> pd.DataFrame:
    return pd.read_csv(result.folder / "curve.csv")


@pytest.mark.parametrize("name", ["dem", "lammps", "latching", "upward", "still", "loaded"])
def test_piston_and_tube_carry_the_weight(name: str, result: Callable[[str], Result]):
    """At each fill to 3 %, over less than a tenth of a grain of slow motion or at rest."""
    curve = curve_of(result(name))
    assert len(curve) == 3
    balance = curve["weight balance (1)"].to_numpy()
    assert abs(balance - 1.0).max() < 0.03
    assert result(name).quantities["weight_balance"].mean == pytest.approx(balance[-1])


def test_engines_agree_on_the_tiny_column(result: Callable[[str], Result]):
    """The same grains, law and drive: the loads of each fill within five combined errors, as the
    errors of so short averages are guesses, and within a tenth."""
    one, other = curve_of(result("dem")), curve_of(result("lammps"))
    assert (one["mass (kg)"] == other["mass (kg)"]).all()
    apart = one["apparent mass (kg)"] / other["apparent mass (kg)"] - 1.0
    assert abs(apart).max() < 0.1


def test_smooth_tube_bears_nothing(result: Callable[[str], Result]):
    """mu_w = 0: the piston carries the whole weight, and there is no K."""
    found = result("smooth")
    curve = curve_of(found)
    assert curve["apparent mass (kg)"].to_numpy() == pytest.approx(
        curve["mass (kg)"].to_numpy(), rel=5e-3
    )
    assert abs(found.series["tube"]).max() == 0.0
    assert not {"janssen_ratio", "wall_mobilisation"} & found.quantities.keys()
    assert found.quantities["janssen_ratio_direct"].mean > 0.1


def test_little_fill_weighs_what_it_is(result: Callable[[str], Result]):
    """M -> 0: a layer thinner than a grain rests on the piston, but for what touches the wall."""
    found = result("little")
    mass = float(curve_of(found)["mass (kg)"].iloc[0])
    assert found.quantities["apparent_mass"].mean == pytest.approx(mass, rel=0.03)
    assert "saturation_mass" not in found.quantities


def test_upward_piston_carries_more_than_the_weight(result: Callable[[str], Result]):
    found = result("upward")
    curve = curve_of(found)
    assert (curve["apparent mass (kg)"] > curve["mass (kg)"]).all()
    assert found.series["tube"][-50:].mean() < 0.0
    assert found.quantities["mobilised_friction"].mean > 0.2
    assert found.quantities["wall_rolling"].mean > 0.1


def test_overload_is_carried_too(result: Callable[[str], Result]):
    plain, loaded = curve_of(result("dem")), curve_of(result("loaded"))
    more = loaded["apparent mass (kg)"] - plain["apparent mass (kg)"]
    assert (more > 0.0).all()
    assert (more < 3.1e-3).all()
    assert more.iloc[0] > more.iloc[-1]


def test_single_fill_is_the_last_of_the_curve(tmp_path: Path):
    single = run(tiny(fill={"curve": False}), tmp_path / "single", "dem")
    (mass,) = curve_of(single)["mass (kg)"]
    assert mass == pytest.approx(6e-3, rel=1e-2)
    assert "janssen_ratio" not in single.quantities
    assert single.quantities["apparent_mass"].mean < mass


def test_result_holds_what_a_reader_needs(result: Callable[[str], Result]):
    """Quantities of the contract, the fits, the cost in grain-steps that were, the pictures."""
    found = result("dem")
    stored = json.loads((found.folder / "result.json").read_text())
    asked = "saturation_mass janssen_ratio janssen_ratio_direct wall_mobilisation weight_balance"
    assert set(asked.split()) <= stored["quantities"].keys()
    assert stored["quantities"]["saturation_mass"]["unit"] == "kg"
    assert stored["rankine"]["active"] * stored["rankine"]["passive"] == pytest.approx(1.0)
    assert {"one_parameter", "two_parameter"} <= stored["fits"].keys()
    fills = json.loads((found.folder / "run.json").read_text())["plan"]["fills"]
    work = sum(count * (end - start) for count, start, _, end in fills)
    assert 0 < stored["grain_steps_per_s"] * stored["wall_s"] < 3 * work
    for name in found.files:
        assert (found.folder / name).stat().st_size > 100
    assert stored["engine"]["name"] == "dem"
    assert stored["provenance"]["deck_sha256"]


@pytest.mark.parametrize("name", ["dem", "lammps"])
def test_analyze_gives_the_same_again(name: str, result: Callable[[str], Result]):
    found = result(name)
    again = analyze(found.folder)
    assert {k: q.to_dict() for k, q in again.quantities.items()} == {
        k: q.to_dict() for k, q in found.quantities.items()
    }


@pytest.mark.parametrize("file", ["forces.csv", "profiles.npz"])
def test_damaged_run_is_refused_in_a_sentence(
    file: str, result: Callable[[str], Result], tmp_path: Path
):
    folder = tmp_path / "damaged"
    folder.mkdir()
    for path in result("dem").folder.iterdir():
        (folder / path.name).write_bytes(path.read_bytes())
    whole = (folder / file).read_bytes()
    (folder / file).write_bytes(whole[: len(whole) // 3])
    with pytest.raises(InputError, match="run the case again"):
        analyze(folder)


def test_same_result_from_the_deck_by_hand(result: Callable[[str], Result], tmp_path: Path):
    folder, text, command = build_deck(tiny(), tmp_path / "deck", "dem")
    assert command == "python -m liftdrag.engines.dem ."
    assert "overlaps of 0.001 d" in text
    done = subprocess.run(
        [sys.executable, "-m", "liftdrag.engines.dem", "."],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "finished" in done.stdout
    own = pd.read_csv(folder / "forces.csv")["piston"].to_numpy()
    assert own == pytest.approx(result("dem").series["piston"], rel=1e-8)


@pytest.mark.parametrize(
    ("engine", "tables", "says"),
    [
        ("lammps", {"grains": {"contact": "walton-braun"}}, "--engine dem"),
        ("dem", {"tube": {"diameter": "1 d"}}, "tube.diameter"),
    ],
)
def test_refused_before_anything_is_started(
    engine: str, tables: dict[str, Any], says: str, out: Path
):
    with pytest.raises(InputError, match=says):
        run(tiny(**tables), out, engine)
    assert not out.exists()


def test_dump_is_refused(out: Path):
    with pytest.raises(InputError, match="--dump is for a tank or a shear flow"):
        run(tiny(), out, "dem", dump=True)


def test_latching_contacts_are_run_in_house_unless_asked_otherwise(
    result: Callable[[str], Result], tmp_path: Path
):
    folder, _, command = build_deck(tiny(grains={"contact": "walton-braun"}), tmp_path / "deck")
    assert command.startswith("python -m liftdrag.engines.dem")
    assert (folder / "column.toml").exists()
    assert result("latching").record["engine"]["name"] == "dem"


def test_interrupted_run_says_so(tmp_path: Path):
    """A signal that meets compiled code neither ends the process nor is lost."""
    file = tmp_path / "tiny.toml"
    file.write_text(TINY)
    running = subprocess.Popen(
        [
            sys.executable,
            "-m",
            "liftdrag",
            "run",
            str(file),
            "--engine",
            "dem",
            "--set",
            'drive.distance="50 d"',
            "--out",
            str(tmp_path / "out"),
        ],
        stderr=subprocess.PIPE,
        text=True,
    )
    assert running.stderr is not None
    for line in running.stderr:
        if line.startswith("driving"):
            break
    running.send_signal(signal.SIGINT)
    assert "was interrupted" in running.stderr.read()
    assert running.wait() == 1
    assert json.loads((tmp_path / "out" / "result.json").read_text())["status"] == "killed"


STUDY = """
title = "The friction of the tube"
engine = "dem"
[runs.rough]
case = "{case}"
[runs.smooth]
case = "{case}"
set = {{ "tube.friction" = 0.1 }}
[[claims]]
says = "a smoother tube leaves more to the piston"
larger = "smooth"
smaller = "rough"
quantity = "apparent_mass"
[[pictures]]
file = "friction.png"
title = "load"
quantity = "apparent_mass"
against = "tube.friction"
groups = [["rough", "smooth"]]
"""


def test_study_of_pistons_weighs_its_claims(tmp_path: Path):
    (tmp_path / "tiny.toml").write_text(TINY)
    file = tmp_path / "friction.study"
    file.write_text(STUDY.format(case=tmp_path / "tiny.toml"))
    found = sweep(str(file), tmp_path / "out")
    ((_, finding),) = found.findings
    one, other = (found.results[name].quantities["apparent_mass"] for name in ("smooth", "rough"))
    assert finding.size == one.mean - other.mean
    assert finding.standard_error == hypot(one.standard_error, other.standard_error)
    assert finding.verdict == "supported"
    assert (tmp_path / "out" / "friction.png").stat().st_size > 1000
    wrong = STUDY.replace('"apparent_mass"', '"drag"', 1).format(case=tmp_path / "tiny.toml")
    file.write_text(wrong)
    done = CliRunner().invoke(app, ["sweep", str(file), "--out", str(tmp_path / "other")])
    assert isinstance(done.exception, InputError)
    assert "has no drag" in str(done.exception)
    assert not (tmp_path / "other").exists()


def test_claims_of_two_means_are_those_of_the_normal_test():
    """Verdicts of normal samples are wrong as often as the level says; shares likewise."""
    rng = np.random.default_rng(5)

    def drawn(mean: float) -> Quantity:
        return Quantity(float(rng.normal(mean, 0.1)), 0.1, "kg", None, None, True)

    same = [difference_of_means(drawn(1.0), drawn(1.0)).verdict for _ in range(2000)]
    assert same.count("undecided") / 2000 == pytest.approx(0.95, abs=0.015)
    apart = [difference_of_means(drawn(2.0), drawn(1.0)).verdict for _ in range(100)]
    assert apart.count("supported") == 100
    inside = [within_of_means(drawn(1.02), drawn(1.0), 0.5).verdict for _ in range(200)]
    assert inside.count("contradicted") == 0
    assert inside.count("supported") > 150
    outside = [within_of_means(drawn(2.5), drawn(1.0), 0.5).verdict for _ in range(200)]
    assert outside.count("contradicted") > 150


def test_layers_are_laid_on_the_column(result: Callable[[str], Result]):
    """The grains of the profiles are those of the fill, in the last blocks of each."""
    from liftdrag.engines import engine
    from liftdrag.folder import Record

    for name in ("dem", "lammps"):
        record = Record.read(result(name).folder)
        counts = {
            round(profile.time / record.plan.time_step): profile.count.sum()
            for profile in engine(name).profiles(record.plan, result(name).folder)
        }
        for count, _, _, end in record.plan.fills:
            assert counts[end] == pytest.approx(count, abs=1e-6)


def test_weight_of_the_series_is_that_of_the_grains(result: Callable[[str], Result]):
    series = result("still").series
    rest = (series["piston"] + series["tube"])[-40:].mean()
    count = tiny().scene.grain_count
    assert rest == pytest.approx(count * 2500 * np.pi * D**3 / 6 * GRAVITY, rel=0.01)
