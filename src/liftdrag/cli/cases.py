"""Cases: listed, explained, written as decks."""

from __future__ import annotations

import json
import shlex
from pathlib import Path
from typing import Annotated

import typer

from liftdrag.cli.options import CaseEngine, CaseName, EnginePath, Ranks, Settings, case_of
from liftdrag.errors import InputError


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


def schema(
    scene: Annotated[str, typer.Argument(help="The scene: tank, drag2d, janssen or shear.")],
) -> None:
    """Print the JSON schema of a scene's case file, for editors."""
    from liftdrag.scene import SCENES

    if scene not in SCENES:
        raise InputError(f"There is no scene {scene!r}; choose one of {', '.join(SCENES)}.")
    print(json.dumps(SCENES[scene].model_json_schema(), indent=2))


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

    folder, text, command = build(case_of(case, settings), out, engine, ranks, engine_path)
    print(text, end="")
    there = shlex.quote(str(folder))
    print(f"The deck is in {folder}; by hand: cd {there} && {command}")


def _first_comment(text: str) -> str:
    first = text.splitlines()[0]
    return first.lstrip("# ") if first.startswith("#") else ""
