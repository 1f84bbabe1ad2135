"""Replicas: several seeds of one case, pooled."""

from __future__ import annotations

from math import sqrt

import numpy as np
import pytest
from conftest import tiny_tank

from liftdrag import replicas, runner
from liftdrag.case import load
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
