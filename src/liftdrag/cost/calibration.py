"""A short run from which an engine that was never used on this machine is known."""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

from liftdrag.case import load
from liftdrag.cost.history import Learnt, learn
from liftdrag.cost.kind import kind_of
from liftdrag.cost.work import Work
from liftdrag.deck.tank import build
from liftdrag.engines import ENGINES
from liftdrag.engines.base import Engine, silent
from liftdrag.numerics import TankNumerics, Value, derive
from liftdrag.scene import TankScene

SIDES = {"length": "28 d", "thickness": "4 d", "height": "24 d"}
"""Of the tank, which holds 3100 grains."""

STEPS = 2000
"""In which it is driven."""

LOADING = 20
"""Steps before that, in which grains begin to touch."""

T = TypeVar("T")


def calibrate(engine: Engine) -> bool:
    """Remember what a small tank takes on one rank; False where the engine holds none, or fails.

    On several ranks, which wait for each other, other work would disturb so short a run too much.
    Raises InputError when the engine is not installed.
    """
    if engine.name not in ENGINES or engine.world().size > 1:
        return False
    scene = _scene()
    numerics = unsettled(derive(scene), STEPS)
    deck = build(scene, numerics, "calibration", "", dialect=engine.dialect)
    with tempfile.TemporaryDirectory(prefix="liftdrag-") as name:
        deck.write(Path(name))
        outcome = engine.run(deck.plan, Path(name), silent, alone=True)
    if outcome.status == "finished":
        kind = kind_of(scene, engine, 1)
        kind = replace(kind, contacts=f"{kind.contacts} calibration")
        work = Work(outcome.grains, outcome.steps, float(outcome.grains * outcome.steps))
        learn(Learnt.of(kind, work, outcome))
    return outcome.status == "finished"


def _scene() -> TankScene:
    case = load("guillard2014/half-height").set("intruder.depth", "12 d")
    for side, value in SIDES.items():
        case = case.set(f"tank.{side}", value)
    assert isinstance(case.scene, TankScene)
    return case.scene


def unsettled(numerics: TankNumerics, steps: int) -> TankNumerics:
    """Numerics of a bed that need not come to rest, and of so many steps without pictures."""
    never = 10**9

    def changed(value: Value[T], to: T) -> Value[T]:
        return replace(value, value=to)

    return replace(
        numerics,
        settle_energy=changed(numerics.settle_energy, 1.0),
        settle_steps=changed(numerics.settle_steps, LOADING),
        settle_steps_max=changed(numerics.settle_steps_max, LOADING),
        look_every=changed(numerics.look_every, LOADING),
        drive_steps=changed(numerics.drive_steps, steps),
        snapshot_every=changed(numerics.snapshot_every, never),
        surface_every=changed(numerics.surface_every, never),
    )
