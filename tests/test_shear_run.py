"""A shear flow from the case to its result, on a tiny cell."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from test_shear_scene import tiny

from liftdrag import sheared
from liftdrag.arrays import read_arrays
from liftdrag.case import load
from liftdrag.deck.shear import CHANNELS, GRAINS, START, STRESSES
from liftdrag.deck.tables import table
from liftdrag.dem.cylinders import Cylinders
from liftdrag.engines import dem_shear
from liftdrag.engines.base import silent
from liftdrag.engines.dem import main as run_by_hand
from liftdrag.engines.samples import read_samples
from liftdrag.errors import CaseError, InputError, RunFailed
from liftdrag.result import Result
from liftdrag.runner import analyze, build_deck, run


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Result:
    """One run of the tiny cell."""
    return run(tiny(), tmp_path_factory.mktemp("shear") / "run")


def test_run_leaves_its_answers_and_keeps_what_must_be_kept(made: Result):
    record = json.loads((made.folder / "result.json").read_text())
    assert (record["status"], record["scene"], record["grains"]) == ("finished", "shear", 60)
    assert record["stopped_by"] == "distance"
    assert 0.0 < made.quantities["shear_stress"].mean < made.quantities["pressure"].mean < 20.0
    assert 0.0 <= made.quantities["order_parameter"].mean < 1.0
    assert set(record["invariants"]) == {
        "largest_overlap", "agitation", "momentum", "energy_created",
    }  # fmt: skip
    assert all(one["holds"] for one in record["invariants"].values())
    for name in made.files:
        assert (made.folder / name).stat().st_size > 100, name
    assert made.series["strain"][-1] == pytest.approx(1.5)
    assert record["steady_window"]["start_strain"] >= 0.5


def test_analyze_gives_the_same_answers_again(made: Result):
    before = json.loads((made.folder / "result.json").read_text())
    assert analyze(made.folder).record == before


def test_looks_begin_with_the_deck_and_never_leave_the_cell(made: Result):
    looks, grains = read_arrays(made.folder / dem_shear.LOOKS), read_arrays(made.folder / GRAINS)
    assert looks["position"][0] == pytest.approx(grains["position"], rel=1e-6)
    assert looks["time"][-1] == pytest.approx(0.015)
    assert np.linalg.norm(looks["axis"], axis=2) == pytest.approx(1.0, abs=1e-6)
    sides = np.array(tiny().scene.sides)
    assert (np.abs(looks["position"] / sides - 0.5) < 0.6).all()


def test_run_of_spheres_leaves_what_they_have(out: Path):
    """All but an order; the energy of turning is none, in the looks they have no axis."""
    found = run(tiny(species=[{"shape": "sphere", "share": 1.0}]), out)
    assert all(one["holds"] for one in found.record["invariants"].values())
    assert "rotational_energy" not in found.quantities
    assert 0.0 < found.quantities["pressure_over_theory"].mean < 2.0
    assert {path.name for path in out.glob("*.png")} == {"flow.png", "cell.png"}
    assert all((out / name).stat().st_size > 100 for name in found.files)
    assert not read_arrays(out / dem_shear.LOOKS)["axis"].any()
    assert analyze(out).record == found.record


def test_deck_runs_by_hand_with_the_same_bits(made: Result, out: Path):
    folder, text, command = build_deck(tiny(), out)
    assert (made.folder / GRAINS).read_bytes() == (folder / GRAINS).read_bytes()
    assert "pi l_c / (0.3262 nu + 1.7532)" in text
    assert command == "python -m liftdrag.engines.dem ."
    assert run_by_hand([str(folder)]) == 0
    assert (folder / STRESSES).read_bytes() == (made.folder / STRESSES).read_bytes()


def test_run_ends_when_its_stress_is_known_well_enough(out: Path):
    stop = {"quantity": "bulk_friction", "relative_error": 0.3}
    case = tiny(stop=stop, drive={"strain": 30.0})
    found = run(case, out)
    assert found.record["stopped_by"] == "precision"
    assert found.series["strain"][-1] < 29.0
    assert found.quantities["bulk_friction"].n_independent >= 50
    assert not any("[stop]" in warning for warning in found.warnings)


def test_target_that_is_not_reached_is_warned_of(out: Path):
    case = tiny(stop={"relative_error": 1e-6}, drive={"strain": 1.0, "average_from": 0.5})
    found = run(case, out)
    assert found.record["stopped_by"] == "distance"
    assert any("shear_stress is not known as well as [stop] asks" in w for w in found.warnings)


@pytest.mark.parametrize("engine", ["lammps", "lmp", "liggghts"])
def test_engine_without_cylinders_is_refused(engine: str, out: Path):
    for ask in (run, build_deck):
        with pytest.raises(InputError, match=f"^The engine {engine} has no contact of cylinders"):
            ask(tiny(), out, engine=engine)
    assert not out.exists()


def test_run_that_takes_too_long_says_so(out: Path):
    with pytest.raises(RunFailed) as caught:
        run(tiny(), out, timeout_s=1e-3)
    assert caught.value.status == "timeout"
    assert json.loads((out / "result.json").read_text())["status"] == "timeout"
    assert "Go on with: liftdrag run --resume --out" in str(caught.value)


def test_cell_that_cannot_be_packed_is_refused(monkeypatch: pytest.MonkeyPatch, out: Path):
    def full(*_: object) -> None:
        raise CaseError("cell.solid_fraction", 0.6, "the grains do not fit", "lower it")

    monkeypatch.setattr(sheared, "grown_cell", full)
    with pytest.raises(CaseError, match="do not fit"):
        run(tiny(), out)
    assert not out.exists()


@pytest.fixture
def deck(made: Result, tmp_path: Path) -> Path:
    """The deck of the tiny cell, alone in a folder."""
    for name in (START, GRAINS):
        (tmp_path / name).write_bytes((made.folder / name).read_bytes())
    return tmp_path


def test_grains_on_top_of_each_other_end_the_run(deck: Path, capsys: pytest.CaptureFixture[str]):
    arrays = read_arrays(deck / GRAINS)
    arrays["position"][1] = arrays["position"][0]
    np.savez(deck / GRAINS, **arrays)
    assert run_by_hand([str(deck)]) == 1
    assert "overlap by more than the radius of the smaller" in capsys.readouterr().err


BROKEN = {
    "arrays": lambda arrays: arrays | {"axis": arrays["axis"][1:]},
    "numbers": lambda arrays: arrays | {"velocity": arrays["velocity"] * np.nan},
    "sizes": lambda arrays: arrays | {"radius": -arrays["radius"]},
    "names": lambda arrays: arrays | {"colour": arrays["radius"]},
}


@pytest.mark.parametrize("what", BROKEN)
def test_damaged_grains_are_refused(what: str, deck: Path, capsys: pytest.CaptureFixture[str]):
    np.savez(deck / GRAINS, **BROKEN[what](read_arrays(deck / GRAINS)))
    assert run_by_hand([str(deck)]) == 2
    assert "holds no cell of liftdrag" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("old", "new"), [("row_every", "row_ever"), ("frame_every = ", "frame_every = 1"), ("0.9", "2")]
)
def test_damaged_numbers_are_refused(
    old: str, new: str, deck: Path, capsys: pytest.CaptureFixture[str]
):
    text = (deck / START).read_text()
    assert old in text
    (deck / START).write_text(text.replace(old, new, 1))
    assert run_by_hand([str(deck)]) == 2
    assert START in capsys.readouterr().err


def test_files_that_were_cut_short_are_refused(made: Result):
    whole = (made.folder / STRESSES).read_text()
    (made.folder / STRESSES).write_text("\n".join(whole.split("\n")[:300]) + "\n")
    try:
        with pytest.raises(InputError, match="damaged"):
            analyze(made.folder)
    finally:
        (made.folder / STRESSES).write_text(whole)


def test_stress_of_two_disks_that_meet_head_on(tmp_path: Path):
    """The time integral of contact yy is impulse times distance, 2 m* v l, over the volume.

    Elastic, face on face, centres a length apart; the kinetic part is that of one m v^2 each.
    """
    radius, length, mass, speed, side = 1e-3, 1e-3, 1e-5, 0.1, 10e-3
    y = np.array([4.4e-3, 5.6e-3])
    still = np.zeros((2, 3))
    grains = Cylinders(
        position=np.column_stack([[5e-3, 5e-3], y, [5e-3, 5e-3]]),
        velocity=np.array([[0.0, speed, 0.0], [0.0, -speed, 0.0]]),
        axis=np.tile([0.0, 1.0, 0.0], (2, 1)),
        spin=still,
        radius=np.full(2, radius),
        half_length=np.full(2, length / 2.0),
        mass=np.full(2, mass),
    )
    step, steps = 1e-7, 40_000
    numbers = {
        "contact": {"youngs_modulus": 1e9, "poisson_ratio": 0.3, "restitution": 1.0},
        "cell": {"size": [side] * 3, "shear_rate": 1e-9},
        "run": {"threads": 1, "time_step": step, "steps": steps, "row_every": 2000,
                "frame_every": 4000, "skin": 1e-4},
    }  # fmt: skip
    (tmp_path / START).write_text("".join(table(name, one) for name, one in numbers.items()))
    np.savez(tmp_path / GRAINS, species=np.array([1, 1]), **vars(grains))
    ran = dem_shear.run(dem_shear.read(tmp_path), tmp_path, silent)
    found = read_samples(tmp_path / STRESSES, CHANNELS)
    assert ran.steps == steps
    impulse = 2.0 * (mass / 2.0) * 2.0 * speed
    integral = found["contact_yy"].sum() * 2000 * step * side**3
    assert integral == pytest.approx(impulse * length, rel=0.02)
    assert found["kinetic_yy"][[0, -1]] == pytest.approx(2.0 * mass * speed**2 / side**3, rel=1e-3)
    assert found["fluctuation"][-1] == pytest.approx(mass * speed**2, rel=1e-3)
    assert abs(found["contact_xy"]).max() < 1e-9 * found["contact_yy"].max()
    assert found["momentum"].max() < 1e-12 * mass * speed


@pytest.mark.validate
def test_dense_rods_flow_as_those_of_the_paper(out: Path):
    """A stress and a pressure on the paper's curves, within four combined errors; S above 0.8."""
    found = run(load("liu2020/rods").set("drive.strain", 40), out)
    assert found.quantities["order_parameter"].mean > 0.8
    for name in ("shear_stress", "pressure"):
        assert abs(found.record["comparison"][name]["difference_in_errors"]) < 4.0
        assert found.quantities[name].standard_error < 0.15 * found.quantities[name].mean
