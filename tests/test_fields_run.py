"""Fields of real runs: every pair once, nothing lost where a run goes on, answers anew."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from conftest import tiny_tank
from kills import killed
from numpy.testing import assert_allclose
from scipy.spatial import cKDTree

import liftdrag
from liftdrag.analysis.around import around, quantities
from liftdrag.analysis.fields import about_axis
from liftdrag.analysis.quantity import Quantity
from liftdrag.case import Case
from liftdrag.cost.disk import needed
from liftdrag.deck import Plan
from liftdrag.engines import engine, process
from liftdrag.engines.base import Engine, silent
from liftdrag.engines.contact_dumps import force_snapshots
from liftdrag.errors import InputError
from liftdrag.folder import Record
from liftdrag.result import Result
from liftdrag.resume import resume
from liftdrag.runner import analyze, run
from liftdrag.tank import prepare

CASE = tiny_tank(
    fields={"snapshots": 20}, drive={"distance": "8 D"}, numerics={"restart_every": 500}
)
NEW = {
    "snapshot_drag": "N",
    "snapshot_lift": "N",
    "tangential_drag_share": "1",
    "front_pressure_ratio": "1",
    "loop_drag": "N",
    "loop_lift": "N",
}


def on(name: str, ranks: int, *marks: pytest.MarkDecorator):
    return pytest.param((name, ranks), marks=[pytest.mark.needs(name), *marks])


ON_RANKS = [
    ("lammps", 2),
    on("liggghts", 1),
    on("lmp", 2, pytest.mark.validate),
    on("liggghts", 2, pytest.mark.validate),
]


@pytest.fixture(scope="module", params=ON_RANKS)
def dumped(request, tmp_path_factory) -> tuple[Plan, Path, Engine]:
    """A deck run by itself; on two ranks each sees the other's grains and their images."""
    name, ranks = request.param
    chosen, folder = engine(name), tmp_path_factory.mktemp("run")
    _, deck = prepare(CASE, ranks, dialect=chosen.dialect)
    deck.write(folder)
    assert chosen.run(deck.plan, folder, silent).status == "finished"
    return deck.plan, folder, chosen


class TestDumps:
    def test_hold_every_pair_that_touches_once(self, dumped):
        plan, folder, _ = dumped
        scene, d = CASE.scene, CASE.scene.grains.diameter
        kind = np.loadtxt(folder / "grains.data", skiprows=9)[:, 1]
        box = [scene.tank.length, scene.tank.thickness, 1.0]
        for one in list(force_snapshots(plan, folder))[::5]:
            tree = cKDTree(one.position % box, boxsize=box)
            found = {frozenset(pair) for pair in one.pair.tolist()}
            assert len(found) == len(one.pair)
            surely, perhaps = (
                {
                    frozenset(pair)
                    for pair in tree.query_pairs(d * reach)
                    if (kind[list(pair)] == 1).any()
                }
                for reach in (1.0 - 1e-4, 1.0 + 1e-4)
            )
            assert surely <= found <= perhaps

    def test_hold_the_force_of_the_series(self, dumped):
        """That of a moment lies near the mean of the row about it."""
        plan, folder, chosen = dumped
        found = list(force_snapshots(plan, folder))[3:]
        drag = [-one.wall[:, 0].sum() for one in found]
        series = chosen.series(plan, folder)
        rows = np.interp([one.time for one in found], series.time, series["drag"])
        assert np.corrcoef(drag, rows)[0, 1] > 0.9

    def test_balance_momentum_about_the_cylinder(self, dumped):
        plan, folder, _ = dumped
        end = plan.stages["drive"] * plan.time_step
        found = around(CASE.scene, force_snapshots(plan, folder), 0.2 * end, end)
        told = quantities(CASE.scene, found, Quantity(160.0, 0.0, "Pa", None, None, True))
        for name in ("drag", "lift"):
            loop, force = told[f"loop_{name}"], told[f"snapshot_{name}"]
            assert abs(loop.mean - force.mean) < 3.0 * loop.standard_error
        assert told["loop_drag"].mean > 3.0 * told["loop_drag"].standard_error

    def test_hold_grains_that_push_each_other(self, dumped):
        """But for a few that part, which damping holds back."""
        plan, folder, _ = dumped
        *_, one = force_snapshots(plan, folder)
        centres = about_axis(CASE.scene, one.position)
        branch = centres[one.pair[:, 0]] - centres[one.pair[:, 1]]
        near = np.linalg.norm(branch, axis=1) < CASE.scene.grains.diameter
        assert (np.sum(one.force * branch, axis=1)[near] > 0.0).mean() > 0.9


@pytest.fixture(scope="module")
def result(tmp_path_factory) -> Result:
    return liftdrag.run(CASE, tmp_path_factory.mktemp("whole") / "run")


