"""The in-house engine: `python -m liftdrag.engines.dem FOLDER` runs the deck in a folder.

Or the decks in the folders below it, one after another. It lives in the process that calls it,
on one core, a column or a sheared cell on as many as it is told; its loops let other threads of the
process run.
"""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from math import inf
from pathlib import Path
from typing import NoReturn

import numpy as np
from pydantic import ValidationError

from liftdrag import dem
from liftdrag.deck import Plan
from liftdrag.deck.dialect import IN_HOUSE
from liftdrag.deck.drag2d import NUMBERS
from liftdrag.deck.janssen import START
from liftdrag.deck.shear import START as SHEARED
from liftdrag.engines import dem_column, dem_planar, dem_shear, mpi
from liftdrag.engines.base import About, Enough, Outcome, Progress, silent
from liftdrag.engines.dem_column import ColumnDeck
from liftdrag.engines.dem_planar import PlanarDeck
from liftdrag.engines.dem_shear import ShearDeck
from liftdrag.engines.fills import early, read_fills
from liftdrag.engines.samples import Ran, read_samples
from liftdrag.engines.stopper import PRECISION
from liftdrag.engines.watchdog import FOREVER, Limits, Watchdog
from liftdrag.errors import InputError
from liftdrag.profile import Profile
from liftdrag.series import Series
from liftdrag.snapshot import Snapshot
from liftdrag.version import VERSION

_ENDS = {
    dem.FINE: ("finished", ""),
    dem.TOO_DEEP: (
        "overlap_exceeded",
        "two grains overlap by more than the radius of the smaller; a smaller numerics.time_step "
        "or stiffer grains may help",
    ),
    dem.NOT_FINITE: (
        "not_finite",
        "a velocity is not a number; a smaller numerics.time_step may help",
    ),
    dem.ESCAPED: ("lost_grains", "a grain left the box; a smaller numerics.time_step may help"),
}
"""How a run may end: its status and the reason."""


class InHouse:
    """The engine `dem`."""

    name = "dem"
    dialect = IN_HOUSE

    def about(self) -> About:
        """It has the version of the package that it is part of."""
        return About(self.name, VERSION, Path(dem.__file__).parent, "none")

    def packages(self) -> tuple[str, ...]:
        """None."""
        return ()

    def world(self) -> mpi.World:
        """The ranks of MPICH's `mpiexec`, each of which runs decks of its own."""
        return mpi.world(program="liftdrag")

    def launcher(self) -> Path:
        """The wheel's own."""
        return mpi.mpiexec()

    def check(self, ranks: int) -> None:
        """It is always there."""

    def join(self) -> NoReturn:
        """It has no ranks."""
        raise InputError("The engine dem runs a deck on one core.")

    def release(self) -> None:
        """Nobody waits."""

    def run(
        self,
        plan: Plan,
        folder: Path,
        progress: Progress,
        alone: bool = False,
        enough: Enough | None = None,
        limits: Limits = FOREVER,
    ) -> Outcome:
        """Carry out the deck in pieces; the average of each fill of a column until `enough`."""
        deck = _read(folder)
        start = time.perf_counter()
        watchdog = Watchdog(replace(limits, silence_s=inf), ())

        def look(stage: str, done: int, total: int) -> None:
            watchdog.look()
            progress(stage, done, total)

        ran, cpu_s = _aside(deck, folder, look, enough)
        loop_s = time.perf_counter() - start
        status, reason = _ENDS[ran.status]
        about = self.about()
        return Outcome(
            status=status,
            reason=reason,
            evidence=ran.evidence,
            version=about.version,
            path=about.path,
            ranks=plan.ranks,
            steps=ran.steps,
            grains=deck.grains,
            loop_s=loop_s,
            cpu_s=cpu_s,
            stopped_by=_stopped_by(plan, folder, ran.before + ran.steps),
            before=ran.before,
        )

    def series(self, plan: Plan, folder: Path) -> Series:
        """The samples, time zero where the drive starts."""
        ((name, channels),) = plan.series.items()
        return read_samples(folder / name, channels)

    def surfaces(self, plan: Plan, folder: Path) -> Iterator[tuple[float, np.ndarray]]:
        """None: no bed of this engine has one that is looked at."""
        return iter(())

    def snapshots(self, plan: Plan, folder: Path) -> Iterator[Snapshot]:
        """Those of a bed in the plane or a sheared cell."""
        if plan.start == SHEARED:
            return dem_shear.snapshots(folder)
        return iter(()) if plan.fills else dem_planar.snapshots(folder)

    def profiles(self, plan: Plan, folder: Path) -> Iterator[Profile]:
        """Those of a column."""
        return dem_column.profiles(folder) if plan.fills else iter(())


