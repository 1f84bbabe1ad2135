"""When the average of a fill of a Janssen piston is long enough."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import inf, nan

from liftdrag.analysis.correlated import mean_of
from liftdrag.analysis.errorbars import MINIMUM_CORRELATION_TIMES
from liftdrag.analysis.quantity import Quantity
from liftdrag.analysis.stopping import Stopping, reached
from liftdrag.granular import GRAVITY
from liftdrag.numerics.janssen import MOBILISE_NEXT
from liftdrag.scene import JanssenScene
from liftdrag.series import Series

LEAST_WAY = MINIMUM_CORRELATION_TIMES * MOBILISE_NEXT
"""Way of the wall, in d, before which no average ends early.

The load shakes within 0.01 d, but also remembers its packing over some 0.3 d, which shorter
averages do not see: of two columns of 15 and two of 60 g, averaged over 60 d, averages over 0.15
to 0.5 d were off by 2 to 6 % where their errors said 0.5 to 2 %. Averages of at most 20 d that
ended when known to 2 % were off by 1.8 % (root mean square); their intervals held the truth in
80 of 100.
"""


class _LoadStopping(Stopping):
    """Is content with a load that is converged, as `met` asks: its least way stands for more."""

    def _is_good(self, series: Series) -> bool:
        return reached(self.targets, self.estimate(series))


@dataclass
class FillStopping:
    """Called with the averaged series of the fill under way: whether its load is known.

    A fill, recognised by the time of its first sample, is judged on its own, from LEAST_WAY on.
    """

    scene: JanssenScene
    _first: float = field(default=nan, init=False)
    _rule: Stopping | None = field(default=None, init=False)

    def __call__(self, series: Series) -> bool:
        if len(series) < 2:
            return False
        if self._rule is None or series.time[0] != self._first:
            self._first = series.time[0]
            self._rule = _LoadStopping(self.scene.targets, load, self._first_look(series))
        return self._rule(series)

    def _first_look(self, series: Series) -> int:
        step = (self.scene.drive.speed or inf) * series.interval / self.scene.grains.diameter
        return max(round(LEAST_WAY / step), MINIMUM_CORRELATION_TIMES)


def load(series: Series) -> dict[str, Quantity]:
    """The apparent mass of a fill from the samples that are averaged, two at least."""
    return {"apparent_mass": mean_of(series["piston"] / GRAVITY, series.interval, "kg")}
