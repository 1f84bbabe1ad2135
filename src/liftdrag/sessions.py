"""The sessions of a run that was gone on with: when each began, what it took and how it ended."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from liftdrag.errors import InputError, RunFailed
from liftdrag.folder import Record


def opened(record: Record, folder: Path) -> Record:
    """The record with one more session, in `run.json` too. Raises RunFailed."""
    began = {"began": datetime.now(UTC).isoformat(timespec="seconds")}
    return _written(record, folder, [*_sessions(record), began])


def closed(record: Record, folder: Path, status: str, wall_s: float, cpu_s: float | None) -> Record:
    """The record with the end of its last session, whose `cpu_s` may not be known.

    Raises RunFailed.
    """
    took: dict[str, Any] = {"status": status, "wall_s": wall_s, "cpu_s": cpu_s}
    *earlier, last = _sessions(record)
    return _written(record, folder, [*earlier, last | took])


def spent(record: Record) -> dict[str, float]:
    """The times (s) of all sessions that are known: one that was killed with liftdrag is not."""
    sessions = _sessions(record)
    return {
        name: sum(session.get(name) or 0.0 for session in sessions) for name in ("wall_s", "cpu_s")
    }


def _sessions(record: Record) -> list[dict[str, Any]]:
    return list(record.provenance.get("sessions", []))


def _written(record: Record, folder: Path, sessions: list[dict[str, Any]]) -> Record:
    """The record with these sessions; in `run.json`, whose plan stays that of the whole run."""
    made = record.provenance | {"sessions": sessions}
    try:
        replace(Record.read(folder), provenance=made).write(folder)
    except InputError as error:
        raise RunFailed("engine_error", str(error)) from None
    return replace(record, provenance=made)
