"""How the cost of a run is foreseen: work over the rate at which this machine did such work."""

from __future__ import annotations

import logging

from liftdrag.cost import memory, model
from liftdrag.cost.calibration import calibrate
from liftdrag.cost.estimate import Estimate, Times
from liftdrag.cost.history import factor
from liftdrag.cost.kind import Kind, kind_of
from liftdrag.cost.turns import turns
from liftdrag.cost.work import Work, work_of
from liftdrag.dem import is_cold
from liftdrag.engines.base import Engine
from liftdrag.numerics import Numerics
from liftdrag.scene import Scene

LONG_S = 60.0
"""A run that is guessed to take longer is worth a calibration, which takes some seconds."""

GUESS = "a guess from another machine: no run here yet"

_log = logging.getLogger("liftdrag")


def foresee(
    scene: Scene, numerics: Numerics, engine: Engine, ranks: int, packed: bool = False
) -> Estimate:
    """The estimate of a run, said to the log `liftdrag`; its bed may be `packed` already.

    An engine that was never used here is calibrated where that is worth it. Raises InputError when
    it is not installed.
    """
    kind, work = kind_of(scene, engine, ranks), work_of(scene, numerics)
    if not factor(kind):
        _calibrate(engine, kind, work)
    found = expected(scene, numerics, engine, ranks, packed)
    _log.info("%s", found)
    for warning in found.warnings:
        _log.warning("WARNING: %s", warning)
    return found


def expected(
    scene: Scene, numerics: Numerics, engine: Engine, ranks: int, packed: bool = False
) -> Estimate:
    """The same from what is known already, and said to nobody."""
    kind, work = kind_of(scene, engine, ranks), work_of(scene, numerics)
    slower, basis = factor(kind) or (1.0, GUESS)
    warnings = (*turns(kind), *memory.warned(kind, work))
    times = _times(kind, work, slower, packed)
    return Estimate(kind, work, times, basis, scene.stop is not None, warnings)


def _calibrate(engine: Engine, kind: Kind, work: Work) -> None:
    """Learn from a calibration, where the run is long and the engine has one."""
    if _times(kind, work, 1.0, packed=True).wall_s > LONG_S:
        calibrate(engine)


def _times(kind: Kind, work: Work, slower: float, packed: bool) -> Times:
    if kind.scene == "drag2d":
        return beds_times(kind, work, slower, is_cold())
    return bed_times(kind, work, slower, kind.engine == "dem" and is_cold(), packed)


def bed_times(kind: Kind, work: Work, slower: float, cold: bool, packed: bool) -> Times:
    """The times of one bed, on ranks that share it; a machine so many times slower."""
    loop, start = slower * model.expected_s(kind, work), model.start_s(kind)
    compiling = slower * model.COMPILE_S if cold else 0.0
    return Times(
        packing_s=0.0 if packed else slower * model.packing_s(kind, work),
        compile_s=compiling,
        wall_s=start + compiling + loop,
        cpu_s=kind.cores * (start + loop) + compiling,
        cores=kind.cores,
        rate=work.grain_steps / (loop * kind.cores),
    )


def beds_times(kind: Kind, work: Work, slower: float, cold: bool) -> Times:
    """The times of beds that are grown and pulled through by themselves, the first grown alone."""
    whole, grown = slower * model.bed_s(kind, work), slower * model.packing_s(kind, work)
    cores = min(kind.cores, work.beds)
    compiling = slower * model.COMPILE_S if cold else 0.0
    rest = max((work.beds * whole - grown) / cores, whole - grown)
    return Times(
        packing_s=0.0,
        compile_s=compiling,
        wall_s=compiling + grown + rest,
        cpu_s=compiling + work.beds * whole,
        cores=cores,
        rate=work.grain_steps / (slower * model.seconds_of(kind, work)),
    )
