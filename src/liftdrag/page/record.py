"""`RunRecord`: what `result.json` says of a run, or `run.json` where there is no result yet."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pydantic import BaseModel, Field, ValidationError

from liftdrag.analysis.quantity import Quantity
from liftdrag.errors import InputError, escaped
from liftdrag.files import is_file
from liftdrag.folder import RECORD, RESULT, read_json

NO_RESULT = "no result"


class Window(BaseModel):
    """The steady part of a series (s)."""

    start_s: float
    end_s: float


class Checked(BaseModel):
    """An invariant: its value and the bound that it must keep."""

    value: float | None
    bound: float | None
    unit: str
    holds: bool


class KnownBias(BaseModel):
    """What a choice of the numerics does to an answer, relative to it."""

    relative: float
    standard_error: float


class Budget(BaseModel):
    """Of one answer: relative standard error, known biases, and what was not measured."""

    statistical: float
    biases: dict[str, KnownBias]
    not_measured: list[str]


class RunRecord(BaseModel):
    """What is known of a run; whatever an older or unfinished run lacks is empty."""

    case: str
    scene: str
    status: str
    tables: dict[str, Any] = Field(default_factory=dict)
    seed: int | None = None
    engine: dict[str, Any] = Field(default_factory=dict)
    steps: int = 0
    grains: int = 0
    wall_s: float = 0.0
    cpu_s: float = 0.0
    grain_steps_per_s: float = 0.0
    packings: int | None = None
    replicas: int | None = None
    stopped_by: str = ""
    quantities: dict[str, Quantity] = Field(default_factory=dict)
    alarms: list[str] = Field(default_factory=list)
    warnings: list[str] = Field(default_factory=list)
    foreseen: list[str] = Field(default_factory=list)
    steady_window: Window | None = None
    invariants: dict[str, Checked] = Field(default_factory=dict)
    error_budget: dict[str, Budget] = Field(default_factory=dict)
    provenance: dict[str, Any] = Field(default_factory=dict)

    @property
    def finished(self) -> bool:
        """Whether it has answers."""
        return self.status == "finished"

    @property
    def reasons(self) -> list[str]:
        """Why it did not finish."""
        if self.finished:
            return []
        return [text for text in self.warnings if text not in (*self.alarms, *self.foreseen)]

    @property
    def remarks(self) -> list[str]:
        """The warnings that are not the reasons."""
        return [text for text in self.warnings if text not in self.reasons]


def is_run(folder: Path) -> bool:
    """Whether a run has begun in a folder."""
    return is_file(folder / RECORD) or is_file(folder / RESULT)


def read_record(folder: Path, begun: str = RECORD) -> RunRecord:
    """The record of a folder, whose case is in the file `begun`. Raises InputError."""
    first = read_json(folder / begun)
    last = read_json(folder / RESULT) if is_file(folder / RESULT) else {}
    tables = first.get("tables")
    scene = tables.get("scene", "unknown") if isinstance(tables, dict) else "unknown"
    known = {
        "status": NO_RESULT,
        "scene": scene,
        "foreseen": first.get("warnings", []),
        "engine": {"name": first.get("engine", "")},
    }
    try:
        return RunRecord.model_validate(first | known | last)
    except ValidationError as error:
        where = ".".join(map(str, error.errors()[0]["loc"]))
        file = RESULT if last else begun
        raise InputError(
            f"{folder / file} is damaged at {escaped(where[:60])}; run the case again."
        ) from None
