"""Impacts of spheres on a wall or on each other, and what came of them."""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, cos, radians, sin

import numpy as np

from liftdrag import granular, hertz
from liftdrag.deck.bodies import Bodies, Steps, Wall
from liftdrag.deck.dialect import Contact
from liftdrag.engines.base import Engine
from liftdrag.engines.motion import Motion, move
from liftdrag.errors import InputError, RunFailed

APPROACH = 2.5
"""Steps before the bodies touch."""

LONGEST = 30.0
"""Duration of a contact over that of an elastic one, beyond which the bodies stick."""

MAX_STEPS = 400_000


@dataclass(frozen=True)
class Throw:
    """How a sphere is thrown: `speed` (m/s) at `angle` (degrees) to the normal, `spin` (rad/s).

    The spin is about tangent x normal: forward rolling is negative.
    """

    speed: float
    angle: float = 0.0
    spin: float = 0.0


@dataclass(frozen=True)
class Impact:
    """What an impact came to.

    Attributes:
        peak_force: largest normal force, N, by a parabola through the largest sample.
        peak_overlap: largest overlap, m, likewise.
        duration: of the contact, s.
        normal_restitution: closing speed after over before.
        tangential_restitution: tangential velocity of the centre, after over before;
            not a number when there was none before.
        tangential_velocity: of the centre afterwards, m/s.
        spin: afterwards, rad/s, about tangent x normal: forward rolling is negative.
        energy_ratio: kinetic energy, of rotation too, after over before.
    """

    peak_force: float
    peak_overlap: float
    duration: float
    normal_restitution: float
    tangential_restitution: float
    tangential_velocity: float
    spin: float
    energy_ratio: float


def impacts(
    engine: Engine,
    contact: Contact,
    density: float,
    throws: list[Throw],
    time_step: float,
    wall: Wall | None = None,
) -> list[Impact]:
    """The impacts of equal spheres on a wall or, without one, each on a mirrored twin.

    The twin has the opposite velocity and the opposite spin. The throws do not meet each
    other. Raises RunFailed when the engine fails or the bodies do not part, InputError
    when the time step is too small.
    """
    steps = _steps(contact, density, throws, time_step, wall)
    bodies = _bodies(contact, density, throws, steps, wall)
    while True:
        motion = move(engine, contact, bodies, steps)
        found = [_Pair(motion, contact, wall, index, len(throws)) for index in range(len(throws))]
        if all(pair.parted for pair in found):
            return [pair.impact(throw) for pair, throw in zip(found, throws, strict=True)]
        if steps.count * time_step > LONGEST * _duration(contact, density, throws, wall):
            raise RunFailed("engine_error", f"{engine.name}: the bodies did not part again.")
        steps = Steps(time_step, 2 * steps.count)
        bodies = _bodies(contact, density, throws, steps, wall)


def stiffness_and_mass(contact: Contact, density: float, wall: Wall | None) -> tuple[float, float]:
    """Hertz stiffness (N/m^1.5) and effective mass (kg) of the contact."""
    modulus = hertz.effective_modulus(contact.youngs_modulus, contact.poisson_ratio)
    mass = density * granular.sphere_volume(2.0 * contact.radius)
    if wall is None:
        return hertz.stiffness(modulus, contact.radius / 2.0), mass / 2.0
    if contact.rigid:
        modulus *= 2.0
    return hertz.stiffness(modulus, contact.radius), mass


def _duration(contact: Contact, density: float, throws: list[Throw], wall: Wall | None) -> float:
    """Duration (s) of the longest elastic impact among the throws."""
    k, mass = stiffness_and_mass(contact, density, wall)
    slowest = min(throw.speed * cos(radians(throw.angle)) for throw in throws)
    return hertz.hertz_time(k, mass, slowest * (2.0 if wall is None else 1.0))


def _steps(
    contact: Contact, density: float, throws: list[Throw], time_step: float, wall: Wall | None
) -> Steps:
    count = ceil(1.6 * _duration(contact, density, throws, wall) / time_step + 2.0 * APPROACH)
    if count > MAX_STEPS:
        raise InputError(
            f"time_step = {time_step:.3g} s makes {count:.2g} steps; take a larger one."
        )
    return Steps(time_step, count)


