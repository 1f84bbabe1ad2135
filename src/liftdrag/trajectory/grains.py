"""The trajectory of a tank, whose engine wrote the dump, as VTK.

Points with `id`, `type`, `diameter` (m) and `velocity` (m/s); `cylinder.vtp` is the surface of the
intruder.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from liftdrag.engines.family import read_dump
from liftdrag.errors import InputError
from liftdrag.scene import Scene, TankScene
from liftdrag.trajectory.collection import DUMP

if TYPE_CHECKING:
    import pyvista

INTRUDER = "cylinder.vtp"

COLUMNS = "id type radius x y z vx vy vz".split()
"""Of the dump."""


def points(
    folder: Path, scene: Scene, time_step: float
) -> Iterator[tuple[float, pyvista.PolyData]]:
    """The time (s) and the grains of each frame; that of a tank has its intruder written first.

    Raises InputError where the dump is damaged.
    """
    if isinstance(scene, TankScene):
        _cylinder(scene).save(folder / INTRUDER)
    try:
        for step, rows in read_dump(folder / DUMP):
            yield step * time_step, _grains(rows)
    except ValueError as error:
        raise InputError(f"The trajectory is damaged ({error}); run the case again.") from None


def _grains(rows: np.ndarray) -> pyvista.PolyData:
    """The grains of a frame (n, 9) as points with data."""
    import pyvista

    if rows.shape[1] != len(COLUMNS):
        raise ValueError(f"{rows.shape[1]} columns, not {' '.join(COLUMNS)}")
    grains = pyvista.PolyData(rows[:, 3:6].astype(np.float32))
    grains["id"] = rows[:, 0].astype(np.int32)
    grains["type"] = rows[:, 1].astype(np.int32)
    grains["diameter"] = (2.0 * rows[:, 2]).astype(np.float32)
    grains["velocity"] = rows[:, 6:9].astype(np.float32)
    return grains


def _cylinder(scene: TankScene) -> pyvista.PolyData:
    import pyvista

    return pyvista.Cylinder(
        center=(scene.axis_x, scene.tank.thickness / 2.0, scene.axis_height),
        direction=(0.0, 1.0, 0.0),
        radius=scene.intruder.diameter / 2.0,
        height=scene.tank.thickness,
    )
