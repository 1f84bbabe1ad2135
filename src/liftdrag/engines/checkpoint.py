"""The state of a run of the in-house engine, kept now and then, so that the run can go on.

Two files by turns, each written whole or not at all. A run that goes on from one gives the bits of
a run that was never cut short.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from liftdrag.arrays import read_arrays

FILES = ("state-a.npz", "state-b.npz")

EVERY_S = 60.0
"""Seconds between two files, where these are written fast."""

SHARE = 0.01
"""Of the time of a run, at most this is spent on writing them."""


class Keeper:
    """Keeps the states of a run in `folder`, whose deck are the files of these names."""

    def __init__(self, folder: Path, deck: Sequence[str]):
        self._folder, self._turn = folder, 0
        self._deck = digest([folder / name for name in deck])
        self._next = time.monotonic() + EVERY_S

    def latest(self) -> dict[str, np.ndarray] | None:
        """The later state that is whole and of the deck, None without one; the next spares it."""
        states = {name: self._read(name) for name in FILES}
        whole = {name: int(state["done"]) for name, state in states.items() if state is not None}
        if not whole:
            return None
        last = max(whole, key=lambda name: whole[name])
        self._turn = 1 - FILES.index(last)
        return states[last]

    def damaged(self) -> list[str]:
        """The files that are there and hold no state of the deck."""
        return [
            name for name in FILES if (self._folder / name).exists() and self._read(name) is None
        ]

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

    @contextlib.contextmanager
    def guarding(self, state: Callable[[], Mapping[str, np.ndarray]]) -> Iterator[None]:
        """Keep this state, where the disk allows it, when what is done meanwhile ends the run."""
        try:
            yield
        except BaseException:
            with contextlib.suppress(OSError):
                self.keep(state())
            raise

    def clear(self) -> None:
        """Remove what was kept: the run has ended well."""
        for file in (self._folder / name for name in FILES):
            file.unlink(missing_ok=True)
            file.with_suffix(".part").unlink(missing_ok=True)

    def _read(self, name: str) -> dict[str, np.ndarray] | None:
        with contextlib.suppress(OSError, ValueError, LookupError):
            state = read_arrays(self._folder / name)
            if str(state["deck"]) == self._deck:
                return state
        return None


def digest(files: Sequence[Path]) -> str:
    """SHA-256 of the files of a deck, none where one is missing."""
    try:
        content = b"".join(file.read_bytes() for file in files)
    except OSError:
        return ""
    return hashlib.sha256(content).hexdigest()
