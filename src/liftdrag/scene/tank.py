"""The tank: a bed of grains carried past a buried cylinder (Guillard et al. 2014, section III)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Literal

from pydantic import Field, model_validator

from liftdrag import granular
from liftdrag.errors import CaseError
from liftdrag.scene.choices import Choices
from liftdrag.scene.grains import Grains
from liftdrag.scene.intruder import Intruder
from liftdrag.scene.model import Part
from liftdrag.scene.quantities import Length, Speed
from liftdrag.scene.stop import Stop, Target

NEAREST_LID = 3.0
"""Depth in intruder diameters under which the cylinder would jam against the lid."""

LID_DEPTH = 16.0
"""Depth in intruder diameters at which the paper puts a lid; nearer, the lid is felt."""

WAKE = 8.0
"""Length in intruder diameters of the zone that the intruder disturbs."""

PACKED_FRACTION = 0.59
"""Solid fraction of the bed as packed, loose enough to settle to that of a poured one."""

SETTLED_FRACTION = 0.598
"""Solid fraction of a settled bed, of the grains that fill the tank to its height."""

FLOOR = 0.8
"""Height in grain diameters at which the random bed begins, in the hollows of the bottom layer."""

AXIS = 0.75
"""Place of the cylinder along the tank's length."""

FAR = (0.35, 0.55)
"""The far field along the tank's length: upstream of the cylinder, of what it will meet."""

TRANSIENT = 2.0
"""Displacement in intruder diameters before the flow is steady (the paper's section III A)."""

MAX_GRAINS = 20_000_000

STOPS = ("drag", "lift", "drag_coefficient", "lift_coefficient", "drag_coefficient_overburden")
"""What a run may be stopped by, when it is known well enough."""


class TankBox(Part):
    """The periodic `length` and `thickness`, and the `height` of the settled bed."""

    length: Length
    thickness: Length
    height: Length


class Lid(Part):
    """A square monolayer of heavy grains on the bed, free to move vertically.

    `density_ratio` is rho*/rho_g; without `bulk_gravity` only the lid has weight.
    """

    density_ratio: Annotated[float, Field(gt=1.0, le=1e4)]
    bulk_gravity: bool


class Drive(Part):
    """The bottom layer (and the lid) move at `speed` along x, over `distance`."""

    speed: Speed
    distance: Length


class FieldTable(Part):
    """How often grains and contacts are kept for fields, and what these are averaged over.

    `snapshots` over the drive once the flow may be steady; `window` is the radius of the sphere
    about a point, `spacing` the most between two points, a grain diameter each where not given.
    """

    snapshots: Annotated[int, Field(ge=8, le=10_000)] = 40
    window: Length | None = None
    spacing: Length | None = None


class TankScene(Part):
    """Everything that the drag and the lift on the cylinder depend on. Lengths in metres."""

    scene: Literal["tank"]
    seed: Annotated[int, Field(ge=0, lt=2**31)]
    grains: Grains
    tank: TankBox
    intruder: Intruder
    lid: Lid | None = None
    drive: Drive
    stop: Stop | None = None
    fields: FieldTable | None = None
    numerics: Choices = Choices()

    @property
    def bulk_gravity(self) -> float:
        """Gravity on the grains of the bed, m/s^2."""
        return granular.GRAVITY if self.lid is None or self.lid.bulk_gravity else 0.0

    @property
    def axis_height(self) -> float:
        """Height of the cylinder's axis above the tank's floor, m."""
        return self.tank.height - self.intruder.depth

    @property
    def axis_x(self) -> float:
        """Place of the cylinder's axis along the tank, m."""
        return AXIS * self.tank.length

    @property
    def far_field(self) -> tuple[float, float]:
        """Where along x (m) the far field lies."""
        return FAR[0] * self.tank.length, FAR[1] * self.tank.length

    @property
    def fresh_distance(self) -> float:
        """Displacement (m) after which grains that passed the cylinder enter the far field."""
        return (1.0 - AXIS + FAR[0]) * self.tank.length

    @property
    def lid_depth(self) -> float:
        """Depth (m) from which on the cylinder does not feel the lid."""
        return LID_DEPTH * self.intruder.diameter

    @property
    def far_band(self) -> tuple[float, float]:
        """Heights (m) between which the far field is bulk.

        2 D about the axis, but three grains clear of the bottom layer and the surface.
        """
        d, reach = self.grains.diameter, 2.0 * self.intruder.diameter
        high = min(self.axis_height + reach, self.tank.height - 3.0 * d)
        low = min(self.axis_height - reach, high - 4.0 * d)
        return max(low, 3.0 * d), high

    @property
    def grain_count(self) -> int:
        """Grains of the bed, without the bottom layer and the lid."""
        area = self.tank.length * (self.tank.height - FLOOR * self.grains.diameter)
        free = (area - self.intruder.section) * self.tank.thickness
        return round(SETTLED_FRACTION * free / granular.sphere_volume(self.grains.diameter))

    @property
    def packed_height(self) -> float:
        """Height (m) of the bed as packed, before it settles to the tank's height."""
        volume = self.grain_count * granular.sphere_volume(self.grains.diameter)
        area = volume / (PACKED_FRACTION * self.tank.thickness) + self.intruder.section
        return FLOOR * self.grains.diameter + area / self.tank.length

    @property
    def targets(self) -> Mapping[str, Target]:
        """How well each quantity must be known for the run to end early; none without a stop."""
        return self.stop.targets(STOPS) if self.stop else {}

    @model_validator(mode="after")
    def _check(self) -> TankScene:
        self.targets  # noqa: B018 - a stop that cannot be is refused
        _check_intruder(self)
        _check_tank(self)
        _check_lid(self)
        _check_drive(self)
        _check_fields(self)
        return self


