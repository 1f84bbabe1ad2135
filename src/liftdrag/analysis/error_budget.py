"""What an answer's error is made of: its statistics, and the biases that a bench measured.

A standard error says nothing of a time step that is too long or a box that is too small. Those
biases are known where `liftdrag bench` has compared the case with a more careful one, and said to
be unknown where it has not.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from typing import Any

from liftdrag.analysis.biases import Bias, Biases
from liftdrag.analysis.quantity import Quantity

AXES = {
    "tank": ("time_step", "stiffness", "speed", "length", "thickness", "height"),
    "drag2d": ("time_step", "stiffness", "speed", "width"),
    "janssen": ("time_step", "stiffness", "speed"),
    "shear": ("time_step", "stiffness", "size"),
}
"""The choices that bias each scene's answers."""

JUDGED_AS = {
    "tank": {
        "drag": "drag_coefficient",
        "lift": "lift_coefficient",
        "drag_coefficient": "drag_coefficient",
        "lift_coefficient": "lift_coefficient",
        "drag_coefficient_overburden": "drag_coefficient",
    },
    "drag2d": {"drag": "drag"},
    "janssen": {"apparent_mass": "apparent_mass", "saturation_mass": "saturation_mass"},
    "shear": {"shear_stress": "shear_stress", "pressure": "pressure"},
}
"""Quantities that have a budget, and under which name a bench gives their relative bias."""

_OF_NO_MATTER = (
    "seed",
    "drive.distance",
    "drive.duration",
    "drive.strain",
    "ensemble.runs",
    "stop",
)
"""Keys that change how long a case is run, and not what it answers."""


@dataclass(frozen=True)
class ErrorBudget:
    """Of one quantity: its relative standard error, its known biases, the axes without one."""

    statistical: float
    biases: Mapping[str, Bias]
    not_measured: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """As `result.json` holds it."""
        found = {axis: asdict(bias) for axis, bias in self.biases.items()}
        missing = list(self.not_measured)
        return {"statistical": self.statistical, "biases": found, "not_measured": missing}


def error_budgets(
    scene: str, found: Mapping[str, Quantity], biases: Biases | None
) -> dict[str, ErrorBudget]:
    """The budget of the quantities that a bench judges, relative to their means."""
    known = biases.found if biases else {}
    return {
        name: _budget(scene, found[name], known.get(key, {}))
        for name, key in JUDGED_AS[scene].items()
        if name in found
    }


def _budget(scene: str, quantity: Quantity, known: Mapping[str, Bias]) -> ErrorBudget:
    relative = abs(quantity.standard_error / quantity.mean) if quantity.mean else float("inf")
    measured = {axis: known[axis] for axis in AXES[scene] if axis in known}
    return ErrorBudget(relative, measured, tuple(a for a in AXES[scene] if a not in known))


def differences(tables: Mapping[str, Any], biases: Biases) -> list[str]:
    """The dotted keys in which a case is another than the benched one, where that matters."""
    mine, benched = dict(_flat(tables)), dict(_flat(biases.tables))
    return sorted(
        key
        for key in mine.keys() | benched.keys()
        if mine.get(key) != benched.get(key) and not key.startswith(_OF_NO_MATTER)
    )


def _flat(tables: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    for key, value in tables.items():
        if isinstance(value, dict):
            yield from _flat(value, f"{prefix}{key}.")
        else:
            yield prefix + key, value
