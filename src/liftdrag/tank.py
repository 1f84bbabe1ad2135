"""A tank, from a case to its result: a bed dragged past a buried cylinder."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np

from liftdrag import beds, fields
from liftdrag.analysis.invariants import check_sound, tank_invariants, watched
from liftdrag.analysis.quantity import Quantity
from liftdrag.analysis.stopping import Stopping, missed
from liftdrag.analysis.tank import FORCES, Answers, answers, forces
from liftdrag.case import Case
from liftdrag.cost import check_means, foresee
from liftdrag.deck import Deck, Plan
from liftdrag.deck.dialect import LAMMPS, Dialect
from liftdrag.deck.tank import Bed, build, contact_of
from liftdrag.engines import engine as engine_called
from liftdrag.engines.base import Engine, Enough
from liftdrag.engines.probes import TANK, Subject
from liftdrag.errors import InputError, RunFailed
from liftdrag.execution import (
    Asked,
    beginning,
    carried_out,
    check_ranks,
    deck_in,
    laid_out,
)
from liftdrag.folder import RESULT, Record, reading, write_json
from liftdrag.numerics import TankNumerics, derive
from liftdrag.pictures import tank as pictures
from liftdrag.result import Result
from liftdrag.result import answered as quantities_of
from liftdrag.scene import TankScene
from liftdrag.series import Series
from liftdrag.snapshot import Snapshot
from liftdrag.trust import trusted
from liftdrag.version import VERSION

FILES = (RESULT, "series.csv", "forces.png", "bed.png")


def prepare(
    case: Case,
    ranks: int = 1,
    dump: bool = False,
    dialect: Dialect = LAMMPS,
    bed: Bed | None = None,
) -> tuple[TankNumerics, Deck]:
    """The numerics and the deck of a tank, whose bed is packed when there is none yet.

    Raises InputError for a bad case or too many ranks.
    """
    check_ranks(ranks)
    scene, version = scene_of(case), VERSION
    numerics = derive(scene, ranks, bed is not None and bed.settled)
    return numerics, build(scene, numerics, case.name, version, ranks, dump, dialect, bed)


def scene_of(case: Case) -> TankScene:
    """The scene of the case. Raises InputError when it is another."""
    if not isinstance(case.scene, TankScene):
        raise InputError(f"The case {case.name} is no tank; its scene is {case.scene.scene}.")
    return case.scene


def write_decks(
    case: Case, engine: Engine, ranks: int, out: str | Path | None
) -> tuple[Path, TankNumerics, Plan]:
    """The deck of a tank in a folder. Raises InputError before anything is written."""
    numerics, deck = prepare(case, ranks, dialect=engine.dialect)
    return deck_in(out, case, numerics, deck, engine), numerics, deck.plan


def run(case: Case, asked: Asked) -> Result:
    """Drag a bed past the cylinder, and answer.

    Raises InputError before anything is started, RunFailed when the engine does not finish.
    """
    with ExitStack() as own:
        return _run(case, asked, own)


def _run(case: Case, asked: Asked, own: ExitStack) -> Result:
    engine, scene = asked.engine, scene_of(case)
    with beginning(asked) as ranks:
        kept = beds.kept(scene)
        planned = derive(scene, ranks, settled=kept == "settled")
        check_means(scene, planned, engine, ranks, asked.out, asked.dump)
        names = TANK if engine.world().size > 1 or ranks == 1 else (*TANK, "ranks")
        subject = Subject(contact_of(scene), scene.grains.density)
        found, alarms = trusted(engine, subject, names, asked.ignored_probes)
        expected = foresee(scene, planned, engine, ranks, packed=kept != "nothing")
        start = beds.find(scene)
        numerics, deck = prepare(case, ranks, asked.dump, engine.dialect, start.bed)
        numerics = replace(numerics, warnings=(*numerics.warnings, *start.warnings))
        folder, record = laid_out(
            own, case, asked, numerics, deck, expected, found, alarms, start.provenance
        )
    enough = enough_for(scene, engine, record, folder)
    outcome, result = carried_out(engine, record, folder, asked.progress, enough, asked.timeout_s)
    expected.compare(outcome, float(outcome.grains * outcome.steps))
    beds.keep(start, scene, folder)
    return answered(folder, case, record, result)


def enough_for(scene: TankScene, engine: Engine, record: Record, folder: Path) -> Enough | None:
    """Whether the series so far reaches the targets of the scene's stop; None without one."""
    if scene.stop is None:
        return None

    def estimate(series: Series) -> Mapping[str, Quantity]:
        if scene.targets.keys() <= FORCES:
            return forces(scene, series)
        return answers(scene, series, engine.surfaces(record.plan, folder)).quantities

    return Stopping(scene.targets, estimate)


