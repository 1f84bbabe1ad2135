"""Pictures of a Janssen piston: apparent mass against the fill, and the column's profile."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from liftdrag import granular
from liftdrag.analysis.column import ColumnProfile
from liftdrag.analysis.janssen import JanssenAnswers, janssen_curves, sense
from liftdrag.analysis.quantity import Quantity, rounded
from liftdrag.granular import GRAVITY
from liftdrag.scene import JanssenScene

if TYPE_CHECKING:
    from matplotlib.axes import Axes

GRAM = 1e3
MILLI = 1e3

ROOM = 1.35
"""Upper end of an axis, over what is measured on it; the hydrostatic line may leave there."""

POINTS: dict[str, Any] = {"fmt": "o", "markersize": 4.0, "capsize": 2.5}

STYLES: dict[str, dict[str, Any]] = {
    "one_parameter": {"color": "tab:red", "linewidth": 1.5},
    "two_parameter": {"color": "tab:green", "linewidth": 1.5, "linestyle": "--"},
    "hydrostatic": {"color": "0.6", "linewidth": 1.0, "linestyle": ":"},
}


def draw_curve(scene: JanssenScene, found: JanssenAnswers, path: Path) -> None:
    """Apparent mass against the mass of the fill: points, both fits and the hydrostatic line."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.0, 4.5), layout="constrained")
    axes = figure.subplots()
    mass = np.array([point.mass for point in found.curve])
    load = np.array([point.apparent_mass.mean for point in found.curve])
    error = np.array([point.apparent_mass.standard_error for point in found.curve])
    grid = np.linspace(0.0, 1.04 * mass[-1], 400)
    for name, curve in janssen_curves(scene, found.fits, grid).items():
        label = _label(name, found.quantities)
        axes.plot(GRAM * grid, GRAM * curve, label=label, **STYLES[name])
    axes.errorbar(
        GRAM * mass, GRAM * load, GRAM * error, color="0.1", label="piston", zorder=3, **POINTS
    )
    axes.set(xlabel="mass of the grains (g)", ylabel="apparent mass on the piston (g)")
    axes.set(xlim=(0.0, GRAM * grid[-1]), ylim=(0.0, ROOM * GRAM * float((load + error).max())))
    axes.set_title(_title(found.quantities), loc="left", fontsize="medium")
    axes.legend(frameon=False, fontsize="small")
    figure.savefig(path, dpi=150)


def _text(quantity: Quantity, scale: float = 1.0) -> str:
    return " ± ".join(rounded(scale * quantity.mean, scale * quantity.standard_error))


def _label(name: str, quantities: dict[str, Quantity]) -> str:
    named = {
        "one_parameter": ("Janssen", "saturation_mass", "$M_{sat}$"),
        "two_parameter": ("Vanel and Clément", "hydrostatic_cap", "$M_0$"),
    }
    if name not in named:
        return name
    words, key, symbol = named[name]
    return f"{words}, {symbol} = {_text(quantities[key], GRAM)} g"


def _title(quantities: dict[str, Quantity]) -> str:
    """K and chi-square of the one-parameter fit, or the load where there is none."""
    words = list[str]()
    if "janssen_ratio" in quantities:
        words.append(f"K = {_text(quantities['janssen_ratio'])}")
    if "chi_square" in quantities:
        words.append(f"$\\chi^2$/dof = {quantities['chi_square'].mean:.3g}")
    return ", ".join(words) or f"{_text(quantities['apparent_mass'], GRAM)} g on the piston"


def draw_profile(scene: JanssenScene, found: JanssenAnswers, path: Path) -> None:
    """Stresses, the wall's friction and solid fraction against height, at the last fill.

    Nothing is drawn without a profile.
    """
    from matplotlib.figure import Figure

    if found.profile is None:
        return
    panels: list[Callable[[Axes, JanssenScene, JanssenAnswers, ColumnProfile], None]]
    panels = [_draw_stresses, _draw_friction, _draw_fraction]
    if not scene.tube.friction:
        panels.remove(_draw_friction)
    size = (2.0 + 3.0 * len(panels), 4.8)
    widths = [1.5] + [1.0] * (len(panels) - 1)
    figure = Figure(figsize=size, layout="constrained")
    row = figure.subplots(1, len(panels), sharey=True, width_ratios=widths)
    for axes, draw in zip(row, panels, strict=True):
        draw(axes, scene, found, found.profile)
        if axes.get_legend_handles_labels()[1]:
            axes.legend(frameon=False, fontsize="small", loc="upper right")
    row[0].set_ylabel("height above the piston (mm)")
    row[0].set_ylim(0.0, ROOM * MILLI * float(found.profile.height[-1]))
    figure.savefig(path, dpi=150)


