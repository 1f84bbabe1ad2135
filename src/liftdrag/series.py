"""`Series`: named quantities against time, in the lab frame."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class Series:
    """Channels sampled at the same times.

    `time` (n,) in seconds, strictly increasing; `channels` name -> (n,) values;
    `units` name -> unit of each channel. Raises ValueError when they do not fit.
    """

    time: np.ndarray
    channels: Mapping[str, np.ndarray]
    units: Mapping[str, str]

    def __post_init__(self) -> None:
        if self.channels.keys() != self.units.keys():
            raise ValueError("each channel of a series needs a unit, and no other unit is given")
        for name, values in self.channels.items():
            if values.shape != self.time.shape:
                raise ValueError(f"channel {name} has shape {values.shape}, time {self.time.shape}")
        if np.any(np.diff(self.time) <= 0.0):
            raise ValueError("the times of a series must increase")

    def __len__(self) -> int:
        return len(self.time)

    def __getitem__(self, name: str) -> np.ndarray:
        return self.channels[name]

    def first(self, count: int) -> Series:
        """The first `count` samples."""
        return self.part(0, count)

    def part(self, start: int, stop: int) -> Series:
        """The samples from number `start` to before `stop`."""
        channels = {name: values[start:stop] for name, values in self.channels.items()}
        return Series(self.time[start:stop], channels, self.units)

    @property
    def interval(self) -> float:
        """Mean time between samples, in seconds."""
        return float(self.time[-1] - self.time[0]) / (len(self) - 1)

    def to_pandas(self) -> pd.DataFrame:
        """A table with the time as index and a column `name (unit)` for each channel."""
        import pandas as pd

        columns = {f"{name} ({self.units[name]})": values for name, values in self.channels.items()}
        return pd.DataFrame(columns, index=pd.Index(self.time, name="time (s)"))
