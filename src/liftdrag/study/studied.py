"""A study as it stands: the answers of its points, and what they say of its claims."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from liftdrag.analysis.claims import Finding
from liftdrag.errors import RunFailed
from liftdrag.study.carried import Answer
from liftdrag.study.findings import Grown
from liftdrag.study.plan import Claim, Plan
from liftdrag.study.state import State


@dataclass(frozen=True)
class Studied:
    """The results of a study's points by name, and what they say of its claims, in its folder."""

    plan: Plan
    folder: Path
    results: Mapping[str, Answer]
    findings: list[tuple[Claim, Finding]]
    growths: list[Grown] = field(default_factory=list)

    @property
    def unfinished(self) -> Iterator[tuple[str, State]]:
        """The runs that have not finished, by name."""
        for one in self.results.values():
            for task, state in one.runs:
                if not state.finished:
                    yield task.name, state

    def check(self) -> None:
        """Raise RunFailed when a run has not finished, with a line for each."""
        left = dict(self.unfinished)
        if left:
            lines = [f"{name}: {state.reason or state.status}" for name, state in left.items()]
            total = len({task.digest for one in self.results.values() for task, _ in one.runs})
            head = f"{len(left)} of {total} runs have not finished; the same command goes on."
            raise RunFailed("engine_error", "\n".join([head, *lines]))
