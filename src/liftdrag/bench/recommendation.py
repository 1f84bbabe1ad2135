"""What a bench recommends of each choice, and why: the cheapest value that does no harm."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from liftdrag.analysis.precision import Deviation
from liftdrag.analysis.quantity import rounded
from liftdrag.bench.axes import Axis, Setting
from liftdrag.bench.judged import CASE, Judged, Key, costs, judge
from liftdrag.bench.runs import Run

WITHIN = 2.0
"""Deviation over its error within which a value does as the case does."""

SHIFTED = 3.0
"""The same from which values that are even less careful are out of the question."""

NEGLIGIBLE = 0.2
"""Deviation over what is tolerated that does no harm, though it is known not to be zero."""


SEEN = 0.5
"""Error of a deviation over what is tolerated up to which a shift by so much would be seen."""


AS_MUCH_FLOW = ("time_step", "pair_law", "ranks")
"""Axes on which a run has the same statistical error wherever it is."""


@dataclass(frozen=True)
class Advice:
    """The value recommended of an axis, None where the case's own stays, and the evidence.

    `cheaper` is what speaks against each cheaper one.
    """

    axis: Axis
    setting: Setting | None
    evidence: str
    cheaper: tuple[str, ...] = ()


@dataclass(frozen=True)
class _Found:
    """What is known of one value: its cost over that of the case, and each quantity of it."""

    setting: Setting
    cost: float
    judged: Mapping[str, Judged]
    failure: str = ""

    def shifted(self, tolerances: Mapping[str, float], by: float) -> bool:
        """Whether a quantity is off by so many errors, and by what is not negligible."""
        return any(
            abs(one.deviation.relative) > by * one.deviation.standard_error
            and _largest(one.deviation) > NEGLIGIBLE * tolerances[name]
            for name, one in self.judged.items()
        )

    def harmless(self, tolerances: Mapping[str, float]) -> bool:
        """Whether nothing is off, though a shift as large as what is tolerated would be seen."""
        seen = all(
            one.deviation.standard_error <= SEEN * tolerances[name]
            for name, one in self.judged.items()
        )
        return seen and not self.failure and not self.shifted(tolerances, WITHIN)


def _largest(deviation: Deviation) -> float:
    return abs(deviation.relative) + WITHIN * deviation.standard_error


def advise(
    runs: Sequence[Run], axes: Sequence[Axis], tolerances: Mapping[str, float]
) -> list[Advice]:
    """The advice for each axis that was measured; none where the case was not."""
    if CASE not in costs(runs):
        return []
    judged = {name: judge(runs, name) for name in tolerances}
    found = [(axis, list(_found(axis, runs, judged))) for axis in axes]
    return [_advice(axis, values, tolerances) for axis, values in found if values]


def _found(
    axis: Axis, runs: Sequence[Run], judged: Mapping[str, Mapping[Key, Judged]]
) -> Iterator[_Found]:
    spent = costs(runs)
    failures = {one.key: one for one in runs if not one.finished}
    for setting in axis.settings:
        key = (axis.name, setting.name)
        if key in failures:
            yield _Found(setting, 0.0, {}, failures[key].status)
        elif key in spent:
            mine = {name: found[key] for name, found in judged.items()}
            yield _Found(setting, _cost(axis, key, runs, judged), mine)


def _cost(
    axis: Axis, key: Key, runs: Sequence[Run], judged: Mapping[str, Mapping[Key, Judged]]
) -> float:
    """Processor time for the reference's error of the quantity that takes longest, over its own.

    Where a choice does not change how much flow a run sees, the time of a run: less noisy.
    """
    spent = costs(runs)
    if axis.name in AS_MUCH_FLOW:
        return spent[key].each_s / spent[CASE].each_s
    ratio = spent[key].cpu_s / spent[CASE].cpu_s
    return max(ratio * (found[key].error / found[CASE].error) ** 2 for found in judged.values())


def _advice(axis: Axis, found: list[_Found], tolerances: Mapping[str, float]) -> Advice:
    barred = _barred(axis, found, tolerances)
    fit = [
        one
        for one in found
        if one.cost < 1.0 and one.harmless(tolerances) and one.setting not in barred
    ]
    chosen = min(fit, key=lambda one: one.cost, default=None)
    bound = chosen.cost if chosen else 1.0
    against = tuple(
        f"{one.setting.name}: {_words(one, tolerances, one.setting in barred)}"
        for one in found
        if one.cost < bound
    )
    if chosen is None:
        return Advice(axis, None, "no cheaper value was seen to do no harm", against)
    return Advice(axis, chosen.setting, _words(chosen, tolerances), against)


def _barred(axis: Axis, found: Sequence[_Found], tolerances: Mapping[str, float]) -> list[Setting]:
    """The values that lie beyond one that did harm, from the case's own on."""
    own = axis.own
    if not axis.careful or isinstance(own, str):
        return []
    sign = 1.0 if axis.careful == "least" else -1.0
    rash = [one for one in found if sign * float(one.setting.at) > sign * own]
    rash.sort(key=lambda one: sign * float(one.setting.at))
    harm = [bool(one.failure) or one.shifted(tolerances, SHIFTED) for one in rash]
    first = harm.index(True) if True in harm else len(rash)
    return [one.setting for one in rash[first + 1 :]]


def _words(one: _Found, tolerances: Mapping[str, float], barred: bool = False) -> str:
    """The evidence: each deviation with its error, the cost, and what speaks against it."""
    if one.failure:
        return f"failed, {one.failure}"
    parts = [f"{name} {percent(judged)}" for name, judged in one.judged.items()]
    cheaper = 1.0 / one.cost
    parts.append(
        f"{cheaper:.2g} times cheaper" if cheaper > 1.0 else f"{one.cost:.2g} times dearer"
    )
    if barred:
        parts.append("beyond a value that did harm")
    elif one.shifted(tolerances, WITHIN):
        parts.append("it differs")
    elif not one.harmless(tolerances):
        parts.append("undecided")
    return ", ".join(parts)


def percent(judged: Judged) -> str:
    """A deviation and its error: "-0.4 +- 1.1 %"."""
    found = judged.deviation
    size, error = rounded(100.0 * found.relative, 100.0 * found.standard_error)
    return f"{'' if size.startswith('-') else '+'}{size} +- {error} %"
