"""A derived number with its reason, and the table of all that a run needs."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields
from typing import Generic, TypeVar

T = TypeVar("T")


@dataclass(frozen=True)
class Value(Generic[T]):
    """A derived value, its unit, and the reason for it."""

    value: T
    unit: str
    reason: str


@dataclass(frozen=True, kw_only=True)
class Numerics:
    """Numbers that a deck needs and its scene does not say; `warnings` are for who runs it."""

    warnings: tuple[str, ...]

    def rows(self) -> Iterator[tuple[str, Value]]:
        """The values by name, in order."""
        for field in fields(self):
            value = getattr(self, field.name)
            if isinstance(value, Value):
                yield field.name, value


def explained(numerics: Numerics) -> str:
    """The numerics as text, a line each: name, value, unit and reason; then the warnings."""
    lines = [
        f"{name:<17} {_shown(value.value):>12} {value.unit:<6} {value.reason}"
        for name, value in numerics.rows()
    ]
    return "\n".join([*lines, *(f"WARNING: {warning}" for warning in numerics.warnings), ""])


def _shown(value: object) -> str:
    if isinstance(value, tuple):
        return " x ".join(map(str, value))
    return f"{value:.4g}" if isinstance(value, float) else str(value)
