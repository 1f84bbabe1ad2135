"""How the grains of a sheared cell lie and stack, look by look."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from liftdrag.analysis.alignment import order_parameter
from liftdrag.analysis.stacking import REACH, SlidingCell, Stacks, stacks
from liftdrag.scene import ShearScene
from liftdrag.series import Series
from liftdrag.snapshot import Snapshot


def structure_series(scene: ShearScene, moments: Iterable[Snapshot]) -> Series:
    """Order parameter, stack size and stacking fraction at each moment.

    Of all grains, the order parameter being the mean of those of the species by their numbers,
    and of each species by number, where there are several.
    """
    rows = [(moment.time, _looked_at(scene, moment)) for moment in moments]
    names = list(rows[0][1]) if rows else []
    channels = {name: np.array([row[name] for _, row in rows]) for name in names}
    return Series(np.array([time for time, _ in rows]), channels, dict.fromkeys(names, "1"))


def cell_at(scene: ShearScene, time: float) -> SlidingCell:
    """The cell after a time (s) of shear."""
    length, height, _ = scene.sides
    return SlidingCell(np.array(scene.sides), scene.drive.shear_rate * time * height % length)


def _looked_at(scene: ShearScene, moment: Snapshot) -> dict[str, float]:
    assert moment.axis is not None
    cell = cell_at(scene, moment.time)
    orders, found = list[float](), list[Stacks]()
    for number, species in enumerate(scene.species, start=1):
        own = moment.kind == number
        axes = moment.axis[own]
        diameter, length = species.sides(scene.grains.diameter)
        reach = REACH["rod"] * diameter if species.is_rod else REACH["disk"] * length
        orders.append(order_parameter(axes))
        found.append(stacks(moment.position[own], axes, cell, reach))
    row = {"strain": scene.drive.shear_rate * moment.time} | _of_all(scene, orders, found)
    if len(orders) > 1:
        for number, (order, made) in enumerate(zip(orders, found, strict=True), start=1):
            row[f"order_parameter_{number}"] = order
            row[f"stack_size_{number}"] = made.mean_size
            row[f"stacking_fraction_{number}"] = made.fraction
    return row


def _of_all(scene: ShearScene, orders: list[float], found: list[Stacks]) -> dict[str, float]:
    whole = Stacks(np.concatenate([made.sizes for made in found]), scene.grain_count)
    return {
        "order_parameter": float(np.average(orders, weights=scene.counts)),
        "stack_size": whole.mean_size,
        "stacking_fraction": whole.fraction,
    }
