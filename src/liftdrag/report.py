"""A result for people: a table on the terminal, and pictures of the forces and of the bed."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from liftdrag.analysis.quantity import Quantity
from liftdrag.runner import Result
from liftdrag.scene import TankScene
from liftdrag.snapshot import Snapshot

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from rich.table import Table

REACH = 9.0
"""The bed is drawn this many intruder diameters to either side of the cylinder."""

_MEANINGS = {
    "drag": "force along the flow",
    "lift": "force against gravity",
    "drag_coefficient": "drag / (rho g h~ D L)",
    "lift_coefficient": "lift / (rho g pi D^2/4 L)",
    "drag_coefficient_overburden": "drag / (measured overburden x D L)",
    "solid_fraction": "of the far bed",
    "depth": "of the axis below the far surface",
    "effective_depth": "h~, depth and lid",
    "overburden": "weight above the axis per area, far",
    "bed_speed_ratio": "far bed over drive",
    "inertial_number": "(U0/D) d / sqrt(P/rho_g)",
}


def table(quantities: dict[str, Quantity]) -> Table:
    """The quantities as a table for the terminal."""
    from rich.table import Table

    columns = ("quantity", "mean", "standard error", "unit", "independent samples", "meaning")
    result = Table(*columns, title_justify="left")
    for name, quantity in quantities.items():
        result.add_row(name, *_cells(quantity), _MEANINGS.get(name, ""))
    return result


def _cells(quantity: Quantity) -> Iterator[str]:
    mean, error = rounded(quantity.mean, quantity.standard_error)
    share = abs(quantity.standard_error / quantity.mean) if quantity.mean else float("inf")
    yield mean
    yield f"{error} ({100 * share:.2g} %)" if share < 10 else error
    yield "" if quantity.unit == "1" else quantity.unit
    count = quantity.n_independent
    mark = "" if quantity.converged else " (not converged)"
    yield ("" if count is None else f"{count:.0f}") + mark


def rounded(mean: float, error: float) -> tuple[str, str]:
    """A mean and its error as text, both to the error's second significant digit."""
    if not np.isfinite(error) or error <= 0.0:
        return f"{mean:.5g}", f"{error:.2g}"
    digits = 1 - int(np.floor(np.log10(error)))
    if abs(mean) >= 1e5 or digits > 6:
        return f"{mean:.5g}", f"{error:.2g}"
    return f"{mean:.{max(digits, 0)}f}", f"{error:.{max(digits, 0)}f}"


def draw(result: Result) -> list[Path]:
    """Write `forces.png` and `bed.png` into the result's folder; the paths."""
    return [
        draw_forces(result, result.folder / "forces.png"),
        draw_bed(result.scene, result.snapshots[-1], result.folder / "bed.png"),
    ]


def draw_forces(result: Result, path: Path) -> Path:
    """Drag and lift against displacement: samples, steady window, mean and error band."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.0, 5.0), layout="constrained")
    for axes, name in zip(figure.subplots(2, 1, sharex=True), ("drag", "lift"), strict=True):
        _draw_force(axes, result, name)
    axes.set_xlabel("displacement over intruder diameter")
    figure.savefig(path, dpi=150)
    return path


def _draw_force(axes: Axes, result: Result, name: str) -> None:
    scene, series, window = result.scene, result.series, result.window
    quantity = result.quantities[name]
    place = series.time * scene.drive.speed / scene.intruder.diameter
    coefficient = result.quantities[f"{name}_coefficient"]
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


def draw_bed(scene: TankScene, snapshot: Snapshot, path: Path) -> Path:
    """The grains cut by the plane through the middle of the tank, coloured by speed."""
    from matplotlib.collections import EllipseCollection
    from matplotlib.figure import Figure
    from matplotlib.patches import Circle

    x, z, width, speed = _slice(scene, snapshot)
    figure = Figure(figsize=(10.0, 4.5), layout="constrained")
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
    figure.savefig(path, dpi=150)
    return path


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
