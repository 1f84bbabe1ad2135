"""The memory that a run needs, and a warning where there is less."""

from __future__ import annotations

from collections.abc import Iterator

from liftdrag.cost.kind import Kind
from liftdrag.cost.machine import free_memory
from liftdrag.cost.work import Work

PROCESS = {"lammps": 115e6, "lmp": 35e6, "liggghts": 35e6}
"""Bytes of each rank of an engine without grains."""

OWN = 250e6
"""Bytes of liftdrag without grains, the in-house engine included."""

GRAIN = 1500.0
"""Bytes of a grain, in the engine and in liftdrag."""


def needed(kind: Kind, work: Work) -> float:
    """Bytes, roughly, at the most."""
    return OWN + kind.ranks * PROCESS.get(kind.engine, 0.0) + GRAIN * work.grains


def warned(kind: Kind, work: Work) -> Iterator[str]:
    """A warning where less is free than is needed."""
    free, need = free_memory(), needed(kind, work)
    if free is not None and need > free:
        yield (
            f"Too little memory: this needs about {need / 1e9:.3g} GB, {free / 1e9:.3g} GB are "
            "free; the system may end it."
        )
