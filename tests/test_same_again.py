"""What is answered again from the stored series is what was answered, to the byte."""

from __future__ import annotations

import json
import shutil

import pytest
from conftest import tiny_tank
from test_drag2d_scene import tiny as tiny_bed
from test_janssen_scene import tiny as tiny_tube

from liftdrag.runner import analyze, run

SCENES = {
    "tank": (tiny_tank(), "lammps"),
    "bed": (tiny_bed(), "dem"),
    "tube": (tiny_tube(), "dem"),
}


@pytest.mark.parametrize(
    "name", ["tank", *(pytest.param(name, marks=pytest.mark.validate) for name in ("bed", "tube"))]
)
def test_analyze_writes_the_same_result_again(name, tmp_path):
    case, engine = SCENES[name]
    folder = run(case, tmp_path / "run", engine).folder
    result = (folder / "result.json").read_bytes()
    tables = {file.name: file.read_bytes() for file in folder.glob("*.csv")}
    for place in (folder, shutil.copytree(folder, tmp_path / "moved")):
        for table in tables.keys() - {"fills.csv", "forces.csv"}:
            (place / table).unlink()
        analyze(place)
        assert (place / "result.json").read_bytes() == result
        assert {file.name: file.read_bytes() for file in place.glob("*.csv")} == tables
    made = json.loads(result)["provenance"]
    assert {"engine", "deck_sha256", "deck_files", "packages", "machine", "probes"} <= made.keys()
    assert made["engine"]["name"] == engine
    assert {"version", "path", "mpi", "sha256"} <= made["engine"].keys()
