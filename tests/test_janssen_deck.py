"""Decks of the Janssen piston on the engines: a few grains against closed forms, small columns."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cache
from itertools import product
from math import pi, sqrt
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from liftdrag import hertz
from liftdrag.deck import Deck, Plan
from liftdrag.deck.column import build, check_contact
from liftdrag.deck.dialect import (
    DIALECTS,
    IN_HOUSE,
    LAMMPS,
    LAMMPS_2021,
    LAMMPS_2023,
    LIGGGHTS,
    Dialect,
)
from liftdrag.engines import engine
from liftdrag.engines.base import silent
from liftdrag.engines.family import read_dump
from liftdrag.engines.profiles import read_profiles
from liftdrag.errors import CaseError
from liftdrag.granular import GRAVITY
from liftdrag.numerics import JanssenNumerics, derive
from liftdrag.numerics.janssen import Level
from liftdrag.packing.tube import PackedColumn
from liftdrag.profile import Profile
from liftdrag.scene import JanssenScene
from liftdrag.series import Series

D = 3e-3
MASS = 2500.0 * pi * D**3 / 6.0
WEIGHT = MASS * GRAVITY
FRICTION, TUBE_FRICTION = 0.3, 0.2
REFUSED = ("lmp", "hertz")
NO_LID = np.zeros((0, 3))

on_each = pytest.mark.parametrize("name", ["lammps", "lmp", "liggghts"])
each_law = pytest.mark.parametrize(
    ("name", "contact"),
    [
        pair
        for pair in product(["lammps", "lmp", "liggghts"], ["linear", "hertz"])
        if pair != REFUSED
    ],
)
each_dialect = pytest.mark.parametrize("dialect", DIALECTS, ids=lambda dialect: dialect.name)


def scene_of(
    count: int,
    levels: int = 1,
    diameters: float = 5.06,
    motion: str = "tube up",
    tube_friction: float = TUBE_FRICTION,
    lid_mass: float = 0.0,
    **grains: Any,
) -> JanssenScene:
    """So many grains of 3 mm in a tube of so many diameters."""
    law = {"diameter": D, "density": 2500.0, "restitution": 0.6, "friction": FRICTION}
    law |= {"contact": "linear"} | grains
    if law["contact"] == "hertz":
        law["poisson_ratio"] = 0.3
    still = {"duration": 0.01}
    moving = {"speed": 0.01, "distance": 0.1 * D}
    return JanssenScene.model_validate(
        {
            "scene": "janssen",
            "seed": 1,
            "grains": law,
            "tube": {"diameter": diameters * D, "height": 1.0, "friction": tube_friction},
            "fill": {"mass": count * MASS, "curve": levels > 1, "levels": max(levels, 2)},
            "drive": {"motion": motion} | (still if motion == "none" else moving),
        }
        | ({"overload": {"mass": lid_mass}} if lid_mass else {})
    )


def numerics_of(scene: JanssenScene, levels: list[Level], **values: float) -> JanssenNumerics:
    """Those of the scene, but for the levels and these values."""
    derived = derive(scene)
    changed = {name: replace(getattr(derived, name), value=value) for name, value in values.items()}
    return replace(derived, levels=tuple(levels), **changed)


def every(steps: int, row: int) -> dict[str, int]:
    """Samples every so many steps, and rows of as many, of forces and of profiles."""
    return {
        "sample_every": steps,
        "profile_every": steps,
        "row_every": row,
        "block_every": row,
        "progress_every": 1000,
    }


@dataclass(frozen=True)
class Answer:
    """What a run left.

    `frames` (t, n, 12) of position, velocity, spin and force at `steps` (t,); profiles, series.
    """

    steps: np.ndarray
    frames: np.ndarray
    series: Series
    profiles: list[Profile]
    plan: Plan

    def at(self, step: int) -> np.ndarray:
        """The frame of a step."""
        return self.frames[np.flatnonzero(self.steps == step)[0]]


def carried_out(name: str, deck: Deck, folder: Path) -> Answer:
    """What the engine of this name leaves of a deck."""
    chosen = engine(name)
    deck.write(folder)
    outcome = chosen.run(deck.plan, folder, silent, alone=True)
    assert outcome.status == "finished", outcome
    shots = list(read_dump(folder / "exact.dump"))
    return Answer(
        np.array([step for step, _ in shots]),
        np.array([rows[:, 1:] for _, rows in shots]),
        chosen.series(deck.plan, folder),
        list(chosen.profiles(deck.plan, folder)),
        deck.plan,
    )


def watched(deck: Deck, dialect: Dialect, often: int, before: str = "") -> Deck:
    """The deck with a dump in full precision and, `before` it, some commands."""
    digits = '"%d' + " %.17g" * 12 + '"' if dialect is LIGGGHTS else "float %.17g"
    lines = (
        f"{before}\ndump exact all custom {often} exact.dump "
        "id x y z vx vy vz omegax omegay omegaz fx fy fz\n"
        f"dump_modify exact sort id format {digits}\n"
    )
    text = deck.texts["in.janssen"].replace("\nrun ", f"\n{lines}run ", 1)
    return replace(deck, texts=dict(deck.texts) | {"in.janssen": text})


# A few grains, far from each other in a wide tube: some overlap at first, some are thrown.

WIDE = 16.0
R, TUBE = 0.5 * D, 0.5 * WIDE * D
OVERLAP = 2e-3 * D
STIFFNESS = {"linear": 1e5, "hertz": 1e8}
RESTING, IN_TUBE, LOWER, UPPER, ON_PISTON, AT_TUBE, ONE, OTHER, IN_PISTON, STUCK = range(10)
THROWN = {
    ON_PISTON: (1.0, 0.0, -0.5),
    AT_TUBE: (0.0, 0.5, 0.0),
    ONE: (0.0, 0.4, 0.0),
    OTHER: (0.0, -0.4, 0.0),
    STUCK: (0.05, 0.0, -0.5),
}
WALL_SPEED = 1.0
THROW_STEPS = 500


def law(contact: str, partner: str) -> tuple[float, float]:
    """The factor and the power of the overlap in the normal force of two grains, or at a wall."""
    if contact == "linear":
        return STIFFNESS[contact], 1.0
    radius = R / 2.0 if partner == "grain" else R
    return hertz.stiffness(hertz.effective_modulus(STIFFNESS[contact], 0.3), radius), 1.5


def force(contact: str, partner: str, overlap: float) -> float:
    """The normal force (N)."""
    factor, power = law(contact, partner)
    return factor * overlap**power


def resting_overlap(contact: str) -> float:
    """The overlap (m) at which the piston bears a grain."""
    factor, power = law(contact, "wall")
    return (WEIGHT / factor) ** (1.0 / power)


def throw_step(contact: str) -> float:
    """A step (s) of about 1/200 of a contact."""
    if contact == "linear":
        return pi * sqrt(MASS / 2.0 / STIFFNESS[contact]) / 200.0
    return hertz.hertz_time(law(contact, "grain")[0], MASS / 2.0, 0.8) / 200.0


def throw_deck(contact: str, restitution: float, dialect: Dialect) -> Deck:
    """The grains by their numbers above; in a second run, as no law may change from run to run."""
    scene = scene_of(10, diameters=WIDE, contact=contact, restitution=restitution)
    drive = scene.drive.model_copy(update={"speed": WALL_SPEED})
    scene = scene.model_copy(update={"drive": drive})
    step = throw_step(contact)
    gap = 2.0 * step
    centres = np.array(
        [
            [0.0, 0.0, R - resting_overlap(contact)],
            [TUBE - R + OVERLAP, 0.0, 5.0 * D],
            [0.0, 0.0, 9.0 * D - R + OVERLAP / 4.0],
            [0.0, 0.0, 9.0 * D + R - OVERLAP / 4.0],
            [4.0 * D, 0.0, R + 0.5 * gap],
            [0.0, TUBE - R - 0.5 * gap, 7.0 * D],
            [0.0, -R - 0.4 * gap, 13.0 * D],
            [0.0, R + 0.4 * gap, 13.0 * D],
            [-4.0 * D, 0.0, R - OVERLAP],
            [0.0, 4.0 * D, R + 0.5 * gap],
        ]
    )
    numerics = numerics_of(
        scene,
        [Level(10, 0, 0, 0, THROW_STEPS)],
        stiffness=STIFFNESS[contact],
        time_step=step,
        **every(1, 1),
    )
    deck = build(scene, numerics, PackedColumn(centres, NO_LID), "thrown", "test", 1, dialect)
    throws = [
        f"group one id {grain + 1}\nvelocity one set {vx} {vy} {vz}\ngroup one delete"
        for grain, (vx, vy, vz) in THROWN.items()
    ]
    return watched(deck, dialect, 1, "\n".join([*throws, "run 0"]))


@pytest.fixture(scope="module")
def thrown(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Answer]:
    """The thrown grains on an engine, each once."""

    @cache
    def run(name: str, contact: str, restitution: float = 0.6) -> Answer:
        deck = throw_deck(contact, restitution, engine(name).dialect)
        return carried_out(name, deck, tmp_path_factory.mktemp("thrown"))

    return run


@each_law
def test_grains_and_walls_push_as_the_law_says(name: str, contact: str, thrown: Callable):
    """The tube, too, is a plane to the grains that touch it."""
    forces = thrown(name, contact).frames[0, :, 9:] + [0.0, 0.0, WEIGHT]
    assert forces[IN_TUBE, :2] == pytest.approx([-force(contact, "wall", OVERLAP), 0.0], rel=1e-9)
    assert forces[IN_PISTON, 2] == pytest.approx(force(contact, "wall", OVERLAP), rel=1e-9)
    pair = force(contact, "grain", OVERLAP / 2.0)
    assert forces[[LOWER, UPPER], 2] == pytest.approx([-pair, pair], rel=1e-9)


@each_law
def test_grain_rests_on_the_piston_where_it_is_borne(name: str, contact: str, thrown: Callable):
    heights = thrown(name, contact).frames[:, RESTING, 2]
    assert R - heights == pytest.approx(resting_overlap(contact), rel=1e-6)


@each_law
def test_grains_bounce_off_each_other_and_the_walls(name: str, contact: str, thrown: Callable):
    frames = thrown(name, contact).frames
    left = np.flatnonzero(frames[1:, ON_PISTON, 2] > R)[1] + 1
    assert left < THROW_STEPS
    assert frames[left, ON_PISTON, 5] / 0.5 == pytest.approx(0.6, rel=0.02)
    assert frames[-1, AT_TUBE, 4] / -0.5 == pytest.approx(0.6, rel=0.01)
    assert frames[-1, [ONE, OTHER], 4] / 0.4 == pytest.approx([-0.6, 0.6], rel=0.01)


@each_law
def test_elastic_grains_keep_their_energy_and_slide_with_the_friction_of_each_wall(
    name: str, contact: str, thrown: Callable
):
    """The tube moves up, lifts the grain that strikes it, and makes it roll up."""
    answer = thrown(name, contact, 1.0)
    frames, fall = answer.frames, GRAVITY * answer.series.time[-1]
    assert frames[-1, AT_TUBE, 4] == pytest.approx(-0.5, rel=1e-4)
    assert frames[-1, ONE, 4] == pytest.approx(-0.4, rel=1e-4)
    assert 1.0 - frames[-1, ON_PISTON, 3] == pytest.approx(FRICTION, rel=2e-3)
    turned = 0.5 - frames[-1, AT_TUBE, 4]
    assert frames[-1, AT_TUBE, 5] + fall == pytest.approx(TUBE_FRICTION * turned, rel=1e-6)
    rolling = 2.5 * TUBE_FRICTION / R
    assert frames[-1, AT_TUBE, 6] == pytest.approx(rolling, rel=0.01)


@on_each
def test_elastic_grain_that_sticks_to_the_piston_turns_its_surface_back(
    name: str, thrown: Callable
):
    """The tangential spring swings as long as the normal one when it has 2/7 of its stiffness."""
    stuck = thrown(name, "linear", 1.0).frames[-1, STUCK]
    assert stuck[3] == pytest.approx(3.0 / 7.0 * 0.05, rel=0.02)
    assert stuck[3] - R * stuck[7] == pytest.approx(-0.05, rel=0.02)


@each_law
def test_first_profile_holds_what_is_known_of_each_grain(name: str, contact: str, thrown: Callable):
    answer = thrown(name, contact)
    first = answer.profiles[0]
    assert first.time == 0.0
    assert first.height[:3] == pytest.approx([D, 3.0 * D, 5.0 * D])
    assert first.count[:8].tolist() == [4, 0, 1, 1, 2, 0, 2, 0]
    pair = force(contact, "grain", OVERLAP / 2.0) * (D - OVERLAP / 2.0)
    assert first.virial[4] == pytest.approx(pair, rel=1e-5)
    assert first.virial.sum() == pytest.approx(pair, rel=1e-5)
    assert first.wall_normal[2] == pytest.approx(force(contact, "wall", OVERLAP), rel=1e-5)
    assert first.wall_contacts.tolist() == [0, 0, 1] + [0] * (len(first.count) - 3)


@each_law
def test_profile_follows_a_grain_that_slides_on_the_tube(name: str, contact: str, thrown: Callable):
    """In the slice of the grain thrown at the tube; elastic, or a damping would add to it."""
    answer = thrown(name, contact, 1.0)
    spins, velocities = answer.frames[:, AT_TUBE, 6], answer.frames[:, AT_TUBE, 4]
    half = int(np.argmin(np.abs(velocities)))
    one = answer.profiles[half]
    pressing = -answer.frames[half, AT_TUBE, 10]
    assert one.time == pytest.approx(answer.series.time[half])
    assert one.wall_normal[3] == pytest.approx(pressing, rel=1e-4)
    assert one.wall_shear[3] == pytest.approx(TUBE_FRICTION * pressing, rel=1e-4)
    assert one.mobilisation[3] == pytest.approx(1.0, rel=1e-5)
    assert (one.wall_contacts[3], one.sliding[3]) == (1.0, 1.0)
    assert one.spin[3] == pytest.approx(spins[half], rel=1e-4)
    assert answer.profiles[-1].spin[3] == 0.0


@on_each
def test_series_holds_the_forces_on_the_walls_and_the_mean_energy(name: str, thrown: Callable):
    answer = thrown(name, "linear")
    found, frames = answer.series.channels, answer.frames
    on_piston = WEIGHT + force("linear", "wall", OVERLAP)
    assert found["piston"][0] == pytest.approx(on_piston, rel=1e-5)
    assert found["wall_normal"][0] == pytest.approx(force("linear", "wall", OVERLAP), rel=1e-5)
    energy = 0.5 * MASS * (frames[:, :, 3:6] ** 2).sum(axis=2).mean(axis=1)
    assert found["kinetic"] == pytest.approx(energy, rel=1e-5)
    lifted = frames[:, [IN_TUBE, AT_TUBE], 11].sum(axis=1) + 2.0 * WEIGHT
    assert found["tube"] == pytest.approx(lifted, abs=1e-5 * lifted.max())


# Small columns, filled in three steps.

STEP = 3e-5
LID_MASS = 2e-3
SPACING = 1.01 * D


def lattice(scene: JanssenScene, with_lid: bool) -> PackedColumn:
    """Hexagonal layers, one in the dents of the other, jittered; a lid clear of the tube."""
    radius, rng = scene.tube.diameter / 2.0, np.random.default_rng(3)
    count, layers = scene.grain_count, list[np.ndarray]()
    while sum(map(len, layers)) < count:
        shift = (len(layers) % 2) / sqrt(3.0) * SPACING
        layers.append(hexagonal(radius - 0.505 * D, shift))
    rows = np.repeat(np.arange(len(layers)), [len(layer) for layer in layers])[:count]
    heights = 0.52 * D + sqrt(2.0 / 3.0) * SPACING * rows
    grains = np.column_stack([np.concatenate(layers)[:count], heights])
    grains += rng.uniform(-0.003 * D, 0.003 * D, (count, 3))
    grains = grains[np.argsort(grains[:, 2])]
    lid = hexagonal(radius - D, 0.0) if with_lid else np.zeros((0, 2))
    return PackedColumn(grains, np.insert(lid, 2, grains[:, 2].max() + D, axis=1))


def hexagonal(radius: float, shift: float) -> np.ndarray:
    """Places (n, 2) not farther than `radius` from the middle, shifted along y."""
    steps = SPACING * np.array([[1.0, 0.0], [0.5, sqrt(0.75)]])
    plane = np.array(list(product(range(-9, 10), repeat=2))) @ steps + [0.0, shift]
    inside: np.ndarray = plane[np.hypot(*plane.T) <= radius]
    return inside


def levels_of(scene: JanssenScene, settle: int, mobilise: int, average: int) -> list[Level]:
    """Levels of the scene's counts, all of the same phases."""
    whole, levels = settle + mobilise + average, list[Level]()
    for number, count in enumerate(scene.counts):
        start = number * whole
        settled = start + settle
        levels.append(Level(count, start, settled, settled + mobilise, start + whole))
    return levels


