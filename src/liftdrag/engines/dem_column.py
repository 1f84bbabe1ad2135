"""The in-house engine on a column in a tube: filled level by level, weighed at each."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from liftdrag import dem
from liftdrag.arrays import read_arrays
from liftdrag.deck.janssen import CHANNELS, FORCES, GRAINS, START
from liftdrag.dem import (
    Column,
    ColumnMemory,
    Fallen,
    Law,
    TubeWalls,
    fall,
    hertz_mindlin,
    linear_spring,
    touching,
    walton_braun,
)
from liftdrag.engines.base import Enough, Progress
from liftdrag.engines.checkpoint import Keeper
from liftdrag.engines.fills import Fill, write_fills
from liftdrag.engines.samples import MOST_BYTES, Ran, write_samples
from liftdrag.errors import InputError
from liftdrag.files import read_bytes
from liftdrag.profile import SLIDING, Profile
from liftdrag.scene.model import Part
from liftdrag.series import Series

DECK = (START, GRAINS)
"""The files of a deck."""

PROFILES = "profiles.npz"
_SUMS = (
    "count",
    "virial",
    "wall_normal",
    "wall_shear",
    "wall_contacts",
    "mobilisation",
    "sliding",
    "spin",
)

_STATE = ("position", "velocity", "spin", "radius", "mass", "upright")
_MEMORY = ("pair", "stretch", "state", "wall_pair", "wall_stretch", "wall_state")
_SAMPLED = ("piston", "tube", "wall_normal", "kinetic", "elastic", "overlap")
_COUNTS = ("done", "at", "begin", "first")

Positive = Annotated[float, Field(gt=0.0)]
NotNegative = Annotated[float, Field(ge=0.0)]
Steps = Annotated[int, Field(ge=0)]


class _Contact(Part):
    law: Literal["linear", "hertz", "walton-braun"]
    stiffness: Positive
    restitution: Annotated[float, Field(gt=0.0, le=1.0)]
    friction: NotNegative
    tangential_ratio: Positive
    poisson_ratio: Annotated[float, Field(ge=0.0, lt=0.5)]


class _Grains(Part):
    diameter: Positive
    mass: Positive
    lid_mass: NotNegative
    gravity: NotNegative


class _Walls(Part):
    radius: Positive
    lift: float
    friction: NotNegative


class _Run(Part):
    threads: Annotated[int, Field(ge=1, le=4096)]
    bins: Annotated[int, Field(ge=1, le=1_000_000)]
    bin_height: Positive
    time_step: Positive
    settle_rate: NotNegative
    skin: Positive
    row_every: Annotated[int, Field(ge=1)]
    profile_every: Annotated[int, Field(ge=1)]
    block_every: Annotated[int, Field(ge=1)]
    fills: Annotated[list[list[Steps]], Field(min_length=1)]


class _Numbers(Part):
    contact: _Contact
    grains: _Grains
    walls: _Walls
    run: _Run


@dataclass(frozen=True)
class ColumnDeck:
    """A deck as read: centres of the grains (n, 3) and of the lid's (m, 3), and its numbers."""

    packed: np.ndarray
    lid: np.ndarray
    numbers: _Numbers

    @property
    def steps(self) -> int:
        """All that it takes."""
        return self.numbers.run.fills[-1][-1]

    @property
    def grains(self) -> int:
        """Grains at the last fill, with the lid's."""
        return self.numbers.run.fills[-1][0] + len(self.lid)


def read(folder: Path) -> ColumnDeck:
    """The deck of a folder. Raises OSError, ValueError or InputError when it is damaged."""
    numbers = _Numbers.model_validate(
        tomllib.loads(read_bytes(folder / START, MOST_BYTES).decode())
    )
    try:
        arrays = read_arrays(folder / GRAINS)
        deck = ColumnDeck(_centres(arrays["grains"]), _centres(arrays["lid"]), numbers)
    except (OSError, ValueError, LookupError) as error:
        raise InputError(
            f"{folder / GRAINS} holds no column of liftdrag ({error}); write the deck again."
        ) from None
    _check_fills(deck, folder)
    return deck


def _centres(found: np.ndarray) -> np.ndarray:
    """Centres (n, 3) as stored. Raises ValueError when they are none."""
    if found.shape[1:] != (3,) or found.dtype.kind != "f" or not np.isfinite(found).all():
        raise ValueError("centres are rows of three finite numbers")
    return found


