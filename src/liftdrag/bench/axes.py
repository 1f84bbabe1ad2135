"""What a bench changes in a case: an axis for each choice, with its values."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import ceil, pi
from typing import Any, Literal

from liftdrag.case import Case
from liftdrag.cost import cores
from liftdrag.errors import InputError, shown
from liftdrag.numerics import derive
from liftdrag.scene import Drag2DScene, JanssenScene, ShearScene, TankScene

STEPS = (0.02, 0.05, 0.1, 0.2, 0.3, 0.4)
"""Time steps over the smaller of the Rayleigh and Hertz times."""

STIFFNESSES = (0.1, 0.32, 3.2, 10.0)
SPEEDS = (0.25, 0.5, 2.0, 4.0)
SHORTER, LONGER = 0.25, (0.5, 2.0, 3.0)

LAWS = ("granular", "hertz/history")
"""The two ways of LAMMPS to say the same contact."""

GRAINS, STRAINS = (0.5, 2.0), (0.5, 2.0)
"""Grains of a sheared cell, and its strain, over the case's own."""

SIDES = {"length": (0.6, 1.5), "thickness": (0.6, 1.6, 2.5), "height": (0.75, 1.5)}


@dataclass(frozen=True)
class Setting:
    """One value of an axis: its name, what the key then is in SI units, and what is changed."""

    name: str
    at: float | str
    changes: Mapping[str, Any]
    ranks: int = 1


@dataclass(frozen=True)
class Axis:
    """A choice of the case, its own value and others in ascending order.

    `careful` says at which end it does no harm, "" where the values have no such order. `of` ends
    the name of a value: "0.3" of the smaller time.
    """

    name: str
    key: str
    own: float | str
    settings: tuple[Setting, ...]
    careful: Literal["least", "most", ""]
    of: str = ""


def axes_of(case: Case, engine: str) -> tuple[Axis, ...]:
    """The axes of a case on the engine of this name."""
    scene = case.scene
    if isinstance(scene, TankScene):
        return tuple(_tank(scene, engine))
    if isinstance(scene, JanssenScene):
        return tuple(_janssen(scene))
    if isinstance(scene, ShearScene):
        return tuple(_shear(scene))
    return tuple(_drag2d(scene))


def wanted(names: Sequence[str], asked: Sequence[str]) -> list[str]:
    """The axes that are `asked` for of these names, all by default. Raises InputError."""
    for name in asked:
        if name not in names:
            raise InputError(
                f"There is no axis {shown(name)} of this case on this engine; choose from "
                f"{', '.join(names)}."
            )
    return list(asked or names)


def _tank(scene: TankScene, engine: str) -> Iterator[Axis]:
    numerics = derive(scene)
    smaller = min(numerics.rayleigh_time.value, numerics.hertz_time.value)
    step, sample = numerics.time_step.value, numerics.sample_every.value
    steps = tuple(_step(f"{share:g}", share * smaller) for share in STEPS)
    yield Axis("time_step", "numerics.time_step", step, steps, "least", "of the smaller time")
    yield _stiffness("grains.youngs_modulus", scene.grains.youngs_modulus)
    if engine in ("lammps", "lmp"):
        yield _pair_law(scene.numerics.pair_law)
    yield _speed(scene.drive.speed)
    for side, factors in SIDES.items():
        yield _side(scene, side, factors)
    strides = (1, 2 * sample, 4 * sample, 16 * sample)
    yield Axis("sampling", "numerics.sample_every", sample, tuple(map(_stride, strides)), "least")
    yield _ranks()


def _janssen(scene: JanssenScene) -> Iterator[Axis]:
    numerics, drive = derive(scene), scene.drive
    yield _time_step(numerics.time_step.value)
    key = "youngs_modulus" if scene.grains.contact == "hertz" else "stiffness"
    yield _stiffness(f"grains.{key}", numerics.stiffness.value)
    if drive.speed is not None:
        yield _speed(drive.speed)
    length, key = drive.distance, "drive.distance"
    if length is None:
        length, key = drive.duration, "drive.duration"
    if length is not None:
        yield Axis("averaging", key, length, _scaled(key, length, (0.5, 2.0, 4.0)), "most")
    yield _ranks()


