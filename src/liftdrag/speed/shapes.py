"""Shapes of grains in the plane against discs."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

from liftdrag.packing.drag2d import packed
from liftdrag.speed.pull import in_house, scene_of
from liftdrag.speed.rounds import best


def against_discs() -> Iterator[str]:
    """The cost of other shapes per step, over that of discs."""
    cases = ("zhou/c1", "zhou/e1", "zhou/e2", "zhou/e3", "zhou/d1")
    runs = []
    for case in cases:
        scene, numerics = scene_of(case)
        runs.append(partial(in_house, packed(scene, 0), scene, numerics))
    times = best(*runs)
    for case, seconds in zip(cases, times, strict=True):
        yield f"{case}: {seconds * 1e6:.1f} us/step, {seconds / times[0]:.2f} times discs"
