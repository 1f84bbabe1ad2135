"""How far each run of a study is, from the evidence in its folders."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

from liftdrag.analysis.quantity import Quantity
from liftdrag.errors import InputError
from liftdrag.execution import CUT_SHORT
from liftdrag.folder import RECORD, RESULT, read_json
from liftdrag.lock import is_held
from liftdrag.study.tasks import Task, claim, folders

END = "end.json"
"""How a task ended that did not finish, in the folder of the task."""

STATUSES = ("finished", "running", "queued", "failed", "interrupted", "missing")

LEFT = ("failed", "interrupted", "missing")
"""Those of tasks that nobody is at, or will be."""


@dataclass(frozen=True)
class State:
    """What is known of a task: its status, why it is not finished, and where its run is.

    A finished one has `quantities`, and `record`, its result.json.
    """

    status: str
    reason: str = ""
    folder: Path | None = None
    quantities: Mapping[str, Quantity] = field(default_factory=dict)
    record: Mapping[str, Any] = field(default_factory=dict)

    @property
    def finished(self) -> bool:
        """Whether it has answers."""
        return self.status == "finished"


def states_of(tasks: Iterable[Task], study: Path) -> dict[str, State]:
    """The states by digest."""
    found = folders(study)
    return {task.digest: state_of(task, study, found.get(task.digest)) for task in tasks}


def state_of(task: Task, study: Path, folder: Path | None) -> State:
    """The state of a task whose run is in `folder`, if it ever began."""
    if folder is not None and not folder.exists():
        folder = None
    if folder is not None and (done := _finished(task, folder)) is not None:
        return done
    place = claim(study, task.digest)
    if is_held(place):
        return State("running", folder=folder)
    end = _read(place / END)
    if end:
        status = "interrupted" if end.get("status") in CUT_SHORT else "failed"
        return State(status, str(end.get("reason", "")), folder)
    if folder is not None:
        return State("interrupted", "it was ended from outside", folder)
    return State("missing")


def _finished(task: Task, folder: Path) -> State | None:
    """A run that ended well and is of this task; None for any other, or one that is damaged."""
    record, result = _read(folder / RECORD), _read(folder / RESULT)
    same = record.get("tables") == dict(task.case.tables) and record.get("engine") == task.engine
    if not same or result.get("status") != "finished":
        return None
    with suppress(LookupError, TypeError, ValueError, AttributeError):
        found = {name: quantity(one) for name, one in result["quantities"].items()}
        if found:
            return State("finished", "", folder, found, result)
    return None


def _read(file: Path) -> dict[str, Any]:
    with suppress(InputError):
        return read_json(file)
    return {}


def quantity(given: Mapping[str, Any]) -> Quantity:
    """A quantity of a result.json. Raises LookupError or TypeError when it is none."""
    found = Quantity(**{one.name: given[one.name] for one in fields(Quantity)})
    if not all(isinstance(number, int | float) for number in (found.mean, found.standard_error)):
        raise TypeError("no number")
    return found
