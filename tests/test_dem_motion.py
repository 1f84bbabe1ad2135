"""Motion against what must be kept: energy, momentum, angular momentum; and orders of the step."""

from __future__ import annotations

from dataclasses import replace
from math import exp

import numpy as np
import pytest
from beds import clumps, grains, law_of

from liftdrag.dem import ESCAPED, FINE, NOT_FINITE, TOO_DEEP, Bed, Law, advance, contacts

SMOOTH = law_of()


def ring(shape: str) -> Bed:
    """Twelve grains of a shape on a ring, that fly inward and spin, to meet about the middle."""
    rng = np.random.default_rng(1)
    angle = np.pi * np.arange(12) / 6.0
    place = 7.0 * np.column_stack([np.cos(angle), np.sin(angle)])
    velocity = 0.4 * rng.normal(size=(12, 2)) - place / 3.5
    moving = velocity, rng.uniform(0.0, 7.0, 12), rng.normal(size=12)
    if shape == "dumbbell":
        return clumps(place, [[-0.6, 0.0], [0.6, 0.0]], [0.6, 0.6], *moving)
    if shape == "triple":
        return clumps(place, [[-0.5, -0.3], [0.5, -0.3], [0.0, 0.6]], [0.6, 0.6, 0.5], *moving)
    if shape == "disc":
        return grains(place, rng.uniform(0.7, 1.1, (12, 1)), *moving)
    contact, ratio = shape.rsplit(" ", 1)
    return grains(place, [float(ratio) ** 0.5, float(ratio) ** -0.5], *moving, contact=contact)


SHAPES = ["disc", "dumbbell", "triple", "common normal 1.375", "common normal 3"]


def momenta(bed: Bed) -> np.ndarray:
    """Momentum and angular momentum about the origin of the free bodies."""
    free = np.isfinite(bed.mass)
    mass, (x, y), (vx, vy) = bed.mass[free], bed.position[free].T, bed.velocity[free].T
    spin = bed.inertia[free] * bed.spin[free]
    return np.array([(mass * vx).sum(), (mass * vy).sum(), (mass * (x * vy - y * vx) + spin).sum()])


def energy_error(bed: Bed, time_step: float, every: int) -> float:
    """The largest change of the energy over what it was, in a run over 1200 rows."""
    run = advance(bed, SMOOTH, time_step, 1200, every)
    assert run.status == FINE
    assert run.elastic.max() > 0.01 * bed.kinetic_energy
    assert run.elastic[-1] < 1e-3 * run.elastic.max()
    total, before = run.kinetic + run.elastic, bed.kinetic_energy
    assert run.kinetic[-1] == pytest.approx(run.bed.kinetic_energy, rel=1e-12)
    return float(abs(total - before).max() / before)


@pytest.mark.parametrize("shape", SHAPES)
def test_energy_of_a_cluster_is_kept_with_an_error_of_second_order(shape: str):
    """Below 1e-5 at the least of three steps, each half of the one before."""
    bed = ring(shape)
    errors = [energy_error(bed, 1e-3 / fold, 5 * fold) for fold in (1, 2, 4)]
    assert errors[-1] < 1e-5
    assert np.log2(errors[0] / errors[-1]) / 2.0 == pytest.approx(2.0, abs=0.2)


@pytest.mark.parametrize("shape", SHAPES)
def test_velocities_of_a_run_cut_in_a_collision_are_those_of_its_last_places(shape: str):
    """The energy of the bed is the kinetic one sampled, and with the elastic one what it was.

    So it is again after a run that goes on from there.
    """
    bed = ring(shape)
    cut = int(advance(bed, SMOOTH, 2.5e-4, 1200, 20).elastic.argmax()) + 1
    run = advance(bed, SMOOTH, 2.5e-4, cut, 20)
    assert run.elastic[-1] > 0.01 * bed.kinetic_energy
    assert run.bed.kinetic_energy == pytest.approx(run.kinetic[-1], rel=1e-12)
    assert run.bed.kinetic_energy + run.elastic[-1] == pytest.approx(bed.kinetic_energy, rel=1e-5)
    after = advance(run.bed, SMOOTH, 2.5e-4, 1, 300)
    assert after.kinetic[0] + after.elastic[0] == pytest.approx(bed.kinetic_energy, rel=1e-5)


@pytest.mark.parametrize("shape", ["paper 1.375", "paper 3"])
def test_energy_of_an_elastic_cluster_changes_under_the_rule_of_the_paper(shape: str):
    """By a third of itself at ratio 1.375 and more at 3, and by the same at a quarter the step."""
    bed = ring(shape)
    coarse, fine = energy_error(bed, 1e-3, 5), energy_error(bed, 2.5e-4, 20)
    assert fine > 0.3
    assert coarse == pytest.approx(fine, rel=1e-3)


