"""Cylinders and spheres in motion: what must be kept, closed forms, orders of the step, the box."""

from __future__ import annotations

from dataclasses import replace
from itertools import islice, product
from math import pi, sqrt

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from liftdrag.dem import HertzMindlin, hertz_mindlin
from liftdrag.dem.cylinders import (
    KINDS,
    NOT_FINITE,
    TOO_DEEP,
    Cell,
    Cylinders,
    Sample,
    grown,
    same_volume,
    shear,
    sheared,
    touching,
)
from liftdrag.dem.cylinders.touching import between

STIFFNESS = 1e6
BIG = Cell(np.full(3, 100.0))


def law_of(restitution: float = 1.0) -> HertzMindlin:
    """The law of these grains: lengths and masses are of order one."""
    return hertz_mindlin(STIFFNESS, 0.3, restitution, 0.0)


def last(count: int, *numbers, **others) -> Sample:
    """The last of some samples of a run."""
    return list(islice(shear(*numbers, **others), count))[-1]


def cylinders(position, axis, radius, half_length, velocity=0.0, spin=0.0, mass=1.0) -> Cylinders:
    """Cylinders of these numbers, each or all, about the middle of the big box.

    Spheres have no half length, and no axis.
    """
    position = np.array(position, float).reshape(-1, 3) + 50.0
    one, every = np.ones(len(position)), np.ones_like(position)
    axis = np.array(axis, float) * every
    axis /= np.linalg.norm(axis, axis=1)[:, None]
    sizes = [np.asarray(number) * one for number in (radius, half_length, mass)]
    axis[sizes[1] == 0.0] = 0.0
    return Cylinders(position, velocity * every, axis, spin * every, *sizes)


def momenta(grains: Cylinders) -> np.ndarray:
    """Momentum and angular momentum about the middle of the big box."""
    push = grains.mass[:, None] * grains.velocity
    turn = np.cross(grains.position - 50.0, push) + grains.angular_momentum
    return np.concatenate([push.sum(axis=0), turn.sum(axis=0)])


def energy(sample: Sample) -> float:
    """All of it, J."""
    return sample.translational + sample.rotational + sample.elastic


@pytest.mark.parametrize("half_length", [0.1, 3.0])
@pytest.mark.parametrize("step", [0.05, 0.011])
def test_a_free_top_moves_as_the_closed_form_says_at_any_step(half_length: float, step: float):
    """Its axis turns about L at |L| over the inertia across; L and energy are kept, to rounding."""
    top = cylinders([0, 0, 0], [1, 2, 2], 0.5, half_length, [0.1, 0.2, 0.3], [0.4, -2.0, 0.7], 2.0)
    now = last(2, top, BIG, law_of(), step, 50, skin=20.0)
    turn = top.angular_momentum[0] / top.inertia[0, 0] * now.time
    assert now.time == pytest.approx(100 * step)
    assert now.grains.axis[0] == pytest.approx(Rotation.from_rotvec(turn).apply(top.axis[0]))
    assert momenta(now.grains) == pytest.approx(momenta(top), abs=1e-12)
    assert now.grains.position[0] == pytest.approx(top.position[0] + now.time * top.velocity[0])
    rotational = 0.5 * (top.spin * top.angular_momentum).sum()
    assert now.rotational == pytest.approx(rotational, rel=1e-12)


# Pairs about to touch, one for each type: size, and the second's way, axis and size.

APPROACH = {
    "face-face": ((1.0, 0.5), [0.3, 0.0, 1.01], [0, 0, 1], (1.0, 0.5)),
    "face-band": ((1.0, 0.1), [0.3, 0.1, 0.301], [0, 1, 0], (0.2, 0.5)),
    "face-edge": ((1.0, 0.1), [0.2, 0.1, 1.05], [0.4, 0, 1], (0.2, 0.9)),
    "parallel bands": ((0.3, 1.0), [0.61, 0.0, 0.4], [0, 0, 1], (0.3, 1.0)),
    "skewed bands": ((0.3, 1.5), [0.1, 0.2, 0.61], [1, 0.3, 0], (0.3, 1.5)),
    "band-edge": ((0.3, 1.5), [0.0, 1.3, 0.1], [0, 1, 0.8], (0.4, 1.0)),
    "edge-edge": ((0.6, 0.3), [1.02, -0.1, 0.72], [1, 1, 1], (0.6, 0.3)),
    "spheres": ((0.6, 0.0), [0.1, 0.2, 0.89], [0, 0, 1], (0.3, 0.0)),
    "face-sphere": ((1.0, 0.1), [0.2, 0.1, 0.41], [0, 0, 1], (0.3, 0.0)),
    "band-sphere": ((0.3, 1.5), [0.1, 0.61, 0.2], [0, 0, 1], (0.3, 0.0)),
    "edge-sphere": ((0.6, 0.3), [0.8, 0.1, 0.55], [0, 0, 1], (0.3, 0.0)),
}


