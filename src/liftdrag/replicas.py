"""Replicas: the same case with several seeds at a time, each on a core of its own, and pooled.

Two ranks share the work of every step and wait for each other; two replicas do not. Each replica
settles a bed and passes the transient, so replicas pay where a run is long against those.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from math import sqrt
from pathlib import Path

from liftdrag.analysis.biases import read_biases
from liftdrag.analysis.precision import hidden_scatter, pooled
from liftdrag.analysis.stopping import missed
from liftdrag.case import Case
from liftdrag.cost import cores
from liftdrag.cost.kind import kind_of
from liftdrag.cost.sharing import share
from liftdrag.engines import mpi
from liftdrag.engines.base import Progress, silent
from liftdrag.errors import InputError
from liftdrag.folder import RESULT, fresh, read_json, write_json
from liftdrag.result import Result, answered, budgeted
from liftdrag.runner import analyze as analyze_one
from liftdrag.runner import engine_for
from liftdrag.runner import run as run_one
from liftdrag.scene import Drag2DScene, TankScene

CASE = "replicas.json"
"""The case that the replicas of a folder belong to."""

MOST = 1000

_log = logging.getLogger("liftdrag")


def run(
    case: Case,
    count: int,
    out: str | Path | None = None,
    engine: str | None = None,
    progress: Progress = silent,
    engine_path: str | Path | None = None,
    ignore_probes: Sequence[str] = (),
    bench: str | Path | None = None,
) -> Result:
    """Run `count` replicas, with seeds from the case's on, as many at a time as there are cores.

    Each has its folder, and stops at sqrt(count) times the errors of the case's stop: pooled they
    reach it. Raises InputError before anything is started, RunFailed when a replica does not
    finish.
    """
    _check(case, count)
    biases = None if bench is None else read_biases(Path(bench))
    folder, halted = fresh(out, case.name), threading.Event()
    write_json(folder / CASE, {"case": case.name, "tables": dict(case.tables)})

    def look(_stage: str, _done: int, _total: int) -> None:
        if halted.is_set():
            raise KeyboardInterrupt

    def one(number: int) -> Result:
        own, place = _replica(case, number, count), _folder(folder, number)
        return run_one(own, place, engine, None, False, look, engine_path, ignore_probes)

    with ThreadPoolExecutor(cores()) as pool:
        try:
            done = list(_shown(pool.map(one, range(count)), count, progress))
        except BaseException:
            halted.set()
            pool.shutdown(cancel_futures=True)
            raise
    return budgeted(_pooled(case, folder, done), case, biases)


@dataclass(frozen=True)
class Spread:
    """A case for its cores: as it stands on `ranks`, or shorter, as so many `replicas`."""

    case: Case
    ranks: int
    replicas: int


def spread(
    case: Case, count: int, engine: str | None = None, engine_path: str | Path | None = None
) -> Spread:
    """The case on so many cores, in the way that is done sooner, which is said to the log.

    A tank is shared by ranks, or run as replicas that together drive as far in the steady flow;
    a piston is shared, and the packings of an ensemble are spread. Raises InputError.
    """
    if not 1 <= count <= cores():
        raise InputError(f"--cores {count} is not between 1 and {cores()}, what this machine has.")
    if mpi.world(program="liftdrag").size > 1:
        raise InputError("Under mpiexec its ranks are used; leave out --cores.")
    if count == 1 or not isinstance(case.scene, TankScene):
        return Spread(case, count, 1)
    chosen = engine_for(case, engine, engine_path)
    found = share(case.scene, kind_of(case.scene, chosen, 1), count)
    _log.info("%s", found)
    if not found.prefers_replicas:
        return Spread(case, count, 1)
    return Spread(case.set("drive.distance", f"{found.diameters!r} D"), 1, count)


def is_replicas(folder: Path) -> bool:
    """Whether a folder holds replicas."""
    return (folder / CASE).exists()


def analyze(folder: Path, bench: str | Path | None = None) -> Result:
    """The pooled answers of finished replicas again."""
    biases = None if bench is None else read_biases(Path(bench))
    places, case = sorted(folder.glob("replica-*")), _case(folder)
    if not places:
        raise InputError(f"{folder} holds no replica that has begun; run the case again.")
    done = [analyze_one(place) for place in places]
    return budgeted(_pooled(case, folder, done), case, biases)


def _case(folder: Path) -> Case:
    """The case of the replicas in a folder. Raises InputError when its record is damaged."""
    whole = read_json(folder / CASE)
    try:
        case = Case(str(whole["case"]), dict(whole["tables"]))
        case.scene  # noqa: B018 - a case that was run is a good one
    except (LookupError, TypeError, ValueError):
        raise InputError(f"{folder / CASE} is damaged; run the case again.") from None
    return case


def _check(case: Case, count: int) -> None:
    if not 1 <= count <= MOST:
        raise InputError(f"--replicas {count} is not between 1 and {MOST}.")
    if isinstance(case.scene, Drag2DScene):
        raise InputError("An ensemble is made of replicas; raise ensemble.runs instead.")
    if mpi.world(program="liftdrag").size > 1:
        raise InputError("Replicas are started by liftdrag itself; start it without mpiexec.")


def _folder(folder: Path, number: int) -> Path:
    return folder / f"replica-{number + 1:03d}"


def _replica(case: Case, number: int, count: int) -> Case:
    """The case with a seed of its own, stopped at an error that pooling brings down."""
    one = case.set("seed", case.scene.seed + number)
    for key in ("relative_error", "absolute_error"):
        given = getattr(case.scene.stop, key, None)
        if given is not None:
            one = one.set(f"stop.{key}", _times(given, sqrt(count)))
    return one


def _times(given: float | dict[str, float], factor: float) -> float | dict[str, float]:
    if isinstance(given, dict):
        return {name: factor * error for name, error in given.items()}
    return factor * given


def _shown(results: Iterable[Result], count: int, progress: Progress) -> Iterator[Result]:
    progress("replicas", 0, count)
    for done, result in enumerate(results, start=1):
        progress("replicas", done, count)
        yield result


def _pooled(case: Case, folder: Path, done: Sequence[Result]) -> Result:
    """One result of all, each with the same weight; their scatter is in the errors."""
    groups = {name: [one.quantities[name] for one in done] for name in done[0].quantities}
    found = {name: pooled(group, hidden_scatter([group])) for name, group in groups.items()}
    records = [one.record for one in done]
    by = {record["stopped_by"] for record in records}
    sentences = dict.fromkeys(text for record in records for text in record["warnings"])
    missing = missed(case.scene.targets, found, "--replicas or the distance")
    record = dict(records[0]) | {
        "replicas": len(done),
        **{key: sum(one[key] for one in records) for key in ("steps", "cpu_s")},
        "wall_s": max(one["wall_s"] for one in records),
        "stopped_by": by.pop() if len(by) == 1 else "distance",
        "warnings": [text for text in sentences if "[stop]" not in text] + missing,
        "seed": case.scene.seed,
        **answered(found),
    }
    record.pop("steady_window", None)
    write_json(folder / RESULT, record)
    return Result(folder, record, found, done[0].series, None, (RESULT,))
