"""Run time against error: what each choice of a case costs, and what it does to the answer."""

from liftdrag.bench.benched import Benched
from liftdrag.bench.budget import seconds
from liftdrag.bench.harness import bench

__all__ = ["Benched", "bench", "seconds"]
