"""Spheres that meet each other, the piston and the tube, against closed forms of three laws."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from math import cos, pi, sin, sqrt
from typing import Any

import numpy as np
import pytest

from liftdrag.dem import (
    ESCAPED,
    FINE,
    NOT_FINITE,
    TOO_DEEP,
    Column,
    Law,
    TubeWalls,
    fall,
    hertz_mindlin,
    linear_spring,
    touching,
    walton_braun,
)

STIFFNESS, MODULUS, POISSON = 1e6, 1e7, 0.3
"""Lengths and masses are of order one."""

TANGENTIAL = 2.0 / 7.0
"""Tangential over normal stiffness of linear springs."""

HEAVY = 1e20
"""Mass of a sphere that moves as it is told."""

FAR = 1e3
"""Radius of a tube that nothing is near."""

LAWS = ["linear", "hertz", "walton-braun"]
each_law = pytest.mark.parametrize("name", LAWS)
each_reach = pytest.mark.parametrize("reach", [0.0, 1.0])


def law_of(name: str, restitution: float = 1.0, friction: float = 0.0, reach: float = 0.0) -> Law:
    """A law of these grains by its name in a case."""
    if name == "hertz":
        return hertz_mindlin(MODULUS, POISSON, restitution, friction, reach)
    if name == "linear":
        return linear_spring(STIFFNESS, restitution, friction, TANGENTIAL, reach)
    return walton_braun(STIFFNESS, restitution, friction, reach)


def column_of(
    position: Any,
    velocity: Any = 0.0,
    spin: Any = 0.0,
    radius: Any = 1.0,
    mass: Any = 1.0,
    upright: Any = False,
    walls: TubeWalls | None = None,
    gravity: float = 0.0,
) -> Column:
    """Spheres of these places, and of these numbers each or all."""
    position = np.array(position, float).reshape(-1, 3)
    count = len(position)
    return Column(
        position,
        np.array(velocity * np.ones((count, 3))),
        np.array(spin * np.ones((count, 3))),
        np.array(radius * np.ones(count)),
        np.array(mass * np.ones(count)),
        np.array(upright | np.zeros(count, bool)),
        walls or TubeWalls(FAR, 0.0, 0.0, 0.0),
        gravity,
    )


def spring_of(name: str, radius: float) -> tuple[float, float]:
    """Factor and power of the overlap in the push, at an effective radius."""
    if name == "hertz":
        return 2.0 / 3.0 * MODULUS / (1.0 - POISSON**2) * sqrt(radius), 1.5
    return STIFFNESS, 1.0


def depth_under(name: str, push: float, radius: float = 1.0) -> float:
    """The overlap at which a contact that was never deeper has this push."""
    factor, power = spring_of(name, radius)
    return float((push / factor) ** (1.0 / power))


# Head-on: a pair, one on the piston, and one on the tube, at each of four speeds.

SPEEDS = np.array([0.01, 0.1, 1.0, 10.0])
NORMAL = np.array([1.0, 2.0, 2.0]) / 3.0
OUTWARD = np.array([cos(0.7), sin(0.7), 0.0])
ON_PISTON, ON_TUBE, ONE, OTHER = (np.arange(4) + 4 * kind for kind in range(4))


def head_on() -> Column:
    """Sixteen spheres, each about to meet something at one of the speeds."""
    k, gap = np.arange(4)[:, None], 1e-12
    up = np.array([0.0, 0.0, 10.0])
    one = 40.0 * up / 10.0 + k * up
    position = [
        k * [10.0, 0.0, 0.0] + [0.0, 0.0, 1.0 + gap],
        (99.0 - gap) * OUTWARD + (k + 1.0) * up,
        one,
        one + (1.6 + gap) * NORMAL,
    ]
    toward = [-up / 10.0, OUTWARD, 0.0 * NORMAL, -NORMAL]
    return column_of(
        np.concatenate(position),
        np.concatenate([SPEEDS[:, None] * way for way in toward]),
        radius=np.repeat([1.0, 1.0, 1.0, 0.6], 4),
        mass=np.repeat([1.0, 0.7, 2.0, 0.5], 4),
        walls=TubeWalls(100.0, 0.0, 0.0, 0.0),
    )


@pytest.mark.parametrize("restitution", [0.2, 0.6, 0.9, 1.0])
@each_law
def test_spheres_part_with_the_restitution_asked_for_at_any_speed(name: str, restitution: float):
    """And what the walls take is the momentum that they gave, m v (1 + e)."""
    column, step, close = head_on(), 1e-6, 1e-5 if name == "walton-braun" else 1e-3
    run = fall(column, law_of(name, restitution), step, 4, 10_000)
    assert run.status == FINE
    assert run.elastic[-1] == 0.0
    before, after = column.velocity, run.column.velocity
    parted = after[OTHER] - after[ONE]
    given = SPEEDS * restitution
    assert after[ON_PISTON, 2] == pytest.approx(given, rel=close)
    assert after[ON_TUBE] @ OUTWARD == pytest.approx(-given, rel=close)
    assert parted @ NORMAL == pytest.approx(given, rel=close)
    for off, normal in (
        (after[ON_PISTON], np.array([0.0, 0.0, 1.0])),
        (after[ON_TUBE], OUTWARD),
        (parted, NORMAL),
    ):
        assert abs(off - np.outer(off @ normal, normal)).max() < 1e-11
    momentum = 2.0 * after[ONE] + 0.5 * after[OTHER]
    assert momentum == pytest.approx(0.5 * before[OTHER], rel=1e-11)
    assert not run.column.spin.any()
    time = 10_000 * step
    lost = (after[ON_PISTON, 2] - before[ON_PISTON, 2]).sum()
    assert time * run.piston.sum() == pytest.approx(lost, rel=1e-9)
    lost = 0.7 * ((before - after)[ON_TUBE] @ OUTWARD).sum()
    assert time * run.wall_normal.sum() == pytest.approx(lost, rel=1e-9)
    assert not run.tube.any()


@pytest.mark.parametrize("restitution", [0.2, 0.6, 0.9])
def test_restitution_of_latching_springs_comes_with_an_error_of_second_order(restitution: float):
    """Below a tenth of the square of the step over sqrt(m/K2), at steps from 1/5 of that on.

    Root mean square over a hundred spheres that meet the piston at any moment of a step.
    """
    step, place = 4e-5, 4.0 * np.column_stack([*np.divmod(np.arange(100), 10), np.zeros(100)])
    place[:, 2] = 1.0 + step * np.random.default_rng(2).random(100)
    column, law = column_of(place, [0.0, 0.0, -1.0]), law_of("walton-braun", restitution)
    for fold in (1, 2, 4, 8, 16):
        parted = fall(column, law, step / fold, 1, 250 * fold).column.velocity[:, 2]
        error = sqrt(((parted / restitution - 1.0) ** 2).mean())
        assert error < 0.1 * (step / fold / (restitution / sqrt(STIFFNESS))) ** 2


# Frozen contacts: heavy spheres on the piston, on the tube, and one with another.

FRICTION = np.array([0.4, 0.3, 0.5])
"""Of the piston, the tube, and the pair."""

PAIR_RADIUS = 1.0 * 0.6 / 1.6
PISTON_SPHERE, TUBE_SPHERE, FIRST, SECOND = range(4)


def frozen(depth: float = 0.0) -> Column:
    """A sphere on the piston, one on the tube where x is largest, two on a line along x."""
    position = [
        [0.0, 0.0, 1.0 - depth],
        [99.0 + depth, 0.0, 50.0],
        [0.0, 0.0, 20.0],
        [1.6 - depth, 0.0, 20.0],
    ]
    walls = TubeWalls(100.0, 0.0, FRICTION[1], FRICTION[0])
    return column_of(position, radius=[1.0, 1.0, 1.0, 0.6], mass=HEAVY, walls=walls)


def met(column: Column, law: Law) -> tuple[np.ndarray, np.ndarray]:
    """Push (3,) and pull (3, 3) of the frozen contacts: piston, tube, pair; zero where apart."""
    between, walls = touching(column, law)
    push, pull = np.zeros(3), np.zeros((3, 3))
    for kind, found in ((np.full(len(between.push), 2), between), (1 - walls.pair[:, 1], walls)):
        push[kind], pull[kind] = found.push, found.pull
    return push, pull


def moved_in(column: Column, speed: float) -> Column:
    """The frozen contacts, moved so that all become deeper at a speed."""
    way = np.array([[0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    walls = column.walls._replace(lift=0.0)
    return replace(column, velocity=speed * way, spin=np.zeros((4, 3)), walls=walls)


def slipping(column: Column, along: Any, across: Any = 0.0) -> Column:
    """The same with slips (3,) of these speeds, of what is touched over the sphere.

    `along` is x on the piston, z on the tube and in the pair; `across` is y.
    """
    along, across = along * np.ones(3), across * np.ones(3)
    velocity, spin = np.zeros((4, 3)), np.zeros((4, 3))
    velocity[PISTON_SPHERE] = [-along[0], -across[0], 0.0]
    spin[TUBE_SPHERE, 2] = -across[1] / (100.0 - column.position[TUBE_SPHERE, 0])
    arm = 0.6 - 0.5 * (1.6 - (column.position[SECOND] - column.position[FIRST])[0])
    spin[SECOND] = [0.0, along[2] / arm, -across[2] / arm]
    walls = column.walls._replace(lift=float(along[1]))
    return replace(column, velocity=velocity, spin=spin, walls=walls)


ALONG = (np.arange(3), np.array([0, 2, 2]))
"""Where the pulls of the frozen contacts have their part along."""


def test_latching_contact_follows_its_lines_and_never_attracts():
    """Against K1 a where it never was deeper, else K2 (a - a0), not below zero.

    Reloaded before and beyond the deepest point, drawn out past a0, drawn off, pressed again.
    """
    law, step = law_of("walton-braun", 0.6), 1e-5
    latched, column, depth, deepest = STIFFNESS / 0.36, frozen(), 0.0, 0.0
    seen = np.zeros(4, int)
    for way, steps in (
        (1, 8),
        (-1, 3),
        (1, 2),
        (1, 7),
        (-1, 11),
        (1, 6),
        (-1, 14),
        (1, 4),
        (-1, 2),
    ):
        for _ in range(steps):
            column = fall(moved_in(column, way * 100.0), law, step, 1).column
            depth += way * 1e-3
            deepest = max(deepest, depth) if depth > 1e-9 else 0.0
            expected = STIFFNESS * max(depth, 0.0)
            if depth < deepest - 1e-9:
                expected = max(latched * (depth - 0.64 * deepest), 0.0)
            seen += [depth < 1e-9, 0.0 == expected < depth - 1e-9, deepest > depth + 1e-9, way > 0]
            push, pull = met(column, law)
            assert push == pytest.approx(np.full(3, expected), rel=1e-8, abs=1e-6)
            assert not pull.any()
    assert seen.min() > 2


@pytest.mark.parametrize("skin", [0.0, 0.5])
@each_law
def test_contact_that_parted_forgets(name: str, skin: float):
    """Pressed and rubbed, drawn off and pressed half as deep: as one that never touched.

    Whether the lists are made anew, or still have the pair while it is apart.
    """
    law, step = law_of(name, 1.0 if name != "walton-braun" else 0.6, FRICTION[2]), 1e-5
    rubbed = fall(slipping(frozen(0.01), 0.01), law, step, 1, 100, skin=skin).column
    assert abs(met(rubbed, law)[1][ALONG]).min() > 1.0
    away = fall(moved_in(rubbed, -20.0), law, step, 1, 100, skin=skin).column
    assert not met(away, law)[0].any()
    again = fall(moved_in(away, 20.0), law, step, 1, 75, skin=skin).column
    fresh = fall(frozen(0.005), law, step, 1, 1, skin=skin).column
    push, pull = met(again, law)
    assert push == pytest.approx(met(fresh, law)[0], rel=1e-8)
    assert abs(pull).max() < 1e-9


def unit(name: str, depth: float, friction: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Largest drag of the frozen contacts, and the slip at which a spring alone had it."""
    spring = np.array([spring_of(name, radius)[0] for radius in (1.0, 1.0, PAIR_RADIUS)])
    push = spring * depth ** spring_of(name, 1.0)[1]
    shear = MODULUS / (2.0 * (1.0 + POISSON)) / (2.0 * (2.0 - POISSON))
    stiffness = {
        "linear": TANGENTIAL * STIFFNESS * np.ones(3),
        "hertz": 8.0 * shear * np.sqrt(np.array([1.0, 1.0, PAIR_RADIUS]) * depth),
        "walton-braun": 0.8 * STIFFNESS * np.ones(3),
    }[name]
    return friction * push, friction * push / stiffness


