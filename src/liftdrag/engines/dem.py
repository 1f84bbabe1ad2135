"""The in-house engine: `python -m liftdrag.engines.dem FOLDER` runs the deck in a folder.

Or the decks in the folders below it, one after another. It lives in the process that calls it,
on one core; its loops let other threads of the process run.
"""

from __future__ import annotations

import sys
import time
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, NoReturn

import numpy as np
from pydantic import Field, ValidationError

from liftdrag import dem
from liftdrag.deck import Plan
from liftdrag.deck.dialect import IN_HOUSE
from liftdrag.deck.drag2d import CHANNELS, NUMBERS, read_bed
from liftdrag.dem import Advanced, Bed, advance, hertz_mindlin
from liftdrag.engines import mpi
from liftdrag.engines.base import About, Outcome, Progress, silent
from liftdrag.errors import InputError
from liftdrag.scene.model import Part
from liftdrag.series import Series
from liftdrag.snapshot import Snapshot
from liftdrag.tables import column, read_table
from liftdrag.version import VERSION

SERIES = "series.csv"
FRAMES = "frames.npz"

_ENDS = {
    dem.FINE: ("finished", ""),
    dem.TOO_DEEP: (
        "overlap_exceeded",
        "two grains overlap by more than the radius of the smaller; a smaller numerics.time_step "
        "or a larger grains.youngs_modulus may help",
    ),
    dem.NOT_FINITE: (
        "not_finite",
        "a velocity is not a number; a smaller numerics.time_step may help",
    ),
    dem.ESCAPED: ("lost_grains", "a grain left the box; a smaller numerics.time_step may help"),
}
"""How a run may end: its status and the reason."""


class _Contact(Part):
    youngs_modulus: Annotated[float, Field(gt=0.0)]
    poisson_ratio: Annotated[float, Field(ge=0.0, lt=0.5)]
    restitution: Annotated[float, Field(gt=0.0, le=1.0)]
    friction: Annotated[float, Field(ge=0.0)]


class _Run(Part):
    time_step: Annotated[float, Field(gt=0.0)]
    steps: Annotated[int, Field(gt=0)]
    row_every: Annotated[int, Field(gt=0)]
    frame_every: Annotated[int, Field(gt=0)]
    skin: Annotated[float, Field(gt=0.0)]
    watched: Annotated[int, Field(ge=0)]


class _Numbers(Part):
    contact: _Contact
    run: _Run


@dataclass(frozen=True)
class _Deck:
    """A deck as read: the bed, the numbers of the contact and those of the run."""

    bed: Bed
    contact: _Contact
    run: _Run


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

    def run(self, plan: Plan, folder: Path, progress: Progress, alone: bool = False) -> Outcome:
        """Carry out the deck, in pieces that end with a frame of the bed."""
        deck = _read(folder)
        start, cpu = time.perf_counter(), time.thread_time()
        pieces, frames = _pieces(deck, progress)
        loop_s, cpu_s = time.perf_counter() - start, time.thread_time() - cpu
        _write_series(deck, pieces, folder / SERIES)
        np.savez(folder / FRAMES, allow_pickle=False, **frames)
        status, reason = _ENDS[pieces[-1].status]
        done = sum(len(piece.force) for piece in pieces) * deck.run.row_every
        about = self.about()
        return Outcome(
            status=status,
            reason=reason,
            evidence="" if status == "finished" else _evidence(pieces[-1], done),
            version=about.version,
            path=about.path,
            ranks=1,
            steps=done,
            grains=len(deck.bed.mass),
            loop_s=loop_s,
            cpu_s=cpu_s,
        )

    def series(self, plan: Plan, folder: Path) -> Series:
        """The samples, time zero where the drive starts."""
        table = read_table(folder / SERIES, "csv")
        channels = {name: column(table, name) for name in CHANNELS}
        return Series(column(table, "time"), channels, CHANNELS)

    def surfaces(self, plan: Plan, folder: Path) -> Iterator[tuple[float, np.ndarray]]:
        """None: a closed box has no surface."""
        return iter(())

    def snapshots(self, plan: Plan, folder: Path) -> Iterator[Snapshot]:
        """The parts of the bed, the first before the drive; the cylinder is of kind 2."""
        bed = read_bed(folder)
        kind = np.where(bed.body == len(bed.mass) - 1, 2, 1)
        with np.load(folder / FRAMES) as file:
            frames = {name: file[name] for name in file.files}
        for k, moment in enumerate(frames["time"]):
            now = replace(bed, position=frames["position"][k], angle=frames["angle"][k])
            velocity = frames["velocity"][k][bed.body]
            place, speed = (np.column_stack([v, np.zeros(len(v))]) for v in (now.place, velocity))
            yield Snapshot(float(moment), kind, place, speed, now.angle[bed.body])


