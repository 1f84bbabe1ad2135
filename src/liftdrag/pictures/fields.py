"""Pictures of the fields about the cylinder, of its stress, and of what gravity does to both."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from liftdrag.analysis.fields import Fields, Grid, deviator, pressure, split, velocity
from liftdrag.analysis.ring import ANGLES, Ring, mirrored, weighted_stress
from liftdrag.granular import GRAVITY
from liftdrag.scene import TankScene

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

REACH = 5.0
"""Fields are drawn this many intruder diameters to each side of the axis."""

STILL = 0.03
"""Share of the drive's speed below which no streamlines are drawn: chance has a part in it."""

BED = 0.1
"""Solid fraction below which a window lies above the bed."""


def draw_fields(scene: TankScene, fields: Fields, confining: float, path: Path) -> None:
    """Pressure and deviator over the `confining` pressure (Pa), solid fraction and speed."""
    mean = fields.blocks.mean
    figure, panels = _panels(scene, fields.grid, 2, 2)
    speed = np.linalg.norm(velocity(mean), axis=-1) / scene.drive.speed
    _map(panels[0], scene, fields, pressure(mean) / confining, "pressure / confining pressure")
    _map(panels[1], scene, fields, deviator(mean) / confining, "deviator / confining pressure")
    _map(panels[2], scene, fields, mean[..., 0], "solid fraction", cmap="cividis")
    _map(panels[3], scene, fields, speed, "speed / drive speed", cmap="viridis")
    figure.savefig(path, dpi=120)


def draw_streamlines(scene: TankScene, fields: Fields, path: Path) -> None:
    """Speed and streamlines in the frame of the cylinder, and in that of the bed far away."""
    flow = _seen(scene, fields, velocity(fields.blocks.mean)) / scene.drive.speed
    figure, panels = _panels(scene, fields.grid, 1, 2)
    frames = (("cylinder", 0.0), ("bed far away", 1.0))
    for axes, (frame, moved) in zip(panels, frames, strict=True):
        own = flow - [moved, 0.0, 0.0]
        speed = np.linalg.norm(own, axis=-1)
        own[speed < STILL] = np.nan
        _map(axes, scene, fields, speed, f"speed / drive speed, frame of the {frame}", "viridis")
        _streamlines(axes, scene, fields.grid, own)
    figure.savefig(path, dpi=120)


def _streamlines(axes: Axes, scene: TankScene, grid: Grid, flow: np.ndarray) -> None:
    columns, levels = _shown(scene, grid)
    part = flow[columns][:, levels]
    axes.streamplot(
        grid.x[columns] / scene.intruder.diameter,
        grid.z[levels] / scene.intruder.diameter,
        part[..., 0].T,
        part[..., 2].T,
        density=1.2,
        color="white",
        linewidth=0.6,
        arrowsize=0.6,
    )


def draw_asymmetry(
    scene: TankScene, fields: Fields, ring: Ring, confining: float, bulk: float, path: Path
) -> None:
    """What is odd about the plane through the axis: pressure, flow, and stress on the cylinder.

    Stresses are over rho g D of a `bulk` of that density (kg/m^3). The paper's eq. 4 has the stress
    without gravity; here the symmetric part of the same run stands in for it.
    """
    mean, gradient = fields.blocks.mean, bulk * GRAVITY * scene.intruder.diameter
    below = min(REACH, scene.axis_height / scene.intruder.diameter)
    figure, panels = _panels(scene, fields.grid, 2, 2, 2.0 * below)
    flow = _seen(scene, fields, velocity(mean))
    even, odd = split(fields.grid, _seen(scene, fields, pressure(mean)))
    odd += bulk * scene.bulk_gravity * fields.grid.z
    along = split(fields.grid, flow[..., 0])[1] / scene.drive.speed
    _map(panels[0], scene, fields, even / confining, "symmetric pressure / confining pressure")
    _signed(
        panels[1],
        scene,
        fields,
        odd / gradient,
        "antisymmetric pressure less hydrostatic / rho g D",
    )
    _signed(panels[2], scene, fields, along, "antisymmetric speed along the flow / drive speed")
    _draw_odd_stress(panels[3], scene, ring, confining, bulk)
    figure.savefig(path, dpi=120)


def _draw_odd_stress(
    axes: Axes, scene: TankScene, ring: Ring, confining: float, bulk: float
) -> None:
    gradient = bulk * GRAVITY * scene.intruder.diameter

    def odd(forces: np.ndarray) -> np.ndarray:
        normal = ring.normal_of(forces)
        return np.asarray((normal - mirrored(normal)) / (2.0 * gradient))

    stress, error = ring.blocks.estimate(odd)
    normal, _ = ring.normal()
    expected = weighted_stress(scene, (normal + mirrored(normal)) / 2.0, confining, bulk)
    _band(axes, stress, error, "tab:blue", "measured")
    axes.plot(np.degrees(ANGLES), expected / gradient, color="0.3", dashes=(2, 2), label="by eq. 4")
    axes.set_title("antisymmetric normal stress / rho g D", loc="left", fontsize="medium")
    _angles(axes)


