"""Run time against error: a panel for each quantity, a mark for each point."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import sqrt
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@dataclass(frozen=True)
class Mark:
    """A point: its axis and value, processor time (s), and relative error."""

    axis: str
    name: str
    cpu_s: float
    error: float


def draw_precision(
    title: str,
    panels: Mapping[str, Sequence[Mark]],
    fronts: Mapping[str, Sequence[Mark]],
    path: Path,
) -> None:
    """The marks of each quantity, the first that of the case; a line through those of its front.

    Dotted is where more runs of the case would lie: the error falls as the root of the time.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.5 * len(panels), 5.0), layout="constrained")
    axes = dict.fromkeys(mark.axis for marks in panels.values() for mark in marks)
    colours = {axis: f"C{k % 10}" if k else "0.1" for k, axis in enumerate(axes)}
    places = figure.subplots(1, len(panels), squeeze=False)[0]
    for place, (quantity, marks) in zip(places, panels.items(), strict=True):
        _draw_marks(place, marks, colours)
        place.plot(*_lines(fronts[quantity]), color="0.7", zorder=0.0)
        _draw_more_runs(place, marks)
        place.set(xscale="log", yscale="log", xlabel="processor time (s)")
        place.set_ylabel(f"error of {quantity}: statistics and bias, relative")
        place.grid(which="both", color="0.92")
    figure.axes[0].legend(fontsize="x-small")
    figure.suptitle(title, x=0.01, ha="left", fontsize="medium", parse_math=False)
    figure.savefig(path, dpi=150)


def _draw_marks(place: Axes, marks: Sequence[Mark], colours: Mapping[str, str]) -> None:
    for axis, colour in colours.items():
        mine = [mark for mark in marks if mark.axis == axis]
        place.plot(*_lines(mine), "o", color=colour, label=axis)
        for mark in mine:
            place.annotate(
                mark.name or "the case",
                (mark.cpu_s, mark.error),
                xytext=(4.0, 3.0),
                textcoords="offset points",
                fontsize="x-small",
                color=colour,
            )


def _draw_more_runs(place: Axes, marks: Sequence[Mark]) -> None:
    case, times = marks[0], [mark.cpu_s for mark in marks]
    errors = [case.error * sqrt(case.cpu_s / time) for time in (min(times), max(times))]
    place.plot([min(times), max(times)], errors, ":", color="0.5", linewidth=1.0, zorder=0.0)


def _lines(marks: Sequence[Mark]) -> tuple[list[float], list[float]]:
    return [mark.cpu_s for mark in marks], [mark.error for mark in marks]
