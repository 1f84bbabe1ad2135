"""Probes: small runs that show whether an engine computes the contacts that a deck asks for.

They are written in the templates of the decks, so what they find of a contact holds there.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from math import ceil, inf
from typing import Any, Literal

import numpy as np

from liftdrag import granular, hertz
from liftdrag.deck.bodies import Bodies, Steps, Wall
from liftdrag.deck.dialect import Contact
from liftdrag.engines.base import Engine
from liftdrag.engines.impact import Throw, impacts, stiffness_and_mass
from liftdrag.engines.motion import Motion, move, ranks_of_motion
from liftdrag.errors import CaseError, InputError, RunFailed
from liftdrag.granular import GRAVITY

Partner = Literal["pair", "plane", "cylinder"]

IMPACT_STEP = 0.0125
"""Time step of the impacts over the Rayleigh time: their restitution is of first order in it."""

SLIDE_STEP = 0.05
"""The same for bodies at rest and sliding."""

SLIDE_TIME = 20.0
"""Rayleigh times that a body slides, half the time after which it would roll."""

SMALL_OVERLAP = 0.05
"""Largest overlap of the impacts, over the radius."""

ANGLES = range(0, 90, 5)
"""Degrees from the normal at which bodies are thrown."""

RESTITUTION_BOUND = 3e-3
"""Absolute error of a restitution: 0.5 % of 0.6."""

GAIN = 1e-4
"""Relative growth of the kinetic energy that is rounding of the time step."""

MEANING = {
    "restitution": "rebound of a head-on impact",
    "energy": "energy never grows in impacts from 0 to 85 degrees",
    "overlap": "Hertz overlap of a grain at rest",
    "force": "force of the wall on that grain, upwards",
    "friction": "deceleration of a sliding grain",
    "ranks": "two ranks are one run",
}
"""What the probes show, by the last word of their names."""


@dataclass(frozen=True)
class Probe:
    """What a probe measured, and what it should have: `bound` is the largest error allowed.

    The error is relative where `expected` is not zero. `failure` says why a probe did not run.
    """

    name: str
    measured: float | None
    expected: float | None
    unit: str
    bound: float
    failure: str = ""

    @property
    def passed(self) -> bool:
        """Whether the measured value is as near as the bound asks."""
        if self.measured is None or self.expected is None:
            return False
        return abs(self.measured - self.expected) <= self.bound * (abs(self.expected) or 1.0)

    @property
    def finding(self) -> str:
        """What was found, in words."""
        if self.measured is None:
            return self.failure
        return f"{self.measured:.4g} where {self.expected:.4g} {self.unit} was asked"

    @property
    def meaning(self) -> str:
        """What it shows."""
        return MEANING[self.name.split("_")[-1]]

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        return asdict(self) | {"passed": self.passed}


@dataclass(frozen=True)
class Subject:
    """The grains that probes are made with: their contacts, and their density (kg/m^3)."""

    contact: Contact
    density: float

    @property
    def mass(self) -> float:
        """Of a grain, kg."""
        return self.density * granular.sphere_volume(2.0 * self.contact.radius)

    @property
    def rayleigh_time(self) -> float:
        """Of a grain, s."""
        c = self.contact
        return hertz.rayleigh_time(2.0 * c.radius, self.density, c.youngs_modulus, c.poisson_ratio)

    def facing(self, partner: Partner) -> Contact:
        """The contact with a partner: a plane has no curvature."""
        return self.contact if partner == "cylinder" else replace(self.contact, wall_radius=inf)


def _impact_probes(engine: Engine, subject: Subject, partner: Partner) -> Iterator[Probe]:
    """Restitution of a head-on impact; the largest gain of energy at any angle."""
    throws = [Throw(_throw_speed(subject, partner), float(angle)) for angle in ANGLES]
    found = impacts(
        engine,
        subject.facing(partner),
        subject.density,
        throws,
        IMPACT_STEP * subject.rayleigh_time,
        _wall(partner),
    )
    asked = subject.contact.restitution
    yield Probe(
        f"{partner}_restitution", found[0].normal_restitution, asked, "", RESTITUTION_BOUND / asked
    )
    gain = max(0.0, max(impact.energy_ratio for impact in found) - 1.0)
    yield Probe(f"{partner}_energy", gain, 0.0, "of the energy gained", GAIN)


def _throw_speed(subject: Subject, partner: Partner) -> float:
    """Speed (m/s) of a fall by a diameter, or at which the overlap is small, if that is less.

    The classic law has the restitution asked for at one speed, that of two grains that meet.
    """
    radius, classic = subject.contact.radius, subject.contact.classic
    if partner == "pair" and classic is not None:
        return classic.speed / 2.0
    k, mass = stiffness_and_mass(subject.facing(partner), subject.density, _wall(partner))
    small = float(np.sqrt(4.0 * k * (SMALL_OVERLAP * radius) ** 2.5 / (5.0 * mass)))
    return min(float(np.sqrt(4.0 * GRAVITY * radius)), small)


def _wall(partner: Partner) -> Wall | None:
    return None if partner == "pair" else partner


def _rest_probes(engine: Engine, subject: Subject, partner: Partner) -> Iterator[Probe]:
    """A body at rest on the wall, and one that slides along it."""
    contact, mass = subject.facing(partner), subject.mass
    k, _ = stiffness_and_mass(contact, subject.density, _wall(partner))
    overlap = hertz.static_overlap(mass * GRAVITY, k)
    motion = _resting_and_sliding(engine, subject, partner, overlap)
    surface = contact.radius + (contact.wall_radius if partner == "cylinder" else 0.0)
    lasting = float(np.mean(surface - motion.position[:, 0, 2]))
    force = float(np.mean(motion.wall_force[:, 0, 2]))
    yield Probe(f"{partner}_overlap", lasting, overlap, "m", 1e-3)
    yield Probe(f"{partner}_force", force, mass * GRAVITY, "N", 1e-3)
    late = motion.time > 0.2 * motion.time[-1]
    slowing = -np.polyfit(motion.time[late], motion.velocity[late, 1, 1], 1)[0]
    measured = float(slowing / GRAVITY)
    yield Probe(f"{partner}_friction", measured, contact.friction, "", 1e-3)


def _resting_and_sliding(
    engine: Engine, subject: Subject, partner: Partner, overlap: float
) -> Motion:
    """Two bodies as deep in the wall as they rest, the second pushed along it."""
    contact, time = subject.facing(partner), SLIDE_TIME * subject.rayleigh_time
    count = ceil(SLIDE_TIME / SLIDE_STEP)
    height = contact.radius - overlap
    if partner == "cylinder":
        height += contact.wall_radius
    speed = 7.0 * max(contact.friction, 0.1) * GRAVITY * time
    still = np.zeros((2, 3))
    bodies = Bodies(
        density=subject.density,
        centres=np.array([[0.0, 0.0, height], [0.0, 6.0 * contact.radius, height]]),
        velocities=np.array([[0.0, 0.0, 0.0], [0.0, speed, 0.0]]),
        spins=still,
        wall=_wall(partner),
        gravity=GRAVITY,
    )
    return move(engine, contact, bodies, Steps(time / count, count))


def _ranks_probe(engine: Engine, subject: Subject) -> Iterator[Probe]:
    """Two ranks, as the engine's own log counts them."""
    radius = subject.contact.radius
    centres = np.array([[0.0, 0.0, 0.0], [0.0, 20.0 * radius, 0.0]])
    bodies = Bodies(subject.density, centres, np.zeros((2, 3)), np.zeros((2, 3)))
    steps = Steps(SLIDE_STEP * subject.rayleigh_time, 10, ranks=2)
    ranks = ranks_of_motion(engine, subject.facing("pair"), bodies, steps)
    yield Probe("ranks", float(ranks), 2.0, "ranks", 0.0)


