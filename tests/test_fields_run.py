"""Fields of real runs: every pair once, nothing lost where a run goes on, answers anew."""

from __future__ import annotations

import json

import numpy as np
import pandas as pd
import pytest
from conftest import tiny_tank
from numpy.testing import assert_allclose
from scipy.spatial import cKDTree

import liftdrag
from liftdrag.analysis.fields import about_axis
from liftdrag.case import Case
from liftdrag.engines import engine
from liftdrag.engines.contact_dumps import force_snapshots
from liftdrag.errors import InputError
from liftdrag.folder import Record
from liftdrag.result import Result
from liftdrag.runner import analyze

CASE = tiny_tank(fields={"snapshots": 20}, drive={"distance": "12 D"})
NEW = {
    "snapshot_drag": "N",
    "snapshot_lift": "N",
    "tangential_drag_share": "1",
    "front_pressure_ratio": "1",
    "loop_drag": "N",
    "loop_lift": "N",
}


@pytest.fixture(scope="module", params=["lammps", "lmp", "liggghts"])
def result(request, tmp_path_factory) -> Result:
    """On two ranks, each of which sees the other's grains, and both their periodic images."""
    if request.param != "lammps":
        try:
            engine(request.param).about()
        except InputError as missing:
            pytest.skip(str(missing))
    folder = tmp_path_factory.mktemp("run") / "tiny"
    return liftdrag.run(CASE, folder, request.param, ranks=2)


def snapshots(result: Result):
    return list(force_snapshots(Record.read(result.folder).plan, result.folder))


class TestARun:
    def test_dumps_every_pair_that_touches_once(self, result):
        scene, d = CASE.scene, CASE.scene.grains.diameter
        kind = np.loadtxt(result.folder / "grains.data", skiprows=9)[:, 1]
        box = [scene.tank.length, scene.tank.thickness, 1.0]
        for one in snapshots(result)[::5]:
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

    def test_the_forces_of_the_wall_are_those_of_the_series(self, result):
        """A snapshot lies within the scatter of the rows about it, and has their sign."""
        drag = [-one.wall[:, 0].sum() for one in snapshots(result)]
        times = [one.time for one in snapshots(result)]
        series = np.interp(times, result.series.time, result.series["drag"])
        assert np.corrcoef(drag[3:], series[3:])[0, 1] > 0.9

    def test_momentum_balances_about_the_cylinder(self, result):
        found = result.quantities
        for name in ("drag", "lift"):
            loop, drag = found[f"loop_{name}"], found[f"snapshot_{name}"]
            assert abs(loop.mean - drag.mean) < 3.0 * loop.standard_error

    def test_pairs_push_and_slide_within_friction(self, result):
        one = snapshots(result)[-1]
        centres = about_axis(CASE.scene, one.position)
        branch = centres[one.pair[:, 0]] - centres[one.pair[:, 1]]
        near = np.linalg.norm(branch, axis=1) < CASE.scene.grains.diameter
        pushed = np.sum(one.force * branch, axis=1)[near]
        assert (pushed >= -1e-12).mean() > 0.99

    def test_answers_with_files(self, result):
        record = json.loads((result.folder / "result.json").read_text())
        units = {name: record["quantities"][name]["unit"] for name in NEW}
        assert units == NEW
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

    def test_analyze_gives_the_same(self, result):
        again = analyze(result.folder)
        assert again.quantities == result.quantities

    def test_damaged_dumps_are_refused(self, result):
        file = result.folder / "contacts.dump"
        whole = file.read_bytes()
        file.write_bytes(whole.replace(b"TIMESTEP\n", b"TIMESTEP\n1", 2))
        with pytest.raises(InputError, match="damaged"):
            analyze(result.folder)
        file.write_bytes(whole)


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
