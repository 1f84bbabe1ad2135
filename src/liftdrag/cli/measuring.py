"""Run time against error, and what breaks a case."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from liftdrag.cli.options import CaseEngine, CaseName, EnginePath, PlainJson, Settings, case_of
from liftdrag.cli.printing import print_lines, print_tables

if TYPE_CHECKING:
    from liftdrag.bench import Benched
    from liftdrag.stress import Stressed

Budget = Annotated[
    str, typer.Option(help="Time on the clock: 90s, 30m or 2h. The same command goes on.")
]
Out = Annotated[
    Path | None,
    typer.Option(help="Folder of the answers; by default runs/bench/CASE or runs/stress/CASE."),
]
Jobs = Annotated[
    int | None, typer.Option(help="Runs at a time, each on one core; by default one a core.")
]
Axes = Annotated[
    str | None,
    typer.Option(metavar="A,B", help="Only these choices: time_step,stiffness. Default: all."),
]


def bench(
    case: CaseName,
    engine: CaseEngine = None,
    engine_path: EnginePath = None,
    budget: Budget = "30m",
    out: Out = None,
    jobs: Jobs = None,
    axes: Axes = None,
    settings: Settings = None,
    as_json: PlainJson = False,
) -> None:
    """Measure run time against error: what each choice of a case costs and does to the answer."""
    from liftdrag.bench import bench as run_bench
    from liftdrag.bench import seconds
    from liftdrag.progress import spinning
    from liftdrag.terminal import bench_table

    budget_s, chosen = seconds(budget), case_of(case, settings)
    with spinning() as tell:
        found = run_bench(chosen, engine, out, budget_s, jobs, _names(axes), engine_path, tell)
    if as_json:
        print(json.dumps(found.to_dict(), indent=2))
        return
    print_tables(bench_table(found))
    print_lines([*found.block().splitlines(), *found.notes, *_left(found, budget)])
    print(f"In {found.stand.folder}: bench.csv, bench.json, bench.png, numerics.toml")


def stress(
    case: CaseName,
    engine: CaseEngine = None,
    engine_path: EnginePath = None,
    budget: Budget = "10m",
    out: Out = None,
    jobs: Jobs = None,
    axes: Axes = None,
    settings: Settings = None,
    as_json: PlainJson = False,
) -> None:
    """Map the stability of a case: which steps, grains and speeds break it, and by what."""
    from liftdrag.bench import seconds
    from liftdrag.progress import spinning
    from liftdrag.stress import stress as run_stress
    from liftdrag.terminal import stress_table

    budget_s, chosen = seconds(budget), case_of(case, settings)
    with spinning() as tell:
        found = run_stress(chosen, engine, out, budget_s, jobs, _names(axes), engine_path, tell)
    if as_json:
        print(json.dumps(found.to_dict(), indent=2))
        return
    print_tables(stress_table(found))
    print_lines([*found.lines(), *_left(found, budget)])
    print(f"In {found.stand.folder}: stability.csv, stability.png, stress.json")


def _names(axes: str | None) -> list[str]:
    """The choices of an option: a,b."""
    return [name.strip() for name in axes.split(",")] if axes else []


def _left(found: Benched | Stressed, budget: str) -> list[str]:
    """What is to be said of what the budget was too short for."""
    if not found.left:
        return []
    rest = ", ".join(found.left)
    return [f"Left out for the budget of {budget}, and the same command goes on with it: {rest}."]
