"""Runs of the closed bed in the plane: their answers by hand, what they keep and leave."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from math import sqrt
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from test_drag2d_scene import TINY, each_shape, tiny, tiny_of

from liftdrag.case import Case
from liftdrag.deck.drag2d import read_bed
from liftdrag.dem import Bed, advance, forces
from liftdrag.engines.dem import main
from liftdrag.errors import InputError, RunFailed
from liftdrag.numerics import derive
from liftdrag.packing.drag2d import law_of, packed
from liftdrag.pictures import drag2d as pictures
from liftdrag.result import Result
from liftdrag.runner import analyze, run
from liftdrag.scene import Drag2DScene

QUANTITIES = {
    "drag": "N",
    "lift": "N",
    "drag_fluctuation": "N",
    "rest_pressure": "Pa",
    "pressure_left": "Pa",
    "pressure_right": "Pa",
    "pressure_bottom": "Pa",
    "pressure_top": "Pa",
    "irregularity": "1",
    "overlap_ratio": "1",
    "drag_deviation": "N",
}

KEYS = """status scene case seed engine steps grains wall_s cpu_s grain_steps_per_s quantities
stopped_by warnings provenance""".split()
"""What every result.json has."""

PARTS = {"mean", "standard_error", "unit", "correlation_time", "n_independent", "converged"}
PARTS |= {"interval_95"}

WALLS = {"left": "height", "right": "height", "bottom": "width", "top": "width"}
"""The side of the box that each wall is as long as."""

ELASTIC = {"friction": 0.0, "restitution": 1.0}


def scene_of(case: Case) -> Drag2DScene:
    assert isinstance(case.scene, Drag2DScene)
    return case.scene


@pytest.fixture(scope="module")
def result_of(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Result]:
    """Runs of the tiny bed by shape and kind of contact, each made once, pictures of the first."""
    made: dict[tuple[str, bool], Result] = {}

    def get(shape: str, elastic: bool = False) -> Result:
        if (shape, elastic) not in made:
            case = tiny_of(shape, grains=ELASTIC if elastic else {})
            with pytest.MonkeyPatch.context() as patch:
                if elastic:
                    patch.setattr(pictures, "draw_drag", lambda *_: None)
                    patch.setattr(pictures, "draw_flow", lambda *_: None)
                made[shape, elastic] = run(case, tmp_path_factory.mktemp("run") / "out", ranks=1)
        return made[shape, elastic]

    return get


def table_of(folder: Path, number: int) -> dict[str, np.ndarray]:
    """The series of a packing, from 1, by the names in its head."""
    path = folder / f"packing-{number:03d}" / "series.csv"
    names = path.read_text().splitlines()[0].split(",")
    return dict(zip(names, np.loadtxt(path, delimiter=",", skiprows=1).T, strict=True))


def frames_of(folder: Path, number: int) -> dict[str, np.ndarray]:
    with np.load(folder / f"packing-{number:03d}" / "frames.npz") as file:
        return {name: file[name] for name in file.files}


def bed_at(folder: Path, number: int, frame: int) -> Bed:
    """The bed of a packing, from 1, as it was at a frame, without spins or springs."""
    bed, frames = read_bed(folder / f"packing-{number:03d}"), frames_of(folder, number)
    for name in ("position", "angle", "velocity"):
        getattr(bed, name)[:] = frames[name][frame]
    return bed


def record_of(folder: Path) -> dict[str, Any]:
    return json.loads((folder / "result.json").read_text())


def naive(folder: Path, scene: Drag2DScene) -> dict[str, list[float]]:
    """The mean of each packing, straight from the definitions."""
    found: dict[str, list[float]] = {name: [] for name in QUANTITIES if name != "drag_deviation"}
    length = {"height": scene.height, "width": scene.box.width}
    area = {wall: length[side] * scene.box.thickness for wall, side in WALLS.items()}
    for number in range(1, scene.ensemble.runs + 1):
        table = table_of(folder, number)
        late = [k for k, t in enumerate(table["time"]) if 2.0 * t > 0.5e-3]
        found["drag"].append(sum(table["drag"][k] for k in late) / len(late))
        found["lift"].append(sum(table["lift"][k] for k in late) / len(late))
        spread = [(table["drag"][k] - found["drag"][-1]) ** 2 for k in late]
        found["drag_fluctuation"].append(sqrt(sum(spread) / len(late)))
        found["rest_pressure"].append(sum(table[wall][0] / area[wall] for wall in WALLS) / 4.0)
        for wall in WALLS:
            mean = sum(table[wall][k] for k in late) / len(late)
            found[f"pressure_{wall}"].append(mean / area[wall])
        found["overlap_ratio"].append(max(table["overlap"]))
        place = frames_of(folder, number)["position"][:, :-1]
        found["irregularity"].append(not_affine(place[0], place[-1], 2.5e-3) / 1e-3)
    return found


def not_affine(before: np.ndarray, after: np.ndarray, reach: float) -> float:
    """What is left of the grains' motion about each other, in a plain loop over the grains."""
    left = []
    for i in range(len(before)):
        old, new = before - before[i], after - after[i]
        near = (np.hypot(*old.T) < reach) & (np.arange(len(old)) != i)
        if near.sum() >= 3:
            best = np.linalg.pinv(old[near]) @ new[near]
            left.append(((new[near] - old[near] @ best) ** 2).sum(axis=1).mean())
    return sqrt(sum(left) / len(left))


