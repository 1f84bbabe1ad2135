"""Where in the deck of a column a run goes on: in which phase of which fill, as its logs say."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from liftdrag.deck import Plan
from liftdrag.deck.commands import check_commands
from liftdrag.deck.restart import PHASE

_MARK = re.compile(
    r"^LIFTDRAG (?:PHASE (?P<name>[a-z]+_(?P<of>\d+)) from step (?P<begin>\d+) to (?P<until>\d+)"
    r"|FILL (?P<number>\d+) averaged to step (?P<end>\d+))$",
    re.MULTILINE,
)


@dataclass(frozen=True)
class Phase:
    """A phase by its label, the step that it lasts to, and the `ends` of the averages before.

    The fill is numbered from 1; `done` says that its average had already ended.
    """

    label: str
    fill: int
    until: int
    ends: tuple[int, ...]
    done: bool = False

    def text(self) -> str:
        """What a deck that goes on reads."""
        lines = [f"variable until equal {self.until}", f"variable phase index {self.label}"]
        lines += [
            f'print "LIFTDRAG FILL {number} averaged to step {end}"'
            for number, end in enumerate(self.ends, start=1)
        ]
        text = "\n".join([*lines, ""])
        check_commands(text, PHASE)
        return text


def logs(folder: Path, log: str) -> Iterator[Path]:
    """The logs of a run, of its first session first."""
    number = 1
    while (earlier := folder / f"{log}.{number}").exists():
        yield earlier
        number += 1
    if (folder / log).exists():
        yield folder / log


def text_of(folder: Path, log: str) -> str:
    """What all its sessions wrote to their logs."""
    return "\n".join(file.read_text("utf-8", "replace") for file in logs(folder, log))


def phase_at(plan: Plan, text: str, step: int) -> Phase | None:
    """The phase at whose end or before it a restart file of the `step` was written.

    None where the logs' `text` does not tell. What a later session says counts.
    """
    marks = list(_MARK.finditer(text))
    begun = [k for k, mark in enumerate(marks) if mark["name"] and int(mark["begin"]) < step]
    if not begun:
        return None
    mark = marks[begun[-1]]
    fill, ends = int(mark["of"]), dict[int, int]()
    for earlier in marks[: begun[-1]]:
        if earlier["number"]:
            ends[int(earlier["number"])] = int(earlier["end"])
    before = tuple(ends[number] for number in range(1, fill) if number in ends)
    if plan.stoppable and len(before) < fill - 1:
        return None
    ended = {(int(m["number"]), int(m["end"])) for m in marks[begun[-1] :] if m["number"]}
    done = (fill, step) in ended
    until = step if done else int(mark["until"])
    return Phase(mark["name"], fill, until, before, done)
