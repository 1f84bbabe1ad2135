"""Decks of planar beds on the engines: forces in closed form, and motion against a plain loop.

Every engine moves each bed once: discs on their own, some clumps too, and one where they collide.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from itertools import combinations
from math import log, pi, sqrt

import jinja2
import jinja2.meta
import numpy as np
import pytest

import liftdrag.deck.planar
from liftdrag.deck import Deck
from liftdrag.deck.dialect import DIALECTS, LAMMPS_2021, LIGGGHTS, Contact, Dialect
from liftdrag.deck.planar import HEAVY, PlanarBed, PlanarSteps, build
from liftdrag.deck.template import template
from liftdrag.engines import engine
from liftdrag.engines.base import silent
from liftdrag.engines.family import read_dump
from liftdrag.errors import CaseError
from liftdrag.hertz import effective_modulus, stiffness, tangential_damping
from liftdrag.series import Series
from liftdrag.snapshot import Snapshot

CONTACT = Contact(5e6, 0.45, 0.6, 0.5, 1e-3)
MODULUS = effective_modulus(CONTACT.youngs_modulus, CONTACT.poisson_ratio)
OVERLAP = 4e-5
GAP = -OVERLAP * 1e3
WIDTH, HEIGHT = 40.0, 30.0
STEPS = PlanarSteps(2e-6, 1500, 1, 500, 2e-4, 500)

on_each = pytest.mark.parametrize("name", ["lammps", "lmp", "liggghts"])
each_bed = pytest.mark.parametrize("which", ["discs", "clumps"])
dialect = pytest.mark.parametrize("dialect", DIALECTS, ids=lambda dialect: dialect.name)


def bed_of(
    discs: list[tuple[float, float, float, float, int]],
    motion: dict[int, tuple[float, float, float]],
) -> PlanarBed:
    """Discs by x, y, radius (mm), mass (g) and body; bodies by velocity (m/s) and spin (rad/s)."""
    x, y, radius, mass = 1e-3 * np.array([row[:4] for row in discs]).T
    body = np.array([row[4] for row in discs])
    position, velocity, spin = np.column_stack([x, y]), np.zeros((len(x), 2)), np.zeros(len(x))
    for number, (vx, vy, turning) in motion.items():
        part = body == number
        away = position[part] - np.average(position[part], axis=0, weights=mass[part])
        velocity[part] = [vx, vy] + turning * turned(away)
        spin[part] = turning
    return PlanarBed(
        position, radius, mass, body, 1e-3 * WIDTH, 1e-3 * HEIGHT,
        np.array([0.02, 0.015]), 3e-3, np.array([0.0, 0.1]), velocity, spin,
    )  # fmt: skip


def turned(vectors: np.ndarray) -> np.ndarray:
    """Vectors (..., 2) turned left by a right angle."""
    return np.stack([-vectors[..., 1], vectors[..., 0]], axis=-1)


DISCS = [
    (10.0, 10.0, 0.5, 3.0, 0),
    (10.0 + 0.6 * (1.3 + GAP), 10.0 + 0.8 * (1.3 + GAP), 0.8, 7.0, 1),  # overlaps the first
    (0.6 + GAP, 20.0, 0.6, 2.0, 2),  # this and the next three overlap the walls
    (WIDTH - 0.7 - GAP, 20.0, 0.7, 3.0, 3),
    (30.0, 0.8 + GAP, 0.8, 4.0, 4),
    (30.0, HEIGHT - 0.9 - GAP, 0.9, 5.0, 5),
    (20.0, 18.5 + GAP, 0.5, 3.0, 6),  # above the intruder, and as fast
    (16.5 - GAP, 15.0, 0.5, 3.0, 7),  # to its left, and as fast
    (30.0, 10.0, 0.5, 3.0, 8),  # strikes the next one off its centre
    (31.31, 10.5, 0.8, 5.0, 9),
]
MOTION = {6: (0.0, 0.1, 0.0), 7: (0.0, 0.1, 0.0), 8: (0.5, 0.1, 90.0), 9: (0.0, 0.0, -50.0)}
STRUCK = [*DISCS, (32.0, 11.5, 0.6, 4.0, 9)]  # overlaps the last one, and is of one body with it
SPINNING = [(10.0, 25.0, 0.7, 3.0, 10), (10.0, 26.0, 0.5, 2.0, 10)]
FREE = {10: (-0.1, 0.2, 150.0)}
BEDS = {
    "discs": bed_of(DISCS, MOTION),
    "clumps": bed_of(STRUCK + SPINNING, MOTION | FREE),
}

CROWD = replace(
    bed_of(
        [
            (0.7, 3.0, 0.6, 2e-3, 0),
            (2.0, 0.8, 0.6, 3e-3, 1),
            (2.7, 1.3, 0.4, 1e-3, 1),
            (5.2, 1.2, 0.7, 4e-3, 2),
            (5.35, 2.6, 0.6, 3e-3, 3),
            (3.1, 5.7, 0.8, 5e-3, 4),
            (4.2, 5.9, 0.5, 2e-3, 4),
            (5.1, 5.2, 0.6, 2e-3, 4),
            (0.9, 5.8, 0.5, 2e-3, 5),
        ],
        {
            0: (0.9, -1.2, 300.0),
            1: (0.3, -0.8, 900.0),
            2: (0.9, -0.3, -200.0),
            3: (-0.4, -0.6, 0.0),
            4: (0.1, 0.5, -300.0),
            5: (-0.6, 0.6, 100.0),
        },
    ),
    width=6e-3,
    height=6.6e-3,
    intruder_position=np.array([3.4e-3, 3.3e-3]),
    intruder_radius=1.1e-3,
    intruder_velocity=np.array([0.0, 1.0]),
)
"""Discs and clumps that strike each other, the intruder and all four walls."""

BRIEF = PlanarSteps(1e-6, 1500, 10, 500, 2e-4, 500)


@dataclass(frozen=True)
class Answer:
    """What a run left: `frames` (t, p + 1, 8) of x y vx vy spin fx fy torque, and its tables."""

    frames: np.ndarray
    series: Series
    snapshots: list[Snapshot]


@pytest.fixture(scope="module")
def moved(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Answer]:
    """Moves a bed on an engine, each time a new one."""

    @cache
    def move(name: str, which: str, friction: float = CONTACT.friction) -> Answer:
        bed, steps = (CROWD, BRIEF) if which == "crowd" else (BEDS[which], STEPS)
        chosen, folder = engine(name), tmp_path_factory.mktemp("planar")
        contact = replace(CONTACT, friction=friction)
        deck = build(contact, bed, steps, chosen.dialect, "moved", "test")
        observed(deck, chosen.dialect).write(folder)
        outcome = chosen.run(deck.plan, folder, silent, alone=True)
        assert outcome.status == "finished", outcome
        frames = np.array([rows[:, 1:] for _, rows in read_dump(folder / "exact.dump")])
        snapshots = list(chosen.snapshots(deck.plan, folder))
        return Answer(frames, chosen.series(deck.plan, folder), snapshots)

    return move


def observed(deck: Deck, dialect: Dialect) -> Deck:
    """The deck with a dump of every step, in full precision."""
    digits = '"%d' + " %.17g" * 8 + '"' if dialect is LIGGGHTS else "float %.17g"
    lines = (
        "dump exact all custom 1 exact.dump id x y vx vy omegaz fx fy tqz\n"
        f"dump_modify exact sort id format {digits}\n"
    )
    text = deck.texts["in.drag2d"].replace("\nrun ", f"\n{lines}run ")
    return replace(deck, texts=dict(deck.texts) | {"in.drag2d": text})


def hertz(radius: float, overlap: float = OVERLAP) -> float:
    """Force (N) at an effective radius (m)."""
    return stiffness(MODULUS, radius) * overlap**1.5


@each_bed
@on_each
def test_unequal_discs_push_each_other_as_hertz_says(name: str, which: str, moved: Callable):
    first, second = moved(name, which).frames[0, :2, 5:7]
    force = hertz(0.5e-3 * 0.8e-3 / 1.3e-3)
    assert second == pytest.approx(force * np.array([0.6, 0.8]), rel=1e-9)
    assert first == pytest.approx(-second, rel=1e-12)


@each_bed
@on_each
def test_each_wall_pushes_back_as_a_plane_of_the_discs_material(
    name: str, which: str, moved: Callable
):
    forces = moved(name, which).frames[0, 2:6, 5:7]
    left, right, bottom, top = (hertz(radius) for radius in (0.6e-3, 0.7e-3, 0.8e-3, 0.9e-3))
    expected = np.array([[left, 0.0], [-right, 0.0], [0.0, bottom], [0.0, -top]])
    assert forces == pytest.approx(expected, rel=1e-9, abs=1e-15)


@each_bed
@on_each
def test_discs_push_the_intruder_back_and_aside(name: str, which: str, moved: Callable):
    force = hertz(0.5e-3 * 3e-3 / 3.5e-3)
    pushed = moved(name, which).frames[0, -1, 5:7]
    assert pushed == pytest.approx([force, -force], rel=1e-9)


@each_bed
@on_each
def test_series_holds_the_forces_on_the_intruder_and_the_walls(
    name: str, which: str, moved: Callable
):
    answer = moved(name, which)
    force, found = answer.frames[:, :, 5:7], answer.series.channels
    assert answer.series.time == pytest.approx(2e-6 * np.arange(1501))
    assert found["drag"] == pytest.approx(-force[:, -1, 1], rel=1e-5, abs=1e-9)
    assert found["lift"] == pytest.approx(force[:, -1, 0], rel=1e-5, abs=1e-9)
    outward = [force[:, 2, 0], -force[:, 3, 0], force[:, 4, 1], -force[:, 5, 1]]
    for wall, expected in zip(["left", "right", "bottom", "top"], outward, strict=True):
        assert found[wall] == pytest.approx(expected, rel=1e-5, abs=1e-9)
    assert min(found[wall][0] for wall in found) > 0.0


@on_each
def test_row_is_the_mean_over_its_steps(name: str, moved: Callable):
    answer = moved(name, "crowd")
    drag = -answer.frames[1:, -1, 6].reshape(-1, BRIEF.row_every).mean(axis=1)
    assert answer.series.channels["drag"] == pytest.approx(drag, rel=1e-5, abs=1e-9)
    assert drag.max() > 0.0


@each_bed
@on_each
def test_intruder_keeps_its_velocity(name: str, which: str, moved: Callable):
    intruder = moved(name, which).frames[:, -1]
    height = 0.015 + 0.1 * 2e-6 * np.arange(1501)
    assert intruder[:, 0] == pytest.approx(0.02, rel=1e-12)
    assert intruder[:, 1] == pytest.approx(height, rel=1e-12)
    assert np.all(intruder[:, 2:4] == [0.0, 0.1])
    assert np.abs(intruder[:, 4]).max() < 1e-9


@each_bed
@on_each
def test_oblique_blow_keeps_momentum_and_angular_momentum(name: str, which: str, moved: Callable):
    """Only with the masses asked for, and moments of inertia of m r^2/2."""
    bed, frames = BEDS[which], moved(name, which).frames
    part = np.isin(bed.body, [8, 9]).nonzero()[0]
    before, after = (momenta(bed, frames[step], part) for step in (0, -1))
    assert after == pytest.approx(before, rel=1e-9)
    assert np.abs(frames[-1, part] - frames[0, part])[:, 4].min() > 10.0


def momenta(bed: PlanarBed, frame: np.ndarray, part: np.ndarray) -> np.ndarray:
    """Momentum (2) and angular momentum about the origin of some discs."""
    x, y, vx, vy, spin = frame[part, :5].T
    mass, inertia = bed.mass[part], 0.5 * bed.mass[part] * bed.radius[part] ** 2
    turning = inertia * spin + mass * (x * vy - y * vx)
    return np.array([(mass * vx).sum(), (mass * vy).sum(), turning.sum()])


@on_each
def test_free_clump_flies_and_spins_as_it_was_told(name: str, moved: Callable):
    frames, bed = moved(name, "clumps").frames, BEDS["clumps"]
    part, mass = [11, 12], bed.mass[[11, 12]]
    start, end = frames[0, part], frames[-1, part]
    assert start[:, 2:5] == pytest.approx(
        np.column_stack([bed.velocity[part], bed.spin[part]]), rel=1e-9
    )
    assert end[:, 4] == pytest.approx([150.0, 150.0], rel=1e-9)
    flown = np.average(end[:, :2] - start[:, :2], axis=0, weights=mass)
    assert flown == pytest.approx(np.array([-0.1, 0.2]) * 3e-3, rel=1e-9)
    axis = end[1, :2] - end[0, :2]
    assert np.arctan2(axis[1], axis[0]) == pytest.approx(pi / 2 + 150.0 * 3e-3, rel=1e-7)


@on_each
def test_discs_of_a_clump_do_not_push_each_other(name: str, moved: Callable):
    assert np.all(moved(name, "clumps").frames[0, 9:13, 5:] == 0.0)


@on_each
def test_snapshots_hold_every_disc_and_the_intruder(name: str, moved: Callable):
    answer, bed = moved(name, "clumps"), BEDS["clumps"]
    assert [shot.time for shot in answer.snapshots] == pytest.approx([0.0, 1e-3, 2e-3, 3e-3])
    start = answer.snapshots[0]
    assert start.kind.tolist() == [1] * len(bed.radius) + [2]
    assert start.position[:-1, :2] == pytest.approx(bed.position, rel=1e-5)
    assert np.all(start.position[:, 2] == 0.0)


@on_each
def test_crowd_moves_as_in_a_plain_loop(name: str, moved: Callable):
    """LIGGGHTS without friction: its tangential spring is another."""
    friction = 0.0 if name == "liggghts" else CONTACT.friction
    frames, expected = moved(name, "crowd", friction).frames, plain_loop(friction)
    assert np.abs(frames[-1, :-1, :2] - expected[:, :2]).max() < 1e-9
    assert np.abs(frames[-1, :-1, 2:4] - expected[:, 2:4]).max() < 1e-5
    assert np.abs(frames[-1, :-1, 4] - expected[:, 4]).max() < 0.05


class Loop:
    """The bed in a plain loop over all pairs and walls, every body with its own motion."""

    def __init__(self, bed: PlanarBed, friction: float):
        self.bed, self.friction = bed, friction
        self.radius = np.append(bed.radius, bed.intruder_radius)
        mass = np.append(bed.mass, HEAVY)
        self.body = np.unique(np.append(bed.body, bed.body.max() + 1), return_inverse=True)[1]
        place = np.vstack([bed.position, bed.intruder_position])
        moving = np.vstack([bed.velocity, bed.intruder_velocity])
        self.mass = np.bincount(self.body, mass)
        self.centre = self.mean(mass, place)
        self.arm = place - self.centre[self.body]
        own = 0.5 * mass * self.radius**2 + mass * (self.arm**2).sum(axis=1)
        self.inertia = np.bincount(self.body, own)
        self.velocity = self.mean(mass, moving)
        self.spin = np.zeros(len(self.mass))
        self.spin[self.body] = np.append(bed.spin, 0.0)
        self.springs: dict[tuple[int, int], float] = {}
        self.loads()

    def mean(self, mass: np.ndarray, values: np.ndarray) -> np.ndarray:
        """The mean over the discs of each body."""
        sums = [np.bincount(self.body, mass * along) for along in values.T]
        return np.column_stack(sums) / self.mass[:, None]

    def step(self, dt: float) -> None:
        """Velocity Verlet; springs grow by the velocities at half of the step."""
        self.kick(dt / 2.0)
        self.centre = self.centre + dt * self.velocity
        angle = (dt * self.spin)[self.body, None]
        self.arm = np.cos(angle) * self.arm + np.sin(angle) * turned(self.arm)
        self.loads(dt)
        self.kick(dt / 2.0)

    def kick(self, dt: float) -> None:
        """Speed the bodies up, but not the intruder."""
        self.velocity[:-1] += dt * (self.force / self.mass[:, None])[:-1]
        self.spin[:-1] += dt * (self.torque / self.inertia)[:-1]

    def discs(self) -> tuple[np.ndarray, np.ndarray]:
        """Positions and velocities of the discs."""
        spin = self.spin[self.body, None]
        return (
            self.centre[self.body] + self.arm,
            self.velocity[self.body] + spin * turned(self.arm),
        )

    def loads(self, dt: float = 0.0) -> None:
        """Forces and torques on the bodies."""
        self.force, self.torque = np.zeros_like(self.velocity), np.zeros_like(self.spin)
        place, moving = self.discs()
        count = len(place)
        for i, j in combinations(range(count), 2):
            if self.body[i] != self.body[j]:
                self.pair(i, j, place, moving, dt)
        bed = self.bed
        for i in range(count - 1):
            for wall in range(4):
                away = np.zeros(2)
                away[wall % 2] = place[i, wall % 2] - (0.0, 0.0, bed.width, bed.height)[wall]
                self.wall(i, -1 - wall, away, moving[i], dt)

    def pair(self, i: int, j: int, place: np.ndarray, moving: np.ndarray, dt: float) -> None:
        """Two discs; the force acts in the middle of the overlap."""
        a, b, away = self.radius[i], self.radius[j], place[i] - place[j]
        overlap = a + b - np.hypot(*away)
        one, other = self.body[i], self.body[j]
        mass = self.mass[one] * self.mass[other] / (self.mass[one] + self.mass[other])
        slip = a * self.spin[one] + b * self.spin[other]
        law = (overlap, a * b / (a + b), mass, moving[i] - moving[j], slip, dt)
        force, rubbing = self.contact((i, j), away, *law)
        for disc, body, sign in ((i, one, 1.0), (j, other, -1.0)):
            self.add(body, self.arm[disc], sign * force)
            self.torque[body] -= (self.radius[disc] - overlap / 2.0) * rubbing

    def wall(self, i: int, wall: int, away: np.ndarray, moving: np.ndarray, dt: float) -> None:
        """A disc and a plane; the force acts at the disc's edge."""
        body, radius = self.body[i], self.radius[i]
        overlap = radius - np.hypot(*away)
        law = (overlap, radius, self.mass[body], moving, radius * self.spin[body], dt)
        force, rubbing = self.contact((i, wall), away, *law)
        self.add(body, self.arm[i], force)
        self.torque[body] -= radius * rubbing

    def add(self, body: int, arm: np.ndarray, force: np.ndarray) -> None:
        """A force at the centre of a disc."""
        self.force[body] += force
        self.torque[body] += arm[0] * force[1] - arm[1] * force[0]

    def contact(
        self,
        key: tuple[int, int],
        away: np.ndarray,
        overlap: float,
        radius: float,
        mass: float,
        velocity: np.ndarray,
        turning: float,
        dt: float,
    ) -> tuple[np.ndarray, float]:
        """The force on the first disc, and its tangential part along the turned normal."""
        if overlap <= 0.0:
            self.springs.pop(key, None)
            return np.zeros(2), 0.0
        normal = away / np.hypot(*away)
        along, size = turned(normal), sqrt(overlap * radius)
        nu, e = CONTACT.poisson_ratio, CONTACT.restitution
        kn = 4.0 / 3.0 * MODULUS * size
        kt = 8.0 * CONTACT.youngs_modulus / (4.0 * (1.0 + nu) * (2.0 - nu)) * size
        damping = sqrt(5.0) * -log(e) / sqrt(pi**2 + log(e) ** 2) * sqrt(mass * kn)
        pushing = kn * overlap - damping * (velocity @ normal)
        slip = velocity @ along - turning
        damping *= tangential_damping(nu)
        sticking = -kt * (self.springs.get(key, 0.0) + slip * dt) - damping * slip
        limit = self.friction * abs(pushing)
        rubbing = min(max(sticking, -limit), limit)
        self.springs[key] = -(rubbing + damping * slip) / kt
        return pushing * normal + rubbing * along, rubbing