def gradual(strokes: list[float]) -> list[float]:
    """Drags over their limit after strokes in units of the slip, in the limit of small steps.

    With u = (T - T*)/(mu N - T*), (1 - u)^(2/3) falls by 2/3 K0 ds/(mu N - T*); T* is where
    the drag turned last, and both signs of it are alike.
    """
    drag, turned, way, found = 0.0, 0.0, 1.0, []
    for stroke in strokes:
        if stroke * way < 0.0:
            turned, way = drag, -way
        room = 1.0 - way * turned
        left = (1.0 - way * (drag - turned) / room) ** (2.0 / 3.0)
        left = max(left - 2.0 / 3.0 * abs(stroke) / room, 0.0)
        drag = turned + way * room * (1.0 - left**1.5)
        found.append(drag)
    return found


def slider(strokes: list[float]) -> list[float]:
    """The same of a spring in series with a slider."""
    drag, found = 0.0, []
    for stroke in strokes:
        drag = min(max(drag + stroke, -1.0), 1.0)
        found.append(drag)
    return found


def drags(name: str, strokes: list[float], steps: int, sign: float = 1.0) -> np.ndarray:
    """Drags (s, 3) of the frozen contacts over their limits, each stroke in so many steps."""
    law, depth, step = law_of(name, friction=FRICTION[2]), 0.01, 1e-6
    if name == "walton-braun":
        law = law_of(name, 0.6, FRICTION[2])
    limit, slip = unit(name, depth, FRICTION)
    column, found = frozen(depth), []
    for stroke in strokes:
        column = slipping(column, sign * stroke * slip / (steps * step))
        column = fall(column, law, step, 1, steps).column
        found.append(met(column, law)[1][ALONG] / limit)
    return np.array(found)


