"""A few spheres against each other or a wall: the deck of the two-body tests."""

from __future__ import annotations

from dataclasses import dataclass
from io import StringIO
from math import inf
from typing import Any, Literal

import numpy as np

from liftdrag.deck.commands import check_commands
from liftdrag.deck.dialect import LIGGGHTS, Contact, Dialect
from liftdrag.deck.model import Deck, Plan
from liftdrag.deck.template import render

MOTION = "motion.dump"
"""Per body and step: id, position, velocity, spin, force, and the force of the wall."""

Wall = Literal["plane", "cylinder"]


@dataclass(frozen=True)
class Bodies:
    """Equal spheres: centres, velocities and spins (n, 3) in m, m/s and rad/s.

    A plane is at z = 0; a cylinder, of the contact's `wall_radius`, has its axis along y
    through the origin.
    """

    density: float
    centres: np.ndarray
    velocities: np.ndarray
    spins: np.ndarray
    wall: Wall | None = None
    gravity: float = 0.0


@dataclass(frozen=True)
class Steps:
    """The time step (s), how many, how many from frame to frame, and on how many ranks."""

    time_step: float
    count: int
    every: int = 1
    ranks: int = 1


def build(contact: Contact, bodies: Bodies, steps: Steps, dialect: Dialect) -> Deck:
    """The deck in which the bodies move. Raises CaseError when the dialect cannot say the law."""
    text = render(f"{dialect.folder}/bodies.in.j2", _context(contact, bodies, steps, dialect))
    check_commands(text, "in.bodies")
    plan = Plan("in.bodies", steps.ranks, steps.time_step, {"motion": steps.count}, steps.every, {})
    return Deck({"in.bodies": text, "bodies.data": _data_file(contact, bodies, steps)}, plan)


def _context(contact: Contact, bodies: Bodies, steps: Steps, dialect: Dialect) -> dict[str, Any]:
    context = dialect.numbers(contact, 2) | {
        "program": dialect.program,
        "partner": f"a {bodies.wall}" if bodies.wall else "each other",
        "processors": f"1 {steps.ranks} 1",
        "skin": 0.5 * contact.radius,
        "time_step": steps.time_step,
        "gravity": bodies.gravity,
        "wall": bodies.wall,
        "cylinder_radius": 0.0 if contact.wall_radius == inf else contact.wall_radius,
        "steps": steps.count,
        "every": steps.every,
    }
    if dialect is LIGGGHTS:
        context["precision"] = "%d" + " %.15g" * (15 if bodies.wall else 12)
    return {key: _plain(value) for key, value in context.items()}


def _plain(value: Any) -> Any:
    return f"{value:.15g}" if isinstance(value, float) and value else value


def _data_file(contact: Contact, bodies: Bodies, steps: Steps) -> str:
    count, d = len(bodies.centres), 2.0 * contact.radius
    low, high = _box(contact, bodies, steps)
    out = StringIO()
    out.write(f"Spheres of liftdrag\n\n{count} atoms\n2 atom types\n")
    for axis, name in enumerate("xyz"):
        out.write(f"{low[axis]:.12g} {high[axis]:.12g} {name}lo {name}hi\n")
    ids = np.arange(1, count + 1)
    sizes = np.column_stack([ids, np.ones(count), np.full((count, 2), [d, bodies.density])])
    out.write("\nAtoms\n\n")
    np.savetxt(out, np.column_stack([sizes, bodies.centres]), fmt="%d %d" + " %.17g" * 5)
    out.write("\nVelocities\n\n")
    motion = np.column_stack([ids, bodies.velocities, bodies.spins])
    np.savetxt(out, motion, fmt="%d" + " %.17g" * 6)
    return out.getvalue()


def _box(contact: Contact, bodies: Bodies, steps: Steps) -> tuple[np.ndarray, np.ndarray]:
    """A box that holds the bodies wherever they go, and the wall's surface."""
    time = steps.time_step * steps.count
    speed = np.abs(bodies.velocities).max(axis=0, initial=0.0)
    falling = np.array([0.0, 0.0, bodies.gravity * time])
    turning = contact.radius * np.abs(bodies.spins).max(initial=0.0)
    room = 4.0 * contact.radius + 1.5 * (speed + falling + turning) * time
    return bodies.centres.min(axis=0) - room, bodies.centres.max(axis=0) + room
