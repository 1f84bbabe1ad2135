"""One deck written and carried out: timed, and its end written down whatever it is."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from liftdrag.case import Case
from liftdrag.deck import Deck
from liftdrag.engines.base import Engine, Outcome, Progress
from liftdrag.engines.probes import Probe
from liftdrag.errors import RunFailed
from liftdrag.folder import RESULT, Record, write_json
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
) -> Record:
    """Write the deck, the numerics with their reasons, and the record that reading needs."""
    deck.write(folder)
    (folder / "numerics.txt").write_text(explained(numerics), "utf-8")
    made = provenance(deck.digest) | {"probes": [found.to_dict() for found in probes]}
    warnings = list(numerics.warnings)
    record = Record(case.name, dict(case.tables), engine, deck.plan, warnings, made, list(alarms))
    record.write(folder)
    return record


def carried_out(
    engine: Engine, record: Record, folder: Path, progress: Progress
) -> tuple[Outcome, dict[str, Any]]:
    """The outcome of a run that finished, and the record of it, without answers yet.

    Raises RunFailed when it did not; `result.json` then says why.
    """
    outcome, wall_s = _timed(engine, record, folder, progress)
    finished = outcome.status == "finished"
    reasons = [] if finished else [outcome.reason]
    result = begun(record, outcome.status, reasons) | cost(outcome, wall_s)
    result["engine"] |= {
        "version": outcome.version,
        "path": str(outcome.path),
        "ranks": outcome.ranks,
    }
    write_json(folder / RESULT, result)
    if not finished:
        raise RunFailed(outcome.status, f"{outcome.status}: {outcome.reason}.", outcome.evidence)
    return outcome, result


def _timed(
    engine: Engine, record: Record, folder: Path, progress: Progress
) -> tuple[Outcome, float]:
    start = time.monotonic()
    try:
        outcome = engine.run(record.plan, folder, progress)
    except KeyboardInterrupt:
        failure = RunFailed("killed", f"The run in {folder} was interrupted.")
    except RunFailed as error:
        failure = error
    else:
        return outcome, time.monotonic() - start
    write_json(folder / RESULT, begun(record, failure.status, [failure.reason]))
    raise failure from None
