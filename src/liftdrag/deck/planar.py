"""A bed of discs, or of rigid clumps of discs, in a plane: the deck of a disc driven through it."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from io import StringIO
from math import inf, pi
from typing import Any

import numpy as np

from liftdrag.deck.commands import check_commands
from liftdrag.deck.dialect import LIGGGHTS, Contact, Dialect
from liftdrag.deck.model import Deck, Plan
from liftdrag.deck.template import render

HEAVY = 1e12
"""Mass of the intruder over that of the heaviest disc: its effective mass is that of a wall."""

SPHERE, DISC = 0.4, 0.5
"""Moment of inertia of a sphere and of a disc, over m r^2."""


@dataclass(frozen=True)
class PlanarBed:
    """p discs in a closed box [0, width] x [0, height] (m) without gravity, and the intruder.

    Of the discs: `position` (p, 2) in m, `radius` (p,) in m, `mass` (p,) in kg, `velocity`
    (p, 2) in m/s, `spin` (p,) in rad/s, the last two zero unless given. Discs of one number
    `body` (p,) are a rigid clump. The intruder is a disc of this position (2,) and radius (m)
    that keeps its velocity (2,) (m/s), and that no wall touches.
    """

    position: np.ndarray
    radius: np.ndarray
    mass: np.ndarray
    body: np.ndarray
    width: float
    height: float
    intruder_position: np.ndarray
    intruder_radius: float
    intruder_velocity: np.ndarray
    velocity: np.ndarray | float = 0.0
    spin: np.ndarray | float = 0.0

    @property
    def clumped(self) -> bool:
        """Whether any body has more than one disc."""
        return bool(self.clump.any())

    @property
    def clump(self) -> np.ndarray:
        """Number of the clump of each disc (p,), from 1; zero for a disc on its own."""
        _, body, discs = np.unique(self.body, return_inverse=True, return_counts=True)
        numbers: np.ndarray = np.where(discs > 1, np.cumsum(discs > 1), 0)
        return numbers[body]


@dataclass(frozen=True)
class PlanarSteps:
    """The time step and how many; steps from row to row, snapshot to snapshot, report to report.

    `time_step` in s, `skin` of the neighbour lists in m. A row is the mean over all its steps.
    """

    time_step: float
    count: int
    row_every: int
    snapshot_every: int
    skin: float
    progress_every: int


def build(
    contact: Contact,
    bed: PlanarBed,
    steps: PlanarSteps,
    dialect: Dialect,
    name: str,
    version: str,
) -> Deck:
    """The deck of a planar bed, whose walls are planes of the grains' own material.

    Its `drag` is minus the y force on the intruder, its `lift` the x force; `left`, `right`,
    `bottom` and `top` are the forces that push the walls outward. All are in N.
    Raises CaseError when the dialect cannot say the contact law.
    """
    context = _context(contact, bed, steps, dialect) | {
        "program": dialect.program,
        "name": re.sub(r"[^A-Za-z0-9_./-]", "_", name)[:80],
        "version": version,
    }
    text = render(f"{dialect.folder}/drag2d.in.j2", context)
    check_commands(text, "in.drag2d")
    texts = {"in.drag2d": text, "grains.data": _data_file(bed, steps, dialect)}
    if bed.clumped:
        texts["clumps.data"] = _clump_file(bed, dialect)
    return Deck(texts, _plan(steps))


def _plan(steps: PlanarSteps) -> Plan:
    return Plan(
        start="in.drag2d",
        ranks=1,
        time_step=steps.time_step,
        stages={"drive": steps.count},
        row_every=steps.row_every,
        series={"forces.dat": dict.fromkeys("drag lift left right bottom top".split(), "N")},
    )


def _context(
    contact: Contact, bed: PlanarBed, steps: PlanarSteps, dialect: Dialect
) -> dict[str, Any]:
    context = dialect.numbers(replace(contact, wall_radius=inf, rigid=False), 2) | {
        "time_step": steps.time_step,
        "drive_steps": steps.count,
        "row_every": steps.row_every,
        "snapshot_every": steps.snapshot_every,
        "progress_every": steps.progress_every,
        "skin": steps.skin,
        "width": bed.width,
        "height": bed.height,
        "speed_x": float(bed.intruder_velocity[0]),
        "speed_y": float(bed.intruder_velocity[1]),
        "clumped": bed.clumped,
    }
    if dialect is not LIGGGHTS:
        context["reach"] = _reach(bed) + steps.skin
    return {key: _plain(value) for key, value in context.items()}


def _plain(value: Any) -> Any:
    return f"{value:.15g}" if isinstance(value, float) else value


def _reach(bed: PlanarBed) -> float:
    """Farther (m) than the centres of discs that touch, or are of one clump, are apart."""
    clump, largest = bed.clump, max(bed.radius.max(), bed.intruder_radius)
    clumps = [bed.position[clump == number] for number in range(1, clump.max() + 1)]
    lengths = [float(np.hypot(*np.ptp(discs, axis=0))) for discs in clumps]
    return 2.0 * float(largest) + max(lengths, default=0.0)


def _data_file(bed: PlanarBed, steps: PlanarSteps, dialect: Dialect) -> str:
    """The discs in order, numbered from 1, of type 1; the intruder last, of type 2."""
    (left, bottom), (right, top) = _box(bed, steps)
    out = StringIO()
    out.write(f"Discs of liftdrag\n\n{len(bed.radius) + 1} atoms\n2 atom types\n")
    out.write(f"{left:.15g} {right:.15g} xlo xhi\n{bottom:.15g} {top:.15g} ylo yhi\n")
    out.write(f"{-bed.intruder_radius:.15g} {bed.intruder_radius:.15g} zlo zhi\n")
    _write_atoms(out, bed, dialect)
    _write_velocities(out, bed, dialect)
    if dialect is not LIGGGHTS and bed.clumped:
        out.write("\nMolecules\n\n")
        np.savetxt(out, np.column_stack([_ids(bed), np.append(bed.clump, 0)]), fmt="%d %d")
    return out.getvalue()


def _box(bed: PlanarBed, steps: PlanarSteps) -> tuple[np.ndarray, np.ndarray]:
    """The closed box, larger where the intruder's centre leaves it.

    A grain that gets through a wall is outside of it, and ends the run.
    """
    way = np.outer([0.0, steps.time_step * steps.count], bed.intruder_velocity)
    way += bed.intruder_position
    low, high, size = way.min(axis=0), way.max(axis=0), np.array([bed.width, bed.height])
    room = bed.intruder_radius
    return np.where(low < 0.0, low - room, 0.0), np.where(high > size, high + room, size)


def _write_atoms(out: StringIO, bed: PlanarBed, dialect: Dialect) -> None:
    """Each engine's columns; LIGGGHTS knows clumps in a style of atoms of its own only."""
    ids, types = _ids(bed), np.append(np.ones(len(bed.radius)), 2.0)
    place, size = np.vstack([bed.position, bed.intruder_position]), _sizes(bed, dialect)
    columns, form = [ids, types, size, place], "%d %d %.17g %.17g %.17g %.17g 0"
    if dialect is LIGGGHTS and bed.clumped:
        columns = [ids, types, place, size, np.append(bed.clump, 0)]
        form = "%d %d %.17g %.17g 0 %.17g %.17g %d"
    out.write("\nAtoms\n\n")
    np.savetxt(out, np.column_stack(columns), fmt=form)


