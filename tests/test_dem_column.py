"""Columns of many spheres against naive loops and their weight, and the engine on its deck."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from liftdrag.deck.janssen import FORCES, GRAINS, START, build
from liftdrag.dem import (
    FINE,
    Column,
    ColumnMemory,
    HertzMindlin,
    Law,
    TubeWalls,
    WaltonBraun,
    fall,
    hertz_mindlin,
    linear_spring,
    touching,
    walton_braun,
)
from liftdrag.dem.column import arrays, pairs_of, wall_pairs_of
from liftdrag.dem.neighbours import neighbours, wall_neighbours
from liftdrag.engines import dem_column
from liftdrag.engines.dem import main
from liftdrag.engines.samples import read_samples
from liftdrag.granular import GRAVITY
from liftdrag.numerics import JanssenNumerics, derive
from liftdrag.numerics.janssen import Level
from liftdrag.packing.tube import PackedColumn, packed_column
from liftdrag.profile import Profile
from liftdrag.scene import JanssenScene
from liftdrag.series import Series

LAWS: dict[str, Law] = {
    "linear": linear_spring(1e4, 0.7, 0.5, 2.0 / 7.0),
    "linear, slip at the surfaces": linear_spring(1e4, 0.7, 0.5, 2.0 / 7.0, 1.0),
    "hertz": hertz_mindlin(1e5, 0.3, 0.7, 0.5),
    "hertz, slip at the surfaces": hertz_mindlin(1e5, 0.3, 0.7, 0.5, 1.0),
    "walton-braun": walton_braun(1e4, 0.7, 0.5),
    "walton-braun, slip at the surfaces": walton_braun(1e4, 0.7, 0.5, 1.0),
}
LATCHING = LAWS["walton-braun"]
each_law = pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
one_of_each = pytest.mark.parametrize("law", list(LAWS.values())[::2], ids=list(LAWS)[::2])


def dense() -> Column:
    """120 spheres of several sizes at random about the places of a lattice, and a large one.

    In a tube that slides along them; many touch each other, some a wall, and all move.
    """
    rng = np.random.default_rng(11)
    line = np.arange(-3, 4)
    place = np.stack(np.meshgrid(line, line, np.arange(5), indexing="ij"), axis=-1).reshape(-1, 3)
    place = place[np.hypot(place[:, 0], place[:, 1]) < 3.3] * 1.0 + [0.0, 0.0, 0.49]
    place = place[np.linalg.norm(place - [1.5, 0.5, 2.0], axis=1) > 1.55]
    place = np.vstack([place, [[1.5, 0.5, 2.0]]]) + rng.uniform(-0.03, 0.03, (len(place) + 1, 3))
    count = len(place)
    order = rng.permutation(count)
    radius = np.append(rng.uniform(0.47, 0.54, count - 1), 1.3)
    return Column(
        place[order],
        0.3 * rng.normal(size=(count, 3)),
        0.5 * rng.normal(size=(count, 3)),
        radius[order],
        np.where(np.arange(count) % 17 == 0, 0.7, 4.0 * radius[order] ** 3),
        np.arange(count) % 17 == 0,
        TubeWalls(3.62, 0.4, 0.3, 0.4),
        1.0,
    )


@cache
def rubbed(law: Law) -> Column:
    """The dense column after some steps, so that its contacts remember something."""
    run = fall(dense(), law, 2e-4, 1, 100)
    assert run.status == FINE
    assert len(run.column.memory.pair) > 200
    return run.column


def differences(one: Column, other: Column) -> float:
    """The largest of place, velocity and spin; all are of order one."""
    names = ("position", "velocity", "spin")
    return max(float(abs(getattr(one, name) - getattr(other, name)).max()) for name in names)


# Forces against naive loops.


@dataclass
class Naive:
    """What naive loops find: forces and torques on the grains (n, 3), and of the walls."""

    force: np.ndarray
    torque: np.ndarray
    piston: float = 0.0
    tube: float = 0.0
    wall_normal: float = 0.0


def naive_contact(
    law: Law,
    friction: float,
    numbers: tuple[float, float],
    depth: float,
    normal: np.ndarray,
    speeds: tuple[float, np.ndarray],
    memory: tuple[np.ndarray, np.ndarray],
) -> tuple[float, np.ndarray]:
    """Push and pull of a contact: effective radius and mass, speed apart and slip, memory."""
    (radius, mass), (parting, slip), (stretch, state) = numbers, speeds, memory
    across = stretch - (stretch @ normal) * normal
    size = np.linalg.norm(across)
    across = across * (np.linalg.norm(stretch) / size if size else 1.0)
    if isinstance(law, WaltonBraun):
        push, pull = law.loading * depth, across
        if depth < state[0]:
            rest = state[0] * (1.0 - law.loading / law.unloading)
            push = max(law.unloading * (depth - rest), 0.0)
    else:
        stiffness = law.stiffness * (np.sqrt(radius * depth) if type(law) is HertzMindlin else 1.0)
        swing = (1.5 if type(law) is HertzMindlin else 1.0) * stiffness * mass
        push = stiffness * depth - law.damping * np.sqrt(swing) * parting
        dashpot = law.tangential_damping * law.damping * np.sqrt(swing)
        pull = law.tangential * stiffness * across + dashpot * slip
    limit, size = friction * abs(push), np.linalg.norm(pull)
    return push, pull * min(1.0, limit / size) if size else pull


def naive(column: Column, law: Law) -> Naive:
    """Every grain with every other and with both walls, one after the other."""
    memory, count = column.memory, len(column.mass)
    kept = zip(map(tuple, memory.pair.tolist()), memory.stretch, memory.state, strict=True)
    known = {pair: (stretch, state) for pair, stretch, state in kept}
    wall_pair = map(tuple, memory.wall_pair.tolist())
    kept = zip(wall_pair, memory.wall_stretch, memory.wall_state, strict=True)
    at_wall = {pair: (stretch, state) for pair, stretch, state in kept}
    nothing = (np.zeros(3), np.zeros(3))
    radius, mass, place = column.radius, column.mass, column.position
    found = Naive(np.zeros((count, 3)), np.zeros((count, 3)))
    for i in range(count):
        for j in range(i + 1, count):
            line = place[j] - place[i]
            distance = np.linalg.norm(line)
            depth, normal = radius[i] + radius[j] - distance, line / distance
            if depth <= 0.0:
                continue
            short = 0.5 * depth * (1.0 - law.reach)
            turning = (radius[i] - short) * column.spin[i] + (radius[j] - short) * column.spin[j]
            relative = column.velocity[j] - column.velocity[i]
            parting = float(relative @ normal)
            slip = relative - parting * normal - np.cross(turning, normal)
            numbers = (
                radius[i] * radius[j] / (radius[i] + radius[j]),
                mass[i] * mass[j] / (mass[i] + mass[j]),
            )
            push, pull = naive_contact(
                law,
                law.friction,
                numbers,
                depth,
                normal,
                (parting, slip),
                known.get((i, j), nothing),
            )
            force = pull - push * normal
            found.force[i] += force
            found.force[j] -= force
            found.torque[i] += np.cross((radius[i] - 0.5 * depth) * normal, pull)
            found.torque[j] += np.cross(-(radius[j] - 0.5 * depth) * normal, -pull)
        walls = column.walls
        away = np.array([*place[i, :2], 0.0])
        outward = away / np.linalg.norm(away)
        for wall, normal, room, lift, friction in (
            (0, outward, walls.radius - np.linalg.norm(away), walls.lift, walls.tube_friction),
            (1, np.array([0.0, 0.0, -1.0]), place[i, 2], 0.0, walls.piston_friction),
        ):
            depth = radius[i] - room
            if depth <= 0.0:
                continue
            relative = np.array([0.0, 0.0, lift]) - column.velocity[i]
            parting = float(relative @ normal)
            lever = (radius[i] - (1.0 - law.reach) * depth) * normal
            slip = relative - parting * normal - np.cross(column.spin[i], lever)
            push, pull = naive_contact(
                law,
                friction,
                (radius[i], mass[i]),
                depth,
                normal,
                (parting, slip),
                at_wall.get((i, wall), nothing),
            )
            found.force[i] += pull - push * normal
            found.torque[i] += np.cross(lever, pull)
            if wall == 1:
                found.piston += push
            else:
                found.tube += pull[2]
                found.wall_normal += push
    return found


@each_law
def test_contacts_add_up_to_the_forces_of_naive_loops(law: Law):
    column = rubbed(law)
    expected = naive(column, law)
    between, walls = touching(column, law)
    force = np.zeros_like(expected.force)
    on_first = between.pull - between.push[:, None] * between.normal
    np.add.at(force, between.pair[:, 0], on_first)
    np.add.at(force, between.pair[:, 1], -on_first)
    of_wall = walls.pull - walls.push[:, None] * walls.normal
    np.add.at(force, walls.pair[:, 0], of_wall)
    assert len(walls.push) > 40
    assert np.linalg.norm(walls.pull, axis=1).max() > 1.0
    assert force == pytest.approx(expected.force, abs=1e-11 * abs(expected.force).max())
    on_piston = walls.pair[:, 1] == 1
    assert walls.push[on_piston].sum() == pytest.approx(expected.piston, rel=1e-12)
    assert walls.pull[~on_piston, 2].sum() == pytest.approx(expected.tube, rel=1e-9)
    assert walls.push[~on_piston].sum() == pytest.approx(expected.wall_normal, rel=1e-12)


@each_law
def test_grains_are_moved_by_the_forces_and_torques_of_naive_loops(law: Law):
    """In a step so short that these hardly change; upright ones upward only, and as one."""
    column, step = rubbed(law), 1e-9
    expected = naive(column, law)
    expected.force[column.upright, 2] = expected.force[column.upright, 2].mean()
    run = fall(column, law, step, 1)
    free, mass = ~column.upright[:, None], column.mass[:, None]
    gained = mass * (run.column.velocity - column.velocity) / step
    sought = np.where(free | (np.arange(3) == 2), expected.force, 0.0)
    sought[:, 2] -= column.mass * column.gravity
    assert gained == pytest.approx(sought, abs=1e-5 * abs(sought).max())
    inertia = 0.4 * mass * column.radius[:, None] ** 2
    spun = inertia * (run.column.spin - column.spin) / step
    turning = np.where(free, expected.torque, 0.0)
    assert spun == pytest.approx(turning, abs=1e-5 * abs(turning).max())
    assert run.piston[0] == pytest.approx(expected.piston, rel=1e-5)
    assert run.tube[0] == pytest.approx(expected.tube, rel=1e-5)
    assert run.wall_normal[0] == pytest.approx(expected.wall_normal, rel=1e-5)


@pytest.mark.parametrize("skin", [0.0, 0.1, 0.7])
def test_neighbours_are_those_of_a_naive_loop(skin: float):
    """The large grain too, which is in no cell; what is remembered goes with its pair."""
    column = rubbed(LATCHING)
    assert (column.radius > 2.0 * column.radius.mean()).sum() == 1
    _, _, parts, scene = arrays(column)
    pairs = neighbours(parts, scene.place, skin, LATCHING, pairs_of(column))
    apart = np.linalg.norm(column.position[:, None] - column.position[None], axis=2)
    near = apart < column.radius[:, None] + column.radius[None] + skin
    expected = np.argwhere(np.triu(near, 1))
    grain = np.repeat(np.arange(len(apart)), np.diff(pairs.first))
    found = np.column_stack([grain, pairs.other])
    assert found[np.lexsort(found.T[::-1])].tolist() == expected.tolist()
    kept = dict(zip(map(tuple, column.memory.pair.tolist()), column.memory.stretch, strict=True))
    stretch = np.array([kept.get(tuple(pair), np.zeros(3)) for pair in found.tolist()])
    assert (abs(stretch).sum(axis=1) > 0.0).sum() > 100
    assert pairs.stretch.tolist() == stretch.tolist()
    walls = column.walls
    at_walls = wall_neighbours(parts, scene.place, skin, LATCHING, walls, wall_pairs_of(column))
    away = walls.radius - np.hypot(*column.position[:, :2].T)
    room = np.column_stack([away, column.position[:, 2]])
    expected = np.argwhere(room < column.radius[:, None] + 0.5 * skin)
    assert np.column_stack([at_walls.part, at_walls.wall]).tolist() == expected.tolist()


# What must change nothing.


@one_of_each
def test_new_neighbour_lists_change_nothing(law: Law):
    """Made anew in every step, sometimes, and never; but forgetful contacts would."""
    column = rubbed(law)
    never, some, always = (fall(column, law, 2e-4, 1, 200, skin=skin) for skin in (2.0, 0.02, 0.0))
    assert never.rebuilt == 0 < some.rebuilt < always.rebuilt == 200
    assert differences(never.column, column) > 0.01
    assert differences(never.column, always.column) < 1e-9
    assert differences(never.column, some.column) < 1e-9
    forgetful = fall(replace(column, memory=ColumnMemory()), law, 2e-4, 1, 200).column
    assert differences(never.column, forgetful) > 1e-4


def shuffled(column: Column, order: np.ndarray) -> Column:
    """The column with its grains in another order, pair by pair, the smaller number first."""
    new = {int(old): k for k, old in enumerate(order)}
    pair, stretch = [], []
    for (i, j), pulled in zip(column.memory.pair.tolist(), column.memory.stretch, strict=True):
        flipped = new[i] > new[j]
        pair.append((new[j], new[i]) if flipped else (new[i], new[j]))
        stretch.append(-pulled if flipped else pulled)
    wall_pair = [(new[i], w) for i, w in column.memory.wall_pair.tolist()]
    names = ("position", "velocity", "spin", "radius", "mass", "upright")
    memory = replace(
        column.memory,
        pair=np.array(pair),
        stretch=np.array(stretch),
        wall_pair=np.array(wall_pair),
    )
    arranged = {name: getattr(column, name)[order] for name in names}
    return replace(column, **arranged, memory=memory)


@one_of_each
def test_order_of_the_grains_changes_nothing(law: Law):
    column = rubbed(law)
    order = np.random.default_rng(5).permutation(len(column.mass))
    plain = fall(column, law, 2e-4, 2, 100)
    other = fall(shuffled(column, order), law, 2e-4, 2, 100)
    assert differences(shuffled(plain.column, order), other.column) < 1e-9
    assert other.piston == pytest.approx(plain.piston, rel=1e-9)
    there, here = (touching(c, law)[0] for c in (shuffled(plain.column, order), other.column))
    sums = [abs(found.pull).sum(axis=0) for found in (there, here)]
    assert sums[0] == pytest.approx(sums[1], rel=1e-7)


def test_run_in_pieces_is_the_run_in_one_where_no_dashpot_asks_for_velocities():
    """Latching forces depend on places and memory alone, which a piece hands on exactly."""
    column = rubbed(LATCHING)
    whole, piece = fall(column, LATCHING, 2e-4, 1, 400).column, column
    for _ in range(8):
        piece = fall(piece, LATCHING, 2e-4, 1, 50).column
    assert differences(whole, piece) < 1e-10
    for name in ("stretch", "state", "wall_state"):
        without = replace(column.memory, **{name: 0.0 * getattr(column.memory, name)})
        assert (
            differences(whole, fall(replace(column, memory=without), LATCHING, 2e-4, 1, 400).column)
            > 1e-4
        )


def test_two_threads_agree_with_one_and_give_the_same_bits_twice():
    column = rubbed(LATCHING)
    alone = fall(column, LATCHING, 2e-4, 10, 20)
    once, again = (fall(column, LATCHING, 2e-4, 10, 20, threads=2) for _ in range(2))
    assert once.rebuilt == alone.rebuilt > 0
    for name in ("position", "velocity", "spin"):
        assert getattr(once.column, name).tolist() == getattr(again.column, name).tolist()
    assert differences(alone.column, once.column) < 1e-9
    for name in ("piston", "tube", "wall_normal", "kinetic", "elastic", "overlap"):
        assert getattr(once, name).tolist() == getattr(again, name).tolist()
        assert getattr(once, name) == pytest.approx(getattr(alone, name), rel=1e-9)


# The engine on its deck, a tiny column of glass.

D = 3e-3
LID_MASS = 2e-3
STEP = 1e-5


def scene_of(
    motion: str = "none", friction: float = 0.4, lid: bool = False, **law: Any
) -> JanssenScene:
    """160 grains in a tube of six diameters, filled in two."""
    drive = {"duration": 0.01} if motion == "none" else {"speed": 0.02, "distance": 0.2 * D}
    return JanssenScene.model_validate(
        {
            "scene": "janssen",
            "seed": 1,
            "grains": {
                "diameter": D,
                "density": 2500.0,
                "restitution": 0.4,
                "friction": 0.4,
                "contact": "linear",
                "stiffness": 1500.0,
            }
            | law,
            "tube": {"diameter": 6.0 * D, "height": 1.0, "friction": friction},
            "fill": {"mass": 160 * 2500.0 * np.pi * D**3 / 6.0, "curve": True, "levels": 2},
            "drive": {"motion": motion} | drive,
        }
        | ({"overload": {"mass": LID_MASS}} if lid else {})
    )


def numerics_of(scene: JanssenScene, *phases: int, **values: float) -> JanssenNumerics:
    """Those of the scene with two fills of these phases, and some values set."""
    derived = derive(scene)
    settle, mobilise, average = phases
    levels = []
    for k, count in enumerate(scene.counts):
        start = k * sum(phases)
        middle = start + settle + mobilise
        levels.append(Level(count, start, start + settle, middle, middle + average))
    values = {
        "time_step": STEP,
        "settle_rate": 40.0,
        "row_every": 20,
        "profile_every": 100,
        "block_every": 500,
    } | values
    changed = {name: replace(getattr(derived, name), value=value) for name, value in values.items()}
    return replace(derived, levels=tuple(levels), **changed)


@cache
def packed(lid: bool) -> PackedColumn:
    """The grains of all these scenes."""
    return packed_column(scene_of(lid=lid))


def written(folder: Path, scene: JanssenScene, *phases: int, **values: float) -> Path:
    """A folder with the deck of a scene."""
    numerics = numerics_of(scene, *phases, **values)
    column = packed(scene.lid_mass > 0.0)
    build(scene, numerics, column, "tiny", "test", 1).write(folder)
    return folder


@dataclass(frozen=True)
class Answer:
    """What a run left, and what it was asked."""

    scene: JanssenScene
    fills: list[list[int]]
    time_step: float
    series: Series
    profiles: list[Profile]

    def averages(self) -> list[tuple[int, np.ndarray, list[Profile]]]:
        """Of each fill the grains, the rows of its average, and the profiles."""
        found, step = [], self.time_step
        for count, _, _, begin, end in self.fills:
            time = self.series.time
            rows = np.flatnonzero((time > (begin + 0.5) * step) & (time < (end + 0.5) * step))
            within = [p for p in self.profiles if (begin + 0.5) < p.time / step < end + 0.5]
            found.append((count, rows, within))
        return found


COLUMNS: dict[str, tuple[JanssenScene, tuple[int, int, int]]] = {
    "rest": (scene_of(), (40_000, 0, 1000)),
    "moving": (scene_of("tube up"), (6000, 3000, 1500)),
    "smooth": (scene_of("tube up", 0.0), (16_000, 500, 1000)),
    "lid": (scene_of(lid=True), (40_000, 0, 500)),
}


@pytest.fixture(scope="module")
def column(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Answer]:
    """The tiny columns as the program of the engine computes them, each once."""

    @cache
    def computed(which: str) -> Answer:
        scene, phases = COLUMNS[which]
        folder = written(tmp_path_factory.mktemp("column"), scene, *phases)
        assert main([str(folder)]) == 0
        run = dem_column.read(folder).numbers.run
        series = read_samples(
            folder / FORCES, {"piston": "N", "tube": "N", "wall_normal": "N", "overlap": "1"}
        )
        return Answer(scene, run.fills, run.time_step, series, list(dem_column.profiles(folder)))

    return computed


def weight(answer: Answer, count: int) -> float:
    """Weight (N) of so many grains and the lid."""
    return GRAVITY * (count * answer.scene.grains.mass + answer.scene.lid_mass)


@pytest.mark.parametrize("which", ["rest", "lid"])
def test_piston_and_tube_carry_the_weight_of_a_settled_column(which: str, column: Callable):
    answer = column(which)
    found = answer.series.channels
    for count, rows, _ in answer.averages():
        carried = (found["piston"] + found["tube"])[rows]
        assert carried == pytest.approx(np.full(len(rows), weight(answer, count)), rel=1e-3)
        assert abs(found["tube"][rows]).min() > 1e-3 * weight(answer, count)


def test_tube_without_friction_carries_nothing(column: Callable):
    """While it slides along the grains; it presses on them all the same."""
    answer = column("smooth")
    found = answer.series.channels
    assert not found["tube"].any()
    for count, rows, profiles in answer.averages():
        assert found["piston"][rows].mean() == pytest.approx(weight(answer, count), rel=5e-3)
        assert found["wall_normal"][rows].mean() > 0.1 * weight(answer, count)
        for profile in profiles:
            assert not profile.wall_shear.any()
            assert not profile.mobilisation.any()
            assert not profile.sliding.any()


def test_friction_of_a_sliding_tube_is_mobilised(column: Callable):
    answer = column("moving")
    found = answer.series.channels
    count, rows, profiles = answer.averages()[-1]
    carried = (found["piston"] + found["tube"])[rows].mean()
    assert carried == pytest.approx(weight(answer, count), rel=0.02)
    lifted, pressed = found["tube"][rows], found["wall_normal"][rows]
    assert (lifted <= 0.4 * pressed * (1.0 + 1e-9)).all()
    assert lifted.mean() > 0.5 * 0.4 * pressed.mean()
    for profile in profiles:
        assert (profile.mobilisation <= profile.wall_contacts * (1.0 + 1e-9)).all()
        assert (0.99 * profile.sliding <= profile.mobilisation).all()
        assert profile.sliding.sum() > 0.2 * profile.wall_contacts.sum()
        assert profile.spin.sum() > 0.0


@pytest.mark.parametrize("which", ["rest", "lid", "smooth", "moving"])
def test_profiles_add_up_to_the_forces_on_the_tube(which: str, column: Callable):
    """Instants of five pieces against rows of means, in a column at rest or nearly so."""
    answer, close = column(which), {"rest": 1e-3, "lid": 1e-3, "smooth": 5e-3, "moving": 0.1}
    found = answer.series.channels
    for count, rows, profiles in answer.averages():
        assert len(profiles) == (answer.fills[0][4] - answer.fills[0][3]) // 500
        for name, channel in (("wall_normal", "wall_normal"), ("wall_shear", "tube")):
            mean = np.mean([getattr(p, name).sum() for p in profiles])
            largest = abs(found["wall_normal"][rows].mean())
            assert mean == pytest.approx(found[channel][rows].mean(), abs=close[which] * largest)
        assert all(p.count.sum() == pytest.approx(count, rel=1e-12) for p in profiles)


def test_stress_of_a_slice_bears_what_is_above_but_for_what_the_tube_carries(column: Callable):
    """The virial over the height of a slice against the weight and the friction above its middle.

    To 7 % of the weight, for a contact is halved between the slices of its two grains.
    """
    answer = column("rest")
    count, _, profiles = answer.averages()[-1]
    profile, mass = profiles[-1], answer.scene.grains.mass
    height = 2.0 * profile.height[0]
    own = GRAVITY * mass * profile.count - profile.wall_shear
    above = np.cumsum(own[::-1])[::-1] - 0.5 * own
    whole = count * mass * GRAVITY
    bottom = 1  # whose grains stand on the piston, which is no grain
    assert (profile.virial / height)[bottom:] == pytest.approx(above[bottom:], abs=0.07 * whole)
    assert above[bottom] > 0.4 * whole


def settled(folder: Path) -> tuple[Column, Law, dem_column.ColumnDeck]:
    """A column at rest of the deck's grains, with its law and deck."""
    deck = dem_column.read(folder)
    law, numbers = dem_column.law_of(deck.numbers.contact), deck.numbers
    grains = len(deck.packed)
    start = Column(
        deck.packed,
        np.zeros((grains, 3)),
        np.zeros((grains, 3)),
        np.full(grains, 0.5 * numbers.grains.diameter),
        np.full(grains, numbers.grains.mass),
        np.zeros(grains, bool),
        TubeWalls(numbers.walls.radius, 0.0, numbers.walls.friction, numbers.contact.friction),
        numbers.grains.gravity,
    )
    step = numbers.run.time_step
    run = fall(start, law, step, 1, 30_000, damping_rate=numbers.run.settle_rate)
    assert run.status == FINE
    return run.column, law, deck


