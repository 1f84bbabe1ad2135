"""From the series of an ensemble of packings to drag, lift and pressures."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import sqrt

import numpy as np

from liftdrag.analysis.mixing import irregularity
from liftdrag.analysis.quantity import Quantity
from liftdrag.scene import Drag2DScene
from liftdrag.series import Series

CONVERGED = 5
"""Packings from which on their scatter gives an error that is more than a guess."""

SOFT = 0.1
"""Overlap over the smaller radius above which grains are soft."""

NEIGHBOURS = 2.5
"""Distance in grain diameters within which grains are neighbours, for the irregularity."""

WALLS = ("left", "right", "bottom", "top")


@dataclass(frozen=True)
class Packing:
    """What one packing gave: its series, and the grains' centres (n, 2) before and after, m."""

    series: Series
    before: np.ndarray
    after: np.ndarray


@dataclass(frozen=True)
class EnsembleAnswers:
    """The quantities, the mean series with the errors of its drag (n,) in N, and warnings.

    `values` are the means of each packing (runs,) by name, in the units of the quantities.
    """

    quantities: dict[str, Quantity]
    series: Series
    drag_error: np.ndarray
    values: dict[str, np.ndarray]
    warnings: tuple[str, ...]


def answers(scene: Drag2DScene, packings: Sequence[Packing]) -> EnsembleAnswers:
    """Means over the packings, each with the standard error of its scatter between them."""
    each = [dict(_values(scene, packing)) for packing in packings]
    values = {name: np.array([found[name][0] for found in each]) for name in each[0]}
    units = {name: unit for name, (_, unit) in each[0].items()}
    quantities = {name: ensemble_mean(values[name], units[name]) for name in values}
    quantities |= dict(_scatter(values["drag"]))
    series, error = _mean_series([packing.series for packing in packings])
    return EnsembleAnswers(quantities, series, error, values, tuple(_warnings(values)))


def displacement(scene: Drag2DScene, series: Series) -> np.ndarray:
    """How far (n,) the cylinder has come at each time, m."""
    return np.asarray(series.time * scene.drive.speed)


def ensemble_mean(values: np.ndarray, unit: str) -> Quantity:
    """Mean of independent `values` (n,), n > 1, with the standard error of the mean."""
    count = len(values)
    error = float(values.std(ddof=1)) / sqrt(count)
    return Quantity(float(values.mean()), error, unit, None, count, count >= CONVERGED)


def _scatter(drag: np.ndarray) -> Iterator[tuple[str, Quantity]]:
    """The standard deviation between packings, its error that of a normal sample."""
    count, deviation = len(drag), float(drag.std(ddof=1))
    error = deviation / sqrt(2.0 * (count - 1))
    yield "drag_deviation", Quantity(deviation, error, "N", None, count, count >= CONVERGED)


def _values(scene: Drag2DScene, packing: Packing) -> Iterator[tuple[str, tuple[float, str]]]:
    """Each quantity of one packing and its unit."""
    series = packing.series
    window = displacement(scene, series) > scene.drive.average_from
    for name in ("drag", "lift"):
        yield name, (float(series[name][window].mean()), "N")
    yield "drag_fluctuation", (float(series["drag"][window].std()), "N")
    area = _wall_areas(scene)
    yield "rest_pressure", (float(np.mean([series[w][0] / area[w] for w in WALLS])), "Pa")
    for wall in WALLS:
        yield f"pressure_{wall}", (float(series[wall][window].mean()) / area[wall], "Pa")
    diameter = scene.grains.diameter
    irregular = irregularity(packing.before, packing.after, NEIGHBOURS * diameter)
    yield "irregularity", (irregular / diameter, "1")
    if "overlap" in series.channels:
        yield "overlap_ratio", (float(series["overlap"].max()), "1")


def _wall_areas(scene: Drag2DScene) -> dict[str, float]:
    side, end = scene.height * scene.box.thickness, scene.box.width * scene.box.thickness
    return dict(zip(WALLS, (side, side, end, end), strict=True))


def _mean_series(all_series: Sequence[Series]) -> tuple[Series, np.ndarray]:
    """The mean over the packings at each time, and the standard error of its drag."""
    first, count = all_series[0], len(all_series)
    means = {
        name: np.mean([series[name] for series in all_series], axis=0) for name in first.channels
    }
    scatter = np.std([series["drag"] for series in all_series], axis=0, ddof=1)
    return Series(first.time, means, first.units), np.asarray(scatter / sqrt(count))


def _warnings(values: Mapping[str, np.ndarray]) -> Iterator[str]:
    count = len(values["drag"])
    if count < CONVERGED:
        yield (
            f"NOT CONVERGED: {count} packings are too few for an error that is more than a guess; "
            f"set ensemble.runs to {CONVERGED} or more."
        )
    deepest = values["overlap_ratio"].max() if "overlap_ratio" in values else 0.0
    if deepest > SOFT:
        yield (
            f"Soft grains: the deepest overlap is {deepest:.2g} of the smaller radius, above "
            f"{SOFT}; a larger grains.youngs_modulus lowers it, and raises the forces."
        )
