"""Compilation by numba, kept on disk and paid once.

numba looks for changes in the file of a compiled function only, not in those of the functions
that it calls. So the folder of the cache is named after the whole package's text: any change
compiles all of it anew, and none uses what was compiled from other text.
"""

from __future__ import annotations

import hashlib
import os
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numba

if "NUMBA_THREADING_LAYER_PRIORITY" not in os.environ:  # the others sleep between two loops
    _settings: Any = numba.config
    _settings.THREADING_LAYER_PRIORITY = ["omp", "tbb", "workqueue"]

LEAST_ROOM = 10_000_000
"""Bytes that the cache may need."""


@cache
def _folder() -> str:
    sources = sorted(Path(__file__).parent.rglob("*.py"))
    digest = hashlib.sha256(b"".join(file.read_bytes() for file in sources)).hexdigest()[:16]
    parent = os.environ.get("XDG_CACHE_HOME") or str(Path("~/.cache").expanduser())
    folder = Path(parent) / "liftdrag" / "kernels" / digest
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder) as file:
            file.write(bytes(LEAST_ROOM))
    except OSError:
        return tempfile.mkdtemp(prefix="liftdrag-kernels-")
    return str(folder)


def is_cold() -> bool:
    """Whether nothing was compiled on this machine yet, which takes half a minute."""
    return not any(Path(_folder()).rglob("*.nbi"))


def compiled(parallel: bool = False, inline: bool = False) -> Callable[[Any], Any]:
    """A decorator: compile for this processor. Division by zero gives inf, as in C.

    `inline` is for the functions of the innermost loop, never called from Python.
    """

    def decorate(function: Any) -> Any:
        settings: Any = numba.config
        before = settings.CACHE_DIR
        settings.CACHE_DIR = f"{_folder()}/{'parallel' if parallel else 'serial'}"
        try:
            return numba.njit(
                function,
                cache=not inline,
                forceinline=inline,
                parallel=parallel,
                error_model="numpy",
                fastmath={"contract"},
                nogil=True,
            )
        finally:
            settings.CACHE_DIR = before

    return decorate
