"""What an engine is, for the provenance of a run: its version, place, MPI and digest."""

from __future__ import annotations

import contextlib
import hashlib
import re
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from liftdrag.engines.base import Engine

_LIBRARY = re.compile(r"=> (/\S*lib(?:lammps|liggghts)\S*)")


def identity(engine: Engine) -> dict[str, Any]:
    """Its name, version, place and MPI, and the SHA-256 of the files that it is.

    Those are the program and its own shared library, or the wheel's library.
    """
    about = engine.about()
    return {
        "name": about.name,
        "version": about.version,
        "path": str(about.path),
        "mpi": about.mpi,
        "sha256": {str(file): _digest(file) for file in _files(about.path)},
    }


def _files(path: Path) -> Iterator[Path]:
    if path.is_dir():
        yield from sorted(path.glob("liblammps*.so*"))
        return
    yield path
    with contextlib.suppress(OSError, subprocess.TimeoutExpired):
        done = subprocess.run(["ldd", path], capture_output=True, text=True, timeout=30)
        yield from (Path(found) for found in _LIBRARY.findall(done.stdout))


def _digest(file: Path) -> str:
    with file.open("rb") as opened:
        return hashlib.file_digest(opened, "sha256").hexdigest()