def _bodies(
    contact: Contact, density: float, throws: list[Throw], steps: Steps, wall: Wall | None
) -> Bodies:
    """The spheres, side by side along y and out of each other's reach; their twins below."""
    angle = np.radians([throw.angle for throw in throws])
    speed = np.array([throw.speed for throw in throws])
    spin = np.array([throw.spin for throw in throws])
    nothing = np.zeros(len(throws))
    velocity = np.column_stack([nothing, speed * np.sin(angle), -speed * np.cos(angle)])
    reach = 4.0 * contact.radius + 4.0 * speed.max() * steps.count * steps.time_step
    height = contact.radius - APPROACH * steps.time_step * velocity[:, 2]
    if wall == "cylinder":
        height += contact.wall_radius
    centres = np.column_stack([nothing, reach * np.arange(len(throws)), height])
    spins = np.column_stack([spin, nothing, nothing])
    if wall is None:
        centres = np.concatenate([centres, centres * [1.0, 1.0, -1.0]])
        velocity, spins = np.concatenate([velocity, -velocity]), np.concatenate([spins, -spins])
    return Bodies(density, centres, velocity, spins, wall)


class _Pair:
    """One sphere and its partner in a motion of several."""

    def __init__(self, motion: Motion, contact: Contact, wall: Wall | None, index: int, count: int):
        self.time, self.contact = motion.time, contact
        self.velocity, self.spin = motion.velocity[:, index], motion.spin[:, index, 0]
        centre, force = motion.position[:, index], motion.force[:, index]
        reach, partner = contact.radius, np.zeros_like(centre)
        self.closing = -self.velocity[:, 2]
        if wall is None:
            partner, reach = motion.position[:, index + count], 2.0 * contact.radius
            self.closing = motion.velocity[:, index + count, 2] - self.velocity[:, 2]
        between = centre - partner
        if wall == "plane":
            between = between * [0.0, 0.0, 1.0]
        elif wall == "cylinder":
            between, reach = between * [1.0, 0.0, 1.0], reach + contact.wall_radius
        distance = np.linalg.norm(between, axis=1)
        self.overlap = reach - distance
        self.normal_force = np.einsum("ij,ij->i", force, between) / distance

    @property
    def parted(self) -> bool:
        """Whether the bodies touched and are apart again."""
        return bool(self.overlap[-1] < 0.0 < self.overlap.max())

    def impact(self, throw: Throw) -> Impact:
        """What came of it."""
        tangential = float(self.velocity[-1, 1])
        before = throw.speed * sin(radians(throw.angle))
        return Impact(
            peak_force=_peak(self.normal_force),
            peak_overlap=_peak(self.overlap),
            duration=self._duration(),
            normal_restitution=float(-self.closing[-1] / self.closing[0]),
            tangential_restitution=tangential / before if before else float("nan"),
            tangential_velocity=tangential,
            spin=float(self.spin[-1]),
            energy_ratio=float(self._energy(-1) / self._energy(0)),
        )

    def _energy(self, frame: int) -> float:
        """Kinetic energy per mass, of translation and of rotation about x."""
        turning: float = 0.4 * (self.contact.radius * self.spin[frame]) ** 2
        return float(self.velocity[frame] @ self.velocity[frame]) + turning

    def _duration(self) -> float:
        touching = np.flatnonzero(self.overlap > 0.0)
        return self._crossing(touching[-1]) - self._crossing(touching[0] - 1)

    def _crossing(self, before: int) -> float:
        """When the overlap vanishes between a frame and the next."""
        one, other = self.overlap[before], self.overlap[before + 1]
        share = one / (one - other)
        return float(self.time[before] + share * (self.time[before + 1] - self.time[before]))


def _peak(values: np.ndarray) -> float:
    """The top of the parabola through the largest value and its neighbours."""
    top = int(np.clip(values.argmax(), 1, len(values) - 2))
    left, middle, right = values[top - 1 : top + 2]
    bend = left - 2.0 * middle + right
    return float(middle - (right - left) ** 2 / (8.0 * bend)) if bend else float(middle)
