"""Beds of discs in the plane, from 400 grains to 100 000, on one thread and on two."""

from __future__ import annotations

import time
from collections.abc import Iterator

import numpy as np

from liftdrag.dem import Bed, advance
from liftdrag.packing.drag2d import law_of, packed
from liftdrag.speed.pull import scene_of
from liftdrag.speed.rounds import best

SKIN = 0.3
"""Neighbour skin of the tiled beds, in grain diameters."""

TILES = (1, 2, 5, 10, 16)
"""Packings of 400 grains side by side, in both directions."""

GRAIN_STEPS = 20_000_000
"""Grain-steps of a timed run of a tiled bed, of 1000 to 2000 steps."""


def sizes() -> Iterator[str]:
    """The cost of a grain-step from 400 to 100 000 grains, on one thread and on two."""
    scene, numerics = scene_of("zhou/c1")
    law, first = law_of(scene), 0.0
    for tiles in TILES:
        bed = tiled(tiles)
        count = len(bed.mass)
        steps = min(max(GRAIN_STEPS // count, 1000), 2000)

        def run(threads: int, bed: Bed = bed, steps: int = steps) -> float:
            begin = time.perf_counter()
            step, skin = numerics.time_step.value, SKIN * scene.grains.diameter
            advance(bed, law, step, 1, steps, skin, threads=threads)
            return (time.perf_counter() - begin) / steps / len(bed.mass)

        run(2)
        alone, together = best(lambda: run(1), lambda: run(2), rounds=3)
        first = first or alone
        yield (
            f"{count} discs: {alone * 1e9:.1f} ns per grain-step, {alone / first:.2f} times the "
            f"smallest bed's; two threads {alone / together:.2f} times as fast"
        )


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
