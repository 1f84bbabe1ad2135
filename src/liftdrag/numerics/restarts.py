"""How often an engine writes its state, so that a run that is cut short can go on."""

from __future__ import annotations

from math import ceil

from liftdrag.numerics.value import Value

APART_S = 60.0
"""Seconds of a run between two restart files, where these are written fast."""

SHARE = 0.01
"""Of the time of a run, at most this is spent on writing restart files."""

SPEED = 100_000.0
"""Grains whose state is written in a second: 0.4 kB each, to a slow disk."""


def restart_every(
    chosen: int | None, grains: float, step_rate: float, whole: int, of: str
) -> Value[int]:
    """Steps between two restart files: `chosen` by hand, or at `step_rate` steps a second.

    They are a multiple of `whole` steps, which is called `of`.
    """
    if chosen is not None:
        return Value(whole * ceil(chosen / whole), "steps", f"set by hand, in whole {of}")
    writing = grains / SPEED
    apart = max(APART_S, writing / SHARE)
    return Value(
        whole * max(round(apart * step_rate / whole), 1),
        "steps",
        f"a restart file every {apart:.0f} s or so: {100.0 * writing / apart:.1g} % of a run",
    )