STROKES = [0.5, -0.3, 0.4, 0.2, -0.25, -0.9, -0.2, 0.15, -0.1, 1.0, -0.2, 0.3]
"""None comes near the limit, three pass through zero."""


def test_drag_of_latching_contacts_converges_to_the_closed_form_in_first_order():
    expected = np.array(gradual(STROKES))
    assert (np.diff(np.sign(expected)) != 0.0).sum() >= 2
    assert abs(expected).max() < 0.95
    folds = (50, 100, 200, 400)
    errors = [abs(drags("walton-braun", STROKES, n) - expected[:, None]).max() for n in folds]
    assert errors[-1] < 2e-3
    assert np.log2(errors[0] / errors[-1]) / 3.0 == pytest.approx(1.0, abs=0.1)


def test_drag_of_springs_is_that_of_a_slider_in_series():
    strokes = [*STROKES, 3.0, -0.5, -8.0, 0.7]
    for name in ("linear", "hertz"):
        expected = np.array(slider(strokes))[:, None] * np.ones(3)
        assert drags(name, strokes, 10) == pytest.approx(expected, abs=1e-9)


@each_law
def test_drag_of_full_sliding_is_the_limit_to_rounding(name: str):
    found = drags(name, [3.0, -8.0, 0.1, 9.0], 40)
    assert found[[0, 1, 3]] == pytest.approx(np.outer([1.0, -1.0, 1.0], np.ones(3)), rel=1e-12)
    assert abs(found[2]).max() < 1.0


