"""How a few bodies move on an engine, step by step."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from liftdrag.deck import Deck
from liftdrag.deck.bodies import MOTION, Bodies, Steps, build
from liftdrag.deck.dialect import Contact
from liftdrag.engines.base import Engine, Outcome, silent
from liftdrag.engines.family import read_dump
from liftdrag.errors import RunFailed


@dataclass(frozen=True)
class Motion:
    """Frames of n bodies: `time` (t,) in s; the rest (t, n, 3) in m, m/s, rad/s and N.

    `force` is the whole force on a body, `wall_force` the wall's part of it, zero without one.
    """

    time: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    spin: np.ndarray
    force: np.ndarray
    wall_force: np.ndarray


def move(engine: Engine, contact: Contact, bodies: Bodies, steps: Steps) -> Motion:
    """The motion of the bodies on the engine, outside of any MPI job.

    Raises RunFailed when the engine fails, CaseError when it cannot say the contact law.
    """
    with tempfile.TemporaryDirectory(prefix="liftdrag-") as name:
        folder = Path(name)
        _carry_out(engine, build(contact, bodies, steps, engine.dialect), folder)
        return _read(folder / MOTION, steps.time_step, bodies)


def ranks_of_motion(engine: Engine, contact: Contact, bodies: Bodies, steps: Steps) -> int:
    """On how many ranks the engine, by its own log, moved the bodies. Raises RunFailed."""
    with tempfile.TemporaryDirectory(prefix="liftdrag-") as name:
        deck = build(contact, bodies, steps, engine.dialect)
        return _carry_out(engine, deck, Path(name)).ranks


def _carry_out(engine: Engine, deck: Deck, folder: Path) -> Outcome:
    deck.write(folder)
    outcome = engine.run(deck.plan, folder, silent, alone=True)
    if outcome.status != "finished":
        raise RunFailed(
            outcome.status, f"{engine.name} failed: {outcome.reason}.", outcome.evidence
        )
    return outcome


def _read(path: Path, time_step: float, bodies: Bodies) -> Motion:
    frames = list(read_dump(path))
    time = np.array([step for step, _ in frames]) * time_step
    rows = np.array([rows for _, rows in frames])
    parts = [rows[:, :, column : column + 3] for column in range(1, rows.shape[2], 3)]
    if bodies.wall is None:
        parts.append(np.zeros_like(parts[0]))
    return Motion(time, *parts)
