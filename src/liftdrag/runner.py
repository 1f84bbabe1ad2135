"""One run, from a case to its result."""

from __future__ import annotations

import os
import platform
import time
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib import metadata
from math import isfinite
from pathlib import Path
from typing import Any

import liftdrag
from liftdrag import pictures
from liftdrag.analysis.quantity import Quantity
from liftdrag.analysis.steady import SteadyWindow
from liftdrag.analysis.tank import Answers, answers
from liftdrag.case import Case
from liftdrag.deck import Deck
from liftdrag.deck.dialect import LAMMPS, Dialect
from liftdrag.deck.tank import build, contact_of
from liftdrag.engines import engine as engine_called
from liftdrag.engines.base import Engine, Outcome, Progress, silent
from liftdrag.engines.known import probed
from liftdrag.engines.probes import TANK, Probe, Subject, check_names
from liftdrag.errors import InputError, RunFailed
from liftdrag.folder import RESULT, Record, fresh, read_json, write_json
from liftdrag.numerics import Numerics, derive, explained
from liftdrag.scene import TankScene
from liftdrag.series import Series

MAX_RANKS = 4096
_PACKAGES = ("lammps", "mpich", "numpy", "scipy", "pandas", "jinja2", "pydantic")


@dataclass(frozen=True)
class Result:
    """What a run answered: `record` is `result.json`, the rest what it was made from."""

    folder: Path
    record: Mapping[str, Any]
    quantities: Mapping[str, Quantity]
    window: SteadyWindow
    series: Series

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


def prepare(
    case: Case, ranks: int = 1, dump: bool = False, dialect: Dialect = LAMMPS
) -> tuple[Numerics, Deck]:
    """The numerics and the deck of a case. Raises InputError for a bad case or too many ranks."""
    _check_ranks(ranks)
    numerics = derive(case.scene, ranks)
    version = liftdrag.__version__
    return numerics, build(case.scene, numerics, case.name, version, ranks, dump, dialect)


def _check_ranks(ranks: int) -> None:
    if not 1 <= ranks <= MAX_RANKS:
        raise InputError(f"--ranks {ranks} is not between 1 and {MAX_RANKS}.")


def write_deck(
    case: Case,
    numerics: Numerics,
    deck: Deck,
    engine: str,
    folder: Path,
    probes: Sequence[Probe] = (),
    alarms: Sequence[str] = (),
) -> Record:
    """Write the deck, the numerics with their reasons, and the record that reading needs."""
    deck.write(folder)
    (folder / "numerics.txt").write_text(explained(numerics), "utf-8")
    provenance = _provenance(deck) | {"probes": [found.to_dict() for found in probes]}
    warnings = list(numerics.warnings)
    record = Record(
        case.name, dict(case.tables), engine, deck.plan, warnings, provenance, list(alarms)
    )
    record.write(folder)
    return record


def _probed(engine: Engine, scene: TankScene, ranks: int) -> list[Probe]:
    """What the probes that the scene needs find of the engine, with the scene's grains."""
    subject = Subject(contact_of(scene), scene.grains.density)
    return probed(engine, subject, TANK if ranks == 1 else (*TANK, "ranks"))


def _alarms(engine: Engine, probes: Sequence[Probe], ignored: Sequence[str]) -> list[str]:
    """A warning for each failure that is ignored. Raises InputError for one that is not."""
    failed = [found for found in probes if not found.passed]
    for found in failed:
        if found.name not in ignored:
            raise InputError(
                f"The engine {engine.name} fails the probe {found.name} ({found.finding}); choose "
                f"another engine, or run at your own risk with --ignore-probe {found.name}."
            )
    return [
        f"THE ENGINE IS WRONG: {engine.name} fails the probe {found.name} ({found.finding}), "
        "which was ignored."
        for found in failed
    ]


