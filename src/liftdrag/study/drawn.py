"""The pictures of a study, from the answers of its points."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from liftdrag.pictures.study import Axes, Line, draw_bars, draw_lines
from liftdrag.study.carried import Answer
from liftdrag.study.plan import Picture, Plan, is_quantity
from liftdrag.study.points import Point, expanded


def draw(folder: Path, plan: Plan, results: Mapping[str, Answer]) -> None:
    """Each picture of which there is anything to show yet. Raises OSError."""
    for picture in plan.pictures:
        groups = [
            (name, [one for one in group if results[one.name].quantities])
            for name, group in _groups(picture, results)
        ]
        groups = [(name, group) for name, group in groups if group]
        if groups and picture.against is None:
            _draw_bars(picture, [group for _, group in groups], results, folder)
        elif groups:
            _draw_lines(picture, groups, results, folder)


def _groups(
    picture: Picture, results: Mapping[str, Answer]
) -> Iterator[tuple[str, Sequence[Point]]]:
    """The points of each group that is named, or of each run."""
    points = {name: one.point for name, one in results.items()}
    if picture.groups is None:
        for run in dict.fromkeys(point.run for point in points.values()):
            yield run, expanded(run, points)
    for names in picture.groups or []:
        found = [point for name in names for point in expanded(name, points)]
        yield names[0] if len(names) == 1 else "", found


def _draw_bars(
    picture: Picture,
    groups: Sequence[Sequence[Point]],
    results: Mapping[str, Answer],
    folder: Path,
) -> None:
    names = [[point.name for point in group] for group in groups]
    found = {name: results[name].quantity(picture.quantity) for group in names for name in group}
    unfinished = {name for name in found if not results[name].whole}
    draw_bars(picture.title, names, found, unfinished, _axes(picture), folder / picture.file)


def _draw_lines(
    picture: Picture,
    groups: Sequence[tuple[str, Sequence[Point]]],
    results: Mapping[str, Answer],
    folder: Path,
) -> None:
    lines = []
    for name, group in groups:
        for label, points in _lines(name, group, picture.against or ""):
            lines.append(_line(picture, label, [results[point.name] for point in points]))
    draw_lines(picture.title, lines, _axes(picture), folder / picture.file)


def _line(picture: Picture, label: str, answers: Sequence[Answer]) -> Line:
    places = [one.place(picture.against or "", picture.over) for one in answers]
    return Line(
        label,
        [place for place, _ in places],
        [one.quantity(picture.quantity) for one in answers],
        [error for _, error in places],
        [one.whole for one in answers],
    )


def _lines(
    name: str, group: Sequence[Point], against: str
) -> Iterator[tuple[str, Sequence[Point]]]:
    """The points of a group that differ in no key of their grid but this one, with a label.

    Against what was measured they are one line.
    """
    if is_quantity(against):
        yield name, group
        return
    found = dict[str, list[Point]]()
    for point in group:
        others = [f"{key} = {value}" for key, value in point.grid.items() if key != against]
        found.setdefault(", ".join([*([name] if name else []), *others]), []).append(point)
    yield from found.items()


def _axes(picture: Picture) -> Axes:
    key = picture.against or ""
    return Axes(
        f"{key} / {picture.over}" if picture.over else key,
        picture.quantity,
        frozenset(picture.logarithmic),
        tuple((level.value, level.label) for level in picture.reference),
    )
