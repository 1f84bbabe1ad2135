"""The papers' numbers beside a run's, in combined standard errors where the case is the paper's."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import hypot, sqrt
from typing import Any

from pydantic import BaseModel

from liftdrag.analysis.quantity import Quantity, rounded
from liftdrag.case import Case, load
from liftdrag.errors import InputError

GUILLARD = "Guillard, Forterre and Pouliquen, Phys. Fluids 26, 043301 (2014)"
ZHOU = "Zhou, Advani and Wetzel"

OF_NO_MATTER = (
    *("seed", "stop", "drive.distance", "drive.duration", "ensemble.runs"),
    *("numerics", "fields"),
)
"""Keys that say how long and how finely a case is run and looked at, not which case it is."""


@dataclass(frozen=True)
class Reference:
    """A number of a paper: `value` with its `error`, for the packaged `cases` that repeat it.

    Without cases it holds for every one of the scene.
    """

    scene: str
    quantity: str
    value: float
    error: float
    unit: str
    source: str
    cases: tuple[str, ...] = ()


_TANKS = ("guillard2014/free-surface", "guillard2014/lid", "guillard2014/lid-only")

REFERENCES = (
    Reference(
        "tank",
        "drag_coefficient",
        10.0,
        1.0,
        "1",
        f"{GUILLARD}, section III B: C_d of about 10 in the simulation, at all depths, with and "
        "without weight in the bulk; the error is a reading of 'about'. The experiment has 13.",
        _TANKS,
    ),
    Reference(
        "tank",
        "lift_coefficient",
        30.0,
        3.0,
        "1",
        f"{GUILLARD}, section IV: 30 times the buoyancy in the simulation, D/d = 3.3 at large "
        "depth; the error is a reading of one digit.",
        ("guillard2014/lid",),
    ),
    Reference(
        "tank",
        "lift_coefficient",
        0.0,
        0.0,
        "1",
        f"{GUILLARD}, section III B: no significant lift without weight in the bulk.",
        ("guillard2014/lid-only",),
    ),
    Reference(
        "drag2d",
        "drag",
        1295.0,
        0.18 * 1295.0 / sqrt(5.0),
        "N",
        f"{ZHOU}, section 3.2: 1295 N, of which 18 % is the deviation between five packings. The "
        "modulus of zhou/c1 is calibrated to it.",
        ("zhou/c1",),
    ),
    Reference(
        "drag2d",
        "drag",
        1405.0,
        0.17 * 1405.0 / sqrt(5.0),
        "N",
        f"{ZHOU}, section 3.2: 1405 N and 17 % by the contact of ellipses at aspect ratio 1.",
        ("zhou/c1",),
    ),
    Reference(
        "janssen",
        "weight_balance",
        1.0,
        0.0,
        "1",
        "Statics: piston and tube together bear the weight, whatever the case.",
    ),
)


@dataclass(frozen=True)
class Compared:
    """A row of the comparison: here, there, and how far they are apart, in words."""

    quantity: str
    here: str
    there: str
    difference: str
    source: str


def compared(tables: Mapping[str, Any], found: Mapping[str, Quantity]) -> list[Compared]:
    """The quantities of a case beside what is known of its scene.

    Where no paper has the case, each quantity is beside that of the nearest.
    """
    try:
        scene = Case("", tables).scene
    except InputError:  # a case of another version
        return []
    mine, named = dict(_flat(scene)), scene.scene
    known = [one for one in REFERENCES if one.scene == named and one.quantity in found]
    apart = {one: _apart(mine, one) for one in known}
    least = dict[str, int]()
    for one, keys in apart.items():
        least[one.quantity] = min(len(keys), least.get(one.quantity, len(keys)))
    nearest = [one for one in known if len(apart[one]) == least[one.quantity]]
    return [_row(one, found[one.quantity], apart[one]) for one in nearest]


def _apart(mine: Mapping[str, Any], known: Reference) -> list[str]:
    """The keys in which a case is another than that of a reference; none where it is the same."""
    others = [_other_keys(mine, case) for case in known.cases]
    return min(others, key=len, default=[])


def _row(known: Reference, found: Quantity, apart: Sequence[str]) -> Compared:
    unit = "" if known.unit == "1" else f" {known.unit}"
    there = " ± ".join(rounded(known.value, known.error)) if known.error else f"{known.value:g}"
    return Compared(
        known.quantity,
        " ± ".join(rounded(found.mean, found.standard_error)) + unit,
        there + unit,
        _difference(known, found, apart),
        known.source,
    )


def _difference(known: Reference, found: Quantity, apart: Sequence[str]) -> str:
    if apart:
        named = ", ".join(apart[:4]) + (" and more" if len(apart) > 4 else "")
        return f"not the paper's case, which has another {named}"
    error = hypot(found.standard_error, known.error)
    if not error:
        return "no error to compare by"
    return f"{(found.mean - known.value) / error:+.1f} combined standard errors"


def _other_keys(mine: Mapping[str, Any], packaged: str) -> list[str]:
    """The keys in which a case is another than a packaged one, in SI units."""
    theirs = dict(_flat(load(packaged).scene))
    return sorted(
        key
        for key in mine.keys() | theirs.keys()
        if mine.get(key) != theirs.get(key) and not key.startswith(OF_NO_MATTER)
    )


def _flat(model: BaseModel, prefix: str = "") -> Iterator[tuple[str, Any]]:
    for name in type(model).model_fields:
        value = getattr(model, name)
        if isinstance(value, BaseModel):
            yield from _flat(value, f"{prefix}{name}.")
        else:
            yield prefix + name, value
