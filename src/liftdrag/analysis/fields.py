"""Solid fraction, velocity and stress about the cylinder, coarse-grained.

As in appendix A of Guillard, Forterre and Pouliquen 2014, in windows that are spheres: a grain
counts by the volume that it shares with the window, a contact by the share of its branch inside.
The paper's stress lacks 1/V; here pressure is positive. A contact with the cylinder has a branch
too, from the point of contact to the grain's centre (Weinhart et al., Granular Matter 14 (2012)
289), so that forces balance up to the surface. A window counts with its whole volume, also
where it reaches into the cylinder: within a window's radius of it, fields fall off.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, floor, pi

import numpy as np

from liftdrag.analysis.blocks import Blocks
from liftdrag.analysis.window import spread_branches, spread_grains
from liftdrag.scene import TankScene
from liftdrag.snapshot import ForceSnapshot

HEADROOM = 3.0
"""Grain diameters above the bed's planned height to which the grid reaches."""

_PRODUCTS = np.array([[4, 7, 8], [7, 5, 9], [8, 9, 6]])
"""Where the products of two velocities stand among the moments."""


@dataclass(frozen=True)
class Grid:
    """Windows of a `radius` (m) about points at `x` (nx,) and `z` (nz,), m from the axis.

    There are `rows` of them across the `thickness` (m), over which all is averaged. Each point
    has one at the same distance above or below the axis, as far as the bed reaches.
    """

    x: np.ndarray
    z: np.ndarray
    rows: int
    radius: float
    thickness: float

    @classmethod
    def of(cls, scene: TankScene, radius: float, spacing: float) -> Grid:
        """That of a tank, its points at most `spacing` (m) apart."""
        columns = ceil(scene.tank.length / spacing * (1.0 - 1e-9))
        rows = ceil(scene.tank.thickness / spacing * (1.0 - 1e-9))
        step = scene.tank.length / columns
        top = scene.tank.height + HEADROOM * scene.grains.diameter
        below = floor(scene.axis_height / spacing + 0.5)
        above = ceil((top - scene.axis_height) / spacing)
        x = (np.arange(columns) + 0.5) * step - 0.5 * scene.tank.length
        z = (np.arange(-below, above) + 0.5) * spacing
        return cls(x, z, rows, radius, scene.tank.thickness)

    @property
    def origin(self) -> np.ndarray:
        """The first point, (3,)."""
        return np.array([self.x[0], 0.5 * self.thickness / self.rows, self.z[0]])

    @property
    def step(self) -> np.ndarray:
        """Between two points, (3,)."""
        across = self.thickness / self.rows
        return np.array([self.x[1] - self.x[0], across, self.z[1] - self.z[0]])

    @property
    def shape(self) -> np.ndarray:
        """Points along each axis, (3,)."""
        return np.array([len(self.x), self.rows, len(self.z)])

    @property
    def volume(self) -> float:
        """Of the windows of a point, across the thickness, in m^3."""
        return 4.0 / 3.0 * pi * self.radius**3 * self.rows


def moments(scene: TankScene, grid: Grid, snapshot: ForceSnapshot) -> np.ndarray:
    """What fields are made from, linear in what is averaged, at one time: (nx, nz, 19).

    The solid fraction, its product with the velocity (3) and with products of velocities (6), and
    the stress (3 x 3, Pa) of the contacts: the force's direction, then the branch's.
    """
    shape, centres = grid.shape, about_axis(scene, snapshot.position)
    solid = np.zeros((shape[0], shape[2], 10))
    stress = np.zeros((shape[0], shape[2], 9))
    place = (grid.radius, grid.origin, grid.step, shape)
    spread_grains(centres, snapshot.velocity, scene.grains.diameter / 2.0, *place, solid)
    spread_branches(*branches(scene, snapshot), *place, stress)
    return np.concatenate([solid, stress], axis=2) / grid.volume


def about_axis(scene: TankScene, position: np.ndarray) -> np.ndarray:
    """Positions (n, 3) in m from the axis, in the period of the tank about it."""
    length, axis = scene.tank.length, np.array([scene.axis_x, 0.0, scene.axis_height])
    centres = position - axis
    centres[:, 0] -= length * np.round(centres[:, 0] / length)
    centres[:, 1] %= scene.tank.thickness
    return np.asarray(centres)