def _ids(bed: PlanarBed) -> np.ndarray:
    return np.arange(1, len(bed.radius) + 2)


def _sizes(bed: PlanarBed, dialect: Dialect) -> np.ndarray:
    """Diameters and the densities that give the masses (p + 1, 2).

    LAMMPS takes the volume of a sphere even in a plane, and so does LIGGGHTS for clumps; for
    discs on their own LIGGGHTS takes the area.
    """
    radius = np.append(bed.radius, bed.intruder_radius)
    mass = np.append(bed.mass, HEAVY * bed.mass.max())
    flat = dialect is LIGGGHTS and not bed.clumped
    volume = pi * radius**2 if flat else 4.0 / 3.0 * pi * radius**3
    return np.column_stack([2.0 * radius, mass / volume])


def _write_velocities(out: StringIO, bed: PlanarBed, dialect: Dialect) -> None:
    """LIGGGHTS sums a clump's angular momentum as if of spheres: there its discs spin faster."""
    spin = np.broadcast_to(bed.spin, bed.radius.shape)
    if dialect is LIGGGHTS:
        spin = np.where(bed.clump > 0, spin * DISC / SPHERE, spin)
    velocity = np.broadcast_to(bed.velocity, bed.position.shape)
    motion = np.column_stack([velocity, spin])
    rows = np.vstack([motion, [*bed.intruder_velocity, 0.0]])
    out.write("\nVelocities\n\n")
    np.savetxt(out, np.column_stack([_ids(bed), rows]), fmt="%d %.17g %.17g 0 0 0 %.17g")


def _clump_file(bed: PlanarBed, dialect: Dialect) -> str:
    """Each clump's number, mass, centre and moments of inertia; for LAMMPS its motion, too."""
    rows = _clumps(bed)
    columns = "%d %.17g %.17g %.17g 0 %.17g %.17g %.17g %.17g 0 0"
    if dialect is LIGGGHTS:
        rows = rows[:, :8]
    else:
        columns += " %.17g %.17g 0 0 0 %.17g 0 0 0"
    out = StringIO()
    out.write(f"# Clumps of liftdrag\n\n{len(rows)}\n")
    np.savetxt(out, rows, fmt=columns)
    return out.getvalue()


def _clumps(bed: PlanarBed) -> np.ndarray:
    """Number, mass, centre, moments xx, yy, zz, xy of flat discs, velocity, angular momentum."""
    inside = bed.clump > 0
    number, mass, position = bed.clump[inside], bed.mass[inside], bed.position[inside]
    vx, vy = np.broadcast_to(bed.velocity, bed.position.shape)[inside].T
    spin = np.broadcast_to(bed.spin, bed.radius.shape)[inside]

    def total(values: np.ndarray) -> np.ndarray:
        return np.bincount(number, mass * values)[1:]

    whole = total(np.ones(len(mass)))
    centre = np.column_stack([total(along) for along in position.T]) / whole[:, None]
    x, y = (position - centre[number - 1]).T
    own = DISC * bed.radius[inside] ** 2
    xx, yy = total(own / 2.0 + y**2), total(own / 2.0 + x**2)
    turning = total(own * spin + x * vy - y * vx)
    motion = [total(vx) / whole, total(vy) / whole, turning]
    numbers = np.arange(1, len(whole) + 1)
    return np.column_stack([numbers, whole, centre, xx, yy, xx + yy, -total(x * y), *motion])
