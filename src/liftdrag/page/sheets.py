"""What a run's folder says, as sheets: tables of text with a caption."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from liftdrag.analysis.meanings import MEANINGS
from liftdrag.analysis.quantity import Quantity, rounded
from liftdrag.files import read_bytes
from liftdrag.page.comparison import Compared
from liftdrag.page.record import RunRecord

MOST_BYTES = 2_000_000
"""The largest file that becomes a sheet."""

MOST_ROWS = 200

_NUMERICS = re.compile(r"(\S+)\s+(\S+(?: x \S+)*)\s+(\S+)\s+(\S.*)")


@dataclass(frozen=True)
class Sheet:
    """A table: its `caption`, the `headings` of its columns, and its `rows` of cells."""

    caption: str
    headings: Sequence[str]
    rows: Sequence[Sequence[str]]


def words(name: str) -> str:
    """A name of the code as words."""
    return name.replace("_", " ")


def with_error(quantity: Quantity) -> str:
    """The mean, its error and the unit."""
    unit = "" if quantity.unit == "1" else f" {quantity.unit}"
    return " ± ".join(rounded(quantity.mean, quantity.standard_error)) + unit


def answers(found: Mapping[str, Quantity]) -> Sheet:
    """Each quantity: mean, error, unit, 95 % interval, independent samples, meaning."""
    return Sheet(
        "Answers: means over the steady part, with their standard errors",
        ("quantity", "mean ± standard error", "unit", "95 % interval", "samples", "meaning"),
        [tuple(_answer(name, quantity)) for name, quantity in found.items()],
    )


def _answer(name: str, found: Quantity) -> Iterator[str]:
    share = abs(found.standard_error / found.mean) if found.mean else float("inf")
    low, high = found.interval_95
    yield words(name)
    yield " ± ".join(rounded(found.mean, found.standard_error)) + (
        f" ({100 * share:.2g} %)" if share < 10 else ""
    )
    yield "-" if found.unit == "1" else found.unit
    yield f"{low:.4g} to {high:.4g}"
    count = "-" if found.n_independent is None else f"{found.n_independent:.0f}"
    yield count + ("" if found.converged else ", not converged")
    yield MEANINGS.get(name, "")


def comparison(rows: Sequence[Compared]) -> Sheet:
    """The run beside the papers."""
    return Sheet(
        "Beside the paper",
        ("quantity", "this run", "the paper", "difference", "source"),
        [(words(r.quantity), r.here, r.there, r.difference, r.source) for r in rows],
    )


def invariants(record: RunRecord) -> Sheet:
    """What must hold in every run, and whether it does."""
    return Sheet(
        "What a sound run keeps within a bound, whatever its answer",
        ("invariant", "value", "bound", "unit", "holds"),
        [
            (
                words(name),
                _number(one.value),
                _number(one.bound),
                "-" if one.unit == "1" else one.unit,
                "yes" if one.holds else "NO",
            )
            for name, one in record.invariants.items()
        ],
    )


def budget(record: RunRecord) -> Sheet:
    """The statistical error of the answers and the biases that are known."""
    return Sheet(
        "Error budget: what the standard error holds, and what it does not",
        ("quantity", "statistical", "measured biases", "not measured"),
        [
            (
                words(name),
                f"{100 * one.statistical:.2g} %",
                ", ".join(
                    f"{words(axis)} {100 * bias.relative:+.1f} ± {100 * bias.standard_error:.1f} %"
                    for axis, bias in one.biases.items()
                )
                or "none",
                ", ".join(map(words, one.not_measured)) or "none",
            )
            for name, one in record.error_budget.items()
        ],
    )


def case(tables: Mapping[str, Any]) -> Sheet:
    """The keys of the case file."""
    return Sheet("The case file", ("key", "value"), list(_keys(tables)))


def _keys(tables: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, str]]:
    for key, value in tables.items():
        if isinstance(value, Mapping):
            yield from _keys(value, f"{prefix}{key}.")
        else:
            yield prefix + key, value if isinstance(value, str) else json.dumps(value)


def numerics(folder: Path) -> Sheet:
    """`numerics.txt`: each derived number and its reason."""
    lines = text(folder / "numerics.txt").splitlines()
    return Sheet(
        "Numbers that liftdrag derived, and why",
        ("number", "value", "unit", "reason"),
        [tuple(_numeric(line)) for line in lines if not line.startswith("WARNING: ")],
    )


def _numeric(line: str) -> Iterator[str]:
    found = _NUMERICS.fullmatch(line)
    if found is None:
        yield from ("", "", "", line)
        return
    name, value, unit, reason = found.groups()
    yield from (words(name), value, "-" if unit == "1" else unit, reason)


def provenance(record: RunRecord, folder: Path) -> Sheet:
    """By what, where, when and how fast."""
    return Sheet(
        "By what, where and when",
        ("what", "value"),
        [(name, value) for name, value in _origins(record, folder) if value],
    )


def _origins(record: RunRecord, folder: Path) -> Iterator[tuple[str, str]]:
    made, engine = record.provenance, record.provenance.get("engine", {})
    yield "folder", str(folder)
    yield "liftdrag", str(made.get("liftdrag", ""))
    yield "engine", " ".join(str(record.engine.get(key, "")) for key in ("name", "version"))
    yield "MPI", str(engine.get("mpi", "")) if isinstance(engine, dict) else ""
    yield "ranks", str(record.engine.get("ranks", ""))
    yield "seed", "" if record.seed is None else str(record.seed)
    yield "started", str(made.get("started", ""))
    yield "machine", str(made.get("machine", ""))
    yield "grains and steps", f"{record.grains} and {record.steps}" if record.steps else ""
    yield "time", f"{record.wall_s:.3g} s on the clock, {record.cpu_s:.3g} s of the cores"
    speed = record.grain_steps_per_s
    yield "speed", f"{speed:.3g} grain-steps per second" if speed else ""
    yield "stopped by", record.stopped_by if record.finished else ""
    yield "SHA-256 of the deck", str(made.get("deck_sha256", ""))
    yield "Python", str(made.get("python", ""))
    packages = made.get("packages", {})
    if isinstance(packages, dict):
        yield "packages", ", ".join(f"{name} {version}" for name, version in packages.items())


def probes(record: RunRecord) -> Sheet:
    """What the engine was asked before it was trusted."""
    found = record.provenance.get("probes", [])
    known = [one for one in found if isinstance(one, dict)] if isinstance(found, list) else []
    return Sheet(
        "Probes that the engine had to pass",
        ("probe", "measured", "expected", "unit", "passed"),
        [
            (
                words(str(one.get("name"))),
                _number(one.get("measured")),
                _number(one.get("expected")),
                str(one.get("unit", "")),
                "yes" if one.get("passed") else f"NO {one.get('failure', '')}",
            )
            for one in known
        ],
    )


def of_csv(path: Path, caption: str) -> Sheet:
    """A small table of a file, its numbers to four digits; without rows where there is none."""
    lines = [line.split(",") for line in text(path).splitlines() if line]
    if len(lines) < 2 or len(lines) > MOST_ROWS:
        return Sheet(caption, (), ())
    return Sheet(caption, lines[0], [[_short(cell) for cell in line] for line in lines[1:]])


def _short(cell: str) -> str:
    try:
        return f"{float(cell):.4g}"
    except ValueError:
        return cell


def _number(value: object) -> str:
    return f"{value:.4g}" if isinstance(value, int | float) else "-"


def text(path: Path) -> str:
    """The text of a file, none where there is no such file, or too large a one."""
    try:
        return read_bytes(path, MOST_BYTES).decode("utf-8", "replace")
    except (OSError, ValueError):
        return ""
