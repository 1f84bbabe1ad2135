"""The points of a study: each run at each combination of its values, and the seeds of each."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from difflib import get_close_matches
from itertools import product
from math import prod
from typing import Any

from liftdrag.case import Case, load, with_settings
from liftdrag.errors import CaseError, InputError, shown
from liftdrag.runner import engine_for
from liftdrag.scene import ShearScene
from liftdrag.study.plan import KNOWN, OF_AXES, Plan, Scale, Varied, is_quantity

MOST = 10_000
"""Runs of a study."""


@dataclass(frozen=True)
class Point:
    """A run of the study at one value of each key of its grid, with a case for each seed.

    `varied` has the values by key, as the study gives them, `grid` those that go through all
    combinations.
    """

    name: str
    run: str
    varied: Mapping[str, Any]
    cases: tuple[Case, ...]
    engine: str
    grid: Mapping[str, Any] = field(default_factory=dict)

    @property
    def case(self) -> Case:
        """The first of its cases, which differ in their seeds alone."""
        return self.cases[0]

    def value(self, key: str) -> Any:
        """What the case has at a dotted key, in SI units; None where it has nothing."""
        found: Any = self.case.scene
        for name in key.split("."):
            found = _at(found, name)
        return found

    def number(self, key: str) -> float:
        """The same. Raises InputError when it is no number."""
        found = self.value(key)
        if isinstance(found, bool) or not isinstance(found, int | float):
            raise InputError(f"The case {self.case.name} has no number at {shown(key)}.")
        return float(found)


def _at(found: Any, name: str) -> Any:
    """What a table has of this name, or a list at this number."""
    if not isinstance(found, list):
        return getattr(found, name, None)
    return dict(zip(map(str, range(len(found))), found, strict=True)).get(name)


def points_of(plan: Plan, scale: str | None, settings: Sequence[str]) -> dict[str, Point]:
    """The points by name, in the order of the file.

    `settings` (KEY=VALUE) hold for all. Raises InputError for a case or name that is wrong, and
    for more than 10 000 runs.
    """
    chosen = plan.scale(scale)
    for setting in settings:
        _check_free(setting.partition("=")[0].strip(), plan, chosen)
    _check_count(plan, chosen)
    found = [point for name in plan.runs for point in _points(name, plan, chosen, settings)]
    twice = [name for name, count in Counter(point.name for point in found).items() if count > 1]
    if twice:
        raise InputError(f"Two points of the study are called {twice[0]}; rename a run.")
    points = {point.name: point for point in found}
    _check_asked(plan, points)
    return points


def expanded(name: str, points: Mapping[str, Point], key: str = "runs") -> list[Point]:
    """The point of this name, or all those of the run. Raises CaseError when there is none.

    `key` is where the study names it.
    """
    if name in points:
        return [points[name]]
    found = [point for point in points.values() if point.run == name]
    if not found:
        known = list(dict.fromkeys([*(point.run for point in points.values()), *points]))
        some = get_close_matches(name, known, n=1) or known[:12]
        remedy = f"choose one of {', '.join(some)}"
        raise CaseError(key, name, "no run or point has this name", remedy)
    return found


def _keys(varied: Varied) -> list[str]:
    return [*varied.grid, *varied.together]


def _check_free(key: str, plan: Plan, scale: Scale) -> None:
    """Raise InputError for a setting of a key that the study varies."""
    if any(key in _keys(plan.varied(run, scale)) for run in plan.runs):
        raise InputError(f"The study varies {shown(key)}; leave out its --set, or edit the study.")


def _check_count(plan: Plan, scale: Scale) -> None:
    count = sum(_count(plan.varied(run, scale)) for run in plan.runs)
    if count > MOST:
        raise InputError(f"The study has {count} runs, more than {MOST}; divide it.")


def _check_once(run: str, varied: Varied) -> None:
    for key in varied.grid.keys() & varied.together.keys():
        raise InputError(f"The run {run} has {shown(key)} in grid and in together; keep one.")


def _count(varied: Varied) -> int:
    rows = len(next(iter(varied.together.values()), [None]))
    return (varied.replicas or 1) * rows * prod(map(len, varied.grid.values()))


def _points(name: str, plan: Plan, scale: Scale, settings: Sequence[str]) -> Iterator[Point]:
    varied, base = plan.varied(name, scale), load(plan.runs[name].case)
    _check_once(name, varied)
    for key, value in varied.set.items():
        base = base.set(key, value)
    named = [*varied.grid, *list(varied.together)[:1]]
    for values in _combinations(varied):
        case = base
        for key, value in values.items():
            case = case.set(key, value)
        case = with_settings(case, list(settings))
        engine = engine_for(case, plan.engine).name
        cases = tuple(_seeded(case, varied.replicas or 1))
        called = _named(name, {key: values[key] for key in named})
        grid = {key: values[key] for key in varied.grid}
        yield Point(called, name, values, cases, engine, grid)


def _combinations(varied: Varied) -> Iterator[dict[str, Any]]:
    """The values by key: each combination of the grid with each row of the lists together."""
    rows = list(zip(*varied.together.values(), strict=True)) or [()]
    for values in product(*varied.grid.values()):
        for row in rows:
            yield dict(zip(_keys(varied), (*values, *row), strict=True))


def _seeded(case: Case, replicas: int) -> Iterator[Case]:
    """The case with its seed and those that follow. Raises InputError for one that is bad."""
    first = case.scene.seed
    if replicas > 1 and case.scene.scene == "drag2d":
        raise InputError("An ensemble is made of replicas; raise ensemble.runs instead.")
    yield case
    for number in range(1, replicas):
        yield case.set("seed", first + number)
    case.set("seed", first + replicas - 1).scene  # noqa: B018 - the last is the largest


def _named(run: str, varied: Mapping[str, Any]) -> str:
    """A name that is fit for a folder, and that a reader understands."""
    lasts = Counter(key.rpartition(".")[2] for key in varied)
    words = [run]
    for key, value in varied.items():
        last = key.rpartition(".")[2]
        words.append(_plain(last if lasts[last] == 1 else key) + "=" + _plain(str(value)))
    return "-".join(words)


def _plain(text: str) -> str:
    return re.sub(r"[^A-Za-z0-9_.+-]", "", text.replace("/", "_")) or "x"


def _check_asked(plan: Plan, points: Mapping[str, Point]) -> None:
    """Raise InputError for a claim or picture of what a run will not have."""
    for claim in plan.claims:
        for name in (claim.larger, claim.smaller):
            found = expanded(name, points, "claims")
            if len(found) > 1:
                raise InputError(
                    f"The claim {shown(claim.says)} names the run {name} of {len(found)} points; "
                    f"name one of them, such as {found[0].name}."
                )
            _check_quantity(claim.quantity, found[0])
    for growth in plan.saturations:
        for point in expanded(growth.run, points, "saturations.run"):
            _check_quantity(growth.quantity, point)
            _check_places(point, growth.against, growth.over)
    for picture in plan.pictures:
        for name in (name for group in picture.groups or [] for name in group):
            expanded(name, points, "pictures.groups")
        for point in drawn(picture.groups, points):
            _check_quantity(picture.quantity, point)
            _check_places(point, picture.against, picture.over)


def _check_places(point: Point, against: str | None, over: str | None) -> None:
    if against is not None and is_quantity(against):
        _check_quantity(against, point)
    elif against is not None:
        point.number(against)
    if over is not None:
        point.number(over)


def drawn(groups: Sequence[Sequence[str]] | None, points: Mapping[str, Point]) -> list[Point]:
    """The points of all groups, all points where there are none."""
    if groups is None:
        return list(points.values())
    return [point for group in groups for name in group for point in expanded(name, points)]


def _check_quantity(quantity: str, point: Point) -> None:
    scene = point.case.scene
    known = KNOWN[scene.scene]
    if quantity not in known:
        raise InputError(
            f"The run {point.name} of the study is a {scene.scene}, which has no {quantity}; "
            f"choose one of {', '.join(known)}."
        )
    if isinstance(scene, ShearScene) and scene.is_of_spheres and quantity in OF_AXES:
        raise InputError(f"The run {point.name} of the study is of spheres, without {quantity}.")
