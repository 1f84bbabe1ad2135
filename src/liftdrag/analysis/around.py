"""What fields and the stress around the cylinder say in single numbers, from a run's snapshots."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from liftdrag.analysis.blocks import BLOCKS, BlockSums
from liftdrag.analysis.correlated import mean_of
from liftdrag.analysis.fields import Fields, Grid, loop_force, moments
from liftdrag.analysis.quantity import Quantity, ratio
from liftdrag.analysis.ring import Ring, predicted_lift, ring_forces
from liftdrag.scene import TankScene
from liftdrag.snapshot import ForceSnapshot

FEWEST = 8
"""Snapshots without which there are no fields."""

APART = 3.0
"""Errors between the snapshots' force and that of the series above which a warning says so."""

SURE = 3.0
"""Errors that the lift must exceed for its tangential share to be worth a number."""

FORCES = ("drag", "lift")


@dataclass(frozen=True)
class Around:
    """Fields and the stress around the cylinder, and the `forces` (n, 2) of each snapshot in N."""

    fields: Fields
    ring: Ring
    forces: np.ndarray
    interval: float

    @property
    def snapshots(self) -> dict[str, Quantity]:
        """Drag and lift in the mean of the snapshots alone."""
        return {
            f"snapshot_{name}": mean_of(self.forces[:, k], self.interval, "N")
            for k, name in enumerate(FORCES)
        }


def around(
    scene: TankScene, snapshots: Iterable[ForceSnapshot], start: float, end: float
) -> Around | None:
    """From the snapshots between two times (s); None where they are too few, or no [fields]."""
    if scene.fields is None:
        return None
    d = scene.grains.diameter
    grid = Grid.of(scene, scene.fields.window or d, scene.fields.spacing or d)
    cells, ring, times, forces = BlockSums(start, end), BlockSums(start, end), [], []
    for snapshot in snapshots:
        if start <= snapshot.time <= end:
            cells.add(snapshot.time, moments(scene, grid, snapshot))
            shares = ring_forces(scene, snapshot)
            ring.add(snapshot.time, shares)
            times.append(snapshot.time)
            forces.append(shares.sum(axis=0))
    if len(times) < FEWEST:
        return None
    interval = (times[-1] - times[0]) / (len(times) - 1)
    found = Ring.of(scene, ring.blocks())
    return Around(Fields(grid, cells.blocks()), found, np.array(forces), interval)


def quantities(scene: TankScene, found: Around, confining: Quantity) -> dict[str, Quantity]:
    """The single numbers; `confining` is the pressure (Pa) far away at the axis' height.

    An error from blocks has one degree of freedom less than there are blocks.
    """
    answers = found.snapshots
    shares = _from_blocks(FORCES, found.ring.tangential_shares(), found, "1")
    lift = answers["snapshot_lift"]
    for name, share in shares.items():
        if name == "drag" or abs(lift.mean) > SURE * lift.standard_error:
            answers[f"tangential_{name}_share"] = share
    if (reach := _reach(scene, found.fields.grid)) is not None:
        loop = found.fields.blocks.estimate(
            lambda mean: loop_force(scene, found.fields.grid, mean, reach)
        )
        answers |= _from_blocks(("loop_drag", "loop_lift"), loop, found, "N")
    peak = _from_blocks(("peak",), found.ring.peak(), found, "Pa")["peak"]
    answers["front_pressure_ratio"] = ratio(peak, 1.0, [confining], "1")
    if scene.lid is not None and not scene.lid.bulk_gravity:
        sums = found.ring.blocks.estimate(lambda forces: _eq_4(found.ring, forces))
        lifted = _from_blocks(("lift",), sums, found, "Pa")["lift"]
        answers["predicted_lift_coefficient"] = ratio(lifted, 1.0, [confining], "1")
    return answers


def _eq_4(ring: Ring, forces: np.ndarray) -> np.ndarray:
    """The predicted lift over the buoyancy, times the confining pressure, (1,) in Pa."""
    return np.array([predicted_lift(ring.normal_of(forces), 1.0)])


def _reach(scene: TankScene, grid: Grid) -> float | None:
    """How far from the axis (m) momentum is balanced: no window there sees the cylinder.

    None where one would see the bottom layer, which is driven.
    """
    reach = scene.intruder.diameter / 2.0 + 2.0 * grid.radius
    lowest = scene.axis_height - reach - float(grid.step[2])
    return reach if lowest > scene.grains.diameter + grid.radius else None


def _from_blocks(
    names: tuple[str, ...], found: tuple[np.ndarray, np.ndarray], of: Around, unit: str
) -> dict[str, Quantity]:
    """Values (n,) and errors (n,) from blocks, by their names."""
    number = len(of.ring.blocks.counts)
    values = (np.atleast_1d(part) for part in found)
    return {
        name: Quantity(float(value), float(error), unit, None, float(number), number == BLOCKS)
        for name, value, error in zip(names, *values, strict=True)
    }


def apart(found: Around, known: Mapping[str, Quantity]) -> dict[str, float | None]:
    """By how many errors of their own the snapshots' means miss those of the whole series.

    `known` has the drag and the lift of the series; None where the snapshots do not scatter.
    """
    pairs = zip(FORCES, found.snapshots.values(), strict=True)
    return {
        name: (one.mean - known[name].mean) / one.standard_error if one.standard_error else None
        for name, one in pairs
    }


def warnings(found: Around, known: Mapping[str, Quantity]) -> Iterator[str]:
    """A sentence for each force that the snapshots miss by more than chance.

    `known` has the drag and the lift of the whole series.
    """
    for name, snapshot in zip(FORCES, found.snapshots.values(), strict=True):
        apart = snapshot.mean - known[name].mean
        if abs(apart) > APART * snapshot.standard_error:
            yield (
                f"The snapshots' mean {name} is {apart:+.2g} N off that of the whole series, more "
                f"than {APART:g} of its errors: take more of them (fields.snapshots)."
            )
