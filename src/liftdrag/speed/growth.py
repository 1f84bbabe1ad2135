"""How the cost of a tank grows with its grains, from a thousand to a million, on LAMMPS.

A bed of `guillard2014/half-height` is packed; larger ones are copies of it along the drive, where
the tank is periodic. They are driven as packed, where a grain-step costs what it costs in a bed at
rest, within 4 %.
"""

from __future__ import annotations

import contextlib
import os
import re
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from liftdrag.case import Case, load
from liftdrag.cost.calibration import unsettled
from liftdrag.deck import Deck
from liftdrag.deck.tank import Bed, build, packed
from liftdrag.engines import engine
from liftdrag.engines.base import Progress, silent
from liftdrag.engines.checks import LOOP
from liftdrag.numerics import derive
from liftdrag.scene import TankScene
from liftdrag.speed.rounds import best

SIZES = ((28, 3, 12, 1), (28, 10, 31, 1), (36, 10, 50, 5), (36, 10, 50, 13), (36, 10, 50, 49))
"""Length, thickness and height of a bed in d, and its copies.

The cylinder stands at 3/4 of a tank, and so does one of the holes for it in 4 k + 1 copies.
"""

GRAIN_STEPS, LEAST_STEPS, MOST_STEPS = 10_000_000, 60, 5000
"""Grain-steps of a timed drive, and the bounds on its steps."""

ROUNDS = 3


@dataclass(frozen=True)
class Size:
    """A tank and its bed, and what it took to pack a grain of it, s."""

    scene: TankScene
    bed: Bed
    packing_s: float

    @property
    def grains(self) -> int:
        """How many, the bottom layer among them."""
        return len(self.bed.types)


def growth() -> Iterator[str]:
    """Tanks of a thousand to a million grains, on LAMMPS with one rank and with two."""
    first = 0.0
    for size in sizes():
        decks = [size_deck(size, ranks) for ranks in (2, 1)]
        (once, each), (single, whole) = map(watched, decks)
        times = best(*(partial(grain_step, deck) for deck in decks), rounds=ROUNDS - 1)
        together, alone = min(once, times[0]), min(single, times[1])
        first = first or alone
        yield (
            f"{size.grains} grains: {alone * 1e9:.0f} ns per grain-step, {1e-6 / alone:.2f} "
            f"million a second, {alone / first:.2f} times the smallest tank's; two ranks "
            f"{alone / together:.2f} times as fast; {whole:.0f} MB, on two ranks "
            f"{each:.0f} MB each; {size.packing_s * 1e6:.0f} us to pack a grain"
        )


def sizes() -> Iterator[Size]:
    """The tanks in order of their grains; copies of a bed are packed once."""
    made: dict[tuple[int, int, int], Size] = {}
    for length, thickness, height, copies in SIZES:
        sides = (length, thickness, height)
        if sides not in made:
            made[sides] = _packed(*sides)
        yield tiled(made[sides], copies)


def _packed(length: int, thickness: int, height: int) -> Size:
    scene = _scene(load("guillard2014/half-height"), length, thickness, height)
    start = time.perf_counter()
    bed = packed(scene)
    return Size(scene, bed, (time.perf_counter() - start) / len(bed.types))


def _scene(case: Case, length: float, thickness: float, height: float) -> TankScene:
    """The case in a tank of these sides in d, its cylinder at half the height."""
    case = case.set("intruder.depth", f"{height / 2} d")
    for side, diameters in (("length", length), ("thickness", thickness), ("height", height)):
        case = case.set(f"tank.{side}", f"{diameters} d")
    assert isinstance(case.scene, TankScene)
    return case.scene


def tiled(size: Size, copies: int) -> Size:
    """A tank that is longer by so many copies of its bed, one beside the other along x."""
    box, bed = size.scene.tank, size.bed
    shift = np.repeat(np.arange(copies) * box.length, size.grains)
    positions = np.tile(bed.positions, (copies, 1))
    positions[:, 0] += shift
    longer = box.model_copy(update={"length": copies * box.length})
    scene = size.scene.model_copy(update={"tank": longer})
    return replace(size, scene=scene, bed=Bed(positions, np.tile(bed.types, copies)))


def size_deck(size: Size, ranks: int) -> Deck:
    """The deck that drives the bed for the steps that are timed."""
    steps = min(max(GRAIN_STEPS // size.grains, LEAST_STEPS), MOST_STEPS)
    numerics = unsettled(derive(size.scene, ranks), steps)
    return build(size.scene, numerics, "speed", "", ranks, bed=size.bed)


def grain_step(deck: Deck, look: Progress = silent) -> float:
    """Seconds per grain-step of LAMMPS' drive."""
    with tempfile.TemporaryDirectory() as name:
        deck.write(Path(name))
        outcome = engine("lammps").run(deck.plan, Path(name), look)
        loops = LOOP.findall((Path(name) / "log.lammps").read_text("utf-8"))
    assert len(loops) == 2, outcome.evidence
    seconds, steps, grains = map(float, loops[-1])
    return seconds / (steps * grains)


def watched(deck: Deck) -> tuple[float, float]:
    """The same, and the most memory (MB) that a process was seen to take, as Linux counts it."""
    seen = [0.0]

    def look(_stage: str, _done: int, _total: int) -> None:
        seen.extend(map(_resident, _below(os.getpid())))

    return grain_step(deck, look), max(seen)


def _below(process: int) -> Iterator[int]:
    """The processes that a process has started, and those that these have."""
    with contextlib.suppress(OSError):
        for child in Path(f"/proc/{process}/task/{process}/children").read_text().split():
            yield int(child)
            yield from _below(int(child))


def _resident(process: int) -> float:
    """The largest resident memory (MB) of a process, zero when it has ended."""
    try:
        found = re.search(r"VmHWM:\s+(\d+) kB", Path(f"/proc/{process}/status").read_text())
    except OSError:
        return 0.0
    return int(found[1]) / 1e3 if found else 0.0
