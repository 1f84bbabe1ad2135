"""One run, from a case to its result."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np

from liftdrag import beds, ensemble, piston
from liftdrag.analysis.biases import read_biases
from liftdrag.analysis.invariants import check_sound, tank_invariants, watched
from liftdrag.analysis.quantity import Quantity
from liftdrag.analysis.stopping import Stopping, missed
from liftdrag.analysis.tank import FORCES, Answers, answers, forces
from liftdrag.case import Case
from liftdrag.cost import check_means, foresee
from liftdrag.deck import Deck, Plan
from liftdrag.deck.dialect import IN_HOUSE, LAMMPS, Dialect
from liftdrag.deck.drag2d import check_shape
from liftdrag.deck.tank import Bed, build, contact_of
from liftdrag.engines import engine as engine_called
from liftdrag.engines import spatial
from liftdrag.engines.base import Engine, Enough, Progress, silent
from liftdrag.engines.identity import identity
from liftdrag.engines.probes import TANK, Subject, check_names
from liftdrag.errors import InputError, RunFailed
from liftdrag.execution import carried_out, write_deck
from liftdrag.folder import (
    RECORD,
    RESULT,
    Record,
    check_free,
    claimed,
    fresh,
    read_json,
    write_json,
)
from liftdrag.numerics import TankNumerics, derive, explained
from liftdrag.pictures import tank as pictures
from liftdrag.result import Result, answered, budgeted
from liftdrag.scene import Drag2DScene, JanssenScene, TankScene
from liftdrag.series import Series
from liftdrag.snapshot import Snapshot
from liftdrag.trust import trusted
from liftdrag.version import VERSION

MAX_RANKS = 4096
_FILES = (RESULT, "series.csv", "forces.png", "bed.png")


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
    _check_ranks(ranks)
    scene, version = _tank(case), VERSION
    numerics = derive(scene, ranks, bed is not None and bed.settled)
    return numerics, build(scene, numerics, case.name, version, ranks, dump, dialect, bed)


def _tank(case: Case) -> TankScene:
    if not isinstance(case.scene, TankScene):
        raise InputError(f"The case {case.name} is no tank; its scene is {case.scene.scene}.")
    return case.scene


def _check_ranks(ranks: int) -> None:
    if not 1 <= ranks <= MAX_RANKS:
        raise InputError(f"--ranks {ranks} is not between 1 and {MAX_RANKS}.")


def run(
    case: Case,
    out: str | Path | None = None,
    engine: str | None = None,
    ranks: int | None = None,
    dump: bool = False,
    progress: Progress = silent,
    engine_path: str | Path | None = None,
    ignore_probes: Sequence[str] = (),
    bench: str | Path | None = None,
    timeout_s: float | None = None,
) -> Result:
    """Run a case in the folder `out` and answer with averages and standard errors.

    The engine is LAMMPS for a tank and a piston, `dem` in the plane and for contacts that no
    other engine has, unless named; the ranks are one for a tank and a piston (threads of `dem`),
    and as many as there are cores for an ensemble, whose runs are spread over them.
    Under `mpirun` the job's ranks are used. The folder keeps the deck, the series,
    the pictures and `result.json`, and with `dump` a trajectory; by default it is
    a new one below `runs/`. The engine is probed first, with the grains of the case;
    a probe of `ignore_probes` may fail. The folder `bench` of a bench gives the biases of the
    result's error budget. Raises InputError before the run is started, RunFailed when the engine
    does not finish, or in `timeout_s` (s); the folder then says why.
    """
    chosen = engine_for(case, engine, engine_path)
    check_names(tuple(ignore_probes))
    if ranks is not None:
        _check_ranks(ranks)
    biases = None if bench is None else read_biases(Path(bench))
    if isinstance(case.scene, Drag2DScene):
        _refuse_dump(dump, "the moments of each packing are kept in any case")
        found = ensemble.run(case, chosen, out, ranks, progress, ignore_probes, timeout_s)
    elif isinstance(case.scene, JanssenScene):
        _refuse_dump(dump, "a column leaves its profiles")
        found = piston.run(case, chosen, out, ranks or 1, progress, ignore_probes, timeout_s)
    else:
        with ExitStack() as own:
            found = _run_tank(
                case, chosen, out, ranks or 1, dump, progress, ignore_probes, timeout_s, own
            )
    return budgeted(found, case, biases)


def _refuse_dump(dump: bool, instead: str) -> None:
    if dump:
        raise InputError(f"--dump is for a tank; {instead}.")


def engine_for(case: Case, name: str | None, path: str | Path | None = None) -> Engine:
    """The engine of this name, or that of the case's scene. Raises InputError."""
    scene, place = case.scene, None if path is None else Path(path)
    if isinstance(scene, TankScene):
        return spatial(name or "lammps", place)
    usual = "dem"
    if isinstance(scene, JanssenScene) and scene.grains.contact != "walton-braun":
        usual = "lammps"
    return engine_called(name or usual, place)


