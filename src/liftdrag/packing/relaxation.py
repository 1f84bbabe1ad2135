"""Random centres pushed apart until they are those of spheres: a bed without pouring.

Soft, frictionless spheres of diameter one are relaxed until their overlaps have all but vanished.
Below random close packing (0.64) this takes a few hundred sweeps and leaves an amorphous bed that
the engine has only to settle.
"""

from __future__ import annotations

from math import sqrt
from typing import Protocol

import numpy as np

TOLERANCE = 2e-3
MAX_SWEEPS = 4000
SKIN = 0.35


class TooTight(ValueError):
    """The grains do not fit: they still `overlap`, in diameters."""

    def __init__(self, overlap: float):
        self.overlap = overlap
        super().__init__(f"grains still overlap by {overlap:.2g} d")


class Room(Protocol):
    """Where the grains are: its walls, its periods, and grains that do not move.

    Lengths in grain diameters; `period` (3,) is zero along an axis that has none, and `fixed`
    (m, 3) are centres.
    """

    @property
    def period(self) -> np.ndarray:
        """Periods along x, y and z."""

    @property
    def fixed(self) -> np.ndarray:
        """Centres of the grains that do not move."""

    def near(self, centres: np.ndarray, reach: float) -> np.ndarray:
        """Pairs (p, 2) of the centres, the fixed ones last, nearer than `reach`."""

    def push(self, x: np.ndarray, force: np.ndarray) -> float:
        """Add the walls' forces on the grains x (n, 3); returns the largest overlap."""


def relaxed(room: Room, start: np.ndarray) -> np.ndarray:
    """The centres (n, 3) pushed apart, by inertial relaxation (FIRE). Raises TooTight."""
    return _Relaxation(room, start).run()


def _dot(one: np.ndarray, other: np.ndarray) -> float:
    """Sum of products, on this thread alone: BLAS would wait for threads that others keep busy."""
    return float(np.einsum("ij,ij", one, other))


class _Relaxation:
    def __init__(self, room: Room, centres: np.ndarray):
        self.room = room
        self.x = centres
        self._find_pairs()

    def run(self) -> np.ndarray:
        velocity = np.zeros_like(self.x)
        step, alpha, downhill = 0.1, 0.1, 0
        for _ in range(MAX_SWEEPS):
            force, worst = self._forces()
            if worst < TOLERANCE:
                return self._wrapped()
            power = _dot(force, velocity)
            if power > 0.0:
                downhill += 1
                if downhill > 5:
                    step, alpha = min(1.1 * step, 0.5), 0.99 * alpha
            else:
                velocity[:] = 0.0
                step, alpha, downhill = max(0.5 * step, 0.05), 0.1, 0
            velocity += step * force
            scale = sqrt(_dot(velocity, velocity) / max(_dot(force, force), 1e-300))
            velocity = (1.0 - alpha) * velocity + alpha * scale * force
            move = np.clip(step * velocity, -0.1, 0.1)
            self.x += move
            self._follow(move)
        raise TooTight(worst)

    def _wrapped(self) -> np.ndarray:
        x, along = self.x.copy(), self.room.period > 0.0
        x[:, along] %= self.room.period[along]
        return x

    def _follow(self, move: np.ndarray) -> None:
        self.moved += np.sqrt((move**2).sum(axis=1).max())
        if self.moved > SKIN / 2:
            self._find_pairs()

    def _find_pairs(self) -> None:
        """Neighbour pairs (i, j) of mobile grains, then of mobile grains and the fixed ones."""
        pairs = self.room.near(np.concatenate([self.x, self.room.fixed]), 1.0 + SKIN)
        self.i, self.j = pairs[pairs.min(axis=1) < len(self.x)].T
        self.moved = 0.0

    def _forces(self) -> tuple[np.ndarray, float]:
        n, period = len(self.x), self.room.period
        every = np.concatenate([self.x, self.room.fixed])
        r = every[self.i] - every[self.j]
        for axis in map(int, np.flatnonzero(period)):
            r[:, axis] -= period[axis] * np.rint(r[:, axis] / period[axis])
        distance = np.sqrt((r * r).sum(axis=1))
        touching = distance < 1.0
        i, j, r, distance = self.i[touching], self.j[touching], r[touching], distance[touching]
        push = r * ((1.0 - distance) / np.maximum(distance, 1e-12))[:, None]
        force = np.empty((n, 3))
        for axis in range(3):
            every_force = np.bincount(i, push[:, axis], len(every))
            every_force -= np.bincount(j, push[:, axis], len(every))
            force[:, axis] = every_force[:n]
        worst = float((1.0 - distance).max(initial=0.0))
        return force, max(worst, self.room.push(self.x, force))
