"""What must hold in every run whatever its answer: overlap, agitation, and what is conserved.

**Momentum of a tank.** What the driven layers and the cylinder do to the free grains, and their
weight, is the rate at which their momentum changes, between the first and the last snapshot:
horizontally the force on the layers and the drag, vertically the force on the bottom layer, the
lift and the weight. The forces are sampled twice in the shortest contact, so their sums are right
to 1 % of the layers' force and of the weight; where a case samples once in many contacts, the
samples are independent, and the error is their scatter/sqrt(rows).

**Energy in the plane.** What the cylinder gives to the bed is more than what the bed then holds:
grains only lose it. Springs along the contact are not counted among what it holds, which makes the
test milder. Velocity Verlet keeps the energy of a spring to (omega dt)^2/4 of it, the bound.

**Weight of a column.** Piston and tube carry it.

**Momentum and energy of a sheared cell.** Contacts change no momentum, and leaving through a side
none against the mean flow: what is left of it is rounding. The work of the shear, the shear stress
times the rate and the volume, is more than the energy that the grains then hold.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from math import isfinite, sqrt
from typing import Any

import numpy as np

from liftdrag import granular
from liftdrag.analysis.overlaps import deepest_in_tank
from liftdrag.analysis.quantity import Quantity
from liftdrag.deck.tank import FLOOR_FORCES
from liftdrag.errors import RunFailed
from liftdrag.granular import GRAVITY
from liftdrag.numerics import derive
from liftdrag.numerics.bounds import Bounds, bounds_of
from liftdrag.packing import square_layer
from liftdrag.scene import Drag2DScene, JanssenScene, ShearScene, TankScene
from liftdrag.series import Series
from liftdrag.snapshot import Snapshot

ROUNDING = 1e-6
"""Momentum against the mean flow over that of all grains at the speed that they scatter with."""

ERRORS = 4.0
"""Standard errors within which a mean is what it must be."""

OUT_OF_BALANCE = 0.01
"""Share of the force that a balance of forces may be off by."""

OVERLAP = "largest_overlap"
"""The invariant whose violation ends a run as `overlap_exceeded`."""


@dataclass(frozen=True)
class Invariant:
    """A `value` in `unit` that a sound run keeps within +- `bound`."""

    value: float
    bound: float
    unit: str

    @property
    def holds(self) -> bool:
        """Whether it is within its bound; what is not a number is not."""
        return isfinite(self.value) and abs(self.value) <= self.bound

    def to_dict(self) -> dict[str, Any]:
        """As `result.json` holds it."""
        return asdict(self) | {"holds": self.holds}


def watched(result: Mapping[str, Any], found: Mapping[str, Invariant]) -> dict[str, Any]:
    """The record with its invariants, warned about where they do not hold.

    Its status becomes `overlap_exceeded` where the largest overlap does not.
    """
    status = result["status"]
    if OVERLAP in found and not found[OVERLAP].holds:
        status = "overlap_exceeded"
    return {
        **result,
        "status": status,
        "invariants": {name: one.to_dict() for name, one in found.items()},
        "warnings": [*broken(found), *result["warnings"]],
    }


def check_sound(record: Mapping[str, Any]) -> None:
    """Raise RunFailed for a record that `watched` found to be of a run with too deep overlaps."""
    if record["status"] == "overlap_exceeded":
        deepest = record["invariants"][OVERLAP]
        raise RunFailed(
            "overlap_exceeded",
            f"overlap_exceeded: grains overlap by {deepest['value']:.2g} d, more than the "
            f"{deepest['bound']:.2g} d that load and impact explain; a smaller numerics.time_step "
            "or stiffer grains may help.",
        )


def broken(found: Mapping[str, Invariant]) -> Iterator[str]:
    """A sentence for each that does not hold."""
    for name, one in found.items():
        if not one.holds:
            unit = "" if one.unit == "1" else f" {one.unit}"
            yield (
                f"INVARIANT BROKEN: {name} is {one.value:.3g}{unit}, beyond {one.bound:.2g}{unit}; "
                "do not trust the run: try a smaller numerics.time_step."
            )


def tank_invariants(
    scene: TankScene, series: Series, snapshots: Iterable[Snapshot]
) -> dict[str, Invariant]:
    """Overlap, agitation and, where FLOOR_FORCES are known, momentum; none without a snapshot."""
    moments = list(snapshots)
    if not moments:
        return {}
    bounds, d = bounds_of(scene), scene.grains.diameter
    deepest = max(deepest_in_tank(scene, moment) for moment in moments) / d
    last = moments[-1]
    found = {
        OVERLAP: Invariant(deepest, bounds.overlap, "d"),
        "agitation": _agitation(last.velocity[last.kind == 1], bounds),
    }
    if series.channels.keys() >= FLOOR_FORCES.keys() and len(moments) > 1:
        found |= _momentum(scene, series, moments[0], last)
    return found


def _agitation(velocity: np.ndarray, bounds: Bounds) -> Invariant:
    scatter = velocity - velocity.mean(axis=0)
    return Invariant(sqrt(float((scatter**2).sum(axis=1).mean())), bounds.agitation, "m/s")


def _momentum(
    scene: TankScene, series: Series, first: Snapshot, last: Snapshot
) -> dict[str, Invariant]:
    inside = (series.time > first.time) & (series.time <= last.time * (1.0 + 1e-9))
    if inside.sum() < 2:
        return {}
    along = (series["floor_drag"] + series["drag"])[inside]
    upward = (series["floor_lift"] + series["lift"])[inside] + weight(scene)
    change = (_impulse(scene, last) - _impulse(scene, first)) / (last.time - first.time)
    push = float(np.abs(series["floor_drag"][inside]).mean())
    errors = [_sampling_error(scene, force) for force in (along, upward)]
    return {
        "horizontal_balance": _balance(along, change[0], push, errors[0]),
        "vertical_balance": _balance(upward, change[1], weight(scene), errors[1]),
    }


def _balance(force: np.ndarray, change: float, scale: float, error: float) -> Invariant:
    """Of what grains exert (n,), of how their momentum changes, of a force to compare with, N."""
    return Invariant(float(force.mean() + change), OUT_OF_BALANCE * scale + ERRORS * error, "N")


def _sampling_error(scene: TankScene, force: np.ndarray) -> float:
    """Standard error (N) of a force (n,) that is sampled less than once in a contact, else 0."""
    numerics = derive(scene)
    stride = numerics.sample_every.value * numerics.time_step.value
    if stride <= numerics.hertz_time.value:
        return 0.0
    return float(force.std(ddof=1)) / sqrt(len(force))


def weight(scene: TankScene) -> float:
    """Weight (N) of all that the bottom layer bears: grains, where they have any, and the lid."""
    bed = scene.grain_count * scene.grains.mass * scene.bulk_gravity
    return bed + _lid_mass(scene) * GRAVITY


def _lid_mass(scene: TankScene) -> float:
    if scene.lid is None:
        return 0.0
    d, box = scene.grains.diameter, scene.tank
    layer = len(square_layer(box.length / d, box.thickness / d, 0.0))
    return layer * scene.lid.density_ratio * granular.sphere_volume(d) * scene.grains.density


def _impulse(scene: TankScene, snapshot: Snapshot) -> np.ndarray:
    """Momentum (kg m/s) along x of the grains, and along z of the grains and the lid."""
    grains, lid = snapshot.velocity[snapshot.kind == 1], snapshot.velocity[snapshot.kind == 3]
    mass = scene.grains.mass
    own = mass * grains.sum(axis=0)
    heavy = (scene.lid.density_ratio if scene.lid else 1.0) * mass * lid[:, 2].sum()
    return np.array([own[0], own[2] + heavy])


def plane_invariants(
    scene: Drag2DScene, packings: Sequence[Series], deepest: float
) -> dict[str, Invariant]:
    """Overlap, `deepest` over the smaller radius; energies where the engine samples them."""
    found = {OVERLAP: Invariant(deepest / 2.0, bounds_of(scene).overlap, "d")}
    if all("elastic" in series.channels for series in packings):
        found["energy_created"] = max(
            (_energy(scene, series) for series in packings), key=lambda one: one.value / one.bound
        )
        speeds = [_speed_in_plane(scene, series) for series in packings]
        found["agitation"] = Invariant(max(speeds), bounds_of(scene).agitation, "m/s")
    return found


def _speed_in_plane(scene: Drag2DScene, series: Series) -> float:
    """Root mean square speed (m/s) of the grains while the drag is averaged."""
    window = series.time * scene.drive.speed > scene.drive.average_from
    mass = scene.grains.density * scene.grains.area * scene.box.thickness
    return sqrt(2.0 * float(series["kinetic"][window].mean()) / mass)


def _energy(scene: Drag2DScene, series: Series) -> Invariant:
    """The largest energy that the grains hold beyond what they had and were given, J."""
    bounds = bounds_of(scene)
    held = series["kinetic"] + series["elastic"]
    given = np.cumsum(series["drag"]) * scene.drive.speed * series.interval
    created = held - held[0] - (given - given[0])
    share = (bounds.own / bounds.expected) ** 2
    return Invariant(float(created.max()), share * float(series["elastic"].max()), "J")


def column_invariants(
    scene: JanssenScene, series: Series, weight_balance: Quantity
) -> dict[str, Invariant]:
    """Weight, agitation and, where the engine samples it, overlap."""
    bounds = bounds_of(scene)
    off = max(OUT_OF_BALANCE, ERRORS * weight_balance.standard_error)
    last = series["kinetic"][-max(len(series) // 20, 1) :].mean()
    speed = sqrt(2.0 * float(last) / scene.grains.mass)
    found = {
        "weight_balance": Invariant(weight_balance.mean - 1.0, off, "1"),
        "agitation": Invariant(speed, bounds.agitation, "m/s"),
    }
    if "overlap" in series.channels:
        deepest = float(series["overlap"].max()) / 2.0
        found[OVERLAP] = Invariant(deepest, bounds.overlap, "d")
    return found


def sheared_invariants(scene: ShearScene, sampled: Series) -> dict[str, Invariant]:
    """Overlap, over the least side of a grain; agitation, momentum and energy."""
    bounds, mass = bounds_of(scene), scene.grain_count * scene.mass
    speed = sqrt(2.0 * float(sampled["fluctuation"].max()) / mass)
    momentum = float(sampled["momentum"].max())
    return {
        OVERLAP: Invariant(float(sampled["overlap"].max()) / 2.0, bounds.overlap, "d"),
        "agitation": Invariant(speed, bounds.agitation, "m/s"),
        "momentum": Invariant(momentum, ROUNDING * mass * speed, "kg m/s"),
        "energy_created": _created(scene, sampled, bounds),
    }


def _created(scene: ShearScene, sampled: Series, bounds: Bounds) -> Invariant:
    """The largest energy that the grains hold beyond what they had and were given, J."""
    held = sampled["fluctuation"] + sampled["rotation"] + sampled["elastic"]
    stress = -sampled["kinetic_xy"] - sampled["contact_xy"]
    given = np.cumsum(stress) * scene.drive.shear_rate * scene.volume * sampled.interval
    created = held - held[0] - (given - given[0])
    share = (bounds.own / bounds.expected) ** 2
    return Invariant(float(created.max()), share * float(held.max()), "J")