def _read(folder: Path) -> _Deck:
    """The deck of a folder. Raises InputError when it is none or damaged."""
    try:
        numbers = _Numbers.model_validate(tomllib.loads((folder / NUMBERS).read_text("utf-8")))
        return _Deck(read_bed(folder), numbers.contact, numbers.run)
    except OSError as error:
        raise InputError(f"{folder} holds no {NUMBERS} to run: {error.strerror}.") from None
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(map(str, first["loc"]))
        raise InputError(f"{folder / NUMBERS} is wrong at {key}: {first['msg']}.") from None
    except InputError:
        raise
    except ValueError as error:
        raise InputError(f"{folder / NUMBERS} is damaged ({error}); write it again.") from None


def _pieces(deck: _Deck, progress: Progress) -> tuple[list[Advanced], dict[str, np.ndarray]]:
    """The run from frame to frame, and the frames; it ends early where a piece does."""
    numbers, bed = deck.run, deck.bed
    law = hertz_mindlin(**dict(deck.contact))
    steps, every = numbers.steps, numbers.frame_every
    pieces: list[Advanced] = []
    moments = [(0.0, bed)]
    for done in range(0, steps, every):
        piece = advance(
            bed,
            law,
            numbers.time_step,
            min(every, steps - done) // numbers.row_every,
            numbers.row_every,
            numbers.skin,
            watched=numbers.watched,
        )
        pieces.append(piece)
        if piece.status != dem.FINE:
            break
        bed = piece.bed
        moments.append(((done + every) * numbers.time_step, bed))
        progress("drive", done + every, steps)
    return pieces, _frames(moments)


def _frames(moments: list[tuple[float, Bed]]) -> dict[str, np.ndarray]:
    names = ("position", "angle", "velocity")
    frames = {name: np.array([getattr(bed, name) for _, bed in moments]) for name in names}
    return frames | {"time": np.array([moment for moment, _ in moments])}


def _write_series(deck: _Deck, pieces: list[Advanced], path: Path) -> None:
    """A row each `row_every` steps, named as in CHANNELS."""
    force = np.concatenate([piece.force for piece in pieces])
    load = np.concatenate([piece.load for piece in pieces])
    rest = [
        np.concatenate([getattr(piece, name) for piece in pieces])
        for name in ("kinetic", "elastic", "overlap")
    ]
    interval = deck.run.row_every * deck.run.time_step
    moment = np.arange(1, len(force) + 1) * interval
    table = np.column_stack([moment, -force[:, 1], force[:, 0], load, *rest])
    head = ",".join(["time", *CHANNELS])
    np.savetxt(path, table, fmt="%.10g", delimiter=",", header=head, comments="")


def _evidence(piece: Advanced, steps: int) -> str:
    deepest = float(piece.overlap.max(initial=0.0))
    return f"stopped after step {steps}, the deepest overlap {deepest:.3g} of the smaller radius"


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
    return 0 if all(outcome.status == "finished" for outcome in outcomes) else 1


def _decks(folder: Path) -> list[Path]:
    """The folder, or those just below it that hold a deck."""
    below = sorted(path.parent for path in folder.glob(f"*/{NUMBERS}"))
    return below if below and not (folder / NUMBERS).exists() else [folder]


def _reported(folder: Path) -> Outcome:
    deck = _read(folder)
    stages = {"drive": deck.run.steps}
    plan = Plan(NUMBERS, 1, deck.run.time_step, stages, deck.run.row_every, {})
    outcome = InHouse().run(plan, folder, silent)
    speed = outcome.grains * outcome.steps / outcome.loop_s
    print(f"{folder}: {outcome.status}, {outcome.steps} steps, {speed:.3g} grain-steps per second")
    if outcome.status != "finished":
        print(f"{outcome.reason}; {outcome.evidence}", file=sys.stderr)
    return outcome


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