COLUMNS: dict[str, tuple[JanssenScene, tuple[int, int, int], dict[str, float]]] = {
    "rest": (
        scene_of(120, 3, motion="none", lid_mass=LID_MASS),
        (5000, 0, 400),
        {"settle_rate": 60.0} | every(10, 200),
    ),
    "moving": (scene_of(120, 2), (3000, 1500, 300), {"settle_rate": 60.0} | every(5, 5)),
    "smooth": (
        scene_of(120, 3, friction=0.0, tube_friction=0.0, lid_mass=LID_MASS),
        (400, 200, 0),
        {"settle_rate": 60.0} | every(10, 100),
    ),
}


@pytest.fixture(scope="module")
def column(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str, str], Answer]:
    """The small columns on an engine, each once."""

    @cache
    def run(name: str, which: str) -> Answer:
        scene, phases, values = COLUMNS[which]
        packed, dialect = lattice(scene, scene.overload is not None), engine(name).dialect
        numerics = numerics_of(
            scene, levels_of(scene, *phases), stiffness=300.0, time_step=STEP, **values
        )
        deck = build(scene, numerics, packed, which, "test", 1, dialect)
        folder = tmp_path_factory.mktemp("column")
        return carried_out(name, watched(deck, dialect, 100), folder)

    return run


