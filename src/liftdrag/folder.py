"""The folder of a run: found free, written whole, read with suspicion."""

from __future__ import annotations

import contextlib
import errno
import hashlib
import json
import os
import re
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field
from math import inf
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from liftdrag.deck import Plan
from liftdrag.errors import InputError, RunFailed, escaped, shown
from liftdrag.files import read_bytes
from liftdrag.lock import LOCK, check_unlocked, held

RECORD = "run.json"
RESULT = "result.json"

MOST_BYTES = 10_000_000
"""The largest record."""

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
        with contextlib.suppress(ValidationError):
            record = TypeAdapter(cls).validate_json(json.dumps(found), strict=True)
            if _is_sound(record.plan):
                return record
        raise InputError(
            f"The folder {escaped(str(folder))} holds no whole record of a run: its {RECORD} is "
            "damaged; remove the folder and run the case again."
        )


def _is_sound(plan: Plan) -> bool:
    """Whether its numbers can be reckoned with, and its files are those of its folder."""
    ours = all(re.fullmatch(r"[a-z]+\.(dat|csv)", name) for name in plan.series)
    return (
        ours and 0.0 < plan.time_step < inf and min(plan.row_every, plan.stages.get("drive", 0)) > 0
    )


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
    with _refused(out or parent):
        return _next_free(Path(parent) / _inside(name)) if out is None else _empty(Path(out))


def check_free(out: str | Path | None) -> None:
    """Raise InputError when `out`, or runs/, cannot be used, before anything is done for it."""
    if out is not None:
        with _refused(out):
            _check_empty(Path(out))
    check_place(Path(out or "runs"))


def check_place(folder: Path) -> None:
    """Raise InputError when nothing can be written to a folder, or to where it would be."""
    folder = folder.absolute()
    with _refused(folder):
        there = next(place for place in (folder, *folder.parents) if os.path.lexists(place))
        if not there.is_dir() or not os.access(there, os.W_OK | os.X_OK):
            raise OSError(0, f"Nothing can be written to {there}")


def _empty(folder: Path) -> Path:
    _check_empty(folder)
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def _check_empty(folder: Path) -> None:
    with contextlib.suppress(FileNotFoundError):
        folder.lstat()
    if folder.is_dir():
        check_unlocked(folder)
    if os.path.lexists(folder) and (not folder.is_dir() or _used(folder)):
        remedy = (
            "go on with it by --resume, or choose another" if _is_run(folder) else "choose another"
        )
        raise InputError(
            f"--out {escaped(str(folder))} exists and is not an empty folder; {remedy}."
        )


@contextlib.contextmanager
def _refused(folder: str | Path) -> Iterator[None]:
    """What the system says against a folder, as an InputError."""
    try:
        yield
    except (OSError, ValueError) as error:
        if isinstance(error, InputError):
            raise
        reason = getattr(error, "strerror", None) or error
        raise InputError(f"The folder {escaped(str(folder))} cannot be used: {reason}.") from None


def _inside(name: str) -> Path:
    """The name of a case as a path that leads down. Raises ValueError when it does not."""
    path = Path(name)
    if path.is_absolute() or ".." in path.parts or not path.name:
        raise ValueError(f"{shown(name)} is no name of a case")
    return path


@contextlib.contextmanager
def claimed(out: str | Path | None, name: str) -> Iterator[Path]:
    """A `fresh` folder for a run, locked for the block. Raises InputError."""
    with held(fresh(out, name)) as folder:
        yield folder


def _is_run(folder: Path) -> bool:
    return (folder / RECORD).exists()


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
        found = json.loads(read_bytes(path, MOST_BYTES))
    except FileNotFoundError:
        raise InputError(
            f"{path.parent} holds no {path.name}: no run of liftdrag has ended there."
        ) from None
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror}.") from None
    except (ValueError, RecursionError):
        raise _damaged(path) from None
    if not isinstance(found, dict):
        raise _damaged(path)
    return found


def _damaged(path: Path) -> InputError:
    return InputError(f"{path} is damaged; run the case again.")


def broken(folder: Path, what: object) -> InputError:
    """What to say of a run whose files are damaged, and how."""
    return InputError(f"The files in {folder} are damaged ({what}); run the case again.")


@contextlib.contextmanager
def reading(folder: Path) -> Iterator[None]:
    """Turn what is wrong with a run's files into InputError, in a sentence."""
    try:
        yield
    except InputError:
        raise
    except (OSError, ValueError, LookupError) as error:
        raise broken(folder, error) from error


def write_json(path: Path, record: Mapping[str, Any]) -> None:
    """Write a whole file or none. Raises RunFailed."""
    with writing(path):
        put(path, json.dumps(record, indent=2))


def put(path: Path, text: str) -> None:
    """Write a whole file or none: to a name beside it first, then renamed. Raises OSError."""
    beside = path.with_suffix(".part")
    try:
        with beside.open("w", encoding="utf-8") as file:
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
        beside.replace(path)
        _keep_names(path.parent)
    except OSError:
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
