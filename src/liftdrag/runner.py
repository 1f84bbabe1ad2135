"""One run, from a case to its result."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from liftdrag import ensemble, piston, seal, sheared, tank
from liftdrag.analysis.biases import read_biases
from liftdrag.case import Case
from liftdrag.deck.dialect import IN_HOUSE
from liftdrag.deck.drag2d import check_shape
from liftdrag.engines import engine as engine_called
from liftdrag.engines import spatial
from liftdrag.engines.base import Engine, Progress, silent
from liftdrag.engines.probes import check_names
from liftdrag.errors import InputError
from liftdrag.execution import Asked, check_ranks
from liftdrag.folder import (
    RECORD,
    RESULT,
    Record,
    check_free,
    read_json,
)
from liftdrag.numerics import explained
from liftdrag.result import Result, budgeted
from liftdrag.scene import Drag2DScene, JanssenScene, ShearScene, TankScene


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

    The engine is LAMMPS for a tank and a piston, `dem` in the plane, for a shear flow and for
    contacts that no other engine has, unless named; the ranks are one (threads of `dem`)
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
        check_ranks(ranks)
    biases = None if bench is None else read_biases(Path(bench))
    asked = Asked(chosen, out, ranks, dump, progress, ignore_probes, timeout_s)
    if isinstance(case.scene, Drag2DScene):
        _refuse_dump(dump, "the moments of each packing are kept in any case")
        found = ensemble.run(case, asked)
    elif isinstance(case.scene, JanssenScene):
        _refuse_dump(dump, "a column leaves its profiles")
        found = piston.run(case, asked)
    elif isinstance(case.scene, ShearScene):
        found = sheared.run(case, asked)
    else:
        found = tank.run(case, asked)
    return budgeted(found, case, biases)


def _refuse_dump(dump: bool, instead: str) -> None:
    if dump:
        raise InputError(f"--dump is for a tank or a shear flow; {instead}.")


def engine_for(case: Case, name: str | None, path: str | Path | None = None) -> Engine:
    """The engine of this name, or that of the case's scene. Raises InputError."""
    scene, place = case.scene, None if path is None else Path(path)
    if isinstance(scene, TankScene):
        return spatial(name or "lammps", place)
    usual = "dem"
    if isinstance(scene, JanssenScene) and scene.grains.contact != "walton-braun":
        usual = "lammps"
    return engine_called(name or usual, place)


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
        check_ranks(ranks)
        folder, filled, plan = piston.write_decks(case, chosen, ranks, out)
        here = f"{program} ." if chosen.dialect is IN_HOUSE else f"{program} -in {plan.start}"
        return folder, explained(filled), here
    if isinstance(case.scene, ShearScene):
        check_ranks(ranks)
        folder, cell = sheared.write_decks(case, chosen, ranks, out)
        return folder, explained(cell), f"{program} ."
    folder, numerics, plan = tank.write_decks(case, chosen, ranks, out)
    return folder, explained(numerics), f"{program} -in {plan.start}"


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
    seal.check(folder, record, old.get("sealed"))
    if isinstance(case.scene, Drag2DScene):
        found = ensemble.answered(folder, case.scene, record, old)
    elif isinstance(case.scene, JanssenScene):
        found = piston.answered(folder, case.scene, record, old)
    elif isinstance(case.scene, ShearScene):
        found = sheared.answered(folder, case.scene, record, old)
    else:
        found = tank.answered(folder, case, record, old)
    return budgeted(found, case, biases)


def recorded(folder: Path, record: Record) -> Case:
    """The case of a folder's record. Raises InputError when it is damaged."""
    case = Case(record.case, record.tables)
    try:
        case.scene  # noqa: B018 - a case that was run is a good one
    except InputError:
        raise InputError(f"{folder / RECORD} is damaged; run the case again.") from None
    return case