LAWS = {
    "smooth": law_of(),
    "rough, slip at the point": law_of(0.6, 0.5),
    "rough, slip at the surfaces": law_of(0.6, 0.5, reach=1.0),
}


@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
@pytest.mark.parametrize("shape", [*SHAPES, "paper 3"])
def test_momentum_and_angular_momentum_are_kept_to_rounding(shape: str, law: Law):
    bed = ring(shape)
    run = advance(bed, law, 5e-4, 1200, 10)
    assert (np.diff((run.elastic > 0.0).astype(int)) > 0).sum() >= 2
    assert (run.bed.kinetic_energy < 0.95 * bed.kinetic_energy) == (law.damping > 0.0)
    weight = bed.mass @ np.hypot(*bed.velocity.T)
    change = abs(momenta(run.bed) - momenta(bed)) / (weight * np.array([1.0, 1.0, 7.0]))
    assert change.max() < 1e-13


def couples(contact: str, ratio: float) -> Bed:
    """Eighty pairs of ellipses, far apart, each about to collide obliquely at speed 2."""
    rng = np.random.default_rng(7)
    place = 40.0 * np.column_stack(np.divmod(np.arange(80), 9))
    apart = np.column_stack([np.full(80, 3.7), rng.uniform(-0.9, 0.9, 80)])
    position = np.stack([place, place + apart], axis=1).reshape(-1, 2)
    velocity = np.tile([[1.0, 0.0], [-1.0, 0.0]], (80, 1))
    axes = [ratio**0.5, ratio**-0.5]
    angle, spin = rng.uniform(0.0, 7.0, 160), 0.5 * rng.normal(size=160)
    return grains(position, axes, velocity, angle, spin, contact)


def energy_by_couple(bed: Bed) -> np.ndarray:
    energies = bed.mass * (bed.velocity**2).sum(axis=1) + bed.inertia * bed.spin**2
    return 0.5 * energies.reshape(-1, 2).sum(axis=1)


def collided(contact: str, ratio: float, time_step: float) -> Bed:
    """The couples three seconds later, all of them apart again."""
    after = advance(couples(contact, ratio), SMOOTH, time_step, 1, round(3.0 / time_step)).bed
    assert len(contacts(after, SMOOTH).depth) == 0
    return after


def gains(contact: str, ratio: float, time_step: float) -> np.ndarray:
    """Kinetic energy of each couple after its collision over what it was, less 1."""
    before = energy_by_couple(couples(contact, ratio))
    return energy_by_couple(collided(contact, ratio, time_step)) / before - 1.0


def test_elastic_collision_changes_the_energy_under_the_rule_of_the_paper_only():
    """Root mean square over 80 collisions at ratio 1.375: a quarter at any step, against 1e-6."""
    coarse, fine = gains("paper", 1.375, 1e-3), gains("paper", 1.375, 2.5e-4)
    assert np.sqrt((fine**2).mean()) == pytest.approx(0.25, abs=0.01)
    assert (abs(fine) > 0.05).mean() > 0.6
    assert coarse == pytest.approx(fine, abs=5e-5)
    assert np.sqrt((gains("common normal", 1.375, 2.5e-4) ** 2).mean()) < 1e-6


@pytest.mark.parametrize("ratio", [1.375, 3.0])
def test_velocities_after_an_oblique_collision_converge_in_second_order(ratio: float):
    """Of ellipses, the median error against a tenth of the smallest of four steps.

    The first and last step of a contact add errors of order 2.5 that differ by couple.
    """
    exact = collided("common normal", ratio, 2.5e-5)
    errors = []
    for time_step in (2e-3, 1e-3, 5e-4, 2.5e-4):
        after = collided("common normal", ratio, time_step)
        off = np.column_stack([after.velocity - exact.velocity, after.spin - exact.spin])
        errors.append(np.median(abs(off)))
    assert errors[-1] < 1e-6
    assert 1.9 < np.log2(errors[0] / errors[-1]) / 3.0 < 2.4


def test_free_dumbbell_turns_at_its_spin_about_a_centre_that_goes_straight():
    """Against x + v t and spin t, after a hundred turns."""
    bed = clumps([[1.0, 2.0]], [[-0.6, 0.0], [0.6, 0.0]], [0.6, 0.6], [[3.0, -1.0]], 0.3, 20.0)
    after = advance(bed, SMOOTH, 1e-3, 1, 31_416).bed
    assert after.spin[0] == 20.0
    assert after.velocity.tolist() == [[3.0, -1.0]]
    assert after.position[0] == pytest.approx([1.0 + 3.0 * 31.416, 2.0 - 31.416], rel=1e-11)
    assert after.angle[0] == pytest.approx(0.3 + 20.0 * 31.416, rel=1e-11)


