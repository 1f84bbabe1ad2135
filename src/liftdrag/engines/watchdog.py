"""Ends a run that has taken too long, or whose engine has written nothing for too long."""

from __future__ import annotations

import os
import time
from collections.abc import Iterable
from dataclasses import dataclass
from math import inf
from pathlib import Path

from liftdrag.errors import InputError, RunFailed

SILENCE = "LIFTDRAG_STALL_S"
"""The environment variable that sets the silence allowed, in seconds; inf for any."""

LEAST_SILENCE_S = 600.0

SILENT_SHARE = 0.05
"""The share of a run's expected time for which an engine may be silent: its log has 200 lines."""

LOOK_S = 1.0
"""Time between two looks counts as this at most: a machine that slept was not silent."""


@dataclass(frozen=True)
class Limits:
    """How long a run may take, and how long its engine may write nothing (s)."""

    run_s: float = inf
    silence_s: float = inf


FOREVER = Limits()


def limits(run_s: float | None, expected_s: float) -> Limits:
    """Those of a run that should take `expected_s`. Raises InputError for a bad variable."""
    return Limits(inf if run_s is None else run_s, _silence(expected_s))


def _silence(expected_s: float) -> float:
    given = os.environ.get(SILENCE)
    try:
        silence = None if given is None else float(given)
    except ValueError:
        silence = 0.0
    if silence is None:
        return max(LEAST_SILENCE_S, SILENT_SHARE * expected_s)
    if not silence > 0.0:
        raise InputError(f"{SILENCE}={given} is no number of seconds; write 7200, or inf.")
    return silence


class Watchdog:
    """Looks at the clock, and at the sizes of the files that an engine writes."""

    def __init__(self, limits: Limits, files: Iterable[Path]):
        self._limits, self._files = limits, tuple(files)
        self._began = self._looked = time.monotonic()
        self._sizes, self._silent_s = self._measured(), 0.0

    def look(self) -> None:
        """Raise RunFailed when the run is to end."""
        now, sizes = time.monotonic(), self._measured()
        since = min(now - self._looked, LOOK_S)
        self._silent_s = self._silent_s + since if sizes == self._sizes else 0.0
        self._looked, self._sizes = now, sizes
        if now - self._began > self._limits.run_s:
            raise RunFailed("timeout", f"timeout: the run took {self._limits.run_s:.6g} s.")
        if self._silent_s > self._limits.silence_s:
            raise RunFailed(
                "stalled",
                f"stalled: the engine wrote nothing for {self._limits.silence_s:.6g} s; "
                f"{SILENCE} sets how long it may.",
            )

    def _measured(self) -> tuple[int, ...]:
        return tuple(file.stat().st_size if file.exists() else -1 for file in self._files)
