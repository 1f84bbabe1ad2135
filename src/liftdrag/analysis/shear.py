"""The answers of a shear flow: stresses over rho d_v^2 rate^2, alignment, stacks and energies."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from liftdrag import liu
from liftdrag.analysis.compared import Compared, beside_theory, compared
from liftdrag.analysis.correlated import mean_of, ratio_of_means
from liftdrag.analysis.errorbars import MINIMUM_CORRELATION_TIMES
from liftdrag.analysis.quantity import Quantity, shortcomings
from liftdrag.analysis.steady import SteadyWindow, common_window, steady_window
from liftdrag.analysis.structure import structure_series
from liftdrag.deck.shear import COMPONENTS, PARTS
from liftdrag.errors import InputError, SeriesTooShort
from liftdrag.scene import ShearScene
from liftdrag.series import Series
from liftdrag.snapshot import Snapshot

STRESSES = ("shear_stress", "pressure")
"""What must be steady."""


@dataclass(frozen=True)
class ShearAnswers:
    """The quantities by name, what they were averaged from and over, and warnings.

    `series` are the stresses and energies of each row, `structure` what each look at the grains
    says; `tensor` is the mean of each component of each part, and `comparison` what the paper's
    curve gives, or kinetic theory for spheres.
    """

    quantities: dict[str, Quantity]
    series: Series
    structure: Series
    window: SteadyWindow
    tensor: dict[str, Quantity]
    comparison: dict[str, Compared]
    warnings: tuple[str, ...]


def answers(scene: ShearScene, sampled: Series, moments: Iterable[Snapshot]) -> ShearAnswers:
    """The averages of a sheared cell's steady window.

    `sampled` has the CHANNELS of the deck. Raises InputError when it ends before the strain from
    which on is averaged.
    """
    series = normalised(scene, sampled)
    window = _window(scene, series)
    steady = series.part(window.start, window.stop)
    structure = structure_series(scene, moments)
    kept = (structure.time >= steady.time[0]) & (structure.time <= steady.time[-1] * (1.0 + 1e-9))
    first, last = int(np.argmax(kept)), int(kept.sum())
    looked = structure.part(first, first + last)
    if len(looked) < 2:
        raise InputError("The axes of the grains were not recorded; run the case again.")
    quantities = stresses(steady) | _energies(scene, steady)
    quantities |= {name: _mean(looked, name) for name in looked.channels if name != "strain"}
    tensor = {name: _mean(_over(sampled, scene.stress_scale, window), name) for name in _names()}
    beside, source = _beside(scene, quantities)
    quantities |= {f"{name}_over_{source}": one.ratio for name, one in beside.items()}
    return ShearAnswers(
        quantities,
        series,
        structure,
        window,
        tensor,
        beside,
        tuple(_warnings(quantities, window)),
    )


def _beside(scene: ShearScene, found: dict[str, Quantity]) -> tuple[dict[str, Compared], str]:
    """What is known of cylinders, or of spheres, and by whom; nothing of both together."""
    spheres = {one.is_sphere for one in scene.species}
    if spheres == {False}:
        return compared(scene.solid_fraction, found), "liu"
    if spheres == {True}:
        return beside_theory(scene.solid_fraction, scene.grains.restitution, found), "theory"
    return {}, ""


def early_answers(scene: ShearScene, sampled: Series) -> dict[str, Quantity]:
    """The stresses of a run so far. Raises InputError as `answers` does."""
    series = normalised(scene, sampled)
    window = _window(scene, series)
    return stresses(series.part(window.start, window.stop))


def normalised(scene: ShearScene, sampled: Series) -> Series:
    """Strain, shear stress and pressure with their kinetic parts, energies of a grain, overlap.

    The shear stress is positive where the layer above drags the one below along.
    """
    stress = {
        part: {name: sampled[f"{part}_{name}"] / scene.stress_scale for name in COMPONENTS}
        for part in PARTS
    }
    kinetic, contact = stress["kinetic"], stress["contact"]
    pressures = {part: (one["xx"] + one["yy"] + one["zz"]) / 3.0 for part, one in stress.items()}
    energy = scene.grain_count * scene.mass * (scene.grains.diameter * scene.drive.shear_rate) ** 2
    channels = {
        "strain": sampled.time * scene.drive.shear_rate,
        "shear_stress": -kinetic["xy"] - contact["xy"],
        "pressure": pressures["kinetic"] + pressures["contact"],
        "kinetic_shear_stress": -kinetic["xy"],
        "kinetic_pressure": pressures["kinetic"],
        "normal_difference": kinetic["xx"] + contact["xx"] - kinetic["yy"] - contact["yy"],
        "fluctuation_energy": sampled["fluctuation"] / energy,
        "rotational_energy": sampled["rotation"] / energy,
        "elastic_energy": sampled["elastic"] / energy,
        "overlap_ratio": sampled["overlap"],
    }
    return Series(sampled.time, channels, dict.fromkeys(channels, "1"))


def stresses(steady: Series) -> dict[str, Quantity]:
    """Shear stress, pressure and their ratio, of the steady rows."""
    shear, pressure = steady["shear_stress"], steady["pressure"]
    found = {name: _mean(steady, name) for name in STRESSES}
    friction = ratio_of_means(shear, pressure, steady.interval)
    if friction is None:
        raise InputError("No grain touches another; shear the cell further, or fill it more.")
    return found | {"bulk_friction": friction}


def _energies(scene: ShearScene, steady: Series) -> dict[str, Quantity]:
    """Kinetic share of the stress, normal stress difference, and energies of a grain.

    Nothing turns a sphere without friction.
    """
    names = ("fluctuation_energy", "rotational_energy")[: 1 if scene.is_of_spheres else 2]
    found = {name: _mean(steady, name) for name in names}
    for name, channel in (("kinetic_share", "kinetic_pressure"), ("normal_difference",) * 2):
        share = ratio_of_means(steady[channel], steady["pressure"], steady.interval)
        assert share is not None
        found[name] = share
    return found


def _mean(series: Series, name: str) -> Quantity:
    return mean_of(series[name], series.interval, series.units[name])


def _names() -> list[str]:
    return [f"{part}_{name}" for part in PARTS for name in COMPONENTS]


def _over(sampled: Series, scale: float, window: SteadyWindow) -> Series:
    """The components of the steady rows over a stress (Pa)."""
    channels = {name: sampled[name] / scale for name in _names()}
    whole = Series(sampled.time, channels, dict.fromkeys(channels, "1"))
    return whole.part(window.start, window.stop)


def _window(scene: ShearScene, series: Series) -> SteadyWindow:
    start = int(np.searchsorted(series["strain"], scene.drive.average_from * (1.0 - 1e-9)))
    if len(series) - start < 2:
        raise InputError(
            f"The series ends at a strain of {series['strain'][-1]:.4g}, before what is averaged "
            "begins; run the case again."
        )
    try:
        return common_window([steady_window(series[name], start) for name in STRESSES])
    except SeriesTooShort:
        return SteadyWindow(start, len(series), float("nan"), False)


def _warnings(found: dict[str, Quantity], window: SteadyWindow) -> Iterator[str]:
    yield from shortcomings({name: found[name] for name in STRESSES}, window)
    axes = [name for name in ("order_parameter", "stack_size") if name in found]
    slow = [name for name in axes if not found[name].converged]
    if slow:
        yield (
            f"The grains turn slowly: few correlation times, under {MINIMUM_CORRELATION_TIMES}, of "
            f"{' and '.join(slow)}, of which the error is a guess; the stresses follow, and their "
            "errors may be half of what seeds scatter by: take --replicas, or a longer strain."
        )
    order = found["order_parameter"].mean if "pressure_over_liu" in found else liu.ALIGNED
    if order < liu.ALIGNED:
        yield (
            f"The order parameter, {order:.2f}, is below {liu.ALIGNED}, where the paper's own "
            "flows scatter about its curve."
        )
