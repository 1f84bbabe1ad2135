"""Profiles of a column, as LAMMPS' `fix ave/chunk` and LIGGGHTS' `fix ave/spatial` write them.

Both write blocks: a row with the step and the number of slices, and then a row for each slice
with its number, the height of its middle, the grains in it, and averages over these grains.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import islice
from pathlib import Path
from typing import TextIO

import numpy as np

from liftdrag.files import check_ordinary, whole_lines
from liftdrag.profile import Profile

PROFILES = "profile.dat"

SUMS = {
    "virial": "v_virial",
    "wall_normal": "v_normal",
    "wall_shear": "v_shear",
    "wall_contacts": "v_touches",
    "mobilisation": "v_mobilisation",
    "sliding": "v_sliding",
    "spin": "v_spin",
}
"""The sums of a `Profile`, and the columns of the averages that they come from."""

_HEIGHT, _COUNT = 1, 2


def read_profiles(path: Path, time_step: float) -> Iterator[Profile]:
    """The complete blocks of a file; none when it does not exist. A step takes `time_step` (s).

    Raises ValueError when a block before the last line is damaged, or comes before the last one.
    """
    if not path.exists():
        return
    check_ordinary(path)
    last = -1
    with path.open() as file:
        for step, names, rows in _blocks(file, path):
            if step <= last:
                raise ValueError(f"{path}: step {step} comes after step {last}")
            last = step
            yield _profile(step * time_step, names, _table(rows, len(names), path))


def _blocks(file: TextIO, path: Path) -> Iterator[tuple[int, list[str], list[str]]]:
    """The step, the names of the columns and the rows of each block that is complete."""
    names = list[str]()
    lines = whole_lines(file)
    for line in lines:
        if line.startswith("#"):
            names = line.split()[1:]
            continue
        step, count = _head(line, path)
        _check_names(names, path)
        rows = list(islice(lines, count))
        if len(rows) < count:
            return
        yield step, names, rows


def _head(line: str, path: Path) -> tuple[int, int]:
    words = line.split()
    if len(words) not in (2, 3) or not all(word.isdecimal() for word in words[:2]):
        raise ValueError(f"{path}: {line.strip()[:60]!r} is not the head of a block of slices.")
    return int(words[0]), int(words[1])


def _check_names(names: Sequence[str], path: Path) -> None:
    missing = sorted(set(SUMS.values()) - set(names))
    if missing or names[_COUNT] != "Ncount":
        raise ValueError(f"{path}: the header names no {', '.join(missing) or 'Ncount'}.")


def _table(rows: Sequence[str], width: int, path: Path) -> np.ndarray:
    try:
        table = np.array([row.split() for row in rows], float).reshape(len(rows), width)
        if np.isfinite(table).all():
            return table
    except ValueError:
        pass
    raise ValueError(
        f"{path}: a block near {rows[0].strip()[:60]!r} has no rows of {width} numbers."
    )


def _profile(time: float, names: Sequence[str], table: np.ndarray) -> Profile:
    """The averages times the grains that they are over."""
    count = table[:, _COUNT]
    sums = {name: count * table[:, names.index(column)] for name, column in SUMS.items()}
    return Profile(time=time, height=table[:, _HEIGHT], count=count, **sums)
