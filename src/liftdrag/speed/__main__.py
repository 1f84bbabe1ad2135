"""The measurements by name: each side by side and by turns, the best of several rounds."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence

from liftdrag.engines import engine
from liftdrag.errors import InputError
from liftdrag.speed.columns import columns
from liftdrag.speed.growth import growth
from liftdrag.speed.lammps import against_lammps
from liftdrag.speed.shapes import against_discs
from liftdrag.speed.sizes import sizes
from liftdrag.speed.skips import skips

MEASURES: dict[str, Callable[[], Iterator[str]]] = {
    "lammps": against_lammps,
    "shapes": against_discs,
    "sizes": sizes,
    "columns": columns,
    "growth": growth,
    "skips": skips,
}
"""The measurements by name."""


def main(names: Sequence[str]) -> int:
    """Print the measurements of these names, by default all, as they are made; the exit status."""
    try:
        _check(names)
        engine("lammps").check(2)
    except InputError as error:
        print(error, file=sys.stderr)
        return 2
    for name in names or MEASURES:
        print(MEASURES[name].__doc__)
        for line in MEASURES[name]():
            print(f"  {line}", flush=True)
    return 0


def _check(names: Sequence[str]) -> None:
    for name in names:
        if name not in MEASURES:
            raise InputError(
                f"There is no measurement {name!r}; choose from {', '.join(MEASURES)}."
            )


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