@each_law
def test_drag_is_the_same_both_ways(name: str):
    strokes = [*STROKES, 3.0, -0.5]
    assert drags(name, strokes, 20, -1.0) == pytest.approx(-drags(name, strokes, 20), rel=1e-12)


def test_slip_across_the_drag_meets_the_first_stiffness():
    """In one step, along the drag and across: K0 (1 - T/(mu N))^(1/3) and K0."""
    law, depth, step = law_of("walton-braun", 0.6, FRICTION[2]), 0.01, 1e-6
    limit, slip = unit("walton-braun", depth, FRICTION)
    column = fall(slipping(frozen(depth), 0.6 * slip / (200 * step)), law, step, 1, 200).column
    before = met(column, law)[1]
    share = before[ALONG] / limit
    assert share == pytest.approx(np.full(3, gradual([0.6])[0]), abs=2e-3)
    for along in (0.0, 0.01):
        turned = slipping(column, along * slip / step, 0.02 * slip / step)
        after = met(fall(turned, law, step, 1).column, law)[1]
        pulled = limit * (share + along * (1.0 - share) ** (1.0 / 3.0))
        assert after[ALONG] == pytest.approx(pulled, rel=1e-9)
        assert after[:, 1] == pytest.approx(0.02 * limit, rel=1e-9)


@each_law
def test_drag_of_full_sliding_turns_to_the_slip(name: str):
    """After sliding along, by slips across: mu N (1/cosh s, tanh s), in units of the slip.

    In small steps; and along the slip to rounding after a few that are large.
    """
    law, depth, step = law_of(name, 1.0, FRICTION[2]), 0.01, 1e-6
    limit, slip = unit(name, depth, FRICTION)
    slid = fall(slipping(frozen(depth), 3.0 * slip / (40 * step)), law, step, 1, 40).column
    for way in (0.5, 2.0):
        turning = slipping(slid, 0.0, way * slip / (1000 * step))
        pull = met(fall(turning, law, step, 1, 1000).column, law)[1]
        assert pull[ALONG] / limit == pytest.approx(np.full(3, 1.0 / np.cosh(way)), abs=2e-3)
        assert pull[:, 1] / limit == pytest.approx(np.full(3, np.tanh(way)), abs=2e-3)
    for along, across in ((0.0, 20.0), (30.0, 20.0)):
        turned = slipping(slid, along * slip / step, across * slip / step)
        pull = met(fall(turned, law, step, 1, 30).column, law)[1]
        size = np.hypot(along, across)
        assert pull[ALONG] / limit == pytest.approx(np.full(3, along / size), abs=1e-9)
        assert pull[:, 1] / limit == pytest.approx(np.full(3, across / size), abs=1e-9)


@each_law
def test_drag_is_cut_where_the_push_becomes_less(name: str):
    """Full sliding along and across, then drawn half-way out: mu N again, the same way."""
    law = law_of(name, 0.9 if name == "walton-braun" else 1.0, FRICTION[2])
    rubbed = slipping(frozen(0.01), 1.2e4, 0.9e4)
    rubbed = fall(rubbed, law, 1e-5, 1, 10).column
    drawn = fall(moved_in(rubbed, -5.0), law, 1e-5, 1, 100).column
    for column in (rubbed, drawn):
        push, pull = met(column, law)
        assert push.min() > 0.0
        assert pull[ALONG] == pytest.approx(0.8 * FRICTION * push, rel=1e-9)
        assert pull[:, 1] == pytest.approx(0.6 * FRICTION * push, rel=1e-9)


def about_axis(angle: float) -> np.ndarray:
    """The turn about z."""
    return np.array(
        [[cos(angle), -sin(angle), 0.0], [sin(angle), cos(angle), 0.0], [0.0, 0.0, 1.0]]
    )


