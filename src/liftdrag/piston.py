"""A Janssen piston, from a case to its result: a column filled level by level, and weighed."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

from liftdrag.analysis.invariants import check_sound, column_invariants, watched
from liftdrag.analysis.janssen import (
    FillWindow,
    JanssenAnswers,
    answers,
    write_curve,
    write_profile,
)
from liftdrag.analysis.janssen_stop import FillStopping
from liftdrag.case import Case
from liftdrag.cost import check_means, foresee
from liftdrag.deck import Deck, Plan
from liftdrag.deck.column import contact_of
from liftdrag.deck.dialect import IN_HOUSE, Dialect
from liftdrag.deck.janssen import build, check_contact
from liftdrag.dem import is_cold
from liftdrag.engines import engine as engine_called
from liftdrag.engines.base import Engine, Outcome, Progress, silent
from liftdrag.engines.fills import read_fills
from liftdrag.engines.probes import PLANAR, Probe, Subject
from liftdrag.errors import InputError, RunFailed
from liftdrag.execution import Asked, beginning, carried_out, deck_in, laid_out
from liftdrag.folder import RESULT, Record, reading, write_json
from liftdrag.numerics import JanssenNumerics, derive
from liftdrag.packing.tube import packed_column
from liftdrag.pictures import janssen as pictures
from liftdrag.result import Result
from liftdrag.result import answered as quantities_of
from liftdrag.scene import JanssenScene
from liftdrag.series import Series
from liftdrag.trust import trusted
from liftdrag.version import VERSION

FILES = (RESULT, "curve.csv", "curve.png", "profile.csv", "profile.png", "series.csv")


def prepare(case: Case, dialect: Dialect, ranks: int = 1) -> tuple[JanssenNumerics, Deck]:
    """The numerics and the deck of a piston. Raises InputError for a bad case."""
    scene = scene_of(case)
    if dialect is not IN_HOUSE:
        check_contact(scene, dialect)
    numerics = derive(scene, ranks)
    column = packed_column(scene)
    return numerics, build(scene, numerics, column, case.name, VERSION, ranks, dialect)


def scene_of(case: Case) -> JanssenScene:
    """The scene of the case. Raises InputError when it is another."""
    if not isinstance(case.scene, JanssenScene):
        raise InputError(f"The case {case.name} is no piston; its scene is {case.scene.scene}.")
    return case.scene


def write_decks(
    case: Case, engine: Engine, ranks: int, out: str | Path | None
) -> tuple[Path, JanssenNumerics, Plan]:
    """The deck of a piston in a folder. Raises InputError before anything is written."""
    numerics, deck = prepare(case, engine.dialect, ranks)
    return deck_in(out, case, numerics, deck, engine), numerics, deck.plan


def run(case: Case, asked: Asked) -> Result:
    """Fill the tube on so many ranks, or threads of the in-house engine, and answer.

    Raises InputError before anything is started, RunFailed when the engine does not finish.
    """
    with ExitStack() as own:
        return _run(case, asked, own)


def _run(case: Case, asked: Asked, until_end: ExitStack) -> Result:
    engine, scene = asked.engine, scene_of(case)
    own = engine.dialect is IN_HOUSE
    if own and engine.world().size > 1:
        raise InputError(
            "The engine dem fills a tube on the threads of one process; start it without mpiexec "
            "and with --ranks N."
        )
    with beginning(asked) as ranks:
        check_means(scene, derive(scene, ranks), engine, ranks, asked.out)
        found, alarms = _probed(scene, engine, asked.ignored_probes)
        expected = foresee(scene, derive(scene, ranks), engine, ranks)
        asked.progress("compile" if own and is_cold() else "packing", 0, 1)
        numerics, deck = prepare(case, engine.dialect, ranks)
        folder, record = laid_out(until_end, case, asked, numerics, deck, expected, found, alarms)
    outcome, found_all = gone_through(case, engine, record, folder, asked.progress, asked.timeout_s)
    expected.compare(outcome, _work(Record.read(folder), outcome.grains))
    return found_all


def gone_through(
    case: Case,
    engine: Engine,
    record: Record,
    folder: Path,
    progress: Progress = silent,
    timeout_s: float | None = None,
) -> tuple[Outcome, Result]:
    """The run of a deck in its folder, or the rest of it, and its answers."""
    enough = FillStopping(scene_of(case)) if record.plan.stoppable else None
    outcome, result = carried_out(engine, record, folder, progress, enough, timeout_s)
    record = _as_it_was(Record.read(folder), folder)
    whole = outcome.grains * record.plan.fills[-1][-1]
    result["grain_steps_per_s"] *= _work(record, outcome.grains) / whole
    return outcome, answered(folder, scene_of(case), record, result)


def _work(record: Record, grains: int) -> float:
    """Grains times steps of a column of so many `grains` at its last fill, with the lid's."""
    fills = record.plan.fills
    lid = grains - fills[-1][0]
    return float(sum((fill[0] + lid) * (fill[3] - fill[1]) for fill in fills))


