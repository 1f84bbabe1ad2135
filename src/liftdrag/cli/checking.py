"""Whether an engine is sound."""

from __future__ import annotations

import json
from typing import Annotated

import typer

from liftdrag.cli.options import EngineName, EnginePath, PlainJson
from liftdrag.cli.printing import print_tables
from liftdrag.errors import InputError, RunFailed


def doctor(
    engine: Annotated[
        str | None, typer.Option(help="Only this engine; by default each that is installed.")
    ] = None,
    engine_path: EnginePath = None,
    as_json: PlainJson = False,
) -> None:
    """Show the engines of this machine, and probe whether each computes contacts right."""
    from liftdrag.doctor import examine
    from liftdrag.engines import ENGINES
    from liftdrag.progress import spinning
    from liftdrag.terminal import engine_table, probe_table

    if engine_path is not None and engine is None:
        raise InputError("--engine-path needs --engine: say whether it is lmp or liggghts.")
    names = ENGINES if engine is None else (engine,)
    with spinning() as tell:
        found = [examine(name, engine_path, tell) for name in names]
    if engine is not None and found[0].missing:
        raise InputError(found[0].missing)
    if as_json:
        print(json.dumps([patient.to_dict() for patient in found], indent=2))
    else:
        print_tables(engine_table(found), probe_table(found))
    if not all(patient.healthy for patient in found):
        failing = ", ".join(patient.name for patient in found if not patient.healthy)
        raise RunFailed("engine_error", f"Failing a probe, or not where it was named: {failing}.")


def verify(
    engine: EngineName = "lammps", engine_path: EnginePath = None, as_json: PlainJson = False
) -> None:
    """Test an engine with two bodies, against closed forms and published values."""
    from liftdrag.engines import spatial
    from liftdrag.progress import spinning
    from liftdrag.terminal import check_table, convergence_table
    from liftdrag.verify import verified

    chosen = spatial(engine, engine_path)
    chosen.check(1)
    with spinning() as tell:
        found = verified(chosen, tell)
    if as_json:
        print(json.dumps(found.to_dict(), indent=2))
    else:
        print_tables(check_table(found), convergence_table(found))
    if not found.passed:
        failed = sum(not check.passed for check in found.checks)
        raise RunFailed("engine_error", f"{chosen.name} fails {failed} of the tests.")
