"""How far a case is pushed: an axis for each choice, from timid to reckless."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from liftdrag.bench.axes import Axis, Setting
from liftdrag.case import Case
from liftdrag.errors import InputError
from liftdrag.numerics import derive
from liftdrag.numerics.bounds import Bounds, bounds_of
from liftdrag.scene import JanssenScene, Scene, ShearScene

STEPS = (0.02, 0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.4, 0.5, 0.6, 0.7, 0.85, 1.0)
"""Time steps over the scale that the scene's own step is a share of."""

SAME = 0.05
"""Relative difference of two steps that are the same."""

STIFFNESSES = (0.1, 0.32, 3.2, 10.0)
RESTITUTIONS = (0.05, 0.1, 0.2, 0.4, 0.6, 0.8, 0.9, 1.0)
FRICTIONS = (0.0, 0.1, 0.3, 0.5, 0.7, 1.0)
SPEEDS = (0.1, 0.25, 4.0, 10.0)

SCALED = ("stiffness", "speed", "shear_rate")
"""Axes whose values are shown over the case's own."""

SEEDS = "seeds"
"""The axis whose points are runs of the case itself."""

UNCHANGED = ("time_step", SEEDS)
"""Axes on which the answer must stay what it is; elsewhere it may move with the physics."""


def axes_of(case: Case) -> tuple[Axis, ...]:
    """The axes of a case. Raises InputError when it has no numerics."""
    return tuple(_axes(case, bounds_of(case.scene)))


def _axes(case: Case, bounds: Bounds) -> Iterator[Axis]:
    scene = case.scene
    steps = tuple(_steps(case, bounds))
    own = bounds.own * bounds.scale
    yield Axis("time_step", "numerics.time_step", own, steps, "least", f"of {bounds.name}")
    key, stiffness = _stiffness(scene)
    yield _scaled("stiffness", key, stiffness, STIFFNESSES)
    yield _given("restitution", scene.grains.restitution, RESTITUTIONS)
    if isinstance(scene, ShearScene):
        yield _scaled("shear_rate", "drive.shear_rate", scene.drive.shear_rate, SPEEDS)
        return
    yield _given("friction", scene.grains.friction, FRICTIONS)
    if scene.drive.speed is not None:
        yield _scaled("speed", "drive.speed", scene.drive.speed, SPEEDS)


def _stiffness(scene: Scene) -> tuple[str, float]:
    """The key of the stiffness, and its value."""
    if isinstance(scene, ShearScene):
        return "numerics.stiffness_factor", scene.numerics.stiffness_factor
    if not isinstance(scene, JanssenScene):
        return "grains.youngs_modulus", scene.grains.youngs_modulus
    key = "youngs_modulus" if scene.grains.contact == "hertz" else "stiffness"
    return f"grains.{key}", derive(scene).stiffness.value


def _steps(case: Case, bounds: Bounds) -> Iterator[Setting]:
    """The steps, each where it is after rounding to whole rows; those that come out alike once."""
    seen = [bounds.own * bounds.scale]
    for share in STEPS:
        value = float(f"{share * bounds.scale * (1.0 - 1e-6):.6g}")
        at = _rounded(case.set("numerics.time_step", value), value)
        if all(abs(at / other - 1.0) > SAME for other in seen):
            seen.append(at)
            yield Setting(f"{at / bounds.scale:.2g}", at, {"numerics.time_step": value})


def _rounded(case: Case, asked: float) -> float:
    """The step (s) that a case runs at; the one `asked` for where that is refused."""
    try:
        return derive(case.scene).time_step.value
    except InputError:
        return asked


def _scaled(name: str, key: str, own: float, factors: Sequence[float]) -> Axis:
    values = {f"x{factor:g}": float(f"{factor * own:.6g}") for factor in factors}
    settings = tuple(Setting(label, value, {key: value}) for label, value in values.items())
    return Axis(name, key, own, settings, "")


def _given(name: str, own: float, values: Sequence[float]) -> Axis:
    key = f"grains.{name}"
    return Axis(name, key, own, tuple(Setting(f"{v:g}", v, {key: v}) for v in values), "")


def share_of(axis: Axis, at: float | str, case: Case) -> float:
    """A value in the unit in which the map shows it: of the scale, of the case's own, as it is."""
    if axis.name == "time_step":
        return float(at) / bounds_of(case.scene).scale
    return float(at) / float(axis.own) if axis.name in SCALED else float(at)
