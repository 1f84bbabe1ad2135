"""Whole runs on the real engine: what they answer, and what they leave when they fail."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from conftest import EXPERIMENTS, LONG, TINY, tiny_tank

import liftdrag
from liftdrag.analysis.errorbars import average
from liftdrag.deck import Deck
from liftdrag.engines import engine, mpi
from liftdrag.engines.lammps import read_dump
from liftdrag.errors import InputError, RunFailed
from liftdrag.granular import GRAVITY
from liftdrag.runner import analyze, prepare, run, write_deck

QUANTITIES = {
    "drag": "N",
    "lift": "N",
    "drag_coefficient": "1",
    "lift_coefficient": "1",
    "drag_coefficient_overburden": "1",
    "solid_fraction": "1",
    "depth": "m",
    "effective_depth": "m",
    "overburden": "Pa",
    "bed_speed_ratio": "1",
    "inertial_number": "1",
}


def first_frame(folder: Path) -> tuple[np.ndarray, np.ndarray]:
    """Types (n,) and centres (n, 3) of the settled bed."""
    _, rows = next(read_dump(folder / "settled.dump"))
    return rows[:, 1].astype(int), rows[:, 2:5]


@pytest.mark.parametrize("name", EXPERIMENTS)
class TestEachExperiment:
    def test_answers_every_quantity_with_an_error_and_a_unit(self, result_of, name):
        record = json.loads((result_of(name).folder / "result.json").read_text())
        assert record["status"] == "finished"
        assert {key: q["unit"] for key, q in record["quantities"].items()} == QUANTITIES
        for quantity in record["quantities"].values():
            assert np.isfinite(quantity["mean"])
            assert quantity["standard_error"] >= 0.0

    def test_counts_its_work(self, result_of, name):
        result = result_of(name)
        kind, _ = first_frame(result.folder)
        assert result.record["grains"] == len(kind)
        assert result.record["engine"]["ranks"] == 1
        assert result.record["cpu_s"] <= result.record["wall_s"]

    def test_the_bed_is_at_rest_before_the_drive(self, result_of, name):
        log = (result_of(name).folder / "log.lammps").read_text()
        said = [line for line in log.splitlines() if line.startswith("LIFTDRAG SETTLED")]
        grains = EXPERIMENTS[name].scene.grains
        bound = 1e-4 * grains.mass * GRAVITY * grains.diameter
        assert float(said[0].split()[-1]) < bound

    def test_no_grain_is_ejected(self, result_of, name):
        kind, centres = first_frame(result_of(name).folder)
        scene = EXPERIMENTS[name].scene
        assert (kind == 1).sum() == scene.grain_count
        assert centres[kind == 1, 2].max() < scene.tank.height + scene.grains.diameter

    def test_far_field_is_what_the_grains_say(self, result_of, name):
        """Solid fraction and overburden of the first sample, by counting the settled grains."""
        scene, series = EXPERIMENTS[name].scene, result_of(name).series
        kind, centres = first_frame(result_of(name).folder)
        low, high = scene.far_band
        far = centres[(kind == 1) & (centres[:, 0] % scene.tank.length < scene.far_length)]
        area = scene.far_length * scene.tank.thickness
        volume = np.pi * scene.grains.diameter**3 / 6.0
        count = np.sum((far[:, 2] > low) & (far[:, 2] < high))
        above = np.sum(far[:, 2] > scene.axis_height)
        pressure = above * volume * scene.grains.density * scene.bulk_gravity / area
        if scene.lid is not None:
            layer, area_all = (kind == 3).sum(), scene.tank.length * scene.tank.thickness
            heavy = scene.lid.density_ratio * scene.grains.density
            pressure += layer * volume * heavy * GRAVITY / area_all
        fraction = count * volume / (area * (high - low))
        assert series["solid_fraction"][0] == pytest.approx(
            fraction, abs=3.0 * volume / area / 1e-3
        )
        assert series["overburden"][0] == pytest.approx(pressure, rel=0.02)


def test_effective_depth_of_a_lid_is_the_papers(result_of):
    """h~ = h + (pi d / 6) rho*/rho; h drops out where the bulk has no weight."""
    for name, own in (("lid", 1.0), ("lid only", 0.0)):
        q = result_of(name).quantities
        lid = np.pi * 1.5e-3 / 6.0 * 60.0 / q["solid_fraction"].mean
        expected = own * q["depth"].mean + lid
        assert q["effective_depth"].mean == pytest.approx(expected, rel=1e-9)


def test_coefficients_follow_their_definitions(result_of):
    result = result_of("free surface")
    q, scene = result.quantities, result.scene
    weight = q["solid_fraction"].mean * 2500.0 * 9.81
    diameter, length = scene.intruder.diameter, scene.tank.thickness
    drag = q["drag"].mean / (weight * q["effective_depth"].mean * diameter * length)
    lift = q["lift"].mean / (weight * np.pi * diameter**2 / 4.0 * length)
    assert q["drag_coefficient"].mean == pytest.approx(drag)
    assert q["lift_coefficient"].mean == pytest.approx(lift)
    by_weight = q["drag"].mean / (q["overburden"].mean * diameter * length)
    assert q["drag_coefficient_overburden"].mean == pytest.approx(by_weight)


def test_drag_and_lift_average_over_one_window_after_two_diameters(result_of):
    result = result_of("free surface")
    window, series, scene = result.window, result.series, result.scene
    start = series.time[window.start]
    assert start * scene.drive.speed >= 2.0 * scene.intruder.diameter
    again = average(series["drag"][window.start : window.stop], series.interval)
    assert result.quantities["drag"].mean == again.mean


def test_the_settled_bed_has_the_solid_fraction_of_a_poured_one(tmp_path):
    case = tiny_tank(
        tank={"length": "24 d", "thickness": "8 d", "height": "20 d"},
        intruder={"diameter": "2 d", "depth": "5 D"},
        drive={"speed": "0.5 m/s", "distance": "4 D"},
    )
    result = run(case, tmp_path)
    assert 0.58 < result.series["solid_fraction"][0] < 0.62


def test_same_seed_same_forces_to_the_bit(result_of, tmp_path):
    again = run(EXPERIMENTS["free surface"], tmp_path)
    first = result_of("free surface")
    assert (again.folder / "forces.dat").read_bytes() == (first.folder / "forces.dat").read_bytes()
    assert again.record["provenance"]["deck_sha256"] == first.record["provenance"]["deck_sha256"]


def test_two_ranks_start_on_the_same_path(result_of, tmp_path):
    """Sums in another order differ by rounding, which the flow then amplifies."""
    two, one = run(EXPERIMENTS["free surface"], tmp_path, ranks=2), result_of("free surface")
    assert two.record["engine"]["ranks"] == 2
    for name in ("solid_fraction", "overburden"):
        assert two.series[name][0] == pytest.approx(one.series[name][0], rel=1e-9)
    error = np.hypot(*(r.quantities["drag"].standard_error for r in (one, two)))
    assert abs(two.quantities["drag"].mean - one.quantities["drag"].mean) < 4.0 * error


def test_analyze_gives_the_same_answers_again(result_of):
    result = result_of("free surface")
    assert analyze(result.folder).quantities == result.quantities


def test_results_are_reached_by_the_documented_words(tmp_path):
    case = liftdrag.load("quick").set("tank.height", "20 d").set("intruder.depth", "2 D")
    case = case.set("tank.length", "27 d").set("tank.thickness", "3 d")
    result = liftdrag.run(case.set("drive.distance", "4 D"), out=tmp_path / "quick", ranks=1)
    assert result.quantities["drag"].unit == "N"
    assert list(result.series.to_pandas()) == [
        "drag (N)",
        "lift (N)",
        "bed_speed (m/s)",
        "solid_fraction (1)",
        "overburden (Pa)",
    ]


def start(folder: Path, *words: str) -> subprocess.Popen[bytes]:
    """`liftdrag run` of a long tiny tank, in its own process."""
    case = folder / "tiny.toml"
    case.write_text(LONG)
    command = [*words, sys.executable, "-m", "liftdrag", "run", str(case), "--out"]
    return subprocess.Popen(
        [*command, str(folder / "out")], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )


def wait_for(condition, patience_s: float = 60.0) -> None:
    end = time.monotonic() + patience_s
    while not condition():
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.1)


def children_in(folder: Path) -> list[int]:
    """Processes whose command line names the folder and the engine's child."""
    found = []
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                words = (entry / "cmdline").read_bytes()
            except OSError:
                continue
            if b"lammps_child" in words and str(folder).encode() in words:
                found.append(int(entry.name))
    return found