def test_virial_of_a_column_at_rest_is_the_moment_of_what_bears_it(tmp_path: Path):
    """Over all slices, against the sum of z (m g - what the walls lift), grain by grain.

    And what each slice holds, against naive sums over its grains.
    """
    resting, law, deck = settled(written(tmp_path, scene_of(), 0, 0, 500))
    profile = dem_column._profile(resting, law, deck)
    between, walls = touching(resting, law)
    lifted = np.zeros(len(resting.mass))
    np.add.at(lifted, walls.pair[:, 0], walls.pull[:, 2] - walls.push * walls.normal[:, 2])
    moment = resting.position[:, 2] @ (resting.mass * resting.gravity - lifted)
    assert profile.virial.sum() == pytest.approx(moment, rel=2e-4)
    size = 2.0 * profile.height[0]
    force = between.push * between.normal[:, 2] - between.pull[:, 2]
    virial = np.zeros(len(profile.height))
    for (i, j), pushed in zip(between.pair, force, strict=True):
        high = resting.position[[i, j], 2]
        for z in high:
            virial[int(z / size)] += 0.5 * pushed * (high[1] - high[0])
    assert profile.virial == pytest.approx(virial, rel=1e-9, abs=1e-12)
    shear, normal, touches, spin = np.zeros((4, len(profile.height)))
    for (i, wall), push, pull, outward in zip(
        walls.pair, walls.push, walls.pull, walls.normal, strict=True
    ):
        if wall == 0:
            here = int(resting.position[i, 2] / size)
            shear[here] += pull[2]
            normal[here] += push
            touches[here] += 1
            spin[here] += resting.spin[i] @ np.cross(outward, [0.0, 0.0, 1.0])
    assert profile.wall_shear == pytest.approx(shear, rel=1e-9, abs=1e-15)
    assert profile.wall_normal == pytest.approx(normal, rel=1e-9)
    assert profile.wall_contacts.tolist() == touches.tolist()
    assert profile.spin == pytest.approx(spin, rel=1e-9, abs=1e-12)


