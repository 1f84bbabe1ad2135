"""Ends a running engine cleanly, when its series so far is good enough."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

from liftdrag.engines.base import Enough
from liftdrag.errors import InputError
from liftdrag.files import text
from liftdrag.series import Series

STOP = "STOP"
"""The file that ends a run of LAMMPS where it is a stoppable one."""

STOP_DECK = "stop.lmp"
"""The file that LIGGGHTS reads after each piece of a run."""

GO, ENOUGH = "variable good_enough equal 0\n", "variable good_enough equal 1\n"

PRECISION = "precision"
"""What the file STOP says when liftdrag wrote it."""

SHARE = 0.05
"""Of the time on the clock, about this is spent on looking at the series."""

LEAST_S, MOST_S = 1.0, 20.0
"""Seconds between two looks."""


def stop_files(fill: int) -> tuple[str, str]:
    """The deck and the file that end the average of a fill, numbered from 1 on."""
    return f"stop-{fill}.lmp", f"{STOP}-{fill}"


def go_on(folder: Path, files: tuple[str, str] = (STOP_DECK, STOP)) -> None:
    """Take back that liftdrag had enough; what somebody else asked for stands."""
    deck, stop = (folder / name for name in files)
    if stop.exists() and text(stop) == PRECISION:
        if deck.exists():
            deck.write_text(GO, "utf-8")
        stop.unlink()


class Stopper:
    """Looks at the series of a run in `folder` now and then, and tells the engine to end."""

    def __init__(
        self,
        folder: Path,
        series: Callable[[], Series],
        enough: Enough | None,
        files: tuple[str, str] = (STOP_DECK, STOP),
    ):
        self._folder, self._series, self._enough, self._files = folder, series, enough, files
        self._next = time.monotonic() + LEAST_S

    def look(self) -> None:
        """Look, unless that was done a moment ago; a row that is being written is left out."""
        begin = time.monotonic()
        if self._enough is None or begin < self._next:
            return
        if self._is_enough(self._enough):
            self._stop()
            self._enough = None
        now = time.monotonic()
        self._next = now + min(max((now - begin) / SHARE, LEAST_S), MOST_S)

    def _is_enough(self, enough: Enough) -> bool:
        try:
            series = self._series()
        except (InputError, OSError, ValueError, LookupError):
            return False
        return len(series) > 1 and enough(series.first(len(series) - 1))

    def _stop(self) -> None:
        for name, content in zip(self._files, (ENOUGH, PRECISION), strict=True):
            beside = self._folder / f"{name}.part"
            beside.write_text(content, "utf-8")
            beside.replace(self._folder / name)
