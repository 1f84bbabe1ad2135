"""What the in-house engine samples: a table in a run's folder, and how the run ended."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from liftdrag import dem
from liftdrag.series import Series
from liftdrag.tables import column, read_table

MOST_BYTES = 1_000_000
"""The largest table of numbers of a deck."""


@dataclass(frozen=True)
class Ran:
    """How a run ended: `status` of `dem`, steps done, deepest overlap over the smaller radius.

    `before` are the steps of the sessions before.
    """

    status: int
    steps: int
    deepest: float
    before: int = 0

    @property
    def evidence(self) -> str:
        """What it said last, where it did not finish."""
        if self.status == dem.FINE:
            return ""
        return (
            f"stopped after step {self.steps}, the deepest overlap {self.deepest:.3g} of the "
            "smaller radius"
        )


def write_samples(file: Path, channels: Iterable[str], interval: float, rows: np.ndarray) -> None:
    """Write the rows (r, c), one every `interval` (s), a column for each channel."""
    moment = np.arange(1, len(rows) + 1) * interval
    head = ",".join(["time", *channels])
    table = np.column_stack([moment, rows])
    np.savetxt(file, table, fmt="%.10g", delimiter=",", header=head, comments="")


def read_samples(file: Path, channels: Mapping[str, str]) -> Series:
    """The series of these channels with their units. Raises ValueError when rows are missing."""
    table = read_table(file, "csv")
    time = column(table, "time")
    if not np.allclose(time, time[0] * np.arange(1, len(time) + 1), rtol=1e-6):
        raise ValueError(f"{file}: its rows are not {time[0]:.6g} s apart")
    return Series(time, {name: column(table, name) for name in channels}, channels)
