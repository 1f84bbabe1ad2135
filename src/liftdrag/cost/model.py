"""What work takes on the machine that this model was measured on: a server core of 2.6 GHz.

Growth with grains and ranks is that of `python -m liftdrag.speed growth`. Another machine is so
many times slower or faster in all of it.
"""

from __future__ import annotations

import numpy as np

from liftdrag.cost.kind import Kind
from liftdrag.cost.work import Work

NANOSECONDS = {
    ("tank", "lammps", "granular"): 250.0,
    ("tank", "lammps", "hertz/history"): 180.0,
    ("tank", "lmp", "granular"): 220.0,
    ("tank", "lmp", "hertz/history"): 180.0,
    ("tank", "liggghts", "granular"): 215.0,
    ("janssen", "lammps", "linear"): 240.0,
    ("janssen", "lammps", "hertz"): 255.0,
    ("janssen", "lmp", "linear"): 195.0,
    ("janssen", "liggghts", "linear"): 180.0,
    ("janssen", "liggghts", "hertz"): 185.0,
    ("janssen", "dem", "linear"): 90.0,
    ("janssen", "dem", "hertz"): 80.0,
    ("janssen", "dem", "walton-braun"): 170.0,
    ("drag2d", "lammps", "disc"): 210.0,
    ("drag2d", "lammps", "dumbbell"): 520.0,
    ("drag2d", "lmp", "disc"): 170.0,
    ("drag2d", "lmp", "dumbbell"): 400.0,
    ("drag2d", "liggghts", "disc"): 170.0,
    ("drag2d", "liggghts", "dumbbell"): 400.0,
    ("drag2d", "dem", "disc"): 60.0,
    ("drag2d", "dem", "dumbbell"): 102.0,
    ("drag2d", "dem", "ellipse"): 120.0,
    ("shear", "dem", "cylinder"): 650.0,
}
"""Of one core for a grain-step, in a bed of 10 000 grains, its measurements included."""

UNKNOWN = 250.0
"""The same of what is not in the table."""

GROWTH = ((1e2, 0.80), (1e3, 0.95), (1e4, 1.0), (1e5, 1.15), (3e5, 1.34), (1e6, 1.7))
"""Grains, and the time of a grain-step over that with 10 000: less and less is in the caches."""

SHARED, FEW = 0.15, 400.0
"""What two ranks lose: this share of the time to each other, and as much as these grains take."""

START_S = {"lammps": 0.75, "lmp": 0.3, "liggghts": 0.3}
"""Until an engine begins."""

PACKING_S = {"tank": 200e-6, "janssen": 90e-6, "shear": 8e-3}
"""Of a grain, in the packing of a bed of spheres, or the growth of a cell of cylinders."""

GROWN_S = {"disc": 0.9e-3, "dumbbell": 1.4e-3, "ellipse": 0.85e-3}
"""Of a grain in the plane, in the growth of 400 of them, a third up or down by how they jam."""

GROWN_POWER = 0.9
"""Of the number of grains, by which each takes longer."""

COMPILE_S = 30.0
"""Of the in-house engine, once."""


def expected_s(kind: Kind, work: Work) -> float:
    """Seconds of the loops on the clock; of beds in the plane, those of one core for all."""
    if kind.scene == "drag2d":
        return work.beds * bed_s(kind, work)
    return seconds_of(kind, work) / speedup(work.grains, kind.cores)


def bed_s(kind: Kind, work: Work) -> float:
    """Seconds of one core to grow a bed in the plane and to pull through it."""
    return packing_s(kind, work) + start_s(kind) + seconds_of(kind, work)


def seconds_of(kind: Kind, work: Work) -> float:
    """Seconds of one core in the loops of one bed."""
    law = kind.contacts.split()[0]
    nanoseconds = NANOSECONDS.get((kind.scene, kind.engine, law), UNKNOWN)
    return work.grain_steps * nanoseconds * 1e-9 * slower(work.grains)


def slower(grains: float) -> float:
    """The time of a grain-step over that with 10 000 grains."""
    sizes, times = np.log10([size for size, _ in GROWTH]), [time for _, time in GROWTH]
    return float(np.interp(np.log10(grains), sizes, times))


def speedup(grains: float, cores: int) -> float:
    """How many times faster so many cores, a rank on each, are than one."""
    return 1.0 if cores == 1 else cores / (1.0 + SHARED + FEW * cores / grains)


def packing_s(kind: Kind, work: Work) -> float:
    """Seconds of one core to pack a bed."""
    if kind.scene in PACKING_S:
        return PACKING_S[kind.scene] * work.grains
    alike = GROWN_S[kind.contacts.split()[0]] * work.grains
    return alike * float((work.grains / 400.0) ** GROWN_POWER)


def start_s(kind: Kind) -> float:
    """Seconds until the engine begins."""
    return START_S.get(kind.engine, 0.0)
