"""Scene, numerics and packed column of a Janssen piston into a deck: of numbers, or LAMMPS'."""

from __future__ import annotations

from io import BytesIO
from typing import Any

import numpy as np

from liftdrag.deck import column as family
from liftdrag.deck.dialect import IN_HOUSE, Dialect
from liftdrag.deck.model import Deck
from liftdrag.deck.tables import table
from liftdrag.granular import GRAVITY
from liftdrag.numerics import JanssenNumerics
from liftdrag.packing.tube import PackedColumn
from liftdrag.scene import JanssenScene
from liftdrag.scene.janssen import TANGENTIAL_RATIO

START = "column.toml"
"""What the in-house engine is to do."""

GRAINS = "column.npz"
"""With what: `grains` (n, 3) in order of z, and `lid` (m, 3), centres as packed, m."""

FORCES = "forces.csv"
"""What it leaves of the CHANNELS."""

CHANNELS = family.CHANNELS | {"elastic": "J", "overlap": "1"}
"""What the in-house engine samples beside the others' channels: the energy of the springs, and
the deepest overlap over the radius."""

check_contact = family.check_contact


def build(
    scene: JanssenScene,
    numerics: JanssenNumerics,
    column: PackedColumn,
    name: str,
    version: str,
    ranks: int,
    dialect: Dialect = IN_HOUSE,
) -> Deck:
    """The deck of a column that is filled level by level.

    Raises CaseError when the dialect cannot say the contacts.
    """
    if dialect is not IN_HOUSE:
        return family.build(scene, numerics, column, name, version, ranks, dialect)
    plan = family.plan_of(scene, numerics, ranks, START, {FORCES: CHANNELS})
    file = BytesIO()
    np.savez(file, allow_pickle=False, grains=column.grains, lid=column.lid)
    return Deck({START: _text(scene, numerics, ranks)}, plan, {GRAINS: file.getvalue()})


def _text(scene: JanssenScene, numerics: JanssenNumerics, threads: int) -> str:
    grains = scene.grains
    tables: dict[str, dict[str, Any]] = {
        "contact": {
            "law": grains.contact,
            "stiffness": numerics.stiffness.value,
            "restitution": grains.restitution,
            "friction": grains.friction,
            "tangential_ratio": TANGENTIAL_RATIO,
            "poisson_ratio": grains.poisson_ratio or 0.0,
        },
        "grains": {
            "diameter": grains.diameter,
            "mass": grains.mass,
            "lid_mass": scene.lid_mass,
            "gravity": GRAVITY,
        },
        "walls": {
            "radius": scene.tube.diameter / 2.0,
            "lift": scene.wall_speed,
            "friction": scene.tube.friction,
        },
        "run": {
            "threads": threads,
            "bins": numerics.bins.value,
            "bin_height": numerics.bin_height.value,
            "time_step": numerics.time_step.value,
            "settle_rate": numerics.settle_rate.value,
            "skin": numerics.skin.value,
            "row_every": numerics.row_every.value,
            "profile_every": numerics.profile_every.value,
            "block_every": numerics.block_every.value,
            "fills": [
                [level.count, level.start, level.settled, level.mobilised, level.end]
                for level in numerics.levels
            ],
        },
    }
    return _HEAD + "".join(table(name, values) for name, values in tables.items())


_HEAD = """# A column of grains in a tube on a piston, for the in-house engine of liftdrag (SI).
# column.npz holds the grains as packed; numerics.txt gives the reasons for the numbers.
# fills: grains, the steps at which a layer is added, is settled, is mobilised, and is averaged.
# By hand: python -m liftdrag.engines.dem FOLDER
"""
