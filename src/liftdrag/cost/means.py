"""What a run needs and the machine has not: refused before anything is started."""

from __future__ import annotations

from pathlib import Path

from liftdrag.cost import disk, machine, memory
from liftdrag.cost.kind import kind_of
from liftdrag.cost.work import work_of
from liftdrag.engines.base import Engine
from liftdrag.errors import InputError
from liftdrag.numerics import Numerics
from liftdrag.scene import Scene


def check_means(
    scene: Scene,
    numerics: Numerics,
    engine: Engine,
    ranks: int,
    out: str | Path | None,
    dump: bool = False,
) -> None:
    """Raise InputError where the machine has less memory, or the disk less room, than is needed.

    The ranks of an MPI job around us may have the memory of other machines.
    """
    if engine.world().size == 1:
        _check_memory(memory.needed(kind_of(scene, engine, ranks), work_of(scene, numerics)))
    _check_disk(disk.needed(scene, numerics, dump), Path(out or "runs"))


def _check_memory(needed: float) -> None:
    whole = machine.whole_memory()
    if whole is not None and needed > whole:
        raise InputError(
            f"This needs about {needed / 1e9:.3g} GB of memory, and the machine has "
            f"{whole / 1e9:.3g} GB; take fewer grains or ranks, or spread it over machines with "
            "mpiexec."
        )


def _check_disk(needed: float, place: Path) -> None:
    free = disk.free(place)
    if needed > free:
        raise InputError(
            f"This writes about {needed / 1e9:.3g} GB, and {free / 1e9:.3g} GB are free at "
            f"{place}; name another disk with --out, or drive it less far."
        )
