"""What was found of a case under stress: its runs, the map, and the margin of its step."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from liftdrag.bench.axes import Axis
from liftdrag.bench.judged import CASE, Key, tolerances
from liftdrag.bench.runs import Run, Stand
from liftdrag.case import Case
from liftdrag.numerics.bounds import Bounds, bounds_of
from liftdrag.stress.axes import share_of
from liftdrag.stress.outcome import DOUBT, REFUSED, Outcome, Tried, axis_of, outcomes


@dataclass(frozen=True)
class Margin:
    """The case's `own` step, the `largest` under which none broke, and the first that `breaks`.

    Shares of the scale; `breaks` is None where nothing broke that was tried.
    """

    own: float
    largest: float
    breaks: float | None
    cause: str

    @property
    def times(self) -> float:
        """The largest over the case's own."""
        return self.largest / self.own

    def __str__(self) -> str:
        held = f"The time step holds {self.times:.2g} times the case's own, {self.own:.3g}"
        if self.breaks is None:
            return f"{held}: nothing that was begun broke, up to {self.largest:.3g}."
        verb = "seems to break" if self.cause == DOUBT else "breaks"
        following = f"the next that was run, {self.breaks:.3g}, {verb}"
        return f"{held}: {self.largest:.3g} does, {following} ({self.cause})."


@dataclass(frozen=True)
class Stressed:
    """A case under stress: `short` is what was run of it, `refused` why values were not begun.

    `left` is what the budget was too short for.
    """

    case: Case
    short: Case
    stand: Stand
    axes: tuple[Axis, ...]
    tried: tuple[Tried, ...]
    refused: Mapping[Key, str]
    left: Sequence[str] = ()

    @cached_property
    def bounds(self) -> Bounds:
        """What is predicted, before anything runs."""
        return bounds_of(self.short.scene)

    @cached_property
    def outcomes(self) -> list[Outcome]:
        """What became of each run, and of what was not begun, by axis and value."""
        known = [(axis.name, setting.name) for axis in self.axes for setting in axis.settings]
        asked = {axis.name for axis in self.axes}
        refused = [
            Outcome(Tried(Run(*key, 1, REFUSED, why), {}), (REFUSED,), None, {})
            for key, why in self.refused.items()
            if key[0] in asked
        ]
        found = [*outcomes(self.tried, tolerances(self.short.scene)), *refused]
        return sorted(found, key=lambda one: _place(one.tried.run, known))

    @property
    def margin(self) -> Margin | None:
        """That of the time step; None where the case itself broke or is not there."""
        own = self.bounds.own
        mine = [one for one in self.outcomes if axis_of(one.tried.run.key) == "time_step"]
        steps = [(share, one) for one in mine if (share := self.share(one)) and share > own]
        if not any(one.tried.run.key == CASE and not one.broken for one in self.outcomes):
            return None
        whole = [(share, one) for share, one in steps if REFUSED not in one.causes]
        first = next(((share, one) for share, one in whole if one.broken or one.doubtful), None)
        good = [share for share, _ in whole if first is None or share < first[0]]
        largest = max(good, default=own)
        if first is None:
            return Margin(own, largest, None, "")
        return Margin(own, largest, first[0], first[1].verdict)

    def share(self, one: Outcome) -> float | None:
        """Where a run lies on its axis, None for one of the case itself."""
        for axis in self.axes:
            for setting in axis.settings:
                if (axis.name, setting.name) == one.tried.run.key:
                    return share_of(axis, setting.at, self.short)
        return None

    def rows(self) -> Iterator[dict[str, Any]]:
        """A row for each run: its place, its causes, and what they were found by."""
        for one in self.outcomes:
            run = one.tried.run
            yield {
                "axis": axis_of(run.key),
                "value": run.name or f"seed {self.short.tables['seed'] + run.replica - 1}",
                "share": self.share(one),
                "status": run.status,
                "broken": one.broken,
                "causes": one.verdict,
                "reason": run.reason,
                "agitation over the case's, energy": one.heating,
                **dict(_invariant_columns(one.tried)),
                **dict(self._answer_columns(one)),
                "cpu_s": run.cpu_s,
            }

    def _answer_columns(self, one: Outcome) -> Iterator[tuple[str, float | None]]:
        answers = one.tried.run.answers or {}
        for name in self.stand.judged:
            answer, deviation = answers.get(name), one.deviations.get(name)
            yield name, answer.mean if answer else None
            yield f"{name} error", answer.standard_error if answer else None
            yield f"{name} deviation", deviation.relative if deviation else None
            yield f"{name} deviation error", deviation.standard_error if deviation else None

    def lines(self) -> Iterator[str]:
        """The prediction, and what was measured."""
        yield from self.bounds.lines()
        if self.margin is not None:
            yield str(self.margin)

    def to_dict(self) -> dict[str, Any]:
        """All of it, as `stress.json` holds it."""
        margin = self.margin
        return {
            "case": self.case.name,
            "scene": self.case.scene.scene,
            "engine": self.stand.engine,
            "engine_version": self.stand.version,
            "tables": dict(self.case.tables),
            "short": dict(self.short.tables),
            "bounds": dict(vars(self.bounds)),
            "margin": None if margin is None else vars(margin) | {"times": margin.times},
            "points": list(self.rows()),
            "left_out": list(self.left),
        }


def _place(run: Run, known: Sequence[Key]) -> tuple[int, int]:
    return (known.index(run.key) if run.key in known else len(known)), run.replica


def _invariant_columns(tried: Tried) -> Iterator[tuple[str, float]]:
    for name, one in tried.invariants.items():
        yield f"{name} ({one['unit']})", one["value"]
        yield f"{name} bound ({one['unit']})", one["bound"]
