"""The scenes: what is simulated, in SI units, with no word on how."""

from liftdrag.scene.drag2d import Drag2DScene
from liftdrag.scene.tank import TankScene

SCENES: dict[str, type[TankScene] | type[Drag2DScene]] = {
    "tank": TankScene,
    "drag2d": Drag2DScene,
}
"""Scene name of a case file -> its model."""

Scene = TankScene | Drag2DScene

__all__ = ["SCENES", "Drag2DScene", "Scene", "TankScene"]