def fills(answer: Answer) -> Iterator[tuple[int, slice, list[Profile]]]:
    """Of each fill the grains, and the rows and profiles of its average."""
    for count, _, first, last in answer.plan.fills:
        late = answer.series.time > (first + 0.5) * STEP
        rows = np.flatnonzero(late & (answer.series.time < (last + 0.5) * STEP))
        yield (
            count,
            slice(rows[0], rows[-1] + 1),
            [one for one in answer.profiles if (first + 0.5) * STEP < one.time < last * STEP],
        )


@on_each
def test_piston_and_tube_carry_the_weight_at_rest(name: str, column: Callable):
    answer = column(name, "rest")
    found = answer.series.channels
    for count, rows, _ in fills(answer):
        carried = (found["piston"] + found["tube"])[rows].mean()
        assert carried == pytest.approx(count * WEIGHT + LID_MASS * GRAVITY, rel=2e-3)


@on_each
def test_forces_of_a_moving_column_change_its_momentum(name: str, column: Callable):
    answer = column(name, "moving")
    found = answer.series.channels
    for (count, _, first, last), (_, rows, _) in zip(answer.plan.fills, fills(answer), strict=True):
        gained = MASS * (answer.at(last) - answer.at(first))[:count, 5].sum()
        expected = count * WEIGHT + gained / ((last - first) * STEP)
        assert (found["piston"] + found["tube"])[rows].mean() == pytest.approx(expected, rel=5e-3)
        assert found["tube"][rows].mean() > 0.05 * count * WEIGHT