def _run_tank(
    case: Case,
    chosen: Engine,
    out: str | Path | None,
    ranks: int,
    dump: bool,
    progress: Progress,
    ignore_probes: Sequence[str],
    timeout_s: float | None,
    own: ExitStack,
) -> Result:
    world, scene = chosen.world(), _tank(case)
    if world.rank > 0:
        chosen.join()
    try:
        chosen.check(ranks)
        check_free(out)
        ranks = world.size if world.size > 1 else ranks
        kept = beds.kept(scene)
        planned = derive(scene, ranks, settled=kept == "settled")
        check_means(scene, planned, chosen, ranks, out, dump)
        names = TANK if world.size > 1 or ranks == 1 else (*TANK, "ranks")
        subject = Subject(contact_of(scene), scene.grains.density)
        found, alarms = trusted(chosen, subject, names, ignore_probes)
        expected = foresee(scene, planned, chosen, ranks, packed=kept != "nothing")
        start = beds.find(scene)
        numerics, deck = prepare(case, ranks, dump, chosen.dialect, start.bed)
        warnings = (*numerics.warnings, *start.warnings, *expected.warnings)
        numerics = replace(numerics, warnings=warnings)
        folder = own.enter_context(claimed(out, case.name))
        record = write_deck(
            case,
            numerics,
            deck,
            chosen.name,
            folder,
            found,
            alarms,
            settled_bed=start.provenance,
            estimate=expected.to_dict(),
            made_by=identity(chosen),
        )
    except BaseException:
        chosen.release()
        raise
    enough = enough_for(scene, chosen, record, folder)
    outcome, result = carried_out(chosen, record, folder, progress, enough, timeout_s)
    expected.compare(outcome, float(outcome.grains * outcome.steps))
    beds.keep(start, scene, folder)
    return _answered(folder, case, record, result)


def enough_for(scene: TankScene, engine: Engine, record: Record, folder: Path) -> Enough | None:
    """Whether the series so far reaches the targets of the scene's stop; None without one."""
    if scene.stop is None:
        return None

    def estimate(series: Series) -> Mapping[str, Quantity]:
        if scene.targets.keys() <= FORCES:
            return forces(scene, series)
        return answers(scene, series, engine.surfaces(record.plan, folder)).quantities

    return Stopping(scene.targets, estimate)


