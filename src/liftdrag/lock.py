"""The lock of a run's folder: one liftdrag at a time, and free once its holder is dead.

The engine that the holder starts keeps the lock too, so that nobody writes beside one that has
outlived liftdrag.
"""

from __future__ import annotations

import contextlib
import errno
import fcntl
import logging
import os
import platform
import re
import time
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import TextIO

from liftdrag.errors import InputError

LOCK = "run.lock"

PATIENCE_S = 10.0
"""How long the engine of a dead holder may take to end."""

_WITHOUT = (errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP)
_HOLDER = re.compile(r"process (\d+) on (\S+) since \S+")
_held = set[int]()
_log = logging.getLogger("liftdrag")


@contextlib.contextmanager
def held(folder: Path) -> Iterator[Path]:
    """The folder, which is this process's own for the block. Raises InputError, saying whose."""
    with _opened(folder) as file:
        _take(file, folder)
        _sign(file)
        _held.add(file.fileno())
        try:
            yield folder
        finally:
            _held.discard(file.fileno())


def check_unlocked(folder: Path) -> None:
    """Raise InputError when another process holds the folder."""
    if (folder / LOCK).exists():
        with _opened(folder) as file:
            _take(file, folder)


def is_held(folder: Path) -> bool:
    """Whether a process holds the folder, found without taking it from anyone."""
    try:
        with (folder / LOCK).open(encoding="utf-8") as file:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:
        return False
    return False


def descriptors() -> tuple[int, ...]:
    """The open locks, for an engine to keep."""
    return tuple(_held)


def _opened(folder: Path) -> TextIO:
    try:
        return (folder / LOCK).open("a+", encoding="utf-8")
    except OSError as error:
        raise InputError(f"The folder {folder} cannot be used: {error.strerror}.") from None


def _take(file: TextIO, folder: Path) -> None:
    until = time.monotonic() + PATIENCE_S
    while not _locked(file, folder):
        file.seek(0)
        holder = file.read().strip() or "another process"
        if _lives(holder) or time.monotonic() > until:
            raise InputError(
                f"The folder {folder} is in use by {holder}, or by its engine; wait for it, or "
                "choose another folder."
            )
        time.sleep(0.1)


def _locked(file: TextIO, folder: Path) -> bool:
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError as error:
        if error.errno not in _WITHOUT:
            raise InputError(f"The folder {folder} cannot be used: {error.strerror}.") from None
        _log.warning("WARNING: The file system of %s has no locks; run one liftdrag there.", folder)
    return True


def _lives(holder: str) -> bool:
    """Whether another process that a lock names may live: it does, or is of another machine."""
    match = _HOLDER.fullmatch(holder)
    if match is None or match[1] == str(os.getpid()):
        return False
    if match[2] == platform.node():
        with contextlib.suppress(PermissionError):
            try:
                os.kill(int(match[1]), 0)
            except (ProcessLookupError, OverflowError):
                return False
    return True


def _sign(file: TextIO) -> None:
    """Write down who holds the lock, where the disk lets it."""
    now = datetime.now(UTC).isoformat(timespec="seconds")
    with contextlib.suppress(OSError):
        file.truncate(0)
        file.write(f"process {os.getpid()} on {platform.node()} since {now}\n")
        file.flush()
