"""The force on the intruder summed from dumps of single contacts, one snapshot at a time."""

from __future__ import annotations

import difflib
from collections.abc import Iterator, Sequence
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, NoReturn, TextIO

import numpy as np

from liftdrag.errors import InputError, escaped
from liftdrag.files import check_ordinary

if TYPE_CHECKING:
    import pandas as pd

ROWS_AT_ONCE = 50_000
MOST_DIGITS = 18


class Sum(NamedTuple):
    """The summed force at one step and the number of rows that carry some of it."""

    step: int
    drag: float
    lift: float
    contacts: int


class _Header(NamedTuple):
    step: int
    rows: int
    names: list[str]


class _FileEnds(Exception):
    pass


def read_contact_dump(
    paths: Path | Sequence[Path],
    drag_column: str,
    lift_column: str,
    sign: float = 1.0,
    time_step: float | None = None,
) -> pd.DataFrame:
    """The force on the intruder at each snapshot of `dump local` or `dump custom` text files.

    Every row must be a contact with the intruder (or hold zeros); the columns are named as
    in the dump, such as `f_wall[2]` or `c_fc[1]`. Returns one row a step, in order of steps:
    step, drag and lift (`sign` times the sum of the column, in its own unit), contacts
    (rows with a drag or lift that is not zero) and, given `time_step` in seconds, time (s).

    `sign` = -1 for columns that hold the force on the grain, such as those of `fix wall/gran
    ... contacts`. A step that comes again keeps its last snapshot, and an incomplete last
    snapshot of a file is dropped; the pieces of a dump per processor (`%`) are not joined.
    Raises InputError for a file that is missing, empty, binary or no such dump, an unknown
    column, a bad row, and when there is no complete snapshot.
    """
    files = [paths] if isinstance(paths, Path) else list(paths)
    last = {shot.step: shot for file in files for shot in snapshots(file, drag_column, lift_column)}
    if not last:
        raise InputError(
            f"{', '.join(map(str, files)) or 'contact dump'}: no complete snapshot; "
            "give a dump file that the simulation has finished writing."
        )
    return _frame([last[step] for step in sorted(last)], sign, time_step)


def snapshots(path: Path, drag_column: str, lift_column: str) -> Iterator[Sum]:
    """The complete snapshots of one file in its own order, read as a stream.

    Raises InputError as `read_contact_dump` does.
    """
    try:
        check_ordinary(path)
        with path.open(encoding="utf-8", errors="replace") as handle:
            _check_is_dump(path, handle.read(4096))
            handle.seek(0)
            yield from _Dump(path, handle, (drag_column, lift_column)).snapshots()
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        name = escaped(str(path))
        raise InputError(f"{name}: {reason}; give the path of a readable dump file.") from error


def _check_is_dump(path: Path, start: str) -> None:
    if not start:
        raise InputError(f"{path}: the file is empty; check that the simulation wrote to it.")
    if "\0" in start:
        raise InputError(f"{path}: the file is binary; give a dump in text form.")
    if not start.startswith("ITEM:"):
        raise InputError(f"{path}: no `ITEM:` line at the start; give a text dump of contacts.")


def _frame(shots: Sequence[Sum], sign: float, time_step: float | None) -> pd.DataFrame:
    import pandas as pd

    frame = pd.DataFrame(shots, columns=Sum._fields)
    frame[["drag", "lift"]] = frame[["drag", "lift"]] * sign + 0.0
    if time_step is not None:
        frame["time"] = frame["step"] * time_step
    return frame


