"""Runs whose engine, or liftdrag itself, is killed with kill -9 at random moments, and resumed.

`pytest --validate tests/test_kills.py`; LIFTDRAG_KILLS is how many for each scene, 5 unless set,
and LIFTDRAG_KILL_SEED the seed, 1 unless set.
"""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from conftest import with_lid
from kills import TANK, engines_in
from test_drag2d_scene import tiny as tiny_bed
from test_janssen_scene import tiny as tiny_tube
from test_shear_scene import tiny as tiny_cell

from liftdrag.resume import resume
from liftdrag.runner import run

COUNT = int(os.environ.get("LIFTDRAG_KILLS", "5"))
SEED = int(os.environ.get("LIFTDRAG_KILL_SEED", "1"))

LONG = TANK.set("drive.distance", "20 D")
BED = tiny_bed().set("ensemble.runs", 6)

TUBE = tiny_tube().set("numerics.restart_every", 1000)
OF_TUBE = ("forces.dat", "profile.dat", "curve.csv", "series.csv")

SHEARED = tiny_cell(drive={"strain": 60.0})
OF_SHEAR = ("stresses.csv", "looks.npz", "series.csv", "structure.csv", "stress.csv")

SCENES = {
    "tank": (LONG, "lammps", 1, ("forces.dat", "bed.dat", "series.csv")),
    "tank on 2 ranks": (LONG, "lammps", 2, ("forces.dat", "bed.dat", "series.csv")),
    "lid": (with_lid(True).set("numerics.restart_every", 500), "lammps", 1, ("forces.dat",)),
    "Debian's lmp": (LONG, "lmp", 1, ()),
    "bed": (BED, "dem", 1, ("drag.csv", "packings.csv")),
    "bed on LAMMPS": (BED, "lammps", 1, ("drag.csv", "packings.csv")),
    "tank on LIGGGHTS": (LONG, "liggghts", 1, ("forces.dat", "bed.dat", "series.csv")),
    "tube on LAMMPS": (TUBE, "lammps", 1, OF_TUBE),
    "tube on 2 ranks": (TUBE, "lammps", 2, OF_TUBE),
    "lid in a tube": (TUBE.set("overload", {"mass": "3 g"}), "lammps", 1, OF_TUBE),
    "tube on Debian's lmp": (TUBE, "lmp", 1, OF_TUBE),
    "tube on LIGGGHTS": (TUBE, "liggghts", 1, OF_TUBE),
    "shear": (SHEARED, "dem", 1, OF_SHEAR),
    "shear on 2 threads": (SHEARED, "dem", 2, OF_SHEAR),
    "tube": (tiny_tube(), "dem", 1, ("curve.csv", "series.csv", "profile.csv")),
}

CODE = """
import sys
sys.path.insert(0, sys.argv[1])
from pathlib import Path
from liftdrag.engines import checkpoint
from liftdrag.resume import resume
from test_kills import SCENES
checkpoint.EVERY_S, checkpoint.SHARE = 0.0, 1e9
case, engine, ranks, _ = SCENES[sys.argv[2]]
resume(case, Path(sys.argv[3]), engine, ranks)
"""


def begin(name: str, folder: Path) -> subprocess.Popen[bytes]:
    """liftdrag in a process of its own, which starts the run or goes on with it."""
    command = [sys.executable, "-c", CODE, str(Path(__file__).parent), name, str(folder)]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def kill(process: subprocess.Popen[bytes], folder: Path, engine_only: bool) -> None:
    """End the engine's processes, or liftdrag, at once."""
    found = set(engines_in(folder)) - {process.pid} if engine_only else {process.pid}
    for pid in found:
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)


@pytest.mark.validate
@pytest.mark.parametrize("name", SCENES)
def test_a_run_that_is_killed_at_random_comes_to_the_end_of_one_that_was_not(name, tmp_path):
    case, engine, ranks, files = SCENES[name]
    start = time.monotonic()
    whole = run(case, tmp_path / "whole", engine, ranks)
    took = time.monotonic() - start
    folder, rng, ended = tmp_path / "run", np.random.default_rng(SEED), 0
    for _ in range(COUNT):
        process = begin(name, folder)
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(2.0 + took * rng.random())
            ended += 1
        kill(process, folder, bool(rng.integers(2)))
        process.wait(60.0)
    result = resume(case, folder, engine, ranks)
    assert engines_in(folder) == []
    assert ended < COUNT
    assert result.status == "finished"
    assert len(result.series) == len(whole.series)
    assert np.array_equal(result.series.time, whole.series.time)
    for file in files:
        assert (folder / file).read_bytes() == (whole.folder / file).read_bytes()
    drag = next(iter(whole.quantities))
    one, other = whole.quantities[drag], result.quantities[drag]
    error = np.hypot(one.standard_error, other.standard_error)
    assert abs(one.mean - other.mean) <= 4.0 * error
