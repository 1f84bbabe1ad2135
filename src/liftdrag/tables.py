"""Force tables written by LAMMPS, LIGGGHTS or a spreadsheet, read into pandas.

A line counts only once its newline is on disk: an unterminated last line may be
cut in the middle of a number, so it is dropped rather than believed.
"""

from __future__ import annotations

import csv
import difflib
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from liftdrag.errors import InputError, escaped
from liftdrag.files import read_bytes

if TYPE_CHECKING:
    import pandas as pd

MOST_BYTES = 300_000_000
"""The largest table."""

FORMS = ("auto", "ave-time", "thermo", "print", "csv")
MOST_DIGITS = 9
"""Digits of a column's number."""

TIME_NAMES = ("time", "t", "time (s)", "time_s", "time[s]")
STEP_NAMES = ("step", "timestep")
DEFAULT_TITLES = ("Fix print output for fix ", "Time-averaged data for fix ")


class _Line(NamedTuple):
    number: int
    text: str


class _Row(NamedTuple):
    number: int
    words: list[str]


class _Table(NamedTuple):
    names: list[str]
    rows: list[_Row]


def read_table(path: Path, form: str = "auto") -> pd.DataFrame:
    """The numbers of a text table: float64, one row a sample, columns named as in the file.

    `form` is one of `FORMS`. "auto" takes, in this order: "thermo" when a line without
    commas begins with the word `Step`; "ave-time" when the first word after a `#` is
    `TimeStep`; "csv" when the first line without `#` has a comma and is not all numbers;
    otherwise "print".

    Columns without a header are c1, c2, .... From a log with several runs come those runs
    that print the same columns as the last one. A row cut off at the end is dropped.
    Raises InputError when the file is missing, empty, binary, has no numeric row, changes
    its columns half-way, or has a bad row in the middle.
    """
    if form not in FORMS:
        raise InputError(f"form {form!r} is unknown; take one of {', '.join(FORMS)}.")
    lines = _lines(path)
    chosen = _detect(lines) if form == "auto" else form
    return _frame(path, _READERS[chosen](path, lines))


def column(frame: pd.DataFrame, name: str) -> np.ndarray:
    """The column `name` of a table, (n,) float64.

    `name` is the exact name, the name without or with its LAMMPS prefix (`drag` for
    `v_drag`, or the reverse), or a number counted from 1. Raises InputError when no column
    or more than one fits, and when a value is not finite.
    """
    values: np.ndarray = frame.iloc[:, _position(frame, name)].to_numpy(dtype=float)
    wrong = np.flatnonzero(~np.isfinite(values))
    if wrong.size:
        raise InputError(
            f"column {name}: {wrong.size} of {values.size} values are missing or not finite, "
            f"the first in row {wrong[0] + 1}; remove those rows or take another column."
        )
    return values


def times(
    frame: pd.DataFrame, time_column: str | None = None, time_step: float | None = None
) -> np.ndarray:
    """The time of each row in seconds, (n,), in the table's own order.

    Without `time_column`, a column of `TIME_NAMES` is taken, else one of `STEP_NAMES`.
    Steps are multiplied by `time_step` (s); times are taken as they are. Raises InputError
    when there is no such column, or no `time_step` for steps.
    """
    name = time_column or _default_time_column(frame)
    values = column(frame, name)
    if _plain(frame.columns[_position(frame, name)]) not in STEP_NAMES:
        return values
    if time_step is None or not 0.0 < time_step < np.inf:
        raise InputError(
            f"column {name} counts steps; give the length of a step in seconds with --time-step."
        )
    return values * time_step


def ordered(
    frame: pd.DataFrame, time_column: str | None = None, time_step: float | None = None
) -> tuple[np.ndarray, pd.DataFrame]:
    """Strictly increasing times (m,) in seconds and the m rows that belong to them.

    Where the time jumps back, as after a restart, the rows written last stay and the
    earlier rows at the same or a later time go. Raises InputError as `times` does.
    """
    seconds = times(frame, time_column, time_step)
    earliest_after = np.minimum.accumulate(seconds[::-1])[::-1][1:]
    kept = np.append(seconds[:-1] < earliest_after, True)
    return seconds[kept], frame.loc[kept].reset_index(drop=True)


def _lines(path: Path) -> list[_Line]:
    """The complete lines that are not blank, stripped, numbered from 1."""
    complete = _text(path).split("\n")[:-1]
    numbered = (_Line(number, text.strip()) for number, text in enumerate(complete, start=1))
    return [line for line in numbered if line.text]


