"""`Deck` and its `Plan`."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path


@dataclass(frozen=True)
class Plan:
    """What a deck promises: where the engine starts, its stages' steps, and the files it leaves.

    `series` names each output file and its channels with their units; a row
    comes every `row_every` steps of `time_step` seconds. `fills` of a column, where it is one:
    for each the number of grains, and the steps of its start and of those between which it is
    averaged; after a run, as it was. A `stoppable` deck, or the average of each of its fills,
    ends early when it is told to.
    """

    start: str
    ranks: int
    time_step: float
    stages: Mapping[str, int]
    row_every: int
    series: Mapping[str, Mapping[str, str]]
    fills: Sequence[tuple[int, int, int, int]] = ()
    stoppable: bool = False


@dataclass(frozen=True)
class Deck:
    """The finished texts of a run by file name, and the plan that they carry out.

    `blobs` are files that are not texts.
    """

    texts: Mapping[str, str]
    plan: Plan
    blobs: Mapping[str, bytes] = field(default_factory=dict)

    @property
    def digest(self) -> str:
        """SHA-256 of the files and their names."""
        joined = json.dumps(sorted(self.texts.items())).encode()
        for name, blob in sorted(self.blobs.items()):
            joined += name.encode() + hashlib.sha256(blob).digest()
        return hashlib.sha256(joined).hexdigest()

    @property
    def digests(self) -> dict[str, str]:
        """SHA-256 of each file that stays as it was written."""
        texts = {name: text.encode() for name, text in self.texts.items()}
        files = sorted((texts | dict(self.blobs)).items())
        return {
            name: hashlib.sha256(content).hexdigest()
            for name, content in files
            if not name.startswith("stop")
        }

    def write(self, folder: Path) -> None:
        """Write the texts into `folder`, which is made when it does not exist."""
        folder.mkdir(parents=True, exist_ok=True)
        for name, text in self.texts.items():
            (folder / name).write_text(text, "utf-8")
        for name, blob in self.blobs.items():
            (folder / name).write_bytes(blob)
