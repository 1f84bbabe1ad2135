"""Studies: many runs, finished once, and what they claim."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from liftdrag.analysis.claims import difference
from liftdrag.cli import app
from liftdrag.engines.mpi import mpiexec
from liftdrag.errors import InputError, RunFailed
from liftdrag.study import packaged, read, sweep
from liftdrag.study.points import points_of
from liftdrag.study.pool import Watch
from liftdrag.study.state import states_of
from liftdrag.study.swept import begin
from liftdrag.study.tasks import tasks_of

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


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of the study, carried out once."""
    folder = tmp_path_factory.mktemp("study")
    (folder / "two.study").write_text(STUDY)
    sweep(str(folder / "two.study"), folder / "out")
    return folder / "out"


@pytest.fixture
def out(finished: Path, tmp_path: Path) -> Path:
    """A copy of that folder."""
    return shutil.copytree(finished, tmp_path / "out")


def run_in(out: Path, name: str) -> Path:
    """The folder of the run of this name."""
    (found,) = (out / "runs").glob(f"{name}-*")
    return found


def written(out: Path) -> dict[Path, int]:
    """When each series was written."""
    return {file: file.stat().st_mtime_ns for file in out.glob("runs/*/packing-*/series.csv")}


def test_sweep_weighs_the_claims_by_the_tables_that_the_runs_wrote(study: Path, out: Path):
    found = sweep(str(study), out)
    drags = {
        name: pd.read_csv(run_in(out, name) / "packings.csv")["drag (N)"].to_numpy()
        for name in ("round", "pairs")
    }
    assert found.findings[0][1] == difference(drags["pairs"], drags["round"], "N")
    assert found.results["round"].quantities["drag"].mean == pytest.approx(drags["round"].mean())
    claims = pd.read_csv(out / "claims.csv")
    assert list(claims["size"]) == pytest.approx([f.size for _, f in found.findings])
    assert (out / "both.png").read_bytes().startswith(b"\x89PNG")


def test_what_has_finished_is_not_run_again_whatever_its_name_and_place(study: Path, out: Path):
    before = written(out)
    lines = list[str]()
    two, three = STUDY.index("[runs.round]"), STUDY.index("[runs.pairs]")
    end = STUDY.index("[[claims]]")
    swapped = STUDY[:two] + STUDY[three:end] + STUDY[two:three] + STUDY[end:]
    study.write_text(swapped.replace("pairs", "twins"))
    found = sweep(str(study), out, watch=Watch(say=lines.append))
    assert len(before) == 6
    assert written(out) == before
    assert lines == []
    assert found.results["twins"].folder == run_in(out, "pairs")


def test_another_setting_is_another_run(study: Path, out: Path):
    same, other = (begin(str(study), out, given, None) for given in ([], ["ensemble.runs=2"]))
    states = [states_of(one.tasks.values(), out).values() for one in (same, other)]
    assert [[one.status for one in group] for group in states] == [
        ["finished", "finished"],
        ["missing", "missing"],
    ]


def test_run_that_was_cut_short_goes_on_where_it_was(study: Path, out: Path):
    """Of the packings only that which had not ended is run, and the answer is the same."""
    before, folder = written(out), run_in(out, "pairs")
    drag = json.loads((folder / "result.json").read_text())["quantities"]["drag"]["mean"]
    (folder / "result.json").unlink()
    (folder / "packing-002" / "outcome.json").unlink()
    found = sweep(str(study), out)
    changed = [file.parent.name for file, at in written(out).items() if at != before[file]]
    assert changed == ["packing-002"]
    assert found.results["pairs"].quantities["drag"].mean == drag


def test_run_that_failed_is_named_and_the_others_are_there(study: Path, out: Path):
    """Not even a file where the folder of a run should be stops the other run."""
    folder = run_in(out, "pairs")
    shutil.rmtree(folder)
    folder.write_text("")
    found = sweep(str(study), out)
    with pytest.raises(RunFailed, match=r"1 of 2 .*\npairs: NotADirectoryError"):
        found.check()
    assert found.results["round"].status == "finished"
    assert found.findings == []
    rows = pd.read_csv(out / "points.csv").set_index("point")
    assert rows.loc["pairs", "status"] == "failed"


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


SCENE_OF = {"guillard2014": "tank", "janssen": "janssen", "liu2020": "shear", "zhou": "drag2d"}


@pytest.mark.parametrize("name", sorted(packaged()))
def test_packaged_study_is_a_good_one_at_every_scale(name: str):
    """Each run has seeds of its own, so that none is like another by chance."""
    plan = read(name)
    for scale in plan.scales or [None]:
        points = points_of(plan, scale, [])
        assert {point.case.scene.scene for point in points.values()} == {
            SCENE_OF[name.partition("/")[0]]
        }
        tasks = [task for point in points.values() for task in tasks_of(point)]
        assert len({task.digest for task in tasks}) == len(tasks)


def test_packaged_studies_are_those_of_the_papers():
    assert {name.partition("/")[0] for name in packaged()} == set(SCENE_OF)


def test_command_line_prints_points_and_claims(study: Path, out: Path):
    shown = CliRunner().invoke(app, ["sweep", str(study), "--out", str(out)])
    assert shown.exit_code == 0
    assert "dumbbells drag more" in shown.output
    assert np.all([name in shown.output for name in ("round", "pairs", "claims.csv")])


def test_ranks_of_an_mpi_job_share_the_runs(study: Path, out: Path):
    """One rank hands out, another runs; the run does not take itself for a rank of the job."""
    shutil.rmtree(run_in(out, "pairs"))
    words = [str(mpiexec()), "-n", "2", sys.executable, "-m", "liftdrag", "sweep", str(study)]
    done = subprocess.run([*words, "--out", str(out)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("points.csv") == 1
    assert done.stderr == "pairs: finished (1 of 1)\n"


def test_jobs_under_a_launcher_are_refused(study: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("PMI_SIZE", "2")
    monkeypatch.setenv("PMI_RANK", "0")
    with pytest.raises(InputError, match="leave out --jobs"):
        sweep(str(study), jobs=2)
