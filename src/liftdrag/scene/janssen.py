"""The Janssen piston: grains in a tube, on a piston that carries what the wall does not.

Janssen 1895; the set-up is that of Walton 2004 and of discrete-element simulations of it. The
piston moves slowly against the tube, so that the friction of the wall is mobilised.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import hypot, log, pi, sqrt
from typing import Annotated, Literal

from pydantic import Field, model_validator

from liftdrag import granular, hertz
from liftdrag.errors import CaseError, at_least, at_most
from liftdrag.scene.model import Part
from liftdrag.scene.quantities import Density, Length, Mass, Modulus, Speed, Stiffness, Time
from liftdrag.scene.stop import Stop, Target

SETTLED_FRACTION = 0.62
"""Solid fraction expected of a settled column over (1 - d/(2 D))^2: the wall keeps grains away.

0.574 at D/d = 13.3, as measured.
"""

LOOSEST = 0.92
"""Solid fraction of the loosest settled column, which is the highest, over the expected one."""

LEAST_RESTITUTION = 0.01

MOST_GRAINS = 5_000_000

STOPS = ("apparent_mass",)
"""What the average of a fill may be stopped by, when it is known well enough."""

TANGENTIAL_RATIO = 2.0 / 7.0
"""Tangential over normal stiffness of the linear contact."""

ContactLaw = Literal["linear", "hertz", "walton-braun"]


class TubeGrains(Part):
    """Monodisperse spheres, and the law of their contacts.

    `contact` is "linear" (spring and dashpot), "hertz" (Hertz-Mindlin), or "walton-braun"
    (Walton and Braun's partially latching spring), each of constant `restitution`. `stiffness` is
    the spring's, of Walton-Braun in loading; it, or the `youngs_modulus` of Hertz, is derived
    from a bound on the overlap when absent.
    """

    diameter: Length
    density: Density
    restitution: Annotated[float, Field(ge=LEAST_RESTITUTION, le=1.0)]
    friction: Annotated[float, Field(ge=0.0, le=10.0)]
    contact: ContactLaw
    stiffness: Stiffness | None = None
    youngs_modulus: Modulus | None = None
    poisson_ratio: Annotated[float, Field(ge=0.0, lt=0.5)] | None = None

    @property
    def mass(self) -> float:
        """Mass of a grain, kg."""
        return self.density * granular.sphere_volume(self.diameter)

    def dashpot(self, stiffness: float, effective_mass: float) -> float:
        """Damping (kg/s) that gives a linear spring (N/m) the restitution, at this mass (kg)."""
        lost = -log(self.restitution)
        return 2.0 * lost / hypot(pi, lost) * sqrt(stiffness * effective_mass)

    def hertz_stiffness(self, youngs_modulus: float) -> float:
        """Hertz stiffness (N/m^1.5) of two grains of this modulus, Pa."""
        return hertz.pair_stiffness(youngs_modulus, self.poisson_ratio or 0.0, self.diameter)


class Tube(Part):
    """A smooth cylinder wall: inner `diameter`, `height` above the piston, and its `friction`."""

    diameter: Length
    height: Length
    friction: Annotated[float, Field(ge=0.0, le=10.0)]

    @property
    def section(self) -> float:
        """Area of the cross-section, m^2."""
        return pi * self.diameter**2 / 4.0


class Fill(Part):
    """How much the tube holds at last: a `mass`, or the `height` of the settled column.

    With `curve` it is filled in `levels` equal steps, and weighed at each.
    """

    mass: Mass | None = None
    height: Length | None = None
    curve: bool = True
    levels: Annotated[int, Field(ge=2, le=64)] = 8


class PistonDrive(Part):
    """What moves: the piston or the tube at `speed`, averaged over `distance` at each fill.

    `mobilise` is the way before that, over which the wall's friction comes to its limit. At
    rest (`motion` "none") the average takes `duration` instead.
    """

    motion: Literal["piston down", "tube up", "piston up", "none"]
    speed: Speed | None = None
    distance: Length | None = None
    mobilise: Length | None = None
    duration: Time | None = None


class Overload(Part):
    """A lid: one layer of grains, glued together, that does not touch the wall; its `mass`.

    It moves vertically and does not tilt.
    """

    mass: Mass


class PistonChoices(Part):
    """The table `[numerics]` of a case; what is absent is derived.

    `overlap_bound` is the largest overlap over d from which a stiffness is derived.
    """

    time_step: Time | None = None
    skin: Length | None = None
    settle_time: Time | None = None
    restart_every: Annotated[int, Field(ge=1, le=2_000_000_000)] | None = None
    overlap_bound: Annotated[float, Field(ge=1e-6, le=0.05)] | None = None


class JanssenScene(Part):
    """Everything that the force on the piston depends on. Lengths in metres."""

    scene: Literal["janssen"]
    seed: Annotated[int, Field(ge=0, lt=2**31)]
    grains: TubeGrains
    tube: Tube
    fill: Fill
    drive: PistonDrive
    overload: Overload | None = None
    stop: Stop | None = None
    numerics: PistonChoices = PistonChoices()

    @property
    def wall_speed(self) -> float:
        """Velocity (m/s) of the tube, upward, in the frame of the piston.

        A piston that moves down and a tube that moves up are the same there.
        """
        speed = self.drive.speed or 0.0
        return -speed if self.drive.motion == "piston up" else speed

    @property
    def settled_fraction(self) -> float:
        """Solid fraction expected of a settled column."""
        return SETTLED_FRACTION * (1.0 - 0.5 * self.grains.diameter / self.tube.diameter) ** 2

    @property
    def bulk_density(self) -> float:
        """Density (kg/m^3) expected of a settled column."""
        return self.settled_fraction * self.grains.density

    @property
    def grain_count(self) -> int:
        """Grains at the last fill."""
        return max(round(self._mass / self.grains.mass), 1)

    @property
    def _mass(self) -> float:
        if self.fill.mass is not None:
            return self.fill.mass
        return self.bulk_density * self.tube.section * (self.fill.height or 0.0)

    @property
    def counts(self) -> tuple[int, ...]:
        """Grains at each fill, ascending."""
        levels = self.fill.levels if self.fill.curve else 1
        return tuple(max(round(self.grain_count * k / levels), 1) for k in range(1, levels + 1))

    @property
    def masses(self) -> tuple[float, ...]:
        """Mass (kg) of the grains at each fill."""
        return tuple(count * self.grains.mass for count in self.counts)

    @property
    def lid_mass(self) -> float:
        """Mass (kg) of the overload, zero without one."""
        return self.overload.mass if self.overload else 0.0

    def height_of(self, count: int, share: float = 1.0) -> float:
        """Height (m) of so many grains at a share of the solid fraction expected."""
        volume = count * granular.sphere_volume(self.grains.diameter)
        return volume / (share * self.settled_fraction * self.tube.section)

    @property
    def targets(self) -> Mapping[str, Target]:
        """How well each fill's load must be known for its average to end; none without a stop."""
        return self.stop.targets(STOPS) if self.stop else {}

    @model_validator(mode="after")
    def _check(self) -> JanssenScene:
        self.targets  # noqa: B018 - a stop that cannot be is refused
        _check_law(self.grains)
        _check_tube(self)
        _check_fill(self)
        _check_motion(self.drive)
        return self


def _check_law(grains: TubeGrains) -> None:
    is_hertz = grains.contact == "hertz"
    strangers = ("stiffness",) if is_hertz else ("youngs_modulus", "poisson_ratio")
    for name in strangers:
        if getattr(grains, name) is not None:
            raise CaseError(
                f"grains.{name}",
                getattr(grains, name),
                f'the contact "{grains.contact}" has none',
                "leave it out, or choose another grains.contact",
            )
    if is_hertz and grains.poisson_ratio is None:
        raise CaseError(
            "grains.poisson_ratio", None, "a Hertz contact needs it", "add it, between 0 and 0.5"
        )


def _check_tube(scene: JanssenScene) -> None:
    least = 2.0 * scene.grains.diameter
    if scene.tube.diameter < least * (1.0 - 1e-9):
        raise CaseError(
            "tube.diameter",
            scene.tube.diameter,
            "the tube is thinner than two grains",
            f"make it at least {at_least(least)} m",
        )
    clear = 4.0 * scene.grains.diameter
    if scene.overload is not None and scene.tube.diameter < clear * (1.0 - 1e-9):
        raise CaseError(
            "tube.diameter",
            scene.tube.diameter,
            "an overload clear of the wall needs a tube four grains wide",
            f"make it at least {at_least(clear)} m, or leave the overload out",
        )


def _check_fill(scene: JanssenScene) -> None:
    fill, grains = scene.fill, scene.grains
    if (fill.mass is None) == (fill.height is None):
        raise CaseError("fill", None, "a fill has a mass or a height", "give one of the two")
    key, given = ("fill.mass", fill.mass) if fill.mass is not None else ("fill.height", fill.height)
    unit = "kg" if fill.mass is not None else "m"
    if scene.grain_count < len(scene.counts) or scene._mass < 0.5 * grains.mass:
        raise CaseError(
            key,
            given,
            "this is less than a grain at each fill",
            f"fill at least {len(scene.counts) * grains.mass:.4g} kg, or lower fill.levels",
        )
    if scene.grain_count > MOST_GRAINS:
        raise CaseError(
            key,
            given,
            f"this is {scene.grain_count:.3g} grains",
            f"keep it under {MOST_GRAINS:.0e}; or check the units",
        )
    height = scene.height_of(scene.grain_count, LOOSEST)
    height += grains.diameter if scene.overload else 0.0
    if height > scene.tube.height:
        share = scene.tube.height / height
        raise CaseError(
            key,
            given,
            f"this is {height:.4g} m high where loose, and the tube {scene.tube.height:.4g} m",
            f"make it at most {at_most(share * (given or 0.0))} {unit}, or raise tube.height",
        )


def _check_motion(drive: PistonDrive) -> None:
    moving = drive.motion != "none"
    needed = ("speed", "distance") if moving else ("duration",)
    strangers = ("duration",) if moving else ("speed", "distance", "mobilise")
    for name in needed:
        if getattr(drive, name) is None:
            raise CaseError(
                f"drive.{name}", None, f'the motion "{drive.motion}" needs it', "add it"
            )
    for name in strangers:
        if getattr(drive, name) is not None:
            raise CaseError(
                f"drive.{name}",
                getattr(drive, name),
                f'the motion "{drive.motion}" has none',
                "leave it out",
            )
