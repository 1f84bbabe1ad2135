"""Go on with a run that was cut short, to the same last step."""

from __future__ import annotations

import json
import logging
from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from liftdrag import ensemble, piston, sheared
from liftdrag.case import Case
from liftdrag.deck.restart import deck_of
from liftdrag.engines import dem_column, dem_shear, restart
from liftdrag.engines.base import Engine, Progress, silent
from liftdrag.engines.checkpoint import Keeper
from liftdrag.engines.family import Family
from liftdrag.errors import InputError
from liftdrag.execution import carried_out
from liftdrag.folder import RECORD, RESULT, Record, read_json, writing
from liftdrag.lock import held
from liftdrag.result import Result, budgeted
from liftdrag.runner import analyze, engine_for, run
from liftdrag.scene import Drag2DScene, JanssenScene, ShearScene, TankScene
from liftdrag.tank import enough_for

_log = logging.getLogger("liftdrag")

_DECKS = {deck[0]: deck for deck in (dem_column.DECK, dem_shear.DECK)}
"""The files of a deck of the in-house engine, by the one that it starts from."""


def resume(
    case: Case | None,
    out: str | Path | None,
    engine: str | None = None,
    ranks: int | None = None,
    progress: Progress = silent,
    engine_path: str | Path | None = None,
    timeout_s: float | None = None,
) -> Result:
    """Go on with the run in the folder `out`, of `case` where that is given.

    A run that has finished is only read again, one that never began is started. LAMMPS goes on
    from the last whole restart file, or anew where there is none yet; an ensemble with the
    packings that have not finished; a column or a sheared cell of the in-house engine from the last
    whole state that it kept. Raises InputError where the run is another or cannot go on, RunFailed
    when it does not finish.
    """
    if out is None:
        raise InputError("--resume needs --out, the folder of the run to go on with.")
    folder = Path(out)
    if not (folder / RECORD).exists():
        if case is None:
            raise InputError(f"{folder} holds no run; name the case to start there.")
        return run(
            case,
            folder,
            engine,
            ranks,
            progress=progress,
            engine_path=engine_path,
            timeout_s=timeout_s,
        )
    record = Record.read(folder)
    of = Case(record.case, record.tables)
    chosen = engine_for(of, record.engine, engine_path)
    world = chosen.world()
    if world.rank > 0:
        chosen.join()
    if world.size > 1:
        ranks = world.size
    with ExitStack() as own:
        try:
            own.enter_context(held(folder))
            _check_asked(case, engine, ranks, record, folder)
            if _status(folder) == "finished":
                chosen.release()
                return analyze(folder)
            going = _going_on(record, chosen, folder)
        except BaseException:
            chosen.release()
            raise
        return _gone_on(of, chosen, going, folder, ranks, progress, timeout_s)


def _gone_on(
    case: Case,
    engine: Engine,
    record: Record,
    folder: Path,
    ranks: int | None,
    progress: Progress,
    timeout_s: float | None,
) -> Result:
    """The result of the rest of a run, once the folder is ready for it."""
    if isinstance(case.scene, Drag2DScene):
        found = ensemble.resumed(case, engine, folder, record, ranks, progress, timeout_s)
        return budgeted(found, case, None)
    if isinstance(case.scene, JanssenScene):
        _, found = piston.gone_through(case, engine, record, folder, progress, timeout_s)
        return budgeted(found, case, None)
    if isinstance(case.scene, ShearScene):
        _, found = sheared.gone_through(case, engine, record, folder, progress, timeout_s)
        return budgeted(found, case, None)
    assert isinstance(case.scene, TankScene)
    enough = enough_for(case.scene, engine, record, folder)
    carried_out(engine, record, folder, progress, enough, timeout_s)
    return analyze(folder)


def _going_on(record: Record, engine: Engine, folder: Path) -> Record:
    """The record of a run that starts from its last point; the folder is as it was there.

    Raises InputError when it cannot go on.
    """
    _check_engine(record, engine, folder)
    if record.tables["scene"] == "drag2d":
        return record
    _check_deck(record, folder)
    if not isinstance(engine, Family):
        return _noted(record, folder, _kept(record, folder))
    point = restart.latest(record.plan, folder, engine.log)
    if point is None:
        with writing(folder):
            restart.begin_anew(record.plan, folder)
        return _noted(record, folder, None)
    with writing(folder):
        restart.take_back(point, record.plan, folder, engine.log)
    record = _noted(record, folder, (point.stage, point.step))
    return replace(record, plan=replace(record.plan, start=deck_of(record.plan.start, point.stage)))


def _kept(record: Record, folder: Path) -> tuple[str, int] | None:
    """Where the last whole state of the in-house engine is; those that are damaged are told of."""
    keeper = Keeper(folder, _DECKS.get(record.plan.start, ()))
    for name in keeper.damaged():
        _log.warning("%s is damaged and is passed over.", name)
    state = keeper.latest()
    return None if state is None else ("drive", int(state["done"]))


def _noted(record: Record, folder: Path, point: tuple[str, int] | None) -> Record:
    """The record, which says from which step of which stage the run goes on, if from any."""
    if point is None:
        _log.info("Nothing was kept yet: from the beginning.")
        return record
    stage, step = point
    _log.info("From step %d of the stage %s.", step, stage)
    now = datetime.now(UTC).isoformat(timespec="seconds")
    points = [
        *record.provenance.get("resumed", []),
        {"stage": stage, "step": step, "at": now},
    ]
    noted = replace(record, provenance=record.provenance | {"resumed": points})
    noted.write(folder)
    return noted


def _check_engine(record: Record, engine: Engine, folder: Path) -> None:
    """Raise InputError when the engine is not what the run began with."""
    began, version = record.provenance.get("engine", {}).get("version"), engine.about().version
    if began not in (None, version):
        raise InputError(
            f"The run in {folder} began with {engine.name} {began}, and this is {version}; name "
            f"the other with --engine-path, or remove {folder} and run again."
        )


def _status(folder: Path) -> str:
    return str(read_json(folder / RESULT).get("status")) if (folder / RESULT).exists() else ""


def _check_asked(
    case: Case | None, engine: str | None, ranks: int | None, record: Record, folder: Path
) -> None:
    """Raise InputError where the run in the folder is not what was asked for."""
    planned, shared = record.plan.ranks, record.tables["scene"] != "drag2d"
    if case is not None and _plain(case.tables) != record.tables:
        raise InputError(
            f"The run in {folder} is of another case than {case.name}; choose another --out."
        )
    if engine not in (None, record.engine):
        raise InputError(
            f"The run in {folder} is of the engine {record.engine}; leave out --engine."
        )
    if shared and ranks not in (None, planned):
        raise InputError(
            f"The run in {folder} is on --ranks {planned}, not {ranks}; leave out --ranks."
        )


def _check_deck(record: Record, folder: Path) -> None:
    """Raise InputError where the deck is not the one that was written."""
    if changed := record.changed(folder):
        raise InputError(
            f"In {folder}, {', '.join(changed)} is not the file that was written for the run; "
            f"remove {folder} and run again."
        )


def _plain(tables: Mapping[str, Any]) -> Any:
    """The tables of a case as a record holds them."""
    return json.loads(json.dumps(tables))