@each_law
def test_drag_turns_with_its_contact_and_keeps_its_size(name: str):
    """The frozen spheres carried about the axis in a hundred turns, with a drag across it.

    A drag that has a part along the axis too is across each normal, and as large.
    """
    law, turn = law_of(name, 1.0, FRICTION[2]), about_axis(0.01)
    _, slip = unit(name, 0.01, FRICTION)
    for along in (0.0, 0.3):
        start = fall(slipping(frozen(0.01), along * slip / 1e-5, 0.4 * slip / 1e-5), law, 1e-5, 1)
        column = slipping(start.column, 0.0)
        before, expected = met(column, law)[1], about_axis(1.0)
        for _ in range(100):
            column = replace(column, position=column.position @ turn.T)
            column = fall(column, law, 1e-5, 1).column
        after = met(column, law)[1]
        size = np.linalg.norm(before, axis=1)
        assert size.min() > 1.0
        assert np.linalg.norm(after, axis=1)[1:] == pytest.approx(size[1:], rel=1e-10)
        assert abs(after[1:] @ expected[:, 0]).max() < 1e-9 * size.max()
        if along == 0.0:
            assert after[1:] == pytest.approx(before[1:] @ expected.T, abs=1e-9 * size.max())


# One or two spheres in motion.

GRAVITY = 10.0


def resting(name: str, reach: float = 0.0, push: float = GRAVITY) -> tuple[Column, float]:
    """A sphere that the piston bears, and the arm of the friction there."""
    depth = depth_under(name, push)
    walls = TubeWalls(FAR, 0.0, 0.9, 0.3)
    return column_of([3.0, 4.0, 1.0 - depth], walls=walls, gravity=push), 1.0 - (
        1.0 - reach
    ) * depth


@each_law
def test_sphere_rests_where_the_spring_bears_it(name: str):
    """At an overlap of m g/k, or (m g/k)^(2/3) for Hertz."""
    column, _ = resting(name)
    law = law_of(name, 0.6)
    run = fall(column, law, 2e-5, 10, 500)
    assert run.piston == pytest.approx(np.full(10, GRAVITY), rel=1e-8)
    assert run.column.position == pytest.approx(column.position, abs=1e-13)
    assert touching(run.column, law)[1].depth == pytest.approx(
        [depth_under(name, GRAVITY)], rel=1e-8
    )


@each_reach
@each_law
def test_sphere_sliding_on_the_piston_slows_and_turns_as_coulomb_has_it(name: str, reach: float):
    """By mu g and 5 mu g/(2 R), each over the second of two halves."""
    column, arm = resting(name, reach)
    law, way = (
        law_of(name, 0.6 if name == "walton-braun" else 1.0, 0.7, reach),
        np.array([0.6, 0.8]),
    )
    half = fall(replace(column, velocity=np.array([[*(5.0 * way), 0.0]])), law, 2e-5, 1, 2000)
    run = fall(half.column, law, 2e-5, 1, 2000)
    slowed = (run.column.velocity - half.column.velocity)[0]
    assert slowed == pytest.approx([*(-0.3 * GRAVITY * 0.04 * way), 0.0], rel=1e-9, abs=1e-11)
    turned = 2.5 * 0.3 * GRAVITY * arm * 0.04
    spun = (run.column.spin - half.column.spin)[0]
    assert spun == pytest.approx([-0.8 * turned, 0.6 * turned, 0.0], rel=1e-9, abs=1e-11)
    assert half.column.velocity[0, :2] == pytest.approx((5.0 - 0.12) * way, rel=1e-3)


@each_law
def test_sliding_sphere_rolls_at_last_at_five_sevenths_of_its_speed(name: str):
    """Its angular momentum about the line of contact is kept all the while."""
    column, arm = resting(name)
    law = law_of(name, 0.3, 0.7)
    start = replace(column, velocity=np.array([[1.0, 0.0, 0.0]]))
    for steps in (500, 20_000):
        after = fall(start, law, 2e-5, 1, steps).column
        speed, spin = after.velocity[0, 0], after.spin[0, 1]
        assert speed + 0.4 * spin / arm == pytest.approx(1.0, rel=1e-10)
        assert (speed > 0.9) == (steps == 500)
    assert speed == pytest.approx(5.0 / 7.0, rel=2e-3)
    assert spin == pytest.approx(5.0 / 7.0, rel=5e-3)


