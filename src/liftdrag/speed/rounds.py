"""Timings that other work on the machine disturbs least."""

from __future__ import annotations

from collections.abc import Callable

ROUNDS = 6
"""Of which the first may have to compile."""


def best(*runs: Callable[[], float], rounds: int = ROUNDS) -> list[float]:
    """The least of several rounds of each, taken by turns."""
    return [
        min(times) for times in zip(*([run() for run in runs] for _ in range(rounds)), strict=True)
    ]
