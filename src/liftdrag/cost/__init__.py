"""What a run will cost, said before it: time from what this machine did before, and memory."""

from liftdrag.cost.estimate import Estimate
from liftdrag.cost.foresight import expected, foresee
from liftdrag.cost.machine import cores
from liftdrag.cost.means import check_means

__all__ = ["Estimate", "check_means", "cores", "expected", "foresee"]