@each_reach
@each_law
def test_tube_that_slides_along_spheres_lifts_and_turns_them(name: str, reach: float):
    """Two, pressed by each other against it: by mu_w N/m, and 5 mu_w N/(2 m R) either way.

    Where they touch each other they do not slip.
    """
    push = 10.0
    deep, between = depth_under(name, push), depth_under(name, push, 0.5)
    away = 1.0 - 0.5 * between
    walls = TubeWalls(away + 1.0 - deep, 8.0, 0.3, 0.9)
    way = np.array([0.6, 0.8, 0.0])
    column = column_of([away * way + [0, 0, 9], -away * way + [0, 0, 9]], walls=walls)
    law = law_of(name, 0.6 if name == "walton-braun" else 1.0, 0.7, reach)
    half = fall(column, law, 2e-5, 1, 2000)
    run = fall(half.column, law, 2e-5, 1, 2000)
    assert run.wall_normal[0] == pytest.approx(2.0 * push, rel=1e-8)
    assert run.tube[0] == pytest.approx(2.0 * 0.3 * push, rel=1e-8)
    lifted = (run.column.velocity - half.column.velocity)[:, 2]
    assert lifted == pytest.approx(np.full(2, 0.3 * push * 0.04), rel=1e-8)
    turned = 2.5 * 0.3 * push * (1.0 - (1.0 - reach) * deep) * 0.04
    spun = run.column.spin - half.column.spin
    axis = np.array([0.8, -0.6, 0.0])
    assert spun == pytest.approx(turned * np.array([axis, -axis]), rel=1e-7, abs=1e-9)


@each_law
def test_oblique_collision_has_the_impulses_of_coulomb(name: str):
    """All the while sliding: mu (1 + e) m* v along, and its moment, on piston, tube and pair."""
    restitution = 0.5 if name == "walton-braun" else 1.0
    law, speed, gap = law_of(name, restitution, 0.1), 0.5, 1e-9
    walls = TubeWalls(100.0, 0.0, 0.15, 0.2)
    position = [
        [0.0, 0.0, 1.0 + gap],
        [0.0, 99.0 - gap, 50.0],
        [0.0, 0.0, 20.0],
        [1.6 + gap, 0.0, 20.0],
    ]
    velocity = [[2.0, 0.0, -speed], [0.0, speed, 2.0], [0.0, 0.0, 0.0], [-speed, 0.0, 0.0]]
    spin = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, -3.0]])
    masses = np.array([1.0, 1.0, 2.0, 0.5])
    column = column_of(position, velocity, spin, [1.0, 1.0, 1.0, 0.6], masses, walls=walls)
    after = fall(column, law, 1e-6, 1, 12_000).column
    gained = after.velocity - column.velocity
    bounce = (1.0 + restitution) * speed
    assert gained[0] == pytest.approx([-0.2 * bounce, 0.0, bounce], rel=1e-4, abs=1e-12)
    assert gained[1] == pytest.approx([0.0, -bounce, -0.15 * bounce], rel=1e-4, abs=1e-12)
    given = 0.4 * bounce
    assert 2.0 * gained[2] == pytest.approx([-given, 0.1 * given, 0.0], rel=1e-3, abs=1e-12)
    assert 0.5 * gained[3] == pytest.approx([given, -0.1 * given, 0.0], rel=1e-3, abs=1e-12)
    spun = after.spin - spin
    assert spun[0] == pytest.approx([0.0, 2.5 * 0.2 * bounce, 0.0], rel=2e-3)
    assert spun[1] == pytest.approx([-2.5 * 0.15 * bounce, 0.0, 0.0], rel=2e-3)
    assert spun[2] == pytest.approx([0.0, 0.0, 0.1 * given / 0.8], rel=2e-3)
    assert spun[3] == pytest.approx([0.0, 0.0, 0.1 * given / 0.12], rel=2e-3)


# Clusters.


def cluster(seed: int = 3) -> Column:
    """Twelve spheres that fly inward from a sphere about (0, 0, 20) and spin."""
    rng = np.random.default_rng(seed)
    k = np.arange(12)
    high = 1.0 - (2.0 * k + 1.0) / 12.0
    place = np.column_stack([np.cos(2.4 * k), np.sin(2.4 * k), high])
    place[:, :2] *= np.sqrt(1.0 - high**2)[:, None]
    velocity = 0.4 * rng.normal(size=(12, 3)) - 2.0 * place
    radius = rng.uniform(0.7, 1.1, 12)
    start = 5.0 * place + [0.0, 0.0, 20.0]
    return column_of(start, velocity, rng.normal(size=(12, 3)), radius, radius**3)


def soft(name: str, **settings: float) -> Law:
    """The law of a name, a thousand times softer."""
    law = law_of(name, **settings)
    if name == "walton-braun":
        names = ("loading", "unloading", "tangential")
        return law._replace(**{field: getattr(law, field) / 1e3 for field in names})
    return law._replace(stiffness=law.stiffness / 1e3)


def momenta(column: Column) -> np.ndarray:
    """Momentum and angular momentum about (0, 0, 20)."""
    push = column.mass[:, None] * column.velocity
    arm = column.position - [0.0, 0.0, 20.0]
    spin = 0.4 * (column.mass * column.radius**2)[:, None] * column.spin
    return np.concatenate([push.sum(axis=0), (np.cross(arm, push) + spin).sum(axis=0)])