@pytest.mark.parametrize("which", ["rest", "moving"])
@on_each
def test_profile_holds_the_grains_of_its_fill(name: str, which: str, column: Callable):
    answer = column(name, which)
    for count, start, _, last in answer.plan.fills:
        during = [one for one in answer.profiles if start < one.time / STEP - 0.5 < last]
        assert during
        assert all(one.count.sum() == pytest.approx(count, rel=1e-5) for one in during)


@pytest.mark.parametrize("which", ["rest", "moving"])
@on_each
def test_profile_sums_up_to_the_forces_on_the_tube(name: str, which: str, column: Callable):
    answer = column(name, which)
    found, profiles = answer.series.channels, answer.profiles
    assert answer.series.time == pytest.approx([one.time for one in profiles])
    for channel, parts in (
        ("tube", [one.wall_shear.sum() for one in profiles]),
        ("wall_normal", [one.wall_normal.sum() for one in profiles]),
    ):
        largest = np.abs(found[channel]).max()
        assert found[channel] == pytest.approx(np.array(parts), abs=1e-4 * largest)
        assert largest > 0.0


@on_each
def test_friction_of_the_tube_is_mobilised_up_to_its_limit(name: str, column: Callable):
    answer = column(name, "moving")
    contacts, mobilised, sliding = (
        np.array([getattr(one, field) for one in answer.profiles])
        for field in ("wall_contacts", "mobilisation", "sliding")
    )
    assert np.all(mobilised <= contacts * (1.0 + 1e-5))
    assert np.all(sliding <= contacts * (1.0 + 1e-5))
    assert np.all(mobilised >= 0.99 * sliding - 1e-5)
    late = np.concatenate([np.arange(len(contacts))[rows] for _, rows, _ in fills(answer)])
    assert 0.5 < mobilised[late].sum() / contacts[late].sum() < 1.0
    spin = np.array([one.spin for one in answer.profiles])
    assert spin[late].sum() > 0.0


