"""Of what kind a run is: runs of one kind take the same time for the same work."""

from __future__ import annotations

import platform
from dataclasses import dataclass

from liftdrag.cost.machine import cores
from liftdrag.cost.work import contacts_of
from liftdrag.engines.base import Engine
from liftdrag.scene import Scene


@dataclass(frozen=True)
class Kind:
    """On which machine and engine, of which scene and contacts, on how many ranks.

    `cores` compute at a time: more ranks than those that liftdrag may start them on take turns.
    """

    machine: str
    engine: str
    version: str
    scene: str
    contacts: str
    ranks: int
    cores: int

    @property
    def takes_turns(self) -> bool:
        """Whether there are more ranks than cores."""
        return self.ranks > self.cores


def kind_of(scene: Scene, engine: Engine, ranks: int) -> Kind:
    """The kind of a run here. Raises InputError when the engine is not installed."""
    version, contacts = engine.about().version, contacts_of(scene)
    together = ranks if engine.world().size > 1 else min(ranks, cores())
    return Kind(platform.node(), engine.name, version, scene.scene, contacts, ranks, together)
