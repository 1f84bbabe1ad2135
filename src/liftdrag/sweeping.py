"""How far the runs of a study are: a live table on a terminal, plain lines elsewhere."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING

from liftdrag.analysis.quantity import Quantity, rounded
from liftdrag.cost.estimate import duration
from liftdrag.study.early import Early
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

    console, forecast, early = Console(stderr=True), Forecast(), Early()

    def shown(view: View) -> Table:
        early.look(view)
        return table(view, forecast, early)

    with Live(console=console, transient=True, refresh_per_second=4) as live:
        yield Watch(
            look=lambda view: live.update(shown(view)),
            say=lambda words: console.print(escape(words), highlight=False),
        )


def table(view: View, forecast: Forecast, early: Early) -> Table:
    """The runs that go on: stage, share done, answer so far; the time left of each and of all."""
    from rich.table import Table

    left_s = forecast.left_s(view)
    rest = "" if left_s is None else f", about {duration(left_s)} left"
    caption = f"{view.ended} of {view.total} have ended{rest}"
    result = Table(caption=caption, min_width=len(caption))
    for heading in ("run", "stage", "done", "left", "so far"):
        result.add_column(heading)
    for row in view.rows:
        share = "" if row.share is None else f"{100.0 * row.share:.0f} %"
        left_s = forecast.run_left_s(row, view)
        left = "" if left_s is None else duration(left_s)
        result.add_row(row.name, row.stage, share, left, _said(early.answers.get(row.name, {})))
    return result


def _said(found: Mapping[str, Quantity]) -> str:
    """Each quantity, with its error once that can be trusted."""
    return ", ".join(f"{name} {_with_error(one)} {one.unit}" for name, one in found.items())


def _with_error(one: Quantity) -> str:
    both = rounded(one.mean, one.standard_error)
    return " ± ".join(both) if one.converged else f"~ {one.mean:.2g}"
