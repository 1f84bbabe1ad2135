"""Scene, numerics and a packing of the closed bed into a deck: a table of numbers, or LAMMPS'."""

from __future__ import annotations

from dataclasses import fields, replace
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from liftdrag.arrays import read_arrays
from liftdrag.deck import planar
from liftdrag.deck.dialect import IN_HOUSE, Contact, Dialect
from liftdrag.deck.model import Deck, Plan
from liftdrag.deck.tables import table
from liftdrag.dem import Bed
from liftdrag.errors import CaseError, InputError
from liftdrag.numerics import Drag2DNumerics
from liftdrag.scene import Drag2DScene

BED = "bed.npz"
"""The packing: the arrays of a `dem.Bed` but for its memory."""

NUMBERS = "deck.toml"
"""What is to be done with it."""

CHANNELS = dict.fromkeys("drag lift left right bottom top".split(), "N") | {
    "kinetic": "J",
    "elastic": "J",
    "overlap": "1",
}
"""What the in-house engine samples: forces as `deck.planar` has them, the energies of the
grains, and the deepest overlap over the smaller radius."""


def contact_of(scene: Drag2DScene) -> Contact:
    """The contacts of the grains, whose radius is that of the mean grain."""
    grains = scene.grains
    return Contact(
        youngs_modulus=grains.youngs_modulus,
        poisson_ratio=grains.poisson_ratio,
        restitution=grains.restitution,
        friction=grains.friction,
        radius=grains.diameter / 2.0,
    )


def build(
    scene: Drag2DScene,
    numerics: Drag2DNumerics,
    bed: Bed,
    name: str,
    version: str,
    dialect: Dialect = IN_HOUSE,
) -> Deck:
    """The deck of one packing. Raises CaseError for shapes that the dialect does not know."""
    if dialect is IN_HOUSE:
        return _in_house(scene, numerics, bed)
    check_shape(scene, dialect)
    deck = planar.build(
        contact_of(scene), _planar_bed(scene, bed), _steps(numerics), dialect, name, version
    )
    return replace(deck, blobs={BED: bed_file(bed)})


def check_shape(scene: Drag2DScene, dialect: Dialect) -> None:
    """Raise CaseError for shapes that the dialect does not know."""
    if scene.grains.shape == "ellipse" and dialect is not IN_HOUSE:
        raise CaseError(
            "grains.shape",
            scene.grains.shape,
            f"{dialect.name} has no contact of two ellipses",
            "choose --engine dem, or another shape",
        )


def _in_house(scene: Drag2DScene, numerics: Drag2DNumerics, bed: Bed) -> Deck:
    plan = Plan(
        start=NUMBERS,
        ranks=1,
        time_step=numerics.time_step.value,
        stages={"drive": numerics.drive_steps.value},
        row_every=numerics.row_every.value,
        series={"series.csv": CHANNELS},
    )
    text = table("contact", IN_HOUSE.numbers(contact_of(scene), 1))
    text += table(
        "run",
        {
            "time_step": numerics.time_step.value,
            "steps": numerics.drive_steps.value,
            "row_every": numerics.row_every.value,
            "frame_every": numerics.frame_every.value,
            "skin": numerics.skin.value,
            "watched": len(bed.mass) - 1,
        },
    )
    return Deck({NUMBERS: _HEAD + text}, plan, {BED: bed_file(bed)})


_HEAD = """# One packing of a closed bed, for the in-house engine of liftdrag (SI units).
# bed.npz holds the grains; the last body is the cylinder. numerics.txt gives the reasons.
# By hand: python -m liftdrag.engines.dem FOLDER
"""


def bed_file(bed: Bed) -> bytes:
    """A bed without its memory, as the content of an .npz file."""
    arrays = {field.name: getattr(bed, field.name) for field in fields(bed)}
    del arrays["memory"]
    out = BytesIO()
    np.savez(out, **arrays)
    return out.getvalue()


def read_bed(folder: Path) -> Bed:
    """The packing of a deck's folder. Raises InputError when it is missing or damaged."""
    try:
        arrays: dict[str, Any] = read_arrays(folder / BED)
        contact, walls = str(arrays.pop("contact")), arrays.pop("walls")
        left, right, bottom, top = map(float, walls)
        return Bed(**arrays, contact=contact, walls=(left, right, bottom, top))
    except (OSError, ValueError, LookupError, TypeError) as error:
        raise InputError(
            f"{folder / BED} is no packing of liftdrag ({error}); write the deck again."
        ) from None


def _planar_bed(scene: Drag2DScene, bed: Bed) -> planar.PlanarBed:
    """The bed's parts as discs: all but the last, the cylinder."""
    discs = bed.body < len(bed.mass) - 1
    radius, body = bed.radius[discs], bed.body[discs]
    share = radius**2 / np.bincount(body, radius**2)[body]
    return planar.PlanarBed(
        position=bed.place[discs],
        radius=radius,
        mass=share * bed.mass[body],
        body=body,
        width=scene.box.width,
        height=scene.height,
        intruder_position=bed.position[-1],
        intruder_radius=scene.intruder.diameter / 2.0,
        intruder_velocity=bed.velocity[-1],
    )


def _steps(numerics: Drag2DNumerics) -> planar.PlanarSteps:
    return planar.PlanarSteps(
        time_step=numerics.time_step.value,
        count=numerics.drive_steps.value,
        row_every=numerics.row_every.value,
        snapshot_every=numerics.frame_every.value,
        skin=numerics.skin.value,
        progress_every=numerics.frame_every.value,
    )
