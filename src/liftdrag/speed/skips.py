"""What a tank's deck skips, and what that saves: each skip by turns with the work done after all.

A bed of `guillard2014/half-height`, 60 d long, is packed and settled once. Every deck drives that
bed for the same steps. Times are of the processor, which other work on the machine disturbs less
than the clock.
"""

from __future__ import annotations

import re
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from math import pi
from pathlib import Path
from time import process_time

from liftdrag.case import Case, load
from liftdrag.deck import Deck
from liftdrag.deck.tank import Bed, build, packed
from liftdrag.engines import engine
from liftdrag.engines.base import silent
from liftdrag.engines.checks import LOOP
from liftdrag.engines.family import read_dump
from liftdrag.numerics import TankNumerics, derive
from liftdrag.scene import TankScene
from liftdrag.scene.tank import SETTLED_FRACTION
from liftdrag.speed.rounds import best

LENGTH = "60 d"
"""Of the tank: some 34 000 grains."""

STEPS = 400
"""Of a timed drive."""

LOADING = 50
"""Steps before it, in which contacts load their springs."""

ROUNDS = 3

_USED = re.compile(r"([\d.]+)% CPU use")
_PAIRS = re.compile(r"^Neighs: +(\S+) ave +(\S+) max", re.MULTILINE)

FRICTION = r"tangential linear_nohistory 0 0"
"""How LAMMPS is told that contacts do not rub."""

WORK: Mapping[str, tuple[str, str]] = {
    "pairs among the fixed grains": (r"^neigh_modify exclude .*\n", ""),
    "a skin of 0.3 d": (r"^(neighbor +)\S+", r"\g<1>0.00045"),
    "grains left unsorted": (r"sort 1000 0.0", "sort 0 0.0"),
    "OPENMP on two threads": (r"\A", "package omp 2\nsuffix omp\n"),
}
"""Work that a deck skips: the line of it that is changed, and to what."""

PICTURES = r"^dump.*\n"
"""What a deck writes for pictures and for the depth of the surface."""


@dataclass(frozen=True)
class Tank:
    """A settled bed, and the processor seconds that packing and settling it took."""

    case: Case
    bed: Bed
    packing_s: float
    settling_s: float

    @property
    def grains(self) -> int:
        """How many, the fixed ones among them."""
        return len(self.bed.types)

    def deck(self, settings: Mapping[str, object] | None = None, ranks: int = 1) -> Deck:
        """The deck that drives the bed, with other settings of the case."""
        scene = scene_of(self.case, settings or {})
        deck = build(scene, _unsettled(derive(scene, ranks)), "speed", "", ranks, bed=self.bed)
        return changed(deck, r"(drive_steps index) \d+", rf"\1 {STEPS}")

    def costs(self, *decks: Deck) -> list[float]:
        """Processor seconds of a rank per grain-step of the drive, of each deck."""
        return best(*(partial(grain_step, deck) for deck in decks), rounds=ROUNDS)


def skips() -> Iterator[str]:
    """Work that a tank's deck leaves out, and what it would cost."""
    tank = settled_tank()
    yield (
        f"{tank.grains} grains: packed in {tank.packing_s:.0f} s, settled in "
        f"{tank.settling_s:.0f} s of processor time"
    )
    yield from work(tank)
    yield from pictures(tank)
    yield from grid(tank)
    yield from friction(tank)
    yield from law(tank)
    yield from lid()


def work(tank: Tank) -> Iterator[str]:
    """Each piece of work that is skipped, done."""
    deck = tank.deck()
    decks = [changed(deck, pattern, text) for pattern, text in WORK.values()]
    own, *others = tank.costs(deck, *decks)
    yield f"as written: {own * 1e9:.0f} ns per grain-step"
    for name, cost in zip(WORK, others, strict=True):
        yield f"{name}: {cost / own:.3f} times the time"


def pictures(tank: Tank) -> Iterator[str]:
    """What dumps cost that the answers or their pictures need."""
    deck = tank.deck()
    own, bare = tank.costs(deck, changed(deck, PICTURES, ""))
    yield f"surfaces and snapshots: {own / bare:.3f} times the time without"


