"""The command line: arguments in, one call, printing."""

from __future__ import annotations

import signal
import sys
from io import TextIOWrapper
from types import FrameType
from typing import Annotated, NoReturn

import typer

from liftdrag.cli.cases import build_deck, cases, schema
from liftdrag.cli.checking import doctor, verify
from liftdrag.cli.measuring import bench, stress
from liftdrag.cli.reading import analyze, report, vtk
from liftdrag.cli.running import run, sweep
from liftdrag.errors import InputError, RunFailed, escaped

INTERRUPTED = 130
"""The status that typer makes of an interruption."""

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


@app.callback()
def options(
    debug: Annotated[bool, typer.Option("--debug", help="Show tracebacks.")] = False,
) -> None:
    """Options that come before the command."""
    _Debug.on = debug


class _Debug:
    on = False


app.command()(cases)
app.command()(schema)
app.command("build-deck")(build_deck)
for command in (run, sweep, bench, stress, analyze, report, vtk, doctor, verify):
    app.command()(command)


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
