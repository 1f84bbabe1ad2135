"""The initial column of a tube: packed at random in full height, to be cut into layers."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import pi

import numpy as np
from scipy.spatial import cKDTree

from liftdrag.errors import CaseError, at_least
from liftdrag.packing.relaxation import TooTight, relaxed
from liftdrag.scene import JanssenScene

LOOSER = (0.975, 0.9, 0.8, 0.7, 0.6)
"""Shares of the settled solid fraction tried in turn: the first that the tube has room for."""

CLEAR = 1.0
"""Distance in d that the centres of a lid's grains keep from the wall, and from each other."""


@dataclass(frozen=True)
class PackedColumn:
    """Centres of the grains (n, 3), from the piston at z = 0 upward, and of the lid's (m, 3), m.

    The tube's axis is x = y = 0. A layer is a range of the grains: they are in order of z.
    """

    grains: np.ndarray
    lid: np.ndarray


@dataclass(frozen=True)
class _Room:
    """A tube of a `radius`, from 0 to `top`, in grain diameters."""

    radius: float
    top: float

    @cached_property
    def period(self) -> np.ndarray:
        return np.zeros(3)

    @cached_property
    def fixed(self) -> np.ndarray:
        return np.zeros((0, 3))

    def near(self, centres: np.ndarray, reach: float) -> np.ndarray:
        return np.asarray(cKDTree(centres).query_pairs(reach, output_type="ndarray"))

    def push(self, x: np.ndarray, force: np.ndarray) -> float:
        below = np.maximum(0.5 - x[:, 2], 0.0)
        above = np.maximum(x[:, 2] - (self.top - 0.5), 0.0)
        force[:, 2] += below - above
        away = np.maximum(np.hypot(x[:, 0], x[:, 1]), 1e-12)
        outside = np.maximum(away + 0.5 - self.radius, 0.0)
        force[:, :2] -= x[:, :2] * (outside / away)[:, None]
        return float(max(below.max(), above.max(), outside.max()))


def packed_column(scene: JanssenScene) -> PackedColumn:
    """The column of a scene as packed, before it settles. Raises CaseError when it cannot be."""
    d, rng = scene.grains.diameter, np.random.default_rng(scene.seed)
    for share in LOOSER:
        try:
            centres = _packed(scene, share * scene.settled_fraction, rng)
        except TooTight:
            continue
        upward = centres[np.argsort(centres[:, 2], kind="stable")] * d
        return PackedColumn(upward, _lid(scene, float(upward[-1, 2]) + d))
    raise CaseError(
        "tube.diameter",
        scene.tube.diameter,
        f"no random column of {scene.grain_count} grains could be packed in it",
        "widen the tube",
    )


def _packed(scene: JanssenScene, fraction: float, rng: np.random.Generator) -> np.ndarray:
    """Centres (n, 3) in diameters at a solid fraction. Raises TooTight."""
    radius, count = scene.tube.diameter / scene.grains.diameter / 2.0, scene.grain_count
    top = count * (pi / 6.0) / (fraction * pi * radius**2)
    room = _Room(radius, max(top, 1.0))
    start = np.column_stack(
        [_on_disc(count, radius - 0.5, rng), rng.permutation(np.linspace(0.5, top, count))]
    )
    return relaxed(room, start)


def _on_disc(count: int, radius: float, rng: np.random.Generator) -> np.ndarray:
    """Places (n, 2) at random on a disc."""
    away, angle = radius * np.sqrt(rng.random(count)), rng.uniform(0.0, 2.0 * pi, count)
    return np.column_stack([away * np.cos(angle), away * np.sin(angle)])


def _lid(scene: JanssenScene, height: float) -> np.ndarray:
    """Centres (m, 3) of a square layer of grains clear of the wall, none without an overload."""
    if scene.overload is None:
        return np.zeros((0, 3))
    d, clear = scene.grains.diameter, scene.tube.diameter / 2.0 - CLEAR * scene.grains.diameter
    reach = int(clear / d * (1.0 + 1e-9))
    line = np.arange(-reach, reach + 1) * d
    x, y = (side.ravel() for side in np.meshgrid(line, line))
    inside = np.hypot(x, y) <= clear * (1.0 + 1e-9)
    least = float(inside.sum()) * scene.grains.mass
    if scene.lid_mass < least:
        raise CaseError(
            "overload.mass",
            scene.lid_mass,
            "its grains would be lighter than those of the column",
            f"make it at least {at_least(least)} kg, a layer of those, or leave it out",
        )
    return np.column_stack([x[inside], y[inside], np.full(int(inside.sum()), height)])
