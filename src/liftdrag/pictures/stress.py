"""The stability map: a row for each axis, a mark for each value, by what became of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MARKS = {
    "whole": ("o", "#0072B2"),
    "overlap": ("s", "#E69F00"),
    "energy": ("^", "#D55E00"),
    "lost": ("X", "#000000"),
    "not finite": ("P", "#000000"),
    "balance": ("v", "#CC79A7"),
    "answer": ("D", "#F0E442"),
    "failed": ("*", "#56B4E9"),
    "refused": ("|", "#999999"),
}
"""Marker and colour by what became of a value; the colours are Okabe and Ito's."""

LOGARITHMIC = ("time_step", "stiffness", "speed", "shear_rate")


@dataclass(frozen=True)
class Dot:
    """A value `at` a place of its axis and what became of it: its `cause`, and how near it was.

    `overlap` over its bound, `heating` over the case, the largest `deviation` of an answer, each
    None where it is not known.
    """

    at: float
    cause: str
    overlap: float | None
    heating: float | None
    deviation: float | None


def draw_map(
    title: str,
    axes: Mapping[str, Sequence[Dot]],
    steps: Mapping[str, float],
    unit: str,
    path: Path,
) -> None:
    """A row for each axis: overlap over its bound above each value, 1 where it breaks.

    `steps` are drawn and named on the axis of the time step, whose `unit` is said.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.0, 1.0 + 1.5 * len(axes)), layout="constrained")
    places = figure.subplots(len(axes), 1, squeeze=False)[:, 0]
    for place, (name, dots) in zip(places, axes.items(), strict=True):
        _draw_axis(place, name, dots)
        if name == "time_step":
            _draw_steps(place, steps)
            place.set_xlabel(f"time step, in units of {unit}", fontsize="small")
    _legend(figure.axes[0], {dot.cause for dots in axes.values() for dot in dots})
    figure.suptitle(title, x=0.01, ha="left", fontsize="medium")
    figure.savefig(path, dpi=150)


def _draw_axis(place: Axes, name: str, dots: Sequence[Dot]) -> None:
    for dot in dots:
        marker, colour = MARKS[dot.cause]
        height = 0.0 if dot.overlap is None else min(dot.overlap, 1.2)
        place.plot([dot.at], [height], marker, color=colour, markeredgecolor="0.2", markersize=8)
        for text, low in ((_shown(dot.heating, "x{:.2g}"), 7.0), (_percent(dot.deviation), -14.0)):
            place.annotate(
                text,
                (dot.at, height),
                xytext=(0.0, low),
                textcoords="offset points",
                fontsize="xx-small",
                ha="center",
            )
    if name in LOGARITHMIC:
        place.set_xscale("log")
    else:
        place.set_xticks([dot.at for dot in dots])
    place.axhline(1.0, color="0.7", linewidth=0.8)
    place.set(ylim=(-0.45, 1.75), yticks=[0.0, 1.0], ylabel="overlap\nover bound")
    place.set_xlabel(name.replace("_", " "), fontsize="small")
    place.grid(axis="x", which="both", color="0.92")


def _draw_steps(place: Axes, steps: Mapping[str, float]) -> None:
    for name, share in steps.items():
        place.axvline(share, color="0.4", linestyle=":", linewidth=1.0)
        place.annotate(name, (share, 1.7), fontsize="xx-small", rotation=90, ha="right", va="top")


def _legend(place: Axes, causes: set[str]) -> None:
    for cause, (marker, colour) in MARKS.items():
        if cause in causes:
            place.plot([], [], marker, color=colour, markeredgecolor="0.2", label=cause)
    place.plot([], [], " ", label="above: agitation's energy over the case's")
    place.plot([], [], " ", label="below: largest deviation of an answer")
    place.legend(fontsize="xx-small", loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=4)


def _shown(value: float | None, form: str) -> str:
    return "" if value is None else form.format(value)


def _percent(value: float | None) -> str:
    return "" if value is None else f"{100.0 * value:.2g} %"