def _as_it_was(record: Record, folder: Path) -> Record:
    """The record of a finished run with its fills as they were, in `run.json` too."""
    if not record.plan.stoppable:
        return record
    fills = read_fills(folder)
    plan = replace(record.plan, fills=fills, stages={"drive": fills[-1][-1]})
    record = replace(record, plan=plan)
    record.write(folder)
    return record


def _probed(
    scene: JanssenScene, engine: Engine, ignored: Sequence[str]
) -> tuple[list[Probe], list[str]]:
    """What is known of the engine's Hertz contacts; other laws are judged by the run itself."""
    if scene.grains.contact != "hertz" or engine.dialect is IN_HOUSE:
        return [], []
    modulus = derive(scene).stiffness.value
    return trusted(
        engine, Subject(contact_of(scene, modulus), scene.grains.density), PLANAR, ignored
    )


def answered(folder: Path, scene: JanssenScene, record: Record, result: dict[str, Any]) -> Result:
    """The answers from the files in the folder, written to `result.json`, tables and pictures."""
    series, found = _read(folder, scene, record)
    warnings = [*record.alarms, *found.warnings, *record.warnings]
    result = result | quantities_of(found.quantities) | found.to_dict() | {"warnings": warnings}
    balance = found.quantities["weight_balance"]
    result = watched(result, column_invariants(scene, series, balance))
    try:
        write_json(folder / RESULT, result)
        series.to_pandas().to_csv(folder / "series.csv")
        write_curve(scene, found, folder / "curve.csv")
        write_profile(found, folder / "profile.csv")
        pictures.draw_curve(scene, found, folder / "curve.png")
        pictures.draw_profile(scene, found, folder / "profile.png")
    except (OSError, RunFailed) as error:
        result["warnings"] = [f"Nothing was written to {folder}: {error}", *warnings]
    check_sound(result)
    return Result(folder, result, found.quantities, series, None, FILES)


def _read(folder: Path, scene: JanssenScene, record: Record) -> tuple[Series, JanssenAnswers]:
    """The series and the answers. Raises InputError when the engine's files are damaged."""
    engine, plan = engine_called(record.engine), record.plan
    fills = [
        FillWindow(count, mobilised * plan.time_step, end * plan.time_step)
        for count, _, mobilised, end in plan.fills
    ]
    with reading(folder):
        series, profiles = engine.series(plan, folder), list(engine.profiles(plan, folder))
        if not profiles or profiles[-1].time < fills[-1].end * (1.0 - 1e-9):
            raise ValueError("the profiles end before the run")
        if fills[-1].end - series.time[-1] > (plan.row_every - 0.5) * plan.time_step:
            raise ValueError("the series ends before the run")
        return series, answers(scene, series, profiles, fills)
