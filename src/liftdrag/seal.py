"""The seal of a finished run: digests of what its answers come from, files and record."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

from liftdrag.files import is_file
from liftdrag.folder import RECORD, Record, broken

OWN = ("*.dat", "*.dump", "*.npz", "fills.csv", "forces.csv", "stresses.csv")
OF_PACKINGS = ("*.dat", "*.dump", "*.npz", "series.csv")
"""What engines write of a run and of each packing: series, profiles and frames."""

_STOPPED = ("fills", "stages", "start")
"""What a run that stops, or goes on, has otherwise than at first."""


def digests(folder: Path, record: Record) -> dict[str, str]:
    """SHA-256 of each file by its name, and of what was run. Raises OSError."""
    files = {file.relative_to(folder).as_posix(): _digest(file) for file in _files(folder)}
    return files | {RECORD: _digest_of(record)}


def check(folder: Path, record: Record, sealed: Any) -> None:
    """Raise InputError where a file is not what it was; None, of an older run, says nothing."""
    alone = record.tables["scene"] != "drag2d"  # packings have decks of their own
    if alone and (changed := record.changed(folder)):
        raise broken(folder, f"{changed[0][:60]} is not what the run wrote")
    if sealed is None:
        return
    try:
        found = digests(folder, record)
    except OSError as error:
        raise broken(folder, error) from None
    if not isinstance(sealed, dict):
        raise broken(folder, "result.json holds no digests")
    if wrong := sorted(name for name, digest in sealed.items() if found.get(name) != digest):
        raise broken(folder, f"{wrong[0][:60]} is not what the run wrote")


def _files(folder: Path) -> Iterator[Path]:
    for pattern in (*OWN, *(f"packing-*/{name}" for name in OF_PACKINGS)):
        yield from (file for file in sorted(folder.glob(pattern)) if is_file(file))


def _digest_of(record: Record) -> str:
    """That of the case and the plan, but for what an early stop changes in it."""
    plan = {name: value for name, value in asdict(record.plan).items() if name not in _STOPPED}
    text = json.dumps([record.tables, record.engine, plan], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()


def _digest(file: Path) -> str:
    with file.open("rb") as opened:
        return hashlib.file_digest(opened, "sha256").hexdigest()
