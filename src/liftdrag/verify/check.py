"""A measured value beside the one that it should have."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any


@dataclass(frozen=True)
class Check:
    """A measured value beside the one that it should have.

    `bound` is the largest relative error allowed (absolute where 0 is expected), None for
    a value that is only reported.
    """

    test: str
    quantity: str
    unit: str
    measured: float
    expected: float
    source: str
    bound: float | None

    @property
    def error(self) -> float:
        """Relative to the expected value, where it is not zero."""
        return abs(self.measured - self.expected) / (abs(self.expected) or 1.0)

    @property
    def passed(self) -> bool:
        """Whether the error is within its bound, where there is one."""
        return self.bound is None or self.error <= self.bound

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        return asdict(self) | {"error": self.error, "passed": self.passed}
