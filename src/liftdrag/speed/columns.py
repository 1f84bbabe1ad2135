"""Spheres in a tube: the in-house engine, with each of its contact laws, against LAMMPS."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from functools import partial
from pathlib import Path

from liftdrag import piston
from liftdrag.case import load
from liftdrag.engines import engine
from liftdrag.engines.base import silent
from liftdrag.speed.rounds import best

COLUMN = {
    "fill.mass": "141.4 g",
    "fill.curve": False,
    "drive.mobilise": "0.01 d",
    "drive.distance": "0.1 d",
}
"""What of `janssen/walton_13` is timed: 4000 grains that settle, and move a tenth of a grain."""


def columns() -> Iterator[str]:
    """4000 spheres in a tube: this engine against LAMMPS, and two threads against one."""
    kinds = [
        ("linear", "lammps", 1),
        ("linear", "dem", 1),
        ("linear", "dem", 2),
        ("walton-braun", "dem", 1),
        ("walton-braun", "dem", 2),
    ]
    times = best(*(partial(column, *kind) for kind in kinds), rounds=3)
    yield f"linear, lammps: {times[0]:.0f} ns per grain-step"
    for k in (1, 3):
        yield (
            f"{kinds[k][0]}, dem: {times[k]:.0f} ns, {times[0] / times[k]:.2f} times as fast as "
            f"lammps; two threads {times[k] / times[k + 1]:.2f} times as fast as one"
        )


def column(contact: str, name: str, ranks: int) -> float:
    """Nanoseconds per grain-step of a column that settles and moves a little, sampling included."""
    case = load("janssen/walton_13").set("grains.contact", contact)
    for key, value in COLUMN.items():
        case = case.set(key, value)
    chosen = engine(name)
    _, deck = piston.prepare(case, chosen.dialect, ranks)
    with tempfile.TemporaryDirectory() as folder:
        deck.write(Path(folder))
        outcome = chosen.run(deck.plan, Path(folder), silent)
    assert outcome.status == "finished", outcome.evidence
    return outcome.loop_s / (outcome.grains * outcome.steps) * 1e9
