"""What the runs of a bench say: of each point the answers, their errors and deviations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import hypot

import numpy as np

from liftdrag.analysis.biases import Bias
from liftdrag.analysis.precision import (
    Deviation,
    deviation,
    front,
    hidden_scatter,
    paired_deviation,
    pooled,
)
from liftdrag.analysis.quantity import Quantity
from liftdrag.bench.axes import Axis
from liftdrag.bench.points import REFERENCE
from liftdrag.bench.runs import Run
from liftdrag.scene import JanssenScene, Scene, ShearScene, TankScene

Key = tuple[str, str]
"""Axis and name of a point."""

CASE: Key = (REFERENCE, "")

ALIKE = 2.0
"""Ratio of two answers within which their scatter from run to run is comparable."""

FEWEST_PAIRS = 4
"""Packings that began alike from which their differences give an error."""

FORCE, LIFT = 0.05, 0.2
"""Relative errors that a bench tolerates, of a force or a stress and of a lift."""


def tolerances(scene: Scene) -> dict[str, float]:
    """What is judged of a scene, and the relative error that is tolerated of each."""
    if isinstance(scene, TankScene):
        return {"drag_coefficient": FORCE, "lift_coefficient": LIFT}
    if isinstance(scene, JanssenScene):
        curve = {"saturation_mass": FORCE} if len(scene.counts) > 1 else {}
        return {"apparent_mass": FORCE} | curve
    if isinstance(scene, ShearScene):
        return {"shear_stress": FORCE, "pressure": FORCE}
    return {"drag": FORCE}


@dataclass(frozen=True)
class Judged:
    """One point and quantity: the mean over the runs, and its deviation from the reference.

    `paired` when the deviation is that of packings which began alike.
    """

    answer: Quantity
    deviation: Deviation
    runs: int
    reference: float
    paired: bool = False

    @property
    def error(self) -> float:
        """Standard error over the reference's mean."""
        return abs(self.answer.standard_error / self.reference)

    @property
    def total_error(self) -> float:
        """Standard error and what is seen of a bias, over the reference's mean."""
        return hypot(self.error, self.deviation.bias)


@dataclass(frozen=True)
class Cost:
    """What a point took: processor time (s) over all its runs, and its runs that finished."""

    cpu_s: float
    runs: int

    @property
    def each_s(self) -> float:
        """Processor time of a run."""
        return self.cpu_s / self.runs


def finished(runs: Sequence[Run]) -> dict[Key, list[Run]]:
    """The runs that have answers, by point."""
    found: dict[Key, list[Run]] = {}
    for one in runs:
        if one.answers is not None:
            found.setdefault(one.key, []).append(one)
    return found


def costs(runs: Sequence[Run]) -> dict[Key, Cost]:
    """What each point took."""
    return {
        key: Cost(sum(one.cpu_s for one in group), len(group))
        for key, group in finished(runs).items()
    }


def judge(runs: Sequence[Run], quantity: str) -> dict[Key, Judged]:
    """What the points say of a quantity, the reference among them; none without it.

    The scatter from run to run that their own errors do not show is taken as the same share of
    the mean everywhere, that of all points with answers like the reference's.
    """
    runs_of = finished(runs)
    if CASE not in runs_of:
        return {}
    groups = {key: _answers(group, quantity) for key, group in runs_of.items()}
    means = {key: pooled(group, 0.0).mean for key, group in groups.items()}
    ratios = {key: mean / means[CASE] for key, mean in means.items()}
    alike = [groups[key] for key, ratio in ratios.items() if 1.0 / ALIKE < ratio < ALIKE]
    hidden = hidden_scatter(alike)
    found = {key: pooled(group, hidden * abs(ratios[key])) for key, group in groups.items()}
    own = found[CASE]
    return {
        key: _judged(runs_of[key], runs_of[CASE], quantity, answer, own)
        for key, answer in found.items()
    }


def _judged(
    mine: Sequence[Run], case: Sequence[Run], quantity: str, answer: Quantity, own: Quantity
) -> Judged:
    if answer is own:
        return Judged(answer, Deviation(0.0, 0.0), len(mine), own.mean)
    pairs = _pairs(mine, case, quantity)
    if len(pairs) < FEWEST_PAIRS:
        return Judged(answer, deviation(answer, own), len(mine), own.mean)
    return Judged(answer, paired_deviation(*pairs.T), len(mine), own.mean, True)


def _pairs(mine: Sequence[Run], case: Sequence[Run], quantity: str) -> np.ndarray:
    """The answers (n, 2) of packings that began alike, of a point and of the case."""
    known = {one.replica: one.each.get(quantity, ()) for one in case}
    pairs = [
        pair
        for one in mine
        for pair in zip(one.each.get(quantity, ()), known.get(one.replica, ()), strict=False)
    ]
    return np.array(pairs).reshape(-1, 2)


def _answers(runs: Sequence[Run], quantity: str) -> list[Quantity]:
    return [one.answers[quantity] for one in runs if one.answers is not None]


def best(runs: Sequence[Run], quantity: str) -> list[Key]:
    """The points that no other beats in both processor time and total error, the cheapest first."""
    judged, spent = judge(runs, quantity), costs(runs)
    keys = list(judged)
    chosen = front([spent[key].cpu_s for key in keys], [judged[key].total_error for key in keys])
    return [keys[k] for k in chosen]


def biases(
    runs: Sequence[Run], axes: Sequence[Axis], quantities: Sequence[str]
) -> dict[str, dict[str, Bias]]:
    """By quantity and axis: the case against the most careful value that was measured."""
    return {quantity: dict(_biases(judge(runs, quantity), axes)) for quantity in quantities}


def _biases(found: Mapping[Key, Judged], axes: Sequence[Axis]) -> list[tuple[str, Bias]]:
    pairs = [(axis.name, _bias(found, axis)) for axis in axes]
    return [(name, bias) for name, bias in pairs if bias is not None]


def _bias(found: Mapping[Key, Judged], axis: Axis) -> Bias | None:
    own = axis.own
    if not axis.careful or isinstance(own, str):
        return None
    sign = 1.0 if axis.careful == "most" else -1.0
    measured = {
        setting.at: found[axis.name, setting.name]
        for setting in axis.settings
        if (axis.name, setting.name) in found and not isinstance(setting.at, str)
    }
    careful = max(measured, key=lambda at: sign * at, default=own)
    if sign * careful <= sign * own:
        return None
    size = measured[careful].deviation.reversed
    return Bias(size.relative, size.standard_error, own, careful)
