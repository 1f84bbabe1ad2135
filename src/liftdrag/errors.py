"""What can go wrong, as exceptions that carry their data and say what to do."""

from __future__ import annotations

from collections.abc import Callable
from math import ceil, floor, log10


class InputError(ValueError):
    """Bad input from the user; nothing was started. The command line exits with status 2."""


class CaseError(InputError):
    """A key of a case file is wrong: carries the `key`, its `value` and the `remedy`."""

    def __init__(self, key: str, value: object, problem: str, remedy: str):
        self.key, self.value, self.problem, self.remedy = key, value, problem, remedy
        given = "" if value is None else f" = {shown(value)}"
        super().__init__(f"{escaped(key[:60])}{given}: {problem}; {remedy}.")


def shown(value: object) -> str:
    """A value as an error repeats it: short."""
    try:
        text = f"{value:.6g}" if isinstance(value, float) else repr(value)
    except ValueError:  # Python writes no whole number of more than 4300 digits
        return "a huge number"
    return text if len(text) <= 60 else f"{text[:57]}..."


def escaped(text: str) -> str:
    """A text with what a terminal would obey, or break a line at, written as Python does."""
    return "".join(sign if sign.isprintable() else repr(sign)[1:-1] for sign in text)


def at_least(value: float) -> str:
    """A positive value to four digits, rounded up: one that a user may copy."""
    return _rounded(value, ceil)


def at_most(value: float) -> str:
    """A positive value to four digits, rounded down."""
    return _rounded(value, floor)


def _rounded(value: float, towards: Callable[[float], int]) -> str:
    if value <= 0.0:
        return "0"
    unit = 10.0 ** (floor(log10(value)) - 3)
    return f"{towards(round(value / unit, 6)) * unit:.4g}"


class SeriesTooShort(ValueError):
    """A series is too short for an error bar; `estimate` is the mean without one, or None."""

    def __init__(self, message: str, estimate: float | None = None):
        self.estimate = estimate
        super().__init__(message)


class RunFailed(RuntimeError):
    """An engine's run did not finish: `status` says why, `evidence` shows its last words."""

    def __init__(self, status: str, reason: str, evidence: str = ""):
        self.status, self.reason, self.evidence = status, reason, evidence
        super().__init__(f"{reason}\n{evidence}".rstrip())
