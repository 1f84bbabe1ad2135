"""What LAMMPS and LIGGGHTS have in common: how they are run and what they leave in a folder."""

from __future__ import annotations

import os
import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

import numpy as np

from liftdrag.deck import Plan
from liftdrag.deck.dialect import Dialect
from liftdrag.engines import checks, mpi, process, restart
from liftdrag.engines.base import About, Enough, Outcome, Progress
from liftdrag.engines.fills import FillStopper, as_they_were, ends_in, write_fills
from liftdrag.engines.log import LogTail
from liftdrag.engines.phases import text_of
from liftdrag.engines.profiles import PROFILES, read_profiles
from liftdrag.engines.stopper import Stopper
from liftdrag.engines.watchdog import FOREVER, Limits, Watchdog
from liftdrag.errors import RunFailed
from liftdrag.files import check_ordinary, text, whole_lines
from liftdrag.profile import Profile
from liftdrag.series import Series
from liftdrag.snapshot import Snapshot
from liftdrag.tables import column, read_table

if TYPE_CHECKING:
    import pandas as pd

SAYS = "engine.out"
_STAGE = re.compile(r"LIFTDRAG STAGE (\w+) (\d+)")
_THERMO = re.compile(r"\s*(\d+)\s+[-+.\deE]+\s+\d+\s")


class Family(ABC):
    """A program of the LAMMPS family; a subclass says how it is found and started."""

    name: str
    log: str

    @property
    @abstractmethod
    def dialect(self) -> Dialect:
        """The language of its decks."""

    @abstractmethod
    def about(self) -> About:
        """What it is and where. Raises InputError when it is not installed."""

    @abstractmethod
    def world(self) -> mpi.World:
        """The MPI job that liftdrag was started in, as far as this program can join it."""

    @abstractmethod
    def command(self, start: str, folder: Path) -> list[str]:
        """The words that start it on a deck, on one rank."""

    @abstractmethod
    def join(self) -> NoReturn:
        """Become a rank that waits for the first one to say what to run, if anything."""

    @abstractmethod
    def release(self) -> None:
        """Tell the waiting ranks that there is nothing to run."""

    @abstractmethod
    def summon(self, folder: Path) -> None:
        """Tell the waiting ranks of a job where the run is."""

    @abstractmethod
    def launcher(self) -> Path:
        """The launcher of its MPI. Raises InputError when there is none."""

    @abstractmethod
    def settings(self) -> dict[str, str]:
        """What its launcher needs in the environment."""

    def check(self, ranks: int) -> None:
        """Raise InputError when it is not installed, or has no launcher for so many ranks."""
        self.about()
        if ranks > 1 and self.world().size == 1:
            self.launcher()

    def run(
        self,
        plan: Plan,
        folder: Path,
        progress: Progress,
        alone: bool = False,
        enough: Enough | None = None,
        limits: Limits = FOREVER,
    ) -> Outcome:
        """Run the deck on the ranks of the MPI job around us or, `alone`, on new ones."""
        report = _reporter(LogTail(folder / self.log), progress)
        stopper = self._stopper(plan, folder, enough)
        watchdog = Watchdog(limits, (folder / name for name in (self.log, SAYS, *plan.series)))

        def poll() -> None:
            report()
            stopper.look()
            watchdog.look()

        own_ranks = 1 if alone else self.world().size
        try:
            ended = process.watch(self._start(plan, folder, own_ranks > 1), folder, poll)
        except RunFailed as failure:
            said = checks.last_words(text(folder / self.log), text(folder / SAYS))
            raise RunFailed(failure.status, failure.reason, said) from None
        return self._outcome(plan, folder, ended.code, own_ranks * ended.cpu_s)

    def _stopper(self, plan: Plan, folder: Path, enough: Enough | None) -> Stopper | FillStopper:
        def series() -> Series:
            return self.series(plan, folder)

        if enough is None or not plan.fills:
            return Stopper(folder, series, enough)
        return FillStopper(plan, folder, LogTail(folder / self.log), series, enough)

    def _start(self, plan: Plan, folder: Path, joined: bool) -> process.Started:
        command = self.command(plan.start, folder.resolve())
        environment = dict(os.environ) | {"OMP_NUM_THREADS": "1"}
        if joined:
            return self._joined(command, folder, environment)
        if plan.ranks > 1:
            command = [str(self.launcher()), "-n", str(plan.ranks), *command]
        alone = mpi.outside(environment) | self.settings()
        return process.start(command, folder, alone, SAYS)

    def _joined(
        self, command: list[str], folder: Path, environment: dict[str, str]
    ) -> process.Started:
        """As one of the ranks of the job around us; the others are told when that fails."""
        try:
            started = process.start(command, folder, environment, SAYS, own_group=False)
        except RunFailed:
            self.release()
            raise
        self.summon(folder)
        return started

    def _outcome(self, plan: Plan, folder: Path, code: int, cpu_s: float) -> Outcome:
        log = text(folder / self.log)
        said = text(folder / SAYS)
        restart.join(plan, folder)
        loops = [(float(s), int(n), int(atoms)) for s, n, atoms in checks.LOOP.findall(log)]
        steps = sum(n for _, n, _ in loops)
        status, reason = checks.verdict(plan, folder, log, said, code)
        if plan.fills and plan.stoppable:
            write_fills(folder, as_they_were(plan, ends_in(log)))
        return Outcome(
            status=status,
            reason=reason,
            evidence="" if status == "finished" else checks.last_words(log, said),
            version=self.about().version,
            path=self.about().path,
            ranks=checks.ranks_of(log),
            steps=steps,
            grains=loops[-1][2] if loops else 0,
            loop_s=sum(s for s, _, _ in loops),
            cpu_s=cpu_s,
            stopped_by=checks.stopped_by(plan, folder, log),
            before=checks.steps_before(text_of(folder, self.log), log, steps),
        )

    def series(self, plan: Plan, folder: Path) -> Series:
        """The series of `fix ave/time`, time zero where the drive starts.

        Raises ValueError or InputError when a file is damaged.
        """
        import pandas as pd

        every = plan.row_every
        whole = [
            _joined([_by_step(file, every) for file in restart.parts(folder, name)], every)
            for name in plan.series
        ]
        table = pd.concat(whole, axis=1, join="inner")
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

    def profiles(self, plan: Plan, folder: Path) -> Iterator[Profile]:
        """Those of `profile.dat`."""
        return read_profiles(folder / PROFILES, plan.time_step)