def test_samples_are_those_of_each_fill(column: Callable):
    """A row every so many steps from the first on, and the layer added comes with its weight."""
    answer = column("rest")
    time = answer.series.time
    assert len(time) == answer.fills[-1][-1] // 20
    assert time == pytest.approx(20 * answer.time_step * np.arange(1, len(time) + 1), rel=1e-9)
    assert 0.0 < answer.series.channels["overlap"].max() < 0.05
    assert [fill[0] for fill in answer.fills] == [80, 160]
    moments = [p.time / answer.time_step for p in answer.profiles]
    blocks = [
        end for _, _, _, begin, stop in answer.fills for end in range(begin + 500, stop + 1, 500)
    ]
    assert moments == pytest.approx(blocks)


def test_grains_and_lid_that_fall_have_the_energy_of_their_fall(tmp_path: Path):
    """Slowed while they settle only; a layer and the lid on it start at rest, the others go on.

    High above the piston, the mean over the grains and the lid's against the closed form.
    """
    scene, phases, steps = scene_of(lid=True), (500, 500, 500), np.arange(20, 3001, 20)
    high = np.array([[0.0, 0.0, 0.5], [0.0, 0.0, 0.51], [0.0, 0.0, 0.52], [0.0, 0.0, 0.53]])
    numerics = numerics_of(scene, *phases)
    levels = tuple(replace(one, count=2 * (k + 1)) for k, one in enumerate(numerics.levels))
    packed = PackedColumn(high, np.array([[0.0, 0.0, 0.6]]))
    build(scene, replace(numerics, levels=levels), packed, "fall", "test", 1).write(tmp_path)
    assert main([str(tmp_path)]) == 0
    time, begun = STEP * steps, STEP * 1500
    rate, settling = 40.0, STEP * 500

    def speed(start: np.ndarray | float, since: np.ndarray) -> np.ndarray:
        """Speed of what had one (m/s) when its fill began, so long ago (s)."""
        slowed, end = np.minimum(since, settling), np.exp(-rate * np.minimum(since, settling))
        return start * end + GRAVITY / rate * (1.0 - end) + GRAVITY * (since - slowed)

    first = speed(0.0, np.minimum(time, begun))
    old = np.where(time > begun, speed(first[-1], time - begun), first)
    new = np.where(time > begun, speed(0.0, time - begun), 0.0)
    lid = np.where(time > begun, new, first)
    twice = 2.0 * scene.grains.mass * (old**2 + new**2) + LID_MASS * lid**2
    expected = 0.5 * twice / np.where(time > begun, 5.0, 3.0)
    found = read_samples(tmp_path / FORCES, {"kinetic": "J"}).channels["kinetic"]
    assert found == pytest.approx(expected, rel=5e-3)


