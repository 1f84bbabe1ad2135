"""The runs of a study as tasks: each known by a digest of what it answers to, whatever its name."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from liftdrag.case import Case
from liftdrag.errors import InputError
from liftdrag.folder import read_json, write_json
from liftdrag.study.points import Point

RUNS, TASKS, BEDS = "runs", "tasks", "beds"
"""The folders of a study: of its runs, of who works at which, and of the settled beds."""

REQUEST, PROGRESS = "task.json", "progress.json"

FINISHED, FAILED, IN_USE = 0, 1, 75
"""Exit statuses of a task's process; the last where another is at the task."""

_DIGITS = 12


@dataclass(frozen=True)
class Task:
    """A case to be run on an engine; `name` is for readers, `digest` tells it from others."""

    name: str
    case: Case
    engine: str

    @property
    def digest(self) -> str:
        """Of the tables of the case and the engine."""
        asked = {"tables": dict(self.case.tables), "engine": self.engine}
        text = json.dumps(asked, sort_keys=True, default=str)
        return hashlib.sha256(text.encode()).hexdigest()[:_DIGITS]


def tasks_of(point: Point) -> list[Task]:
    """A task for each seed of a point."""
    if len(point.cases) == 1:
        return [Task(point.name, point.case, point.engine)]
    return [
        Task(f"{point.name}-seed={case.tables['seed']}", case, point.engine) for case in point.cases
    ]


def distinct(points: Iterable[Point]) -> dict[str, Task]:
    """The tasks of all points by digest: what two points share is run once."""
    found = dict[str, Task]()
    for point in points:
        for task in tasks_of(point):
            found.setdefault(task.digest, task)
    return found


def claim(study: Path, digest: str) -> Path:
    """The folder of a task itself: its request, its lock, how far it is and how it ended."""
    return study / TASKS / digest


def folders(study: Path) -> dict[str, Path]:
    """The folders of the runs of a study by digest."""
    if not (study / RUNS).is_dir():
        return {}
    return {entry.name.rpartition("-")[2]: entry for entry in (study / RUNS).iterdir()}


def folder_of(task: Task, study: Path) -> Path:
    """Where the run of a task is, or will be."""
    return folders(study).get(task.digest, study / RUNS / f"{task.name}-{task.digest}")


def request(task: Task, study: Path) -> Path:
    """The folder of a task in which it is written what to run. Raises RunFailed."""
    folder = claim(study, task.digest)
    try:
        requested(folder)
    except InputError:
        folder.mkdir(parents=True, exist_ok=True)
        asked = {"name": task.name, "case": task.case.name, "tables": dict(task.case.tables)}
        write_json(folder / REQUEST, asked | {"engine": task.engine})
    return folder


def requested(folder: Path) -> Task:
    """The task that is written in its folder. Raises InputError when it is not what it was."""
    found: dict[str, Any] = read_json(folder / REQUEST)
    try:
        case = Case(str(found["case"]), dict(found["tables"]))
        task = Task(str(found["name"]), case, str(found["engine"]))
    except (LookupError, TypeError, ValueError):
        raise InputError(f"{folder / REQUEST} is damaged; remove {folder}.") from None
    if task.digest != folder.name:
        raise InputError(f"{folder / REQUEST} was changed; remove {folder}.")
    return task
