"""The stress around the cylinder (Guillard, Forterre and Pouliquen 2014, Figs. 11 and 12).

Angles are the paper's: 0 at the front, where grains come from, pi/2 below. The force of each
contact is shared out to the angles by a Gaussian, its shares normalised on the grid and its
components kept apart until then, so that the stress adds up to the mean drag and lift to rounding.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from liftdrag.analysis.blocks import Blocks
from liftdrag.analysis.fields import about_axis
from liftdrag.granular import GRAVITY
from liftdrag.scene import TankScene
from liftdrag.snapshot import ForceSnapshot

POINTS = 64
WIDTH = np.radians(8.0)
"""Standard deviation of the Gaussian."""

ANGLES = (np.arange(POINTS) + 0.5) * 2.0 * np.pi / POINTS - np.pi
NORMAL = np.column_stack([-np.cos(ANGLES), -np.sin(ANGLES)])
TANGENT = np.column_stack([np.sin(ANGLES), -np.cos(ANGLES)])
"""Out of the cylinder and along the growing angle, in x and z, (64, 2) each."""


def ring_forces(scene: TankScene, snapshot: ForceSnapshot) -> np.ndarray:
    """The force (64, 2) on the cylinder along x and z, N, that each angle has a share in."""
    touching = np.any(snapshot.wall != 0.0, axis=1)
    centres = about_axis(scene, snapshot.position[touching])
    angle = np.arctan2(-centres[:, 2], -centres[:, 0])
    apart = (ANGLES - angle[:, None] + np.pi) % (2.0 * np.pi) - np.pi
    share = np.exp(-0.5 * (apart / WIDTH) ** 2)
    share /= share.sum(axis=1, keepdims=True)
    return np.asarray(share.T @ -snapshot.wall[touching][:, [0, 2]])


@dataclass(frozen=True)
class Ring:
    """The ring forces (64, 2) in blocks of snapshots, and the `area` (m^2) of an angle's part."""

    blocks: Blocks
    area: float

    @classmethod
    def of(cls, scene: TankScene, blocks: Blocks) -> Ring:
        """Around the cylinder of a tank."""
        surface = np.pi * scene.intruder.diameter * scene.tank.thickness
        return cls(blocks, surface / POINTS)

    def normal(self) -> tuple[np.ndarray, np.ndarray]:
        """Normal stress (64,) on the cylinder in Pa, positive where it presses, and its errors."""
        return self.blocks.estimate(self.normal_of)

    def normal_of(self, forces: np.ndarray) -> np.ndarray:
        """That of ring forces (64, 2) in N."""
        return np.asarray(-np.sum(forces * NORMAL, axis=1) / self.area)

    def tangential(self) -> tuple[np.ndarray, np.ndarray]:
        """Tangential stress (64,) in Pa along the growing angle, and its errors."""
        return self.blocks.estimate(lambda forces: np.sum(forces * TANGENT, axis=1) / self.area)

    def peak(self) -> tuple[np.ndarray, np.ndarray]:
        """The largest normal stress (1,), Pa, and its error at the angle where it is found."""
        stress, error = self.normal()
        at = np.argmax(stress, keepdims=True)
        return stress[at], error[at]

    def forces(self) -> tuple[np.ndarray, np.ndarray]:
        """Drag and lift (2,) in N that the stresses add up to, and their errors."""
        return self.blocks.estimate(lambda forces: forces.sum(axis=0))

    def tangential_shares(self) -> tuple[np.ndarray, np.ndarray]:
        """What the tangential stress has of the drag and the lift, (2,), and its errors."""
        return self.blocks.estimate(_tangential_shares)


def _tangential_shares(forces: np.ndarray) -> np.ndarray:
    along = np.sum(forces * TANGENT, axis=1, keepdims=True) * TANGENT
    return np.asarray(along.sum(axis=0) / forces.sum(axis=0))


def mirrored(stress: np.ndarray) -> np.ndarray:
    """A stress (64,) at the angles mirrored by the horizontal plane through the axis."""
    return stress[::-1]


def predicted_lift(normal: np.ndarray, confining: float) -> float:
    """The lift over the buoyancy by the paper's eq. 4, from a normal stress (64,) without gravity.

    It takes the stress at each angle as proportional to the weight above it: the integral of the
    stress over the `confining` pressure (Pa) times sin^2, over pi. The buoyancy is that of the
    bulk, rho g pi D^2 L / 4, whatever gravity is then switched on.
    """
    step = 2.0 * np.pi / POINTS
    return float(np.sum(normal * np.sin(ANGLES) ** 2) * step / (np.pi * confining))


def weighted_stress(
    scene: TankScene, normal: np.ndarray, confining: float, bulk: float
) -> np.ndarray:
    """What eq. 4 adds to a normal stress (64,) without gravity, Pa, in a bulk of density `bulk`."""
    gradient = bulk * GRAVITY * scene.intruder.diameter / 2.0
    return np.asarray(normal / confining * gradient * np.sin(ANGLES))
