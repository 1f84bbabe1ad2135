"""A case cut down to what a budget affords: shorter, and what is left of it still answers."""

from __future__ import annotations

from collections.abc import Sequence

from liftdrag.bench.axes import Axis
from liftdrag.bench.points import points_of, reference
from liftdrag.case import Case
from liftdrag.numerics.janssen import MOBILISE_FIRST
from liftdrag.scene import JanssenScene, ShearScene, TankScene
from liftdrag.scene.tank import TRANSIENT

SHORTEST = 0.1
"""Least share of a column's way."""

LEAST_STRAIN = 10.0
"""Least strain of a shear flow, of which a share is averaged."""

FEWEST = 4
"""Least packings of an ensemble, of which the differences give an error."""


def shortened(case: Case, axes: Sequence[Axis], seconds: float) -> Case:
    """The case so short that all points of its axes take about so long (s, of processor time).

    A case is never made longer.
    """
    points, _ = points_of(case, axes)
    whole = sum(point.hint_s for point in (reference(case), *points))
    return cut(case, min(seconds / whole, 1.0))


def cut(case: Case, share: float) -> Case:
    """A share of the displacement, or of the packings of an ensemble, as far as that goes."""
    scene = case.scene
    if isinstance(scene, TankScene):
        least = 2.0 * TRANSIENT * scene.intruder.diameter
        return case.set("drive.distance", max(share * scene.drive.distance, least))
    if isinstance(scene, JanssenScene):
        return _shorter_column(case, scene, max(share, SHORTEST))
    if isinstance(scene, ShearScene):
        drive = scene.drive
        share = max(share, min(LEAST_STRAIN / drive.strain, 1.0))
        case = case.set("drive.strain", share * drive.strain)
        return case.set("drive.average_from", share * drive.average_from)
    own = scene.ensemble.runs
    return case.set("ensemble.runs", min(max(round(share * own), FEWEST), own))


def _shorter_column(case: Case, scene: JanssenScene, share: float) -> Case:
    """The last fill alone, and of its way so much."""
    case, drive = case.set("fill.curve", False), scene.drive
    if drive.duration is not None:
        return case.set("drive.duration", share * drive.duration)
    way = drive.mobilise or MOBILISE_FIRST * scene.grains.diameter
    return case.set("drive.distance", share * (drive.distance or 0.0)).set(
        "drive.mobilise", share * way
    )
