"""One deck written and carried out: timed, and its end written down whatever it is."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from liftdrag.case import Case
from liftdrag.deck import Deck
from liftdrag.engines.base import Engine, Enough, Outcome, Progress
from liftdrag.engines.probes import Probe
from liftdrag.errors import RunFailed
from liftdrag.folder import RESULT, Record, write_json, writing
from liftdrag.numerics import Numerics, explained
from liftdrag.result import begun, cost, provenance


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
) -> Record:
    """Write the deck, the numerics with their reasons, and the record that reading needs.

    `settled_bed` says where the bed of a tank comes from, `estimate` what the run should cost.
    """
    with writing(folder):
        deck.write(folder)
        (folder / "numerics.txt").write_text(explained(numerics), "utf-8")
    made = provenance(deck.digest) | {"probes": [found.to_dict() for found in probes]}
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
) -> tuple[Outcome, dict[str, Any]]:
    """The outcome of a run that finished, or had `enough`, and its record without answers yet.

    Raises RunFailed when it did not; `result.json` then says why.
    """
    outcome, wall_s = _timed(engine, record, folder, progress, enough)
    finished = outcome.status == "finished"
    reasons = [] if finished else [outcome.reason]
    result = begun(record, outcome.status, reasons) | cost(outcome, wall_s)
    result["engine"] |= {
        "version": outcome.version,
        "path": str(outcome.path),
        "ranks": outcome.ranks,
    }
    if finished:
        result["stopped_by"] = outcome.stopped_by
    write_json(folder / RESULT, result)
    if not finished:
        raise RunFailed(outcome.status, f"{outcome.status}: {outcome.reason}.", outcome.evidence)
    return outcome, result


def _timed(
    engine: Engine, record: Record, folder: Path, progress: Progress, enough: Enough | None
) -> tuple[Outcome, float]:
    start = time.monotonic()
    try:
        outcome = engine.run(record.plan, folder, progress, enough=enough)
    except KeyboardInterrupt:
        failure = RunFailed("killed", f"The run in {folder} was interrupted.")
    except RunFailed as error:
        failure = error
    else:
        return outcome, time.monotonic() - start
    write_json(folder / RESULT, begun(record, failure.status, [failure.reason]))
    raise failure from None
