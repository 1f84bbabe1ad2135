"""The engines by name."""

from __future__ import annotations

import difflib

from liftdrag.engines.base import Engine
from liftdrag.engines.lammps import Lammps
from liftdrag.errors import InputError

ENGINES: dict[str, Engine] = {"lammps": Lammps()}


def engine(name: str) -> Engine:
    """The engine called `name`. Raises InputError when there is none."""
    if name not in ENGINES:
        close = difflib.get_close_matches(name, ENGINES, n=1)
        hint = f"did you mean {close[0]!r}" if close else f"choose one of {', '.join(ENGINES)}"
        raise InputError(f"There is no engine {name!r}; {hint}.")
    return ENGINES[name]