def _text(path: Path) -> str:
    try:
        raw = read_bytes(path, MOST_BYTES)
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise InputError(
            f"{escaped(str(path))}: {reason}; give the path of a readable text table."
        ) from error
    if not raw:
        raise InputError(f"{path}: the file is empty; check that the simulation wrote to it.")
    if b"\0" in raw:
        raise InputError(f"{path}: the file is binary; give a table of plain UTF-8 text.")
    return raw.decode("utf-8-sig", errors="replace")


def _detect(lines: Sequence[_Line]) -> str:
    """The form of a table from its content, by the rules of `read_table`."""
    if any(_first_word(line.text) == "Step" and "," not in line.text for line in lines):
        return "thermo"
    if any(_is_title(line) and _first_word(_untitled(line.text)) == "TimeStep" for line in lines):
        return "ave-time"
    first = next((line.text for line in lines if not _is_title(line)), "")
    return "csv" if "," in first and not _is_numeric(_blanks_or_commas(first)) else "print"


def _first_word(text: str) -> str:
    return text.split(maxsplit=1)[0] if text else ""


def _is_title(line: _Line) -> bool:
    return line.text.startswith("#")


def _untitled(text: str) -> str:
    return text.lstrip("# \t")


def _read_ave_time(path: Path, lines: Sequence[_Line]) -> _Table:
    if any("Number-of-rows" in line.text for line in lines if _is_title(line)):
        raise InputError(f"{path}: fix ave/time wrote vectors; write scalars with `mode scalar`.")
    table = _read_titled(path, lines, str.split)
    if not any(_is_title(line) for line in lines):
        raise InputError(f"{path}: no header `# TimeStep ...`; read it with the form print.")
    return table


def _read_print(path: Path, lines: Sequence[_Line]) -> _Table:
    return _read_titled(path, lines, _blanks_or_commas)


def _read_csv(path: Path, lines: Sequence[_Line]) -> _Table:
    return _read_titled(path, lines, _cells)


def _blanks_or_commas(text: str) -> list[str]:
    return text.replace(",", " ").split()


def _cells(text: str) -> list[str]:
    """The cells of a CSV line, an empty cell as nan; a line that is no CSV is one cell."""
    try:
        cells = next(csv.reader([text], skipinitialspace=True))
    except csv.Error:
        return [text]
    return [cell.strip() or "nan" for cell in cells]


def _read_titled(path: Path, lines: Sequence[_Line], split: Callable[[str], list[str]]) -> _Table:
    """Rows below titles: `#` lines anywhere and at most one line of words above the rows."""
    titles = [_Row(line.number, split(_untitled(line.text))) for line in lines if _is_title(line)]
    rows = [_Row(line.number, split(line.text)) for line in lines if not _is_title(line)]
    if rows and _is_header(rows[0].words):
        titles.append(rows.pop(0))
    if not rows:
        raise _no_rows(path)
    names = _names(titles, rows[0])
    _check_later_titles(path, titles, names)
    return _Table(names, [row for row in rows if row.words != names])


def _is_header(words: Sequence[str]) -> bool:
    """Words and empty cells (nan) without any number, so that a damaged row is no header."""
    return not any(_is_numeric([word]) for word in words if word != "nan") and set(words) != {"nan"}


def _names(titles: Sequence[_Row], first: _Row) -> list[str]:
    """The words of the last title above the first row if they fit it, else c1, c2, ...."""
    above = max((title for title in titles if title.number < first.number), default=None)
    if above is not None and _names_columns(above.words, len(first.words)):
        return above.words
    return [f"c{number}" for number in range(1, len(first.words) + 1)]


def _names_columns(words: list[str], width: int) -> bool:
    if words[:1] == ["TimeStep"]:
        return True
    return len(words) == width and not " ".join(words).startswith(DEFAULT_TITLES)


def _check_later_titles(path: Path, titles: Sequence[_Row], names: list[str]) -> None:
    """A header that comes again, as after a restart, must name the same columns."""
    for number, words in titles:
        if len(words) > 1 and words[0] == names[0] and words != names:
            raise InputError(
                f"{path}: line {number} names other columns than the first header; "
                "split the file there and analyze the parts."
            )


