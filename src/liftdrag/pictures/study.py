"""Pictures of several runs side by side."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from liftdrag.analysis.quantity import Quantity

if TYPE_CHECKING:
    from matplotlib.axes import Axes as Panel
    from matplotlib.figure import Figure


LONG = 8
"""Letters of a name that takes the room of more than its bar."""


@dataclass(frozen=True)
class Axes:
    """What the axes show, which of "x" and "y" are logarithmic, and levels with their labels."""

    x: str
    y: str
    logarithmic: frozenset[str]
    levels: tuple[tuple[float, str], ...]


@dataclass(frozen=True)
class Line:
    """Quantities (n) at places (n,) along the x axis, and what they are called."""

    label: str
    places: Sequence[float]
    quantities: Sequence[Quantity]


def draw_bars(
    title: str,
    groups: Sequence[Sequence[str]],
    quantities: Mapping[str, Quantity],
    axes: Axes,
    path: Path,
) -> None:
    """A bar of a quantity and its error for each run, by groups (Figs. 13 and 14)."""
    figure, panel = _panel()
    place, ticks, names = 0.0, list[float](), list[str]()
    for group in groups:
        for k, run in enumerate(group):
            found = quantities[run]
            colour = ("tab:blue", "tab:orange", "tab:green", "tab:purple")[k % 4]
            panel.bar(place, found.mean, color=colour if len(group) > 1 else "tab:blue", width=0.8)
            panel.errorbar(place, found.mean, found.standard_error, color="0.1", capsize=4.0)
            ticks.append(place)
            names.append(run)
            place += 0.9
        place += 0.5
    long = max(map(len, names)) > LONG
    panel.set_xticks(ticks, names, rotation=30 if long else 0, ha="right" if long else "center")
    _finish(figure, panel, title, axes, quantities[names[0]].unit, path)


def draw_lines(title: str, lines: Sequence[Line], axes: Axes, path: Path) -> None:
    """Points with their errors against their places, joined to lines."""
    figure, panel = _panel()
    for line in lines:
        order = sorted(range(len(line.places)), key=line.places.__getitem__)
        panel.errorbar(
            [line.places[k] for k in order],
            [line.quantities[k].mean for k in order],
            [line.quantities[k].standard_error for k in order],
            marker="o",
            capsize=4.0,
            label=line.label or None,
        )
    panel.set_xlabel(axes.x)
    if "x" in axes.logarithmic:
        panel.set_xscale("log")
    _finish(figure, panel, title, axes, lines[0].quantities[0].unit, path)


def _panel() -> tuple[Figure, Panel]:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.0, 4.0), layout="constrained")
    return figure, figure.subplots()


def _finish(figure: Figure, panel: Panel, title: str, axes: Axes, unit: str, path: Path) -> None:
    for k, (level, label) in enumerate(axes.levels):
        panel.axhline(level, color="0.3", linestyle=("--", ":", "-.")[k % 3], label=label)
    panel.set_ylabel(axes.y if unit == "1" else f"{axes.y} ({unit})")
    if "y" in axes.logarithmic:
        panel.set_yscale("log")
    elif panel.get_ylim()[0] > 0.0:
        panel.set_ylim(bottom=0.0)
    if len(panel.get_legend_handles_labels()[1]) > (0 if axes.levels else 1):
        panel.legend(fontsize="small")
    panel.set_title(title, loc="left", fontsize="medium", parse_math=False)
    figure.savefig(path, dpi=150)
