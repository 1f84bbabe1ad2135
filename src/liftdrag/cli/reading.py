"""Results read again: averaged, on a page, for ParaView."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from liftdrag.cli.options import Bench, Json, refuse_options
from liftdrag.cli.printing import show, show_forces


def analyze(
    context: typer.Context,
    path: Annotated[
        Path, typer.Argument(metavar="PATH", help="The folder of a run, or your own force file.")
    ],
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

        refuse_options(context, {"path", "bench", "as_json"})
        kind = replicas if replicas.is_replicas(path) else runner
        show(kind.analyze(path, bench), as_json)
        return
    from liftdrag.analysis.forces import Columns, answers, read_forces

    columns = Columns(drag, lift, sign, unit, time_column, time_step)
    show_forces(answers(read_forces(path, form, columns), discard), as_json)


def report(
    folders: Annotated[
        list[Path],
        typer.Argument(metavar="DIR", help="Folders of runs, replicas or studies."),
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


def vtk(
    folder: Annotated[
        Path, typer.Argument(metavar="DIR", help="Folder of a run with --dump, or of a shear flow.")
    ],
) -> None:
    """Write the trajectory of a run for ParaView; OVITO opens trajectory.dump itself."""
    from liftdrag.trajectory import write_vtk

    print(f"ParaView opens {write_vtk(folder)}")
