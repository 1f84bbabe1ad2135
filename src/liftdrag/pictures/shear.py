"""Pictures of a shear flow: stresses and alignment against strain, and against each other."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from liftdrag import liu
from liftdrag.analysis.quantity import Quantity, rounded
from liftdrag.analysis.shear import STRESSES, ShearAnswers
from liftdrag.scene import ShearScene
from liftdrag.series import Series

if TYPE_CHECKING:
    from matplotlib.axes import Axes

COLOURS = {"shear_stress": "tab:red", "pressure": "tab:blue"}

ORDER = "order_parameter"
"""What spheres alone have none of."""

BLOCK = 1.0
"""Strain over which a stress is averaged for a picture."""

ROOM = 1.5
"""Upper end of a stress axis, over the largest block of the flow past its start."""


def named(scene: ShearScene, number: int) -> str:
    """What a species is called, by its number from 1."""
    species = scene.species[number - 1]
    if species.is_sphere:
        return "spheres"
    return f"{'rods' if species.is_rod else 'disks'} of ratio {species.aspect_ratio:g}"


def blocks(series: Series, name: str, strain: float = BLOCK) -> tuple[np.ndarray, np.ndarray]:
    """The middles (k,) in strain of whole blocks of a series, and its means (k,) over them."""
    number = (series["strain"] / strain * (1.0 - 1e-9)).astype(int)
    count = np.bincount(number)
    mean = np.bincount(number, series[name]) / np.maximum(count, 1)
    full = count > 0.5 * count.max()
    return (np.flatnonzero(full) + 0.5) * strain, mean[full]


def draw_flow(scene: ShearScene, found: ShearAnswers, path: Path) -> None:
    """Stresses over rho d_v^2 rate^2, and order and stacks, against strain (Figs. 6 to 10)."""
    from matplotlib.figure import Figure

    panels = 2 if ORDER in found.structure.channels else 1
    figure = Figure(figsize=(7.0, 3.0 * panels), layout="constrained")
    column = list(figure.subplots(panels, 1, sharex=True, squeeze=False)[:, 0])
    upper = column[0]
    for name, colour in COLOURS.items():
        _draw_stress(upper, found, name, colour)
    upper.set(ylabel=r"stress / $\rho\,d_v^2\,\dot\gamma^2$")
    upper.set_ylim(0.0, ROOM * _largest(scene, found))
    upper.set_title(_title(found.quantities), loc="left", fontsize="medium")
    if ORDER in found.structure.channels:
        _draw_structure(column[1], scene, found.structure)
    for axes in column:
        axes.axvspan(0.0, _start(found), color="0.93", linewidth=0, zorder=0)
        axes.legend(frameon=False, fontsize="small")
    column[-1].set(xlabel="strain", xlim=(0.0, found.series["strain"][-1]))
    figure.savefig(path, dpi=150)


def _start(found: ShearAnswers) -> float:
    return float(found.series["strain"][found.window.start])


def _largest(scene: ShearScene, found: ShearAnswers) -> float:
    """The largest pressure of a block once a tenth of the strain is past."""
    at, mean = blocks(found.series, "pressure", min(BLOCK, scene.drive.strain / 20.0))
    return float(mean[at > 0.1 * scene.drive.strain].max())


def _draw_stress(axes: Axes, found: ShearAnswers, name: str, colour: str) -> None:
    """Each row faintly, blocks, and the mean with its error over the window."""
    strain, quantity = found.series["strain"], found.quantities[name]
    axes.plot(strain, found.series[name], color=colour, alpha=0.2, linewidth=0.5)
    label = f"{name.replace('_', ' ')} {_text(quantity)}"
    axes.plot(*blocks(found.series, name), color=colour, linewidth=1.2, label=label)
    mean, error = quantity.mean, quantity.standard_error
    window = [_start(found), strain[-1]]
    axes.fill_between(window, mean - error, mean + error, color=colour, alpha=0.3, linewidth=0)


def _draw_structure(axes: Axes, scene: ShearScene, structure: Series) -> None:
    strain = structure["strain"]
    axes.plot(strain, structure["order_parameter"], color="0.1", label="order parameter")
    for number in range(1, len(scene.species) + 1):
        own = f"order_parameter_{number}"
        if own in structure.channels:
            label = f"that of {named(scene, number)}"
            axes.plot(strain, structure[own], linewidth=0.9, linestyle="--", label=label)
    fraction = structure["stacking_fraction"]
    axes.plot(strain, fraction, color="tab:green", linewidth=0.9, label="share in stacks")
    axes.set(ylim=(0.0, 1.0), ylabel="order, and share in stacks")


def _text(quantity: Quantity) -> str:
    return " ± ".join(rounded(quantity.mean, quantity.standard_error))


def _title(found: dict[str, Quantity]) -> str:
    order = f", order {_text(found[ORDER])}" if ORDER in found else ""
    return f"friction {_text(found['bulk_friction'])}{order}"


def draw_order(scene: ShearScene, found: ShearAnswers, path: Path) -> None:
    """Stresses against the order parameter, with the paper's curves (Figs. 16 and 17)."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.5, 4.4), layout="constrained")
    row = figure.subplots(1, 2)
    for axes, name in zip(row, STRESSES, strict=True):
        _draw_against_order(axes, scene, found, name)
        axes.set_title(f"{name.replace('_', ' ')} {_text(found.quantities[name])}", loc="left")
    figure.colorbar(row[0].collections[0], ax=row, label="strain")
    figure.legend(*row[0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    figure.savefig(path, dpi=150)


def _draw_against_order(axes: Axes, scene: ShearScene, found: ShearAnswers, name: str) -> None:
    """Blocks of the whole flow by their strain, the mean, and the curve where there is one."""
    at, stress = blocks(found.series, name)
    order = np.interp(at, found.structure["strain"], found.structure["order_parameter"])
    axes.scatter(order, stress, c=at, s=12.0, cmap="viridis", label="mean over a strain of one")
    mean, alignment = found.quantities[name], found.quantities["order_parameter"]
    axes.errorbar(
        alignment.mean,
        mean.mean,
        mean.standard_error,
        alignment.standard_error,
        fmt="o",
        color="tab:red",
        capsize=2.5,
        label="mean over the steady flow",
    )
    curve = liu.curve(name, scene.solid_fraction)
    if curve is not None:
        grid = np.linspace(min(liu.ALIGNED, order.min()), max(0.95, order.max()), 100)
        axes.plot(grid, curve(grid), color="0.4", linestyle="--", label="Liu et al. 2020")
    axes.set(yscale="log", xlabel="order parameter")
    axes.set_ylabel(r"stress / $\rho\,d_v^2\,\dot\gamma^2$")