def _check_fills(deck: ColumnDeck, folder: Path) -> None:
    run, before = deck.numbers.run, (0, 0)
    for fill in run.fills:
        good = len(fill) == 5 and before[0] < fill[0] <= len(deck.packed) and fill[1] == before[1]
        if not good or any(b < a or (b - a) % run.block_every for a, b in pairwise(fill[1:])):
            raise InputError(f"{folder / START} is wrong at run.fills: {fill} is no fill.")
        before = fill[0], fill[-1]
    if len(deck.lid) and not deck.numbers.grains.lid_mass:
        raise InputError(f"{folder / START} is wrong at grains.lid_mass: a lid weighs something.")
    if run.block_every % run.profile_every or run.profile_every % run.row_every:
        raise InputError(f"{folder / START} is wrong at run.block_every: it is no whole rows.")


def law_of(contact: _Contact) -> Law:
    """The contact law of a deck."""
    if contact.law == "hertz":
        return hertz_mindlin(
            contact.stiffness, contact.poisson_ratio, contact.restitution, contact.friction
        )
    if contact.law == "linear":
        return linear_spring(
            contact.stiffness, contact.restitution, contact.friction, contact.tangential_ratio
        )
    return walton_braun(contact.stiffness, contact.restitution, contact.friction)


def run(deck: ColumnDeck, folder: Path, progress: Progress, enough: Enough | None = None) -> Ran:
    """The column filled level by level; it ends early where a piece does.

    The average of a fill ends early where its series is `enough`.
    """
    filling = _Filling(deck, progress, enough or (lambda _: False), Keeper(folder, DECK))
    if (state := filling.keeper.latest()) is not None:
        filling.restore(state)
    begin = filling.done
    status = filling.run()
    interval = deck.numbers.run.row_every * deck.numbers.run.time_step
    write_samples(folder / FORCES, CHANNELS, interval, filling.rows())
    _write_profiles(folder, filling.profiles)
    write_fills(folder, filling.fills)
    if status == dem.FINE:
        filling.keeper.clear()
    last = filling.pieces[-1]
    return Ran(status, filling.done - begin, float(last.overlap.max(initial=0.0)), begin)


