"""Whole runs on the real engine: what they answer, and what they leave when they fail."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from conftest import EXPERIMENTS, LONG, TINY, tiny_tank

import liftdrag
import liftdrag.tank
from liftdrag.analysis.errorbars import average
from liftdrag.deck import Deck
from liftdrag.engines import engine, mpi
from liftdrag.engines.family import read_dump
from liftdrag.errors import InputError, RunFailed
from liftdrag.execution import write_deck
from liftdrag.folder import Record, fresh
from liftdrag.granular import GRAVITY
from liftdrag.result import Result
from liftdrag.runner import analyze, run
from liftdrag.snapshot import Snapshot
from liftdrag.tank import prepare

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


LAMMPS = engine("lammps")


def time_of(item) -> float:
    return item.time if isinstance(item, Snapshot) else item[0]


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
        """Solid fraction and overburden at step 0, by counting the settled grains."""
        scene, folder = EXPERIMENTS[name].scene, result_of(name).folder
        kind, centres = first_frame(folder)
        (left, right), (low, high) = scene.far_field, scene.far_band
        inside = (centres[:, 0] > left) & (centres[:, 0] < right) & (kind == 1)
        far = centres[inside, 2]
        area = (right - left) * scene.tank.thickness
        volume = np.pi * scene.grains.diameter**3 / 6.0
        fraction = np.sum((far > low) & (far < high)) * volume / (area * (high - low))
        weight = volume * scene.grains.density * scene.bulk_gravity
        pressure = np.sum(far > scene.axis_height) * weight / area
        if scene.lid is not None:
            heavy = volume * scene.lid.density_ratio * scene.grains.density * GRAVITY
            pressure += (kind == 3).sum() * heavy / (scene.tank.length * scene.tank.thickness)
        step, _, measured_fraction, measured_pressure = np.loadtxt(folder / "bed.dat")[0]
        assert step == 0
        assert measured_fraction == pytest.approx(fraction, rel=1e-4)
        assert measured_pressure == pytest.approx(pressure, rel=1e-4)

    def test_snapshots_and_surfaces_follow_each_other_in_time(self, result_of, name):
        result = result_of(name)
        plan = Record.read(result.folder).plan
        end = plan.stages["drive"] * plan.time_step
        for read in (LAMMPS.snapshots, LAMMPS.surfaces):
            times = [time_of(item) for item in read(plan, result.folder)]
            assert times[0] == 0.0
            assert np.all(np.diff(times) > 0.0)
            assert times[-1] > 0.9 * end


def test_effective_depth_of_a_lid_is_the_papers(result_of):
    """h~ = h + (pi d / 6) rho*/rho; h drops out where the bulk has no weight."""
    for name, own in (("lid", 1.0), ("lid only", 0.0)):
        q = result_of(name).quantities
        lid = np.pi * 1.5e-3 / 6.0 * 60.0 / q["solid_fraction"].mean
        expected = own * q["depth"].mean + lid
        assert q["effective_depth"].mean == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("name", EXPERIMENTS)
def test_coefficients_follow_their_definitions(result_of, name):
    result, scene = result_of(name), EXPERIMENTS[name].scene
    q = result.quantities
    weight = q["solid_fraction"].mean * 2500.0 * 9.81
    diameter, length = scene.intruder.diameter, scene.tank.thickness
    drag = q["drag"].mean / (weight * q["effective_depth"].mean * diameter * length)
    lift = q["lift"].mean / (weight * np.pi * diameter**2 / 4.0 * length)
    assert q["drag_coefficient"].mean == pytest.approx(drag)
    assert q["lift_coefficient"].mean == pytest.approx(lift)
    by_weight = q["drag"].mean / (q["overburden"].mean * diameter * length)
    assert q["drag_coefficient_overburden"].mean == pytest.approx(by_weight)
    assert drag == pytest.approx(by_weight, rel=0.1)


def test_drag_and_lift_average_over_one_window_after_two_diameters(result_of):
    result, scene = result_of("free surface"), EXPERIMENTS["free surface"].scene
    window, series = result.window, result.series
    start = series.time[window.start]
    assert start * scene.drive.speed >= 2.0 * scene.intruder.diameter
    again = average(series["drag"][window.start : window.stop], series.interval)
    assert result.quantities["drag"].mean == again.mean


def test_the_settled_bed_has_the_solid_fraction_of_a_poured_one(tmp_path):
    case = tiny_tank(
        tank={"length": "20 d", "thickness": "6 d", "height": "16 d"},
        intruder={"depth": "5 D"},
        drive={"speed": "2 m/s"},
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
    case = liftdrag.load("quick").set("tank.height", "12 d").set("intruder.diameter", "1.5 d")
    case = case.set("tank.length", "16 d").set("tank.thickness", "3 d")
    result = liftdrag.run(case.set("drive.distance", "6 D"), out=tmp_path / "quick", ranks=1)
    assert result.quantities["drag"].unit == "N"
    assert list(result.series.to_pandas()) == [
        "drag (N)",
        "lift (N)",
        "floor_drag (N)",
        "floor_lift (N)",
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


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
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


def test_an_engine_ends_with_a_liftdrag_that_is_killed(tmp_path):
    process = start(tmp_path)
    wait_for(lambda: driving(tmp_path))
    process.kill()
    process.communicate(timeout=20)
    wait_for(lambda: children_in(tmp_path) == [])
    assert not (tmp_path / "out" / "result.json").exists()


def test_a_folder_that_vanishes_ends_the_run(tmp_path):
    process = start(tmp_path)
    wait_for(lambda: driving(tmp_path))
    shutil.rmtree(tmp_path / "out")
    _, errors = process.communicate(timeout=20)
    assert process.returncode == 1
    assert b"Traceback" not in errors
    assert children_in(tmp_path) == []


def copy_of(result: Result, folder: Path) -> Path:
    shutil.copytree(result.folder, folder / "copy")
    return folder / "copy"


@pytest.mark.parametrize("text", ["{", "[]", "{}", '{"status": "finished"}', "\udcff"])
@pytest.mark.parametrize("name", ["result.json", "run.json"])
def test_a_damaged_record_is_one_sentence(result_of, tmp_path, name, text):
    folder = copy_of(result_of("free surface"), tmp_path)
    (folder / name).write_text(text, "utf-8", "surrogateescape")
    if name == "result.json" and "finished" in text:
        assert analyze(folder).status == "finished"
        return
    with pytest.raises(InputError) as caught:
        analyze(folder)
    assert len(str(caught.value).splitlines()) == 1


@pytest.mark.parametrize("damage", ["header", "nan", "short", "gone", "surface"])
def test_damaged_series_are_one_sentence(result_of, tmp_path, damage):
    folder = copy_of(result_of("free surface"), tmp_path)
    forces = folder / "forces.dat"
    lines = forces.read_text().splitlines(keepends=True)
    if damage == "header":
        lines[1] = lines[1].replace("v_drag", "v_drug")
    if damage == "nan":
        lines[60] = lines[60].split()[0] + " nan nan\n"
    if damage == "short":
        del lines[6:]
    forces.write_text("".join(lines))
    if damage == "gone":
        forces.unlink()
    if damage == "surface":
        (folder / "surface.dump").write_text("ITEM: TIMESTEP\nx\n")
    with pytest.raises(InputError) as caught:
        analyze(folder)
    assert len(str(caught.value).splitlines()) == 1


def test_answers_that_fail_leave_a_run_that_can_be_analysed(tmp_path, monkeypatch):
    """An interrupt between the engine's end and the answers loses nothing."""

    def interrupted(*_):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(liftdrag.tank, "answers", interrupted)
        with pytest.raises(KeyboardInterrupt):
            run(EXPERIMENTS["free surface"], tmp_path)
    assert analyze(tmp_path).quantities["drag"].mean > 0.0


