"""The engines by name."""

from __future__ import annotations

import difflib
from functools import cache
from pathlib import Path

from liftdrag.engines.base import Engine
from liftdrag.engines.lammps import Lammps
from liftdrag.engines.program import LIGGGHTS_BINARY, LMP, Program
from liftdrag.errors import InputError

_PROGRAMS = {kind.name: kind for kind in (LMP, LIGGGHTS_BINARY)}

ENGINES = ("lammps", *_PROGRAMS)
"""LAMMPS from its wheel, and the programs of this machine."""

ALL = (*ENGINES, "dem")
"""These, and the in-house engine, which is a part of this package."""


def engine(name: str, path: Path | None = None) -> Engine:
    """The engine called `name`, a program at `path`. Raises InputError when there is none.

    Whether it is installed shows when it is asked for more than its name.
    """
    if name not in ALL:
        close = difflib.get_close_matches(name, ALL, n=1)
        hint = f"did you mean {close[0]!r}" if close else f"choose one of {', '.join(ALL)}"
        raise InputError(f"There is no engine {name!r}; {hint}.")
    if name in _PROGRAMS:
        return _program(name, path)
    if path is not None:
        raise InputError(
            f"The engine {name} is a Python package and has no path; for a program of your own "
            "choose --engine lmp."
        )
    return _in_house() if name == "dem" else _wheel()


def spatial(name: str, path: Path | None = None) -> Engine:
    """The engine called `name`, of those that hold a tank. Raises InputError as above."""
    if name == "dem":
        raise InputError(
            f"The engine dem has beds in the plane and columns in a tube, no tank; choose one of "
            f"{', '.join(ENGINES)}."
        )
    return engine(name, path)


@cache
def _program(name: str, path: Path | None) -> Program:
    return Program(_PROGRAMS[name], path)


@cache
def _wheel() -> Lammps:
    return Lammps()


@cache
def _in_house() -> Engine:
    from liftdrag.engines.dem import InHouse

    return InHouse()
