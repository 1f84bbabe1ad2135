"""The state of a column of the in-house engine, kept now and then, so that a run can go on.

Two files by turns, each written whole or not at all. A run that goes on from one gives the bits of
a run that was never cut short.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import time
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from liftdrag.arrays import read_arrays
from liftdrag.deck.janssen import GRAINS, START

FILES = ("filling-a.npz", "filling-b.npz")

EVERY_S = 60.0
"""Seconds between two files, where these are written fast."""

SHARE = 0.01
"""Of the time of a run, at most this is spent on writing them."""


class Keeper:
    """Keeps the states of a run in `folder`."""

    def __init__(self, folder: Path):
        self._folder, self._turn = folder, 0
        self._deck = deck_digest(folder)
        self._next = time.monotonic() + EVERY_S

    def is_due(self) -> bool:
        """Whether it is time for a state to be kept."""
        return time.monotonic() >= self._next

    def keep(self, state: Mapping[str, np.ndarray]) -> None:
        """Keep a state: over the older file, in a single move. Raises OSError."""
        begin = time.monotonic()
        file = self._folder / FILES[self._turn]
        beside = file.with_suffix(".part")
        with beside.open("wb") as opened:
            np.savez(opened, allow_pickle=False, deck=np.array(self._deck), **state)
            opened.flush()
            os.fsync(opened.fileno())
        beside.replace(file)
        self._turn = 1 - self._turn
        now = time.monotonic()
        self._next = now + max(EVERY_S, (now - begin) / SHARE)

    def clear(self) -> None:
        """Remove what was kept: the run has ended well."""
        for name in FILES:
            (self._folder / name).unlink(missing_ok=True)


def latest(folder: Path) -> dict[str, np.ndarray] | None:
    """The later state that is whole and of the deck in the folder; None without one."""
    states = [_read(folder / name, deck_digest(folder)) for name in FILES]
    return max((one for one in states if one), key=lambda one: int(one["done"]), default=None)


def _read(file: Path, deck: str) -> dict[str, np.ndarray] | None:
    with contextlib.suppress(OSError, ValueError, LookupError):
        state = read_arrays(file)
        if str(state["deck"]) == deck:
            return state
    return None


def deck_digest(folder: Path) -> str:
    """SHA-256 of the deck of a column, none where there is none."""
    try:
        content = (folder / START).read_bytes() + (folder / GRAINS).read_bytes()
    except OSError:
        return ""
    return hashlib.sha256(content).hexdigest()