@each_reach
@each_law
def test_collisions_keep_momentum_and_angular_momentum_to_rounding(name: str, reach: float):
    column = cluster()
    law = soft(name, restitution=0.6, friction=0.5, reach=reach)
    run = fall(column, law, 5e-4, 80, 100)
    assert run.status == FINE
    assert not run.piston.any()
    assert run.elastic.max() > 0.01 * column.kinetic_energy
    assert run.elastic[-1] == 0.0
    assert run.column.kinetic_energy < 0.95 * column.kinetic_energy
    assert run.kinetic[-1] == pytest.approx(run.column.kinetic_energy, rel=1e-12)
    assert abs(momenta(run.column) - momenta(column)).max() < 1e-10


def in_tube(seed: int = 4, gravity: float = 0.0) -> Column:
    """Twelve spheres that fly about in a tube that slides along them, and fall on its piston."""
    rng = np.random.default_rng(seed)
    k = np.arange(12)
    place = np.column_stack([2.2 * np.cos(1.7 * k), 2.2 * np.sin(1.7 * k), 1.5 + 1.6 * k])
    velocity = 2.0 * rng.normal(size=(12, 3)) - [0.0, 0.0, 3.0]
    walls = TubeWalls(3.6, 0.7, 0.0, 0.0)
    return column_of(place, velocity, rng.normal(size=(12, 3)), walls=walls, gravity=gravity)


def energy_error(column: Column, name: str, fold: int) -> float:
    """The root mean square change of the energy over what it was, in 1200 rows of a run."""
    run = fall(column, soft(name), 1e-3 / fold, 1200, 5 * fold)
    assert run.status == FINE
    assert run.elastic.max() > 0.02 * column.kinetic_energy
    off = (run.kinetic + run.elastic) / column.kinetic_energy - 1.0
    return float(np.sqrt((off**2).mean()))


@pytest.mark.parametrize("start", [cluster, in_tube])
@pytest.mark.parametrize("name", ["linear", "hertz"])
def test_energy_of_elastic_spheres_is_kept_with_an_error_of_second_order(
    name: str, start: Callable[[int], Column]
):
    """Frictionless, in clusters that fall apart and in a tube, at a step and at an eighth."""
    coarse, fine = (
        sqrt(sum(energy_error(start(seed), name, fold) ** 2 for seed in range(4)) / 4.0)
        for fold in (1, 8)
    )
    assert fine < 3e-6
    assert np.log2(coarse / fine) / 3.0 == pytest.approx(2.0, abs=0.3)


def test_latching_springs_of_restitution_one_are_linear_ones():
    """Frictionless, for they slip otherwise."""
    linear, latching = (fall(in_tube(), soft(name), 1e-3, 20, 100) for name in LAWS[::2])
    assert linear.elastic.max() > 0.02 * linear.kinetic.max()
    assert latching.elastic == pytest.approx(linear.elastic, rel=1e-8, abs=1e-8)
    assert latching.column.velocity == pytest.approx(linear.column.velocity, abs=1e-8)


@each_law
def test_energy_is_kept_under_gravity(name: str):
    """Kinetic, of the springs, and of the height, at moments of falling and of bouncing."""
    column, found = in_tube(gravity=1.0), []
    for _ in range(50):
        run = fall(column, soft(name), 5e-4, 1, 200)
        column = run.column
        high = (column.mass * column.position[:, 2]).sum()
        found.append([run.kinetic[0], run.elastic[0], high])
    energies = np.array(found)
    assert np.ptp(energies, axis=0).min() > 1.0
    assert np.ptp(energies.sum(axis=1)) < 1e-3 * energies[0].sum()


# Lids, rows, ends.


def test_upright_sphere_moves_up_and_down_only_and_presses_with_its_weight():
    """It slides down the side of one that it pushes away along the piston, then rests on it."""
    place = [[0.0, 0.0, 1.0], [0.5, 0.3, 3.0]]
    walls = TubeWalls(1.9, 0.0, 0.2, 0.3)
    column = column_of(place, mass=[1.0, 7.0], upright=[False, True], walls=walls, gravity=1.0)
    column = replace(column, spin=np.array([[0.0, 0.0, 0.0], [1.0, 2.0, 3.0]]))
    law = soft("linear", restitution=0.6, friction=0.1)
    run = fall(column, law, 1e-3, 2, 20_000, damping_rate=0.5)
    after = run.column
    assert after.position[1, :2].tolist() == [0.5, 0.3]
    assert not after.velocity[1, :2].any()
    assert after.position[1, 2] < 2.9
    assert abs(after.position[0, :2]).min() > 0.1
    between, walls_met = touching(after, law)
    on_piston = walls_met.push[walls_met.pair[:, 1] == 1].sum()
    on_tube = walls_met.pull[walls_met.pair[:, 1] == 0, 2].sum()
    assert on_piston + on_tube == pytest.approx(8.0, rel=1e-3)
    lifted = between.pull[0, 2] - between.push[0] * between.normal[0, 2]
    assert abs(lifted) == pytest.approx(7.0, rel=1e-3)
    assert replace(after, velocity=0.0 * after.velocity, spin=column.spin).kinetic_energy == 0.0


