"""Restart files in decks: what they are called, and the decks that go on from them.

An engine writes two files of a stage by turns, so that one is whole at any moment. A deck that
goes on reads a third, a copy of the one that was whole.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

from liftdrag.deck.dialect import LAMMPS, LIGGGHTS, Dialect

STAGES = ("drive", "settle")
"""The stages that can be gone on with, the later first."""

PHASE = "from.lmp"
"""What the deck of a column that goes on reads: where in it, and until which step."""

Way = Literal["pieces", "upto", "written"]
"""How a run is made of pieces, each of which begins as a run from a restart file does, with forces
computed anew, so that both give the same bits: in "pieces" that LAMMPS' `restart` files end, or
in pieces after which LIGGGHTS has its file "written". Or it is one run, which goes on "upto" its
last step: not to the bit where an engine derives the damping of its walls anew at each run.
"""


def way_of(dialect: Dialect, springs: bool = False) -> Way:
    """How an engine keeps its state; walls of `springs` keep their damping in any."""
    if dialect is LIGGGHTS:
        return "written"
    return "pieces" if springs or dialect is LAMMPS else "upto"


def deck_of(start: str, stage: str) -> str:
    """The deck that goes on with a stage of the one called `start`."""
    return f"{start}-{stage}"


def written(stage: str) -> tuple[str, str]:
    """The restart files that a stage writes by turns."""
    return f"{stage}-a.restart", f"{stage}-b.restart"


def read(stage: str) -> str:
    """The restart file that the deck which goes on with a stage reads."""
    return f"{stage}-from.restart"


@dataclass(frozen=True)
class LongRun:
    """A run of a stage up to the step `steps`, which may be gone on with once it was cut short.

    A restart file comes every so many steps, or none for `every` 0. One of LIGGGHTS that may end
    early is in pieces in any case. A piece takes `piece` steps,
    or as many, and `after` it come commands; another follows while `going` holds, where that is
    given, from the `label`, that of the stage unless named. LIGGGHTS' file of its last step is not
    written where it is not `kept_last`: to write one makes what was computed out of date. Pieces
    that are `joined`, where no file comes, are as one run.
    """

    stage: str
    steps: str
    every: int
    way: Way
    going: str = ""
    label: str = ""
    piece: int = 0
    after: str = ""
    kept_last: bool = True
    joined: bool = False

    def lines(self, resumed: bool = False) -> str:
        """The commands; a run from a restart file is `resumed`."""
        if self.way == "written" and (self.every or self.going):
            return self.body(resumed)
        if not self.every:
            return f"run          {self.steps}"
        return f"{restarting(self.stage, self.every)}\n{self.body(resumed)}\nrestart      0"

    def body(self, resumed: bool = False) -> str:
        """The commands without those that ask LAMMPS for its files."""
        if self.way == "upto":
            return f"run          {self.steps}{' upto' * resumed}"
        return "\n".join(self._pieces())

    def _pieces(self) -> Iterator[str]:
        steps, label = self.piece or self.every, self.label or self.stage
        more = f"(${{left}} > 0) && ({self.going})" if self.going else "${left} > 0"
        if self.every:
            yield "# In pieces: a run that goes on from a restart file gives the same to the bit."
        yield f"variable     left equal {self.steps}-step"
        yield f"variable     piece equal (floor(step/{steps})+1)*{steps}-step"
        if self.way == "written" and self.every:
            yield f"variable     since equal step-floor(step/{self.every})*{self.every}"
            yield f"variable     turn equal floor(step/{self.every})-2*floor(step/{2 * self.every})"
        joined = " pre no post no" * (self.joined and not self.every)
        if joined:
            yield "run          0"
        yield f"label        {label}"
        runs = f'"run ${{piece}}{joined}" else "run ${{left}}{joined}"'
        yield f'if           "${{left}} > ${{piece}}" then {runs}'
        if self.after:
            yield self.after
        if self.way == "written" and self.every:
            yield from self._writing("" if self.kept_last else f" && ({more})")
        yield f'if           "{more}" then "jump SELF {label}"'

    def _writing(self, also: str) -> Iterator[str]:
        for turn, file in zip((1, 0), written(self.stage), strict=True):
            due = f"(${{since}} == 0) && (${{turn}} == {turn}){also}"
            said = f"print 'LIFTDRAG KEPT {file} at step $(step)'"
            yield f'if           "{due}" then "write_restart {file}" "{said}"'


def restarting(stage: str, every: int) -> str:
    """The command that asks LAMMPS for the files of a stage."""
    first, second = written(stage)
    return f"restart      {every} {first} {second}"