def approaching(kind: str, spin: float) -> Cylinders:
    """Two cylinders that meet so, the first about z or, for skewed bands, about x."""
    one, way, axis, other = APPROACH[kind]
    first = [0, 1, 0] if kind == "skewed bands" else [0, 0, 1]
    toward = np.array(way, float) / np.linalg.norm(way)
    velocity = np.array([0.5 * toward, -0.5 * toward])
    (r1, a1), (r2, a2) = one, other
    turning = spin * np.array([[0.3, -0.2, 0.5], [-0.1, 0.4, 0.2]])
    pair = [[0.0, 0.0, 0.0], way]
    return cylinders(pair, [first, axis], [r1, r2], [a1, a2], velocity, turning, [1.0, 0.7])


FLAT = ("face-face", "face-band", "parallel bands")
"""Types of axes that stay as they are, but for rounding, without spin."""


@pytest.mark.parametrize("kind", KINDS)
def test_a_pair_that_meets_elastically_keeps_what_it_must(kind: str):
    """Momentum and angular momentum to rounding; energy to the second order of the step.

    Of the first order where grains lie flat on each other, and the point jumps from end to end.
    """
    pair, errors = approaching(kind, 0.0 if kind in FLAT else 0.2), []
    for fold in (1, 4):
        run = list(islice(shear(pair, BIG, law_of(), 4e-5 / fold, 25 * fold), 120))
        total = np.array([energy(sample) for sample in run])
        assert sum(sample.counts[KINDS.index(kind)] for sample in run) > 0.0
        assert max(sample.elastic for sample in run) > 0.3 * total[0]
        assert momenta(run[-1].grains) == pytest.approx(momenta(pair), abs=2e-10)
        errors.append(abs(total / total[0] - 1.0).max())
    assert errors[0] < (5e-3 if kind in FLAT else 1e-4)
    assert errors[1] < errors[0] / (2.5 if kind in FLAT else 12.0)


def test_two_that_meet_head_on_overlap_as_hertz_says():
    """The largest overlap, with r* half the radius, and the restitution, at 50 steps and more."""
    pair = cylinders([[0, 0, 0], [0, 0, 1.001]], [0, 0, 1], 1.0, 0.5, [[0, 0, 0.5], [0, 0, -0.5]])
    stiffness = law_of().stiffness * sqrt(0.5)
    depth = (5.0 * 0.5 * 1.0 / (4.0 * stiffness)) ** 0.4
    step = 2.9432 * depth / 200.0
    run = list(islice(shear(pair, BIG, law_of(), step, 3), 200))
    assert max(sample.overlap for sample in run) == pytest.approx(depth / 0.5, rel=2e-4)
    errors = []
    for fold in (1, 2):
        now = last(1, pair, BIG, law_of(0.9), 4.0 * step / fold, 150 * fold)
        errors.append(abs(now.grains.velocity[1, 2] / 0.5 - 0.9))
    assert errors[0] < 6e-4
    assert errors[1] < 0.6 * errors[0]


def test_stress_of_one_contact_is_force_times_way():
    """Hertz's force on the overlap along z, over the volume; and of two that fly, m V V."""
    pair = cylinders([[0, 0, 0], [0.4, 0, 0.99]], [0, 0, 1], 1.0, 0.5, [[1, 2, 3], [-1, -2, -3]])
    now = last(1, replace(pair, velocity=0.0 * pair.velocity), BIG, law_of(), 1e-9, 1)
    force = law_of().stiffness * sqrt(0.5) * 0.01**1.5
    stress = np.zeros((3, 3))
    stress[2] = force * np.array([0.4, 0.0, 0.99]) / 1e6
    assert now.contact == pytest.approx(stress, rel=1e-6, abs=1e-12)
    flying = last(1, pair, BIG, law_of(), 1e-12, 1)
    assert flying.kinetic == pytest.approx(2.0 * np.outer([1, 2, 3], [1, 2, 3]) / 1e6, rel=1e-3)


