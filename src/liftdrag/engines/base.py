"""What every engine offers: run a deck in a folder, and read what it left there."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn, Protocol

import numpy as np

from liftdrag.deck import Plan
from liftdrag.deck.dialect import Dialect
from liftdrag.engines.mpi import World
from liftdrag.engines.watchdog import FOREVER, Limits
from liftdrag.profile import Profile
from liftdrag.series import Series
from liftdrag.snapshot import Snapshot

Progress = Callable[[str, int, int], None]
"""Called with the stage's name, the steps done and the steps planned."""


Enough = Callable[[Series], bool]
"""Called with the series so far: whether the run may end."""


def silent(_stage: str, _done: int, _total: int) -> None:
    """No progress shown."""


@dataclass(frozen=True)
class Outcome:
    """How a run ended, decided from evidence; `status` is "finished" or the reason in a word.

    `stopped_by` is "precision" where it had enough, "request" where somebody else wrote its file
    STOP, or "distance". `loop_s` is the time on the clock of the engine's loops, `cpu_s` the
    processor time of all its ranks, in seconds; `before` are steps of the sessions before.
    """

    status: str
    reason: str
    evidence: str
    version: str
    path: Path
    ranks: int
    steps: int
    grains: int
    loop_s: float
    cpu_s: float
    stopped_by: str = "distance"
    before: int = 0


@dataclass(frozen=True)
class About:
    """What an engine is: its name, version, place and the MPI that it is linked with."""

    name: str
    version: str
    path: Path
    mpi: str


class Engine(Protocol):
    """A program that runs decks."""

    name: str

    @property
    def dialect(self) -> Dialect:
        """The language of its decks. Raises InputError when that needs the program, not found."""

    def about(self) -> About:
        """What it is and where. Raises InputError when it is not installed."""

    def packages(self) -> tuple[str, ...]:
        """The optional parts that it was built with, where it says so."""

    def world(self) -> World:
        """The MPI job that liftdrag was started in, one rank when there is none."""

    def launcher(self) -> Path:
        """The program that starts it on several ranks. Raises InputError when there is none."""

    def check(self, ranks: int) -> None:
        """Raise InputError when the engine cannot start on so many ranks."""

    def join(self) -> NoReturn:
        """As a rank other than 0 of an MPI job: take part in the run that rank 0 will start."""

    def release(self) -> None:
        """As rank 0 of an MPI job: tell the other ranks that there is nothing to run."""

    def run(
        self,
        plan: Plan,
        folder: Path,
        progress: Progress,
        alone: bool = False,
        enough: Enough | None = None,
        limits: Limits = FOREVER,
    ) -> Outcome:
        """Carry out the plan of a deck already written to `folder`, until there is `enough`.

        On the ranks of the MPI job that liftdrag was started in or, `alone`, outside of it.
        Raises RunFailed "timeout" or "stalled" beyond the `limits`.
        """

    def series(self, plan: Plan, folder: Path) -> Series:
        """The measured series of the drive stage."""

    def surfaces(self, plan: Plan, folder: Path) -> Iterator[tuple[float, np.ndarray]]:
        """Times (s) of the drive stage, and the heights (n,) in m of the far field's top grains."""

    def snapshots(self, plan: Plan, folder: Path) -> Iterator[Snapshot]:
        """The beds of the drive stage, in order of time; the first is the settled bed."""

    def profiles(self, plan: Plan, folder: Path) -> Iterator[Profile]:
        """The profiles of a column from the first step on, in order of time.

        Raises ValueError when what the engine wrote is damaged.
        """
