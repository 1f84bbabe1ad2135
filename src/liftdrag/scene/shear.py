"""Shear flow of rods and disks in a sheared periodic cell (Liu et al., Energies 13 (2020) 1841).

Frictionless cylinders with flat ends, of one or more aspect ratios, and spheres, all of one
volume. The cell is periodic along the flow, x, and along z; across, along y, its neighbours slide
by (Lees-Edwards), so that the mean flow is v_x = rate (y - middle). Neither gravity nor walls.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import floor, hypot
from typing import Annotated, Literal

from pydantic import Field, model_validator

from liftdrag import granular
from liftdrag.errors import CaseError, at_least, at_most
from liftdrag.scene.model import Part
from liftdrag.scene.quantities import Density, Length, Modulus, Rate, Time
from liftdrag.scene.stop import Stop, Target

DENSEST = 0.6
"""Solid fraction up to which cylinders in no order can flow; the paper goes to 0.55."""

FEWEST, MOST = 20, 1_000_000
"""Grains of a cell."""

STOPS = ("shear_stress", "pressure", "bulk_friction")
"""What a run may be stopped by, when it is known well enough."""

ROOM = 0.5
"""Of d_v: by what a cell must be longer than its longest grain, for the neighbour lists."""

SHARES = 1e-6
"""What the sum of the shares may be off one by."""


class Cylinders(Part):
    """What all grains are made of, and the `diameter` of the sphere of their volume, d_v.

    Elastic grains would be heated by the shear for ever.
    """

    diameter: Length
    density: Density
    youngs_modulus: Modulus
    poisson_ratio: Annotated[float, Field(ge=0.0, lt=0.5)]
    restitution: Annotated[float, Field(gt=0.0, lt=1.0)]


class Species(Part):
    """Cylinders of one `aspect_ratio`, length over diameter, or spheres; their `share` of all."""

    shape: Literal["cylinder", "sphere"] = "cylinder"
    aspect_ratio: Annotated[float, Field(ge=0.05, le=20.0)] | None = None
    share: Annotated[float, Field(gt=0.0, le=1.0)]

    @property
    def is_rod(self) -> bool:
        """Whether it is longer than wide."""
        return self.aspect_ratio is not None and self.aspect_ratio > 1.0

    @property
    def is_sphere(self) -> bool:
        """Whether it has no axis."""
        return self.shape == "sphere"

    def sides(self, volume_diameter: float) -> tuple[float, float]:
        """Diameter and length (m) of a grain of the volume of this sphere, whose are the same."""
        if self.aspect_ratio is None:
            return volume_diameter, volume_diameter
        diameter = volume_diameter * float((2.0 / (3.0 * self.aspect_ratio)) ** (1.0 / 3.0))
        return diameter, self.aspect_ratio * diameter

    def span(self, volume_diameter: float) -> float:
        """Diameter (m) of the sphere about the grain."""
        diameter, length = self.sides(volume_diameter)
        return diameter if self.is_sphere else hypot(diameter, length)


class Cell(Part):
    """How full it is, and its sides along the flow, across and along z; or a `count` of grains.

    The sides of a `count` are equal.
    """

    solid_fraction: Annotated[float, Field(gt=0.001, le=DENSEST)]
    length: Length | None = None
    height: Length | None = None
    width: Length | None = None
    count: Annotated[int, Field(ge=FEWEST, le=MOST)] | None = None


class Shear(Part):
    """The rate (1/s), the strain at the end, and that from which on is averaged."""

    shear_rate: Rate
    strain: Annotated[float, Field(gt=0.0, le=1e5)]
    average_from: Annotated[float, Field(ge=0.0)]


class ShearChoices(Part):
    """The table `[numerics]` of a case; what is absent is derived.

    Contacts have `stiffness_factor` of the grains' modulus; a stress that does not depend on it
    comes cheaper by its root.
    """

    time_step: Time | None = None
    stiffness_factor: Annotated[float, Field(ge=1e-9, le=1.0)] = 1.0
    skin: Length | None = None
    sample_every: Annotated[int, Field(ge=1, le=1_000_000)] | None = None


class ShearScene(Part):
    """Everything that the stress depends on. Lengths in metres."""

    scene: Literal["shear"]
    seed: Annotated[int, Field(ge=0, lt=2**31)]
    grains: Cylinders
    cell: Cell
    species: Annotated[list[Species], Field(min_length=1, max_length=10)]
    drive: Shear
    stop: Stop | None = None
    numerics: ShearChoices = ShearChoices()

    @property
    def grain_volume(self) -> float:
        """Volume (m^3) of each grain."""
        return granular.sphere_volume(self.grains.diameter)

    @property
    def mass(self) -> float:
        """Mass (kg) of each grain."""
        return self.grains.density * self.grain_volume

    @property
    def grain_count(self) -> int:
        """Number of grains, the nearest to the solid fraction."""
        if self.cell.count is not None:
            return self.cell.count
        length, height, width = self.sides
        room = length * height * width
        return round(self.cell.solid_fraction * room / self.grain_volume)

    @property
    def counts(self) -> tuple[int, ...]:
        """Number of grains of each species: the nearest to the shares that sum to `grain_count`."""
        exact = [one.share * self.grain_count for one in self.species]
        found = [floor(number) for number in exact]
        order = sorted(range(len(exact)), key=lambda k: found[k] - exact[k])
        for k in order[: self.grain_count - sum(found)]:
            found[k] += 1
        return tuple(found)

    @property
    def sides(self) -> tuple[float, float, float]:
        """Sides (m) of the cell along x, y and z."""
        cell = self.cell
        if cell.count is not None:
            room = cell.count * self.grain_volume / cell.solid_fraction
            side = float(room ** (1.0 / 3.0))
            return side, side, side
        assert cell.length is not None
        assert cell.height is not None
        assert cell.width is not None
        return cell.length, cell.height, cell.width

    @property
    def volume(self) -> float:
        """Volume (m^3) of the cell."""
        length, height, width = self.sides
        return length * height * width

    @property
    def solid_fraction(self) -> float:
        """That of the whole grains in the cell."""
        return self.grain_count * self.grain_volume / self.volume

    @property
    def rod_fraction(self) -> float:
        """The paper's C: the share of grains that are rods."""
        return sum(one.share for one in self.species if one.is_rod)

    @property
    def is_of_spheres(self) -> bool:
        """Whether all grains are spheres."""
        return all(one.is_sphere for one in self.species)

    @property
    def longest(self) -> float:
        """Diameter (m) of the sphere about the longest grain."""
        return max(one.span(self.grains.diameter) for one in self.species)

    @property
    def stress_scale(self) -> float:
        """rho d_v^2 rate^2 (Pa), over which stresses are given."""
        return self.grains.density * (self.grains.diameter * self.drive.shear_rate) ** 2

    @property
    def targets(self) -> Mapping[str, Target]:
        """How well each quantity must be known for an early end; none without a stop."""
        return self.stop.targets(STOPS) if self.stop else {}

    @model_validator(mode="after")
    def _check(self) -> ShearScene:
        self.targets  # noqa: B018 - a stop that cannot be is refused
        _check_shapes(self.species)
        _check_sides(self.cell)
        _check_shares(self)
        _check_room(self)
        _check_window(self.drive)
        return self