def _draw_stresses(
    axes: Axes, scene: JanssenScene, found: JanssenAnswers, profile: ColumnProfile
) -> None:
    """Both stresses with their bars, and the lines that the fit of the curve asks for."""
    height, lines = _predicted(scene, found)
    colours = {"vertical": "tab:blue", "radial": "tab:orange", "hydrostatic": "0.6"}
    for name, stress in lines.items():
        style = ":" if name == "hydrostatic" else "-"
        label = name if name == "hydrostatic" else f"{name}, by the fit"
        axes.plot(stress, height, style, color=colours[name], linewidth=1.2, label=label)
    measured = {
        "vertical": (profile.vertical_stress, profile.vertical_error),
        "radial": (profile.radial_stress, profile.radial_error),
    }
    for name, (stress, error) in measured.items():
        height = MILLI * profile.height
        axes.errorbar(stress, height, xerr=error, color=colours[name], label=name, **POINTS)
    largest = max(float((stress + error).max()) for stress, error in measured.values()) or 1.0
    axes.set(xlabel="stress (Pa)", xlim=(0.0, ROOM * largest))
    if "janssen_ratio_direct" in found.quantities:
        text = f"K = {_text(found.quantities['janssen_ratio_direct'])}, measured in the bulk"
        axes.set_title(text, loc="left", fontsize="medium")


def _predicted(
    scene: JanssenScene, found: JanssenAnswers
) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Heights (n,) in mm, and the stresses (n,) in Pa there of Janssen's and of a fluid column.

    The vertical one bends with the fitted M_sat, whatever the share of the friction mobilised;
    the radial one is that times K, corrected for this share where it is known.
    """
    density = found.quantities["solid_fraction"].mean * scene.grains.density
    section, weight = scene.tube.section, density * GRAVITY
    depth = np.linspace(0.0, found.curve[-1].mass / (density * section), 200)
    lid = scene.lid_mass * GRAVITY / section
    lines = {"hydrostatic": weight * depth + lid}
    ratio = found.quantities.get("janssen_ratio_mobilised", found.quantities.get("janssen_ratio"))
    if ratio is not None:
        saturation = found.quantities["saturation_mass"].mean
        beta = sense(scene) * density * section / saturation
        stress = [granular.janssen_stress(float(z), weight, beta, lid) for z in depth]
        lines["vertical"] = np.array(stress)
        lines["radial"] = ratio.mean * lines["vertical"]
    return MILLI * (depth[-1] - depth), lines


def _draw_friction(
    axes: Axes, _scene: JanssenScene, _found: JanssenAnswers, profile: ColumnProfile
) -> None:
    height = MILLI * profile.height
    label = r"mean $|T|/\mu_w N$"
    axes.plot(profile.mobilisation, height, "o-", color="tab:purple", markersize=4.0, label=label)
    axes.plot(profile.sliding, height, "s--", color="tab:brown", markersize=4.0, label="sliding")
    axes.set(xlabel="contacts with the tube", xlim=(0.0, 1.05))


def _draw_fraction(
    axes: Axes, _scene: JanssenScene, found: JanssenAnswers, profile: ColumnProfile
) -> None:
    mean = found.quantities["solid_fraction"]
    low, high = mean.mean - mean.standard_error, mean.mean + mean.standard_error
    height = MILLI * profile.height
    axes.axvspan(low, high, color="tab:red", alpha=0.35, linewidth=0.0)
    axes.axvline(mean.mean, color="tab:red", linewidth=1.2)
    axes.set_title(f"bulk {_text(mean)}", loc="left", fontsize="medium")
    axes.plot(profile.solid_fraction, height, "o-", color="0.3", markersize=4.0)
    axes.set(xlabel="solid fraction", xlim=(0.0, 0.8))
