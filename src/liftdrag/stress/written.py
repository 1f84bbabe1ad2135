"""The folder of a stability map: begun, and written whole at the end."""

from __future__ import annotations

import errno
from pathlib import Path
from typing import Any

from liftdrag.case import Case
from liftdrag.errors import InputError, RunFailed
from liftdrag.folder import read_json, write_json
from liftdrag.pictures.stress import Dot, draw_map
from liftdrag.stress.outcome import REFUSED, Outcome, axis_of
from liftdrag.stress.stressed import Stressed

STRESS = "stress.json"


def begun(folder: Path, case: Case, engine: str, short: Case) -> Case:
    """The short case of the folder: `short` where it is new, else what it was begun with.

    Raises InputError when the folder is that of something else.
    """
    try:
        if not folder.exists() or (folder.is_dir() and not any(folder.iterdir())):
            folder.mkdir(parents=True, exist_ok=True)
            record = {"tables": dict(case.tables), "engine": engine, "short": dict(short.tables)}
            write_json(folder / STRESS, record)
    except OSError as error:
        raise InputError(f"The folder {folder} cannot be used: {error.strerror}.") from None
    found = _read(folder)
    if found.get("tables") != dict(case.tables) or found.get("engine") != engine:
        raise InputError(
            f"{folder} holds something else than a stability map of this case on {engine}; "
            "choose another --out, or remove it."
        )
    return Case(case.name, found["short"])


def _read(folder: Path) -> dict[str, Any]:
    try:
        return read_json(folder / STRESS)
    except InputError:
        return {}


def write(found: Stressed) -> None:
    """The table and the picture. Raises RunFailed."""
    import pandas as pd

    folder = found.stand.folder
    write_json(folder / STRESS, found.to_dict())
    try:
        pd.DataFrame(list(found.rows())).to_csv(folder / "stability.csv", index=False)
        _draw(found, folder / "stability.png")
    except OSError as error:
        status = "disk_full" if error.errno == errno.ENOSPC else "engine_error"
        raise RunFailed(status, f"Nothing was written to {folder}: {error.strerror}.") from None


def _draw(found: Stressed, path: Path) -> None:
    dots: dict[str, list[Dot]] = {}
    for one in found.outcomes:
        dots.setdefault(axis_of(one.tried.run.key), []).append(_dot(found, one))
    if dots:
        bounds = found.bounds
        steps = {"its own": bounds.own, "worst": bounds.earliest, "predicted": bounds.expected}
        title = f"{found.case.name} on {found.stand.engine}: what breaks it"
        draw_map(title, dots, steps, bounds.name, path)


def _dot(found: Stressed, one: Outcome) -> Dot:
    share, run = found.share(one), one.tried.run
    deepest = one.tried.invariants.get("largest_overlap")
    return Dot(
        float(found.short.tables["seed"] + run.replica - 1) if share is None else share,
        REFUSED if REFUSED in one.causes else next(iter(one.causes), "whole"),
        None if deepest is None else deepest["value"] / deepest["bound"],
        one.heating,
        max((abs(d.relative) for d in one.deviations.values()), default=None),
    )
