"""The fills of a column as they were: the average of each may end before it was planned to."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from pathlib import Path

from liftdrag.deck import Plan
from liftdrag.engines.base import Enough
from liftdrag.engines.log import LogTail
from liftdrag.engines.stopper import Stopper, stop_files
from liftdrag.series import Series

FILLS = "fills.csv"
"""The file that an engine leaves of them."""

Fill = tuple[int, int, int, int]
"""The grains, and the steps of the start and of those between which it is averaged."""

_HEAD = "grains,start,mobilised,end"
_END = re.compile(r"^LIFTDRAG FILL \d+ averaged to step (\d+)$", re.MULTILINE)


def ends_in(log: str) -> list[int]:
    """The steps at which the averages ended, as the log of a stoppable column says."""
    return [int(step) for step in _END.findall(log)]


def averaged_from(plan: Plan, ends: Sequence[int]) -> int:
    """The step from which the fill is averaged before which averages ended at these steps."""
    _, start, mobilised, _ = plan.fills[len(ends)]
    return (ends[-1] if ends else 0) + mobilised - start


def as_they_were(plan: Plan, ends: Sequence[int]) -> list[Fill]:
    """The fills whose averages ended at these steps; all else took as long as planned."""
    starts = [0, *ends[:-1]]
    return [
        (plan.fills[k][0], starts[k], averaged_from(plan, ends[:k]), end)
        for k, end in enumerate(ends[: len(plan.fills)])
    ]


def early(plan: Plan, fills: Sequence[Fill]) -> list[int]:
    """The numbers, from 1 on, of the fills that were averaged for less than planned."""
    pairs = enumerate(zip(plan.fills, fills, strict=False), start=1)
    return [number for number, (one, other) in pairs if other[3] - other[2] < one[3] - one[2]]


def write_fills(folder: Path, fills: Sequence[Fill]) -> None:
    """Write them, a row each, as CSV."""
    rows = [",".join(map(str, fill)) for fill in fills]
    (folder / FILLS).write_text("\n".join([_HEAD, *rows, ""]), "utf-8")


def read_fills(folder: Path) -> list[Fill]:
    """What `write_fills` wrote."""
    rows = [row.split(",") for row in (folder / FILLS).read_text("utf-8").splitlines()[1:]]
    return [(int(count), int(a), int(b), int(c)) for count, a, b, c in rows]


class FillStopper:
    """Looks at the average of each fill as it grows, and tells the engine to go on to the next."""

    def __init__(
        self,
        plan: Plan,
        folder: Path,
        tail: LogTail,
        series: Callable[[], Series],
        enough: Enough,
    ):
        self._plan, self._folder, self._tail = plan, folder, tail
        self._series, self._enough = series, enough
        self._ends: list[int] = []
        self._stopper: Stopper | None = self._next()

    def look(self) -> None:
        """Look, unless that was done a moment ago."""
        new = ends_in("\n".join(self._tail.lines()))
        if new:
            self._ends += new
            self._stopper = self._next()
        if self._stopper is not None:
            self._stopper.look()

    def _next(self) -> Stopper | None:
        """That of the fill under way, which sees what is averaged of it; none after the last."""
        done = len(self._ends)
        if done == len(self._plan.fills):
            return None
        begin = averaged_from(self._plan, self._ends) * self._plan.time_step
        files = stop_files(done + 1)
        return Stopper(self._folder, lambda: _after(self._series(), begin), self._enough, files)


def _after(series: Series, begin: float) -> Series:
    """The samples later than a time, s."""
    late = series.time > begin
    channels = {name: values[late] for name, values in series.channels.items()}
    return Series(series.time[late], channels, series.units)
