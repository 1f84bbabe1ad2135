"""Restart files in the decks of LAMMPS: what they are called, and the decks that go on from them.

LAMMPS writes two files of a stage by turns, so that one is whole at any moment. A deck that goes
on reads a third, a copy of the one that was whole.
"""

from __future__ import annotations

from dataclasses import dataclass

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


@dataclass(frozen=True)
class LongRun:
    """A run of a stage up to the step `steps`, which LAMMPS may go on with once it was cut short.

    A restart file comes every so many steps, or none for `every` 0. `exact` runs are made of
    pieces, each of which begins as a run from a restart file does, with forces computed anew: both
    give the same bits. A piece follows while `going` holds, where that is given.
    """

    stage: str
    steps: str
    every: int
    exact: bool
    going: str = ""

    def lines(self, resumed: bool = False) -> str:
        """The commands; a run from a restart file is `resumed`."""
        if not self.every:
            return f"run          {self.steps}"
        first, second = written(self.stage)
        body = self._pieces() if self.exact else self._whole(resumed)
        return f"restart      {self.every} {first} {second}\n{body}\nrestart      0"

    def _whole(self, resumed: bool) -> str:
        return f"run          {self.steps}{' upto' * resumed}"

    def _pieces(self) -> str:
        more = f"(${{left}} > 0) && ({self.going})" if self.going else "${left} > 0"
        return "\n".join(
            (
                "# In pieces: a run that goes on from a restart file gives the same to the bit.",
                f"variable     left equal {self.steps}-step",
                f"label        {self.stage}",
                f'if           "${{left}} > {self.every}" then "run {self.every}" '
                'else "run ${left}"',
                f'if           "{more}" then "jump SELF {self.stage}"',
            )
        )
