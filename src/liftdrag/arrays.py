"""Arrays that were kept in a file, read back."""

from __future__ import annotations

import zlib
from pathlib import Path
from zipfile import BadZipFile

import numpy as np

from liftdrag.files import check_ordinary

MOST_BYTES = 2_000_000_000
"""The largest file, unpacked."""

_DAMAGE = (LookupError, TypeError, EOFError, BadZipFile, RuntimeError, zlib.error)


def read_arrays(path: Path) -> dict[str, np.ndarray]:
    """The arrays of an .npz file by name.

    Raises OSError when there is none, ValueError when it is damaged or too large.
    """
    check_ordinary(path)
    try:
        with np.load(path, allow_pickle=False) as file:
            if sum(part.file_size for part in file.zip.infolist()) > MOST_BYTES:
                raise ValueError(f"{path} unpacks to more than {MOST_BYTES} bytes")
            return {name: file[name] for name in file.files}
    except _DAMAGE as error:
        raise ValueError(f"{path} is damaged: {error}") from None
