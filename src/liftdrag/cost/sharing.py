"""How one tank shares the cores that it is given: as ranks of one run, or as replicas of it.

Ranks wait for each other at every step, so n of them are less than n times as fast. Replicas do
not wait, but each packs and settles a bed of its own and drives through the transient. Both reach
the same error when the replicas together drive as far in the steady flow as the one run would.
"""

from __future__ import annotations

from dataclasses import dataclass

from liftdrag.cost import model
from liftdrag.cost.estimate import duration
from liftdrag.cost.kind import Kind
from liftdrag.cost.work import work_of
from liftdrag.numerics import derive
from liftdrag.scene import TankScene
from liftdrag.scene.tank import TRANSIENT

LEAST_STEADY = 9.0
"""Intruder diameters of steady flow that a replica needs for an error of its own.

They are twenty correlation times of the lift, 0.43 D each in the small box of `quick`.
"""


@dataclass(frozen=True)
class Sharing:
    """So many `ranks`, or else `replicas` of so many intruder diameters each.

    `ranks_s` and `replicas_s` are the seconds on the clock of either way; those of replicas are
    None where each would be too short.
    """

    ranks: int
    replicas: int
    diameters: float
    ranks_s: float
    replicas_s: float | None

    def __str__(self) -> str:
        ranks = f"{self.ranks} ranks of one run in about {duration(self.ranks_s)}"
        if self.replicas_s is None:
            return f"{ranks}: replicas would each be too short for an error of its own."
        replicas = (
            f"{self.replicas} replicas of {self.diameters:.3g} D each in about "
            f"{duration(self.replicas_s)}"
        )
        first, second = (replicas, ranks) if self.prefers_replicas else (ranks, replicas)
        return f"{first}, rather than {second}."

    @property
    def prefers_replicas(self) -> bool:
        """Whether the replicas are done sooner."""
        return self.replicas_s is not None and self.replicas_s < self.ranks_s


def share(scene: TankScene, kind: Kind, cores: int) -> Sharing:
    """The two ways to use `cores`, with the times of the model for runs of this kind."""
    diameters = scene.drive.distance / scene.intruder.diameter
    steady = (diameters - TRANSIENT) / cores
    ranks_s = _seconds(scene, kind, diameters, cores)
    replicas_s = _seconds(scene, kind, TRANSIENT + steady, 1) if steady >= LEAST_STEADY else None
    return Sharing(cores, cores, TRANSIENT + steady, ranks_s, replicas_s)


def _seconds(scene: TankScene, kind: Kind, diameters: float, ranks: int) -> float:
    """Seconds on the clock to pack, settle and drive so many intruder diameters."""
    driven = scene.drive.model_copy(update={"distance": diameters * scene.intruder.diameter})
    work = work_of(scene, derive(scene.model_copy(update={"drive": driven})))
    loop = model.seconds_of(kind, work) / model.speedup(work.grains, ranks)
    return model.start_s(kind) + model.packing_s(kind, work) + loop
