"""Runs of a case, and of a study."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from liftdrag.cli.options import (
    Bench,
    CaseEngine,
    EnginePath,
    Json,
    RunCase,
    Settings,
    Workers,
    case_of,
    refuse_options,
)
from liftdrag.cli.printing import print_lines, print_tables, show
from liftdrag.errors import InputError

RESUMING = set("case engine engine_path ranks out settings timeout as_json resume".split())
"""What may be said with --resume."""


def run(
    context: typer.Context,
    case: RunCase = None,
    engine: CaseEngine = None,
    engine_path: EnginePath = None,
    ranks: Workers = None,
    out: Annotated[
        Path | None, typer.Option(help="Folder of the run; by default a new one below runs/.")
    ] = None,
    settings: Settings = None,
    dump: Annotated[bool, typer.Option("--dump", help="Write trajectory.dump to look at.")] = False,
    ignore_probe: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help="Run although the engine fails this probe of doctor."),
    ] = None,
    replicas: Annotated[
        int,
        typer.Option(help="Runs with seeds of their own, one a core, whose answers are pooled."),
    ] = 1,
    cores: Annotated[
        int | None,
        typer.Option(help="Use so many cores in the way done sooner: by ranks or by replicas."),
    ] = None,
    bench: Bench = None,
    resume: Annotated[
        bool,
        typer.Option("--resume", help="Go on with the run in --out, where it was cut short."),
    ] = False,
    timeout: Annotated[
        str | None, typer.Option(help="End the run after this time: 90s, 30m or 2h.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Run a case and answer with averages and standard errors: drag and lift, or a curve."""
    from liftdrag.bench import seconds
    from liftdrag.progress import reported
    from liftdrag.replicas import run as run_replicas
    from liftdrag.replicas import spread
    from liftdrag.resume import resume as go_on
    from liftdrag.runner import run as run_case
    from liftdrag.trajectory import offer

    timeout_s = None if timeout is None else seconds(timeout, "--timeout")
    if resume:
        refuse_options(context, RESUMING, "is not for --resume, which goes on with what began")
        given = None if case is None else case_of(case, settings)
        with reported() as progress:
            found = go_on(given, out, engine, ranks, progress, engine_path, timeout_s)
        show(found, as_json)
        return
    if case is None:
        raise InputError("Name a case to run; 'liftdrag cases' lists the packaged ones.")
    chosen, ignored = case_of(case, settings), ignore_probe or ()
    _check_together(cores, replicas, ranks is not None or dump or timeout is not None)
    with reported() as progress:
        if cores is not None:
            way = spread(chosen, cores, engine, engine_path)
            chosen, ranks, replicas = way.case, way.ranks, way.replicas
        if replicas == 1:
            result = run_case(
                chosen, out, engine, ranks, dump, progress, engine_path, ignored, bench, timeout_s
            )
        else:
            result = run_replicas(
                chosen, replicas, out, engine, progress, engine_path, ignored, bench
            )
    show(result, as_json)
    if dump:
        opened = offer(result.folder)
        print(opened, file=sys.stderr if as_json else sys.stdout)


def _check_together(cores: int | None, replicas: int, single: bool) -> None:
    """Raise InputError where --cores or --replicas comes with an option of a `single` run."""
    if cores is not None and (replicas != 1 or single):
        raise InputError("--cores chooses; leave out --ranks, --replicas, --dump and --timeout.")
    if replicas != 1 and single:
        raise InputError(
            "--replicas takes a core for each run; leave out --ranks, --dump and --timeout."
        )


def sweep(
    context: typer.Context,
    study: Annotated[
        str, typer.Argument(metavar="STUDY", help="A study file, or a packaged study: zhou/tables.")
    ],
    out: Annotated[
        Path | None, typer.Option(help="Folder of the study; by default runs/STUDY.")
    ] = None,
    jobs: Annotated[
        int | None,
        typer.Option(help="Runs at a time, in processes of their own; by default one a core."),
    ] = None,
    ranks: Annotated[
        int | None, typer.Option(help="Ranks of each run, or its packings at a time.")
    ] = None,
    scale: Annotated[
        str | None, typer.Option(help="One of the study's scales, by default the first.")
    ] = None,
    settings: Settings = None,
    slurm: Annotated[
        bool, typer.Option("--slurm", help="Submit what is missing to SLURM, and end.")
    ] = False,
    status: Annotated[
        bool, typer.Option("--status", help="Show how far the runs are, and start none.")
    ] = False,
) -> None:
    """Run what has not finished yet of a study, and weigh its claims."""
    from liftdrag import study as studies
    from liftdrag.sweeping import watched
    from liftdrag.terminal import claim_table, growth_lines, run_table, state_table

    if slurm or status:
        why = "is for runs on this machine; leave it out with --slurm and --status"
        refuse_options(context, {"study", "out", "scale", "settings", "slurm", "status"}, why)
    if status:
        found = studies.status(study, out, settings, scale)
    elif slurm:
        found, submitted = studies.on_slurm(study, out, settings, scale)
        for number in submitted:
            print(f"Submitted batch job {number}")
    else:
        with watched() as watch:
            found = studies.sweep(study, out, settings, jobs, ranks, scale, watch)
    shown = [state_table(found)] if slurm or status else []
    print_tables(*shown, run_table(found), *([claim_table(found)] if found.findings else []))
    print_lines(growth_lines(found))
    if found.folder.exists():
        print(f"In {found.folder}: points.csv, runs.csv, claims.csv, the pictures, and runs/")
    if not slurm and not status:
        found.check()
