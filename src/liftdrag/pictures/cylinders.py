"""A picture of rods, disks and spheres in their cell, as shaded bodies seen from afar.

Faces that look away are left out, the others are painted from the farthest to the nearest.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from liftdrag.analysis.structure import cell_at
from liftdrag.pictures.shear import named
from liftdrag.scene import ShearScene
from liftdrag.snapshot import Snapshot

if TYPE_CHECKING:
    from matplotlib.axes import Axes

CORNERS = 24
"""Of the polygon that an end is drawn as."""

PIECES = 4
"""That a rod's side is cut into along its axis: shorter faces hide each other rightly."""

CAMERA = np.array([0.42, 0.38, 0.82])
"""Where it is seen from: the flow goes to the right, its gradient up."""

LIGHT = np.array([-0.35, 0.75, 0.56])

DARKEST, FOG = 0.55, 0.3
"""Brightness of a face that the light does not reach, and how much darker the farthest are."""

PALETTE = np.array([[0.42, 0.66, 0.93], [1.0, 0.72, 0.36], [0.52, 0.80, 0.55], [0.90, 0.53, 0.58]])
"""Colours of the species, by turns."""

MILLI = 1e3


@dataclass(frozen=True)
class Faces:
    """Polygons (k, c, 3) in space that look along `normal` (k, 3), and their `colour` (k, 3)."""

    corners: np.ndarray
    normal: np.ndarray
    colour: np.ndarray

    def seen(self, camera: np.ndarray) -> Faces:
        """Those that look towards the camera."""
        kept = self.normal @ camera > 0.0
        return Faces(self.corners[kept], self.normal[kept], self.colour[kept])


def draw_cell(scene: ShearScene, moment: Snapshot, path: Path) -> None:
    """The grains of a moment in their cell."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.5, 6.5), layout="constrained")
    axes = figure.subplots()
    right, up, towards = _view(CAMERA)
    faces = [part.seen(towards) for part in _bodies(scene, moment)]
    _frame(axes, scene, right, up, towards, behind=True)
    _paint(axes, faces, right, up, towards)
    _frame(axes, scene, right, up, towards, behind=False)
    axes.set_title(_title(scene, moment), loc="left", fontsize="medium")
    axes.set_aspect("equal")
    axes.autoscale_view()
    axes.axis("off")
    figure.savefig(path, dpi=150)


def _title(scene: ShearScene, moment: Snapshot) -> str:
    shown = [
        f"{count} {named(scene, number)}" for number, count in enumerate(scene.counts, start=1)
    ]
    strain = scene.drive.shear_rate * moment.time
    return f"{', '.join(shown)} at a strain of {strain:.4g}"


def _view(camera: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The directions to the right, up and towards the camera, with y up."""
    towards = camera / np.linalg.norm(camera)
    right = np.cross([0.0, 1.0, 0.0], towards)
    right /= np.linalg.norm(right)
    return right, np.cross(towards, right), towards


def _bodies(scene: ShearScene, moment: Snapshot) -> list[Faces]:
    """Sides and ends of all grains, each where its centre is in the cell."""
    assert moment.axis is not None
    cell = cell_at(scene, moment.time)
    centre, axes = cell.images(moment.position, 0.0)[0], moment.axis.astype(float)
    size = [one.sides(scene.grains.diameter) for one in scene.species]
    radius, half = (np.array(size)[moment.kind - 1] / 2.0).T
    colour = PALETTE[(moment.kind - 1) % len(PALETTE)]
    round_ = np.array([one.is_sphere for one in scene.species])[moment.kind - 1]
    long = ~round_
    flat = centre[long], axes[long], radius[long], half[long], colour[long]
    return [*_sides(*flat), *_ends(*flat), *_globes(centre[round_], radius[round_], colour[round_])]


def _across(axes: np.ndarray) -> np.ndarray:
    """Unit vectors (CORNERS, n, 3) around each axis (n, 3)."""
    least = np.eye(3)[np.abs(axes).argmin(axis=1)]
    one = np.cross(axes, least)
    one /= np.linalg.norm(one, axis=1, keepdims=True)
    other = np.cross(axes, one)
    angle = 2.0 * np.pi * np.arange(CORNERS) / CORNERS
    return np.asarray(np.cos(angle)[:, None, None] * one + np.sin(angle)[:, None, None] * other)


