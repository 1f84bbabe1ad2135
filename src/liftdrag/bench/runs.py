"""The runs of a bench, each in a folder of its own that is read again the next time."""

from __future__ import annotations

import shutil
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field, fields
from math import isfinite
from pathlib import Path
from typing import Any

from liftdrag.analysis.quantity import Quantity
from liftdrag.bench.points import Point, Task
from liftdrag.engines.base import Progress
from liftdrag.ensemble import PACKINGS, each_of
from liftdrag.errors import InputError, RunFailed
from liftdrag.folder import RECORD, RESULT, read_json
from liftdrag.runner import run


@dataclass(frozen=True)
class Stand:
    """Where a bench runs, on which engine, and what it judges."""

    folder: Path
    engine: str
    version: str
    path: Path | None
    judged: tuple[str, ...]


@dataclass(frozen=True)
class Run:
    """One run of a point: how it ended, what it took, and what it answered of what is judged.

    `each` has the answers of each packing of an ensemble; those of the same replica begin alike.
    """

    axis: str
    name: str
    replica: int
    status: str
    reason: str = ""
    cpu_s: float = 0.0
    wall_s: float = 0.0
    grain_steps: float = 0.0
    grain_steps_per_s: float = 0.0
    answers: Mapping[str, Quantity] | None = None
    each: Mapping[str, tuple[float, ...]] = field(default_factory=dict)

    @property
    def key(self) -> tuple[str, str]:
        """The point that it is of."""
        return self.axis, self.name

    @property
    def finished(self) -> bool:
        """Whether it has answers."""
        return self.answers is not None

    def to_dict(self) -> dict[str, Any]:
        """As `bench.json` holds it."""
        return asdict(self)


def folder_of(stand: Stand, task: Task) -> Path:
    """Where a run of a bench is."""
    return stand.folder / task.point.axis / task.point.name / f"run-{task.replica}"


def carried_out(task: Task, stand: Stand, progress: Progress) -> Run:
    """The run of a task; what an earlier one that did not finish left is removed.

    A failure is a result too.
    """
    folder, point = folder_of(stand, task), task.point
    shutil.rmtree(folder, ignore_errors=True)
    try:
        run(task.case, folder, stand.engine, point.ranks, False, progress, stand.path)
    except RunFailed as failure:
        return Run(*point.key, task.replica, failure.status, failure.reason)
    except InputError as refusal:
        return Run(*point.key, task.replica, "refused", str(refusal))
    return read(task, stand)


def warm_up(task: Task, stand: Stand, halted: threading.Event) -> None:
    """Begin the run of a task and leave it, so that it finds the in-house engine compiled."""

    def look(_stage: str, done: int, _total: int) -> None:
        if done or halted.is_set():
            raise RunFailed("killed", "the engine is warm")

    folder = stand.folder / "warm-up"
    shutil.rmtree(folder, ignore_errors=True)
    with suppress(InputError, RunFailed):
        run(task.case, folder, stand.engine, task.point.ranks, False, look, stand.path)
    shutil.rmtree(folder, ignore_errors=True)


def earlier(points: Sequence[Point], stand: Stand) -> list[Run]:
    """The runs of these points that finished in the folder before."""
    return [found for point in points for found in _finished(point, stand)]


def _finished(point: Point, stand: Stand) -> Iterator[Run]:
    replica = 1
    while found := _earlier(Task(point, replica), stand):
        yield found
        replica += 1


def _earlier(task: Task, stand: Stand) -> Run | None:
    """The finished run of a task; a damaged one is made again."""
    with suppress(LookupError, TypeError, ValueError, AttributeError):
        return read(task, stand) if _is_finished(task, stand) else None
    return None


def _is_finished(task: Task, stand: Stand) -> bool:
    folder = folder_of(stand, task)
    try:
        record, result = read_json(folder / RECORD), read_json(folder / RESULT)
    except InputError:
        return False
    same = record.get("tables") == dict(task.case.tables)
    done = result.get("status") == "finished" and bool(result.get("quantities"))
    return same and done and result["engine"]["version"] == stand.version


def read(task: Task, stand: Stand) -> Run:
    """The run in its folder. One without an answer that can be judged has failed."""
    result, point = read_json(folder_of(stand, task) / RESULT), task.point
    given = result["quantities"]
    answers = {name: _quantity(given[name]) for name in stand.judged if name in given}
    missing = [name for name in stand.judged if not _is_known(answers.get(name))]
    grows = point.case.tables["scene"] == "janssen"
    return Run(
        *point.key,
        task.replica,
        "no_answer" if missing else result["status"],
        f"it has no {' and no '.join(missing)}" if missing else "",
        result["cpu_s"],
        result["wall_s"],
        point.work if grows else float(result["grains"] * result["steps"]),
        result["grain_steps_per_s"],
        None if missing else answers,
        {} if missing else dict(_each(folder_of(stand, task), answers)),
    )


def _each(folder: Path, answers: Mapping[str, Quantity]) -> Iterator[tuple[str, tuple[float, ...]]]:
    """By quantity what each packing answered; none where the run is no ensemble."""
    if (folder / PACKINGS).exists():
        for name, answer in answers.items():
            yield name, tuple(each_of(folder, name, answer.unit))


def _quantity(given: Mapping[str, Any]) -> Quantity:
    return Quantity(**{one.name: given[one.name] for one in fields(Quantity)})


def _is_known(answer: Quantity | None) -> bool:
    if answer is None or not isfinite(answer.mean) or not isfinite(answer.standard_error):
        return False
    return answer.mean != 0.0