@cache
def plain_loop(friction: float) -> np.ndarray:
    """The crowd's discs at the end: x, y, vx, vy, spin."""
    loop = Loop(CROWD, friction)
    for _ in range(BRIEF.count):
        loop.step(BRIEF.time_step)
    place, moving = loop.discs()
    return np.column_stack([place, moving, loop.spin[loop.body]])[:-1]


def deck_of(which: str, dialect: Dialect, name: str = "planar", **changed: object) -> Deck:
    """The deck of a bed, some of whose fields are changed."""
    return build(CONTACT, replace(BEDS[which], **changed), STEPS, dialect, name, "1.2.3")


def asked(name: str) -> set[str]:
    """The names that a template asks for, and those that it includes or extends."""
    tree = jinja2.Environment(trim_blocks=True, lstrip_blocks=True).parse(template(name))
    names = jinja2.meta.find_undeclared_variables(tree)
    for other in jinja2.meta.find_referenced_templates(tree):
        names |= asked(other)
    return names


@each_bed
@dialect
def test_template_uses_every_number_and_no_other(
    which: str, dialect: Dialect, monkeypatch: pytest.MonkeyPatch
):
    seen: list[set[str]] = []
    monkeypatch.setattr(liftdrag.deck.planar, "render", lambda _, names: seen.append(set(names)))
    monkeypatch.setattr(liftdrag.deck.planar, "check_commands", lambda *_: None)
    deck_of(which, dialect)
    assert seen == [asked(f"{dialect.folder}/drag2d.in.j2")]


