"""One deck written and carried out: timed, and its end written down whatever it is."""

from __future__ import annotations

import contextlib
import shlex
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from liftdrag import seal, sessions
from liftdrag.case import Case
from liftdrag.deck import Deck
from liftdrag.engines.base import Engine, Enough, Outcome, Progress, silent
from liftdrag.engines.probes import Probe
from liftdrag.engines.watchdog import Limits, limits
from liftdrag.errors import InputError, RunFailed
from liftdrag.folder import RESULT, Record, write_json, writing
from liftdrag.numerics import Numerics, explained
from liftdrag.result import begun, cost, provenance

CUT_SHORT = ("killed", "timeout", "stalled", "disk_full")
"""Ends of a run that are no fault of its own."""

MAX_RANKS = 4096


@dataclass(frozen=True)
class Asked:
    """How a case is to be run: on which engine, in the folder `out`, on so many ranks.

    With `dump` a trajectory is kept; a probe of `ignored_probes` may fail; the run may last
    `timeout_s` (s).
    """

    engine: Engine
    out: str | Path | None = None
    ranks: int | None = None
    dump: bool = False
    progress: Progress = silent
    ignored_probes: Sequence[str] = ()
    timeout_s: float | None = None


def check_ranks(ranks: int) -> None:
    """Raise InputError for a number of ranks that nothing can start."""
    if not 1 <= ranks <= MAX_RANKS:
        raise InputError(f"--ranks {ranks} is not between 1 and {MAX_RANKS}.")


def write_deck(
    case: Case,
    numerics: Numerics,
    deck: Deck,
    engine: str,
    folder: Path,
    probes: Sequence[Probe] = (),
    alarms: Sequence[str] = (),
    settled_bed: Mapping[str, Any] | None = None,
    estimate: Mapping[str, Any] | None = None,
    made_by: Mapping[str, Any] | None = None,
) -> Record:
    """Write the deck, the numerics with their reasons, and the record that reading needs.

    `settled_bed` says where the bed of a tank comes from, `estimate` what the run should cost,
    `made_by` what the engine is.
    """
    with writing(folder):
        deck.write(folder)
        (folder / "numerics.txt").write_text(explained(numerics), "utf-8")
    made = provenance(deck) | {"probes": [found.to_dict() for found in probes]}
    if made_by is not None:
        made["engine"] = dict(made_by)
    if settled_bed is not None:
        made["settled_bed"] = dict(settled_bed)
    warnings = list(numerics.warnings)
    record = Record(
        case.name,
        dict(case.tables),
        engine,
        deck.plan,
        warnings,
        made,
        list(alarms),
        dict(estimate or {}),
    )
    record.write(folder)
    return record


def carried_out(
    engine: Engine,
    record: Record,
    folder: Path,
    progress: Progress,
    enough: Enough | None = None,
    timeout_s: float | None = None,
) -> tuple[Outcome, dict[str, Any]]:
    """The outcome of a run that finished, or had `enough`, and its record without answers yet.

    Raises RunFailed when it did not, or in `timeout_s`; `result.json` then says why.
    """
    bounds = limits(timeout_s, record.estimate.get("wall_s", 0.0))
    record = sessions.opened(record, folder)
    outcome, wall_s = _timed(engine, record, folder, progress, enough, bounds)
    outcome = _as_written(outcome, record, folder)
    if outcome.status != "finished":
        with contextlib.suppress(RunFailed):
            record = sessions.closed(record, folder, outcome.status, wall_s, outcome.cpu_s)
        with contextlib.suppress(RunFailed):
            write_json(folder / RESULT, _ended(record, outcome, [outcome.reason]))
        how = how_on(folder, outcome.status)
        reason = f"{outcome.status}: {outcome.reason}.{how}"
        raise RunFailed(outcome.status, reason, outcome.evidence)
    record = sessions.closed(record, folder, outcome.status, wall_s, outcome.cpu_s)
    with writing(folder):
        sealed = {"stopped_by": outcome.stopped_by, "sealed": seal.digests(folder, record)}
    result = _ended(record, outcome, []) | sealed
    write_json(folder / RESULT, result)
    return outcome, result


def _ended(record: Record, outcome: Outcome, reasons: list[str]) -> dict[str, Any]:
    """The record of a run that ended, with what all its sessions took."""
    result = begun(record, outcome.status, reasons) | cost(outcome, 0.0) | sessions.spent(record)
    result["engine"] |= {
        "version": outcome.version,
        "path": str(outcome.path),
        "ranks": outcome.ranks,
    }
    return result


def _as_written(outcome: Outcome, record: Record, folder: Path) -> Outcome:
    """The outcome; that of a deck that is not the one written is no finished run."""
    changed = record.changed(folder)
    if outcome.status != "finished" or not changed:
        return outcome
    reason = f"{', '.join(changed)} is not the file that was written for this run"
    return replace(outcome, status="engine_error", reason=reason)


def _timed(
    engine: Engine,
    record: Record,
    folder: Path,
    progress: Progress,
    enough: Enough | None,
    bounds: Limits,
) -> tuple[Outcome, float]:
    start = time.monotonic()
    try:
        with writing(folder):
            outcome = engine.run(record.plan, folder, progress, enough=enough, limits=bounds)
    except KeyboardInterrupt:
        failure = RunFailed("killed", f"The run in {folder} was interrupted.")
    except RunFailed as error:
        failure = error
    else:
        return outcome, time.monotonic() - start
    wall_s = time.monotonic() - start
    with contextlib.suppress(RunFailed):
        record = sessions.closed(record, folder, failure.status, wall_s, None)
    with contextlib.suppress(RunFailed):
        ended = begun(record, failure.status, [failure.reason]) | sessions.spent(record)
        write_json(folder / RESULT, ended)
    reason = f"{failure.reason}{how_on(folder, failure.status)}"
    raise RunFailed(failure.status, reason, failure.evidence) from None


def how_on(folder: Path, status: str) -> str:
    """How to go on with a run that was cut short."""
    if status not in CUT_SHORT:
        return ""
    return f" Go on with: liftdrag run --resume --out {shlex.quote(str(folder))}"
