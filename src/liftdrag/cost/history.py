"""What earlier runs took, in the user's cache: `rates.json`, the last few runs of each kind.

What cannot be read is left out, what cannot be written is lost.
"""

from __future__ import annotations

import contextlib
import json
import os
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from math import isfinite
from pathlib import Path
from statistics import median
from typing import Any

from liftdrag.cost.kind import Kind
from liftdrag.cost.model import expected_s, start_s
from liftdrag.cost.work import Work
from liftdrag.engines.base import Outcome

LAST = 5
"""Runs of a kind that count, and are kept."""

KEPT = 500
"""Runs that are kept of all kinds."""

QUIET = 0.9
"""Share of the machine from which on ranks, which wait for each other, were not disturbed."""

LIKE = (
    (("machine", "engine", "version", "scene", "contacts", "ranks"), "such run{s} here"),
    (("machine", "engine", "scene", "contacts"), "such run{s} here, on other ranks"),
    (("machine", "engine", "scene"), "run{s} of this scene here"),
    (("machine", "engine"), "run{s} of this engine here"),
    (("machine",), "run{s} of other engines here"),
)
"""In what a run is like another, the most alike first, and how they are called."""


@dataclass(frozen=True)
class Learnt:
    """A run that was, and the `seconds` that it would have taken with the machine to itself.

    `share` is what it had of the machine: its processor time over that on the clock.
    """

    kind: Kind
    work: Work
    seconds: float
    share: float

    @property
    def factor(self) -> float:
        """How many times longer it took than on the machine of the model."""
        return self.seconds / expected_s(self.kind, self.work)

    @property
    def quiet(self) -> bool:
        """Whether other work did not disturb it: its processor time is what it takes."""
        return self.share >= QUIET or self.kind.cores == 1

    @classmethod
    def of(cls, kind: Kind, work: Work, outcome: Outcome) -> Learnt:
        """What the outcome of a run says; of beds in the plane, the processor time of all."""
        if kind.scene == "drag2d":
            return cls(kind, work, outcome.cpu_s, 1.0)
        computed = max(outcome.cpu_s / kind.cores - start_s(kind), 0.1 * outcome.loop_s)
        share = min(computed / outcome.loop_s, 1.0)
        return cls(kind, work, share * outcome.loop_s, share)


def learn(run: Learnt) -> None:
    """Remember a run."""
    runs = [*remembered(), run]
    of_kind = [one for one in runs if one.kind == run.kind][-LAST:]
    kept = [one for one in runs if one.kind != run.kind or one in of_kind][-KEPT:]
    _write([asdict(one) for one in kept])


def factor(kind: Kind) -> tuple[float, str] | None:
    """How many times slower this machine is than that of the model, and how that is known.

    The median of the last runs, of those most alike. Runs that were disturbed count only where
    there are no others, those whose ranks took turns only for their own kind.
    """
    every = [one for one in remembered() if one.kind == kind or not one.kind.takes_turns]
    return _of_most_alike(kind, [one for one in every if one.quiet]) or _of_most_alike(kind, every)


def _of_most_alike(kind: Kind, runs: Sequence[Learnt]) -> tuple[float, str] | None:
    for names, called in LIKE:
        alike = [one for one in runs if _same(one.kind, kind, names)][-LAST:]
        if alike:
            says = called.format(s="s" * (len(alike) > 1))
            return median(one.factor for one in alike), f"as in {len(alike)} {says}"
    return None


def _same(one: Kind, other: Kind, names: Sequence[str]) -> bool:
    return all(getattr(one, name) == getattr(other, name) for name in names)


def remembered() -> list[Learnt]:
    """The runs that are kept, in order of time."""
    try:
        rows = json.loads(_file().read_text("utf-8"))["runs"]
        return list(_read(rows))
    except (OSError, RuntimeError, ValueError, LookupError, TypeError):
        return []


def _read(rows: Sequence[dict[str, Any]]) -> Iterator[Learnt]:
    for row in rows:
        with contextlib.suppress(LookupError, TypeError, ValueError, ArithmeticError):
            kind, work = Kind(**row["kind"]), Work(**row["work"])
            run = Learnt(kind, work, float(row["seconds"]), float(row["share"]))
            if isfinite(run.factor) and run.factor > 0.0:
                yield run


def _write(rows: list[dict[str, Any]]) -> None:
    with contextlib.suppress(OSError, RuntimeError):
        file = _file()
        file.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile("w", dir=file.parent, delete=False) as beside:
            json.dump({"runs": rows}, beside, indent=1)
        Path(beside.name).replace(file)


def _file() -> Path:
    cache = os.environ.get("XDG_CACHE_HOME") or str(Path("~/.cache").expanduser())
    return Path(cache) / "liftdrag" / "rates.json"