def answered(folder: Path, case: Case, record: Record, result: dict[str, Any]) -> Result:
    """The answers from the files in the folder, written to `result.json` and as pictures."""
    series, found, last = _read(folder, scene_of(case), record)
    mapped = fields.read(folder, scene_of(case), record.plan, series, found)
    found = fields.told(scene_of(case), found, mapped)
    result = result | _reported(found, record, series) | fields.recorded(found, mapped)
    result["warnings"] += missed(scene_of(case).targets, found.quantities, "drive.distance")
    beds = engine_called(record.engine).snapshots(record.plan, folder)
    result = watched(result, tank_invariants(scene_of(case), series, beds))
    files: tuple[str, ...] = FILES
    try:
        series.to_pandas().to_csv(folder / "series.csv")
        write_json(folder / RESULT, result)
        pictures.draw_forces(scene_of(case), series, found, folder / "forces.png")
        for snapshot in last:
            pictures.draw_bed(scene_of(case), snapshot, folder / "bed.png")
        files = (*FILES, *fields.write(folder, scene_of(case), found, mapped))
    except (OSError, RunFailed) as error:
        result["warnings"] = [f"Nothing was written to {folder}: {error}", *result["warnings"]]
    check_sound(result)
    return Result(folder, result, found.quantities, series, found.window, files)


def _read(
    folder: Path, scene: TankScene, record: Record
) -> tuple[Series, Answers, deque[Snapshot]]:
    """The series, the answers and the last snapshot, if any.

    Raises InputError when the engine's files are damaged.
    """
    chosen = engine_called(record.engine)
    with reading(folder):
        series = chosen.series(record.plan, folder)
        surfaces = list(chosen.surfaces(record.plan, folder))
        _check_complete(series, [time for time, _ in surfaces], record.plan)
        last = deque(chosen.snapshots(record.plan, folder), maxlen=1)
        return series, answers(scene, series, surfaces), last


def _check_complete(series: Series, surfaces: Sequence[float], plan: Plan) -> None:
    """Raise ValueError where rows, or times of surfaces (s), are missing at the end of a run."""
    end, row = series.time[-1], plan.row_every * plan.time_step
    whole = end if plan.stoppable else plan.stages["drive"] * plan.time_step
    if whole - end > row * (1.0 - 1e-6):
        raise ValueError(f"the series ends at {end:.6g} s of {whole:.6g} s")
    between = np.diff(surfaces)
    if not between.size or np.ptp(between) > 0.5 * row or whole - surfaces[-1] > between[0]:
        raise ValueError("surfaces are missing")


def _reported(found: Answers, record: Record, series: Series) -> dict[str, Any]:
    window = found.window
    return {
        **quantities_of(found.quantities),
        "warnings": [*record.alarms, *found.warnings, *record.warnings],
        "steady_window": {
            "start_s": float(series.time[window.start]),
            "end_s": float(series.time[window.stop - 1]),
            "drift": window.drift if isfinite(window.drift) else None,
            "steady": window.steady,
        },
    }