def test_sample_of_a_row_is_the_mean_over_its_steps():
    law = soft("linear", restitution=0.6)
    each, mean = (fall(in_tube(gravity=1.0), law, 1e-3, rows, 4000 // rows) for rows in (4000, 40))
    assert each.piston.max() > 0.0
    assert each.wall_normal.max() > 0.0
    for name in ("piston", "tube", "wall_normal"):
        rows = getattr(each, name).reshape(40, 100).mean(axis=1)
        assert getattr(mean, name) == pytest.approx(rows, rel=1e-11, abs=1e-12)
    assert mean.overlap == pytest.approx(each.overlap.reshape(40, 100).max(axis=1), rel=1e-12)
    assert mean.kinetic == pytest.approx(each.kinetic[99::100], rel=1e-12)
    assert mean.elastic == pytest.approx(each.elastic[99::100], rel=1e-12, abs=1e-15)


def test_damping_rate_slows_straight_motion_and_spin_exponentially():
    column = column_of([0.0, 0.0, 50.0], [3.0, -1.0, 2.0], [4.0, 5.0, -6.0])
    after = fall(column, law_of("linear"), 1e-3, 3, 500, damping_rate=2.0).column
    assert after.velocity == pytest.approx(column.velocity * np.exp(-3.0), rel=1e-11)
    assert after.spin == pytest.approx(column.spin * np.exp(-3.0), rel=1e-11)


def test_free_sphere_falls_as_it_should():
    column = column_of([0.0, 0.0, 500.0], [3.0, -1.0, 2.0], [1.0, 2.0, 3.0], gravity=9.81)
    after = fall(column, law_of("linear"), 1e-3, 1, 2000).column
    expected = np.array([[6.0, -2.0, 504.0 - 0.5 * 9.81 * 4.0]])
    assert after.position == pytest.approx(expected, rel=1e-11)
    assert after.velocity == pytest.approx(np.array([[3.0, -1.0, 2.0 - 19.62]]), rel=1e-11)
    assert after.spin.tolist() == column.spin.tolist()


def test_run_ends_where_spheres_are_none_any_more():
    """Too deep in each other or a wall, through a wall in one step, or nowhere."""
    law = soft("linear")
    fast = column_of([[0, 0, 50], [2.1, 0, 50]], [[0, 0, 0], [-90.0, 0, 0]])
    for column in (fast, column_of([0, 0, 2.0], [0, 0, -60.0])):
        for deepest in (1.0, 0.3):
            run = fall(column, law, 1e-4, 2000, deepest=deepest)
            assert run.status == TOO_DEEP
            assert run.overlap[-1] > deepest >= run.overlap[:-1].max()
    for place, way in (
        ([0, 0, 9], [0, 0, -3.0]),
        ([990, 0, 9], [0.0, 70.0, 0]),
        ([0, -997, 9], [0, -1, 0]),
    ):
        run = fall(column_of(place, way), law, 2.0, 10, deepest=1e9)
        assert (run.status, len(run.piston)) == (ESCAPED, 2)
    same = column_of([[0.0, 0, 9], [0.0, 0, 9], [5.0, 0, 9]], [[0, 0, 0], [0, 0, 0], [9.0, 0, 0]])
    assert fall(same, law, 1e-3, 3, 100).status == NOT_FINITE


@pytest.mark.parametrize(
    "wrong", [{"time_step": 0.0}, {"time_step": float("nan")}, {"rows": -1}, {"threads": 0}]
)
def test_runs_that_make_no_sense_are_refused(wrong: dict[str, Any]):
    with pytest.raises(ValueError, match="no run of"):
        fall(cluster(), law_of("linear"), **({"time_step": 1e-3, "rows": 1} | wrong))


@pytest.mark.parametrize("restitution", [0.2, 0.6, 1.0])
def test_latching_law_has_the_stiffnesses_of_its_restitution(restitution: float):
    law = walton_braun(3e4, restitution, 0.5, 1.0)
    assert sqrt(law.loading / law.unloading) == pytest.approx(restitution, rel=1e-14)
    assert (law.loading, law.tangential) == (3e4, pytest.approx(0.8 * 3e4))
    assert (law.friction, law.reach) == (0.5, 1.0)


@pytest.mark.parametrize("name", ["linear", "walton-braun"])
def test_contact_of_two_spheres_lasts_half_a_swing(name: str):
    """pi sqrt(m*/k), each half of it with its own spring where they latch."""
    column = column_of([[0, 0, 50], [2.0 + 1e-12, 0, 50]], [[0, 0, 0], [-1.0, 0, 0]], mass=[1, 3])
    restitution = 1.0 if name == "linear" else 0.6
    run = fall(column, law_of(name, restitution), 1e-6, 4000)
    swing = pi * sqrt(0.75 / STIFFNESS) * 0.5 * (1.0 + restitution)
    assert np.count_nonzero(run.elastic > 0.0) * 1e-6 == pytest.approx(swing, abs=3e-6)
    assert run.elastic.max() == pytest.approx(0.5 * 0.75 * restitution**2, rel=1e-5)
    assert run.overlap.max() == pytest.approx(sqrt(0.75 / STIFFNESS), rel=1e-5)