def _by_step(file: Path, every: int) -> pd.DataFrame:
    """The rows of a file by steps, `every` steps apart. Raises ValueError."""
    return _spaced(read_table(file, "ave-time").set_index("TimeStep"), every, file.name)


def _joined(parts: Sequence[pd.DataFrame], every: int) -> pd.DataFrame:
    """The rows before a run went on and those since; of two with the same step the earlier."""
    import pandas as pd

    table = pd.concat(parts)
    return _spaced(table[~table.index.duplicated(keep="first")], every, "what went on")


def _spaced(table: pd.DataFrame, every: int, name: str) -> pd.DataFrame:
    if np.any(np.diff(table.index.to_numpy()) != every):
        raise ValueError(f"{name}: its rows are not {every} steps apart")
    return table


def read_dump(path: Path) -> Iterator[tuple[int, np.ndarray]]:
    """The complete frames of a text dump: the step, and the rows (n, columns).

    A line counts once its newline is on disk. Raises ValueError where a frame is damaged, or
    comes before the last one.
    """
    if not path.exists():
        return
    check_ordinary(path)
    last = -1
    with path.open() as file:
        lines = whole_lines(file)
        while len(header := list(islice(lines, 9))) == 9:
            step, count, width = _frame(header, path)
            rows = list(islice(lines, count))
            if len(rows) < count:
                return
            if step <= last:
                raise ValueError(f"{path}: step {step} comes after step {last}")
            last = step
            yield step, _table(rows, width, path)


def _frame(header: Sequence[str], path: Path) -> tuple[int, int, int]:
    """The step, the rows and the columns that the nine lines above a frame name."""
    step, count = header[1].strip(), header[3].strip()
    if not header[8].startswith(("ITEM: ATOMS", "ITEM: ENTRIES")) or not (
        step.isdecimal() and count.isdecimal()
    ):
        raise ValueError(f"{path}: no head of a frame at {header[0].strip()[:60]!r}")
    return int(step), int(count), len(header[8].split()) - 2


def _table(rows: Sequence[str], width: int, path: Path) -> np.ndarray:
    """Rows of `width` finite numbers, (n, width)."""
    values = np.loadtxt(rows, comments=None, ndmin=2) if rows else np.zeros((0, width))
    if values.shape[1] != width or not np.isfinite(values).all():
        raise ValueError(f"{path}: not rows of {width} numbers near {rows[0].strip()[:60]!r}")
    return values


def _reporter(tail: LogTail, progress: Progress) -> Callable[[], None]:
    stage, done, total = "start", 0, 0

    def poll() -> None:
        nonlocal stage, done, total
        for line in tail.lines():
            if match := _STAGE.match(line):
                stage, done, total = match[1], 0, int(match[2])
            elif match := _THERMO.match(line):
                done = int(match[1])
        if total:
            progress(stage, done, total)

    return poll