@pytest.mark.parametrize("contact", ["linear", "hertz", "walton-braun"])
def test_law_of_a_deck_is_the_one_asked_for(contact: str, tmp_path: Path):
    asked = {"stiffness": None, "youngs_modulus": 1e7, "poisson_ratio": 0.3}
    scene = scene_of(contact=contact, **(asked if contact == "hertz" else {}))
    deck = dem_column.read(written(tmp_path, scene, 0, 0, 500))
    expected = {
        "linear": linear_spring(1500.0, 0.4, 0.4, 2.0 / 7.0),
        "hertz": hertz_mindlin(1e7, 0.3, 0.4, 0.4),
        "walton-braun": walton_braun(1500.0, 0.4, 0.4),
    }
    assert dem_column.law_of(deck.numbers.contact) == expected[contact]


# Decks that are none.


@pytest.fixture
def deck(tmp_path: Path) -> Path:
    return written(tmp_path, scene_of(), 500, 0, 500)


def refused(folder: Path, capsys: pytest.CaptureFixture[str]) -> str:
    """The sentence with which the program refuses a folder."""
    assert main([str(folder)]) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    said = printed.err.strip()
    assert "\n" not in said
    assert said.endswith(".")
    assert "Traceback" not in said
    return said


def changed(folder: Path, old: str, new: str) -> None:
    text = (folder / START).read_text()
    assert old in text
    (folder / START).write_text(text.replace(old, new, 1))