@on_each
def test_contacts_of_the_column_outlive_the_coming_of_a_layer(name: str, column: Callable):
    """Its forces, tangential ones too, go on from step to step."""
    answer = column(name, "moving")
    virial = np.array([one.virial.sum() for one in answer.profiles])
    before = np.flatnonzero(answer.series.time > (answer.plan.fills[1][1] - 0.5) * STEP)[0]
    for values in (virial, answer.series.channels["tube"], answer.series.channels["piston"]):
        assert values[before : before + 5] == pytest.approx(values[before], rel=0.01)


@on_each
def test_grains_wait_for_their_fill(name: str, column: Callable):
    scene = COLUMNS["rest"][0]
    packed, answer = lattice(scene, True).grains, column(name, "rest")
    for count, _, _, last in answer.plan.fills[:-1]:
        frame, after = answer.at(last)[:120], answer.at(last + 100)[:120]
        assert frame[count:, :3] == pytest.approx(packed[count:], abs=1e-12)
        assert np.all(frame[count:, 3:] == 0.0)
        layer = slice(count, count + 40)
        gap = after[layer, 2].min() - frame[:count, 2].max()
        fallen = 0.5 * GRAVITY * (100 * STEP) ** 2
        assert gap == pytest.approx(D - fallen, abs=0.3 * fallen + 0.01 * D)
        assert after[layer, :2] == pytest.approx(packed[layer, :2], abs=1e-12)


