"""Pictures of several runs side by side."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from liftdrag.analysis.quantity import Quantity


def draw_bars(
    title: str,
    groups: Sequence[Sequence[str]],
    name: str,
    quantities: Mapping[str, Quantity],
    path: Path,
) -> None:
    """A bar of the quantity `name` and its error for each run, by groups (Figs. 13 and 14)."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.0, 4.0), layout="constrained")
    axes = figure.subplots()
    place, ticks, names = 0.0, list[float](), list[str]()
    for group in groups:
        for k, run in enumerate(group):
            found = quantities[run]
            colour = ("tab:blue", "tab:orange", "tab:green", "tab:purple")[k % 4]
            axes.bar(place, found.mean, color=colour if len(group) > 1 else "tab:blue", width=0.8)
            axes.errorbar(place, found.mean, found.standard_error, color="0.1", capsize=4.0)
            ticks.append(place)
            names.append(run)
            place += 0.9
        place += 0.5
    axes.set_xticks(ticks, names)
    unit = quantities[names[0]].unit
    axes.set_ylabel(name if unit == "1" else f"{name} ({unit})")
    axes.set_title(title, loc="left", fontsize="medium", parse_math=False)
    figure.savefig(path, dpi=150)


def draw_against(
    title: str,
    groups: Sequence[Sequence[str]],
    key: str,
    places: Mapping[str, float],
    name: str,
    quantities: Mapping[str, Quantity],
    path: Path,
) -> None:
    """The quantity `name` and its error for each run against its place, a line for each group."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.0, 4.0), layout="constrained")
    axes = figure.subplots()
    for group in groups:
        runs = sorted(group, key=lambda run: places[run])
        axes.errorbar(
            [places[run] for run in runs],
            [quantities[run].mean for run in runs],
            [quantities[run].standard_error for run in runs],
            marker="o",
            capsize=4.0,
        )
    unit = quantities[groups[0][0]].unit
    axes.set_xlabel(key)
    axes.set_ylabel(name if unit == "1" else f"{name} ({unit})")
    axes.set_ylim(bottom=0.0)
    axes.set_title(title, loc="left", fontsize="medium", parse_math=False)
    figure.savefig(path, dpi=150)