def driving(folder: Path) -> bool:
    log = folder / "out" / "log.lammps"
    return log.exists() and "\nLIFTDRAG STAGE drive" in log.read_text()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupt_stops_the_engine_and_says_so(tmp_path, number):
    process = start(tmp_path)
    wait_for(lambda: driving(tmp_path))
    process.send_signal(number)
    _, errors = process.communicate(timeout=20)
    assert process.returncode == 1
    assert b"interrupted" in errors
    assert b"Traceback" not in errors
    assert json.loads((tmp_path / "out" / "result.json").read_text())["status"] == "killed"
    assert children_in(tmp_path) == []


def test_a_killed_engine_does_not_take_liftdrag_with_it(tmp_path):
    process = start(tmp_path)
    wait_for(lambda: driving(tmp_path))
    for child in children_in(tmp_path):
        os.kill(child, signal.SIGKILL)
    _, errors = process.communicate(timeout=20)
    assert process.returncode == 1
    assert b"killed" in errors
    assert json.loads((tmp_path / "out" / "result.json").read_text())["status"] == "killed"


def test_a_run_that_blows_up_fails_with_its_reason(tmp_path):
    case = EXPERIMENTS["free surface"].set("numerics.time_step", 9e-5)
    with pytest.raises(RunFailed) as caught:
        run(case, tmp_path)
    record = json.loads((tmp_path / "result.json").read_text())
    assert caught.value.status == record["status"] != "finished"
    assert record["status"] in {"lost_grains", "not_finite"}
    assert "ERROR" in caught.value.evidence
    assert record["quantities"] == {}
    with pytest.raises(InputError, match="did not finish"):
        analyze(tmp_path)


