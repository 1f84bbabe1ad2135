"""A series as a chart: the range and the mean of each of a few hundred blocks, to be drawn as SVG.

The drawing has no text, so that it may be stretched to any width; the page sets the labels.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite
from pathlib import Path

import numpy as np

from liftdrag.analysis.quantity import Quantity
from liftdrag.errors import InputError
from liftdrag.files import is_file
from liftdrag.page.record import RunRecord
from liftdrag.page.sheets import with_error, words
from liftdrag.tables import read_table

WIDTH, HEIGHT = 600.0, 120.0
"""Of the drawing, in its own units."""

BLOCKS = 240
MOST = 8
"""Charts of a series."""

_ENGINE = {"TimeStep": "time step"}

FILES = ("series.csv", "drag.csv", "forces.dat")
"""Where a series is, the first that exists; the last is the engine's, of a run without answers."""


@dataclass(frozen=True)
class Chart:
    """One column of a series against the first one.

    `band` and `line` are paths of SVG; `steady` is x and width of the steady part and `mean` the
    height of the mean over it, where they are known.
    """

    title: str
    summary: str
    axis: str
    first: str
    last: str
    top: str
    bottom: str
    band: str
    line: str
    steady: tuple[float, float] | None
    mean: float | None


def charts(folder: Path, record: RunRecord) -> list[Chart]:
    """The charts of the series of a folder; none where it has no series."""
    path = next((folder / name for name in FILES if is_file(folder / name)), None)
    if path is None:
        return []
    try:
        table = read_table(path)
    except (InputError, OSError):
        return []
    place = table.iloc[:, 0].to_numpy(float)
    shown = [name for name in table.columns[1:] if not _is_aside(str(name))]
    return [
        _chart(str(table.columns[0]), place, str(name), table[name].to_numpy(float), record)
        for name in shown[:MOST]
    ]


def _is_aside(name: str) -> bool:
    """Whether a column is the time again, or an error of another."""
    return name.startswith("time ") or "standard error" in name


def _chart(axis: str, place: np.ndarray, name: str, values: np.ndarray, record: RunRecord) -> Chart:
    low, high = _limits(values)
    word, unit = _parts(name)
    found = record.quantities.get(word)
    title = words(word) + (f" ({unit})" if unit != "1" else "")
    answer = f", mean {with_error(found)}" if found is not None and found.unit == unit else ""
    blocks = _blocks(place, values)
    across, along = _parts(axis)
    return Chart(
        title,
        f"{title} against {words(across)}: from {low:.3g} to {high:.3g}{answer}.",
        words(across) + (f" ({along})" if along != "1" else ""),
        *_ends(float(place[0]), float(place[-1])),
        *_ends(high, low),
        *_paths(blocks, (float(place[0]), float(place[-1])), (low, high)),
        _steady(record, place) if across == "time" else None,
        _mean(found, unit, low, high),
    )


def _ends(one: float, other: float) -> tuple[str, str]:
    """Both ends of an axis as labels; what is nothing beside the other is 0."""
    least = 0.005 * max(abs(one), abs(other))
    first, last = (f"{end:.3g}" if abs(end) >= least else "0" for end in (one, other))
    return first, last


def _parts(name: str) -> tuple[str, str]:
    """The word and the unit of a column's name, as liftdrag or an engine has it."""
    word, _, unit = name.partition(" (")
    return _ENGINE.get(word, word.removeprefix("v_")), unit.rstrip(")") or "1"


def _limits(values: np.ndarray) -> tuple[float, float]:
    known = values[np.isfinite(values)]
    if not known.size:
        return 0.0, 1.0
    low, high = float(known.min()), float(known.max())
    return (low, high) if high > low else (low - 0.5, high + 0.5)


@dataclass(frozen=True)
class _Block:
    """The middle of some rows, and their least, greatest and mean value."""

    middle: float
    low: float
    high: float
    mean: float


def _blocks(place: np.ndarray, values: np.ndarray) -> list[_Block]:
    known = np.flatnonzero(np.isfinite(values) & np.isfinite(place))
    parts = np.array_split(known, min(BLOCKS, max(known.size, 1)))
    return [_block(place[part], values[part]) for part in parts if part.size]


def _block(place: np.ndarray, values: np.ndarray) -> _Block:
    return _Block(
        float(place.mean()), float(values.min()), float(values.max()), float(values.mean())
    )


def _paths(
    blocks: list[_Block], across: tuple[float, float], up: tuple[float, float]
) -> tuple[str, str]:
    """The band of the ranges and the line of the means, as paths."""
    span = (across[1] - across[0]) or 1.0
    x = [WIDTH * (block.middle - across[0]) / span for block in blocks]
    low, high, mean = (
        [(a, _up(getattr(block, name), up)) for a, block in zip(x, blocks, strict=True)]
        for name in ("low", "high", "mean")
    )
    return _path(high + low[::-1]) + "Z", _path(mean)


def _path(points: list[tuple[float, float]]) -> str:
    return "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in points)


def _up(value: float, limits: tuple[float, float]) -> float:
    """The height of a value in the drawing, whose zero is at the top."""
    return HEIGHT * (limits[1] - value) / (limits[1] - limits[0])


def _steady(record: RunRecord, place: np.ndarray) -> tuple[float, float] | None:
    window, span = record.steady_window, float(place[-1] - place[0])
    if window is None or span <= 0.0:
        return None
    start, end = (WIDTH * (t - float(place[0])) / span for t in (window.start_s, window.end_s))
    return round(max(start, 0.0), 1), round(min(end, WIDTH) - max(start, 0.0), 1)


def _mean(found: Quantity | None, unit: str, low: float, high: float) -> float | None:
    if found is None or found.unit != unit or not isfinite(found.mean):
        return None
    return round(_up(found.mean, (low, high)), 1) if low <= found.mean <= high else None
