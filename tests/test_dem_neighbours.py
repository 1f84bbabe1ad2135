"""Neighbours, order, threads and packings against naive loops and against the same asked again."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from beds import clumps, grains, law_of

from liftdrag.dem import FINE, Bed, Law, Memory, advance, contacts, forces, grown

ROUGH = law_of(0.6, friction=0.5, reach=1.0, tangential_damping=0.8)


def joined(one: Bed, other: Bed) -> Bed:
    """The bodies of both, between the walls of the first."""
    names = "position velocity angle spin mass inertia semi_axes offset".split()
    both = {name: np.concatenate([getattr(one, name), getattr(other, name)]) for name in names}
    return replace(one, **both, body=np.concatenate([one.body, other.body + len(one.mass)]))


def mixture(kind: str) -> Bed:
    """150 small bodies about one of ten times their size, at uneven places, in a tight box."""
    rng = np.random.default_rng(21)
    place = np.stack(np.meshgrid(np.arange(20), np.arange(20)), axis=-1).reshape(-1, 2) * 1.5
    place = place[np.hypot(*(place - 14.0).T) > 10.5]
    place = place + rng.uniform(-0.15, 0.15, place.shape)
    count = len(place)
    moving = rng.normal(size=(count, 2)), rng.uniform(0.0, 7.0, count), rng.normal(size=count)
    walls = (-0.7, 29.2, -0.7, 29.2)
    if kind == "disc":
        small = grains(place, rng.uniform(0.5, 1.1, (count, 1)), *moving, walls=walls)
    else:
        offset = [[-0.25, -0.15], [0.3, 0.0], [0.0, 0.35]]
        small = clumps(place, offset, [0.45, 0.5, 0.35], *moving)
        small = replace(small, walls=walls)
    return joined(small, grains([[14.0, 14.2]], 9.8, [[0.3, -0.2]], 0.0, 0.1))


@pytest.fixture(scope="module", params=["disc", "clump"])
def rubbed(request: pytest.FixtureRequest) -> Bed:
    """The mixture after some steps, so that springs are stretched."""
    run = advance(mixture(request.param), ROUGH, 1e-4, 1, 60)
    assert run.status == FINE
    return run.bed


def cross(one: np.ndarray, other: np.ndarray) -> float:
    return float(one[0] * other[1] - one[1] * other[0])


def naive_contact(law: Law, numbers: Any, depth: float, speed: np.ndarray, stretch: float) -> Any:
    """Push and pull of a contact of effective radius and mass `numbers`; `speed` apart, across."""
    radius, mass = numbers
    spring = law.stiffness * np.sqrt(radius * depth)
    dashpot = law.damping * np.sqrt(1.5 * spring * mass)
    push = spring * depth - dashpot * speed[0]
    pull = law.tangential * spring * stretch + law.tangential_damping * dashpot * speed[1]
    limit = law.friction * abs(push)
    return push, np.clip(pull, -limit, limit)


def naive_forces(bed: Bed, law: Law) -> np.ndarray:
    """Every part with every part of another body and with every wall, one after the other."""
    total = np.zeros((len(bed.mass), 3))
    stretch = dict(zip(map(tuple, bed.memory.pair.tolist()), bed.memory.stretch, strict=True))
    wall_stretch = dict(
        zip(map(tuple, bed.memory.wall_pair.tolist()), bed.memory.wall_stretch, strict=True)
    )
    place, body, radius = bed.place, bed.body, bed.semi_axes[:, 0]
    arm = place - bed.position[body]
    spin, mass = bed.spin[body], bed.mass[body]
    velocity = bed.velocity[body] + spin[:, None] * np.column_stack([-arm[:, 1], arm[:, 0]])

    def act(part: int, push: np.ndarray, at: np.ndarray) -> None:
        total[body[part], :2] += push
        total[body[part], 2] += cross(at - bed.position[body[part]], push)

    for i in range(len(body)):
        for j in range(i + 1, len(body)):
            line = place[j] - place[i]
            distance = np.hypot(*line)
            depth = radius[i] + radius[j] - distance
            if body[i] == body[j] or depth <= 0.0:
                continue
            normal = line / distance
            across = np.array([-normal[1], normal[0]])
            reach = radius[[i, j]] - 0.5 * depth * (1.0 - law.reach)
            relative = velocity[j] - velocity[i]
            slip = relative @ across - spin[[i, j]] @ reach
            numbers = (
                radius[i] * radius[j] / (radius[i] + radius[j]),
                1.0 / (1.0 / mass[i] + 1.0 / mass[j]),
            )
            push, pull = naive_contact(
                law, numbers, depth, np.array([relative @ normal, slip]), stretch.get((i, j), 0.0)
            )
            at = place[i] + (radius[i] - 0.5 * depth) * normal
            act(i, -push * normal + pull * across, at)
            act(j, push * normal - pull * across, at)
        for wall in range(4):
            normal = np.array([[-1.0, 0.0], [1.0, 0.0], [0.0, -1.0], [0.0, 1.0]])[wall]
            room = abs(bed.walls[wall] - place[i, wall // 2])
            depth = radius[i] - room
            if depth <= 0.0 or np.isinf(mass[i]):
                continue
            across = np.array([-normal[1], normal[0]])
            reach = radius[i] - 0.5 * depth * (1.0 - law.reach)
            slip = -velocity[i] @ across - spin[i] * reach
            push, pull = naive_contact(
                law,
                (radius[i], mass[i]),
                depth,
                np.array([-velocity[i] @ normal, slip]),
                wall_stretch.get((i, wall), 0.0),
            )
            act(i, -push * normal + pull * across, place[i] + (radius[i] - 0.5 * depth) * normal)
            total[body[i], 2] += 0.5 * law.reach * depth * pull
    return total


@pytest.mark.parametrize("reach", [0.0, 1.0])
@pytest.mark.parametrize("driven", [False, True])
def test_forces_are_those_of_a_loop_over_all_pairs_and_walls(
    rubbed: Bed, reach: float, driven: bool
):
    """With a large intruder, damping, friction, spins and springs; with it free and driven."""
    law, bed = ROUGH._replace(reach=reach), rubbed
    if driven:
        last = np.arange(len(bed.mass)) == len(bed.mass) - 1
        heavy = {name: np.where(last, np.inf, getattr(bed, name)) for name in ("mass", "inertia")}
        bed = replace(bed, **heavy)
    expected, found = naive_forces(bed, law), forces(bed, law)
    stretched = abs(bed.memory.stretch) > 0.0
    assert stretched.sum() > 50
    assert (abs(bed.memory.wall_stretch) > 0.0).sum() > 20
    assert len(bed.body) - 1 in bed.memory.pair[stretched]
    assert abs(found - expected).max() < 1e-12 * abs(expected).max()


def test_pairs_in_contact_are_those_of_a_distance_matrix(rubbed: Bed):
    distance = np.hypot(*(rubbed.place[:, None] - rubbed.place).transpose(2, 0, 1))
    depth = rubbed.semi_axes[:, 0][:, None] + rubbed.semi_axes[:, 0] - distance
    touching = np.triu((depth > 0.0) & (rubbed.body[:, None] != rubbed.body))
    found = contacts(rubbed, ROUGH)
    order = np.lexsort(found.pair.T[::-1])
    assert np.array_equal(found.pair[order], np.argwhere(touching))
    assert found.depth[order] == pytest.approx(depth[touching], abs=1e-13)


def test_parts_of_one_body_never_push_each_other():
    bed = clumps([[0.0, 0.0], [9.0, 0.0]], [[-0.3, 0.0], [0.3, 0.0], [0.0, 0.2]], [0.5, 0.6, 0.7])
    assert len(contacts(bed, ROUGH).depth) == 0
    assert not forces(bed, ROUGH).any()
    run = advance(replace(bed, spin=np.array([1.0, -2.0])), ROUGH, 1e-3, 1, 500)
    assert run.elastic[0] == 0.0
    assert run.bed.spin.tolist() == [1.0, -2.0]


def differences(one: Bed, other: Bed) -> float:
    """The largest of place, velocity and spin; all are of order one."""
    names = ("position", "velocity", "spin")
    return max(float(abs(getattr(one, name) - getattr(other, name)).max()) for name in names)


@pytest.mark.parametrize("skin", [0.0, 0.05, 3.0])
def test_trajectory_does_not_depend_on_the_skin(rubbed: Bed, skin: float):
    usual, other = (advance(rubbed, ROUGH, 1e-4, 1, 300, skin=width) for width in (None, skin))
    assert other.rebuilt == {0.0: 300, 3.0: 0}.get(skin, other.rebuilt)
    assert skin != 0.05 or 2 <= other.rebuilt < 100
    assert differences(usual.bed, rubbed) > 0.01
    assert differences(usual.bed, other.bed) < 1e-12


def permuted(bed: Bed, order: np.ndarray) -> Bed:
    """The bodies, with their parts and their contacts, in another order.

    The normals that the search remembers lead from the first part to the second.
    """
    rank = np.argsort(order)
    parts = np.concatenate([np.flatnonzero(bed.body == body) for body in order])
    part_rank = np.argsort(parts)
    memory = bed.memory
    pair = part_rank[memory.pair]
    wall_part, wall = memory.wall_pair.T
    names = ("position", "velocity", "angle", "spin", "mass", "inertia")
    return replace(
        bed,
        **{name: getattr(bed, name)[order] for name in names},
        semi_axes=bed.semi_axes[parts],
        offset=bed.offset[parts],
        body=rank[bed.body[parts]],
        memory=replace(
            memory,
            pair=np.sort(pair, axis=1),
            search=np.where(pair[:, :1] > pair[:, 1:], -memory.search, memory.search),
            wall_pair=np.column_stack([part_rank[wall_part], wall]),
        ),
    )


def test_trajectory_does_not_depend_on_the_order_of_the_bodies(rubbed: Bed):
    order = np.random.default_rng(4).permutation(len(rubbed.mass))
    watched = int(np.argsort(order)[-1])
    given = advance(rubbed, ROUGH, 1e-4, 3, 100, watched=len(order) - 1)
    shuffled = advance(permuted(rubbed, order), ROUGH, 1e-4, 3, 100, watched=watched)
    assert differences(given.bed, permuted(shuffled.bed, np.argsort(order))) < 1e-12
    scale = abs(given.force).max()
    assert scale > 1.0
    assert abs(given.force - shuffled.force).max() < 1e-12 * scale
    assert given.load == pytest.approx(shuffled.load, rel=1e-12)


def ellipses() -> Bed:
    """64 ellipses that push each other, in rows; within a run they stand in another order."""
    rng = np.random.default_rng(6)
    place = np.stack(np.meshgrid(np.arange(8), np.arange(8)), axis=-1).reshape(-1, 2) * 2.0
    moving = rng.normal(size=(64, 2)), rng.uniform(0.0, 7.0, 64), rng.normal(size=64)
    bed = grains(rng.permutation(place), [1.6, 0.9], *moving, contact="common normal")
    return advance(bed, ROUGH, 1e-4, 1, 30).bed


def test_normals_remembered_of_ellipses_lead_from_the_first_to_the_second():
    """Against the normals of a bed without memory."""
    bed = ellipses()
    found = contacts(replace(bed, memory=Memory()), ROUGH)
    normals = dict(zip(map(tuple, bed.memory.pair.tolist()), bed.memory.search, strict=True))
    remembered = np.array([normals[tuple(pair)] for pair in found.pair.tolist()])
    assert len(remembered) > 50
    assert abs(remembered - found.normal).max() < 1e-6


def test_ellipses_in_another_order_move_alike():
    """What the search remembers of a pair is turned round with it.

    The contact point is taken from the first of a pair: its last, Taylor's, step leaves out 1e-8.
    """
    bed, order = ellipses(), np.random.default_rng(7).permutation(64)
    given, shuffled = (advance(b, ROUGH, 1e-4, 1, 200).bed for b in (bed, permuted(bed, order)))
    assert differences(given, permuted(shuffled, np.argsort(order))) < 1e-7


def same_bits(one: Bed, other: Bed) -> bool:
    names = ("position", "velocity", "angle", "spin")
    states = all(np.array_equal(getattr(one, name), getattr(other, name)) for name in names)
    return states and np.array_equal(one.memory.stretch, other.memory.stretch)


def test_same_call_gives_the_same_bits_and_leaves_the_bed_as_it_was(rubbed: Bed):
    before = replace(rubbed, **{n: getattr(rubbed, n).copy() for n in ("position", "velocity")})
    one, two = (advance(rubbed, ROUGH, 1e-4, 2, 100, watched=0) for _ in range(2))
    assert same_bits(one.bed, two.bed)
    assert np.array_equal(one.force, two.force)
    assert np.array_equal(one.load, two.load)
    assert same_bits(before, rubbed)
    assert np.array_equal(forces(rubbed, ROUGH), forces(rubbed, ROUGH))


def test_two_threads_give_the_same_bits_twice_and_what_one_thread_gives():
    bed = advance(mixture("disc"), ROUGH, 1e-4, 1, 60).bed
    alone = advance(bed, ROUGH, 1e-4, 3, 100, watched=0)
    one, two = (advance(bed, ROUGH, 1e-4, 3, 100, watched=0, threads=2) for _ in range(2))
    assert same_bits(one.bed, two.bed)
    assert np.array_equal(one.load, two.load)
    assert alone.rebuilt >= 2
    assert differences(one.bed, alone.bed) < 1e-9
    for name in ("load", "kinetic", "elastic", "overlap", "force"):
        ours, theirs = getattr(one, name), getattr(alone, name)
        assert abs(ours - theirs).max() < 1e-9 * max(abs(theirs).max(), 1.0)


@pytest.mark.parametrize("walls", [(-np.inf, np.inf) * 2, (-1e5, 1e5) * 2])
def test_two_grains_in_a_huge_empty_box_meet_without_delay(walls: Any):
    """Ten thousand radii apart on a diagonal, thrown at each other, lists made in every step."""
    law = law_of()
    far = 5e3 / np.sqrt(2.0)
    bed = grains([[-far, -far], [far, far]], velocity=[[4.0, 4.0], [-4.0, -4.0]], walls=walls)
    advance(bed, law, 1e-3, 1)
    start = time.process_time()
    run = advance(bed, law, 0.2, 1, 4400)
    assert run.rebuilt == 4400
    near = advance(run.bed, law, 2e-4, 1, 40_000)
    assert time.process_time() - start < 2.0
    assert abs(run.bed.position).max() < 20.0
    assert near.status == FINE
    assert near.bed.velocity == pytest.approx(-bed.velocity, rel=1e-3)


SIDE = {"disc": 18.2, "dumbbell": 16.3, "ellipse": 18.2}
"""Sides of boxes that 90 grains and a driven disc fill to some 95 %."""


def unpacked(kind: str, side: float) -> Bed:
    """Grains, all at one place, and a driven disc that comes first, in a square box."""
    rng = np.random.default_rng(1)
    walls, middle = (0.0, side, 0.0, side), np.full((90, 2), 0.5 * side)
    width = rng.uniform(0.8, 1.2, (90, 1))
    if kind == "disc":
        free = grains(middle, width, walls=walls)
    elif kind == "dumbbell":
        free = clumps(middle, [[-0.35, 0.0], [0.35, 0.0]], [0.7, 0.7], walls=walls)
    else:
        axes = width * [1.5**0.5, 1.5**-0.5]
        free = grains(middle, axes, contact="common normal", walls=walls)
    still = grains([[0.4 * side, 0.6 * side]], 3.0, angle=0.3, contact=free.contact, walls=walls)
    driven = replace(still, mass=np.array([np.inf]), inertia=np.array([np.inf]))
    return joined(driven, free)


def packed(kind: str, seed: int = 1) -> Bed:
    return grown(unpacked(kind, SIDE[kind]), law_of(0.5), 2e-3, 5.0, seed)


@pytest.mark.parametrize("kind", ["disc", "dumbbell", "ellipse"])
def test_packing_is_at_rest_between_its_walls_about_the_driven_body(kind: str):
    """Net forces on the free bodies against the mean force of a contact; it does hold together."""
    bed = packed(kind)
    smooth = law_of(0.5)
    touching = contacts(bed, smooth)
    assert len(touching.depth) > 100
    assert touching.depth.max() < 0.4
    one, other = bed.radius[touching.pair].T
    push = smooth.stiffness * np.sqrt(one * other / (one + other)) * touching.depth**1.5
    assert np.hypot(*forces(bed, smooth)[1:, :2].T).max() < 0.005 * push.mean()
    assert not bed.velocity.any()
    assert not bed.spin.any()
    assert len(bed.memory.pair) == 0
    assert (bed.place > 0.0).all()
    assert (bed.place < SIDE[kind]).all()
    before = unpacked(kind, SIDE[kind])
    assert bed.semi_axes == pytest.approx(before.semi_axes, rel=1e-12)
    assert bed.offset == pytest.approx(before.offset, rel=1e-12)
    assert np.array_equal(bed.position[0], before.position[0])
    assert bed.angle[0] == 0.3


def test_packing_of_a_seed_has_its_bits_and_of_another_other_places():
    one, same, other = packed("disc", 1), packed("disc", 1), packed("disc", 2)
    assert same_bits(one, same)
    assert abs(one.position - other.position)[1:].mean() > 1.0


def test_packing_leaves_a_driven_body_with_a_speed_where_it_is():
    """Its speed is for later: it does not plough through the grains as they grow."""
    bed = unpacked("disc", 20.0)
    moving = replace(bed, velocity=np.where(np.arange(91)[:, None] == 0, [0.5, 0.0], 0.0))
    assert grown(moving, law_of(0.5), 2e-3, 5.0, 1).position[0].tolist() == [8.0, 12.0]


@pytest.mark.parametrize("side", [9.0, 13.0])
def test_grains_that_cannot_fit_are_refused(side: float):
    """Neither where half the size has no room, nor where the full size has not."""
    with pytest.raises(ValueError, match="do not fit into the box"):
        grown(unpacked("disc", side), law_of(0.5), 2e-3, 5.0, 1)


def test_erased_memory_is_no_memory():
    """A bed that never moved and one that forgot have the same forces: those of no stretch."""
    bed = advance(mixture("disc"), ROUGH, 1e-4, 1, 60).bed
    forgot = replace(bed, memory=Memory())
    assert abs(forces(forgot, ROUGH) - naive_forces(forgot, ROUGH)).max() < 1e-9
    assert abs(forces(bed, ROUGH) - forces(forgot, ROUGH)).max() > 1.0
