"""The packed bed against one that was poured: does the drag notice?"""

from __future__ import annotations

from dataclasses import replace
from math import hypot

import pytest

from liftdrag.analysis.tank import Answers, answers
from liftdrag.case import Case, load
from liftdrag.deck import tank as decks
from liftdrag.engines import engine
from liftdrag.execution import write_deck
from liftdrag.numerics import Value, derive
from liftdrag.packing import random_bed

LOOSENED = 1.7
"""Height of the cloud of grains that falls, over that of the bed: a solid fraction of 0.35."""


def rain(container, count, rng):
    """Grains scattered over a taller container, apart from each other, to fall into place."""
    return random_bed(replace(container, top=LOOSENED * container.top), count, rng)


def driven(case: Case, folder, ranks: int, free_fall: bool = False) -> tuple[float, Answers]:
    """Solid fraction of the settled bed, and the answers of the drive."""
    numerics = derive(case.scene, ranks)
    if free_fall:
        numerics = replace(
            numerics,
            settle_damping=Value(1e-12, "kg/s", "a free fall"),
            settle_steps_max=Value(200_000, "steps", "it breathes for long"),
        )
    deck = decks.build(case.scene, numerics, case.name, "validation", ranks)
    write_deck(case, numerics, deck, "lammps", folder)
    lammps = engine("lammps")
    assert lammps.run(deck.plan, folder, lambda *_: None).status == "finished"
    series = lammps.series(deck.plan, folder)
    found = answers(case.scene, series, list(lammps.surfaces(deck.plan, folder)))
    return float(series["solid_fraction"][0]), found


@pytest.mark.validate
@pytest.mark.parametrize(
    ("name", "distance", "ranks"), [("quick", "18 D", 1), ("guillard2014/half-height", "16 D", 2)]
)
def test_drag_does_not_tell_a_packed_bed_from_a_poured_one(
    name, distance, ranks, tmp_path, monkeypatch, capsys
):
    """Packed and settled with damping, or rained down freely: the same drag within 5 %."""
    case = load(name).set("drive.distance", distance)
    packed_fraction, packed = driven(case, tmp_path / "packed", ranks)
    monkeypatch.setattr(decks, "random_bed", rain)
    monkeypatch.setattr(decks, "_headroom", lambda scene: 2.0 * scene.tank.height)
    poured_fraction, poured = driven(case, tmp_path / "poured", ranks, free_fall=True)
    one, other = packed.quantities["drag"], poured.quantities["drag"]
    error = hypot(one.standard_error, other.standard_error)
    with capsys.disabled():
        print(f"\nsolid fraction packed {packed_fraction:.4f}, poured {poured_fraction:.4f}")
        for bed, found in (("packed", packed), ("poured", poured)):
            for key, q in found.quantities.items():
                print(f"{name} {bed} {key} {q.mean:.5g} +- {q.standard_error:.2g} {q.unit}")
    assert one.converged
    assert other.converged
    assert error < 0.05 * one.mean
    assert abs(one.mean - other.mean) < 2.0 * error
    assert 0.58 < packed_fraction < 0.62
    assert 0.58 < poured_fraction < 0.62
