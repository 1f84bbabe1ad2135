"""Drag through a closed, pressurised bed of discs, dumbbells or ellipses (Zhou et al. 2007-2008).

Two-dimensional, without gravity. Grains of one size but for a uniform spread fill a box of given
width to a given solid fraction, which sets its height; a cylinder is pulled upward through them.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import pi, sqrt
from typing import Annotated, Literal

from pydantic import Field, model_validator

from liftdrag import hertz
from liftdrag.errors import CaseError, at_least, at_most
from liftdrag.scene.material import Material
from liftdrag.scene.model import Part
from liftdrag.scene.quantities import Length, Speed, Time
from liftdrag.scene.stop import Stop, Target

DENSEST = 0.95
"""Solid fraction that no random packing of these shapes comes near."""

MOST_ASPECT = 5.0
"""Aspect ratio up to which the contact of ellipses is tested."""

STOPS = ("drag", "lift", "irregularity")
"""What an ensemble may be stopped by, when it is known well enough."""


class PlanarGrains(Material):
    """`count` grains, each with the area of a disc of `diameter`, uniform within +- `spread`.

    A dumbbell is two equal discs that touch. An ellipse has an `aspect_ratio`, and `contact`
    says where two of them touch: at their common normal, or as the paper's section 2.3 reads.
    """

    shape: Literal["disc", "dumbbell", "ellipse"]
    count: Annotated[int, Field(ge=10, le=1_000_000)]
    diameter: Length
    spread: Annotated[float, Field(ge=0.0, le=0.5)]
    aspect_ratio: Annotated[float, Field(ge=1.0, le=MOST_ASPECT)] | None = None
    contact: Literal["common normal", "paper"] = "common normal"

    @property
    def stiffness(self) -> float:
        """Hertz stiffness (N/m^1.5) of a contact of two grains, or of two discs of dumbbells."""
        diameter = self.diameter / sqrt(2.0) if self.shape == "dumbbell" else self.diameter
        return hertz.pair_stiffness(self.youngs_modulus, self.poisson_ratio, diameter)

    @property
    def area(self) -> float:
        """Area (m^2) of all grains: the square of a uniform diameter, in `count` equal steps."""
        square = 1.0 + self.spread**2 / 3.0 * (1.0 - 1.0 / self.count**2)
        return self.count * pi * self.diameter**2 / 4.0 * square


class Box(Part):
    """`width` between the walls, `thickness` out of the plane, and how full it is.

    `solid_fraction` is the grains' area over that of the box without the cylinder.
    """

    width: Length
    thickness: Length
    solid_fraction: Annotated[float, Field(gt=0.1, lt=DENSEST)]


class Pulled(Part):
    """A cylinder of `diameter`, in the middle of the width, its centre at first `start` high."""

    diameter: Length
    start: Length


class Pull(Part):
    """Upward at `speed` over `distance`; what is averaged begins at `average_from`."""

    speed: Speed
    distance: Length
    average_from: Length


class Ensemble(Part):
    """`runs` random packings, or fewer where a stop ends them; the answer is their mean."""

    runs: Annotated[int, Field(ge=2, le=10_000)]


class PlanarChoices(Part):
    """The table `[numerics]` of a case; what is absent is derived."""

    time_step: Time | None = None
    skin: Length | None = None


class Drag2DScene(Part):
    """Everything that the drag on the cylinder depends on. Lengths in metres."""

    scene: Literal["drag2d"]
    seed: Annotated[int, Field(ge=0, lt=2**31)]
    grains: PlanarGrains
    box: Box
    intruder: Pulled
    drive: Pull
    ensemble: Ensemble
    stop: Stop | None = None
    numerics: PlanarChoices = PlanarChoices()

    @property
    def height(self) -> float:
        """Height (m) of the box that the solid fraction asks for."""
        cylinder = pi * self.intruder.diameter**2 / 4.0
        return (self.grains.area / self.box.solid_fraction + cylinder) / self.box.width

    @property
    def mass(self) -> float:
        """Mass (kg) of a grain of the mean diameter."""
        area = pi * self.grains.diameter**2 / 4.0
        return self.grains.density * area * self.box.thickness

    @property
    def targets(self) -> Mapping[str, Target]:
        """How well each quantity must be known for no more packings; none without a stop."""
        return self.stop.targets(STOPS) if self.stop else {}

    @model_validator(mode="after")
    def _check(self) -> Drag2DScene:
        self.targets  # noqa: B018 - a stop that cannot be is refused
        _check_shape(self.grains)
        _check_box(self)
        _check_path(self)
        return self


def _check_shape(grains: PlanarGrains) -> None:
    if grains.shape == "ellipse" and grains.aspect_ratio is None:
        raise CaseError(
            "grains.aspect_ratio", None, "an ellipse needs it", "add the long over the short axis"
        )
    if grains.shape != "ellipse" and grains.aspect_ratio is not None:
        raise CaseError(
            "grains.aspect_ratio",
            grains.aspect_ratio,
            f"a {grains.shape} has none",
            'leave it out, or set grains.shape = "ellipse"',
        )
    if grains.shape != "ellipse" and grains.contact != "common normal":
        raise CaseError(
            "grains.contact",
            grains.contact,
            f"a {grains.shape} has one way to touch",
            'leave it out, or set grains.shape = "ellipse"',
        )


def _check_box(scene: Drag2DScene) -> None:
    least = scene.intruder.diameter + 4.0 * scene.grains.diameter
    if scene.box.width < least:
        raise CaseError(
            "box.width",
            scene.box.width,
            "the grains cannot pass between the cylinder and the walls",
            f"make it at least the cylinder and four grains wide, {at_least(least)} m",
        )
    if scene.intruder.diameter < scene.grains.diameter:
        raise CaseError(
            "intruder.diameter",
            scene.intruder.diameter,
            "the intruder is smaller than a grain",
            f"make it at least grains.diameter = {at_least(scene.grains.diameter)} m",
        )


def _check_path(scene: Drag2DScene) -> None:
    radius, drive = scene.intruder.diameter / 2.0, scene.drive
    if scene.intruder.start < radius:
        raise CaseError(
            "intruder.start",
            scene.intruder.start,
            "the cylinder would begin in the floor",
            f"put its centre at least its radius, {at_least(radius)} m, high",
        )
    room = scene.height - radius - scene.intruder.start
    if room <= 0.0:
        raise CaseError(
            "intruder.start",
            scene.intruder.start,
            f"the cylinder would begin in the ceiling of the box, {scene.height:.4g} m high",
            "start lower, or make the box higher with more grains (grains.count)",
        )
    if drive.distance > room:
        raise CaseError(
            "drive.distance",
            drive.distance,
            f"the cylinder would hit the ceiling of the box, {scene.height:.4g} m high",
            f"make it at most {at_most(room)} m, or start lower",
        )
    if drive.average_from >= drive.distance:
        raise CaseError(
            "drive.average_from",
            drive.average_from,
            "nothing is left to average",
            f"make it less than drive.distance = {at_most(drive.distance)} m",
        )
