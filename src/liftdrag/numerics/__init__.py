"""The numerics that a scene implies: time step, step counts, skin, each with its reason."""

from __future__ import annotations

from typing import overload

from liftdrag.numerics import drag2d, janssen, shear, tank
from liftdrag.numerics.drag2d import Drag2DNumerics
from liftdrag.numerics.janssen import JanssenNumerics
from liftdrag.numerics.shear import ShearNumerics
from liftdrag.numerics.tank import TankNumerics
from liftdrag.numerics.value import Numerics, Value, explained
from liftdrag.scene import Drag2DScene, JanssenScene, Scene, ShearScene, TankScene

__all__ = [
    "Drag2DNumerics",
    "JanssenNumerics",
    "Numerics",
    "ShearNumerics",
    "TankNumerics",
    "Value",
    "derive",
    "explained",
]


@overload
def derive(scene: TankScene, ranks: int = 1, settled: bool = False) -> TankNumerics: ...


@overload
def derive(scene: Drag2DScene, ranks: int = 1) -> Drag2DNumerics: ...


@overload
def derive(scene: JanssenScene, ranks: int = 1) -> JanssenNumerics: ...


@overload
def derive(scene: ShearScene, ranks: int = 1) -> ShearNumerics: ...


def derive(scene: Scene, ranks: int = 1, settled: bool = False) -> Numerics:
    """The numerics of `scene` on `ranks` processes; a tank's bed may be `settled` already.

    Raises CaseError when they cannot be.
    """
    if isinstance(scene, JanssenScene):
        return janssen.derive(scene, ranks)
    if isinstance(scene, Drag2DScene):
        return drag2d.derive(scene)
    if isinstance(scene, ShearScene):
        return shear.derive(scene)
    return tank.derive(scene, ranks, settled)