class _Dump:
    """An open dump file, read line by line; a line counts once its newline is on disk."""

    def __init__(self, path: Path, handle: TextIO, columns: tuple[str, str]):
        self.path, self.handle, self.columns = path, handle, columns
        self.number = 0

    def snapshots(self) -> Iterator[Sum]:
        while True:
            try:
                shot = self.snapshot()
            except _FileEnds:
                return
            yield shot

    def snapshot(self) -> Sum:
        """The next snapshot. Raises _FileEnds when the file ends before it does."""
        header = self.header()
        picks = [self.position(header.names, name) for name in self.columns]
        total, contacts = np.zeros(2), 0
        for start in range(0, header.rows, ROWS_AT_ONCE):
            lines = self.lines(min(ROWS_AT_ONCE, header.rows - start))
            forces = self.forces(lines, len(header.names), picks)
            total += forces.sum(axis=0)
            contacts += int(np.count_nonzero(forces.any(axis=1)))
        return Sum(header.step, float(total[0]), float(total[1]), contacts)

    def header(self) -> _Header:
        """The lines of a snapshot above its rows, in any order."""
        found: dict[str, int] = {}
        while True:
            item = self.item()
            if item == "TIMESTEP" or item.startswith("NUMBER OF "):
                found[item.split()[0]] = self.integer()
            elif item.startswith("BOX BOUNDS"):
                self.lines(3)
            elif item in ("TIME", "UNITS"):
                self.lines(1)
            elif len(found) == 2:
                return _Header(found["TIMESTEP"], found["NUMBER"], item.split()[1:])
            else:
                self.fail("comes before the time step and the number of rows")

    def item(self) -> str:
        line = self.lines(1)[0].strip()
        if not line.startswith("ITEM: "):
            self.fail("is not the `ITEM:` line that must follow")
        return line.removeprefix("ITEM: ")

    def integer(self) -> int:
        line = self.lines(1)[0].strip()
        if not line.isdecimal() or len(line) > MOST_DIGITS:
            self.fail("is not a whole number")
        return int(line)

    def lines(self, count: int) -> list[str]:
        """The next `count` lines. Raises _FileEnds when there are fewer complete lines."""
        lines = list(islice(self.handle, count))
        self.number += len(lines)
        if len(lines) == count and lines[-1].endswith("\n"):
            return lines
        for line_number, line in enumerate(lines, start=self.number - len(lines) + 1):
            if count > 1 and "ITEM:" in line:
                self.fail("cuts the snapshot above it short", line_number)
        raise _FileEnds

    def forces(self, lines: list[str], width: int, picks: list[int]) -> np.ndarray:
        """The picked columns of some rows, (n, 2)."""
        try:
            forces = _parsed(lines, width, picks)
        except ValueError:
            self.fail_at_bad_row(lines, width, picks)
        return forces

    def fail_at_bad_row(self, lines: list[str], width: int, picks: list[int]) -> NoReturn:
        first = self.number - len(lines) + 1
        for line_number, line in enumerate(lines, start=first):
            try:
                _parsed([line], width, picks)
            except ValueError:
                self.fail(f"is not a row of {width} values with finite forces", line_number)
        raise AssertionError("a block of good rows was refused")

    def position(self, names: list[str], name: str) -> int:
        if name in names:
            return names.index(name)
        close = difflib.get_close_matches(name, names, n=1)
        hint = f", did you mean {close[0]}" if close else ""
        raise InputError(
            f"{self.path}: no column {escaped(name[:60])}{hint}; take one of {', '.join(names)}."
        )

    def fail(self, problem: str, line_number: int | None = None) -> NoReturn:
        raise InputError(
            f"{self.path}: line {line_number or self.number} {problem}; "
            "give a text file of `dump local` or `dump custom` and delete its damaged snapshots."
        )


def _parsed(lines: list[str], width: int, picks: list[int]) -> np.ndarray:
    """Two columns of rows of `width` words, (n, 2). Raises ValueError on other rows."""
    rows = [line.split() for line in lines]
    if any(len(row) != width for row in rows):
        raise ValueError("wrong number of columns")
    forces = np.array([[float(row[pick]) for pick in picks] for row in rows])
    if not np.isfinite(forces).all():
        raise ValueError("a force is not finite")
    return forces
