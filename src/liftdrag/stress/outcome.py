"""What became of a point: whether it broke, and by what."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from liftdrag.analysis.precision import Deviation
from liftdrag.bench.judged import CASE, Key, judge
from liftdrag.bench.recommendation import NEGLIGIBLE
from liftdrag.bench.runs import Run
from liftdrag.stress.axes import SEEDS, UNCHANGED

CLEAR = 4.0
"""Combined errors beyond which an answer is another; they are those of few and short runs."""

RUNS = 3
"""Runs of the case itself, which differ in their seed, and of a value whose answer seems another:
one packing in a few is far off whatever the step."""

HEATED = 2.0
"""Energy of agitation over that of the case beyond which the step feeds it."""

CAUSES = ("lost", "not finite", "overlap", "energy", "balance", "answer", "failed")
"""What breaks a run, the gravest first."""

DOUBT = "answer?"
"""Said of an answer that seems another."""

REFUSED = "refused"
"""What liftdrag does not begin with: no break."""

_BY_STATUS = {
    "finished": None,
    "lost_grains": "lost",
    "not_finite": "not finite",
    "overlap_exceeded": "overlap",
    REFUSED: REFUSED,
}
_BY_INVARIANT = {
    "largest_overlap": "overlap",
    "agitation": "energy",
    "energy_created": "energy",
    "momentum": "balance",
    "horizontal_balance": "balance",
    "vertical_balance": "balance",
    "weight_balance": "balance",
}
_UNSETTLED = "did not come to rest"


@dataclass(frozen=True)
class Tried:
    """A run of a point, and its invariants as `result.json` holds them."""

    run: Run
    invariants: Mapping[str, Mapping[str, Any]]

    @property
    def agitation(self) -> float | None:
        """Agitation (m/s), where it is known."""
        found = self.invariants.get("agitation")
        return None if found is None else float(found["value"])


@dataclass(frozen=True)
class Outcome:
    """What became of a run: its `causes`, none when nothing broke, and `deviations` by quantity.

    It is `doubtful` when its answer seems another, and the runs are too few to say so.
    """

    tried: Tried
    causes: tuple[str, ...]
    heating: float | None
    deviations: Mapping[str, Deviation]
    doubtful: bool = False

    @property
    def verdict(self) -> str:
        """Its causes in a line; that of one in doubt has a question mark."""
        return ", ".join([*self.causes, *([DOUBT] if self.doubtful else [])])

    @property
    def broken(self) -> bool:
        """Whether it broke; one that was refused did not."""
        return bool(self.causes) and REFUSED not in self.causes


def outcomes(tried: Sequence[Tried], tolerances: Mapping[str, float]) -> list[Outcome]:
    """What became of each run, against those of the case itself; relative errors are tolerated."""
    runs, energy = [one.run for one in tried], _own_energy(tried)
    found, counts = deviations_of(runs, tolerances), Counter(run.key for run in runs)
    other = shifted(found, tolerances)
    sure = {key for key in other if counts[key] >= RUNS}
    return [
        replace(
            _outcome(one, found[one.run.key], energy, one.run.key in sure),
            doubtful=one.run.key in other - sure,
        )
        for one in tried
    ]


def deviations_of(
    runs: Sequence[Run], tolerances: Mapping[str, float]
) -> dict[Key, dict[str, Deviation]]:
    """Of each point and quantity, from the case itself; none of what did not finish."""
    judged = {name: judge(runs, name) for name in tolerances}
    return {
        key: {name: found[key].deviation for name, found in judged.items() if key in found}
        for key in {run.key for run in runs}
    }


def shifted(
    found: Mapping[Key, Mapping[str, Deviation]], tolerances: Mapping[str, float]
) -> set[Key]:
    """The points whose answer is another, on axes that must not change it."""
    return {
        key
        for key, mine in found.items()
        if axis_of(key) in UNCHANGED
        and any(_is_shifted(one, tolerances[name]) for name, one in mine.items())
    }


def _is_shifted(deviation: Deviation, tolerated: float) -> bool:
    size = abs(deviation.relative)
    return size > CLEAR * deviation.standard_error and size > NEGLIGIBLE * tolerated


def _own_energy(tried: Sequence[Tried]) -> float | None:
    """The mean square agitation of the case, (m/s)^2."""
    own = [one.agitation**2 for one in tried if one.run.key == CASE and one.agitation]
    return sum(own) / len(own) if own else None


def _outcome(
    one: Tried, deviations: Mapping[str, Deviation], energy: float | None, is_shifted: bool
) -> Outcome:
    heating = one.agitation**2 / energy if one.agitation is not None and energy else None
    found = set(_causes(one, heating, is_shifted))
    causes = tuple(cause for cause in (*CAUSES, REFUSED) if cause in found)
    return Outcome(one, causes, heating, deviations)


def _causes(one: Tried, heating: float | None, is_shifted: bool) -> Iterator[str]:
    run = one.run
    if cause := _BY_STATUS.get(run.status, "energy" if _UNSETTLED in run.reason else "failed"):
        yield cause
    for name, invariant in one.invariants.items():
        if not invariant["holds"]:
            yield _BY_INVARIANT[name]
    if axis_of(run.key) in UNCHANGED and heating is not None and heating > HEATED:
        yield "energy"
    if is_shifted:
        yield "answer"


def axis_of(key: Key) -> str:
    """The axis of a point; runs of the case itself are that of the seeds."""
    return SEEDS if key == CASE else key[0]
