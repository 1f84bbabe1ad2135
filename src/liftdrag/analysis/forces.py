"""Error bars for a user's own forces: a table of drag and lift, or a dump of contacts."""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np

from liftdrag.analysis.errorbars import average
from liftdrag.analysis.quantity import Quantity, shortcomings
from liftdrag.analysis.steady import common_window, steady_window
from liftdrag.contacts import read_contact_dump
from liftdrag.errors import InputError, SeriesTooShort, shown
from liftdrag.series import Series
from liftdrag.tables import FORMS, column, ordered, read_table


@dataclass(frozen=True)
class Columns:
    """Where the forces stand in a file: names or numbers of columns, factor, unit, time."""

    drag: str
    lift: str
    sign: float = 1.0
    unit: str = "N"
    time: str | None = None
    time_step: float | None = None


@dataclass(frozen=True)
class ForceAnswers:
    """Drag and lift over the steady window, `start_s` to `end_s`, and warnings."""

    quantities: dict[str, Quantity]
    start_s: float
    end_s: float
    warnings: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """The answers as JSON, in the manner of `result.json`."""
        return {
            "quantities": {name: value.to_dict() for name, value in self.quantities.items()},
            "steady_window": {"start_s": self.start_s, "end_s": self.end_s},
            "warnings": list(self.warnings),
        }


def read_forces(path: Path, form: str, columns: Columns) -> Series:
    """Drag and lift of a force table (a form of `tables.FORMS`), or of a "contacts" dump.

    Raises InputError when the file or an option does not fit.
    """
    _check_numbers(columns)
    if form == "contacts":
        return _from_contacts(path, columns)
    if form not in FORMS:
        raise InputError(f"--form {form!r} is unknown; choose one of {', '.join(FORMS)}, contacts.")
    time, table = ordered(read_table(path, form), columns.time, columns.time_step)
    with np.errstate(over="ignore"):
        forces = {name: columns.sign * column(table, getattr(columns, name)) for name in _NAMES}
    if not all(np.isfinite(values).all() for values in forces.values()):
        raise InputError(f"--sign {columns.sign} makes the forces infinite; give 1 or -1.")
    return _series(time, forces, columns.unit)


_NAMES = ("drag", "lift")


def _check_numbers(columns: Columns) -> None:
    if not isfinite(columns.sign) or columns.sign == 0.0:
        raise InputError(f"--sign {columns.sign} is not a factor; give 1 or -1.")
    if columns.time_step is not None and not 0.0 < columns.time_step < float("inf"):
        raise InputError(f"--time-step {columns.time_step} is not the length of a step, in s.")
    if not columns.unit.isprintable() or len(columns.unit) > 40:
        raise InputError(f"--unit {shown(columns.unit)} is no unit; write N, or N/m.")


def _from_contacts(path: Path, columns: Columns) -> Series:
    if columns.time_step is None:
        raise InputError("A dump counts steps; give the length of a step with --time-step.")
    table = read_contact_dump(path, columns.drag, columns.lift, columns.sign, columns.time_step)
    forces = {name: table[name].to_numpy(float) for name in _NAMES}
    return _series(table["time"].to_numpy(float), forces, columns.unit)


def _series(time: np.ndarray, forces: dict[str, np.ndarray], unit: str) -> Series:
    return Series(time, forces, dict.fromkeys(forces, unit))


def answers(series: Series, discard: float) -> ForceAnswers:
    """Averages from `discard` seconds after the first sample, or from where it is steady.

    Raises InputError when too little is left for an error bar.
    """
    if not (isfinite(discard) and discard >= 0.0):
        raise InputError(f"--discard {discard} is not a time; give seconds, at least zero.")
    start = int(np.searchsorted(series.time, series.time[0] + discard))
    try:
        window = common_window([steady_window(series[name], start) for name in _NAMES])
        kept = slice(window.start, window.stop)
        quantities = {
            name: Quantity.of(average(series[name][kept], series.interval), series.units[name])
            for name in _NAMES
        }
    except SeriesTooShort as error:
        mean = "" if error.estimate is None else f" (the plain mean is {error.estimate:.6g})"
        raise InputError(f"No error bar can be given: {error}{mean}.") from None
    return ForceAnswers(
        quantities,
        float(series.time[window.start]),
        float(series.time[window.stop - 1]),
        tuple(shortcomings(quantities, window)),
    )
