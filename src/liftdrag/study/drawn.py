"""The pictures of a study, from the answers of its points."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from liftdrag import liu
from liftdrag.pictures.study import Axes, Line, draw_bars, draw_lines
from liftdrag.scene import ShearScene
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
        yield shared(names), found


def shared(names: Sequence[str]) -> str:
    """The parts between dashes that all names have."""
    first, *others = (name.split("-") for name in names)
    return "-".join(part for part in first if all(part in other for other in others))


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
            line = _line(picture, label, [results[point.name] for point in points])
            lines.append(replace(line, beside=_curve(picture, points, line.places)))
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


def _curve(
    picture: Picture, points: Sequence[Point], places: Sequence[float]
) -> Sequence[tuple[float, float]]:
    """The paper's curve where these points of one solid fraction are; none where it has none.

    It is of rods and disks, without spheres.
    """
    fractions = {point.number("cell.solid_fraction") for point in points} if picture.curve else ()
    if any(_has_spheres(point) for point in points):
        return ()
    if len(fractions) != 1:
        return ()
    curve = liu.curve(picture.quantity, *fractions)
    if curve is None or max(places) <= liu.ALIGNED:
        return ()
    order = np.linspace(max(min(places), liu.ALIGNED), max(places), 30)
    return list(zip(order, curve(order), strict=True))


def _has_spheres(point: Point) -> bool:
    scene = point.case.scene
    return isinstance(scene, ShearScene) and any(one.is_sphere for one in scene.species)


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
    keys = {key for point in group for key in point.grid if key != against}
    varied = {key for key in keys if len({str(point.grid.get(key)) for point in group}) > 1}
    for point in group:
        others = [f"{key} = {value}" for key, value in point.grid.items() if key in varied]
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
