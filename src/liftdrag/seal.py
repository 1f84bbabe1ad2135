"""The seal of a finished run: digests of the files that it wrote, which its answers come from."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from liftdrag.errors import InputError
from liftdrag.files import is_file

OWN = ("*.dat", "*.dump", "*.npz", "forces.csv", "fills.csv")
OF_PACKINGS = ("*.dat", "*.dump", "*.npz", "series.csv")
"""What engines write of a run and of each packing: series, profiles and frames."""


def digests(folder: Path) -> dict[str, str]:
    """SHA-256 of each file by its name. Raises OSError."""
    return {file.relative_to(folder).as_posix(): _digest(file) for file in _files(folder)}


def check(folder: Path, sealed: Any) -> None:
    """Raise InputError where a file is not what it was; None, of an older run, says nothing."""
    if sealed is None:
        return
    try:
        found = digests(folder)
    except OSError as error:
        raise _broken(folder, str(error)) from None
    if not isinstance(sealed, dict):
        raise _broken(folder, "result.json holds no digests")
    if wrong := sorted(name for name, digest in sealed.items() if found.get(name) != digest):
        raise _broken(folder, f"{wrong[0][:60]} is not what the run wrote")


def _broken(folder: Path, what: str) -> InputError:
    return InputError(f"The files in {folder} are damaged ({what}); run the case again.")


def _files(folder: Path) -> Iterator[Path]:
    for pattern in (*OWN, *(f"packing-*/{name}" for name in OF_PACKINGS)):
        yield from (file for file in sorted(folder.glob(pattern)) if is_file(file))


def _digest(file: Path) -> str:
    with file.open("rb") as opened:
        return hashlib.file_digest(opened, "sha256").hexdigest()