def build_deck(
    case: Case,
    out: str | Path | None = None,
    engine: str | None = None,
    ranks: int = 1,
    engine_path: str | Path | None = None,
) -> tuple[Path, str, str]:
    """Write the deck of a case, or those of its packings, into a folder, by default below decks/.

    Returns the folder, the numbers with their reasons, and the command that runs it there.
    """
    check_free(out)
    chosen = engine_for(case, engine, engine_path)
    program = chosen.dialect.program
    if isinstance(case.scene, Drag2DScene):
        check_shape(case.scene, chosen.dialect)
        folder, planar = ensemble.write_decks(case, chosen, out)
        here = f"{program} ."
        if chosen.dialect is not IN_HOUSE:
            here = f"cd {ensemble.packing_folder(Path(), 0)} && {program} -in in.drag2d"
        return folder, explained(planar), here
    if isinstance(case.scene, JanssenScene):
        _check_ranks(ranks)
        folder, filled, plan = piston.write_decks(case, chosen, ranks, out)
        here = f"{program} ." if chosen.dialect is IN_HOUSE else f"{program} -in {plan.start}"
        return folder, explained(filled), here
    numerics, deck = prepare(case, ranks, dialect=chosen.dialect)
    folder = fresh(out, case.name, "decks")
    write_deck(case, numerics, deck, chosen.name, folder)
    return folder, explained(numerics), f"{program} -in {deck.plan.start}"


def analyze(folder: Path, bench: str | Path | None = None) -> Result:
    """The answers of a finished run again, from the series in its folder.

    The folder `bench` of a bench gives the biases of the result's error budget.
    """
    biases = None if bench is None else read_biases(Path(bench))
    old, record = read_json(folder / RESULT), Record.read(folder)
    status = old.get("status", "unknown")
    if status != "finished":
        raise InputError(f"The run in {folder} did not finish ({status}); run the case again.")
    case = recorded(folder, record)
    if isinstance(case.scene, Drag2DScene):
        found = ensemble.answered(folder, case.scene, record, old)
    elif isinstance(case.scene, JanssenScene):
        found = piston.answered(folder, case.scene, record, old)
    else:
        found = _answered(folder, case, record, old)
    return budgeted(found, case, biases)


def recorded(folder: Path, record: Record) -> Case:
    """The case of a folder's record. Raises InputError when it is damaged."""
    case = Case(record.case, record.tables)
    try:
        case.scene  # noqa: B018 - a case that was run is a good one
    except InputError:
        raise InputError(f"{folder / RECORD} is damaged; run the case again.") from None
    return case


def _answered(folder: Path, case: Case, record: Record, result: dict[str, Any]) -> Result:
    """The answers from the files in the folder, written to `result.json` and as pictures."""
    series, found, last = _read(folder, _tank(case), record)
    result = result | _reported(found, record, series)
    result["warnings"] += missed(_tank(case).targets, found.quantities, "drive.distance")
    beds = engine_called(record.engine).snapshots(record.plan, folder)
    result = watched(result, tank_invariants(_tank(case), series, beds))
    try:
        series.to_pandas().to_csv(folder / "series.csv")
        write_json(folder / RESULT, result)
        pictures.draw_forces(_tank(case), series, found, folder / "forces.png")
        for snapshot in last:
            pictures.draw_bed(_tank(case), snapshot, folder / "bed.png")
    except (OSError, RunFailed) as error:
        result["warnings"] = [f"Nothing was written to {folder}: {error}", *result["warnings"]]
    check_sound(result)
    return Result(folder, result, found.quantities, series, found.window, _FILES)


def _read(
    folder: Path, scene: TankScene, record: Record
) -> tuple[Series, Answers, deque[Snapshot]]:
    """The series, the answers and the last snapshot, if any.

    Raises InputError when the engine's files are damaged.
    """
    chosen = engine_called(record.engine)
    try:
        series = chosen.series(record.plan, folder)
        surfaces = list(chosen.surfaces(record.plan, folder))
        _check_complete(series, [time for time, _ in surfaces], record.plan)
        last = deque(chosen.snapshots(record.plan, folder), maxlen=1)
        return series, answers(scene, series, surfaces), last
    except InputError:
        raise
    except (OSError, ValueError, LookupError) as error:
        raise InputError(
            f"The files in {folder} are damaged ({error}); run the case again."
        ) from error


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
        **answered(found.quantities),
        "warnings": [*record.alarms, *found.warnings, *record.warnings],
        "steady_window": {
            "start_s": float(series.time[window.start]),
            "end_s": float(series.time[window.stop - 1]),
            "drift": window.drift if isfinite(window.drift) else None,
            "steady": window.steady,
        },
    }