@each_bed
@dialect
def test_deck_holds_the_plan_and_the_files_that_it_reads(which: str, dialect: Dialect):
    deck = deck_of(which, dialect)
    files = {"in.drag2d", "grains.data"} | ({"clumps.data"} if which == "clumps" else set())
    assert set(deck.texts) == files
    assert all(name in deck.texts["in.drag2d"] for name in files - {"in.drag2d"})
    assert (deck.plan.start, deck.plan.ranks, deck.plan.stages) == ("in.drag2d", 1, {"drive": 1500})
    (line,) = (x for x in deck.texts["in.drag2d"].splitlines() if x.endswith("file forces.dat"))
    channels = [word[2:] for word in line.split() if word.startswith("v_")]
    assert deck.plan.series == {"forces.dat": dict.fromkeys(channels, "N")}


def test_same_bed_gives_the_same_deck_and_another_one_another():
    deck = deck_of("clumps", LAMMPS_2021)
    assert deck_of("clumps", LAMMPS_2021).digest == deck.digest
    faster = np.array([0.0, 0.1 + 1e-9])
    assert deck_of("clumps", LAMMPS_2021, intruder_velocity=faster).digest != deck.digest
    heavier = BEDS["clumps"].mass * (1.0 + 1e-12)
    assert deck_of("clumps", LAMMPS_2021, mass=heavier).digest != deck.digest