def _sides(
    centre: np.ndarray, axes: np.ndarray, radius: np.ndarray, half: np.ndarray, colour: np.ndarray
) -> list[Faces]:
    """Faces of the bands, a strip of PIECES between two corners at a time."""
    round_ = _across(axes)
    rims = centre + radius[:, None] * round_
    along = half[:, None] * axes
    found = []
    for k, piece in product(range(CORNERS), range(PIECES)):
        low, high = 2.0 * piece / PIECES - 1.0, 2.0 * (piece + 1) / PIECES - 1.0
        one, other = rims[k], rims[(k + 1) % CORNERS]
        corners = np.stack(
            [one + low * along, other + low * along, other + high * along, one + high * along],
            axis=1,
        )
        normal = round_[k] + round_[(k + 1) % CORNERS]
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        found.append(Faces(corners, normal, colour))
    return found


def _ends(
    centre: np.ndarray, axes: np.ndarray, radius: np.ndarray, half: np.ndarray, colour: np.ndarray
) -> list[Faces]:
    rims = centre + radius[:, None] * _across(axes)
    return [
        Faces(np.moveaxis(rims + side * half[:, None] * axes, 0, 1), side * axes, colour)
        for side in (-1.0, 1.0)
    ]


def _globes(centre: np.ndarray, radius: np.ndarray, colour: np.ndarray) -> list[Faces]:
    """Faces between two meridians and two parallels at a time, of spheres."""
    polar = np.linspace(0.0, np.pi, CORNERS // 2 + 1)
    angle = np.linspace(0.0, 2.0 * np.pi, CORNERS + 1)
    found = []
    for k, m in product(range(len(polar) - 1), range(CORNERS)):
        at = np.array([(k, m), (k + 1, m), (k + 1, m + 1), (k, m + 1)])
        ring, turn = polar[at[:, 0]], angle[at[:, 1]]
        unit = np.column_stack(
            [np.sin(ring) * np.cos(turn), np.cos(ring), np.sin(ring) * np.sin(turn)]
        )
        normal = unit.mean(axis=0) / np.linalg.norm(unit.mean(axis=0))
        corners = centre[:, None] + radius[:, None, None] * unit
        found.append(Faces(corners, np.broadcast_to(normal, centre.shape), colour))
    return found


def _paint(
    axes: Axes, faces: list[Faces], right: np.ndarray, up: np.ndarray, towards: np.ndarray
) -> None:
    """All faces, the farthest first, each as bright as the light falls on it."""
    from matplotlib.collections import PolyCollection

    flat = MILLI * np.column_stack([right, up])
    shapes = [shape for part in faces for shape in part.corners @ flat]
    depth = np.concatenate([(part.corners @ towards).mean(axis=1) for part in faces])
    normal = np.concatenate([part.normal for part in faces])
    colour = np.concatenate([part.colour for part in faces])
    lit = np.clip(normal @ (LIGHT / np.linalg.norm(LIGHT)), 0.0, 1.0)
    near = (depth - depth.min()) / max(np.ptp(depth), 1e-300)
    bright = (DARKEST + (1.0 - DARKEST) * lit) * (1.0 - FOG + FOG * near)
    painted = np.clip(colour * bright[:, None], 0.0, 1.0)
    order = np.argsort(depth)
    axes.add_collection(
        PolyCollection(
            [shapes[k] for k in order],
            facecolors=painted[order],
            edgecolors=painted[order],
            linewidths=0.3,
        )
    )


def _frame(
    axes: Axes,
    scene: ShearScene,
    right: np.ndarray,
    up: np.ndarray,
    towards: np.ndarray,
    behind: bool,
) -> None:
    """The edges of the cell: those at its farthest corner `behind` the grains, or the others."""
    sides = np.array(scene.sides)
    corners = np.array(list(product((0, 1), repeat=3)))
    farthest = corners[(corners * sides @ towards).argmin()]
    for one, other in product(corners, corners):
        if (other - one).sum() == 1 and np.abs(other - one).sum() == 1:
            hidden = bool((one == farthest).all() or (other == farthest).all())
            if hidden == behind:
                ends = MILLI * np.stack([one * sides, other * sides])
                axes.plot(ends @ right, ends @ up, color="0.35", linewidth=0.8)