def _read_thermo(path: Path, lines: Sequence[_Line]) -> _Table:
    """The rows between `Step` headers and `Loop time of`; lines without a step are messages."""
    runs: list[_Table] = []
    inside = False
    for number, text in lines:
        words = text.split()
        if words[0] == "Step":
            runs.append(_Table(words, []))
            inside = True
        elif text.startswith("Loop time of"):
            inside = False
        elif inside and words[0].isdecimal():
            runs[-1].rows.append(_Row(number, words))
    return _joined(path, [run for run in runs if run.rows])


def _joined(path: Path, runs: Sequence[_Table]) -> _Table:
    """The runs with the columns of the last one, without the step that a next run repeats."""
    if not runs:
        raise _no_rows(path)
    names, rows = runs[-1].names, list[_Row]()
    for run in runs:
        if run.names == names:
            repeats = bool(rows) and run.rows[0].words[0] == rows[-1].words[0]
            rows += run.rows[1:] if repeats else run.rows
    return _Table(names, rows)


_READERS: dict[str, Callable[[Path, Sequence[_Line]], _Table]] = {
    "ave-time": _read_ave_time,
    "thermo": _read_thermo,
    "print": _read_print,
    "csv": _read_csv,
}


def _frame(path: Path, table: _Table) -> pd.DataFrame:
    import pandas as pd

    width = len(table.names)
    values = [_numbers(row.words, width) for row in table.rows]
    if values and values[-1] is None and _is_cut(table.rows[-1], width):
        values.pop()
    if None in values:
        raise _bad_row(path, table.rows[values.index(None)], width)
    if not values:
        raise _no_rows(path)
    return pd.DataFrame(np.array(values, dtype=float), columns=table.names)


def _numbers(words: Sequence[str], width: int) -> list[float] | None:
    """The numbers of a row, or None when they are not `width` numbers."""
    if len(words) != width or "_" in "".join(words):
        return None
    try:
        return [float(word) for word in words]
    except ValueError:
        return None


def _is_numeric(words: Sequence[str]) -> bool:
    return _numbers(words, len(words)) is not None


def _is_cut(row: _Row, width: int) -> bool:
    return len(row.words) < width or not _is_numeric(row.words)


def _bad_row(path: Path, row: _Row, width: int) -> InputError:
    return InputError(
        f"{path}: line {row.number} ({' '.join(row.words)[:60]!r}) is not a row of {width} "
        "numbers; correct or delete that line."
    )


def _no_rows(path: Path) -> InputError:
    return InputError(
        f"{path}: no rows of numbers; give a fix ave/time or fix print file, a log with "
        "one-line thermo output, or a CSV table."
    )


def _default_time_column(frame: pd.DataFrame) -> str:
    for wanted in (TIME_NAMES, STEP_NAMES):
        for name in frame.columns:
            if _plain(name) in wanted:
                return str(name)
    raise InputError(
        f"no column holds times or steps; name one with --time-column: {_listed(frame)}."
    )


def _plain(name: str) -> str:
    return _bare(name).lower()


def _bare(name: str) -> str:
    """The name without the prefix of a LAMMPS compute, fix or variable."""
    return re.sub(r"^[cfv]_", "", name)


def _position(frame: pd.DataFrame, name: str) -> int:
    """The index of the only column that `name` fits, in the order of `column`."""
    names = list(frame.columns)
    exact = [i for i, known in enumerate(names) if known == name]
    prefixed = [i for i, known in enumerate(names) if name == _bare(known) or known == _bare(name)]
    found = exact or prefixed or _numbered(name, len(names))
    if not found:
        asked = f"{escaped(name[:60])}{_suggestion(name, names)}"
        raise InputError(f"no column {asked}; take one of {_listed(frame)}.")
    if len(found) > 1:
        raise InputError(f"column {name} is ambiguous; take by number one of {_listed(frame)}.")
    return found[0]


def _numbered(name: str, count: int) -> list[int]:
    number = int(name) if name.isdecimal() and len(name) < MOST_DIGITS else 0
    return [number - 1] if 1 <= number <= count else []


def _suggestion(name: str, names: Sequence[str]) -> str:
    by_plain_name = {_plain(known): known for known in reversed(names)}
    close = difflib.get_close_matches(_plain(name), by_plain_name, n=1)
    return f", did you mean {by_plain_name[close[0]]}" if close else ""


def _listed(frame: pd.DataFrame) -> str:
    return ", ".join(f"{number} {name}" for number, name in enumerate(frame.columns, start=1))
