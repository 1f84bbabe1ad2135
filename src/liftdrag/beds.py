"""Beds kept in the user's cache, so that one bed is packed and settled once, whatever drives it.

A file a bed. Its name is a digest of all that the bed depends on: how it is packed and, once it
is settled, its contacts, its weight and how it came to rest. The time step, the drive, the ranks
and the engine do not count. A file that is not what it was when it was written is left out, with a
warning, and replaced. LIFTDRAG_BEDS=off keeps and finds nothing; with a folder they are there.

A bed that was packed before gives the run that it would have given when packed anew, to the bit.
A bed that was settled before keeps its grains where they were, but not the tangential springs
between them, which contacts load anew: such a run differs from the one that settled the bed as
two engines differ, not to be told apart by its averages. All the later runs are the same.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from liftdrag.deck.tank import Bed, packed
from liftdrag.engines.family import read_dump
from liftdrag.granular import GRAVITY
from liftdrag.numerics.tank import SETTLED, settle_time
from liftdrag.scene import TankScene

FORM = 1
"""To be raised whenever beds are packed or settled in another way: older ones are not found."""

LIMIT = 2_000_000_000
"""Bytes that the beds may take together; the one longest unused goes first."""

_DIGEST = 32


class Damaged(Exception):
    """A file of the cache is not what was written there."""


@dataclass(frozen=True)
class Found:
    """The bed that a run starts from, the `key` of its settled form, and warnings."""

    bed: Bed
    key: str
    warnings: tuple[str, ...] = ()

    @property
    def provenance(self) -> dict[str, Any]:
        """Where the settled bed comes from, for `result.json`."""
        return {"key": self.key, "reused": self.bed.settled}


def find(scene: TankScene) -> Found:
    """The bed of a scene, settled before, packed before, or packed now.

    Raises InputError when its grains do not fit.
    """
    key, warnings = key_of(scene), list[str]()
    for name, settled in ((key, True), (_key(_packing(scene)), False)):
        try:
            if (grains := _read(name)) is not None:
                bed = Bed(grains[:, :3], grains[:, 3].astype(int), settled)
                return Found(bed, key, tuple(warnings))
        except Damaged as damage:
            warnings.append(f"{damage}; another bed was made.")
    bed = packed(scene)
    _write(_key(_packing(scene)), bed)
    return Found(bed, key, tuple(warnings))


def kept(scene: TankScene) -> str:
    """What is kept of a scene's bed: "settled", "packed" or "nothing". It may yet be damaged."""
    with contextlib.suppress(OSError, RuntimeError):
        for state, question in (("settled", _settling(scene)), ("packed", _packing(scene))):
            if (_folder() / f"{_key(question)}.bed").exists():
                return state
    return "nothing"


def key_of(scene: TankScene) -> str:
    """What tells a scene's settled bed from others."""
    return _key(_settling(scene))


def keep(found: Found, scene: TankScene, folder: Path) -> None:
    """Keep the bed that a run in `folder` has settled, if it did."""
    if found.bed.settled:
        return
    with contextlib.suppress(OSError, ValueError):
        for _, rows in read_dump(folder / "settled.dump"):
            if np.array_equal(rows[:, 1], found.bed.types):
                period = [scene.tank.length, scene.tank.thickness, np.inf]
                _write(found.key, Bed(rows[:, 2:5] % period, found.bed.types))


def _packing(scene: TankScene) -> dict[str, Any]:
    """All that a packed bed depends on."""
    return {
        "form": FORM,
        "seed": scene.seed,
        "diameter": scene.grains.diameter,
        "tank": scene.tank.model_dump(),
        "intruder": scene.intruder.model_dump(),
        "lid": scene.lid is not None,
        "count": scene.grain_count,
        "height": scene.packed_height,
    }


def _settling(scene: TankScene) -> dict[str, Any]:
    """All that a settled bed depends on."""
    return {
        "packing": _packing(scene),
        "grains": scene.grains.model_dump(),
        "lid": scene.lid and scene.lid.model_dump(),
        "gravity": GRAVITY,
        "settle_time": settle_time(scene),
        "settled": SETTLED,
    }


def _key(question: dict[str, Any]) -> str:
    return hashlib.sha256(json.dumps(question, sort_keys=True).encode()).hexdigest()


def _folder() -> Path:
    """Where the beds are. Raises OSError when they are not wanted."""
    asked = os.environ.get("LIFTDRAG_BEDS")
    if asked == "off":
        raise OSError("beds are not kept")
    if asked:
        return Path(asked)
    cache = os.environ.get("XDG_CACHE_HOME") or str(Path("~/.cache").expanduser())
    return Path(cache) / "liftdrag" / "beds"


def _read(key: str) -> np.ndarray | None:
    """Rows (n, 4) of centre and type, None when there is no such bed. Raises Damaged."""
    try:
        file = _folder() / f"{key}.bed"
        found = file.read_bytes()
    except (OSError, RuntimeError):
        return None
    content = found[_DIGEST:]
    if found[:_DIGEST] != _seal(key, content):
        raise Damaged(f"The bed kept in {file} is damaged")
    with contextlib.suppress(OSError):
        os.utime(file)
    return np.frombuffer(content, "<f8").reshape(-1, 4)


def _write(key: str, bed: Bed) -> None:
    """Keep a bed whole or not at all: nothing where nothing can be kept."""
    content = np.column_stack([bed.positions, bed.types]).astype("<f8").tobytes()
    with contextlib.suppress(OSError, RuntimeError):
        folder = _folder()
        folder.mkdir(parents=True, exist_ok=True)
        _put(folder / f"{key}.bed", _seal(key, content) + content)
        _tidy(folder)


def _put(file: Path, content: bytes) -> None:
    """Write under a name of its own first, then rename."""
    with tempfile.NamedTemporaryFile(dir=file.parent, delete=False) as beside:
        try:
            beside.write(content)
            beside.flush()
            Path(beside.name).replace(file)
        except OSError:
            Path(beside.name).unlink()
            raise


def _tidy(folder: Path) -> None:
    """Remove what was longest not used, until the rest is under the limit."""
    states = sorted(((file.stat(), file) for file in folder.iterdir()), key=_unused)
    total = sum(state.st_size for state, _ in states)
    for state, file in states:
        if total <= LIMIT:
            return
        file.unlink()
        total -= state.st_size


def _unused(item: tuple[os.stat_result, Path]) -> int:
    return item[0].st_mtime_ns


def _seal(key: str, content: bytes) -> bytes:
    return hashlib.sha256(key.encode() + content).digest()
