"""Scene, numerics and grown cell of a shear flow into a deck of numbers for the in-house engine."""

from __future__ import annotations

from dataclasses import fields
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from liftdrag.arrays import read_arrays
from liftdrag.deck.dialect import IN_HOUSE
from liftdrag.deck.model import Deck, Plan
from liftdrag.deck.tables import table
from liftdrag.dem.cylinders import Cylinders
from liftdrag.errors import InputError
from liftdrag.numerics import ShearNumerics
from liftdrag.scene import ShearScene

START = "cell.toml"
"""What the in-house engine is to do."""

GRAINS = "cell.npz"
"""With what: the arrays of `dem.Cylinders`, and `species` (n,) by number from 1."""

STRESSES = "stresses.csv"
"""What it leaves of the CHANNELS."""

PARTS = ("kinetic", "contact")
COMPONENTS = tuple(f"{i}{j}" for i in "xyz" for j in "xyz")

CHANNELS = {f"{part}_{name}": "Pa" for part in PARTS for name in COMPONENTS} | {
    "fluctuation": "J",
    "rotation": "J",
    "elastic": "J",
    "momentum": "kg m/s",
    "jumps": "1",
    "overlap": "1",
}
"""What the in-house engine samples: stresses, positive in compression, of the force or momentum
along the first letter through a plane across the second; energies against the mean flow, of turning
and of the contacts, the size of the momentum against the mean flow, contacts a step whose normal
jumped, and the deepest overlap over the smallest radius or half length of two grains."""


def check_engine(name: str) -> None:
    """Raise InputError for an engine that has no cylinders."""
    if name != IN_HOUSE.name:
        raise InputError(
            f"The engine {name} has no contact of cylinders with flat ends; choose --engine dem."
        )


def build(scene: ShearScene, numerics: ShearNumerics, grains: Cylinders, ranks: int) -> Deck:
    """The deck of a cell of these grains, in the order of the species, on so many threads."""
    plan = Plan(
        start=START,
        ranks=ranks,
        time_step=numerics.time_step.value,
        stages={"drive": numerics.drive_steps.value},
        row_every=numerics.row_every.value,
        series={STRESSES: CHANNELS},
        stoppable=scene.stop is not None,
    )
    return Deck({START: _text(scene, numerics, ranks)}, plan, {GRAINS: _file(scene, grains)})


def _text(scene: ShearScene, numerics: ShearNumerics, threads: int) -> str:
    tables: dict[str, dict[str, Any]] = {
        "contact": {
            "youngs_modulus": numerics.modulus.value,
            "poisson_ratio": scene.grains.poisson_ratio,
            "restitution": scene.grains.restitution,
        },
        "cell": {"size": list(scene.sides), "shear_rate": scene.drive.shear_rate},
        "run": {
            "threads": threads,
            "time_step": numerics.time_step.value,
            "steps": numerics.drive_steps.value,
            "row_every": numerics.row_every.value,
            "frame_every": numerics.frame_every.value,
            "skin": numerics.skin.value,
        },
    }
    return _HEAD + "".join(table(name, values) for name, values in tables.items())


_HEAD = """# Cylinders in a sheared periodic cell, for the in-house engine of liftdrag (SI units).
# cell.npz holds the grains as grown; numerics.txt gives the reasons for the numbers.
# By hand: python -m liftdrag.engines.dem FOLDER
"""


def _file(scene: ShearScene, grains: Cylinders) -> bytes:
    arrays = {field.name: getattr(grains, field.name) for field in fields(grains)}
    species = np.repeat(np.arange(1, len(scene.counts) + 1), scene.counts)
    out = BytesIO()
    np.savez(out, allow_pickle=False, species=species, **arrays)
    return out.getvalue()


def read_grains(folder: Path) -> tuple[Cylinders, np.ndarray]:
    """The grains of a deck's folder, and their species (n,). Raises InputError when damaged."""
    try:
        arrays: dict[str, Any] = read_arrays(folder / GRAINS)
        species = arrays.pop("species")
        _check(species, arrays)
        return Cylinders(**arrays), species
    except (OSError, ValueError, LookupError, TypeError) as error:
        raise InputError(
            f"{folder / GRAINS} holds no cell of liftdrag ({error}); write the deck again."
        ) from None


def _check(species: np.ndarray, arrays: dict[str, np.ndarray]) -> None:
    """Raise ValueError where arrays are not those of as many cylinders as there are species."""
    for name, values in arrays.items():
        shape = (len(species), 3)[: values.ndim]
        if values.dtype.kind != "f" or values.shape != shape or not np.isfinite(values).all():
            raise ValueError(f"{name} is not finite numbers for {len(species)} grains")
    for name in ("radius", "mass"):
        if not (arrays[name] > 0.0).all():
            raise ValueError(f"{name} is not positive")
    if not (arrays["half_length"] >= 0.0).all():
        raise ValueError("half_length is negative")
