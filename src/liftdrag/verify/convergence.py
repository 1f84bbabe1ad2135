"""How the error of an elastic impact falls with the time step."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from liftdrag.engines.base import Engine
from liftdrag.engines.impact import Throw
from liftdrag.verify.material import ALUMINIUM, closed_form, thrown

FRACTIONS = (0.2, 0.1, 0.05, 0.025, 0.0125)
"""Time steps over the Rayleigh time at which the order of convergence shows."""


@dataclass(frozen=True)
class Convergence:
    """Relative errors of an elastic impact at time steps given over the Rayleigh time.

    `order` is the slope of the logarithm of the error over that of the time step.
    """

    quantity: str
    fractions: tuple[float, ...]
    errors: tuple[float, ...]

    @property
    def order(self) -> float:
        """Order of convergence in the time step."""
        return float(np.polyfit(np.log(self.fractions), np.log(self.errors), 1)[0])

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        return asdict(self) | {"order": self.order}


def convergence(engine: Engine) -> list[Convergence]:
    """Errors of test 2's aluminium against Hertz's closed form, over the time step."""
    force, overlap, duration = closed_form(ALUMINIUM, rigid=True)
    contact = ALUMINIUM.contact(1.0, 0.0, rigid=True)
    errors: dict[str, list[float]] = {"peak force": [], "peak overlap": [], "duration": []}
    for fraction in FRACTIONS:
        (found,) = thrown(engine, ALUMINIUM, contact, [Throw(ALUMINIUM.speed)], fraction)
        errors["peak force"].append(abs(found.peak_force / force - 1.0))
        errors["peak overlap"].append(abs(found.peak_overlap / overlap - 1.0))
        errors["duration"].append(abs(found.duration / duration - 1.0))
    return [Convergence(name, FRACTIONS, tuple(values)) for name, values in errors.items()]
