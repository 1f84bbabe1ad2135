"""The engine commands that a deck may hold, so that no text of a case ever runs a program."""

from __future__ import annotations

import re
from collections.abc import Iterator

ALLOWED = frozenset(
    """atom_modify atom_style boundary comm_modify communicate compute dimension displace_atoms
    dump dump_modify fix group hard_particles if label neigh_modify neighbor newton pair_coeff
    pair_style print processors read_data region reset_timestep run soft_particles thermo
    thermo_modify thermo_style timestep unfix units variable velocity write_dump""".split()
)
"""The only engine commands a deck may hold: none that runs programs or includes other decks."""

PIECES = frozenset({("include", "stop.lmp"), ("next", "piece"), ("jump", "SELF", "drive")})
"""Whole commands of a run in pieces, after each of which a file of liftdrag's may end it."""

FILL_PIECES = re.compile(r"include stop-[0-9]+\.lmp|next piece_[0-9]+|jump SELF average_[0-9]+")
"""The same of an average in pieces, one for each fill of a column."""

RESTARTS = re.compile(
    r"restart 0|restart [0-9]+ (settle|drive)-a\.restart \1-b\.restart"
    r"|read_restart (settle|drive)-from\.restart"
)
"""Whole commands that write the state of a tank and read it again."""

RUN_PIECE = re.compile(r"run ([0-9]+|\$\{left\})")
"""What an `if` may run of a run in pieces."""

ALLOWED_IN_IF = frozenset({"print", "quit", "jump"})
"""The only commands that an `if` of a deck may run."""

STYLES = {
    "variable": (2, {"atom", "index", "equal", "loop"}),
    "compute": (
        3,
        {"chunk/atom", "ke", "property/atom", "reduce", "reduce/region", "stress/atom"},
    ),
    "displace_atoms": (2, {"move"}),
    "dump": (3, {"custom"}),
    "fix": (
        3,
        set(
            """ave/chunk ave/spatial ave/time check/timestep/gran enforce2d gravity halt move
            nve nve/sphere property/atom property/global rigid rigid/small viscous wall/gran
            wall/gran/region""".split()
        ),
    ),
}
"""Commands that have styles: the place of the style's word, and the styles allowed."""


def check_commands(text: str) -> None:
    """Raise ValueError when a line holds a command or a form of one that is not allowed."""
    for line in text.splitlines():
        command = line.split("#")[0].strip()
        _check(command, ALLOWED)
        if command.startswith("if "):
            for part in _consequences(command):
                if not RUN_PIECE.fullmatch(part):
                    _check(part, ALLOWED_IN_IF)


def _check(command: str, allowed: frozenset[str]) -> None:
    words = command.split()
    if tuple(words) in PIECES or any(
        whole.fullmatch(" ".join(words)) for whole in (FILL_PIECES, RESTARTS)
    ):
        return
    if words and (words[0] not in allowed or not _harmless(words)):
        raise ValueError(f"the deck would run {command[:60]!r}, which is not allowed")


def _consequences(command: str) -> Iterator[str]:
    """The commands that an `if` would run."""
    quoted = re.split(r"\sthen\s", command, maxsplit=1)[-1]
    for match in re.finditer(r"\"([^\"]*)\"|'([^']*)'|(\S+)", quoted):
        if match[3] != "else":
            yield next(part for part in match.groups() if part is not None)


def _harmless(words: list[str]) -> bool:
    """Whether a command is of the forms that the templates use, and stays in its folder."""
    if any(word.startswith(("/", "~", "..")) for word in words):
        return False
    if words[0] in STYLES:
        place, styles = STYLES[words[0]]
        return len(words) > place and words[place] in styles
    if words[0] == "run":
        return len(words) == 2 or words[2:] in (["pre", "no", "post", "no"], ["upto"])
    if words[0] == "jump":
        return words[1:2] == ["SELF"]
    return words[0] != "print" or not {"file", "append"} & set(words)