@each_shape
class TestEachShape:
    def test_record_has_the_keys_of_every_run(self, shape: str, result_of):
        record = record_of(result_of(shape).folder)
        assert set(KEYS) <= set(record)
        assert (record["status"], record["scene"], record["case"]) == ("finished", "drag2d", "tiny")
        assert (record["seed"], record["stopped_by"], record["grains"]) == (1, "distance", 61)
        assert record["engine"]["name"] == "dem"
        assert record["engine"]["version"]
        assert {name: one["unit"] for name, one in record["quantities"].items()} == QUANTITIES
        assert all(set(one) == PARTS for one in record["quantities"].values())
        assert record["alarms"] == []
        assert re.fullmatch("[0-9a-f]{64}", record["provenance"]["deck_sha256"])
        assert record == dict(result_of(shape).record)

    def test_work_is_counted_over_all_packings(self, shape: str, result_of):
        result = result_of(shape)
        rows = sum(len(table_of(result.folder, number)["time"]) for number in (1, 2, 3))
        assert result.record["steps"] == rows * scene_rows(result.folder)
        assert 0.0 < result.record["cpu_s"] <= result.record["wall_s"]
        assert result.record["grain_steps_per_s"] > 61 * result.record["steps"] / 60.0

    def test_quantities_are_means_over_the_packings_with_the_errors_of_their_scatter(
        self, shape: str, result_of
    ):
        found = result_of(shape).quantities
        for name, values in naive(result_of(shape).folder, tiny_of(shape).scene).items():
            mean = sum(values) / 3.0
            error = sqrt(sum((value - mean) ** 2 for value in values) / 2.0 / 3.0)
            assert found[name].mean == pytest.approx(mean, rel=1e-9)
            assert found[name].standard_error == pytest.approx(error, rel=1e-6)
            assert found[name].n_independent == 3
            assert not found[name].converged
        deviation = found["drag"].standard_error * sqrt(3.0)
        assert found["drag_deviation"].mean == pytest.approx(deviation)
        assert found["drag_deviation"].standard_error == pytest.approx(deviation / 2.0)

    def test_tables_hold_the_packings_and_their_mean(self, shape: str, result_of):
        folder = result_of(shape).folder
        each = read_csv(folder / "packings.csv")
        assert each.pop("packing").tolist() == [1, 2, 3]
        values = naive(folder, tiny_of(shape).scene)
        assert list(each) == [f"{name} ({QUANTITIES[name]})" for name in values]
        for column, value in zip(each.values(), values.values(), strict=True):
            assert column == pytest.approx(value, rel=1e-9)
        tables = [table_of(folder, number) for number in (1, 2, 3)]
        mean = read_csv(folder / "drag.csv")
        drags = np.array([table["drag"] for table in tables])
        assert mean["displacement (m)"] == pytest.approx(2.0 * tables[0]["time"])
        assert mean["drag (N)"] == pytest.approx(drags.mean(axis=0))
        error = drags.std(axis=0, ddof=1) / sqrt(3.0)
        assert mean["drag standard error (N)"] == pytest.approx(error)
        top = np.mean([table["top"] for table in tables], axis=0)
        assert mean["top (N)"] == pytest.approx(top)

    def test_series_ends_at_the_distance(self, shape: str, result_of):
        folder = result_of(shape).folder
        for number in (1, 2, 3):
            time = table_of(folder, number)["time"]
            assert len(time) == 240
            assert time == pytest.approx(np.arange(1, 241) * 0.75e-3 / 240, rel=1e-9)
            frames = frames_of(folder, number)
            assert frames["time"] == pytest.approx(np.linspace(0.0, 0.75e-3, 5), rel=1e-9)
            way = frames["position"][:, -1] - frames["position"][0, -1]
            assert way == pytest.approx(
                np.column_stack([np.zeros(5), 2.0 * frames["time"]]), abs=1e-15
            )

    def test_pictures_are_pictures(self, shape: str, result_of):
        for name in ("drag.png", "flow.png"):
            picture = (result_of(shape).folder / name).read_bytes()
            assert picture.startswith(b"\x89PNG")
            assert len(picture) > 10_000

    def test_walls_and_cylinder_give_the_grains_their_momentum(self, shape: str, result_of):
        """Elastic and without friction, forces depend on places alone, and walls push straight.

        Velocity Verlet: the first and the last step of a stretch count half.
        """
        folder = result_of(shape, elastic=True).folder
        law = law_of(scene_of(tiny_of(shape, grains=ELASTIC)))
        table, frames = table_of(folder, 1), frames_of(folder, 1)
        mass = read_bed(folder / "packing-001").mass[:-1, None]
        push = np.column_stack([table["left"] - table["right"], table["bottom"] - table["top"]])
        push += np.column_stack([-table["lift"], table["drag"]])
        every, step = scene_rows(folder), table["time"][0] / scene_rows(folder)
        for k in range(4):
            ends = [
                forces(bed_at(folder, 1, frame), law)[:-1, :2].sum(axis=0) for frame in (k, k + 1)
            ]
            impulse = step * every * push[60 * k : 60 * k + 60].sum(axis=0)
            impulse += step * (ends[0] - ends[1]) / 2.0
            gained = (mass * (frames["velocity"][k + 1] - frames["velocity"][k])[:-1]).sum(axis=0)
            gross = step * every * abs(push[60 * k : 60 * k + 60]).sum(axis=0)
            assert gained == pytest.approx(impulse, abs=1e-9 * gross.max())
            assert abs(gained).max() > 1e-3 * gross.max()

    def test_work_of_the_cylinder_is_the_energy_of_the_grains(self, shape: str, result_of):
        """Elastic and without friction, to an error of the time step."""
        folder = result_of(shape, elastic=True).folder
        for number in (1, 2, 3):
            table = table_of(folder, number)
            energy, interval = table["kinetic"] + table["elastic"], table["time"][0]
            work = 2.0 * interval * np.cumsum(table["drag"])
            gained = energy - energy[0]
            assert gained[-1] > 0.5 * energy[0]
            assert gained == pytest.approx(work - work[0], abs=0.005 * gained[-1])


