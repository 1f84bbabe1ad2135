"""The trajectory of a sheared cell, from the looks at its grains.

The dump is what OVITO draws with the shape "cylinder": an axis as a quaternion, and the columns
shapex, shapey and shapez, of which it takes half as radius and as length: the diameter twice, and
twice the length. A sphere has its diameter thrice. As VTK the grains are surfaces with `id`, `type`
and `velocity` (m/s).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
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
"""Of the polygon that an end of a cylinder is, and a sphere's equator."""


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
    """Write the looks as a dump, or none. Raises InputError where they are damaged, OSError."""
    grains, beside = read_grains(folder)[0], folder / f"{DUMP}.part"
    with beside.open("w") as file:
        for moment in looks(folder):
            header = _header(scene, round(moment.time / time_step))
            np.savetxt(file, _rows(grains, moment), "%.7g", header=header, comments="")
    beside.replace(folder / DUMP)


def _header(scene: ShearScene, step: int) -> str:
    sides = "\n".join(f"0.0 {side!r}" for side in scene.sides)
    return (
        f"ITEM: TIMESTEP\n{step}\nITEM: NUMBER OF ATOMS\n{scene.grain_count}\n"
        f"ITEM: BOX BOUNDS pp pp pp\n{sides}\nITEM: ATOMS {COLUMNS}"
    )


def _rows(grains: Cylinders, moment: Snapshot) -> np.ndarray:
    """The COLUMNS of a moment (n, 15)."""
    assert moment.axis is not None
    diameter = 2.0 * grains.radius
    return np.column_stack(
        [
            np.arange(1, len(diameter) + 1),
            moment.kind,
            moment.position,
            moment.velocity,
            diameter,
            diameter,
            np.where(grains.is_sphere, diameter, 4.0 * grains.half_length),
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
    import pyvista

    grains = read_grains(folder)[0]
    ball = pyvista.Sphere(radius=1.0, theta_resolution=CORNERS, phi_resolution=CORNERS // 2)
    for moment in looks(folder):
        surface = pyvista.PolyData()
        for some, corners, faces in (
            (~grains.is_sphere, _prisms(grains, moment), _of_prism()),
            (grains.is_sphere, _balls(grains, moment, ball.points), list(ball.regular_faces)),
        ):
            if some.any():
                surface = surface.append_polydata(_surface(moment, some, corners[some], faces))
        yield moment.time, surface


def _surface(
    moment: Snapshot, some: np.ndarray, corners: np.ndarray, faces: Sequence[np.ndarray]
) -> pyvista.PolyData:
    """Some grains (n,) of one shape, of `corners` (m, k, 3) and `faces` of such numbers below k."""
    import pyvista

    count, each = corners.shape[:2]
    first = each * np.arange(count)[:, None]
    after_size = [part for one in faces for part in (np.full((count, 1), len(one)), first + one)]
    surface = pyvista.PolyData(
        corners.reshape(-1, 3).astype(np.float32), faces=np.hstack(after_size).ravel()
    )
    surface["id"] = np.repeat(1 + np.flatnonzero(some), each).astype(np.int32)
    surface["type"] = np.repeat(moment.kind[some], each).astype(np.int32)
    surface["velocity"] = np.repeat(moment.velocity[some].astype(np.float32), each, axis=0)
    return surface


def _prisms(grains: Cylinders, moment: Snapshot) -> np.ndarray:
    """The corners of both ends of each (n, 2 CORNERS, 3), turned the same way about the axis."""
    assert moment.axis is not None
    axis = moment.axis.astype(float)
    across = np.cross(axis, np.eye(3)[np.abs(axis).argmin(axis=1)])
    across *= (grains.radius / np.maximum(np.linalg.norm(across, axis=1), 1e-9))[:, None]
    beside = np.cross(axis, across)
    angle = 2.0 * np.pi * np.arange(CORNERS)[:, None] / CORNERS
    ring = np.cos(angle) * across[:, None] + np.sin(angle) * beside[:, None]
    to_end = (grains.half_length[:, None] * axis)[:, None]
    middle = moment.position[:, None]
    return np.concatenate([middle - to_end + ring, middle + to_end + ring], axis=1)


def _of_prism() -> list[np.ndarray]:
    """The faces of a prism by its corners: two ends and the sides."""
    one = np.arange(CORNERS)
    after = (one + 1) % CORNERS
    return [
        one[::-1],
        CORNERS + one,
        *np.column_stack([one, after, CORNERS + after, CORNERS + one]),
    ]


def _balls(grains: Cylinders, moment: Snapshot, ball: np.ndarray) -> np.ndarray:
    """The corners of a unit `ball` (k, 3) about each, of its radius (n, k, 3)."""
    return np.asarray(moment.position[:, None] + grains.radius[:, None, None] * ball)
