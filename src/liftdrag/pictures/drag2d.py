"""Pictures of drag through a closed bed: force against displacement, and the flow."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from liftdrag.analysis.drag2d import EnsembleAnswers, displacement
from liftdrag.analysis.quantity import rounded
from liftdrag.dem import Bed
from liftdrag.scene import Drag2DScene
from liftdrag.series import Series
from liftdrag.snapshot import Snapshot

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MILLI = 1e3
LAYERS = 8
"""Layers of grains that are coloured by turns."""

CLUSTER = 1.5
"""Reach of the tracked cluster in front of the cylinder, over the cylinder's diameter."""


def draw_drag(
    scene: Drag2DScene, packings: Sequence[Series], found: EnsembleAnswers, path: Path
) -> None:
    """Drag against displacement: each packing, their mean and its error (Zhou et al., Fig. 7)."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.0, 4.5), layout="constrained")
    axes = figure.subplots()
    place = MILLI * displacement(scene, found.series)
    for series in packings:
        axes.plot(place, series["drag"], color="0.8", linewidth=0.5)
    mean, error = found.series["drag"], found.drag_error
    axes.fill_between(place, mean - error, mean + error, color="tab:blue", alpha=0.3, linewidth=0)
    axes.plot(place, mean, color="tab:blue", linewidth=1.5)
    drag = found.quantities["drag"]
    window = [MILLI * scene.drive.average_from, MILLI * scene.drive.distance]
    axes.plot(window, [drag.mean] * 2, color="tab:red", linewidth=1.5)
    text = " ± ".join(rounded(drag.mean, drag.standard_error))
    axes.set_title(f"drag {text} N over {len(packings)} packings", loc="left", fontsize="medium")
    axes.set(xlabel="displacement (mm)", ylabel="drag (N)", xlim=(0.0, place[-1]))
    axes.set_ylim(bottom=min(0.0, float(mean.min())))
    figure.savefig(path, dpi=150)


def draw_flow(scene: Drag2DScene, bed: Bed, moments: list[Snapshot], path: Path) -> None:
    """The first packing at three displacements: a cluster tracked, and layers (Figs. 9 to 12)."""
    from matplotlib.figure import Figure

    shown = [moments[k] for k in (0, len(moments) // 2, len(moments) - 1)]
    size = (10.0, 1.0 + 6.6 * scene.height / scene.box.width)
    figure = Figure(figsize=size, layout="constrained")
    rows = figure.subplots(2, 3, sharex=True, sharey=True)
    for row, colours in zip(rows, (_cluster(scene, bed), _layers(scene, bed)), strict=True):
        for axes, moment in zip(row, shown, strict=True):
            _draw_moment(axes, scene, bed, moment, colours)
    for axes, moment in zip(rows[0], shown, strict=True):
        axes.set_title(f"{MILLI * moment.time * scene.drive.speed:.3g} mm", fontsize="medium")
    figure.savefig(path, dpi=100)


def _cluster(scene: Drag2DScene, bed: Bed) -> np.ndarray:
    """A colour for each body (b, 3): those at first in front of the cylinder are dark."""
    ahead = bed.position - bed.position[-1]
    diameter = scene.intruder.diameter
    inside = (abs(ahead[:, 0]) < CLUSTER / 2.0 * diameter) & (ahead[:, 1] > 0.0)
    inside &= ahead[:, 1] < CLUSTER * diameter
    return np.where(inside[:, None], [0.85, 0.35, 0.1], [0.87, 0.87, 0.87])


def _layers(scene: Drag2DScene, bed: Bed) -> np.ndarray:
    """A colour for each body (b, 3) by the layer that it is in at first."""
    layer = (LAYERS * bed.position[:, 1] / scene.height).astype(int)
    return np.where(layer[:, None] % 2 == 0, [0.35, 0.55, 0.8], [0.93, 0.88, 0.7])


def _draw_moment(
    axes: Axes, scene: Drag2DScene, bed: Bed, moment: Snapshot, colours: np.ndarray
) -> None:
    from matplotlib.collections import EllipseCollection
    from matplotlib.patches import Circle

    parts = len(bed.body) - 1
    width, height = (2.0 * MILLI * bed.semi_axes[:parts]).T
    angle = np.zeros(parts) if moment.angle is None else np.degrees(moment.angle[:parts])
    centres = MILLI * moment.position[:, :2]
    axes.add_collection(
        EllipseCollection(
            width,
            height,
            angle,
            units="xy",
            offsets=centres[:parts],
            offset_transform=axes.transData,
            facecolors=colours[bed.body[:parts]],
            edgecolors="0.3",
            linewidths=0.3,
        )
    )
    radius = MILLI * scene.intruder.diameter / 2.0
    axes.add_patch(Circle(tuple(centres[-1]), radius, color="0.15"))
    box = {"xlim": (0.0, MILLI * scene.box.width), "ylim": (0.0, MILLI * scene.height)}
    axes.set(aspect="equal", **box)
    axes.set_xticks([])
    axes.set_yticks([])
