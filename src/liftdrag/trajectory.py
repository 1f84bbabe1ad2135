"""The trajectory of a run for others' programs: `trajectory.dump` as VTK.

OVITO opens the dump itself. ParaView opens `grains.pvd`, the times of `grains/*.vtp`, one file a
frame: points with `id`, `type`, `diameter` (m) and `velocity` (m/s); `cylinder.vtp` is the surface
of the intruder.
"""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from liftdrag.case import Case
from liftdrag.engines.family import read_dump
from liftdrag.errors import InputError, escaped
from liftdrag.files import is_file
from liftdrag.folder import Record, put, writing
from liftdrag.scene import TankScene

if TYPE_CHECKING:
    import pyvista

DUMP, FRAMES, TIMES, INTRUDER = "trajectory.dump", "grains", "grains.pvd", "cylinder.vtp"

COLUMNS = "id type radius x y z vx vy vz".split()
"""Of the dump."""

HOW = "pip install 'liftdrag[vtk]'"


def offer(folder: Path) -> str:
    """What opens the trajectory of a folder, in a sentence; VTK is written where it can be."""
    if _has_vtk():
        opens = f"ParaView opens {write_vtk(folder)}."
    else:
        opens = f"For ParaView: {HOW}, then liftdrag vtk {shlex.quote(str(folder))}"
    return f"OVITO opens {folder / DUMP}. {opens}"


def _has_vtk() -> bool:
    return find_spec("pyvista") is not None


def write_vtk(folder: Path) -> Path:
    """Write the trajectory of a run's folder as VTK, and return the file that holds its times.

    Raises InputError without pyvista, or a trajectory, or where it is damaged; RunFailed when
    nothing can be written.
    """
    if not _has_vtk():
        raise InputError(f"VTK files are written by pyvista, which is not installed: {HOW}.")
    if not is_file(folder / DUMP):
        name = escaped(str(folder))
        raise InputError(f"{name} holds no {DUMP}; run a tank with --dump for one.")
    record = Record.read(folder)
    with writing(folder / FRAMES):
        (folder / FRAMES).mkdir(exist_ok=True)
        times = _write_frames(folder, record.plan.time_step)
        put(folder / TIMES, _collection(times))
        scene = Case(record.case, record.tables).scene
        if isinstance(scene, TankScene):
            _cylinder(scene).save(folder / INTRUDER)
    return folder / TIMES


def _write_frames(folder: Path, time_step: float) -> list[float]:
    """The times (s) of the frames that were written."""
    times = []
    try:
        for number, (step, rows) in enumerate(read_dump(folder / DUMP)):
            _grains(rows).save(folder / _frame(number))
            times.append(step * time_step)
    except ValueError as error:
        raise InputError(f"The trajectory is damaged ({error}); run the case again.") from None
    return times


def _frame(number: int) -> str:
    return f"{FRAMES}/{number:06d}.vtp"


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


def _collection(times: Sequence[float]) -> str:
    """The times (s) of the frames, as ParaView reads them."""
    lines = [
        f'<DataSet timestep="{time!r}" part="0" file="{_frame(number)}"/>'
        for number, time in enumerate(times)
    ]
    head = '<VTKFile type="Collection" version="0.1" byte_order="LittleEndian">'
    return "\n".join([head, "<Collection>", *lines, "</Collection>", "</VTKFile>", ""])