@pytest.mark.parametrize("shape", ["dumbbell", "common normal 3"])
def test_parts_turn_with_the_angle_of_their_body(shape: str):
    """Two halves of a run, the axes of the second from the angles, against the run in one.

    The axes turned step by step, some thirty times around, until the two bodies collided.
    """
    moving = [[0.0, 0.0], [-1.0, 0.0]], [0.5, 1.0], [20.0, 3.0]
    two = (
        clumps([[0.0, 0.0], [10.0, 0.2]], [[-0.6, 0.0], [0.6, 0.0]], [0.6, 0.6], *moving)
        if shape == "dumbbell"
        else grains([[0.0, 0.0], [10.0, 0.2]], [3**0.5, 3**-0.5], *moving, contact="common normal")
    )
    whole = advance(two, SMOOTH, 5e-4, 1, 22_000).bed
    half = advance(two, SMOOTH, 5e-4, 1, 10_000).bed
    halves = advance(half, SMOOTH, 5e-4, 1, 12_000).bed
    assert abs(whole.velocity - two.velocity).max() > 0.3
    assert whole.velocity == pytest.approx(halves.velocity, abs=1e-6)
    assert whole.spin == pytest.approx(halves.spin, abs=1e-6)


def test_damping_rate_slows_straight_motion_and_spin_exponentially():
    bed = grains([[0.0, 0.0], [9.0, 9.0]], velocity=[[3.0, -1.0], [0.5, 2.0]], spin=[4.0, -1.0])
    after = advance(bed, SMOOTH, 1e-3, 3, 500, damping_rate=2.0).bed
    assert after.velocity == pytest.approx(bed.velocity * exp(-3.0), rel=1e-11)
    assert after.spin == pytest.approx(bed.spin * exp(-3.0), rel=1e-11)
    travel = (after.position - bed.position) / bed.velocity
    assert travel == pytest.approx(np.full((2, 2), 0.5 * (1.0 - exp(-3.0))), rel=2e-3)


def with_driven(bed: Bed) -> Bed:
    """The same with its first body in the middle, driven along x and turned."""
    bed = replace(bed, position=bed.position.copy(), velocity=bed.velocity.copy())
    bed.position[0], bed.velocity[0] = [-1.0, 0.2], [1.5, 0.1]
    first = np.arange(12) == 0
    mass, inertia = np.where(first, np.inf, bed.mass), np.where(first, np.inf, bed.inertia)
    return replace(bed, mass=mass, inertia=inertia, spin=np.where(first, 0.8, bed.spin))


@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
@pytest.mark.parametrize("shape", ["disc", "dumbbell", "common normal 3"])
def test_driven_body_moves_as_told_and_takes_what_momentum_the_others_lose(shape: str, law: Law):
    """Impulse and moment about the origin, summed over all steps, against minus the change."""
    bed = with_driven(ring(shape))
    run = advance(bed, law, 5e-4, 16_000, watched=0)
    assert run.status == FINE
    assert run.bed.velocity[0].tolist() == [1.5, 0.1]
    assert run.bed.spin[0] == 0.8
    assert run.bed.position[0] == pytest.approx([-1.0 + 1.5 * 8.0, 0.2 + 0.1 * 8.0], rel=1e-11)
    for end in (bed, run.bed):
        assert 0 not in contacts(end, law).pair // (len(bed.body) // 12)
    x, y = (bed.position[0] + 5e-4 * np.arange(1, 16_001)[:, None] * bed.velocity[0]).T
    fx, fy, torque = run.force.T
    taken = 5e-4 * np.array([fx.sum(), fy.sum(), (torque + x * fy - y * fx).sum()])
    assert abs(taken[:2]).max() > 1.0
    assert taken == pytest.approx(momenta(bed) - momenta(run.bed), rel=1e-9, abs=1e-10)


