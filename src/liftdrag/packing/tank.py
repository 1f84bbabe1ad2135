"""The initial bed, made without pouring.

Grains start at random inside the volume that the settled bed will fill and are
pushed apart as soft, frictionless spheres until their overlaps have all but
vanished. Below random close packing (0.64) this takes a few hundred sweeps and
leaves an amorphous bed that the engine has only to settle, not to pour.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from liftdrag.errors import InputError

TOLERANCE = 2e-3
MAX_SWEEPS = 4000


@dataclass(frozen=True)
class Container:
    """The volume that the grains fill: x and y periodic, z between two planes.

    Lengths in grain diameters. `floor` holds the centres (m, 3) of the fixed
    bottom layer; the cylinder's axis is along y at (x, z) = `axis`.
    """

    length: float
    thickness: float
    bottom: float
    top: float
    axis: tuple[float, float]
    radius: float
    floor: np.ndarray


def square_layer(length: float, thickness: float, height: float) -> np.ndarray:
    """Centres (m, 3) of a square monolayer at `height`, commensurate with the periodic box.

    Lengths in grain diameters; the spacing is the smallest that is no less
    than one diameter and divides the box, so no grain overlaps its image.
    """
    columns, rows = int(length + 1e-9), int(thickness + 1e-9)
    x = (np.arange(columns) + 0.5) * length / columns
    y = (np.arange(rows) + 0.5) * thickness / rows
    grid = np.stack(np.meshgrid(x, y, [height], indexing="ij"), axis=-1)
    return grid.reshape(-1, 3)


def random_bed(container: Container, count: int, rng: np.random.Generator) -> np.ndarray:
    """Centres (count, 3) of a dense random bed, in grain diameters.

    No two grains, nor a grain and the floor or the cylinder, overlap by more
    than `TOLERANCE` diameters. Raises InputError when the grains do not fit.
    """
    start = _scatter(container, count, rng)
    return _Relaxation(container, start).run()


def _scatter(box: Container, count: int, rng: np.random.Generator) -> np.ndarray:
    """One grain in each of `count` random cells of a grid over the free volume."""
    volume = np.array([box.length, box.thickness, box.top - box.bottom])
    spacing = (volume.prod() / count) ** (1.0 / 3.0)
    while True:
        cells = np.ceil(volume / spacing).astype(int)
        grid = np.stack(np.meshgrid(*map(np.arange, cells), indexing="ij"), axis=-1).reshape(-1, 3)
        jittered = (grid + rng.uniform(0.0, 1.0, grid.shape)) / cells
        points = jittered * volume + [0.0, 0.0, box.bottom]
        away = np.hypot(points[:, 0] - box.axis[0], points[:, 2] - box.axis[1])
        points = points[away > box.radius]
        if len(points) >= count:
            return rng.permutation(points)[:count]
        spacing *= 0.99


class _Relaxation:
    """Inertial relaxation (FIRE) of harmonic spheres of diameter one."""

    skin = 0.35

    def __init__(self, box: Container, centres: np.ndarray):
        self.box = box
        self.x = centres
        self.period = np.array([box.length, box.thickness, 0.0])
        self._find_pairs()

    def run(self) -> np.ndarray:
        velocity = np.zeros_like(self.x)
        step, alpha, downhill = 0.1, 0.1, 0
        for _ in range(MAX_SWEEPS):
            force, worst = self._forces()
            if worst < TOLERANCE:
                return self._wrapped()
            power = np.vdot(force, velocity)
            if power > 0.0:
                downhill += 1
                if downhill > 5:
                    step, alpha = min(1.1 * step, 0.5), 0.99 * alpha
            else:
                velocity[:] = 0.0
                step, alpha, downhill = max(0.5 * step, 0.05), 0.1, 0
            velocity += step * force
            scale = np.linalg.norm(velocity) / max(float(np.linalg.norm(force)), 1e-300)
            velocity = (1.0 - alpha) * velocity + alpha * scale * force
            move = np.clip(step * velocity, -0.1, 0.1)
            self.x += move
            self._follow(move)
        raise InputError(
            f"The bed cannot be packed: its {len(self.x)} grains still overlap by {worst:.2g} d; "
            "make the tank larger about the cylinder."
        )

    def _wrapped(self) -> np.ndarray:
        x = self.x.copy()
        x[:, :2] %= self.period[:2]
        return x

    def _follow(self, move: np.ndarray) -> None:
        self.moved += np.sqrt((move**2).sum(axis=1).max())
        if self.moved > self.skin / 2:
            self._find_pairs()

    def _find_pairs(self) -> None:
        """Neighbour pairs (i, j) of mobile grains, then of mobile grains and the floor."""
        box = self.box
        every = np.concatenate([self.x, box.floor])
        every[:, :2] %= self.period[:2]
        every[:, 2] += 1.0
        tree = cKDTree(every, boxsize=np.array([box.length, box.thickness, 4.0 * box.top + 8.0]))
        pairs = tree.query_pairs(1.0 + self.skin, output_type="ndarray")
        self.i, self.j = pairs[pairs.min(axis=1) < len(self.x)].T
        self.moved = 0.0

    def _forces(self) -> tuple[np.ndarray, float]:
        n = len(self.x)
        every = np.concatenate([self.x, self.box.floor])
        r = every[self.i] - every[self.j]
        r[:, :2] -= self.period[:2] * np.rint(r[:, :2] / self.period[:2])
        distance = np.sqrt((r * r).sum(axis=1))
        touching = distance < 1.0
        i, j, r, distance = self.i[touching], self.j[touching], r[touching], distance[touching]
        push = r * ((1.0 - distance) / np.maximum(distance, 1e-12))[:, None]
        force = np.empty((n, 3))
        for axis in range(3):
            every_force = np.bincount(i, push[:, axis], len(every))
            every_force -= np.bincount(j, push[:, axis], len(every))
            force[:, axis] = every_force[:n]
        worst = float((1.0 - distance).max(initial=0.0))
        return force, max(worst, self._add_walls(force))

    def _add_walls(self, force: np.ndarray) -> float:
        box, x = self.box, self.x
        below = np.maximum(box.bottom - x[:, 2], 0.0)
        above = np.maximum(x[:, 2] - (box.top - 0.5), 0.0)
        force[:, 2] += below - above
        dx = x[:, 0] - box.axis[0]
        dx -= box.length * np.rint(dx / box.length)
        dz = x[:, 2] - box.axis[1]
        distance = np.maximum(np.hypot(dx, dz), 1e-12)
        inside = np.maximum(box.radius + 0.5 - distance, 0.0)
        force[:, 0] += inside * dx / distance
        force[:, 2] += inside * dz / distance
        return float(max(below.max(), above.max(), inside.max()))
