"""What a bench, or a stability map, begins with: its case, its engine and its folder."""

from __future__ import annotations

from pathlib import Path

from liftdrag.bench.judged import tolerances
from liftdrag.bench.runs import Stand
from liftdrag.case import Case
from liftdrag.engines.base import Engine
from liftdrag.runner import engine_for
from liftdrag.scene import Scene


def prepared(
    case: Case, name: str | None, path: str | Path | None, out: str | Path | None, kind: str
) -> tuple[Case, Engine, Path]:
    """The case, run to its end whatever would stop it, the engine of this name, and the folder.

    That is `out`, or below runs/ that of the `kind`. Raises InputError where the engine is not
    there.
    """
    whole = Case(case.name, {key: table for key, table in case.tables.items() if key != "stop"})
    engine = engine_for(whole, name, path)
    engine.check(1)
    return whole, engine, Path("runs") / kind / case.name if out is None else Path(out)


def stand_of(folder: Path, engine: Engine, path: str | Path | None, scene: Scene) -> Stand:
    """Where its runs are, on an engine from a `path`, and what of the scene is judged."""
    place = None if path is None else Path(path)
    return Stand(folder, engine.name, engine.about().version, place, tuple(tolerances(scene)))
