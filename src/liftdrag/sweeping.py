"""How far the runs of a study are: a live table on a terminal, plain lines elsewhere."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from liftdrag.cost.estimate import duration
from liftdrag.study.forecast import Forecast
from liftdrag.study.pool import View, Watch

if TYPE_CHECKING:
    from rich.table import Table


@contextmanager
def watched() -> Iterator[Watch]:
    """Who is told how far a study is while the block runs, on standard error."""
    if not sys.stderr.isatty():
        yield Watch(say=lambda words: print(words, file=sys.stderr, flush=True))
        return
    from rich.console import Console
    from rich.live import Live
    from rich.markup import escape

    console, forecast = Console(stderr=True), Forecast()
    with Live(console=console, transient=True, refresh_per_second=4) as live:
        yield Watch(
            look=lambda view: live.update(table(view, forecast)),
            say=lambda words: console.print(escape(words), highlight=False),
        )


def table(view: View, forecast: Forecast) -> Table:
    """The runs that go on: stage, share of it done, and the time left of the run and of all."""
    from rich.table import Table

    left_s = forecast.left_s(view)
    rest = "" if left_s is None else f", about {duration(left_s)} left"
    caption = f"{view.ended} of {view.total} have ended{rest}"
    result = Table(caption=caption, min_width=len(caption))
    for heading in ("run", "stage", "done", "left"):
        result.add_column(heading)
    for row in view.rows:
        share = "" if row.share is None else f"{100.0 * row.share:.0f} %"
        left_s = forecast.run_left_s(row, view)
        left = "" if left_s is None else duration(left_s)
        result.add_row(row.name, row.stage, share, left)
    return result