def scene_rows(folder: Path) -> int:
    """Steps of a row, as the deck has it."""
    return int(re.search(r"row_every = (\d+)", (folder / "packing-001/deck.toml").read_text())[1])


def read_csv(path: Path) -> dict[str, np.ndarray]:
    names = path.read_text().splitlines()[0].split(",")
    return dict(zip(names, np.loadtxt(path, delimiter=",", skiprows=1).T, strict=True))


def copy_of(result: Result, folder: Path) -> Path:
    shutil.copytree(result.folder, folder / "copy")
    return folder / "copy"


def test_analyze_gives_the_same_answers_again(result_of, tmp_path):
    """And draws and tabulates them again, to the bit."""
    first = result_of("dumbbell")
    folder = copy_of(first, tmp_path)
    for name in ("drag.csv", "packings.csv", "drag.png", "flow.png"):
        (folder / name).unlink()
    assert analyze(folder).quantities == first.quantities
    for name in ("drag.csv", "packings.csv"):
        assert (folder / name).read_bytes() == (first.folder / name).read_bytes()
    assert (folder / "flow.png").exists()
    assert record_of(folder) == record_of(first.folder)


def test_kinetic_energy_is_that_of_the_frames(result_of):
    """Discs without friction do not spin."""
    folder = result_of("disc", elastic=True).folder
    table, frames = table_of(folder, 2), frames_of(folder, 2)
    mass = read_bed(folder / "packing-002").mass[:-1]
    for k in (1, 2, 3, 4):
        speed = frames["velocity"][k][:-1]
        energy = 0.5 * (mass * (speed**2).sum(axis=1)).sum()
        assert table["kinetic"][60 * k - 1] == pytest.approx(energy, rel=1e-6)


