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

    Of all grains that have an axis, the order parameter being the mean of those of the species by
    their numbers, and of each of these by number, where there are several.
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
    orders, found = dict[int, float](), dict[int, Stacks]()
    for number, species in enumerate(scene.species, start=1):
        if species.is_sphere:
            continue
        own = moment.kind == number
        axes = moment.axis[own]
        diameter, length = species.sides(scene.grains.diameter)
        reach = REACH["rod"] * diameter if species.is_rod else REACH["disk"] * length
        orders[number] = order_parameter(axes)
        found[number] = stacks(moment.position[own], axes, cell, reach)
    row = {"strain": scene.drive.shear_rate * moment.time} | _of_all(scene, orders, found)
    if len(scene.species) > 1:
        for number, made in found.items():
            row[f"order_parameter_{number}"] = orders[number]
            row[f"stack_size_{number}"] = made.mean_size
            row[f"stacking_fraction_{number}"] = made.fraction
    return row


def _of_all(
    scene: ShearScene, orders: dict[int, float], found: dict[int, Stacks]
) -> dict[str, float]:
    if not orders:
        return {}
    counts = [scene.counts[number - 1] for number in orders]
    sizes = np.concatenate([made.sizes for made in found.values()])
    whole = Stacks(sizes, sum(counts))
    return {
        "order_parameter": float(np.average(list(orders.values()), weights=counts)),
        "stack_size": whole.mean_size,
        "stacking_fraction": whole.fraction,
    }
