"""The in-house engine: grains of any shape in the plane, spheres in a tube; arrays in, samples out.

`law` holds the contact laws, scalar functions; `forces` loops over the contacts, `neighbours`
lists them, `motion` integrates. `planar` says what all three need to know of bodies in the plane,
whose geometry is in `ellipse` and `shapes`, `spheres` what of spheres. What a user of the engine
holds is a `bed`, which `growth` packs and `contacts` looks at, or a `column`, and `touching`.
`cylinders` is an engine of its own, of rods and disks in a box that may be sheared.
"""

from liftdrag.dem.bed import Advanced, Bed, Memory, advance
from liftdrag.dem.column import Column, ColumnMemory, Fallen, fall
from liftdrag.dem.compiled import is_cold
from liftdrag.dem.contacts import Contacts, contacts, forces
from liftdrag.dem.growth import grown
from liftdrag.dem.law import (
    HertzMindlin,
    Law,
    LinearSpring,
    WaltonBraun,
    hertz_mindlin,
    linear_spring,
    walton_braun,
)
from liftdrag.dem.motion import ESCAPED, FINE, NOT_FINITE, TOO_DEEP
from liftdrag.dem.spheres import TubeWalls
from liftdrag.dem.touching import Touching, touching

__all__ = [
    "ESCAPED",
    "FINE",
    "NOT_FINITE",
    "TOO_DEEP",
    "Advanced",
    "Bed",
    "Column",
    "ColumnMemory",
    "Contacts",
    "Fallen",
    "HertzMindlin",
    "Law",
    "LinearSpring",
    "Memory",
    "Touching",
    "TubeWalls",
    "WaltonBraun",
    "advance",
    "contacts",
    "fall",
    "forces",
    "grown",
    "hertz_mindlin",
    "is_cold",
    "linear_spring",
    "touching",
    "walton_braun",
]
