"""The folder of a run: found free, written whole, read with suspicion."""

from __future__ import annotations

import contextlib
import errno
import hashlib
import json
import os
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from liftdrag.deck import Plan
from liftdrag.errors import InputError, RunFailed
from liftdrag.lock import LOCK, check_unlocked, held

RECORD = "run.json"
RESULT = "result.json"

FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
"""What the system says where nothing more can be written."""


@dataclass(frozen=True)
class Record:
    """What a run's folder must say about itself to be read again: `run.json`.

    `warnings` are of the numerics, `alarms` are what a reader must know before anything else;
    `estimate` is what the run was expected to cost.
    """

    case: str
    tables: dict[str, Any]
    engine: str
    plan: Plan
    warnings: list[str]
    provenance: dict[str, Any]
    alarms: list[str] = field(default_factory=list)
    estimate: dict[str, Any] = field(default_factory=dict)

    def write(self, folder: Path) -> None:
        """Write it into the folder. Raises RunFailed."""
        write_json(folder / RECORD, asdict(self))

    def changed(self, folder: Path) -> list[str]:
        """The files of the deck that are not what they were when they were written."""
        return changed(folder, self.provenance.get("deck_files", {}))

    @classmethod
    def read(cls, folder: Path) -> Record:
        """The record of a folder. Raises InputError when it is missing or damaged."""
        found = read_json(folder / RECORD)
        try:
            record = cls(**found | {"plan": Plan(**found["plan"])})
            if isinstance(record.tables, dict) and isinstance(record.alarms, list):
                return record
            raise TypeError
        except (KeyError, TypeError):
            raise _damaged(folder / RECORD) from None


def changed(folder: Path, digests: Mapping[str, str]) -> list[str]:
    """The names of the files that do not have these digests any more."""
    return [name for name, digest in digests.items() if _digest(folder / name) != digest]


def _digest(file: Path) -> str:
    """SHA-256 of a file, none when it cannot be read."""
    try:
        return hashlib.sha256(file.read_bytes()).hexdigest()
    except OSError:
        return ""


def fresh(out: str | Path | None, name: str, parent: str = "runs") -> Path:
    """A folder to write to: `out`, which must be empty or new, or the next free one."""
    try:
        return _next_free(Path(parent) / name) if out is None else _empty(Path(out))
    except (OSError, ValueError) as error:
        if isinstance(error, InputError):
            raise
        reason = getattr(error, "strerror", None) or error
        raise InputError(f"The folder {out or parent} cannot be used: {reason}.") from None


@contextlib.contextmanager
def claimed(out: str | Path | None, name: str) -> Iterator[Path]:
    """A `fresh` folder for a run, locked for the block. Raises InputError."""
    with held(fresh(out, name)) as folder:
        yield folder


def check_free(out: str | Path | None) -> None:
    """Raise InputError when `out` is given and in use, before anything is done for it."""
    if out is not None and Path(out).exists():
        fresh(out, "")


def _empty(folder: Path) -> Path:
    if folder.is_dir():
        check_unlocked(folder)
    if folder.exists() and (not folder.is_dir() or _used(folder)):
        raise InputError(f"--out {folder} exists and is not an empty folder; choose another.")
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def _used(folder: Path) -> bool:
    return any(entry.name != LOCK for entry in folder.iterdir())


def _next_free(base: Path) -> Path:
    number, folder = 1, base
    while True:
        try:
            folder.mkdir(parents=True)
        except FileExistsError:
            number += 1
            folder = base.with_name(f"{base.name}-{number}")
        else:
            return folder


def read_json(path: Path) -> dict[str, Any]:
    """A JSON object of a file. Raises InputError when it is missing or damaged."""
    try:
        found = json.loads(path.read_text("utf-8"))
    except FileNotFoundError:
        raise InputError(
            f"{path.parent} holds no {path.name}: no run of liftdrag has ended there."
        ) from None
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror}.") from None
    except ValueError:
        raise _damaged(path) from None
    if not isinstance(found, dict):
        raise _damaged(path)
    return found


def _damaged(path: Path) -> InputError:
    return InputError(f"{path} is damaged; run the case again.")


def write_json(path: Path, record: Mapping[str, Any]) -> None:
    """Write a whole file or none: to a name beside it first, then renamed. Raises RunFailed."""
    beside = path.with_suffix(".part")
    try:
        with writing(path):
            with beside.open("w", encoding="utf-8") as file:
                json.dump(record, file, indent=2)
                file.flush()
                os.fsync(file.fileno())
            beside.replace(path)
            _keep_names(path.parent)
    except RunFailed:
        with contextlib.suppress(OSError):
            beside.unlink(missing_ok=True)
        raise


@contextlib.contextmanager
def writing(path: Path) -> Iterator[None]:
    """Turn what the system says of a write to `path` into RunFailed, in a sentence."""
    try:
        yield
    except OSError as error:
        status = "disk_full" if error.errno in FULL else "engine_error"
        raise RunFailed(status, f"{path} cannot be written: {error.strerror}.") from None


def _keep_names(folder: Path) -> None:
    """Have the names of a folder's files on the disk, as their contents are."""
    place = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(place)
    finally:
        os.close(place)
