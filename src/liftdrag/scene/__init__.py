"""The scenes: what is simulated, in SI units, with no word on how."""

from liftdrag.scene.drag2d import Drag2DScene
from liftdrag.scene.janssen import JanssenScene
from liftdrag.scene.shear import ShearScene
from liftdrag.scene.tank import TankScene

Scene = TankScene | Drag2DScene | JanssenScene | ShearScene

SCENES: dict[str, type[Scene]] = {
    "tank": TankScene,
    "drag2d": Drag2DScene,
    "janssen": JanssenScene,
    "shear": ShearScene,
}
"""Scene name of a case file -> its model."""

__all__ = ["SCENES", "Drag2DScene", "JanssenScene", "Scene", "ShearScene", "TankScene"]
