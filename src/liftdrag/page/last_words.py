"""The last lines that an engine wrote in a folder."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

from liftdrag.files import check_ordinary

LOGS = ("log.lammps", "log.liggghts", "engine.out")

LINES = 12

_BYTES = 20_000


def last_words(folder: Path) -> str:
    """Of each log, and of each packing that failed; empty where there is nothing."""
    parts = [part for name in LOGS if (part := _tail(folder / name))]
    return "\n".join([*parts, *_packings(folder)])


def _packings(folder: Path) -> Iterator[str]:
    for path in sorted(folder.glob("packing-*/outcome.json")):
        try:
            found = json.loads(path.read_bytes())
            if found["status"] != "finished":
                yield f"{found['reason']}\n{found['evidence']}".rstrip()
        except (OSError, ValueError, LookupError, TypeError):
            continue


def _tail(path: Path) -> str:
    """The last lines of a file that are not blank."""
    try:
        check_ordinary(path)
        with path.open("rb") as file:
            file.seek(max(path.stat().st_size - _BYTES, 0))
            read = file.read().decode("utf-8", "replace")
    except OSError:
        return ""
    return "\n".join([line for line in read.splitlines() if line.strip()][-LINES:])
