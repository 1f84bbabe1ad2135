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
        normal_restitution: closing speed after over before, along the line of centres at
            the end and at the start of the contact.
        tangential_restitution: tangential velocity of the (first) sphere's centre, after
            over before; not a number when there was none before.
        tangential_velocity: of that centre afterwards, m/s.
        spin: of that sphere afterwards, rad/s, about tangent x normal: forward rolling is
            negative.
        energy_ratio: kinetic energy of all bodies, of rotation too, after over before.
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

    The twin has the opposite velocity and the opposite spin, and touches head-on: the line
    of centres is first along the normal that the angle is counted from. The throws do not
    meet each other. Raises RunFailed when the engine fails or the bodies do not part, InputError
    when the time step is too small.
    """
    steps = _steps(contact, density, throws, time_step, wall)
    bodies = _bodies(contact, density, throws, steps, wall)
    while True:
        motion = move(engine, contact, bodies, steps)
        found = [_Pair(motion, contact, wall, index, len(throws)) for index in range(len(throws))]
        if not all(pair.met for pair in found):
            raise RunFailed("engine_error", f"{engine.name}: the bodies did not touch.")
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
        approach = APPROACH * steps.time_step * velocity * [0.0, 1.0, 0.0]
        centres = np.concatenate([centres - approach, centres * [1.0, 1.0, -1.0] + approach])
        velocity, spins = np.concatenate([velocity, -velocity]), np.concatenate([spins, -spins])
    return Bodies(density, centres, velocity, spins, wall)


class _Pair:
    """One sphere and its partner in a motion of several."""

    def __init__(self, motion: Motion, contact: Contact, wall: Wall | None, index: int, count: int):
        self.time, self.radius = motion.time, contact.radius
        self.bodies = [index] if wall else [index, index + count]
        self.velocity, self.spin = motion.velocity[:, self.bodies], motion.spin[:, self.bodies]
        between, reach = _between(motion, contact, wall, index, count)
        distance = np.linalg.norm(between, axis=1)
        self.normal = between / distance[:, None]
        self.overlap = reach - distance
        self.normal_force = np.einsum("ij,ij->i", motion.force[:, index], self.normal)

    @property
    def met(self) -> bool:
        """Whether the bodies touched at all."""
        return bool(self.overlap.max() > 0.0)

    @property
    def parted(self) -> bool:
        """Whether the bodies touched and are apart again."""
        return bool(self.overlap[-1] < 0.0) and self.met

    def impact(self, throw: Throw) -> Impact:
        """What came of it."""
        touching = np.flatnonzero(self.overlap > 0.0)
        last = self.normal[touching[-1]]
        tangential = float(self.velocity[-1, 0] @ [0.0, last[2], -last[1]])
        before = throw.speed * sin(radians(throw.angle))
        return Impact(
            peak_force=_peak(self.normal_force),
            peak_overlap=_peak(self.overlap),
            duration=self._duration(),
            normal_restitution=-self._closing(-1, last)
            / self._closing(0, self.normal[touching[0]]),
            tangential_restitution=tangential / before if before else float("nan"),
            tangential_velocity=tangential,
            spin=float(self.spin[-1, 0, 0]),
            energy_ratio=self._energy(-1) / self._energy(0),
        )

    def _closing(self, frame: int, normal: np.ndarray) -> float:
        """Speed of approach along the normal; a wall stands still, a twin comes as fast."""
        return float(-self.velocity[frame, 0] @ normal)

    def _energy(self, frame: int) -> float:
        """Kinetic energy per mass of all the bodies, of translation and of rotation."""
        turning = 0.4 * (self.radius * self.spin[frame]) ** 2
        return float((self.velocity[frame] ** 2 + turning).sum())

    def _duration(self) -> float:
        touching = np.flatnonzero(self.overlap > 0.0)
        return self._crossing(touching[-1]) - self._crossing(touching[0] - 1)

    def _crossing(self, before: int) -> float:
        """When the overlap vanishes between a frame and the next."""
        one, other = self.overlap[before], self.overlap[before + 1]
        share = one / (one - other)
        return float(self.time[before] + share * (self.time[before + 1] - self.time[before]))


def _between(
    motion: Motion, contact: Contact, wall: Wall | None, index: int, count: int
) -> tuple[np.ndarray, float]:
    """From the partner to the sphere (t, 3), and the distance at which they touch."""
    centre = motion.position[:, index]
    if wall == "plane":
        return centre * [0.0, 0.0, 1.0], contact.radius
    if wall == "cylinder":
        return centre * [1.0, 0.0, 1.0], contact.radius + contact.wall_radius
    return centre - motion.position[:, index + count], 2.0 * contact.radius


def _peak(values: np.ndarray) -> float:
    """The top of the parabola through the largest value and its neighbours."""
    top = int(np.clip(values.argmax(), 1, len(values) - 2))
    left, middle, right = values[top - 1 : top + 2]
    bend = left - 2.0 * middle + right
    return float(middle - (right - left) ** 2 / (8.0 * bend)) if bend else float(middle)
