"""The in-house engine: two-dimensional grains of any shape; arrays in, samples out.

`law` is the contact law, a scalar function; `ellipse` and `shapes` are the geometry; `forces`
loops over the contacts, `neighbours` lists them, `motion` integrates. `bed` is what a user of the
engine holds, `growth` packs it, `contacts` looks at it.
"""

from liftdrag.dem.bed import Advanced, Bed, Memory, advance
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

__all__ = [
    "ESCAPED",
    "FINE",
    "NOT_FINITE",
    "TOO_DEEP",
    "Advanced",
    "Bed",
    "Contacts",
    "HertzMindlin",
    "Law",
    "LinearSpring",
    "Memory",
    "WaltonBraun",
    "advance",
    "contacts",
    "forces",
    "grown",
    "hertz_mindlin",
    "is_cold",
    "linear_spring",
    "walton_braun",
]
