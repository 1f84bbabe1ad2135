"""The trajectory of a run for others' programs, OVITO and ParaView.

OVITO opens `trajectory.dump`, ParaView `grains.pvd`, the times of `grains/*.vtp`, one file a frame.
`grains` writes them of a tank, `cells` of a sheared cell, `collection` the times.
"""

from __future__ import annotations

import shlex
from importlib.util import find_spec
from pathlib import Path

from liftdrag.case import Case
from liftdrag.deck import Plan
from liftdrag.engines.dem_shear import LOOKS
from liftdrag.errors import InputError, escaped
from liftdrag.files import is_file
from liftdrag.folder import Record, writing
from liftdrag.scene import Scene, ShearScene
from liftdrag.trajectory import cells, grains
from liftdrag.trajectory.collection import DUMP, write_times

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


def write_dump(folder: Path) -> Path:
    """The dump of a run's folder; that of a sheared cell is written now, from the looks at it.

    Raises InputError where there is none or it is damaged, RunFailed when it cannot be written.
    """
    scene, plan = _read(folder)
    name = escaped(str(folder))
    if isinstance(scene, ShearScene):
        if not is_file(folder / LOOKS):
            how = f"liftdrag run --resume --out {shlex.quote(str(folder))}"
            raise InputError(f"The run in {name} has not ended; go on with: {how}")
        with writing(folder / DUMP):
            cells.write_dump(folder, scene, plan.time_step)
    elif not is_file(folder / DUMP):
        raise InputError(f"{name} holds no {DUMP}; run a tank or a shear flow with --dump.")
    return folder / DUMP


def _read(folder: Path) -> tuple[Scene, Plan]:
    record = Record.read(folder)
    return Case(record.case, record.tables).scene, record.plan


def write_vtk(folder: Path) -> Path:
    """Write the trajectory of a run's folder as VTK, and return the file that holds its times.

    Raises InputError without pyvista, or a trajectory, or where it is damaged; RunFailed when
    nothing can be written.
    """
    if not _has_vtk():
        raise InputError(f"VTK files are written by pyvista, which is not installed: {HOW}.")
    write_dump(folder)
    scene, plan = _read(folder)
    with writing(folder):
        if isinstance(scene, ShearScene):
            return write_times(folder, cells.surfaces(folder))
        return write_times(folder, grains.points(folder, scene, plan.time_step))
