"""The in-house engine on a packing in the plane: read its deck, run it, write what it sampled."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Field

from liftdrag import dem
from liftdrag.arrays import read_arrays
from liftdrag.deck.drag2d import CHANNELS, NUMBERS, read_bed
from liftdrag.dem import Advanced, Bed, advance, hertz_mindlin
from liftdrag.engines.base import Progress
from liftdrag.engines.samples import MOST_BYTES, Ran, write_samples
from liftdrag.files import read_bytes
from liftdrag.scene.model import Part
from liftdrag.snapshot import Snapshot

SERIES = "series.csv"
FRAMES = "frames.npz"


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
class PlanarDeck:
    """A deck as read: the bed, the numbers of the contact and those of the run."""

    bed: Bed
    contact: _Contact
    run: _Run

    @property
    def steps(self) -> int:
        """All that it takes."""
        return self.run.steps

    @property
    def grains(self) -> int:
        """Bodies, the cylinder among them."""
        return len(self.bed.mass)


def read(folder: Path) -> PlanarDeck:
    """The deck of a folder. Raises OSError, ValueError or InputError when it is damaged."""
    numbers = _Numbers.model_validate(
        tomllib.loads(read_bytes(folder / NUMBERS, MOST_BYTES).decode())
    )
    return PlanarDeck(read_bed(folder), numbers.contact, numbers.run)


def run(deck: PlanarDeck, folder: Path, progress: Progress) -> Ran:
    """The run from frame to frame; it ends early where a piece does."""
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
    rows = _rows(pieces)
    write_samples(folder / SERIES, CHANNELS, numbers.row_every * numbers.time_step, rows)
    np.savez(folder / FRAMES, allow_pickle=False, **_frames(moments))
    last = pieces[-1]
    deepest = float(last.overlap.max(initial=0.0))
    return Ran(last.status, len(rows) * numbers.row_every, deepest)


def snapshots(folder: Path) -> Iterator[Snapshot]:
    """The parts of the bed, the first before the drive; the cylinder is of kind 2."""
    bed = read_bed(folder)
    kind = np.where(bed.body == len(bed.mass) - 1, 2, 1)
    frames = read_arrays(folder / FRAMES)
    for k, moment in enumerate(frames["time"]):
        now = replace(bed, position=frames["position"][k], angle=frames["angle"][k])
        velocity = frames["velocity"][k][bed.body]
        place, speed = (np.column_stack([v, np.zeros(len(v))]) for v in (now.place, velocity))
        yield Snapshot(float(moment), kind, place, speed, now.angle[bed.body])


def _frames(moments: list[tuple[float, Bed]]) -> dict[str, np.ndarray]:
    names = ("position", "angle", "velocity")
    frames = {name: np.array([getattr(bed, name) for _, bed in moments]) for name in names}
    return frames | {"time": np.array([moment for moment, _ in moments])}


def _rows(pieces: list[Advanced]) -> np.ndarray:
    """A row each `row_every` steps, in the order of CHANNELS."""
    force = np.concatenate([piece.force for piece in pieces])
    load = np.concatenate([piece.load for piece in pieces])
    rest = [
        np.concatenate([getattr(piece, name) for piece in pieces])
        for name in ("kinetic", "elastic", "overlap")
    ]
    return np.column_stack([-force[:, 1], force[:, 0], load, *rest])