def test_two_runs_at_once_get_two_folders(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert fresh(None, "same") != fresh(None, "same")


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

    def test_an_engine_that_cannot_start_ends_every_rank(self, tmp_path):
        """Rank 0 fails after its deck is written, while the others wait for it."""
        code = (
            "import sys; from pathlib import Path; from liftdrag.engines import family, mpi\n"
            "family.SAYS = 'no/such/folder'\n"
            "sys.argv = ['liftdrag', 'run', 'tiny.toml', '--out', 'out']\n"
            "from liftdrag.cli import main; main()"
        )
        (tmp_path / "tiny.toml").write_text(TINY)
        command = [str(mpi.mpiexec()), "-n", "2", sys.executable, "-c", code]
        done = subprocess.run(
            command,
            capture_output=True,
            text=True,
            timeout=60,
            cwd=tmp_path,
            env=mpi.outside(os.environ),
        )
        assert done.returncode == 1
        assert "did not start" in done.stderr

    def test_a_folder_in_use_ends_every_rank(self, tmp_path):
        done = self.run(tmp_path, "--out", str(tmp_path))
        assert done.returncode == 2
        assert "not an empty folder" in done.stderr


each_program = pytest.mark.parametrize("name", ["lmp", "liggghts"])
one_program = pytest.mark.parametrize(
    "name", ["lmp", pytest.param("liggghts", marks=pytest.mark.validate)]
)
"""For what liftdrag does before the program is started, the same for both."""


class TestUnderOpenMpi:
    """Open MPI's mpirun around `python -m liftdrag`, for a program linked with it."""

    def run(self, name: str, folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
        (folder / "tiny.toml").write_text(TINY)
        command = [str(engine(name).launcher()), "-n", "2", sys.executable, "-m", "liftdrag", "run"]
        return subprocess.run(
            [*command, "tiny.toml", "--engine", name, *words],
            capture_output=True,
            text=True,
            timeout=240,
            cwd=folder,
            env=mpi.outside(os.environ) | mpi.settings(mpi.OPEN_MPI, os.environ),
        )

    @one_program
    def test_the_jobs_ranks_are_used(self, name, tmp_path):
        done = self.run(name, tmp_path, "--json")
        assert done.returncode == 0, done.stderr
        record = json.loads(done.stdout)
        assert record["engine"]["ranks"] == 2
        assert record["status"] == "finished"
        assert sorted(path.name for path in tmp_path.iterdir()) == ["runs", "tiny.toml"]

    @one_program
    def test_bad_input_is_one_sentence_and_status_2(self, name, tmp_path):
        done = self.run(name, tmp_path, "--set", "intruder.depth=1 m")
        assert done.returncode == 2
        assert done.stderr.count("intruder.depth") == 1

    @one_program
    def test_a_folder_in_use_ends_every_rank(self, name, tmp_path):
        done = self.run(name, tmp_path, "--out", str(tmp_path))
        assert done.returncode == 2
        assert "not an empty folder" in done.stderr


@pytest.mark.parametrize("ranks", [0, -1, 100_000])
def test_ranks_out_of_range_are_refused(ranks):
    with pytest.raises(InputError, match="ranks"):
        run(EXPERIMENTS["free surface"], ranks=ranks)
