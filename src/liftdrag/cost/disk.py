"""The bytes that a run writes, from its plan, and what the disk has left for them."""

from __future__ import annotations

import shutil
from pathlib import Path

from liftdrag.numerics import (
    Drag2DNumerics,
    JanssenNumerics,
    Numerics,
    ShearNumerics,
    TankNumerics,
)
from liftdrag.scene import Drag2DScene, Scene, ShearScene, TankScene

REST = 2e6
"""Bytes of the pictures, the log and the records."""

DECK = 210.0
"""Bytes of a grain in the files that it starts from, and where it settled."""

FRAME = 90.0
"""Bytes of a grain in a picture of the bed."""

TRAJECTORY = 120.0
"""Bytes of a grain in a frame of the trajectory: 80 of text, 32 of VTK."""

RESTARTS = 1000.0
"""Bytes of a grain in three restart files: 270 in each of a small bed."""

FIELDS = 320.0
"""Bytes of a grain, its two contacts and its wall force in a snapshot for the fields."""

HEIGHT = 12.0
"""Bytes of a grain of the surface."""

LYING = 144.0
"""Bytes of a cylinder's place, velocity and axis at one time: 36, and as many in each of two states
kept and in the one that is being written."""

ROW = 260.0
"""Bytes of a row of the series, in the engine's files and in liftdrag's."""

SLICE = 120.0
"""Bytes of a slice of a column's profiles."""


def needed(scene: Scene, numerics: Numerics, dump: bool = False) -> float:
    """Bytes, roughly, at the most."""
    if isinstance(numerics, TankNumerics) and isinstance(scene, TankScene):
        return REST + _tank(scene, numerics, dump)
    if isinstance(numerics, Drag2DNumerics) and isinstance(scene, Drag2DScene):
        steps, grains = numerics.drive_steps.value, scene.grains.count
        frames = steps / numerics.frame_every.value + 2.0
        bed = grains * (2.0 * DECK + FRAME * frames) + ROW * steps / numerics.row_every.value
        return REST + scene.ensemble.runs * bed
    if isinstance(numerics, ShearNumerics) and isinstance(scene, ShearScene):
        steps = numerics.drive_steps.value
        looks = steps / numerics.frame_every.value + 1.0
        rows = 2.0 * ROW * steps / numerics.row_every.value
        return REST + scene.grain_count * (DECK + LYING * looks) + rows
    assert isinstance(numerics, JanssenNumerics)
    levels = numerics.levels
    rows = levels[-1].end / numerics.row_every.value
    slices = numerics.bins.value * levels[-1].end / numerics.block_every.value
    return REST + DECK * levels[-1].count + ROW * rows + SLICE * slices


def _tank(scene: TankScene, numerics: TankNumerics, dump: bool) -> float:
    steps, left, right = numerics.drive_steps.value, *scene.far_field
    frames = steps / numerics.snapshot_every.value + 2.0
    moments = steps / numerics.trajectory_every.value if dump else 0.0
    every = numerics.fields_every
    fields = FIELDS * (steps / every.value + 1.0) if every else 0.0
    far = (right - left) / scene.tank.length * steps / numerics.surface_every.value
    grains = numerics.grain_steps.value / (numerics.settle_steps.value + steps)
    kept = RESTARTS if numerics.restart_every.value < steps else 0.0
    of_grain = DECK + FRAME * frames + TRAJECTORY * moments + fields + HEIGHT * far + kept
    return grains * of_grain + ROW * steps / numerics.row_every.value


def free(place: Path) -> int:
    """Bytes left on the disk of a folder, or of the nearest above it that exists."""
    folder = place.absolute()
    while not folder.exists():
        folder = folder.parent
    return shutil.disk_usage(folder).free
