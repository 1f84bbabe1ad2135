"""What a sweep leaves in its folder: tables, pictures, and below `runs` a folder a run."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from liftdrag.analysis.quantity import rounded
from liftdrag.files import is_file
from liftdrag.folder import RECORD
from liftdrag.page.record import RunRecord, is_run, read_record
from liftdrag.page.sheets import Sheet, text, words
from liftdrag.replicas import CASE, is_replicas

POINTS, RUNS, CLAIMS, SATURATIONS = "points.csv", "runs.csv", "claims.csv", "saturations.csv"

BELOW = "runs"
"""The folder of a study's own runs."""


def is_study(folder: Path) -> bool:
    """Whether a folder holds a study, or folders of runs."""
    return is_file(folder / RUNS) or is_file(folder / CLAIMS) or bool(runs_in(folder))


def runs_in(folder: Path) -> dict[str, RunRecord]:
    """The records of the runs in the folders of a folder, or of a study's own, by their names."""
    kinds = {RECORD: is_run, CASE: is_replicas}
    place = folder / BELOW if (folder / BELOW).is_dir() else folder
    return {
        place.name: read_record(place, begun)
        for place in sorted(place.iterdir())
        for begun, holds in kinds.items()
        if holds(place)
    }


def study_sheets(folder: Path) -> Iterator[Sheet]:
    """Claims, plateaus, and every quantity of points and runs; no rows where a file is absent."""
    claims = _rows(folder / CLAIMS)
    yield Sheet(
        "Claims, weighed by the runs",
        ("claim", "difference", "p-value", "verdict"),
        [(_cell(row, "claim"), _difference(row), _p(row), _cell(row, "verdict")) for row in claims],
    )
    plateaus = _rows(folder / SATURATIONS)
    yield Sheet(
        "Where it saturates",
        ("of", "quantity", "plateau", "90 % of it at", "finished points"),
        [
            (
                _cell(row, "says"),
                words(_cell(row, "quantity")),
                _with_error(row.get("plateau"), row.get("plateau_error"), None),
                _with_error(row.get("depth"), row.get("depth_error"), None),
                _of_all(row, "points"),
            )
            for row in plateaus
            if row.get("saturates") == "True"
        ],
    )
    yield _quantities("point", [row | {"point": _marked(row)} for row in _rows(folder / POINTS)])
    yield _quantities("run", _rows(folder / RUNS))


def unfinished_in(folder: Path) -> list[str]:
    """The runs that a study still lacks, by its table."""
    rows = _rows(folder / RUNS)
    return list(
        dict.fromkeys(row["run"] for row in rows if row.get("status", "finished") != "finished")
    )


def _rows(path: Path) -> list[dict[str, str]]:
    return list(csv.DictReader(text(path).splitlines()))


def _cell(row: Mapping[str, str], name: str) -> str:
    return row.get(name) or "-"


def _of_all(row: Mapping[str, str], name: str) -> str:
    """How many of all have finished, where the table says so."""
    return f"{row['finished']} of {row[name]}" if row.get("finished") and row.get(name) else "-"


def _marked(row: Mapping[str, str]) -> str:
    """The point, and how many of its replicas have finished where that is not all."""
    point, done, many = (row.get(name) or "" for name in ("point", "finished", "replicas"))
    return point if done in ("", many) else f"{point} ({_of_all(row, 'replicas')} replicas)"


def _difference(row: Mapping[str, str]) -> str:
    return _with_error(row.get("size"), row.get("standard_error"), row.get("unit"))


def _p(row: Mapping[str, str]) -> str:
    try:
        return f"{float(row['p_value']):.2g}"
    except (LookupError, TypeError, ValueError):
        return "-"


def _with_error(mean: str | None, error: str | None, unit: str | None) -> str:
    try:
        size = " ± ".join(rounded(float(mean or ""), float(error or "")))
    except ValueError:
        return "-"
    return size if unit in (None, "", "1") else f"{size} {unit}"


def _quantities(kind: str, rows: Sequence[Mapping[str, str]]) -> Sheet:
    """A row for each of a kind, and a column for each quantity."""
    known = [row for row in rows if row.get(kind) and row.get("quantity")]
    names = list(dict.fromkeys(row["quantity"] for row in known))
    cells = {
        (row[kind], row["quantity"]): _with_error(
            row.get("mean"), row.get("standard_error"), row.get("unit")
        )
        for row in known
    }
    return Sheet(
        f"Every quantity of every {kind}",
        (kind, *map(words, names)),
        [
            (run, *(cells.get((run, name), "-") for name in names))
            for run in dict.fromkeys(row[kind] for row in known)
        ],
    )