def _stopped_by(plan: Plan, folder: Path, steps: int) -> str:
    """What ended a sheared cell, or all fills of a column: "precision", or "distance"."""
    if not plan.fills:
        return PRECISION if plan.stoppable and steps < plan.stages["drive"] else "distance"
    ended = early(plan, read_fills(folder))
    return PRECISION if len(ended) == len(plan.fills) else "distance"


Deck = PlanarDeck | ColumnDeck | ShearDeck
"""What the engine runs."""

_READERS: dict[str, Callable[[Path], Deck]] = {
    START: dem_column.read,
    SHEARED: dem_shear.read,
    NUMBERS: dem_planar.read,
}
"""Of a deck, by the file that it starts from."""


class _Halted(Exception):
    """The user stopped the run."""


def _aside(
    deck: Deck, folder: Path, progress: Progress, enough: Enough | None
) -> tuple[Ran, float]:
    """How the deck ended in a thread of its own, and the processor time (s) that it took.

    A signal that arrives in compiled code would end the process; here it is obeyed between two
    pieces of the run.
    """
    halted = threading.Event()

    def look(stage: str, done: int, total: int) -> None:
        if halted.is_set():
            raise _Halted
        progress(stage, done, total)

    with ThreadPoolExecutor(1) as pool:
        running = pool.submit(_carried_out, deck, folder, look, enough)
        try:
            return running.result()
        except KeyboardInterrupt:
            halted.set()
            raise


def _carried_out(
    deck: Deck, folder: Path, progress: Progress, enough: Enough | None
) -> tuple[Ran, float]:
    if isinstance(deck, PlanarDeck):
        start = time.thread_time()
        return dem_planar.run(deck, folder, progress), time.thread_time() - start
    clock = time.thread_time if deck.numbers.run.threads == 1 else time.process_time
    start = clock()
    if isinstance(deck, ShearDeck):
        return dem_shear.run(deck, folder, progress, enough), clock() - start
    return dem_column.run(deck, folder, progress, enough), clock() - start


def _read(folder: Path) -> Deck:
    """The deck of a folder. Raises InputError when it is none or damaged."""
    name = next((name for name in _READERS if (folder / name).exists()), NUMBERS)
    try:
        return _READERS[name](folder)
    except OSError as error:
        raise InputError(f"{folder} holds no {name} to run: {error.strerror}.") from None
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(map(str, first["loc"]))
        raise InputError(f"{folder / name} is wrong at {key}: {first['msg']}.") from None
    except InputError:
        raise
    except ValueError as error:
        raise InputError(f"{folder / name} is damaged ({error}); write it again.") from None


def main(arguments: list[str]) -> int:
    """Run the decks; 0 when all finished, 1 when one did not, 2 when there is none."""
    try:
        folders = [deck for name in arguments for deck in _decks(Path(name))]
        if not folders:
            raise InputError(
                "Name a folder that holds a deck: python -m liftdrag.engines.dem FOLDER"
            )
        outcomes = [_reported(folder) for folder in folders]
    except InputError as error:
        print(error, file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("Interrupted.", file=sys.stderr)
        return 1
    return 0 if all(outcome.status == "finished" for outcome in outcomes) else 1


def _decks(folder: Path) -> list[Path]:
    """The folder, or those just below it that hold a deck."""
    below = sorted({path.parent for name in _READERS for path in folder.glob(f"*/{name}")})
    alone = any((folder / name).exists() for name in _READERS)
    return below if below and not alone else [folder]


def _reported(folder: Path) -> Outcome:
    deck = _read(folder)
    threads = 1 if isinstance(deck, PlanarDeck) else deck.numbers.run.threads
    plan = Plan("", threads, 0.0, {"drive": deck.steps}, 1, {})
    outcome = InHouse().run(plan, folder, silent)
    speed = outcome.grains * outcome.steps / outcome.loop_s
    print(f"{folder}: {outcome.status}, {outcome.steps} steps, {speed:.3g} grain-steps per second")
    if outcome.status != "finished":
        print(f"{outcome.reason}; {outcome.evidence}", file=sys.stderr)
    return outcome


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