def _check_shapes(species: Sequence[Species]) -> None:
    for number, one in enumerate(species):
        key, ratio = f"species.{number}.aspect_ratio", one.aspect_ratio
        if one.is_sphere and ratio is not None:
            raise CaseError(key, ratio, "a sphere has none", "leave it out, or leave out shape")
        if not one.is_sphere and ratio is None:
            raise CaseError(
                key, None, "a cylinder needs it", 'add length over diameter, or shape = "sphere"'
            )


def _check_sides(cell: Cell) -> None:
    sides = {"length": cell.length, "height": cell.height, "width": cell.width}
    missing = [name for name, side in sides.items() if side is None]
    if cell.count is None and missing:
        raise CaseError(
            f"cell.{missing[0]}", None, "the cell has no size", "add it, or a count of grains"
        )
    given = [name for name in sides if name not in missing]
    if cell.count is not None and given:
        raise CaseError(
            "cell.count",
            cell.count,
            f"the cell has a {given[0]} too, and both give its size",
            "leave one of them out",
        )


def _check_shares(scene: ShearScene) -> None:
    whole = sum(one.share for one in scene.species)
    if abs(whole - 1.0) > SHARES:
        raise CaseError("species", None, f"the shares sum to {whole:.6g}", "make them sum to 1")
    ratios = [one.aspect_ratio for one in scene.species]
    if len(set(ratios)) < len(ratios):
        raise CaseError(
            "species",
            None,
            "two of them have one aspect_ratio, or are spheres",
            "make them one, with both shares",
        )


def _check_room(scene: ShearScene) -> None:
    room = scene.longest + ROOM * scene.grains.diameter
    least = at_least(room)
    for name, side in zip(("length", "height", "width"), scene.sides, strict=True):
        if side <= room:
            key, value = f"cell.{name}", getattr(scene.cell, name)
            remedy = f"make it longer than {least} m, better twice that"
            if scene.cell.count is not None:
                key, value, remedy = "cell.count", scene.cell.count, "take more grains"
            raise CaseError(key, value, "the longest grain would touch its own image", remedy)
    if not FEWEST <= scene.grain_count <= MOST:
        raise CaseError(
            "cell.solid_fraction",
            scene.cell.solid_fraction,
            f"the cell would hold {scene.grain_count} grains",
            f"choose sides for {FEWEST} to {MOST} grains",
        )
    if 0 in scene.counts:
        raise CaseError(
            "species",
            None,
            f"of {scene.grain_count} grains, a share is less than one",
            "take a larger cell, or leave that species out",
        )


def _check_window(drive: Shear) -> None:
    if drive.average_from >= drive.strain:
        raise CaseError(
            "drive.average_from",
            drive.average_from,
            "nothing is left to average",
            f"make it less than drive.strain = {at_most(drive.strain)}",
        )
