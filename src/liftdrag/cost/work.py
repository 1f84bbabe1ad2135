"""How much there is to compute: grains, steps and beds of a run, from its scene and numerics."""

from __future__ import annotations

from dataclasses import dataclass

from liftdrag.numerics import (
    Drag2DNumerics,
    JanssenNumerics,
    Numerics,
    ShearNumerics,
    TankNumerics,
)
from liftdrag.scene import Drag2DScene, JanssenScene, Scene, ShearScene, TankScene

SETTLED_AFTER = 1.2
"""Steps in which a packed bed comes to rest, over the least: 1.02 to 1.66 in 40 tanks."""


@dataclass(frozen=True)
class Work:
    """A bed's `grains` at the most, its `steps`, and its `grain_steps`, summed; so many `beds`."""

    grains: int
    steps: int
    grain_steps: float
    beds: int = 1


def work_of(scene: Scene, numerics: Numerics) -> Work:
    """What the numerics of a scene mean to an engine."""
    if isinstance(scene, TankScene) and isinstance(numerics, TankNumerics):
        return _tank(numerics)
    if isinstance(scene, Drag2DScene) and isinstance(numerics, Drag2DNumerics):
        grains, steps = scene.grains.count + 1, numerics.drive_steps.value
        return Work(grains, steps, float(grains * steps), scene.ensemble.runs)
    if isinstance(scene, ShearScene) and isinstance(numerics, ShearNumerics):
        return Work(scene.grain_count, numerics.drive_steps.value, numerics.grain_steps.value)
    assert isinstance(scene, JanssenScene)
    assert isinstance(numerics, JanssenNumerics)
    return Work(scene.grain_count, numerics.levels[-1].end, numerics.grain_steps.value)


def _tank(numerics: TankNumerics) -> Work:
    drive, least = numerics.drive_steps.value, numerics.settle_steps.value
    grains = numerics.grain_steps.value / (least + drive)
    steps = round(SETTLED_AFTER * least) + drive
    return Work(round(grains), steps, grains * steps)


def contacts_of(scene: Scene) -> str:
    """What the time of a grain-step depends on beside the engine: the law, or the shape."""
    if isinstance(scene, TankScene):
        return scene.numerics.pair_law
    if isinstance(scene, JanssenScene):
        return scene.grains.contact
    if isinstance(scene, ShearScene):
        shapes = " ".join(
            f"{one.aspect_ratio:g}" if one.aspect_ratio else one.shape for one in scene.species
        )
        return f"cylinder {shapes} at {scene.cell.solid_fraction:g}"
    ratio = f" {scene.grains.aspect_ratio:g}" if scene.grains.aspect_ratio else ""
    return f"{scene.grains.shape}{ratio} at {scene.box.solid_fraction:g}"