@on_each
def test_lid_moves_vertically_and_lies_on_top(name: str, column: Callable):
    scene = COLUMNS["rest"][0]
    packed, answer = lattice(scene, True).lid, column(name, "rest")
    lid = answer.frames[:, 120:]
    assert np.abs(lid[:, :, :2] - packed[:, :2]).max() < 1e-9
    assert np.abs(lid[:, :, 3:5]).max() < 1e-12
    assert np.ptp(lid[:, :, 2], axis=1).max() < 1e-9
    for count, _, _, last in answer.plan.fills:
        frame = answer.at(last)
        top = np.sort(frame[:count, 2])[-5:].mean()
        assert abs(frame[120:, 2].mean() - top) < 1.5 * D
    assert len({round(frame[120:, 2].mean() / D) for frame in answer.frames}) > 3


@on_each
def test_grain_slides_on_the_piston_until_it_rolls(name: str, tmp_path: Path):
    """Slowed by its friction at first, to five sevenths of its speed at last."""
    scene, dialect, speed = scene_of(1, motion="none"), engine(name).dialect, 0.1
    resting = np.array([[0.0, 0.0, R - WEIGHT / 300.0]])
    values: dict[str, float] = {"stiffness": 300.0, "time_step": STEP, **every(10, 100)}
    numerics = numerics_of(scene, [Level(1, 0, 0, 0, 500)], **values)
    deck = build(scene, numerics, PackedColumn(resting, NO_LID), "slide", "test", 1, dialect)
    start = f"velocity all set {speed} 0 0"
    answer = carried_out(name, watched(deck, dialect, 100, start), tmp_path)
    slowed = answer.at(100)[0, 3] - answer.at(200)[0, 3]
    assert slowed == pytest.approx(FRICTION * GRAVITY * 100 * STEP, rel=1e-4)
    assert answer.at(500)[0, 3] == pytest.approx(5.0 / 7.0 * speed, rel=1e-3)


