"""A shear flow of rods, disks and spheres, from a case to its result: a cell grown and sheared."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import replace
from math import isfinite
from pathlib import Path
from typing import Any

from liftdrag.analysis.invariants import check_sound, sheared_invariants, watched
from liftdrag.analysis.quantity import Quantity
from liftdrag.analysis.shear import ShearAnswers, answers, early_answers
from liftdrag.analysis.shear_tables import write_tensor
from liftdrag.analysis.stopping import Stopping, missed
from liftdrag.case import Case
from liftdrag.cost import check_means, foresee
from liftdrag.deck import Deck
from liftdrag.deck.shear import build, check_engine
from liftdrag.dem import is_cold
from liftdrag.engines import engine as engine_called
from liftdrag.engines.base import Engine, Outcome, Progress, silent
from liftdrag.engines.identity import identity
from liftdrag.errors import InputError, RunFailed
from liftdrag.execution import Asked, carried_out, write_deck
from liftdrag.folder import RESULT, Record, check_free, claimed, fresh, write_json
from liftdrag.numerics import ShearNumerics, derive
from liftdrag.packing.shear import grown_cell
from liftdrag.pictures.cylinders import draw_cell
from liftdrag.pictures.shear import ORDER, draw_flow, draw_order
from liftdrag.result import Result
from liftdrag.result import answered as quantities_of
from liftdrag.scene import ShearScene
from liftdrag.series import Series
from liftdrag.snapshot import Snapshot
from liftdrag.trajectory import write_dump

FILES = (RESULT, "series.csv", "structure.csv", "stress.csv", "flow.png", "cell.png")

ORDERED = "order.png"
"""What is drawn of grains with axes alone."""


def prepare(case: Case, ranks: int = 1) -> tuple[ShearNumerics, Deck]:
    """The numerics and the deck of a shear flow, its cell grown. Raises InputError."""
    scene = scene_of(case)
    numerics = derive(scene)
    return numerics, build(scene, numerics, grown_cell(scene, ranks), ranks)


def scene_of(case: Case) -> ShearScene:
    """The scene of the case. Raises InputError when it is another."""
    if not isinstance(case.scene, ShearScene):
        raise InputError(f"The case {case.name} is no shear flow; its scene is {case.scene.scene}.")
    return case.scene


def write_decks(
    case: Case, engine: Engine, ranks: int, out: str | Path | None
) -> tuple[Path, ShearNumerics]:
    """The deck of a shear flow in a folder. Raises InputError before anything is written."""
    check_engine(engine.name)
    numerics, deck = prepare(case, ranks)
    folder = fresh(out, case.name, "decks")
    write_deck(case, numerics, deck, engine.name, folder)
    return folder, numerics


def run(case: Case, asked: Asked) -> Result:
    """Shear the cell on so many threads of the in-house engine, and answer.

    Raises InputError before anything is started, RunFailed when the engine does not finish.
    """
    with ExitStack() as own:
        return _run(case, asked, own)


def _run(case: Case, asked: Asked, own: ExitStack) -> Result:
    engine, scene, ranks = asked.engine, scene_of(case), asked.ranks or 1
    check_engine(engine.name)
    if engine.world().size > 1:
        raise InputError(
            "The engine dem shears a cell on the threads of one process; start it without mpiexec "
            "and with --ranks N."
        )
    check_free(asked.out)
    planned = derive(scene)
    check_means(scene, planned, engine, ranks, asked.out)
    expected = foresee(scene, planned, engine, ranks)
    asked.progress("compile" if is_cold() else "packing", 0, 1)
    numerics, deck = prepare(case, ranks)
    numerics = replace(numerics, warnings=(*numerics.warnings, *expected.warnings))
    folder = own.enter_context(claimed(asked.out, case.name))
    record = write_deck(
        case,
        numerics,
        deck,
        engine.name,
        folder,
        estimate=expected.to_dict(),
        made_by=identity(engine),
    )
    outcome, found = gone_through(case, engine, record, folder, asked.progress, asked.timeout_s)
    expected.compare(outcome, float(outcome.grains * outcome.steps))
    if asked.dump:
        write_dump(folder)
    return found


def gone_through(
    case: Case,
    engine: Engine,
    record: Record,
    folder: Path,
    progress: Progress = silent,
    timeout_s: float | None = None,
) -> tuple[Outcome, Result]:
    """The run of a deck in its folder, or the rest of it, and its answers."""
    scene = scene_of(case)
    outcome, result = carried_out(engine, record, folder, progress, _enough(scene), timeout_s)
    return outcome, answered(folder, scene, record, result)


def _enough(scene: ShearScene) -> Stopping | None:
    """Whether the series so far reaches the targets of the scene's stop; None without one."""

    def estimate(sampled: Series) -> Mapping[str, Quantity]:
        return early_answers(scene, sampled)

    return Stopping(scene.targets, estimate) if scene.stop else None


def answered(folder: Path, scene: ShearScene, record: Record, result: dict[str, Any]) -> Result:
    """The answers from the files in the folder, written to `result.json`, tables and pictures."""
    sampled, found, last = _read(folder, scene, record)
    warnings = [*record.alarms, *found.warnings, *record.warnings]
    warnings += missed(scene.targets, found.quantities, "drive.strain")
    result = result | _reported(found) | {"warnings": warnings}
    result = watched(result, sheared_invariants(scene, sampled))
    has_order = ORDER in found.quantities
    try:
        write_json(folder / RESULT, result)
        found.series.to_pandas().to_csv(folder / "series.csv")
        found.structure.to_pandas().to_csv(folder / "structure.csv")
        write_tensor(found.tensor, folder / "stress.csv")
        draw_flow(scene, found, folder / "flow.png")
        if has_order:
            draw_order(scene, found, folder / ORDERED)
        draw_cell(scene, last, folder / "cell.png")
    except (OSError, RunFailed) as error:
        result["warnings"] = [f"Nothing was written to {folder}: {error}", *result["warnings"]]
    check_sound(result)
    files = (*FILES, ORDERED) if has_order else FILES
    return Result(folder, result, found.quantities, found.series, found.window, files)


def _read(folder: Path, scene: ShearScene, record: Record) -> tuple[Series, ShearAnswers, Snapshot]:
    """What was sampled, the answers and the last look at the grains.

    Raises InputError when the engine's files are damaged.
    """
    engine, plan = engine_called(record.engine), record.plan
    try:
        sampled = engine.series(plan, folder)
        whole, row = plan.stages["drive"] * plan.time_step, plan.row_every * plan.time_step
        if not plan.stoppable and whole - sampled.time[-1] > 0.5 * row:
            raise ValueError("the series ends before the run")
        looks = list(engine.snapshots(plan, folder))
        if abs(sampled.time[-1] - looks[-1].time) > 0.5 * row:
            raise ValueError("the looks at the grains end before the series")
        return sampled, answers(scene, sampled, looks), looks[-1]
    except InputError:
        raise
    except (OSError, ValueError, LookupError) as error:
        raise InputError(
            f"The files in {folder} are damaged ({error}); run the case again."
        ) from error


def _reported(found: ShearAnswers) -> dict[str, Any]:
    window, strain = found.window, found.series["strain"]
    return {
        **quantities_of(found.quantities),
        "comparison": {name: one.to_dict() for name, one in found.comparison.items()},
        "steady_window": {
            "start_s": float(found.series.time[window.start]),
            "end_s": float(found.series.time[window.stop - 1]),
            "start_strain": float(strain[window.start]),
            "end_strain": float(strain[window.stop - 1]),
            "drift": window.drift if isfinite(window.drift) else None,
            "steady": window.steady,
        },
    }
