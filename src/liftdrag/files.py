"""Files that others wrote: looked at before they are opened, and read no further than a bound."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from itertools import takewhile
from pathlib import Path
from stat import S_ISDIR, S_ISREG


def is_file(path: Path) -> bool:
    """Whether there is a file of this name; a name that no file can have is none."""
    return S_ISREG(_mode(path))


def is_folder(path: Path) -> bool:
    """Whether there is a folder of this name; a name that no folder can have is none."""
    return S_ISDIR(_mode(path))


def _mode(path: Path) -> int:
    try:
        return path.stat().st_mode
    except (OSError, ValueError):
        return 0


def check_ordinary(path: Path) -> None:
    """Raise OSError where there is no file, or a device or pipe, which may never end."""
    if not S_ISREG(path.stat().st_mode):
        what = "Is a directory" if path.is_dir() else "it is no ordinary file"
        raise OSError(0, what, os.fspath(path))


def whole_lines(file: Iterable[str]) -> Iterator[str]:
    """The lines of a file that have their newline, up to one that is still being written."""
    return takewhile(lambda line: line.endswith("\n"), file)


def read_bytes(path: Path, most: int) -> bytes:
    """What a file holds. Raises OSError as `check_ordinary`, and for more than `most` bytes."""
    check_ordinary(path)
    with path.open("rb") as file:
        found = file.read(most + 1)
    if len(found) > most:
        raise OSError(0, f"it is larger than {most} bytes", os.fspath(path))
    return found


def text(path: Path) -> str:
    """The text of a file, or none when it does not exist."""
    return path.read_text("utf-8", "replace") if path.exists() else ""