@on_each
def test_lid_falls_past_few_grains_onto_the_piston(name: str, tmp_path: Path):
    scene = scene_of(1, lid_mass=5.0 * MASS, motion="none")
    dialect = engine(name).dialect
    lid = np.array([[1.1 * D, 0.0, 3.0 * D], [-1.1 * D, 0.0, 3.0 * D]])
    packed = PackedColumn(np.array([[0.0, 0.0, R]]), lid)
    numerics = numerics_of(
        scene,
        levels_of(scene, 4000, 0, 200),
        stiffness=300.0,
        time_step=STEP,
        settle_rate=60.0,
        **every(10, 200),
    )
    deck = build(scene, numerics, packed, "one", "test", 1, dialect)
    answer = carried_out(name, watched(deck, dialect, 100), tmp_path)
    assert answer.series.channels["piston"][-1] == pytest.approx(6.0 * WEIGHT, rel=2e-3)


@pytest.mark.needs("lmp", "liggghts")
@pytest.mark.parametrize(("other", "bound"), [("lmp", 1e-11), ("liggghts", 1e-9)])
def test_engines_move_frictionless_grains_alike(other: str, bound: float, column: Callable):
    """Layers and lid come at the same places; LIGGGHTS substitutes numbers with fewer digits."""
    one, same = column("lammps", "smooth"), column(other, "smooth")
    assert np.abs(one.frames[:, :, :3] - same.frames[:, :, :3]).max() < bound
    forces, others = one.series.channels["piston"], same.series.channels["piston"]
    assert others == pytest.approx(forces, abs=1e-4 * forces.max())


# What the decks say.


def text_of(dialect: Dialect, scene: JanssenScene, phases: tuple[int, int, int]) -> str:
    numerics = numerics_of(scene, levels_of(scene, *phases))
    packed = lattice(scene, scene.overload is not None)
    return build(scene, numerics, packed, "a case", "1.0", 2, dialect).texts["in.janssen"]


@pytest.mark.parametrize("lid_mass", [0.0, LID_MASS])
@pytest.mark.parametrize("friction", [0.0, 0.5])
@pytest.mark.parametrize("contact", ["linear", "hertz"])
@pytest.mark.parametrize("dialect", [LAMMPS, LAMMPS_2023, LIGGGHTS], ids=lambda one: one.name)
def test_deck_takes_the_steps_of_its_levels(
    dialect: Dialect, contact: str, friction: float, lid_mass: float
):
    scene = scene_of(80, 4, contact=contact, tube_friction=friction, lid_mass=lid_mass)
    for phases in product((0, 40), (0, 30), (0, 20)):
        lines = text_of(dialect, scene, phases).splitlines()
        runs = [int(line.split()[1]) for line in lines if line.startswith("run ")]
        assert runs == 4 * [steps for steps in phases if steps]


@each_dialect
def test_settling_slows_grains_and_lid_at_the_same_rate(dialect: Dialect):
    scene = scene_of(40, 2, lid_mass=LID_MASS)
    lines = text_of(dialect, scene, (10, 10, 10)).splitlines()
    damped = {tuple(line.split()[1:5]) for line in lines if " viscous " in line}
    rate, lid = derive(scene).settle_rate.value, len(lattice(scene, True).lid)
    assert damped == {
        ("damping", "column", "viscous", f"{rate * MASS:.15g}"),
        ("lid_damping", "lid", "viscous", f"{rate * LID_MASS / lid:.15g}"),
    }


@each_dialect
def test_grains_of_a_lid_do_not_push_each_other(dialect: Dialect):
    text = text_of(dialect, scene_of(40, 2, lid_mass=LID_MASS), (10, 10, 10))
    assert "\nneigh_modify exclude group lid lid " in text


@each_dialect
def test_wall_moves_down_when_the_piston_moves_up(dialect: Dialect):
    scene = scene_of(40, 2, motion="piston up")
    assert "wall_speed  index -0.01 " in text_of(dialect, scene, (10, 10, 10))


def test_deck_of_many_levels_needs_no_more_groups_than_there_are():
    lines = text_of(LAMMPS, scene_of(640, 64), (10, 10, 10)).splitlines()
    names = {line.split()[1] for line in lines if line.startswith("group ")}
    assert names == {"column", "loaded", "waiting", "layer"}