def test_rest_pressure_is_that_of_hertz_at_the_walls_of_the_packing(result_of):
    """The grains have hardly moved in the first row, and not at all along the walls."""
    scene, found = tiny().scene, []
    law = law_of(scene)
    for number in (1, 2, 3):
        bed = read_bed(result_of("disc").folder / f"packing-{number:03d}")
        (x, y), radius = bed.position[:-1].T, bed.radius[:-1]
        for gap, side in ((x, scene.height), (8e-3 - x, scene.height)):
            found.append(wall_push(law.stiffness, radius, gap) / (side * 0.01))
        for gap in (y, scene.height - y):
            found.append(wall_push(law.stiffness, radius, gap) / (8e-3 * 0.01))
    mean = result_of("disc").quantities["rest_pressure"].mean
    assert mean == pytest.approx(np.mean(found), rel=0.02)


def wall_push(stiffness: float, radius: np.ndarray, gap: np.ndarray) -> float:
    """Force (N) of discs whose centres are this far from a wall."""
    depth = np.maximum(radius - gap, 0.0)
    return float((stiffness * np.sqrt(radius) * depth**1.5).sum())


def test_few_packings_and_soft_grains_are_warned_about(result_of):
    few, soft = result_of("disc").warnings
    assert few.startswith("NOT CONVERGED: 3 packings are too few")
    assert soft.startswith("Soft grains: the deepest overlap is 0.")
    deepest = max(max(table_of(result_of("disc").folder, n)["overlap"]) for n in (1, 2, 3))
    assert f"is {deepest:.2g} of the smaller radius" in soft


def bytes_of(folder: Path, *names: str) -> list[bytes]:
    """The content of these files of each packing."""
    return [(folder / f"packing-00{n}" / name).read_bytes() for n in (1, 2, 3) for name in names]


BITS = ("bed.npz", "deck.toml", "series.csv", "frames.npz")


def test_same_seed_gives_the_same_bits_whatever_the_workers(result_of, tmp_path):
    first, again = result_of("disc"), run(tiny(), tmp_path / "out", ranks=3)
    assert bytes_of(again.folder, *BITS) == bytes_of(first.folder, *BITS)
    assert again.quantities == first.quantities
    digests = [r.record["provenance"]["deck_sha256"] for r in (again, first)]
    assert digests[0] == digests[1]


def test_other_seed_gives_other_packings(result_of, tmp_path):
    first, other = result_of("disc"), run(tiny().set("seed", 2), tmp_path / "out", ranks=1)
    beds = [bed_at(r.folder, n, 0).position for r in (first, other) for n in (1, 2, 3)]
    for k, one in enumerate(beds):
        for another in beds[:k]:
            assert abs(one - another).max() > 0.1e-3
    assert other.quantities["drag"].mean != first.quantities["drag"].mean


@pytest.mark.parametrize("ranks", [0, -1, 100_000])
def test_workers_out_of_range_are_refused(ranks: int, tmp_path):
    with pytest.raises(InputError, match="--ranks"):
        run(tiny(), tmp_path / "out", ranks=ranks)
    assert not (tmp_path / "out").exists()


def command(*words: str | Path, folder: Path) -> subprocess.CompletedProcess[str]:
    """A module of Python with its arguments, run in the folder."""
    return subprocess.run(
        [sys.executable, "-m", *map(str, words)],
        capture_output=True,
        text=True,
        cwd=folder,
        timeout=300,
        check=False,
    )


