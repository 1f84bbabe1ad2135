"""The frames of a trajectory as VTK files, and the file that holds their times."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from liftdrag.errors import InputError, escaped
from liftdrag.folder import put

if TYPE_CHECKING:
    import pyvista

DUMP, FRAMES, TIMES = "trajectory.dump", "grains", "grains.pvd"


def write_times(folder: Path, frames: Iterable[tuple[float, pyvista.PolyData]]) -> Path:
    """Write each frame to a file and the times (s) of all to one, which is returned.

    Those of another time are removed. Raises InputError where there is no frame.
    """
    (folder / FRAMES).mkdir(exist_ok=True)
    for file in (folder / FRAMES).glob("*.vtp"):
        file.unlink()
    times = []
    for number, (time, frame) in enumerate(frames):
        frame.save(folder / _frame(number))
        times.append(time)
    if not times:
        raise InputError(f"{escaped(str(folder / DUMP))} holds no whole frame; run the case again.")
    put(folder / TIMES, _collection(times))
    return folder / TIMES


def _frame(number: int) -> str:
    return f"{FRAMES}/{number:06d}.vtp"


def _collection(times: Sequence[float]) -> str:
    """The times (s) of the frames, as ParaView reads them."""
    lines = [
        f'<DataSet timestep="{time!r}" part="0" file="{_frame(number)}"/>'
        for number, time in enumerate(times)
    ]
    head = '<VTKFile type="Collection" version="0.1" byte_order="LittleEndian">'
    return "\n".join([head, "<Collection>", *lines, "</Collection>", "</VTKFile>", ""])