def test_box_has_room_for_every_layer_to_fall_and_for_whole_slices():
    scene = scene_of(640, 64)
    numerics = numerics_of(scene, levels_of(scene, 10, 10, 10), bin_height=1.7 * D)
    packed = lattice(scene, False)
    deck = build(scene, numerics, packed, "high", "1.0", 1, LAMMPS)
    low, high = next(
        map(float, line.split()[:2])
        for line in deck.texts["column.data"].splitlines()
        if line.endswith("zlo zhi")
    )
    assert low == 0.0
    assert high > packed.grains[:, 2].max() + 64.0 * D
    assert high / (1.7 * D) == pytest.approx(round(high / (1.7 * D)), rel=1e-9)


@each_dialect
def test_walton_braun_is_refused(dialect: Dialect):
    with pytest.raises(CaseError, match=f"{dialect.name} has no Walton-Braun contact") as refused:
        check_contact(scene_of(40, contact="walton-braun"), dialect)
    assert "--engine dem" in str(refused.value)


def test_walton_braun_is_for_the_in_house_engine():
    check_contact(scene_of(40, contact="walton-braun"), IN_HOUSE)


def test_lammps_of_2021_is_refused_for_hertz_only():
    """At each run it takes the damping of a wall for a restitution, and computes it again."""
    check_contact(scene_of(40), LAMMPS_2021)
    with pytest.raises(CaseError, match="lammps-2021 damps Hertz walls differently at each run"):
        check_contact(scene_of(40, contact="hertz"), LAMMPS_2021)


def test_liggghts_refuses_a_low_restitution_of_hertz_only():
    check_contact(scene_of(40, restitution=0.01), LIGGGHTS)
    with pytest.raises(CaseError, match="restitution"):
        check_contact(scene_of(40, contact="hertz", restitution=0.01), LIGGGHTS)


# Files of profiles.

HEADER = """# Chunk-averaged data for fix profile and group column
# Timestep Number-of-chunks Total-count
# Chunk Coord1 Ncount v_virial v_normal v_shear v_touches v_mobilisation v_sliding v_spin
"""
BLOCK = """{step} 2 12
  1 0.003 8 1 2 3 0.5 0.25 0.125 -4
  2 0.009 4 0 0 0 0 0 0 0
"""
WHOLE = HEADER + BLOCK.format(step=100) + BLOCK.format(step=200)


def test_profiles_are_averages_times_grains(tmp_path: Path):
    path = tmp_path / "profile.dat"
    for text in (WHOLE, WHOLE.replace("Chunk Coord1", "Bin Coord").replace("2 12", "2")):
        path.write_text(text)
        first, last = read_profiles(path, 1e-3)
        assert (first.time, last.time) == (pytest.approx(0.1), pytest.approx(0.2))
        assert first.height.tolist() == [0.003, 0.009]
        assert first.count.tolist() == [8.0, 4.0]
        found = [first.virial[0], first.wall_normal[0], first.wall_shear[0], first.wall_contacts[0]]
        assert found == [8.0, 16.0, 24.0, 4.0]
        assert [first.mobilisation[0], first.sliding[0], first.spin[0]] == [2.0, 1.0, -32.0]


@pytest.mark.parametrize("lost", range(1, len(BLOCK.format(step=200))))
def test_profile_that_is_cut_short_is_left_out(tmp_path: Path, lost: int):
    path = tmp_path / "profile.dat"
    path.write_text(WHOLE[:-lost])
    assert [one.time for one in read_profiles(path, 1.0)] == [100.0]


def test_no_file_has_no_profiles(tmp_path: Path):
    assert list(read_profiles(tmp_path / "profile.dat", 1.0)) == []


@pytest.mark.parametrize(
    ("right", "wrong", "says"),
    [
        ("100 2 12", "100 two 12", "not the head of a block"),
        ("100 2 12", "100 3 12", "no rows of 10 numbers"),
        ("0.25 0.125", "0.25 0,125", "no rows of 10 numbers"),
        ("0.25 0.125", "0.25", "no rows of 10 numbers"),
        (" v_spin", "", "names no v_spin"),
        ("Ncount", "count", "names no Ncount"),
    ],
)
def test_damaged_profile_is_refused(tmp_path: Path, right: str, wrong: str, says: str):
    path = tmp_path / "profile.dat"
    path.write_text(WHOLE.replace(right, wrong, 1))
    with pytest.raises(ValueError, match=says):
        list(read_profiles(path, 1.0))