def test_hostile_name_stays_a_comment():
    text = deck_of("discs", LIGGGHTS, "x\nshell rm &").texts["in.drag2d"]
    assert "Case x_shell_rm__." in text
    assert "\nshell" not in text


def test_restitution_too_low_for_liggghts_is_refused():
    with pytest.raises(CaseError, match="LIGGGHTS has no restitution so low"):
        build(replace(CONTACT, restitution=0.03), BEDS["discs"], STEPS, LIGGGHTS, "", "")


@dialect
def test_walls_are_planes_of_the_grains_material_whatever_the_contact(dialect: Dialect):
    curved = replace(CONTACT, wall_radius=1e-3, rigid=True)
    deck = build(curved, BEDS["discs"], STEPS, dialect, "planar", "1.2.3")
    assert deck.texts == deck_of("discs", dialect).texts


def test_clumps_are_numbered_and_discs_on_their_own_are_not():
    bed = replace(BEDS["discs"], body=np.array([7, 3, 3, 1, 9, 7, 8, 9, 9, 0]))
    assert bed.clump.tolist() == [2, 1, 1, 0, 3, 2, 0, 3, 3, 0]
    assert bed.clumped
    assert not BEDS["discs"].clumped


@pytest.mark.parametrize(
    ("speed", "low", "high"),
    [(0.1, [0.0, 0.0], [40e-3, 30e-3]), (-10.0, [0.0, -18e-3], [40e-3, 30e-3])],
)
def test_box_is_closed_but_for_the_intruders_way(speed: float, low: list, high: list):
    deck = deck_of("discs", LAMMPS_2021, intruder_velocity=np.array([0.0, speed]))
    lines = deck.texts["grains.data"].splitlines()
    box = np.array([line.split()[:2] for line in lines if line.endswith(("xhi", "yhi"))], float)
    assert box == pytest.approx(np.column_stack([low, high]))