class _Filling:
    """The column on its way, and what was sampled.

    It is `at` so many blocks of the fill that began at the step `begin`, whose average begins with
    the piece `first`.
    """

    def __init__(self, deck: ColumnDeck, progress: Progress, enough: Enough, keeper: Keeper):
        self.deck, self.progress, self.enough, self.keeper = deck, progress, enough, keeper
        self.run_numbers = deck.numbers.run
        self.law = law_of(deck.numbers.contact)
        self.column = _empty(deck)
        self.pieces: list[Fallen] = []
        self.grains: list[int] = []
        self.profiles: list[Profile] = []
        self.fills: list[Fill] = []
        self.done = self.at = self.begin = self.first = 0

    def run(self) -> int:
        """Through all fills; returns FINE or why it stopped."""
        count = self.fills[-1][0] if self.fills else 0
        for more, start, settled, mobilised, end in self.run_numbers.fills[len(self.fills) :]:
            if self.at == 0:
                self.column = _filled(self.column, self.deck, count, more)
                self.begin = self.done
            if (status := self._fill(settled - start, mobilised - start, end - start)) != dem.FINE:
                return status
            self.fills.append((more, self.begin, self.begin + mobilised - start, self.done))
            count, self.at = more, 0
        return dem.FINE

    def _fill(self, settled: int, mobilised: int, end: int) -> int:
        """Through the rest of a fill, whose average ends early when it is known well enough."""
        every = self.run_numbers.block_every
        while self.at < end // every:
            averaged = self.at >= mobilised // every
            if self.at == mobilised // every:
                self.first = len(self.pieces)
            status = self._block(settling=self.at < settled // every, averaged=averaged)
            if status != dem.FINE:
                return status
            self.at += 1
            if averaged and self.enough(self._series(self.first)):
                return status
            if self.keeper.is_due():
                self.keeper.keep(self.state())
        return dem.FINE

    def state(self) -> dict[str, np.ndarray]:
        """All that the rest of the run depends on, and what was sampled so far."""
        column, memory = self.column, self.column.memory
        counts = {name: np.array(getattr(self, name)) for name in _COUNTS}
        profiles = {
            f"profile_{name}": np.array([getattr(one, name) for one in self.profiles])
            for name in ("time", *_SUMS)
        }
        return {
            **counts,
            **profiles,
            **{name: getattr(column, name) for name in _STATE},
            **{f"memory_{name}": getattr(memory, name) for name in _MEMORY},
            **{name: np.concatenate([getattr(p, name) for p in self.pieces]) for name in _SAMPLED},
            "rows": np.array([len(piece.piston) for piece in self.pieces]),
            "grains": np.array(self.grains),
            "fills": np.array(self.fills, int).reshape(-1, 4),
        }

    def restore(self, state: Mapping[str, np.ndarray]) -> None:
        """Take up a state."""
        memory = ColumnMemory(**{name: state[f"memory_{name}"] for name in _MEMORY})
        arrays: dict[str, Any] = {name: state[name] for name in _STATE}
        self.column = replace(self.column, memory=memory, **arrays)
        for name in _COUNTS:
            setattr(self, name, int(state[name]))
        ends = np.cumsum(state["rows"])[:-1]
        parts = zip(*(np.split(state[name], ends) for name in _SAMPLED), strict=True)
        self.pieces = [self._piece_of(*part) for part in parts]
        self.grains = [int(count) for count in state["grains"]]
        self.fills = [(a, b, c, d) for a, b, c, d in state["fills"].tolist()]
        self.profiles = [self._profile(state, k) for k in range(len(state["profile_time"]))]

    def _piece_of(self, *sampled: np.ndarray) -> Fallen:
        """A piece that went well, from what was sampled in it."""
        arrays: dict[str, Any] = dict(zip(_SAMPLED, sampled, strict=True))
        return Fallen(column=_nothing(self.column), status=dem.FINE, rebuilt=0, **arrays)

    def _profile(self, state: Mapping[str, np.ndarray], number: int) -> Profile:
        sums = {name: state[f"profile_{name}"][number] for name in _SUMS}
        height = _heights(self.run_numbers)
        return Profile(time=float(state["profile_time"][number]), height=height, **sums)

    def _series(self, first: int) -> Series:
        """The samples from a piece on."""
        rows = self.rows(first)
        interval = self.run_numbers.row_every * self.run_numbers.time_step
        last = self.done // self.run_numbers.row_every
        moment = np.arange(last - len(rows) + 1, last + 1) * interval
        return Series(moment, dict(zip(CHANNELS, rows.T, strict=True)), CHANNELS)

    def _block(self, settling: bool, averaged: bool) -> int:
        numbers = self.run_numbers
        every = numbers.profile_every if averaged else numbers.block_every
        found = list[Profile]()
        for _ in range(0, numbers.block_every, every):
            status = self._piece(every, settling)
            if status != dem.FINE:
                return status
            if averaged:
                found.append(_profile(self.column, self.law, self.deck))
        if found:
            self.profiles.append(_mean(found, self.done * numbers.time_step))
        return dem.FINE

    def _piece(self, steps: int, settling: bool) -> int:
        numbers = self.run_numbers
        piece = fall(
            self.column,
            self.law,
            numbers.time_step,
            steps // numbers.row_every,
            numbers.row_every,
            numbers.skin,
            numbers.settle_rate if settling else 0.0,
            threads=numbers.threads,
        )
        self.column = piece.column
        self.pieces.append(replace(piece, column=_nothing(piece.column)))
        self.grains.append(len(piece.column.mass))
        self.done += len(piece.piston) * numbers.row_every
        self.progress("drive", self.done, self.deck.steps)
        return piece.status

    def rows(self, first: int = 0) -> np.ndarray:
        """Samples (r, c) from a piece on, in the order of CHANNELS."""
        each = [
            np.column_stack(
                [
                    piece.piston,
                    piece.tube,
                    piece.wall_normal,
                    piece.kinetic / grains,
                    piece.elastic,
                    piece.overlap,
                ]
            )
            for piece, grains in zip(self.pieces[first:], self.grains[first:], strict=True)
        ]
        return np.concatenate(each)


def _empty(deck: ColumnDeck) -> Column:
    """The lid alone, nowhere yet."""
    numbers = deck.numbers
    walls = numbers.walls
    count = len(deck.lid)
    return Column(
        position=deck.lid.copy(),
        velocity=np.zeros((count, 3)),
        spin=np.zeros((count, 3)),
        radius=np.full(count, numbers.grains.diameter / 2.0),
        mass=np.full(count, numbers.grains.lid_mass / max(count, 1)),
        upright=np.ones(count, bool),
        walls=TubeWalls(walls.radius, walls.lift, walls.friction, numbers.contact.friction),
        gravity=numbers.grains.gravity,
    )


def _filled(column: Column, deck: ColumnDeck, count: int, more: int) -> Column:
    """The column with the grains from `count` to `more` on its top, the lid on theirs, at rest."""
    lid, grains = len(deck.lid), deck.numbers.grains
    layer = deck.packed[count:more].copy()
    if count:
        highest = column.position[lid:, 2].max()
        layer[:, 2] += highest + grains.diameter - layer[:, 2].min()
    position, velocity = column.position.copy(), column.velocity.copy()
    if lid:
        position[:lid, 2] = layer[:, 2].max() + grains.diameter
        velocity[:lid] = 0.0
    new, still = len(layer), np.zeros((len(layer), 3))
    return replace(
        column,
        position=np.vstack([position, layer]),
        velocity=np.vstack([velocity, still]),
        spin=np.vstack([column.spin, still]),
        radius=np.append(column.radius, np.full(new, grains.diameter / 2.0)),
        mass=np.append(column.mass, np.full(new, grains.mass)),
        upright=np.append(column.upright, np.zeros(new, bool)),
    )


def _nothing(column: Column) -> Column:
    """The column without its arrays, which the samples do not need."""
    none = np.zeros((0, 3))
    return replace(column, position=none, velocity=none, spin=none, memory=ColumnMemory())


def _profile(column: Column, law: Law, deck: ColumnDeck) -> Profile:
    """The sums over each slice at this moment, without the lid."""
    run, lid = deck.numbers.run, len(deck.lid)
    slices = np.minimum((column.position[:, 2] / run.bin_height).astype(int), run.bins - 1)

    def summed(grain: np.ndarray, values: np.ndarray) -> np.ndarray:
        own = grain >= lid
        return np.bincount(slices[grain[own]], values[own], run.bins)

    between, walls = touching(column, law)
    at_tube = (walls.pair[:, 1] == 0) & (walls.push != 0.0)
    grain, normal = walls.pair[at_tube, 0], walls.normal[at_tube]
    push, pull = walls.push[at_tube], walls.pull[at_tube]
    size, limit = np.sqrt((pull**2).sum(axis=1)), column.walls.tube_friction * abs(push)
    share = np.divide(size, limit, out=np.zeros_like(size), where=limit > 0.0)
    spin = column.spin[grain]
    one = np.ones(len(grain))
    lever = column.position[between.pair[:, 1], 2] - column.position[between.pair[:, 0], 2]
    virial = -0.5 * lever * (between.pull[:, 2] - between.push * between.normal[:, 2])
    return Profile(
        time=0.0,
        height=_heights(run),
        count=summed(np.arange(len(slices)), np.ones(len(slices))),
        virial=summed(between.pair[:, 0], virial) + summed(between.pair[:, 1], virial),
        wall_normal=summed(grain, push),
        wall_shear=summed(grain, pull[:, 2]),
        wall_contacts=summed(grain, one),
        mobilisation=summed(grain, share),
        sliding=summed(grain, np.where(share > SLIDING, one, 0.0)),
        spin=summed(grain, normal[:, 1] * spin[:, 0] - normal[:, 0] * spin[:, 1]),
    )


def _heights(run: _Run) -> np.ndarray:
    """The middles (b,) of the slices, m."""
    heights: np.ndarray = (np.arange(run.bins) + 0.5) * run.bin_height
    return heights


def _mean(profiles: list[Profile], time: float) -> Profile:
    means = {name: np.mean([getattr(p, name) for p in profiles], axis=0) for name in _SUMS}
    return replace(profiles[0], time=time, **means)


def _write_profiles(folder: Path, profiles: list[Profile]) -> None:
    arrays = {name: np.array([getattr(p, name) for p in profiles]) for name in ("time", *_SUMS)}
    height = profiles[0].height if profiles else np.zeros(0)
    np.savez(folder / PROFILES, allow_pickle=False, height=height, **arrays)


def profiles(folder: Path) -> Iterator[Profile]:
    """The profiles of the averaged blocks, in order of time."""
    arrays = read_arrays(folder / PROFILES)
    for k, moment in enumerate(arrays["time"]):
        sums = {name: arrays[name][k] for name in _SUMS}
        yield Profile(time=float(moment), height=arrays["height"], **sums)
