"""What a bench found of the biases of a case: its own choices against more careful ones."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from liftdrag.errors import InputError
from liftdrag.files import read_bytes

BENCH = "bench.json"

MOST_BYTES = 10_000_000
"""The largest of them."""


@dataclass(frozen=True)
class Bias:
    """The answer of the case less that of a more careful choice, over the careful answer.

    `at` is what the case has on this axis, `against` the more careful value, in SI units.
    """

    relative: float
    standard_error: float
    at: float
    against: float


@dataclass(frozen=True)
class Biases:
    """The biases by quantity and axis of a case, with its tables, on an engine."""

    case: str
    engine: str
    tables: Mapping[str, Any]
    found: Mapping[str, Mapping[str, Bias]]

    def to_dict(self) -> dict[str, Any]:
        """As `bench.json` holds them."""
        found = {
            quantity: {axis: asdict(bias) for axis, bias in axes.items()}
            for quantity, axes in self.found.items()
        }
        tables = dict(self.tables)
        return {"case": self.case, "engine": self.engine, "tables": tables, "biases": found}

    @classmethod
    def from_dict(cls, record: Mapping[str, Any]) -> Biases:
        """From what `to_dict` gives. Raises LookupError or TypeError when it is something else."""
        found = {
            quantity: {axis: Bias(**bias) for axis, bias in axes.items()}
            for quantity, axes in dict(record["biases"]).items()
        }
        return cls(record["case"], record["engine"], dict(record["tables"]), found)


def read_biases(folder: Path) -> Biases:
    """The biases in the folder of a bench. Raises InputError when there are none."""
    path = folder / BENCH
    try:
        return Biases.from_dict(json.loads(read_bytes(path, MOST_BYTES)))
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror}; run liftdrag bench.") from None
    except (ValueError, LookupError, TypeError, AttributeError, RecursionError):
        raise InputError(f"{path} is damaged; run liftdrag bench again.") from None
