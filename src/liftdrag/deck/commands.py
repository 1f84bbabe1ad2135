"""The engine commands that a deck may hold, so that no text of a case ever runs a program."""

from __future__ import annotations

import re
from collections.abc import Iterator

ALLOWED = frozenset(
    """atom_modify atom_style boundary comm_modify compute dump dump_modify fix group if
    neigh_modify neighbor newton pair_coeff pair_style print processors read_data region
    reset_timestep run thermo thermo_modify thermo_style timestep unfix units variable
    velocity write_dump""".split()
)
"""The only engine commands a deck may hold: none that runs programs or reads other files."""


ALLOWED_IN_IF = frozenset({"print", "quit"})
"""The only commands that an `if` of a deck may run."""


def check_commands(text: str) -> None:
    """Raise ValueError when a line holds a command or a form of one that is not allowed."""
    for line in text.splitlines():
        command = line.split("#")[0].strip()
        _check(command, ALLOWED)
        if command.startswith("if "):
            for part in _consequences(command):
                _check(part, ALLOWED_IN_IF)


def _check(command: str, allowed: frozenset[str]) -> None:
    words = command.split()
    if words and (words[0] not in allowed or not _harmless(words)):
        raise ValueError(f"the deck would run {command[:60]!r}, which is not allowed")


def _consequences(command: str) -> Iterator[str]:
    """The commands that an `if` would run."""
    quoted = command.partition(" then ")[2]
    for match in re.finditer(r"\"([^\"]*)\"|'([^']*)'|(\S+)", quoted):
        yield next(part for part in match.groups() if part is not None)


def _harmless(words: list[str]) -> bool:
    """Whether a command is of the forms that the templates use, clear of files and the shell."""
    if words[0] == "variable":
        return len(words) > 2 and words[2] in {"index", "equal"}
    return words[0] != "print" or not {"file", "append"} & set(words[1:])
