"""Flat-ended cylinders in space, and spheres, without friction, in a box that may be sheared.

`meeting` finds where two cylinders touch, `edges` where edges do, `rounded` where a sphere does;
`candidates` are the pairs that may meet, `neighbours` those of them that are near, over which
`forces` loops; `images` knows the box, `motion` moves, and `advance` is the loop over the steps.
What a user holds are `Cylinders` in a `Cell`, `grown` there, `shear` and its samples, and the
contacts that `touching` finds.
"""

from liftdrag.dem.cylinders.advance import FINE, NOT_FINITE, TOO_DEEP
from liftdrag.dem.cylinders.flow import Sample, shear, sheared
from liftdrag.dem.cylinders.growth import grown
from liftdrag.dem.cylinders.kinds import KINDS
from liftdrag.dem.cylinders.state import Cell, Cylinders, same_volume
from liftdrag.dem.cylinders.touching import Contacts, touching

__all__ = [
    "FINE",
    "KINDS",
    "NOT_FINITE",
    "TOO_DEEP",
    "Cell",
    "Contacts",
    "Cylinders",
    "Sample",
    "grown",
    "same_volume",
    "shear",
    "sheared",
    "touching",
]
