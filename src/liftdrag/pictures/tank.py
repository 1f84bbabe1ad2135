"""Pictures of a run: the forces against displacement, and a slice of the bed."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from liftdrag.analysis.quantity import rounded
from liftdrag.analysis.tank import Answers
from liftdrag.scene import TankScene
from liftdrag.series import Series
from liftdrag.snapshot import Snapshot

if TYPE_CHECKING:
    from matplotlib.axes import Axes

REACH = 9.0
"""The bed is drawn this many intruder diameters to either side of the cylinder."""


def draw_forces(scene: TankScene, series: Series, found: Answers, path: Path) -> None:
    """Drag and lift against displacement: samples, steady window, mean and error band."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.0, 5.0), layout="constrained")
    for axes, name in zip(figure.subplots(2, 1, sharex=True), ("drag", "lift"), strict=True):
        _draw_force(axes, scene, series, found, name)
    axes.set_xlabel("displacement over intruder diameter")
    figure.savefig(path, dpi=150)


def _draw_force(axes: Axes, scene: TankScene, series: Series, found: Answers, name: str) -> None:
    window, quantity = found.window, found.quantities[name]
    place = series.time * scene.drive.speed / scene.intruder.diameter
    coefficient = found.quantities[f"{name}_coefficient"]
    mean, error = rounded(coefficient.mean, coefficient.standard_error)
    axes.plot(place, series[name], color="0.75", linewidth=0.4)
    axes.plot(*_smoothed(place, series[name]), color="tab:blue", linewidth=1.2)
    axes.axvspan(0.0, place[window.start], color="0.93")
    span = [place[window.start], place[window.stop - 1]]
    low, high = quantity.mean - quantity.standard_error, quantity.mean + quantity.standard_error
    axes.fill_between(span, low, high, color="tab:red", alpha=0.35, linewidth=0.0)
    axes.plot(span, [quantity.mean] * 2, color="tab:red", linewidth=1.5)
    axes.set_ylabel(f"{name} (N)")
    axes.set_title(f"{name} coefficient {mean} ± {error}", loc="left", fontsize="medium")
    axes.margins(x=0.0)


def _smoothed(place: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Means over blocks of half an intruder diameter."""
    block = max(int(np.searchsorted(place, place[0] + 0.5)), 1)
    count = len(values) // block
    shape = (count, block)
    return (
        place[: count * block].reshape(shape).mean(axis=1),
        values[: count * block].reshape(shape).mean(axis=1),
    )


def draw_bed(scene: TankScene, snapshot: Snapshot, path: Path) -> None:
    """The grains cut by the plane through the middle of the tank, coloured by speed."""
    from matplotlib.collections import EllipseCollection
    from matplotlib.figure import Figure
    from matplotlib.patches import Circle

    x, z, width, speed = _slice(scene, snapshot)
    figure = Figure(figsize=(10.0, 1.0 + 8.0 * z.max() / np.ptp(x)), layout="constrained")
    axes = figure.subplots()
    centres = {"offsets": np.column_stack([x, z]), "offset_transform": axes.transData}
    grains = EllipseCollection(width, width, 0.0, units="x", **centres)
    grains.set(array=speed / scene.drive.speed, cmap="viridis", clim=(0.0, 1.2))
    axes.add_collection(grains)
    axes.add_patch(Circle((0.0, scene.axis_height / scene.intruder.diameter), 0.5, color="tab:red"))
    axes.set(aspect="equal", xlabel="x / D", ylabel="z / D")
    axes.set(xlim=(x.min() - 0.2, x.max() + 0.2), ylim=(0.0, z.max() + 0.5))
    figure.colorbar(grains, label="speed / drive speed", shrink=0.8)
    axes.set_title(f"slice at half thickness, {snapshot.time:.3g} s after the start", loc="left")
    figure.savefig(path, dpi=100)


def _slice(scene: TankScene, snapshot: Snapshot) -> tuple[np.ndarray, ...]:
    """x and z of the cut grains about the cylinder and their cuts' widths, over D; their speeds."""
    diameter, length = scene.intruder.diameter, scene.tank.length
    offset = snapshot.position[:, 1] - scene.tank.thickness / 2.0
    cut = (scene.grains.diameter / 2.0) ** 2 - offset**2
    x = (snapshot.position[:, 0] - scene.axis_x + length / 2.0) % length - length / 2.0
    seen = (cut > 0.0) & (abs(x) < REACH * diameter)
    speed = np.linalg.norm(snapshot.velocity[seen], axis=1)
    z = snapshot.position[seen, 2]
    return x[seen] / diameter, z / diameter, 2.0 * np.sqrt(cut[seen]) / diameter, speed
