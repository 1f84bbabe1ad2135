"""Replicas: several seeds of one case, pooled."""

from __future__ import annotations

from math import sqrt

import numpy as np
import pytest
from conftest import tiny_tank

from liftdrag import replicas, runner
from liftdrag.case import load
from liftdrag.cost.kind import Kind
from liftdrag.cost.sharing import LEAST_STEADY, share
from liftdrag.errors import InputError
from liftdrag.folder import read_json


def test_replicas_are_runs_of_their_seeds_pooled_with_equal_weights(tmp_path):
    case = tiny_tank()
    found = replicas.run(case, 2, tmp_path / "both")
    alone = [runner.run(case.set("seed", seed), tmp_path / str(seed)) for seed in (1, 2)]
    drags = [one.quantities["drag"] for one in alone]
    own = sum(one.standard_error**2 for one in drags) / 4.0
    scatter = np.var([one.mean for one in drags], ddof=1) / 2.0
    drag = found.quantities["drag"]
    assert drag.mean == pytest.approx(np.mean([one.mean for one in drags]), rel=1e-12)
    assert drag.standard_error == pytest.approx(sqrt(max(own, scatter)), rel=1e-9)
    assert found.record["steps"] == sum(one.record["steps"] for one in alone)
    assert replicas.is_replicas(tmp_path / "both")
    assert not replicas.is_replicas(tmp_path / "1")
    again = replicas.analyze(tmp_path / "both")
    assert again.quantities == found.quantities
    assert read_json(tmp_path / "both" / "result.json")["replicas"] == 2


def test_each_replica_is_stopped_at_an_error_that_pooling_brings_down():
    stop = {"quantity": ["drag", "lift"], "relative_error": 0.05, "absolute_error": {"lift": 0.2}}
    scene = replicas._replica(load("quick").set("stop", stop), 3, 4).scene
    assert scene.seed == load("quick").scene.seed + 3
    assert scene.targets["drag"].relative == pytest.approx(0.1)
    assert scene.targets["lift"].absolute == pytest.approx(0.4)


@pytest.mark.parametrize(
    ("name", "count", "says"),
    [("quick", 0, "--replicas 0"), ("zhou/c1", 2, "ensemble.runs"), ("quick", 1001, "1000")],
)
def test_what_cannot_be_replicated_is_refused(name, count, says, tmp_path):
    with pytest.raises(InputError, match=says):
        replicas.run(load(name), count, tmp_path / "out")
    assert not (tmp_path / "out").exists()


LONG = load("quick").set("drive.distance", "60 D")
WHEEL = Kind("here", "lammps", "1", "tank", "granular", 1, 1)


def test_replicas_drive_as_far_together_in_the_steady_flow_as_the_one_run():
    found = share(LONG.scene, WHEEL, 4)
    assert 4 * (found.diameters - 2.0) == pytest.approx(60.0 - 2.0)
    assert found.replicas_s < found.ranks_s


def test_a_bed_that_takes_long_to_settle_is_shared_by_ranks():
    """Settled once for 40 000 grains, against twice."""
    large = load("guillard2014/half-height").set("drive.distance", "21 D").set("drive.speed", 0.5)
    found = share(large.scene, WHEEL, 2)
    assert found.replicas_s > found.ranks_s
    assert not found.prefers_replicas
    assert "2 ranks" in str(found).split("rather")[0]


def test_replicas_too_short_for_an_error_are_not_thought_of():
    least = 2.0 + 2.0 * LEAST_STEADY
    for distance, possible in ((least - 0.1, False), (least + 0.1, True)):
        scene = LONG.set("drive.distance", f"{distance} D").scene
        assert (share(scene, WHEEL, 2).replicas_s is not None) == possible


def test_cores_are_spread_over_ranks_replicas_or_packings(monkeypatch):
    monkeypatch.setattr(replicas, "cores", lambda: 4)
    way = replicas.spread(LONG, 2)
    assert (way.ranks, way.replicas) == (1, 2)
    assert way.case.scene.drive.distance == pytest.approx(31.0 * LONG.scene.intruder.diameter)
    for case, count in ((LONG, 1), (load("zhou/c1"), 3), (load("janssen/quick"), 4)):
        assert replicas.spread(case, count) == replicas.Spread(case, count, 1)
    with pytest.raises(InputError, match="--cores 5 is not between 1 and 4"):
        replicas.spread(LONG, 5)