def test_a_normal_that_jumps_from_the_face_to_the_band_is_counted():
    """An edge 0.03 within the rim of a face: when it is as deep, its contact is the band's."""
    way = [0.97 + 0.3, 0.0, 0.58]
    velocity = [[0.0, 0.0, 0.0], [0.0, 0.0, -1.0]]
    pair = cylinders([[0, 0, 0], way], [0, 0, 1], [1.0, 0.3], [0.1, 0.5], velocity, mass=1e6)
    tilt = np.array([[0.0, 0.0, 1.0], [-0.001, 0.0, 1.0]])
    pair = replace(pair, axis=tilt / np.linalg.norm(tilt, axis=1)[:, None])
    before, after = islice(shear(pair, BIG, law_of(), 1e-3, 7, skin=0.5), 2)
    assert (before.counts > 0.0).tolist() == [kind == "face-edge" for kind in KINDS]
    assert before.jumps == 0.0
    assert (after.counts > 0.0).tolist() == [kind in ("face-edge", "band-edge") for kind in KINDS]
    assert after.jumps * 7 == pytest.approx(1.0)


# Many, in a box.

MIXED = np.resize([6.0, 0.3, 1.0, 0.1, 0.0], 60)
"""Aspect ratios, and spheres."""


def bed(fraction: float, seed: int = 1, aspect: np.ndarray = MIXED) -> tuple[Cylinders, Cell]:
    """Grains of unit volume diameter and random speed at a solid fraction."""
    radius, half_length = same_volume(aspect, 1.0)
    size = np.full(3, (len(aspect) * pi / 6.0 / fraction) ** (1.0 / 3.0))
    grains = grown(radius, half_length, np.ones(len(aspect)), size, seed)
    rng = np.random.default_rng(seed)
    velocity, spin = rng.normal(size=(2, len(aspect), 3))
    return replace(grains, velocity=velocity - velocity.mean(axis=0), spin=spin), Cell(size)


@pytest.fixture(scope="module")
def loose() -> tuple[Cylinders, Cell]:
    return bed(0.25)


def test_a_gas_of_elastic_grains_keeps_its_energy_and_momentum(loose):
    """Rods, disks, spheres and others, some of which come to lie flat: three in ten thousand."""
    run = list(islice(shear(*loose, law_of(), 2e-4, 50), 40))
    total = np.array([energy(sample) for sample in run])
    assert sum(sample.counts.sum() for sample in run) * 50 > 5000
    assert abs(total / total[0] - 1.0).max() < 5e-4
    assert run[-1].grains.velocity.sum(axis=0) == pytest.approx(0.0, abs=1e-10)
    assert run[-1].lists > 0


def naive(grains: Cylinders, cell: Cell) -> set[tuple]:
    """All pairs of all images that touch, and how deep."""
    n, found = len(grains.mass), set()
    place = np.column_stack([grains.position, grains.axis, grains.radius, grains.half_length])
    one, other = np.triu_indices(n, 1)
    bound = np.hypot(grains.radius, grains.half_length)
    for kx, ky, kz in product(range(-3, 4), range(-2, 3), range(-2, 3)):
        away = np.array([kx, ky, kz]) * cell.size + [ky * cell.shift, 0.0, 0.0]
        way = grains.position[other] + away - grains.position[one]
        near = np.linalg.norm(way, axis=1) < bound[one] + bound[other]
        pair = np.column_stack([one, other])[near]
        met = between(place, pair, way[near])
        found |= {(*p, round(float(d), 9)) for p, d in zip(met.pair, met.depth, strict=True)}
    return found


def test_rods_grow_to_the_densest_flow_of_the_paper():
    """In no order they jam before; about the flow they do not, and touch nowhere."""
    grains, cell = bed(0.55, aspect=np.full(120, 6.0))
    assert naive(grains, cell) == set()
    assert grains.volume.sum() / cell.volume == pytest.approx(0.55)
    assert abs(grains.axis[:, 0]).mean() > 0.7


@pytest.mark.parametrize("shift", [0.0, 0.37, -0.8])
def test_no_contact_is_missed_in_a_small_sheared_box(loose, shift: float):
    """Those that the cells find, of swollen grains, are those of all pairs of all images."""
    grains, cell = loose
    swollen = replace(grains, radius=1.15 * grains.radius, half_length=1.15 * grains.half_length)
    slid = replace(cell, shift=shift * cell.size[0])
    met = touching(swollen, slid)
    listed = {(*p, round(float(d), 9)) for p, d in zip(met.pair, met.depth, strict=True)}
    assert len(listed) > 60
    assert listed == naive(swollen, slid)


def test_lists_that_are_made_often_and_seldom_give_the_same(loose):
    """In a sheared box, where a list too old would miss contacts."""
    grains, cell = loose
    cell = replace(cell, shear_rate=1.0)
    often = last(1, grains, cell, law_of(0.8), 2e-4, 500, skin=0.02)
    seldom = last(1, grains, cell, law_of(0.8), 2e-4, 500, skin=1.0)
    assert often.lists > 5 * seldom.lists
    assert often.elastic == pytest.approx(seldom.elastic, rel=1e-6)
    assert often.grains.spin == pytest.approx(seldom.grains.spin, abs=1e-6)