def branches(
    scene: TankScene, snapshot: ForceSnapshot
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of each contact the start, the branch and the force on the grain at its end, (n, 3) each.

    The branch between two grains leads to the first, that of the cylinder from its surface.
    """
    centres = about_axis(scene, snapshot.position)
    first, second = snapshot.pair[:, 0], snapshot.pair[:, 1]
    branch = centres[first] - centres[second]
    for axis, period in enumerate((scene.tank.length, scene.tank.thickness)):
        branch[:, axis] -= period * np.round(branch[:, axis] / period)
    force = _within_friction(snapshot.force, branch, scene.grains.friction)
    touching = np.flatnonzero(np.any(snapshot.wall != 0.0, axis=1))
    surface = _surface(centres[touching], scene.intruder.diameter / 2.0)
    return (
        np.concatenate([centres[second], surface]),
        np.concatenate([branch, centres[touching] - surface]),
        np.concatenate([force, snapshot.wall[touching]]),
    )


def _surface(centres: np.ndarray, radius: float) -> np.ndarray:
    """The points (n, 3) of the cylinder nearest to these."""
    points = centres.copy()
    across = np.hypot(centres[:, 0], centres[:, 2])
    points[:, [0, 2]] *= (radius / across)[:, None]
    return points


def _within_friction(force: np.ndarray, branch: np.ndarray, friction: float) -> np.ndarray:
    """Forces (n, 3) with their tangential parts cut back to Coulomb's limit.

    LIGGGHTS reckons the forces of a dump anew, and gives a contact that slides a damping that the
    motion does not know. LAMMPS' forces stay as they are.
    """
    normal = branch / np.linalg.norm(branch, axis=1, keepdims=True)
    along = np.sum(force * normal, axis=1, keepdims=True) * normal
    across = force - along
    limit = friction * np.linalg.norm(along, axis=1, keepdims=True)
    size = np.linalg.norm(across, axis=1, keepdims=True)
    return np.asarray(along + across * np.minimum(1.0, limit / np.maximum(size, 1e-300)))


@dataclass(frozen=True)
class Fields:
    """The moments of a grid in blocks of snapshots; each field with its standard error."""

    grid: Grid
    blocks: Blocks

    def named(self) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        """All fields by name, (nx, nz), (nx, nz, 3) or (nx, nz, 3, 3), and their errors."""
        return {name: self.blocks.estimate(field) for name, field in FIELDS.items()}


def solid_fraction(found: np.ndarray) -> np.ndarray:
    """Of moments (..., 19)."""
    return found[..., 0]


def velocity(found: np.ndarray) -> np.ndarray:
    """That of the mass (..., 3), m/s; not a number where there is none."""
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(found[..., 1:4] / found[..., :1])


def stress(found: np.ndarray) -> np.ndarray:
    """That of the contacts (..., 3, 3), Pa, positive where grains are pressed together."""
    return found[..., 10:].reshape(*found.shape[:-1], 3, 3)


def pressure(found: np.ndarray) -> np.ndarray:
    """A third of the stress' trace (...), Pa."""
    return np.asarray(np.trace(stress(found), axis1=-2, axis2=-1) / 3.0)


def deviator(found: np.ndarray) -> np.ndarray:
    """sqrt(s : s / 2) of the symmetric stress without its pressure (...), Pa."""
    whole = stress(found)
    rest = (whole + np.swapaxes(whole, -1, -2)) / 2.0 - pressure(found)[..., None, None] * np.eye(3)
    return np.asarray(np.sqrt(np.sum(rest**2, axis=(-1, -2)) / 2.0))


FIELDS = {
    "solid_fraction": solid_fraction,
    "velocity": velocity,
    "stress": stress,
    "pressure": pressure,
    "deviator": deviator,
}


def mirrored(grid: Grid, values: np.ndarray) -> np.ndarray:
    """Values (nx, nz) at the points mirrored by the axis' height; not a number where none is."""
    below = int(np.sum(grid.z < 0.0))
    image = 2 * below - 1 - np.arange(len(grid.z))
    inside = (image >= 0) & (image < len(grid.z))
    found = np.full_like(values, np.nan)
    found[:, inside] = values[:, image[inside]]
    return found


def split(grid: Grid, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The symmetric and the antisymmetric part of values (nx, nz) about the axis' height."""
    other = mirrored(grid, values)
    return (values + other) / 2.0, (values - other) / 2.0


def loop_force(scene: TankScene, grid: Grid, found: np.ndarray, reach: float) -> np.ndarray:
    """Drag and lift (2,) in N that the balance of momentum gives, of moments (nx, nz, 19).

    What flows in through a rectangle about the axis, at least `reach` (m) from it, by contacts and
    by motion, less the weight of the grains inside. In a steady flow that is the cylinder's force.
    """
    density = scene.grains.density
    flux = stress(found) + density * found[..., _PRODUCTS]
    columns = np.flatnonzero(abs(grid.x) <= reach + grid.step[0])
    levels = np.flatnonzero(abs(grid.z) <= reach + grid.step[2])
    box = flux[columns[0] : columns[-1] + 1, levels[0] : levels[-1] + 1]
    through_ends = _trapezoid((box[0] - box[-1])[:, :, 0], grid.step[2])
    through_sides = _trapezoid((box[:, 0] - box[:, -1])[:, :, 2], grid.step[0])
    solid = found[columns[0] : columns[-1] + 1, levels[0] : levels[-1] + 1, 0]
    area = _trapezoid(_trapezoid(solid, grid.step[0]), grid.step[2])
    weight = density * scene.bulk_gravity * area * np.array([0.0, 0.0, 1.0])
    return np.asarray(((through_ends + through_sides - weight) * grid.thickness)[[0, 2]])


def _trapezoid(values: np.ndarray, step: float) -> np.ndarray:
    """The integral over the first axis."""
    return np.asarray(step * (values.sum(axis=0) - 0.5 * (values[0] + values[-1])))
