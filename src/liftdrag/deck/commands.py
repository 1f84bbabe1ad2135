"""The engine commands that a deck may hold, so that no text of a case ever runs a program.

Each deck has a list of its own: commands, their styles, the files that it reads and writes, and
where it may jump to. What is not on the list is refused, harmless or not.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

ANY = frozenset(
    """atom_modify atom_style boundary comm_modify communicate compute dump dump_modify fix group
    hard_particles neigh_modify neighbor newton pair_coeff pair_style print processors read_data
    region run soft_particles thermo thermo_modify thermo_style timestep units variable""".split()
)
"""The commands of every deck: none that runs programs or includes other decks."""

STYLES = {
    "atom_style": (1, {"sphere", "hybrid"}),
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
    "pair_style": (1, {"gran", "gran/hertz/history", "granular"}),
    "region": (2, {"block", "cylinder"}),
    "variable": (2, {"atom", "equal", "index", "loop"}),
    "velocity": (2, {"set"}),
    "write_dump": (2, {"custom"}),
}
"""Commands that have styles: the place of the style's word, and the styles allowed."""

FILE_AT = {"dump": 5, "read_data": 1, "write_dump": 3}
"""Commands that name a file, and the place of its word; others name theirs after a FILE_WORD."""

FILE_WORDS = frozenset({"append", "file", "infile", "outfile"})

SHAPES = {
    "label": re.compile(r"label [a-z_0-9]+"),
    "print": re.compile(r"print (\"[^\"]*\"|'[^']*')"),
    "processors": re.compile(r"processors( [1-9*][0-9]*){3}"),
    "quit": re.compile(r"quit( 1)?"),
    "run": re.compile(r"run \S+( pre no post no| upto)?"),
}
"""Commands of which only this form is allowed, whole."""

IN_IF = frozenset({"print", "quit", "jump", "write_restart"})
"""The commands that an `if` may run."""

RUN_PIECE = re.compile(r"run \$\{(left|piece)\}( pre no post no)?")
"""What else it may run, in a run in pieces."""

RESTARTS = (
    r"restart (0|[0-9]+ (?P<stage>settle|drive)-a\.restart (?P=stage)-b\.restart)"
    r"|write_restart (settle|drive)-[ab]\.restart|read_restart (settle|drive)-from\.restart"
)
"""Whole commands that write the state of a run and read it again."""


CONTACTS = (
    r"compute pair_grains all property/local patom1 patom2 cutoff radius"
    r"|compute pair_forces all pair/local fx fy fz p1 p2 p3 cutoff radius"
    r"|compute pairs all pair/gran/local id force"
    r"|dump contacts all local [0-9]+ contacts\.dump( c_pair(s|_grains|_forces)\[[1-6]\])+"
)
"""Whole commands that write the contacts of a tank."""


@dataclass(frozen=True)
class Rules:
    """What a deck may hold beside ANY: commands, the names of its files, and whole commands."""

    commands: frozenset[str]
    files: frozenset[str]
    whole: re.Pattern[str]


def _rules(commands: str, files: str, whole: str = r"\0") -> Rules:
    return Rules(ANY | set(commands.split()), frozenset(files.split()), re.compile(whole))


_TANK = _rules(
    "if label reset_timestep unfix velocity write_dump",
    """bed.dat fields.dump forces.dat grains.data settled.dump snapshots.dump surface.dump
    trajectory.dump""",
    rf"include stop\.lmp|jump SELF (settle|drive)|{RESTARTS}|{CONTACTS}",
)

_COLUMN = (
    r"include stop-\d+\.lmp|next piece_\d+"
    rf"|jump SELF (averaged?|(settl|mobilis|averag)ing)_\d+|{RESTARTS}"
)


def _column(whole: str) -> Rules:
    files = "column.data forces.dat profile.dat"
    return _rules("displace_atoms if label unfix velocity", files, whole)


DECKS = {
    "in.tank": _TANK,
    "in.tank-settle": _TANK,
    "in.tank-drive": _TANK,
    "in.janssen": _column(_COLUMN),
    "in.janssen-drive": _column(rf"{_COLUMN}|include from\.lmp|jump SELF \$\{{phase\}}"),
    "from.lmp": _rules("", ""),
    "in.drag2d": _rules("dimension", "clumps.data forces.dat grains.data snapshots.dump"),
    "in.bodies": _rules("", "bodies.data motion.dump"),
}
"""The decks by their names. A run in pieces ends after one where a file of liftdrag's says so."""

_WORD = r"\"[^\"]*\"|'[^']*'|[^\s\"']+"
_LINE = re.compile(rf"\s*(?:(?:{_WORD})(?:\s+|$))*")
_VALUE = re.compile(r"\$(?!\{[a-z_0-9]+\}|\(step\))")
_NO_NUMBER = re.compile(r"[-+]?(nan|inf)")


def check_commands(text: str, deck: str) -> None:
    """Raise ValueError when a line of the deck of this name holds what is not allowed there."""
    for line in text.split("\n"):
        if not line.isascii() or not line.isprintable() or '"""' in line or line.endswith("&"):
            raise _refusal(line)
        _check(line.split("#")[0], DECKS[deck])


def _check(command: str, rules: Rules) -> None:
    if not _LINE.fullmatch(command) or _VALUE.search(command):
        raise _refusal(command)
    words = re.findall(_WORD, command)
    if not words or rules.whole.fullmatch(" ".join(words)):
        return
    if words[0] not in rules.commands or not _is_formed(words) or not _is_at_home(words, rules):
        raise _refusal(command)
    if words[0] == "if":
        for part in _consequences(words):
            if part.split(" ")[0] not in IN_IF and not RUN_PIECE.fullmatch(part):
                raise _refusal(part)
            _check(part, Rules(rules.commands | {"quit"}, rules.files, rules.whole))


def _refusal(command: str) -> ValueError:
    return ValueError(f"the deck would run {command.strip()[:60]!r}, which is not allowed")


def _consequences(words: Sequence[str]) -> Iterator[str]:
    """The commands that an `if` would run, without their quotes."""
    if len(words) < 4 or words[2] != "then":
        raise _refusal(" ".join(words))
    for word in words[3:]:
        if word != "else":
            yield word[1:-1] if word[0] in "\"'" else word


def _is_formed(words: Sequence[str]) -> bool:
    """Whether a command is of the style and the form that the templates use, of finite numbers."""
    place, styles = STYLES.get(words[0], (0, {words[0]}))
    if len(words) <= place or words[place] not in styles:
        return False
    if any(_NO_NUMBER.fullmatch(word) for word in words):
        return False
    return words[0] not in SHAPES or bool(SHAPES[words[0]].fullmatch(" ".join(words)))


def _is_at_home(words: Sequence[str], rules: Rules) -> bool:
    """Whether a command reads and writes no files but the deck's."""
    named = FILE_WORDS - {"append"} if words[0] == "dump_modify" else FILE_WORDS
    places = [k + 1 for k, word in enumerate(words) if _bare(word) in named]
    if words[0] in FILE_AT:
        places.append(FILE_AT[words[0]])
    return all(place < len(words) and words[place] in rules.files for place in places)


def _bare(word: str) -> str:
    return word.strip("\"'")
