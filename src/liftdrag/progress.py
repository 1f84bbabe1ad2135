"""Progress of a run: a bar with time left on a terminal, plain lines elsewhere."""

from __future__ import annotations

import logging
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from liftdrag.engines.base import Progress

LINE_EVERY_S = 20.0


@contextmanager
def reported() -> Iterator[Progress]:
    """Progress, and what liftdrag logs, shown on standard error while the block runs."""
    log, spoken = logging.getLogger("liftdrag"), _Spoken()
    log.addHandler(spoken)
    log.setLevel(logging.INFO)
    try:
        if sys.stderr.isatty():
            with _bar() as progress:
                yield progress
        else:
            yield _lines()
    finally:
        log.removeHandler(spoken)


class _Spoken(logging.Handler):
    """Prints to standard error as it is at the time, above a bar."""

    def emit(self, record: logging.LogRecord) -> None:
        print(self.format(record), file=sys.stderr, flush=True)


@contextmanager
def _bar() -> Iterator[Progress]:
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}"), BarColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as shown:
        tasks: dict[str, TaskID] = {}

        def progress(stage: str, done: int, total: int) -> None:
            if stage not in tasks:
                for earlier in tasks.values():
                    shown.remove_task(earlier)
                tasks.clear()
                tasks[stage] = shown.add_task(_MEANING.get(stage, stage), total=total)
            shown.update(tasks[stage], completed=done)

        yield progress


_MEANING = {
    "settle": "settling, at most",
    "drive": "driving",
    "compile": "compiling the in-house engine, this once",
}


def _lines() -> Progress:
    shown_at: dict[str, float] = {}

    def progress(stage: str, done: int, total: int) -> None:
        now = time.monotonic()
        if now - shown_at.get(stage, -LINE_EVERY_S) < LINE_EVERY_S and done < total:
            return
        shown_at[stage] = now
        share = f"{100.0 * done / total:.0f} %"
        print(f"{_MEANING.get(stage, stage)}: step {done} of {total}, {share}", file=sys.stderr)

    return progress


@contextmanager
def spinning() -> Iterator[Callable[[str], None]]:
    """A function to say what is being done: one changing line on a terminal, lines elsewhere."""
    if not sys.stderr.isatty():
        yield lambda words: print(words, file=sys.stderr, flush=True)
        return
    from rich.console import Console
    from rich.markup import escape

    with Console(stderr=True).status("starting") as status:
        yield lambda words: status.update(escape(words))
