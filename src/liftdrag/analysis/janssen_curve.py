"""The points of a Janssen curve: what piston and tube carry at each fill."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from liftdrag.analysis.correlated import drift, mean_of, ratio_of_means
from liftdrag.analysis.janssen_fit import Curve
from liftdrag.analysis.quantity import Quantity
from liftdrag.errors import InputError
from liftdrag.granular import GRAVITY
from liftdrag.scene import JanssenScene
from liftdrag.series import Series

if TYPE_CHECKING:
    import pandas as pd

SLACK = 1e-9
"""Relative round-off of a time."""


@dataclass(frozen=True)
class FillWindow:
    """One fill: `count` grains, averaged over the samples with begin < time <= end (s)."""

    count: int
    begin: float
    end: float

    def holds(self, time: np.ndarray) -> np.ndarray:
        """Which of the times (n,) belong to the fill."""
        slack = SLACK * abs(self.end)
        return np.asarray((time > self.begin + slack) & (time <= self.end + slack))


@dataclass(frozen=True)
class CurvePoint:
    """One fill of `mass` (kg): what the piston and the tube carry over g, in kg.

    `weight_balance` is the sum of both over the weight of grains and lid; `mobilised_friction`
    the tube's force over mu_w times its normal force, positive in the sense of the motion, None
    where there is neither. `drift` is that of the piston's force, in its errors.
    """

    mass: float
    apparent_mass: Quantity
    tube_mass: Quantity
    weight_balance: Quantity
    mobilised_friction: Quantity | None
    drift: float


def sense(scene: JanssenScene) -> float:
    """1 where the wall carries grains, -1 where a rising piston makes it push them down."""
    return -1.0 if scene.drive.motion == "piston up" else 1.0


def curve_points(
    scene: JanssenScene, series: Series, fills: Sequence[FillWindow]
) -> tuple[CurvePoint, ...]:
    """A point for each fill. Raises InputError for one that the series does not reach."""
    return tuple(_point(scene, series, fill) for fill in fills)


def _point(scene: JanssenScene, series: Series, fill: FillWindow) -> CurvePoint:
    inside = fill.holds(series.time)
    count = int(inside.sum())
    if count < 2:
        raise InputError(
            f"The series has {count} samples of the fill of {fill.count} grains; "
            "run the case again."
        )
    mass, interval = fill.count * scene.grains.mass, (fill.end - fill.begin) / count
    weight = (mass + scene.lid_mass) * GRAVITY
    piston, tube = series["piston"][inside], series["tube"][inside]
    normal = scene.tube.friction * series["wall_normal"][inside]
    return CurvePoint(
        mass,
        mean_of(piston / GRAVITY, interval, "kg"),
        mean_of(tube / GRAVITY, interval, "kg"),
        mean_of((piston + tube) / weight, interval, "1"),
        ratio_of_means(sense(scene) * tube, normal, interval),
        drift(piston),
    )


def fitted_curve(scene: JanssenScene, points: Sequence[CurvePoint]) -> Curve:
    """The points as the fits take them."""
    return Curve(
        np.array([point.mass for point in points]),
        np.array([point.apparent_mass.mean for point in points]),
        np.array([point.apparent_mass.standard_error for point in points]),
        scene.lid_mass,
        sense(scene),
    )


def curve_table(points: Sequence[CurvePoint], forms: Mapping[str, np.ndarray]) -> pd.DataFrame:
    """A row for each fill, units in the names of the columns; `forms` are fitted masses (n,)."""
    import pandas as pd

    table: dict[str, object] = {"mass (kg)": [point.mass for point in points]}
    for name in ("apparent_mass", "tube_mass", "weight_balance", "mobilised_friction"):
        table |= dict(_columns(name, [getattr(point, name) for point in points]))
    loads = [point.apparent_mass for point in points]
    table["correlation time (s)"] = [load.correlation_time for load in loads]
    table["n independent (1)"] = [load.n_independent for load in loads]
    table["converged"] = [load.converged for load in loads]
    table |= {f"{name} (kg)": values for name, values in forms.items()}
    return pd.DataFrame(table)


def _columns(
    name: str, found: Sequence[Quantity | None]
) -> Iterator[tuple[str, list[float | None]]]:
    unit = next((quantity.unit for quantity in found if quantity), "1")
    words = name.replace("_", " ")
    yield f"{words} ({unit})", [quantity.mean if quantity else None for quantity in found]
    yield (
        f"{words} standard error ({unit})",
        [quantity.standard_error if quantity else None for quantity in found],
    )
