"""What the deck of a tank with [fields] dumps: grains with their wall forces, and pairs."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from liftdrag.deck import Plan
from liftdrag.engines.family import read_dump
from liftdrag.snapshot import ForceSnapshot

GRAINS, CONTACTS = "fields.dump", "contacts.dump"

_WIDTH = 11
"""Columns of a grain: number, type, place, velocity and the force of the cylinder."""


def force_snapshots(plan: Plan, folder: Path) -> Iterator[ForceSnapshot]:
    """Those of the drive stage, in order of time. Raises ValueError where a file is damaged."""
    frames = zip(read_dump(folder / GRAINS), read_dump(folder / CONTACTS), strict=False)
    for (step, grains), (other, contacts) in frames:
        if step != other:
            raise ValueError(f"{GRAINS} has step {step} where {CONTACTS} has step {other}")
        yield _snapshot(step * plan.time_step, grains, contacts)


def _snapshot(time: float, grains: np.ndarray, contacts: np.ndarray) -> ForceSnapshot:
    """Of a pair the columns are the numbers of both grains, then vectors that add up to a force."""
    if not len(grains) or grains.shape[1] != _WIDTH:
        raise ValueError(f"{GRAINS} holds no rows of {_WIDTH} numbers")
    pair = _rows(grains[:, 0].astype(int), contacts[:, :2].astype(int))
    vectors = contacts[:, 2:].reshape(len(contacts), -1, 3)
    wall = grains[:, 8:11]
    return ForceSnapshot(time, grains[:, 2:5], grains[:, 5:8], wall, pair, vectors.sum(axis=1))


def _rows(numbers: np.ndarray, pair: np.ndarray) -> np.ndarray:
    """Where the grains of these numbers (m, 2) stand. Raises ValueError where one is missing."""
    order = np.argsort(numbers)
    place = np.minimum(np.searchsorted(numbers, pair, sorter=order), len(numbers) - 1)
    found = order[place]
    if np.any(numbers[found] != pair):
        raise ValueError(f"{CONTACTS} names a grain that {GRAINS} does not hold")
    return np.asarray(found)
