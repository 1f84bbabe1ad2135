"""Two-body tests of an engine, against closed forms and published values."""

from liftdrag.verify.check import Check
from liftdrag.verify.convergence import Convergence
from liftdrag.verify.impact import impact
from liftdrag.verify.verified import Verified, verified

__all__ = ["Check", "Convergence", "Verified", "impact", "verified"]