class TestARun:
    def test_answers_with_files(self, result):
        record = json.loads((result.folder / "result.json").read_text())
        units = {name: record["quantities"][name]["unit"] for name in NEW}
        assert units == NEW
        assert record["fields"]["snapshots"] >= 8
        assert all(abs(errors) < 3.0 for errors in record["fields"]["errors_from_series"].values())
        for name in result.files:
            assert (result.folder / name).stat().st_size > 100
        ring = pd.read_csv(result.folder / "cylinder.csv")
        angle = np.radians(ring["angle_degrees"])
        area = np.pi * CASE.scene.intruder.diameter * CASE.scene.tank.thickness / len(ring)
        drag = ring["normal"] * np.cos(angle) + ring["tangential"] * np.sin(angle)
        assert_allclose(drag.sum() * area, result.quantities["snapshot_drag"].mean, rtol=1e-8)
        stored = np.load(result.folder / "fields.npz")
        assert stored["stress"].shape == (len(stored["x"]), len(stored["z"]), 3, 3)
        assert (stored["pressure_error"] >= 0.0).all()

    def test_takes_the_disk_that_it_said(self, result):
        numerics = prepare(CASE)[0]
        without = replace(numerics, fields_every=None)
        said = needed(CASE.scene, numerics) - needed(CASE.scene, without)
        dumps = [result.folder / name for name in ("fields.dump", "contacts.dump")]
        assert 0.5 * said < sum(dump.stat().st_size for dump in dumps) < said

    def test_leaves_image_data_for_paraview(self, result):
        pyvista = pytest.importorskip("pyvista")
        image = pyvista.read(result.folder / "fields.vti")
        stored = np.load(result.folder / "fields.npz")
        x, _, z = image.points[7 + 5 * len(stored["x"])]
        assert_allclose([x, z], [stored["x"][7], stored["z"][5]], rtol=1e-6)
        found = image.point_data["stress"][7 + 5 * len(stored["x"])]
        assert_allclose(found.reshape(3, 3), stored["stress"][7, 5])

    @pytest.mark.parametrize(
        ("name", "old", "new"),
        [
            ("contacts.dump", b"TIMESTEP\n", b"TIMESTEP\n1"),
            ("fields.dump", b"\n7 1 ", b"\n70007 1 "),
            ("fields.dump", b" f_wall[4]", b""),
        ],
    )
    def test_damaged_dumps_are_refused(self, result, name, old, new):
        """Below the seal, which finds any change first."""
        record = json.loads((result.folder / "result.json").read_text())
        record.pop("sealed", None)
        (result.folder / "result.json").write_text(json.dumps(record))
        file = result.folder / name
        whole = file.read_bytes()
        assert old in whole
        file.write_bytes(whole.replace(old, new))
        with pytest.raises(InputError, match="damaged"):
            analyze(result.folder)
        file.write_bytes(whole)


def test_a_run_that_goes_on_has_no_gap_and_the_same_answers(result, tmp_path, monkeypatch):
    """Which `analyze` gives, from the files."""
    monkeypatch.setattr(process, "POLL_S", 0.02)
    folder = killed(tmp_path / "run", "drive", 2000, CASE)
    assert resume(None, folder).quantities == result.quantities
    assert (folder / "fields.dump").read_bytes() == (result.folder / "fields.dump").read_bytes()
    plan = Record.read(folder).plan
    times = [one.time / plan.time_step for one in force_snapshots(plan, folder)]
    every = prepare(CASE)[0].fields_every.value
    assert_allclose(times, np.arange(len(times)) * every, rtol=1e-9)
    assert len(times) == plan.stages["drive"] // every + 1


@pytest.mark.validate
@pytest.mark.needs("liggghts")
def test_a_run_of_liggghts_goes_on_too(tmp_path, monkeypatch):
    monkeypatch.setattr(process, "POLL_S", 0.02)
    whole = run(CASE, tmp_path / "whole", "liggghts")
    folder = killed(tmp_path / "run", "drive", 2000, CASE, "liggghts")
    assert resume(None, folder).quantities == whole.quantities
    for name in ("fields.dump", "contacts.dump", "cylinder.csv"):
        assert (folder / name).read_bytes() == (whole.folder / name).read_bytes()


def test_without_the_table_nothing_is_dumped(tmp_path):
    folder, _, _ = liftdrag.runner.build_deck(tiny_tank(), tmp_path / "deck")
    deck = (folder / "in.tank").read_text()
    assert "fields" not in deck
    assert "local" not in deck
    assert "fields_every" not in (folder / "numerics.txt").read_text()


@pytest.mark.parametrize(
    ("key", "value"),
    [("snapshots", 7), ("window", "0.4 d"), ("window", "9 d"), ("spacing", "1.1 d")],
)
def test_a_table_that_cannot_be_is_refused(key, value):
    case = Case("tiny", dict(tiny_tank().tables) | {"fields": {key: value}})
    with pytest.raises(InputError, match=f"fields.{key}"):
        case.scene  # noqa: B018