def grid(tank: Tank) -> Iterator[str]:
    """Two ranks side by side along the flow, and as LAMMPS would place them."""
    deck = tank.deck(ranks=2)
    default = changed(deck, r"^processors .*", "processors * * *")
    own, other = (max(map(float, _PAIRS.findall(driven(one))[-1])) for one in (deck, default))
    yield f"two ranks on LAMMPS' own grid: the busier one has {other / own:.2f} times the pairs"


def friction(tank: Tank) -> Iterator[str]:
    """Grains without friction, with springs that never act and spins that never change."""
    deck = tank.deck({"grains.friction": 0.0})
    old = changed(changed(deck, FRICTION, "tangential mindlin NULL 1 0"), r"\bnve\b", "nve/sphere")
    own, spun = tank.costs(deck, old)
    yield f"friction 0, tangential springs and spins kept: {spun / own:.3f} times the time"


def law(tank: Tank) -> Iterator[str]:
    """LAMMPS' older contact law between the grains."""
    own, classic = tank.costs(tank.deck(), tank.deck({"numerics.pair_law": "hertz/history"}))
    yield f"numerics.pair_law = hertz/history: {own / classic:.2f} times as fast"


def lid() -> Iterator[str]:
    """Grains that a lid's weight stands for, in the paper's tank."""
    scene = scene_of(load("guillard2014/lid"), {})
    assert scene.lid is not None
    depth = pi * scene.grains.diameter / 6.0 * scene.lid.density_ratio / SETTLED_FRACTION
    deeper = {
        "tank.height": scene.tank.height + depth,
        "intruder.depth": scene.intruder.depth + depth,
    }
    column = scene_of(load("guillard2014/free-surface"), deeper)
    yield (
        f"a lid of {scene.lid.density_ratio:g} rho_g: {scene.grain_count} grains instead of "
        f"{column.grain_count}, {column.grain_count / scene.grain_count:.2f} times as many"
    )


def settled_tank() -> Tank:
    """The bed, packed and settled by LAMMPS."""
    case = load("guillard2014/half-height").set("tank.length", LENGTH)
    scene = scene_of(case, {})
    start = process_time()
    bed = packed(scene)
    packing_s = process_time() - start
    deck = build(scene, derive(scene), "speed", "", bed=bed)
    deck = changed(deck, r"(drive_steps index) \d+", r"\1 1")
    with tempfile.TemporaryDirectory() as name:
        deck.write(Path(name))
        outcome = engine("lammps").run(deck.plan, Path(name), silent)
        _, rows = next(read_dump(Path(name) / "settled.dump"))
    return Tank(case, replace(bed, positions=rows[:, 2:5], settled=True), packing_s, outcome.cpu_s)


def _unsettled(numerics: TankNumerics) -> TankNumerics:
    """Numerics of a bed that need not come to rest."""
    steps = replace(numerics.settle_steps, value=LOADING)
    energy = replace(numerics.settle_energy, value=1.0)
    return replace(numerics, settle_steps=steps, settle_energy=energy)


def scene_of(case: Case, settings: Mapping[str, object]) -> TankScene:
    """The scene of a case with other settings."""
    for key, value in settings.items():
        case = case.set(key, value)
    assert isinstance(case.scene, TankScene)
    return case.scene


def grain_step(deck: Deck) -> float:
    """Processor seconds of a rank per grain-step of LAMMPS' drive."""
    log = driven(deck)
    seconds, steps, grains = map(float, LOOP.findall(log)[-1])
    return seconds * float(_USED.findall(log)[-1]) / 100.0 / (steps * grains)


def driven(deck: Deck) -> str:
    """The log of LAMMPS on a deck."""
    with tempfile.TemporaryDirectory() as name:
        deck.write(Path(name))
        outcome = engine("lammps").run(deck.plan, Path(name), silent)
        log = (Path(name) / "log.lammps").read_text("utf-8")
    assert len(LOOP.findall(log)) == 2, outcome.evidence
    return log


def changed(deck: Deck, pattern: str, text: str) -> Deck:
    """A deck in which what matches `pattern` is another text; it has to be there."""
    found, count = re.subn(pattern, text, deck.texts["in.tank"], flags=re.MULTILINE)
    assert count, pattern
    return replace(deck, texts=dict(deck.texts) | {"in.tank": found})