def run(
    case: Case,
    out: str | Path | None = None,
    engine: str = "lammps",
    ranks: int = 1,
    dump: bool = False,
    progress: Progress = silent,
    engine_path: str | Path | None = None,
    ignore_probes: Sequence[str] = (),
) -> Result:
    """Run a case in the folder `out` and answer with averages and standard errors.

    Under `mpirun` the job's ranks are used. The folder keeps the deck, the series,
    the pictures and `result.json`, and with `dump` a trajectory; by default it is
    a new one below `runs/`. The engine is probed first, with the grains of the case;
    a probe of `ignore_probes` may fail. Raises InputError before the run is started,
    RunFailed when the engine does not finish; the folder then says why.
    """
    chosen = engine_called(engine, None if engine_path is None else Path(engine_path))
    world = chosen.world()
    case.scene  # noqa: B018 - every rank refuses a bad case by itself
    check_names(tuple(ignore_probes))
    if world.rank > 0:
        chosen.join()
    try:
        _check_ranks(ranks)
        chosen.check(ranks)
        ranks = world.size if world.size > 1 else ranks
        found = _probed(chosen, case.scene, ranks if world.size == 1 else 1)
        alarms = _alarms(chosen, found, ignore_probes)
        numerics, deck = prepare(case, ranks, dump, chosen.dialect)
        folder = fresh(out, case.name)
        record = write_deck(case, numerics, deck, engine, folder, found, alarms)
    except BaseException:
        chosen.release()
        raise
    return _conclude(folder, case, record, *_timed(chosen, record, folder, progress))


def analyze(folder: Path) -> Result:
    """The answers of a finished run again, from the series in its folder."""
    old, record = read_json(folder / RESULT), Record.read(folder)
    status = old.get("status", "unknown")
    if status != "finished":
        raise InputError(f"The run in {folder} did not finish ({status}); run the case again.")
    return _answered(folder, Case(record.case, record.tables), record, old)


def _timed(
    chosen: Engine, record: Record, folder: Path, progress: Progress
) -> tuple[Outcome, float]:
    start = time.monotonic()
    try:
        outcome = chosen.run(record.plan, folder, progress)
    except KeyboardInterrupt:
        failure = RunFailed("killed", f"The run in {folder} was interrupted.")
    except RunFailed as error:
        failure = error
    else:
        return outcome, time.monotonic() - start
    write_json(folder / RESULT, _result(record, failure.status, [failure.reason]))
    raise failure from None


def _conclude(folder: Path, case: Case, record: Record, outcome: Outcome, wall_s: float) -> Result:
    finished = outcome.status == "finished"
    reasons = [] if finished else [outcome.reason]
    result = _result(record, outcome.status, reasons) | _cost(outcome, wall_s)
    result["engine"] |= {
        "version": outcome.version,
        "path": str(outcome.path),
        "ranks": outcome.ranks,
    }
    write_json(folder / RESULT, result)
    if not finished:
        raise RunFailed(outcome.status, f"{outcome.status}: {outcome.reason}.", outcome.evidence)
    return _answered(folder, case, record, result)


def _answered(folder: Path, case: Case, record: Record, result: dict[str, Any]) -> Result:
    """The answers from the files in the folder, written to `result.json` and as pictures."""
    series, found = _read(folder, case.scene, record)
    result = result | _reported(found, record, series)
    try:
        series.to_pandas().to_csv(folder / "series.csv")
        write_json(folder / RESULT, result)
        _draw(folder, case.scene, record, series, found)
    except (OSError, RunFailed) as error:
        result["warnings"] = [f"Nothing was written to {folder}: {error}", *result["warnings"]]
    return Result(folder, result, found.quantities, found.window, series)


def _draw(folder: Path, scene: TankScene, record: Record, series: Series, found: Answers) -> None:
    pictures.draw_forces(scene, series, found, folder / "forces.png")
    for last in deque(engine_called(record.engine).snapshots(record.plan, folder), maxlen=1):
        pictures.draw_bed(scene, last, folder / "bed.png")


def _read(folder: Path, scene: TankScene, record: Record) -> tuple[Series, Answers]:
    """The series and the answers. Raises InputError when the engine's files are damaged."""
    chosen = engine_called(record.engine)
    try:
        series = chosen.series(record.plan, folder)
        return series, answers(scene, series, list(chosen.surfaces(record.plan, folder)))
    except InputError:
        raise
    except (OSError, ValueError, LookupError) as error:
        raise InputError(
            f"The files in {folder} are damaged ({error}); run the case again."
        ) from error


def _reported(found: Answers, record: Record, series: Series) -> dict[str, Any]:
    window = found.window
    return {
        "quantities": {name: value.to_dict() for name, value in found.quantities.items()},
        "warnings": [*record.alarms, *found.warnings, *record.warnings],
        "steady_window": {
            "start_s": float(series.time[window.start]),
            "end_s": float(series.time[window.stop - 1]),
            "drift": window.drift if isfinite(window.drift) else None,
            "steady": window.steady,
        },
    }


def _result(record: Record, status: str, reasons: list[str]) -> dict[str, Any]:
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
        "quantities": {},
        "stopped_by": "distance" if status == "finished" else status,
        "alarms": record.alarms,
        "warnings": [*record.alarms, *reasons, *record.warnings],
        "provenance": record.provenance,
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
