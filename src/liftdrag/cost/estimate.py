"""The estimate of a run's cost, and how it is said."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from liftdrag.cost.history import Learnt, learn
from liftdrag.cost.kind import Kind
from liftdrag.cost.work import Work
from liftdrag.engines.base import Outcome

SHORT_S = 0.5
"""Shorter runs teach nothing."""


@dataclass(frozen=True)
class Times:
    """Seconds on the clock to pack, to compile and from then to the end, and those of all cores.

    `cores` compute at a time; each takes `rate` grain-steps a second.
    """

    packing_s: float
    compile_s: float
    wall_s: float
    cpu_s: float
    cores: int
    rate: float


@dataclass(frozen=True)
class Estimate:
    """What a run of a kind should take, how that is known, and what to know before it starts.

    A run that `stops` when its answer is good enough takes this at most.
    """

    kind: Kind
    work: Work
    times: Times
    basis: str
    stops: bool
    warnings: tuple[str, ...]

    def __str__(self) -> str:
        times = self.times
        most = "At most" if self.stops else "About"
        whole = duration(times.wall_s + times.packing_s)
        where = f"{times.cores} core{'s' * (times.cores > 1)}"
        return f"{most} {whole} on {where}: {', '.join(self._parts())}."

    def _parts(self) -> Iterator[str]:
        work, times = self.work, self.times
        many = f"{work.beds} packings of " if self.kind.scene == "drag2d" else ""
        yield f"{many}{counted(work.grains)} grains"
        yield f"{counted(work.steps)} steps"
        yield f"{times.rate / 1e6:.2g} million grain-steps a second and core"
        if times.compile_s:
            yield f"{duration(times.compile_s)} to compile the engine, once"
        yield self.basis

    def to_dict(self) -> dict[str, Any]:
        """As `result.json` holds it."""
        times = self.times
        return {
            "wall_s": times.wall_s,
            "packing_s": times.packing_s,
            "cpu_s": times.cpu_s,
            "basis": self.basis,
        }

    def compare(self, outcome: Outcome, grain_steps: float, beds: int = 1) -> None:
        """Learn from how it went: `grain_steps` of a bed, so many `beds`."""
        work = Work(self.work.grains, outcome.steps // beds, grain_steps, beds)
        run = Learnt.of(self.kind, work, outcome)
        if not self.times.compile_s and run.seconds >= SHORT_S:
            learn(run)


def counted(number: float) -> str:
    """A number to three digits, in groups: 35 000."""
    return f"{float(f'{number:.3g}'):,.0f}".replace(",", " ")


def duration(seconds: float) -> str:
    """A duration as it is said: 40 s, 14 min, 3.2 h."""
    if seconds < 99.5:
        return f"{max(seconds, 1.0):.0f} s"
    if seconds < 99.5 * 60.0:
        return f"{seconds / 60.0:.0f} min"
    if seconds < 48.0 * 3600.0:
        return f"{seconds / 3600.0:.2g} h"
    return f"{seconds / 86400.0:.2g} days"