def test_a_sheared_box_is_the_same_from_anywhere(loose):
    """Moved as a whole, by a way that takes grains over its sides, with the speed of the shear."""
    grains, cell = loose
    cell, moved = replace(cell, shear_rate=2.0), np.array([1.0, 2.5, -3.0])
    velocity = grains.velocity + np.array([2.0 * moved[1], 0.0, 0.0])
    elsewhere = replace(grains, position=grains.position + moved, velocity=velocity)
    here, there = (last(2, start, cell, law_of(0.8), 2e-4, 150) for start in (grains, elsewhere))
    assert there.contact == pytest.approx(here.contact, rel=1e-7)
    assert there.kinetic == pytest.approx(here.kinetic, rel=1e-9)
    assert there.cell.shift == pytest.approx(here.cell.shift)
    assert here.cell.shift == pytest.approx(2.0 * cell.size[1] * here.time)


def test_grains_too_far_apart_to_meet_are_carried_along_by_the_shear():
    """Through the sides, over two box heights of shear, without speed against the mean flow."""
    rng, cell = np.random.default_rng(1), Cell(np.array([20.0, 20.0, 20.0]), 3.0)
    sites = np.array([[5.0, 2.5 + 5.0 * k, 5.0] for k in range(4)]) - 50.0
    grains = sheared(cylinders(sites, rng.normal(size=(4, 3)), 0.5, 0.5), cell)
    run = list(islice(shear(grains, cell, law_of(), 1e-3, 100, skin=1.0), 7))
    assert run[-1].strain == pytest.approx(2.1)
    assert run[-1].translational == pytest.approx(0.0, abs=1e-20)
    assert run[-1].kinetic == pytest.approx(0.0, abs=1e-20)
    assert run[-1].grains.position[:, 1] == pytest.approx(grains.position[:, 1])


def test_a_run_goes_on_where_a_sample_ends(loose):
    """From the sample's grains and cell the next one is that of the first run."""
    grains, cell = loose
    cell = replace(cell, shear_rate=1.0)
    one, two = islice(shear(grains, cell, law_of(0.8), 2e-4, 50), 2)
    again = last(1, one.grains, one.cell, law_of(0.8), 2e-4, 50)
    assert again.contact == pytest.approx(two.contact, rel=1e-9)
    assert again.grains.position == pytest.approx(two.grains.position, abs=1e-11)


def test_a_dense_mixture_grows_and_none_touches_another():
    """At a solid fraction of 0.5, the same from the same seed, at rest and at its own size."""
    aspect = np.resize([6.0, 0.3], 40)
    grains, cell = bed(0.5, 2, aspect)
    again, _ = bed(0.5, 2, aspect)
    assert grains.volume.sum() / cell.volume == pytest.approx(0.5)
    assert len(touching(grains, cell).pair) == 0
    assert (grains.position == again.position).all()


def test_grains_that_do_not_fit_are_refused():
    with pytest.raises(ValueError, match="do not fit"):
        bed(0.95, 1, np.full(20, 0.5))


def test_a_run_that_makes_no_sense_is_refused(loose):
    grains, cell = loose
    with pytest.raises(ValueError, match="no run of"):
        next(shear(grains, cell, law_of(), -1.0, 10))
    with pytest.raises(ValueError, match="a sphere has no axis"):
        next(shear(replace(grains, axis=np.ones((60, 3))), cell, law_of(), 1e-4, 10))
    with pytest.raises(ValueError, match="not longer than"):
        next(shear(grains, replace(cell, size=np.full(3, 2.0)), law_of(), 1e-4, 10))


def test_a_run_that_fails_says_so():
    """Two pushed into each other are too deep; one without a place is nowhere."""
    pair = cylinders([[0, 0, 0], [0.1, 0, 0.2]], [0, 0, 1], 1.0, 0.5)
    assert next(shear(pair, BIG, law_of(), 1e-6, 10)).status == TOO_DEEP
    lost = replace(pair, velocity=np.full((2, 3), np.inf))
    assert next(shear(lost, BIG, law_of(), 1e-6, 10)).status == NOT_FINITE


@pytest.mark.validate
def test_two_threads_give_the_bits_of_any_number(loose):
    """The loop compiled for several threads, on two and on three."""
    two, three = (last(2, *loose, law_of(), 2e-4, 50, threads=k).grains for k in (2, 3))
    assert (two.position == three.position).all()
    assert (two.spin == three.spin).all()
    one = last(2, *loose, law_of(), 2e-4, 50).grains
    assert one.position == pytest.approx(two.position, abs=1e-10)
