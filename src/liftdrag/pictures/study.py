"""Pictures of several runs side by side."""

from __future__ import annotations

from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from liftdrag.analysis.quantity import Quantity

if TYPE_CHECKING:
    from matplotlib.axes import Axes as Panel
    from matplotlib.figure import Figure


LONG = 8
"""Letters of a name that takes the room of more than its bar."""

COLOURS = ("tab:blue", "tab:orange", "tab:green", "tab:purple")

OPEN = "open: not all replicas"
"""What the legend says of points that are not finished."""

BESIDE = "the paper's curve"

_OPEN: dict[str, Any] = {"marker": "o", "linestyle": "", "markerfacecolor": "white", "zorder": 3.0}


@dataclass(frozen=True)
class Axes:
    """What the axes show, which of "x" and "y" are logarithmic, and levels with their labels."""

    x: str
    y: str
    logarithmic: frozenset[str]
    levels: tuple[tuple[float, str], ...]


@dataclass(frozen=True)
class Line:
    """Quantities (n) at places (n,) along the x axis, and what they are called.

    `errors` (n,) are those of the places; `whole` (n,) says which points lack no replica; `beside`
    is a published curve, as places and values.
    """

    label: str
    places: Sequence[float]
    quantities: Sequence[Quantity]
    errors: Sequence[float]
    whole: Sequence[bool]
    beside: Sequence[tuple[float, float]] = ()

    def ordered(self) -> Line:
        """The same from left to right."""
        order = sorted(range(len(self.places)), key=self.places.__getitem__)
        return Line(
            self.label,
            [self.places[k] for k in order],
            [self.quantities[k] for k in order],
            [self.errors[k] for k in order],
            [self.whole[k] for k in order],
            self.beside,
        )


def draw_bars(
    title: str,
    groups: Sequence[Sequence[str]],
    quantities: Mapping[str, Quantity],
    unfinished: Set[str],
    axes: Axes,
    path: Path,
) -> None:
    """A bar of a quantity and its error for each run, by groups; open for `unfinished` ones."""
    figure, panel = _panel()
    place, ticks, names = 0.0, list[float](), list[str]()
    for group in groups:
        for k, run in enumerate(group):
            found = quantities[run]
            colour = COLOURS[k % len(COLOURS)]
            panel.bar(place, found.mean, width=0.8, **_filled(colour, run not in unfinished))
            panel.errorbar(place, found.mean, found.standard_error, color="0.1", capsize=4.0)
            ticks.append(place)
            names.append(run)
            place += 0.9
        place += 0.5
    long = max(map(len, names)) > LONG
    panel.set_xticks(ticks, names, rotation=30 if long else 0, ha="right" if long else "center")
    if unfinished & set(names):
        panel.bar(0.0, 0.0, label=OPEN, **_filled("0.3", False))
    _finish(figure, panel, title, axes, quantities[names[0]].unit, path)


def _filled(colour: str, whole: bool) -> dict[str, Any]:
    return {"facecolor": colour if whole else "none", "edgecolor": colour}


def draw_lines(title: str, lines: Sequence[Line], axes: Axes, path: Path) -> None:
    """Points with their errors against their places, joined to lines; unfinished ones are open."""
    figure, panel = _panel()
    for line in lines:
        _draw_line(panel, line.ordered())
    if not all(all(line.whole) for line in lines):
        panel.plot([], [], color="0.3", label=OPEN, **_OPEN)
    if any(line.beside for line in lines):
        panel.plot([], [], color="0.3", label=BESIDE, linestyle="--")
    panel.set_xlabel(axes.x)
    if "x" in axes.logarithmic:
        panel.set_xscale("log")
    _finish(figure, panel, title, axes, lines[0].quantities[0].unit, path)


def _draw_line(panel: Panel, line: Line) -> None:
    means = [one.mean for one in line.quantities]
    drawn = panel.errorbar(
        line.places,
        means,
        [one.standard_error for one in line.quantities],
        line.errors if any(line.errors) else None,
        marker="o",
        capsize=4.0,
        label=line.label or None,
    )
    colour = drawn.lines[0].get_color()
    if line.beside:
        panel.plot(*zip(*line.beside, strict=True), color=colour, linestyle="--")
    for place, mean, whole in zip(line.places, means, line.whole, strict=True):
        if not whole:
            panel.plot(place, mean, color=colour, **_OPEN)


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
    labels = panel.get_legend_handles_labels()[1]
    if len(labels) > 1 or axes.levels or {OPEN, BESIDE} & set(labels):
        panel.legend(fontsize="small")
    panel.set_title(title, loc="left", fontsize="medium", parse_math=False)
    figure.savefig(path, dpi=150)