def draw_ring(ring: Ring, confining: float, path: Path) -> None:
    """Normal and tangential stress over the `confining` pressure (Pa) against the angle."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.0, 4.0), layout="constrained")
    axes = figure.subplots()
    for name, color, (stress, error) in (
        ("normal", "tab:blue", ring.normal()),
        ("tangential", "tab:orange", ring.tangential()),
    ):
        _band(axes, stress / confining, error / confining, color, name)
    axes.set_ylabel("stress / confining pressure")
    _angles(axes)
    figure.savefig(path, dpi=150)


def _band(axes: Axes, values: np.ndarray, errors: np.ndarray, color: str, label: str) -> None:
    degrees = np.degrees(ANGLES)
    axes.plot(degrees, values, color=color, linewidth=1.5, label=label)
    axes.fill_between(
        degrees, values - errors, values + errors, color=color, alpha=0.25, linewidth=0.0
    )


def _angles(axes: Axes) -> None:
    axes.axhline(0.0, color="0.6", linewidth=0.6)
    axes.set(xlim=(-180.0, 180.0), xlabel="angle around the cylinder")
    axes.set_xticks([-180, -90, 0, 90, 180], ["rear", "above", "front", "below", "rear"])
    axes.legend(frameon=False)


def _panels(
    scene: TankScene, grid: Grid, rows: int, columns: int, height: float | None = None
) -> tuple[Figure, list[Axes]]:
    """Axes for fields of this height over D, that of the grid where none is given."""
    from matplotlib.figure import Figure

    across, up = (np.ptp(part) for part in _shown_axes(scene, grid))
    size = (5.5 * columns, rows * (4.6 * (height or up) / across + 1.0))
    figure = Figure(figsize=size, layout="constrained")
    return figure, list(np.ravel(figure.subplots(rows, columns)))


def _shown(scene: TankScene, grid: Grid) -> tuple[np.ndarray, np.ndarray]:
    """The columns and the levels that are drawn."""
    reach = REACH * scene.intruder.diameter
    return np.flatnonzero(abs(grid.x) <= reach), np.flatnonzero(abs(grid.z) <= reach)


def _shown_axes(scene: TankScene, grid: Grid) -> tuple[np.ndarray, np.ndarray]:
    """Their places over D."""
    columns, levels = _shown(scene, grid)
    d = scene.intruder.diameter
    return grid.x[columns] / d, grid.z[levels] / d


def _seen(scene: TankScene, fields: Fields, values: np.ndarray) -> np.ndarray:
    """Values (nx, nz, ...) where the bed is: not inside the cylinder, above, or at the floor."""
    grid = fields.grid
    inside = np.hypot(grid.x[:, None], grid.z) < scene.intruder.diameter / 2.0
    floor = grid.z + scene.axis_height < grid.radius
    found = values.astype(float)
    found[inside | floor | (fields.blocks.mean[..., 0] < BED)] = np.nan
    return found


def _map(
    axes: Axes,
    scene: TankScene,
    fields: Fields,
    values: np.ndarray,
    title: str,
    cmap: str = "magma",
    **limits: Any,
) -> None:
    from matplotlib.patches import Circle

    columns, levels = _shown(scene, fields.grid)
    x, z = _shown_axes(scene, fields.grid)
    part = _seen(scene, fields, values)[columns][:, levels]
    drawn = np.isfinite(part).any(axis=0)
    mesh = axes.pcolormesh(x, z, part.T, cmap=cmap, shading="nearest", **limits)
    axes.figure.colorbar(mesh, cax=axes.inset_axes((1.03, 0.0, 0.04, 1.0)))
    axes.add_patch(Circle((0.0, 0.0), 0.5, color="0.8"))
    axes.set(aspect="equal", xlabel="x / D", ylabel="z / D", ylim=z[drawn][[0, -1]])
    axes.set_title(title, loc="left", fontsize="medium")


def _signed(axes: Axes, scene: TankScene, fields: Fields, values: np.ndarray, title: str) -> None:
    """As `_map`, zero in the middle of the colours."""
    columns, levels = _shown(scene, fields.grid)
    most = np.nanpercentile(abs(_seen(scene, fields, values)[columns][:, levels]), 99.0)
    _map(axes, scene, fields, values, title, "RdBu_r", vmin=-most, vmax=most)