def test_deck_without_grains_is_refused(deck: Path, capsys: pytest.CaptureFixture[str]):
    (deck / GRAINS).unlink()
    assert "holds no column" in refused(deck, capsys)


@pytest.mark.parametrize("share", [0.0, 0.3, 0.97])
def test_deck_whose_grains_are_cut_is_refused(
    share: float, deck: Path, capsys: pytest.CaptureFixture[str]
):
    whole = (deck / GRAINS).read_bytes()
    (deck / GRAINS).write_bytes(whole[: int(share * len(whole))])
    assert "holds no column" in refused(deck, capsys)


def test_deck_with_other_arrays_is_refused(deck: Path, capsys: pytest.CaptureFixture[str]):
    np.savez(deck / GRAINS, grains=np.zeros((160, 3)))
    assert "holds no column" in refused(deck, capsys)


@pytest.mark.parametrize("share", [0.5, 0.97])
def test_deck_whose_text_is_cut_is_refused(
    share: float, deck: Path, capsys: pytest.CaptureFixture[str]
):
    whole = (deck / START).read_text()
    (deck / START).write_text(whole[: int(share * len(whole))])
    assert START in refused(deck, capsys)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("[80, 0, 500, 500, 1000]", "[80, 0, 500, 400, 1000]"),
        ("[80, 0, 500, 500, 1000]", "[80, 0, 500, 500, 1001]"),
        ("[80, 0, 500, 500, 1000]", "[80, 0, 500, 500]"),
        ("[80, 0, 500, 500, 1000]", "[80, 500, 500, 500, 1000]"),
        ("[160, 1000", "[161, 1000"),
        ("[160, 1000", "[80, 1000"),
        ("[160, 1000", "[160, 1500"),
        ("profile_every = 100", "profile_every = 110"),
        ("row_every = 20", "row_every = 30"),
        ("restitution = 0.4", "restitution = 0.0"),
        ("restitution = 0.4", "restitution = 1.5"),
        ('law = "linear"', 'law = "none"'),
        ("threads = 1", "threads = 0"),
        ("gravity", "gravitation"),
    ],
)
def test_deck_with_a_wrong_number_is_refused(
    old: str, new: str, deck: Path, capsys: pytest.CaptureFixture[str]
):
    changed(deck, old, new)
    assert START in refused(deck, capsys)


def test_folder_without_a_deck_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    assert "to run" in refused(tmp_path, capsys)
    assert "to run" in refused(tmp_path / "none", capsys)


def test_run_of_too_soft_grains_ends_with_their_overlap(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    """What was sampled until then is left, and nothing was averaged."""
    folder = written(tmp_path, scene_of(), 5000, 0, 500, stiffness=0.5)
    assert main([str(folder)]) == 1
    printed = capsys.readouterr()
    assert "overlap_exceeded" in printed.out
    assert "overlap" in printed.err
    series = read_samples(folder / FORCES, {"overlap": "1"})
    assert 0 < len(series.time) < 275
    assert series.channels["overlap"][-1] > 1.0 > series.channels["overlap"][0]
    assert list(dem_column.profiles(folder)) == []


def test_every_sum_of_a_profile_is_kept(column: Callable):
    profile = column("moving").profiles[-1]
    for name in (field.name for field in fields(Profile) if field.name != "time"):
        assert getattr(profile, name).shape == profile.height.shape
        assert getattr(profile, name).any()