def _drag2d(scene: Drag2DScene) -> Iterator[Axis]:
    yield _time_step(derive(scene).time_step.value)
    yield _stiffness("grains.youngs_modulus", scene.grains.youngs_modulus)
    yield _speed(scene.drive.speed)
    yield _width(scene)


def _shear(scene: ShearScene) -> Iterator[Axis]:
    yield _time_step(derive(scene).time_step.value)
    yield _stiffness("numerics.stiffness_factor", scene.numerics.stiffness_factor)
    yield _size(scene)
    key, strain = "drive.strain", scene.drive.strain
    yield Axis("averaging", key, strain, _scaled(key, strain, STRAINS), "most")
    yield _ranks()


def _step(name: str, value: float) -> Setting:
    return _set(name, "numerics.time_step", float(f"{value:.4g}"))


def _set(name: str, key: str, value: float) -> Setting:
    return Setting(name, value, {key: value})


def _scaled(key: str, own: float, factors: Sequence[float]) -> tuple[Setting, ...]:
    return tuple(_set(f"x{share:g}", key, float(f"{share * own:.6g}")) for share in factors)


def _time_step(own: float) -> Axis:
    settings = tuple(_step(f"x{share:g}", share * own) for share in (SHORTER, *LONGER))
    return Axis("time_step", "numerics.time_step", own, settings, "least")


def _stiffness(key: str, own: float) -> Axis:
    return Axis("stiffness", key, own, _scaled(key, own, STIFFNESSES), "most")


def _speed(own: float) -> Axis:
    return Axis("speed", "drive.speed", own, _scaled("drive.speed", own, SPEEDS), "least")


def _pair_law(own: str) -> Axis:
    key = "numerics.pair_law"
    others = tuple(Setting(law.replace("/", "-"), law, {key: law}) for law in LAWS if law != own)
    return Axis("pair_law", key, own, others, "")


def _side(scene: TankScene, side: str, factors: Sequence[float]) -> Axis:
    """Whole numbers of grains long, that a lid still fits."""
    key, own, d = f"tank.{side}", getattr(scene.tank, side), scene.grains.diameter
    counts = {f"x{share:g}": round(share * own / d) for share in factors}
    settings = [Setting(name, n * d, {key: f"{n} d"}) for name, n in counts.items()]
    return Axis(side, key, own, tuple(settings), "most")


def _stride(steps: int) -> Setting:
    return Setting(f"{steps}", float(steps), {"numerics.sample_every": steps})


def _width(scene: Drag2DScene) -> Axis:
    """A wider box that is as high and as full, and so holds more grains."""
    grains, own, share = scene.grains, scene.box.width, 1.5
    cylinder = pi * scene.intruder.diameter**2 / 4.0
    room = (share * own * scene.height - cylinder) * scene.box.solid_fraction
    count = ceil(room / grains.area * grains.count)
    width = float(f"{share * own:.6g}")
    wider = Setting(f"x{share:g}", width, {"box.width": width, "grains.count": count})
    return Axis("width", "box.width", own, (wider,), "most")


def _size(scene: ShearScene) -> Axis:
    """A cell of as many grains, or one whose given sides are longer alike."""
    count, cell = scene.cell.count, scene.cell
    if count is not None:
        counts = {f"x{share:g}": round(share * count) for share in GRAINS}
        settings = [Setting(name, n, {"cell.count": n}) for name, n in counts.items()]
        return Axis("size", "cell.count", count, tuple(settings), "most")
    sides = {f"cell.{name}": getattr(cell, name) for name in ("length", "height", "width")}
    settings = []
    for share in GRAINS:
        longer = {key: float(f"{side * share ** (1 / 3):.6g}") for key, side in sides.items()}
        settings.append(Setting(f"x{share:g}", longer["cell.length"], longer))
    return Axis("size", "cell.length", sides["cell.length"], tuple(settings), "most")


def _ranks() -> Axis:
    counts = [2**k for k in range(1, 16) if 2**k < cores()]
    counts += [cores()] if cores() > 1 else []
    settings = tuple(Setting(f"{n}", float(n), {}, ranks=n) for n in counts)
    return Axis("ranks", "--ranks", 1.0, settings, "")
