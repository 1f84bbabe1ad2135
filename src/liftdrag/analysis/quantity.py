"""An answer: a mean, its standard error and its unit."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from math import floor, hypot, isfinite, log10
from typing import Any

from scipy.special import stdtrit

from liftdrag.analysis.errorbars import MINIMUM_CORRELATION_TIMES, Average
from liftdrag.analysis.steady import SteadyWindow

SAMPLES_PER_DEGREE = 20.0
"""Independent samples of a correlated series to a degree of freedom of its error.

Measured on series that were stopped by their own error (`stopping`), which prefers errors that
came out small.
"""

FEWEST_DEGREES = 3.0


@dataclass(frozen=True)
class Quantity:
    """`mean` and `standard_error` in `unit`.

    `correlation_time` in seconds and the number of independent samples are None
    where the quantity is not the average of one series.
    """

    mean: float
    standard_error: float
    unit: str
    correlation_time: float | None
    n_independent: float | None
    converged: bool

    @classmethod
    def of(cls, average: Average, unit: str) -> Quantity:
        """The quantity of an average over a series."""
        return cls(
            average.mean,
            average.standard_error,
            unit,
            average.correlation_time,
            average.n_independent,
            average.converged,
        )

    @property
    def interval_95(self) -> tuple[float, float]:
        """Where the truth lies in 95 of 100 cases: Student's t for the error of the error."""
        half = self.standard_error * float(stdtrit(self._degrees, 0.975))
        return self.mean - half, self.mean + half

    @property
    def _degrees(self) -> float:
        """Degrees of freedom of the error; those of an ensemble are its packings less one."""
        if self.n_independent is None:
            return 1e9
        if self.correlation_time is None:
            return max(self.n_independent - 1.0, 1.0)
        return max(self.n_independent / SAMPLES_PER_DEGREE, FEWEST_DEGREES)

    def to_dict(self) -> dict[str, Any]:
        """The quantity as `result.json` holds it."""
        return asdict(self) | {"interval_95": list(self.interval_95)}


def ratio(force: Quantity, scale: float, divisors: Sequence[Quantity], unit: str) -> Quantity:
    """scale x force / (the product of the divisors), their errors taken as independent.

    The correlation time and the independent samples are those of `force`. It is converged
    when the force is, and so is each divisor that adds noticeably to its error.
    """
    factor = scale
    for divisor in divisors:
        factor /= divisor.mean
    mean, own = factor * force.mean, abs(factor) * force.standard_error
    shares = [abs(mean) * divisor.standard_error / divisor.mean for divisor in divisors]
    pairs = zip(divisors, shares, strict=True)
    return Quantity(
        mean,
        hypot(own, *shares),
        unit,
        force.correlation_time,
        force.n_independent,
        force.converged and all(divisor.converged or share < own / 2 for divisor, share in pairs),
    )


def rounded(mean: float, error: float) -> tuple[str, str]:
    """A mean and its error as text, both to the error's second significant digit."""
    if not isfinite(error) or error <= 0.0:
        return f"{mean:.5g}", f"{error:.2g}"
    digits = 1 - floor(log10(error))
    if abs(mean) >= 1e5 or digits > 6:
        return f"{mean:.5g}", f"{error:.2g}"
    return f"{mean:.{max(digits, 0)}f}", f"{error:.{max(digits, 0)}f}"


def shortcomings(forces: Mapping[str, Quantity], window: SteadyWindow) -> Iterator[str]:
    """A sentence for each force that is not converged, and one when the window is not steady."""
    for name, force in forces.items():
        if not force.converged:
            yield (
                f"NOT CONVERGED: the {name} was averaged over {force.n_independent:.0f} "
                f"correlation times, fewer than {MINIMUM_CORRELATION_TIMES}; its error is a guess: "
                "run longer."
            )
    if not window.steady and isfinite(window.drift):
        yield (
            f"NOT STEADY: a force still drifts by {window.drift:.1f} standard errors within the "
            "averaged window: run longer, or discard more of the start."
        )