@pytest.fixture(scope="module")
def typed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder in which the tiny bed was run, and its decks written and run by hand."""
    folder = tmp_path_factory.mktemp("typed")
    (folder / "tiny.toml").write_text(TINY)
    for words in (
        ("liftdrag", "run", "tiny.toml", "--ranks", "2"),
        ("liftdrag", "build-deck", "tiny.toml", "--out", "deck"),
        ("liftdrag.engines.dem", "deck"),
    ):
        done = command(*words, folder=folder)
        assert done.returncode == 0, done.stderr
        (folder / f"{words[0]} {words[1]}.txt").write_text(done.stdout)
    return folder


class TestTyped:
    def test_run_answers_with_a_table_and_leaves_its_files(self, typed: Path, result_of):
        said = (typed / "liftdrag run.txt").read_text()
        assert "drag_fluctuation" in said
        assert "WARNING: NOT CONVERGED" in said
        assert said.endswith(
            "In runs/tiny: result.json, drag.csv, packings.csv, drag.png, flow.png\n"
        )
        assert bytes_of(typed / "runs/tiny", *BITS) == bytes_of(result_of("disc").folder, *BITS)

    def test_decks_run_by_hand_give_the_series_of_the_run(self, typed: Path):
        said = (typed / "liftdrag build-deck.txt").read_text()
        assert said.startswith("box_height")
        assert said.endswith("cd deck && python -m liftdrag.engines.dem .\n")
        assert bytes_of(typed / "deck", *BITS) == bytes_of(typed / "runs/tiny", *BITS)
        lines = (typed / "liftdrag.engines.dem deck.txt").read_text().splitlines()
        assert [line.split(": ")[1].split(", ")[0] for line in lines] == ["finished"] * 3

    def test_analyze_prints_what_the_run_wrote(self, typed: Path):
        done = command("liftdrag", "analyze", "runs/tiny", "--json", folder=typed)
        assert done.returncode == 0, done.stderr
        assert json.loads(done.stdout) == record_of(typed / "runs/tiny")

    def test_time_step_edited_to_be_too_large_never_passes(self, typed: Path, tmp_path, capsys):
        """Fifty times larger: it ends with a reason, and status 1; the others do run."""
        shutil.copytree(typed / "deck", tmp_path / "deck")
        deck = tmp_path / "deck/packing-002/deck.toml"
        step = re.search(r"time_step = (\S+)", deck.read_text())[1]
        deck.write_text(deck.read_text().replace(step, repr(50.0 * float(step))))
        assert main([str(tmp_path / "deck")]) == 1
        said = capsys.readouterr()
        one, two, three = said.out.splitlines()
        assert re.search(
            r"deck/packing-002: (overlap_exceeded|not_finite|lost_grains), \d+ steps", two
        )
        assert "finished" in one
        assert "finished" in three
        (reason,) = said.err.splitlines()
        assert "a smaller numerics.time_step" in reason
        assert "deepest overlap" in reason

    @pytest.mark.parametrize("words", [[], ["nowhere"], ["."]])
    def test_folder_without_a_deck_is_one_sentence(
        self, words: list[str], tmp_path, monkeypatch, capsys
    ):
        monkeypatch.chdir(tmp_path)
        assert main(words) == 2
        assert len(capsys.readouterr().err.splitlines()) == 1

    @pytest.mark.parametrize(
        "damage", ["no text", "no steps", "wrong type", "no bed", "half a bed"]
    )
    def test_damaged_deck_is_one_sentence(self, typed: Path, tmp_path, damage: str, capsys):
        folder = tmp_path / "deck"
        shutil.copytree(typed / "deck/packing-001", folder)
        deck, bed = folder / "deck.toml", folder / "bed.npz"
        text, content = deck.read_text(), bed.read_bytes()
        if damage == "no text":
            deck.write_bytes(b"\xff\xfe")
        if damage == "no steps":
            deck.write_text(re.sub(r"\nsteps = .*", "", text))
        if damage == "wrong type":
            deck.write_text(re.sub(r"\nsteps = .*", '\nsteps = "many"', text))
        if damage == "no bed":
            bed.unlink()
        if damage == "half a bed":
            bed.write_bytes(content[: len(content) // 2])
        assert main([str(folder)]) == 2
        assert len(capsys.readouterr().err.splitlines()) == 1


def damage(folder: Path, kind: str) -> None:
    """Damage a file of the second packing."""
    file, how = kind.split(": ")
    path = folder / "packing-002" / file
    content = path.read_bytes()
    if how == "gone":
        path.unlink()
        return
    lines = content.splitlines(keepends=True)
    path.write_bytes(
        {
            "empty": b"",
            "garbage": b"\x00\x01 no such thing",
            "half": content[: len(content) // 2],
            "rows cut": b"".join(lines[:100]),
            "no rows": lines[0],
            "a word": content.replace(lines[5], b"1,2,word\n"),
            "not a number": content.replace(lines[5], b",".join([b"nan"] * 10) + b"\n"),
        }[how]
    )


DAMAGES = [
    *(f"series.csv: {how}" for how in ("gone", "empty", "half", "rows cut", "no rows", "a word")),
    "series.csv: not a number",
    *(f"frames.npz: {how}" for how in ("gone", "empty", "half", "garbage")),
    *(f"bed.npz: {how}" for how in ("gone", "empty", "half", "garbage")),
]


@pytest.mark.parametrize("kind", DAMAGES)
@pytest.mark.filterwarnings("error::UserWarning", "error::RuntimeWarning")
def test_damaged_folder_is_one_sentence(kind: str, result_of, tmp_path):
    folder = copy_of(result_of("disc"), tmp_path)
    damage(folder, kind)
    with pytest.raises(InputError) as caught:
        analyze(folder)
    assert "packing-002" in str(caught.value)
    assert len(str(caught.value).splitlines()) == 1


def test_damaged_folder_ends_analyze_with_status_2(result_of, tmp_path):
    damage(copy_of(result_of("disc"), tmp_path), "frames.npz: half")
    done = command("liftdrag", "analyze", "copy", folder=tmp_path)
    assert done.returncode == 2
    assert len(done.stderr.splitlines()) == 1


def test_grains_too_soft_fail_the_run_with_a_status_and_a_reason(tmp_path):
    (tmp_path / "tiny.toml").write_text(TINY)
    words = ("--set", "grains.youngs_modulus=10 kPa", "--out", "out", "--ranks", "1")
    done = command("liftdrag", "run", "tiny.toml", *words, folder=tmp_path)
    assert done.returncode == 1
    assert "Traceback" not in done.stderr
    reason = "overlap_exceeded: packing 1: two grains overlap by more than the radius"
    assert reason in done.stderr
    record = record_of(tmp_path / "out")
    assert record["status"] == record["stopped_by"] == "overlap_exceeded"
    assert record["quantities"] == {}
    assert 0 < record["steps"] < 240
    assert record["warnings"][0].startswith("packing 1: two grains overlap by more")
    assert not (tmp_path / "out" / "packing-003" / "series.csv").exists()
    with pytest.raises(InputError, match="did not finish"):
        analyze(tmp_path / "out")


def test_failure_reaches_python_with_its_evidence(tmp_path):
    case = tiny(grains={"youngs_modulus": "10 kPa"})
    with pytest.raises(RunFailed) as caught:
        run(case, tmp_path / "out", ranks=1)
    assert caught.value.status == "overlap_exceeded"
    assert re.match(r"stopped after step \d+, the deepest overlap 1", caught.value.evidence)


LONG = TINY.replace("2 m/s", "0.02 m/s")
"""The same bed, pulled slowly: small steps make it take some ten seconds a packing."""


def wait_for(condition: Callable[[], bool], patience_s: float = 120.0) -> None:
    end = time.monotonic() + patience_s
    while not condition():
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.05)


def processes_of(folder: Path) -> list[int]:
    """Processes whose command line names the folder."""
    found = []
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit() and int(entry.name) != os.getpid():
            try:
                words = (entry / "cmdline").read_bytes()
            except OSError:
                continue
            if str(folder).encode() in words:
                found.append(int(entry.name))
    return found


@pytest.mark.parametrize(
    ("name", "file", "step"), [("dem", "deck.toml", "100 ns"), ("lammps", "log.lammps", "200 ns")]
)
def test_an_interrupt_stops_every_packing_and_says_so(name: str, file: str, step: str, tmp_path):
    (tmp_path / "tiny.toml").write_text(LONG)
    words = [sys.executable, "-m", "liftdrag", "run", str(tmp_path / "tiny.toml")]
    words += [
        "--set",
        f"numerics.time_step={step}",
        "--engine",
        name,
        "--ranks",
        "2",
        "--out",
        str(tmp_path / "out"),
    ]
    process = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    running = tmp_path / "out" / "packing-001" / file
    wait_for(lambda: running.exists() or process.poll() is not None)
    time.sleep(0.5)
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 1
    assert b"interrupted" in errors
    assert b"Traceback" not in errors
    assert record_of(tmp_path / "out")["status"] == "killed"
    assert processes_of(tmp_path) == []
    with pytest.raises(InputError, match="did not finish"):
        analyze(tmp_path / "out")


def test_derived_step_holds_where_the_pull_is_slow_and_the_grains_are_light():
    """Against a quarter of it: there a step of 0.02 Hertz times made kinetic energy of nothing."""
    slow = {"speed": "1 mm/s", "distance": "0.02 mm", "average_from": "4 um"}
    scene = scene_of(tiny(box={"thickness": "1 mm"}, drive=slow))
    step, bed = derive(scene).time_step.value, packed(scene, 0)

    def pulled(share: float) -> tuple[float, float]:
        rows, every = 20, round(1e-3 / (share * step))
        run = advance(bed, law_of(scene), share * step, rows, every, watched=len(bed.mass) - 1)
        return float(run.force[:, 1].mean()), float(run.kinetic[-1])

    coarse, fine = pulled(1.0), pulled(0.25)
    assert coarse == pytest.approx(fine, rel=1e-3)
