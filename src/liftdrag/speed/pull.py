"""A packing of the closed bed pulled through by the in-house engine."""

from __future__ import annotations

import time

from liftdrag.case import load
from liftdrag.dem import Bed, advance
from liftdrag.numerics import Drag2DNumerics, derive
from liftdrag.packing.drag2d import law_of
from liftdrag.scene import Drag2DScene


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
