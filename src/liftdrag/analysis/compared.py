"""Measured stresses beside the paper's curves of stress against alignment, or kinetic theory."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from math import hypot
from typing import Any

import numpy as np

from liftdrag import kinetic, liu
from liftdrag.analysis.quantity import Quantity, ratio

THEORY = {"shear_stress": "shear_stress", "pressure": "pressure", "fluctuation_energy": "energy"}
"""What kinetic theory says of spheres, and what it calls it."""


@dataclass(frozen=True)
class Compared:
    """A `measured` stress, and that of the `curve` at the measured order, with the order's error.

    The paper gives no error of the curve itself, and theory has none.
    """

    measured: Quantity
    curve: Quantity

    @property
    def ratio(self) -> Quantity:
        """The measured stress over that of the curve."""
        return ratio(self.measured, 1.0, [self.curve], "1")

    @property
    def difference_in_errors(self) -> float:
        """How many combined errors the measured stress is above the curve."""
        error = hypot(self.measured.standard_error, self.curve.standard_error)
        return (self.measured.mean - self.curve.mean) / error

    def to_dict(self) -> dict[str, Any]:
        """As `result.json` holds it."""
        return asdict(self) | {"difference_in_errors": self.difference_in_errors}


def compared(solid_fraction: float, found: Mapping[str, Quantity]) -> dict[str, Compared]:
    """The stresses of `found` beside the curves at its `order_parameter`; none without a curve."""
    order = found["order_parameter"]
    beside = dict[str, Compared]()
    for name in liu.CURVES:
        curve = liu.curve(name, solid_fraction)
        if curve is not None:
            there = float(curve(np.array(order.mean)))
            error = abs(curve.a) * there * order.standard_error
            beside[name] = Compared(found[name], replace(order, mean=there, standard_error=error))
    return beside


def beside_theory(
    solid_fraction: float, restitution: float, found: Mapping[str, Quantity]
) -> dict[str, Compared]:
    """The stresses and energy of hard spheres beside kinetic theory; none where they freeze."""
    if not kinetic.holds(solid_fraction, restitution):
        return {}
    there = kinetic.steady_shear(solid_fraction, restitution)
    return {
        name: Compared(found[name], Quantity(getattr(there, own), 0.0, "1", None, None, True))
        for name, own in THEORY.items()
    }
