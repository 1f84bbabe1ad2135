"""The in-house engine on a sheared cell of cylinders: reads its deck, runs it, writes samples."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator, Mapping
from contextlib import nullcontext
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from liftdrag import dem
from liftdrag.arrays import read_arrays
from liftdrag.deck.shear import CHANNELS, GRAINS, START, STRESSES, read_grains
from liftdrag.dem import hertz_mindlin
from liftdrag.dem.cylinders import Cell, Cylinders, Sample, shear
from liftdrag.engines.base import Enough, Progress
from liftdrag.engines.checkpoint import Keeper
from liftdrag.engines.samples import MOST_BYTES, Ran, write_samples
from liftdrag.files import read_bytes
from liftdrag.scene.model import Part
from liftdrag.series import Series
from liftdrag.snapshot import Snapshot

DECK = (START, GRAINS)
"""The files of a deck."""

LOOKS = "looks.npz"
"""Places, velocities and axes of the grains, look by look, in single precision."""

_SEEN = ("position", "velocity", "axis")
_STATE = (*_SEEN, "spin")

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
    keeper, flow = Keeper(folder, DECK), _Flow(deck)
    if (state := keeper.latest()) is not None:
        flow.restore(state)
    begin, status = flow.done, dem.FINE
    for last in flow.samples():
        flow.add(last)
        status = last.status
        over = status != dem.FINE or flow.done == deck.steps or flow.is_enough(enough)
        with nullcontext() if over else keeper.guarding(partial(flow.state, last)):
            progress("drive", flow.done, deck.steps)
        if over:
            break
        if keeper.is_due():
            keeper.keep(flow.state(last))
    write_samples(folder / STRESSES, CHANNELS, flow.interval, flow.rows)
    np.savez(folder / LOOKS, allow_pickle=False, **flow.looks)
    if status == dem.FINE:
        keeper.clear()
    return Ran(status, flow.done - begin, flow.deepest, begin)


class _Flow:
    """The cell on its way: a row of each sample in the order of CHANNELS, and the looks."""

    def __init__(self, deck: ShearDeck):
        self._deck, self._run = deck, deck.numbers.run
        self._values = np.empty((self._run.steps // self._run.row_every, len(CHANNELS)))
        self._looks, self._count = [_look(0.0, deck.cylinders)], 0
        self._grains, self._shift, self._time = deck.cylinders, 0.0, 0.0
        self._angular_momentum = deck.cylinders.angular_momentum

    def samples(self) -> Iterator[Sample]:
        """Those still to come."""
        numbers, run = self._deck.numbers, self._run
        cell = Cell(np.array(numbers.cell.size), numbers.cell.shear_rate, self._shift)
        contact = numbers.contact
        law = hertz_mindlin(
            contact.youngs_modulus, contact.poisson_ratio, contact.restitution, friction=0.0
        )
        return shear(
            self._grains,
            cell,
            law,
            run.time_step,
            run.row_every,
            run.skin,
            threads=run.threads,
            angular_momentum=self._angular_momentum,
            time=self._time,
        )

    def add(self, sample: Sample) -> None:
        """Keep a sample, and of some a look; of one that broke none."""
        self._values[self._count] = _row(sample)
        self._count += 1
        if sample.status == dem.FINE and self._looks_now:
            self._looks.append(_look(sample.time, sample.grains))

    @property
    def _looks_now(self) -> bool:
        return self.done % self._run.frame_every == 0

    def is_enough(self, enough: Enough | None) -> bool:
        """Whether the series so far is, which is asked at each look."""
        return enough is not None and self._looks_now and enough(self._series())

    def state(self, last: Sample) -> dict[str, np.ndarray]:
        """All that the rest of the run depends on, and what was sampled so far."""
        return {
            "done": np.array(self.done),
            "rows": self.rows,
            "shift": np.array(last.cell.shift),
            "time": np.array(last.time),
            "angular_momentum": last.angular_momentum,
            **{name: getattr(last.grains, name) for name in _STATE},
            **{f"look_{name}": values for name, values in self.looks.items()},
        }

    def restore(self, state: Mapping[str, np.ndarray]) -> None:
        """Take up a state."""
        self._count = len(state["rows"])
        self._values[: self._count] = state["rows"]
        names = ("time", *_SEEN)
        looks = zip(*(state[f"look_{name}"] for name in names), strict=True)
        self._looks = [dict(zip(names, look, strict=True)) for look in looks]
        arrays: dict[str, Any] = {name: state[name] for name in _STATE}
        self._grains = replace(self._grains, **arrays)
        self._shift, self._time = float(state["shift"]), float(state["time"])
        self._angular_momentum = state["angular_momentum"]

    @property
    def done(self) -> int:
        """Steps."""
        return self._count * self._run.row_every

    @property
    def interval(self) -> float:
        """Time (s) from row to row."""
        return self._run.row_every * self._run.time_step

    @property
    def rows(self) -> np.ndarray:
        """Those so far (r, c)."""
        return self._values[: self._count]

    @property
    def looks(self) -> dict[str, np.ndarray]:
        """Those so far: their times, and of each the arrays of the grains."""
        return {name: np.array([look[name] for look in self._looks]) for name in ("time", *_SEEN)}

    @property
    def deepest(self) -> float:
        """The deepest overlap so far."""
        return float(self.rows[:, -1].max(initial=0.0))

    def _series(self) -> Series:
        moment = np.arange(1, self._count + 1) * self.interval
        return Series(moment, dict(zip(CHANNELS, self.rows.T, strict=True)), CHANNELS)


def _look(time: float, grains: Cylinders) -> dict[str, Any]:
    seen = {name: np.array(getattr(grains, name), np.float32) for name in _SEEN}
    return {"time": time, **seen}


def _row(sample: Sample) -> list[float]:
    return [
        *sample.kinetic.ravel(),
        *sample.contact.ravel(),
        sample.translational,
        sample.rotational,
        sample.elastic,
        _momentum(sample),
        sample.jumps,
        sample.overlap,
    ]


def _momentum(sample: Sample) -> float:
    """The size of the momentum against the mean flow, kg m/s."""
    grains, cell = sample.grains, sample.cell
    against = grains.velocity.copy()
    against[:, 0] -= cell.shear_rate * (grains.position[:, 1] - 0.5 * cell.size[1])
    return float(np.linalg.norm(grains.mass @ against))


def snapshots(folder: Path) -> Iterator[Snapshot]:
    """The grains at each look, of the kind that is their species; the first as they began."""
    species = read_grains(folder)[1]
    looks = read_arrays(folder / LOOKS)
    for k, moment in enumerate(looks["time"]):
        place, velocity, axis = (looks[name][k] for name in ("position", "velocity", "axis"))
        if place.shape != (len(species), 3):
            raise ValueError(f"{folder / LOOKS} holds other grains than the deck")
        yield Snapshot(float(moment), species, place, velocity, axis=axis)
