"""The scenes: what is simulated, in SI units, with no word on how."""

from liftdrag.scene.tank import TankScene

SCENES = {"tank": TankScene}
"""Scene name of a case file -> its model."""

__all__ = ["SCENES", "TankScene"]
