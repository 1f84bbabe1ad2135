"""Tasks carried out on this machine, some at a time, each in a process of its own."""

from __future__ import annotations

import json
import os
import sys
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from liftdrag.engines import mpi, process
from liftdrag.errors import escaped
from liftdrag.lock import is_held
from liftdrag.study.state import State, state_of
from liftdrag.study.tasks import IN_USE, PROGRESS, Task, claim, folder_of, request

SAYS = "says.txt"
POLL_S = 0.1


@dataclass(frozen=True)
class Row:
    """A task that goes on: its name, its stage, the share of that done, and its time (s) left.

    It has gone on for `went_s`; `task` is None where another process is at it.
    """

    name: str
    stage: str
    share: float | None
    left_s: float | None
    task: Task | None = None
    went_s: float = 0.0


@dataclass(frozen=True)
class View:
    """How far a pool is: the tasks that go on, those that `ended`, and how many there are.

    `waiting` ones are begun by `jobs` at a time on `ranks` each; those that `took` so many seconds
    have finished here. `study` is the folder of all.
    """

    rows: Sequence[Row]
    ended: int
    total: int
    waiting: Sequence[Task] = ()
    took: Sequence[tuple[Task, float]] = ()
    jobs: int = 1
    ranks: int = 1
    study: Path = Path()


@dataclass(frozen=True)
class Watch:
    """Who is told: of each look at the pool, and in words of each task that starts or ends."""

    look: Callable[[View], None] = lambda _view: None
    say: Callable[[str], None] = lambda _words: None


@dataclass(frozen=True)
class Going:
    """A task that is carried out by a process, begun at a time (s) of the monotonic clock."""

    task: Task
    started: process.Started
    began_s: float

    @property
    def went_s(self) -> float:
        """For how long it has gone on."""
        return time.monotonic() - self.began_s


@dataclass
class Pool:
    """`jobs` tasks of the study in `study` at a time, each on so many ranks."""

    study: Path
    jobs: int
    ranks: int | None
    watch: Watch
    total: int = 0
    waiting: deque[Task] = field(default_factory=deque)
    elsewhere: list[Task] = field(default_factory=list)
    going: list[Going] = field(default_factory=list)
    took: list[tuple[Task, float]] = field(default_factory=list)
    ended: dict[str, State] = field(default_factory=dict)

    def carry_out(self, tasks: Sequence[Task]) -> Mapping[str, State]:
        """The states of the tasks by digest once all have ended, here or elsewhere.

        What interrupts it ends all children first.
        """
        self.waiting.extend(tasks)
        self.total = len(tasks)
        try:
            while self.waiting or self.going or self.elsewhere:
                self._start()
                time.sleep(POLL_S)
                self._reap()
                self._look_elsewhere()
                self.watch.look(self._view())
        finally:
            self._stop()
        return self.ended

    def _start(self) -> None:
        while self.waiting and len(self.going) < self.jobs:
            task = self.waiting.popleft()
            place = request(task, self.study).absolute()
            if is_held(place):
                self._leave(task)
                continue
            command = child_command(self.study, task, self.ranks)
            started = process.start(command, place, mpi.outside(os.environ), SAYS)
            self.going.append(Going(task, started, time.monotonic()))
            self.watch.say(f"{task.name}: started")

    def _reap(self) -> None:
        for one in list(self.going):
            code = one.started.process.poll()
            if code is None:
                continue
            process.stop(one.started)
            self.going.remove(one)
            if code == IN_USE:
                self._leave(one.task)
            else:
                self._end(one, code)

    def _leave(self, task: Task) -> None:
        self.elsewhere.append(task)
        self.watch.say(f"{task.name}: another liftdrag is at it; waiting")

    def _end(self, one: Going, code: int) -> None:
        task, state = one.task, ended(one.task, self.study, code)
        self.ended[task.digest] = state
        if state.finished:
            self.took.append((task, one.went_s))
        self.watch.say(told(task, state, len(self.ended), self.total))

    def _look_elsewhere(self) -> None:
        """What another process left is done here, unless it has finished."""
        for task in list(self.elsewhere):
            if not is_held(claim(self.study, task.digest)):
                self.elsewhere.remove(task)
                self.waiting.append(task)

    def _view(self) -> View:
        rows = [_row(one, claim(self.study, one.task.digest)) for one in self.going]
        away = [Row(task.name, "elsewhere", None, None) for task in self.elsewhere]
        return View(
            [*rows, *away],
            len(self.ended),
            self.total,
            self.waiting,
            self.took,
            self.jobs,
            self.ranks or 1,
            self.study,
        )

    def _stop(self) -> None:
        for one in self.going:
            one.started.process.terminate()
        for one in self.going:
            process.stop(one.started)


def ended(task: Task, study: Path, code: int) -> State:
    """The state of a task whose process has ended with this status."""
    state = state_of(task, study, folder_of(task, study))
    if state.finished or state.reason:
        return state
    said = escaped(_last_line(claim(study, task.digest) / SAYS))
    return State("failed", f"its process ended with status {code}. {said}".rstrip())


def told(task: Task, state: State, done: int, total: int) -> str:
    """What is said of a task that has ended."""
    why = f", {state.reason}" if state.reason else ""
    return f"{task.name}: {state.status}{why} ({done} of {total})"


def child_command(study: Path, task: Task, ranks: int | None) -> list[str]:
    """The words that run a task in a process of its own."""
    command = [sys.executable, "-m", "liftdrag.study.child", str(study.absolute())]
    command += ["--task", task.digest]
    return command if ranks is None else [*command, "--ranks", str(ranks)]


def _row(one: Going, place: Path) -> Row:
    task, went_s = one.task, one.went_s
    with suppress(OSError, ValueError, LookupError, TypeError):
        said = json.loads((place / PROGRESS).read_text("utf-8"))
        done, total = said["done"], said["total"]
        share = done / total if total else None
        left = said["elapsed_s"] * (total - done) / done if done else None
        return Row(task.name, str(said["stage"]), share, left, task, went_s)
    return Row(task.name, "starting", None, None, task, went_s)


def _last_line(file: Path) -> str:
    with suppress(OSError):
        lines = file.read_text("utf-8", "replace").split("\n")
        return next((line.strip() for line in reversed(lines) if line.strip()), "")
    return ""
