"""The stability map of a case: how far each choice can be pushed before something breaks."""

from liftdrag.stress.harness import stress
from liftdrag.stress.stressed import Stressed

__all__ = ["Stressed", "stress"]
