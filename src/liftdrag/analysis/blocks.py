"""Averages over snapshots that follow each other, with errors from blocks of them.

The error of anything that is made from the averages is that of the delete-one-block jackknife:
B. Efron, The Jackknife, the Bootstrap and Other Resampling Plans (1982), chapter 3.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

BLOCKS = 8
"""Blocks of equal length in time, long against what snapshots remember of each other."""


@dataclass(frozen=True)
class Blocks:
    """The `sums` (b, ...) over the snapshots of each block, and how many, `counts` (b,)."""

    sums: np.ndarray
    counts: np.ndarray

    @property
    def mean(self) -> np.ndarray:
        """Over all snapshots."""
        return np.asarray(self.sums.sum(axis=0) / self.counts.sum())

    def estimate(
        self, statistic: Callable[[np.ndarray], np.ndarray]
    ) -> tuple[np.ndarray, np.ndarray]:
        """A statistic of the mean, and its standard error; not a number with a single block."""
        total, count, number = self.sums.sum(axis=0), self.counts.sum(), len(self.counts)
        others = zip(total - self.sums, count - self.counts, strict=True)
        with np.errstate(divide="ignore", invalid="ignore"):
            without = np.array([statistic(one / left) for one, left in others])
            spread = ((without - without.mean(axis=0)) ** 2).sum(axis=0)
            found = statistic(total / count)
        error = np.sqrt((number - 1) / number * spread)
        return found, error if number > 1 else np.full_like(error, np.nan)


class BlockSums:
    """Adds up what comes at times from `start` to `end` (s), block by block."""

    def __init__(self, start: float, end: float, blocks: int = BLOCKS):
        self._start, self._length = start, (end - start) / blocks
        self._last = blocks - 1
        self._sums: dict[int, np.ndarray] = {}
        self._counts: dict[int, int] = {}

    def add(self, time: float, values: np.ndarray) -> None:
        """Add the values of a time."""
        block = min(int((time - self._start) / self._length), self._last)
        self._sums[block] = self._sums.get(block, 0.0) + values
        self._counts[block] = self._counts.get(block, 0) + 1

    def blocks(self) -> Blocks:
        """Those that something came in, of which there must be one."""
        kept = sorted(self._sums)
        counts = np.array([self._counts[block] for block in kept])
        return Blocks(np.array([self._sums[block] for block in kept]), counts)