def test_sample_of_a_row_is_the_mean_over_its_steps():
    bed = with_driven(ring("disc"))
    each, mean = (advance(bed, SMOOTH, 1e-3, rows, 4000 // rows, watched=0) for rows in (4000, 40))
    assert mean.force == pytest.approx(each.force.reshape(40, 100, 3).mean(axis=1), abs=1e-12)
    assert mean.overlap == pytest.approx(each.overlap.reshape(40, 100).max(axis=1), abs=1e-15)
    assert mean.kinetic == pytest.approx(each.kinetic[99::100], rel=1e-13)
    assert mean.elastic == pytest.approx(each.elastic[99::100], rel=1e-13, abs=1e-15)


@pytest.mark.parametrize("contact", ["disc", "common normal"])
@pytest.mark.parametrize("wall", range(4))
def test_load_of_a_wall_over_time_is_the_momentum_it_gave(wall: int, contact: str):
    """A grain that bounces once, against m v (1 + e), and nothing on the other three."""
    toward = np.array([[-1.0, 0.0], [1.0, 0.0], [0.0, -1.0], [0.0, 1.0]])[wall]
    bed = grains([1.9 * toward], 1.0, [0.8 * toward], contact=contact, walls=(-3, 3, -3, 3))
    law = law_of(0.5)
    run = advance(bed, law, 1e-4, 3, 2500)
    given = run.load.sum(axis=0) * 0.25
    lost = bed.mass[0] * (bed.velocity - run.bed.velocity)[0] @ toward
    assert lost == pytest.approx(bed.mass[0] * 0.8 * 1.5, rel=1e-3)
    assert given == pytest.approx(np.where(np.arange(4) == wall, lost, 0.0), rel=1e-10)


def crowd() -> Bed:
    """Discs on a lattice in a box, that hardly touch and fly about."""
    rng = np.random.default_rng(0)
    place = np.stack(np.meshgrid(np.arange(6), np.arange(6)), axis=-1).reshape(-1, 2)
    velocity = rng.normal(size=(36, 2))
    return grains(1.99 * place, velocity=velocity, walls=(-1.0, 10.95, -1.0, 10.95))


@pytest.mark.parametrize("time_step", [1e-3, 0.01, 0.1, 1.0, 1e3, 1e100])
def test_step_too_large_never_passes_for_a_result(time_step: float):
    """FINE means numbers, inside, with their energy; a fiftieth of a collision is not too large."""
    bed = crowd()
    before = bed.kinetic_energy
    run = advance(bed, SMOOTH, time_step, 20, 50)
    assert run.status == FINE or time_step > 1e-3
    assert run.status != FINE or time_step < 0.1
    if run.status == FINE:
        assert np.isfinite(run.bed.position).all()
        assert (run.kinetic + run.elastic)[-1] == pytest.approx(before, rel=0.02)
    else:
        assert len(run.kinetic) < 20


def test_overlap_beyond_the_deepest_stops_the_run():
    """In the first row whose overlap is larger, at the depth given or where one is half-way in."""
    bed = grains([[0.0, 0.0], [2.1, 0.0]], velocity=[[0.0, 0.0], [-60.0, 0.0]])
    for deepest, settings in ((1.0, {}), (0.3, {"deepest": 0.3})):
        run = advance(bed, SMOOTH, 1e-4, 2000, **settings)
        assert run.status == TOO_DEEP
        assert run.overlap[-1] > deepest >= run.overlap[:-1].max()


def test_grain_beyond_a_wall_stops_the_run():
    """Where an overlap of more than its radius would be let pass, and for driven bodies."""
    for toward in ([1, 0], [-1, 0], [0, 1], [0, -1]):
        free = grains([[0.0, 0.0]], velocity=[toward], walls=(-2.5, 2.5, -2.5, 2.5))
        driven = replace(free, mass=np.array([np.inf]), inertia=np.array([np.inf]))
        for bed in (free, driven):
            run = advance(bed, SMOOTH, 1.4, 10, deepest=10.0)
            assert (run.status, len(run.kinetic)) == (ESCAPED, 2)


def test_place_that_is_no_number_stops_the_run():
    """Two discs at one place have no normal; others fly on and ask for new lists meanwhile."""
    still = grains([[0.0, 0.0], [0.0, 0.0], *[[5.0 + 3.0 * k, 5.0] for k in range(9)]])
    bed = replace(still, velocity=np.where(np.arange(11)[:, None] > 1, 10.0, 0.0) * np.ones(2))
    run = advance(bed, SMOOTH, 1e-3, 3, 400)
    assert run.status == NOT_FINITE
    assert len(run.kinetic) < 3
    assert np.isfinite(run.bed.position[2:]).all()


@pytest.mark.parametrize(
    "wrong", [{"time_step": 0.0}, {"time_step": -1.0}, {"time_step": float("nan")}, {"rows": -1}]
)
def test_runs_that_make_no_sense_are_refused(wrong: dict[str, float]):
    with pytest.raises(ValueError, match="no run of"):
        advance(crowd(), SMOOTH, **({"time_step": 1e-3, "rows": 1} | wrong))


def test_discs_that_are_none_are_refused():
    with pytest.raises(ValueError, match="no discs"):
        advance(grains([[0.0, 0.0]], [[2.0, 1.0]]), SMOOTH, 1e-3, 1)
