"""The in-house engine on a sheared cell of cylinders: reads its deck, runs it, writes samples."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Field

from liftdrag import dem
from liftdrag.arrays import read_arrays
from liftdrag.deck.shear import CHANNELS, START, STRESSES, read_grains
from liftdrag.dem import hertz_mindlin
from liftdrag.dem.cylinders import Cell, Cylinders, Sample, shear
from liftdrag.engines.base import Enough, Progress
from liftdrag.engines.samples import MOST_BYTES, Ran, write_samples
from liftdrag.files import read_bytes
from liftdrag.scene.model import Part
from liftdrag.series import Series
from liftdrag.snapshot import Snapshot

LOOKS = "looks.npz"
"""Places and axes of the grains, look by look, in single precision."""

Positive = Annotated[float, Field(gt=0.0)]
Steps = Annotated[int, Field(gt=0)]


class _Contact(Part):
    youngs_modulus: Positive
    poisson_ratio: Annotated[float, Field(ge=0.0, lt=0.5)]
    restitution: Annotated[float, Field(gt=0.0, le=1.0)]


class _Cell(Part):
    size: Annotated[list[Positive], Field(min_length=3, max_length=3)]
    shear_rate: Positive


class _Run(Part):
    threads: Annotated[int, Field(ge=1, le=4096)]
    time_step: Positive
    steps: Steps
    row_every: Steps
    frame_every: Steps
    skin: Positive


class _Numbers(Part):
    contact: _Contact
    cell: _Cell
    run: _Run


@dataclass(frozen=True)
class ShearDeck:
    """A deck as read: the grains, their species (n,) from 1, and its numbers."""

    cylinders: Cylinders
    species: np.ndarray
    numbers: _Numbers

    @property
    def steps(self) -> int:
        """All that it takes."""
        return self.numbers.run.steps

    @property
    def grains(self) -> int:
        """Cylinders."""
        return len(self.species)


def read(folder: Path) -> ShearDeck:
    """The deck of a folder. Raises OSError, ValueError or InputError when it is damaged."""
    numbers = _Numbers.model_validate(
        tomllib.loads(read_bytes(folder / START, MOST_BYTES).decode())
    )
    run = numbers.run
    if run.steps % run.frame_every or run.frame_every % run.row_every:
        raise ValueError("run.steps is no whole number of frames, or a frame of rows")
    return ShearDeck(*read_grains(folder), numbers)


def run(deck: ShearDeck, folder: Path, progress: Progress, enough: Enough | None = None) -> Ran:
    """The cell sheared row by row, until its series is `enough`; it ends early where it breaks."""
    rows, looks = _Rows(deck), [(0.0, deck.cylinders)]
    every, last = deck.numbers.run.frame_every // deck.numbers.run.row_every, None
    for last in _samples(deck):
        rows.add(last)
        progress("drive", rows.count * deck.numbers.run.row_every, deck.steps)
        if last.status != dem.FINE or rows.count % every:
            continue
        looks.append((last.time, last.grains))
        if rows.count == len(rows.values) or (enough and enough(rows.series())):
            break
    write_samples(folder / STRESSES, CHANNELS, rows.interval, rows.values[: rows.count])
    _write_looks(folder, looks)
    assert last is not None
    return Ran(last.status, rows.count * deck.numbers.run.row_every, rows.deepest)


def _samples(deck: ShearDeck) -> Iterator[Sample]:
    numbers = deck.numbers
    cell = Cell(np.array(numbers.cell.size), numbers.cell.shear_rate)
    contact = numbers.contact
    law = hertz_mindlin(
        contact.youngs_modulus, contact.poisson_ratio, contact.restitution, friction=0.0
    )
    run = numbers.run
    return shear(
        deck.cylinders, cell, law, run.time_step, run.row_every, run.skin, threads=run.threads
    )


class _Rows:
    """The samples so far, in the order of CHANNELS."""

    def __init__(self, deck: ShearDeck):
        run = deck.numbers.run
        self.interval, self.count = run.row_every * run.time_step, 0
        self.values = np.empty((run.steps // run.row_every, len(CHANNELS)))

    def add(self, sample: Sample) -> None:
        """Keep a sample."""
        self.values[self.count] = [
            *sample.kinetic.ravel(),
            *sample.contact.ravel(),
            sample.translational,
            sample.rotational,
            sample.elastic,
            _momentum(sample),
            sample.jumps,
            sample.overlap,
        ]
        self.count += 1

    @property
    def deepest(self) -> float:
        """The deepest overlap so far."""
        return float(self.values[: self.count, -1].max(initial=0.0))

    def series(self) -> Series:
        """Those so far."""
        moment = np.arange(1, self.count + 1) * self.interval
        columns = self.values[: self.count].T
        return Series(moment, dict(zip(CHANNELS, columns, strict=True)), CHANNELS)


def _momentum(sample: Sample) -> float:
    """The size of the momentum against the mean flow, kg m/s."""
    grains, cell = sample.grains, sample.cell
    against = grains.velocity.copy()
    against[:, 0] -= cell.shear_rate * (grains.position[:, 1] - 0.5 * cell.size[1])
    return float(np.linalg.norm(grains.mass @ against))


def _write_looks(folder: Path, looks: list[tuple[float, Cylinders]]) -> None:
    arrays = {
        name: np.array([getattr(grains, name) for _, grains in looks], np.float32)
        for name in ("position", "velocity", "axis")
    }
    time = np.array([moment for moment, _ in looks])
    np.savez(folder / LOOKS, allow_pickle=False, time=time, **arrays)


def snapshots(folder: Path) -> Iterator[Snapshot]:
    """The grains at each look, of the kind that is their species; the first as they began."""
    species = read_grains(folder)[1]
    looks = read_arrays(folder / LOOKS)
    for k, moment in enumerate(looks["time"]):
        place, velocity, axis = (looks[name][k] for name in ("position", "velocity", "axis"))
        if place.shape != (len(species), 3):
            raise ValueError(f"{folder / LOOKS} holds other grains than the deck")
        yield Snapshot(float(moment), species, place, velocity, axis=axis)
