"""Studies: many runs, finished once, and what they claim."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from liftdrag.analysis.claims import difference
from liftdrag.case import load
from liftdrag.cli import app
from liftdrag.errors import InputError
from liftdrag.study import packaged, read, sweep

STUDY = """
title = "Two shapes"
[set]
"grains.count" = 60
"box.width" = "8 mm"
"intruder.diameter" = "2 mm"
"intruder.start" = "3 mm"
"drive.distance" = "1 mm"
"drive.average_from" = "0.2 mm"
"ensemble.runs" = 3
[runs.round]
case = "zhou/c1"
[runs.pairs]
case = "zhou/d1"
set = { seed = 2 }
[[claims]]
says = "dumbbells drag more"
larger = "pairs"
smaller = "round"
[[claims]]
says = "the same within a factor of ten"
larger = "pairs"
smaller = "round"
within = 9.0
[[pictures]]
file = "both.png"
title = "both"
groups = [["round", "pairs"]]
"""


@pytest.fixture
def study(tmp_path: Path) -> Path:
    file = tmp_path / "two.study"
    file.write_text(STUDY)
    return file


def test_sweep_runs_once_and_weighs_the_claims(study: Path, tmp_path: Path):
    """The claims are those of the tables that the runs wrote; the second time nothing runs."""
    out = tmp_path / "out"
    found = sweep(str(study), out)
    drags = {
        name: pd.read_csv(out / name / "packings.csv")["drag (N)"].to_numpy()
        for name in ("round", "pairs")
    }
    assert found.findings[0][1] == difference(drags["pairs"], drags["round"], "N")
    assert found.results["round"].quantities["drag"].mean == pytest.approx(drags["round"].mean())
    claims = pd.read_csv(out / "claims.csv")
    assert list(claims["size"]) == pytest.approx([f.size for _, f in found.findings])
    assert (out / "both.png").read_bytes().startswith(b"\x89PNG")
    written = {file: file.stat().st_mtime_ns for file in out.glob("*/packing-*/series.csv")}
    again = sweep(str(study), out)
    assert len(written) == 6
    assert written == {f: f.stat().st_mtime_ns for f in out.glob("*/packing-*/series.csv")}
    assert again.findings == found.findings


def test_folder_of_another_run_is_refused_and_kept(study: Path, tmp_path: Path):
    out = tmp_path / "out"
    sweep(str(study), out)
    before = (out / "round" / "result.json").read_text()
    with pytest.raises(InputError, match="holds another run"):
        sweep(str(study), out, ["ensemble.runs=2"])
    assert (out / "round" / "result.json").read_text() == before


def test_run_that_did_not_finish_is_named(study: Path, tmp_path: Path):
    out = tmp_path / "out"
    sweep(str(study), out)
    result = out / "pairs" / "result.json"
    result.write_text(json.dumps(json.loads(result.read_text()) | {"status": "killed"}))
    with pytest.raises(InputError, match="did not finish"):
        sweep(str(study), out)


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ('larger = "pairs"', 'larger = "triples"', "triples"),
        ('case = "zhou/c1"', 'case = "zhou/c9"', "zhou/c9"),
        ('file = "both.png"', 'file = "../both.png"', "pictures.0.file"),
        ("[runs.pairs]", "[runs.'../pairs']", "runs"),
        ("[runs.pairs]", "[runs.'..']", "runs"),
        ("[runs.pairs]", "[runs.'runs.csv']", "runs"),
        ("within = 9.0", 'quantity = "zzz"', "claims.1.quantity"),
        ('case = "zhou/d1"', 'case = "quick"', "grains.count"),
        ('title = "Two shapes"', "", "title"),
        ("[set]", "[set", "not TOML"),
        ('"ensemble.runs" = 3', '"ensemble.runs" = 1', "ensemble.runs"),
    ],
)
def test_bad_study_is_refused_before_anything_runs(
    study: Path, tmp_path: Path, old: str, new: str, says: str
):
    study.write_text(STUDY.replace(old, new))
    out = tmp_path / "out"
    with pytest.raises(InputError, match=says.replace(".", r"\.")):
        sweep(str(study), out)
    assert not out.exists()


def test_study_that_does_not_exist_is_refused():
    with pytest.raises(InputError, match="zhou/tables"):
        read("zhou/table")


def test_packaged_studies_name_cases_that_load():
    names = sorted(packaged())
    zhou = ["zhou/contact", "zhou/tables", "zhou/tables-20mm"]
    assert names == ["janssen/mu_wall", "liu2020/rods-and-disks", *zhou]
    for name in names:
        plan = read(name)
        seeds = [one.set["seed"] for one in plan.runs.values()]
        assert len(set(seeds)) == len(seeds)
        for one in plan.runs.values():
            case = load(one.case)
            for key, value in (plan.set | one.set).items():
                case = case.set(key, value)
            if name.startswith("zhou/"):
                assert case.scene.ensemble.runs == 40
            else:
                assert case.scene.scene == ("janssen" if name.startswith("janssen/") else "shear")


def test_command_line_prints_runs_and_claims(study: Path, tmp_path: Path):
    shown = CliRunner().invoke(app, ["sweep", str(study), "--out", str(tmp_path / "out")])
    assert shown.exit_code == 0
    assert "dumbbells drag more" in shown.output
    assert np.all([name in shown.output for name in ("round", "pairs", "claims.csv")])


def test_study_under_a_launcher_is_refused(study: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("PMI_SIZE", "2")
    monkeypatch.setenv("PMI_RANK", "0")
    with pytest.raises(InputError, match="without mpiexec"):
        sweep(str(study))
