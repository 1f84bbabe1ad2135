"""Restart files in the decks of LAMMPS: what they are called, and the decks that go on from them.

LAMMPS writes two files of a stage by turns, so that one is whole at any moment. A deck that goes
on reads a third, a copy of the one that was whole.
"""

from __future__ import annotations

STAGES = ("drive", "settle")
"""The stages of a tank that can be gone on with, the later first."""


def deck_of(stage: str) -> str:
    """The deck that goes on with a stage."""
    return f"in.tank-{stage}"


def written(stage: str) -> tuple[str, str]:
    """The restart files that a stage writes by turns."""
    return f"{stage}-a.restart", f"{stage}-b.restart"


def read(stage: str) -> str:
    """The restart file that the deck which goes on with a stage reads."""
    return f"{stage}-from.restart"