def _under(value: float, bound: float) -> bool:
    """Less by more than the rounding of lengths that were given as multiples."""
    return value < bound * (1.0 - 1e-9)


def _check_intruder(scene: TankScene) -> None:
    d, intruder, height = scene.grains.diameter, scene.intruder, scene.tank.height
    radius = intruder.diameter / 2.0
    if _under(intruder.diameter, d):
        raise CaseError(
            "intruder.diameter",
            intruder.diameter,
            "the intruder is smaller than a grain, and grains would not feel a cylinder",
            f"make it at least grains.diameter = {d:.6g} m",
        )
    if _under(intruder.depth, radius):
        raise CaseError(
            "intruder.depth",
            intruder.depth,
            "the intruder lies above the surface",
            f"put its centre at least its radius, {radius:.6g} m, deep",
        )
    deepest = height - radius - 3.0 * d
    if _under(deepest, intruder.depth):
        raise CaseError(
            "intruder.depth",
            intruder.depth,
            f"the intruder does not fit into a bed of tank.height = {height:.6g} m "
            "with three grains below it",
            f"make the depth at most {max(deepest, 0.0):.6g} m, or the tank higher",
        )


def _check_tank(scene: TankScene) -> None:
    d, box = scene.grains.diameter, scene.tank
    wake = WAKE * scene.intruder.diameter
    if _under(box.length, wake):
        raise CaseError(
            "tank.length",
            box.length,
            f"the tank is shorter than the wake, {WAKE:g} intruder diameters",
            f"make it at least {wake:.6g} m",
        )
    low, high = scene.far_band
    if _under(high - low, 2.0 * d):
        raise CaseError(
            "tank.height",
            box.height,
            "the bed is too low to have a bulk between its surface and the bottom layer",
            f"make it at least eight grains, {8.0 * d:.6g} m, high",
        )
    if _under(box.thickness, 3.0 * d):
        raise CaseError(
            "tank.thickness",
            box.thickness,
            "across the periodic thickness a grain would touch its own image's neighbours",
            f"make it at least three grain diameters, {3.0 * d:.6g} m",
        )
    if scene.grain_count > MAX_GRAINS:
        raise CaseError(
            "tank.length",
            box.length,
            f"the tank would hold {scene.grain_count:.3g} grains",
            f"keep it under {MAX_GRAINS:.0e}; or check the units of the lengths",
        )


def _check_lid(scene: TankScene) -> None:
    nearest = NEAREST_LID * scene.intruder.diameter
    if scene.lid is not None and _under(scene.intruder.depth, nearest):
        raise CaseError(
            "intruder.depth",
            scene.intruder.depth,
            f"the lid is closer than {NEAREST_LID:g} intruder diameters to the intruder's centre",
            f"make the depth at least {nearest:.6g} m, or leave the lid out",
        )
    for name in ("length", "thickness"):
        _check_lid_fits(scene, f"tank.{name}", getattr(scene.tank, name))


def _check_lid_fits(scene: TankScene, key: str, side: float) -> None:
    d = scene.grains.diameter
    if scene.lid is not None and abs(side / d - round(side / d)) > 1e-6:
        raise CaseError(
            key,
            side,
            "a lid without gaps is a whole number of grains long",
            f"make it {round(side / d) * d:.6g} m, {round(side / d)} d",
        )


def _check_drive(scene: TankScene) -> None:
    least = 2.0 * TRANSIENT * scene.intruder.diameter
    if _under(scene.drive.distance, least):
        raise CaseError(
            "drive.distance",
            scene.drive.distance,
            f"the flow is steady after {TRANSIENT:g} intruder diameters, and little is left",
            f"make it at least {least:.6g} m",
        )


def _check_fields(scene: TankScene) -> None:
    if scene.fields is None:
        return
    d = scene.grains.diameter
    window, spacing = scene.fields.window or d, scene.fields.spacing or d
    if _under(window, d / 2.0):
        raise CaseError(
            "fields.window",
            window,
            "a window smaller than a grain sees one grain or none",
            f"make it at least half a grain diameter, {d / 2.0:.6g} m",
        )
    if _under(scene.tank.length / 8.0, window):
        raise CaseError(
            "fields.window",
            window,
            "a window across a quarter of the tank's length shows nothing",
            f"make it at most {scene.tank.length / 8.0:.6g} m; the paper's is a grain diameter",
        )
    if _under(spacing, d / 8.0) or _under(window, spacing):
        raise CaseError(
            "fields.spacing",
            spacing,
            "points so far apart miss grains, or are needlessly many",
            f"make it {d / 8.0:.6g} to {window:.6g} m, the window's radius",
        )
