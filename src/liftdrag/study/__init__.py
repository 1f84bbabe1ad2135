"""A study: many cases run, each once, what they claim together, and pictures of both."""

from liftdrag.study.plan import packaged, read
from liftdrag.study.studied import Studied
from liftdrag.study.swept import on_slurm, status, sweep

__all__ = ["Studied", "on_slurm", "packaged", "read", "status", "sweep"]