def test_a_bed_that_does_not_come_to_rest_is_refused(tmp_path):
    """A settling stage cut to 100 steps leaves the bed moving."""
    case, folder = EXPERIMENTS["free surface"], tmp_path / "deck"
    numerics, deck = prepare(case)
    texts = dict(deck.texts)
    most = str(numerics.settle_steps_max.value)
    texts["in.tank"] = texts["in.tank"].replace(f"run          {most}", "run          100")
    changed = Deck(texts, deck.plan)
    write_deck(case, numerics, changed, "lammps", folder)
    outcome = engine("lammps").run(changed.plan, folder, lambda *_: None)
    assert outcome.status == "engine_error"
    assert "did not come to rest" in outcome.reason


class TestUnderMpirun:
    """The wheel's own mpiexec around `python -m liftdrag`."""

    def run(self, folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
        case = folder / "tiny.toml"
        case.write_text(TINY)
        command = [str(mpi.mpiexec()), "-n", "2", sys.executable, "-m", "liftdrag", "run"]
        return subprocess.run(
            [*command, str(case), *words],
            capture_output=True,
            text=True,
            timeout=120,
            env=mpi.outside(os.environ),
        )

    def test_the_jobs_ranks_are_used(self, tmp_path):
        done = self.run(tmp_path, "--out", str(tmp_path / "out"), "--json")
        assert done.returncode == 0, done.stderr
        record = json.loads(done.stdout)
        assert record["engine"]["ranks"] == 2
        assert record["status"] == "finished"

    def test_bad_input_is_one_sentence_and_status_2(self, tmp_path):
        done = self.run(tmp_path, "--set", "intruder.depth=1 m")
        assert done.returncode == 2
        assert done.stderr.count("intruder.depth") == 1

    def test_a_folder_in_use_ends_every_rank(self, tmp_path):
        done = self.run(tmp_path, "--out", str(tmp_path))
        assert done.returncode == 2
        assert "not an empty folder" in done.stderr


def test_open_mpis_launcher_is_refused():
    with pytest.raises(InputError, match="Open MPI"):
        mpi.world({"OMPI_COMM_WORLD_SIZE": "2", "OMPI_COMM_WORLD_RANK": "0"})


@pytest.mark.parametrize("ranks", [0, -1, 100_000])
def test_ranks_out_of_range_are_refused(ranks):
    with pytest.raises(InputError, match="ranks"):
        run(EXPERIMENTS["free surface"], ranks=ranks)
