"""The trajectory of a sheared cell, from the looks at its grains.

The dump is what OVITO draws with the shape "cylinder": an axis as a quaternion, and the columns
shapex, shapey and shapez, of which it takes half as radius and as length: the diameter twice, and
twice the length. As VTK the grains are surfaces with `id`, `type` and `velocity` (m/s).
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from liftdrag.deck.shear import read_grains
from liftdrag.dem.cylinders import Cylinders
from liftdrag.engines.dem_shear import snapshots
from liftdrag.errors import InputError
from liftdrag.scene import ShearScene
from liftdrag.snapshot import Snapshot
from liftdrag.trajectory.collection import DUMP

if TYPE_CHECKING:
    import pyvista

MOST = 60
"""Frames that are written."""

COLUMNS = "id type x y z vx vy vz shapex shapey shapez quati quatj quatk quatw"

CORNERS = 16
"""Of the polygon that an end of a surface is."""


def looks(folder: Path) -> Iterator[Snapshot]:
    """The looks at a cell, at most MOST and evenly spread, the first and the last among them.

    Raises InputError where they are damaged.
    """
    try:
        found = list(snapshots(folder))
    except (OSError, ValueError, LookupError) as error:
        raise InputError(f"The looks at the cell are damaged ({error}); run it again.") from None
    for number in np.unique(np.linspace(0, len(found) - 1, MOST).round().astype(int)):
        yield found[number]


def write_dump(folder: Path, scene: ShearScene, time_step: float) -> None:
    """Write the looks as a dump. Raises InputError where they are damaged, OSError."""
    grains = read_grains(folder)[0]
    with (folder / DUMP).open("w") as file:
        for moment in looks(folder):
            header = _header(scene, round(moment.time / time_step))
            np.savetxt(file, _rows(grains, moment), "%.7g", header=header, comments="")


def _header(scene: ShearScene, step: int) -> str:
    sides = "\n".join(f"0.0 {side!r}" for side in scene.sides)
    return (
        f"ITEM: TIMESTEP\n{step}\nITEM: NUMBER OF ATOMS\n{scene.grain_count}\n"
        f"ITEM: BOX BOUNDS pp pp pp\n{sides}\nITEM: ATOMS {COLUMNS}"
    )


def _rows(grains: Cylinders, moment: Snapshot) -> np.ndarray:
    """The COLUMNS of a moment (n, 15)."""
    assert moment.axis is not None
    diameter, length = 2.0 * grains.radius, 2.0 * grains.half_length
    return np.column_stack(
        [
            np.arange(1, len(diameter) + 1),
            moment.kind,
            moment.position,
            moment.velocity,
            diameter,
            diameter,
            2.0 * length,
            turn_of(moment.axis),
        ]
    )


def turn_of(axis: np.ndarray) -> np.ndarray:
    """The unit quaternions (n, 4), i j k w, that turn z onto each unit vector (n, 3)."""
    x, y, z = axis.T
    turn = np.column_stack([-y, x, np.zeros_like(x), 1.0 + z])
    turn[z < -1.0 + 1e-6] = (1.0, 0.0, 0.0, 0.0)
    return np.asarray(turn / np.linalg.norm(turn, axis=1)[:, None])


def surfaces(folder: Path) -> Iterator[tuple[float, pyvista.PolyData]]:
    """The time (s) and the surfaces of the grains of each look. Raises InputError as `looks`."""
    grains = read_grains(folder)[0]
    for moment in looks(folder):
        yield moment.time, _surface(grains, moment)


def _surface(grains: Cylinders, moment: Snapshot) -> pyvista.PolyData:
    """Prisms for the grains of a moment."""
    import pyvista

    count = len(moment.kind)
    surface = pyvista.PolyData(_corners(grains, moment).reshape(-1, 3), faces=_faces(count))
    per_corner = {"id": np.arange(1, count + 1), "type": moment.kind, "velocity": moment.velocity}
    for name, values in per_corner.items():
        kind = np.float32 if values.ndim > 1 else np.int32
        surface[name] = np.repeat(values.astype(kind), 2 * CORNERS, axis=0)
    return surface


def _corners(grains: Cylinders, moment: Snapshot) -> np.ndarray:
    """Those of both ends (n, 2, CORNERS, 3), turned the same way about the axis."""
    assert moment.axis is not None
    axis = moment.axis.astype(float)
    least = np.eye(3)[np.abs(axis).argmin(axis=1)]
    across = np.cross(axis, least)
    across *= (grains.radius / np.linalg.norm(across, axis=1))[:, None]
    angle = 2.0 * np.pi * np.arange(CORNERS) / CORNERS
    ring = (
        np.cos(angle)[:, None] * across[:, None]
        + np.sin(angle)[:, None] * np.cross(axis, across)[:, None]
    )
    ends = (
        moment.position[:, None]
        + np.array([-1.0, 1.0])[:, None] * (grains.half_length[:, None] * axis)[:, None]
    )
    return np.asarray((ends[:, :, None] + ring[:, None]).astype(np.float32))


def _faces(count: int) -> np.ndarray:
    """The polygons of so many prisms, each after its number of corners: two ends and the sides."""
    one, first = np.arange(CORNERS), 2 * CORNERS * np.arange(count)[:, None]
    after = (one + 1) % CORNERS
    sides = np.column_stack([one, after, CORNERS + after, CORNERS + one])
    faces = [one[::-1], CORNERS + one, *sides]
    return np.hstack(
        [part for face in faces for part in (np.full((count, 1), len(face)), first + face)]
    ).ravel()
