"""A finished run is sealed: what its engine wrote is what its answers come from."""

from __future__ import annotations

import hashlib
import json
import shutil
from pathlib import Path

import pytest
from conftest import tiny_tank
from test_drag2d_scene import tiny as tiny_bed

from liftdrag.errors import InputError
from liftdrag.folder import RECORD, RESULT, Record
from liftdrag.runner import analyze, run
from liftdrag.seal import check

SHORT = tiny_tank(drive={"distance": "6 D"})
BED = tiny_bed().set("ensemble.runs", 2)


@pytest.fixture(scope="module")
def runs(tmp_path_factory) -> dict[str, Path]:
    """The folders of a tank and of an ensemble."""
    place = tmp_path_factory.mktemp("sealed")
    return {
        "tank": run(SHORT, place / "tank", "lammps").folder,
        "bed": run(BED, place / "bed", "dem", 1).folder,
    }


@pytest.mark.parametrize("name", ["tank", "bed"])
def test_the_digests_are_those_of_the_files_and_their_answer_is_bit_for_bit(name, runs):
    folder = runs[name]
    before = (folder / RESULT).read_bytes()
    sealed = json.loads(before)["sealed"]
    expected = {"forces.dat", "bed.dat", "surface.dump", "snapshots.dump", "settled.dump"}
    if name == "bed":
        expected = {p.relative_to(folder).as_posix() for p in folder.glob("packing-*/series.csv")}
    assert expected <= sealed.keys()
    for file, digest in sealed.items() - {(RECORD, sealed[RECORD])}:
        assert digest == hashlib.sha256((folder / file).read_bytes()).hexdigest()
    analyze(folder)
    assert (folder / RESULT).read_bytes() == before


@pytest.mark.parametrize(
    "file", ["forces.dat", "snapshots.dump", "in.tank", "packing-002/series.csv", "gone"]
)
def test_a_changed_digit_is_refused_in_a_sentence(file, runs, tmp_path):
    folder = shutil.copytree(runs["bed" if "/" in file else "tank"], tmp_path / "run")
    if file == "gone":
        (folder / "settled.dump").unlink()
        file = "settled.dump"
    else:
        content = (folder / file).read_text()
        place = next(k for k in range(len(content) // 2, len(content)) if content[k].isdigit())
        digit = "4" if content[place] != "4" else "5"
        (folder / file).write_text(content[:place] + digit + content[place + 1 :])
    with pytest.raises(InputError) as caught:
        analyze(folder)
    what = f"({file} is not what the run wrote); run the case again."
    assert str(caught.value) == f"The files in {folder} are damaged {what}"


@pytest.mark.parametrize("sealed", [[], {"../x": ""}, "a"])
def test_a_wrong_seal_is_refused_and_a_run_of_before_is_read(sealed, runs, tmp_path):
    folder = shutil.copytree(runs["tank"], tmp_path / "run")
    with pytest.raises(InputError, match="run the case again"):
        check(folder, Record.read(folder), sealed)
    check(folder, Record.read(folder), None)


@pytest.mark.parametrize("key", [("tables", "seed"), ("plan", "time_step")])
def test_another_case_or_step_in_the_record_is_refused(key, runs, tmp_path):
    folder = shutil.copytree(runs["tank"], tmp_path / "run")
    record = json.loads((folder / RECORD).read_text())
    record[key[0]][key[1]] *= 2
    (folder / RECORD).write_text(json.dumps(record))
    before = (folder / RESULT).read_bytes()
    with pytest.raises(InputError, match=r"run\.json is not what the run wrote"):
        analyze(folder)
    assert (folder / RESULT).read_bytes() == before