Run = Callable[[Engine, Subject], Iterator[Probe]]


def _of(run: Callable[[Engine, Subject, Partner], Iterator[Probe]], partner: Partner) -> Run:
    return lambda engine, subject: run(engine, subject, partner)


RUNS: Mapping[tuple[str, ...], Run] = {
    ("pair_restitution", "pair_energy"): _of(_impact_probes, "pair"),
    ("plane_restitution", "plane_energy"): _of(_impact_probes, "plane"),
    ("plane_overlap", "plane_force", "plane_friction"): _of(_rest_probes, "plane"),
    ("cylinder_restitution", "cylinder_energy"): _of(_impact_probes, "cylinder"),
    ("cylinder_overlap", "cylinder_force", "cylinder_friction"): _of(_rest_probes, "cylinder"),
    ("ranks",): _ranks_probe,
}
"""The runs by the probes that each yields."""

NAMES = tuple(name for names in RUNS for name in names)
"""All the probes."""

TANK = tuple(name for name in NAMES if name.startswith(("pair", "cylinder")))
"""The probes that a tank needs: grains, and the cylinder."""

PLANAR = tuple(name for name in NAMES if name.startswith(("pair", "plane")))
"""The probes that a closed box needs: grains, and plane walls."""


def probe(engine: Engine, subject: Subject, names: tuple[str, ...] = NAMES) -> Iterator[Probe]:
    """Run the probes of these names on an engine, outside of any MPI job.

    A probe whose run fails is yielded as failed. Raises InputError for an unknown name.
    """
    check_names(names)
    for together, run in RUNS.items():
        if set(together) & set(names):
            yield from (
                found for found in _tried(run, engine, subject, together) if found.name in names
            )


def check_names(names: tuple[str, ...]) -> None:
    """Raise InputError when one of these is not a probe."""
    for name in names:
        if name not in NAMES:
            raise InputError(f"There is no probe {name!r}; choose from {', '.join(NAMES)}.")


def _tried(run: Run, engine: Engine, subject: Subject, names: tuple[str, ...]) -> list[Probe]:
    try:
        return list(run(engine, subject))
    except CaseError:
        raise
    except InputError as error:
        failure = str(error)
    except RunFailed as error:
        failure = " ".join([error.reason, *error.evidence.splitlines()[-1:]])
    return [Probe(name, None, None, "", 0.0, failure) for name in names]
