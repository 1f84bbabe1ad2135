"""What a deck leaves out changes nothing; the cheaper contact law is what it is said to be."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from math import gamma, radians, sqrt, tan
from pathlib import Path

import numpy as np
import pytest
from conftest import tiny_tank
from test_engines_agree import PRECISE

from liftdrag import hertz
from liftdrag.classic import classic, damping_number, rebound
from liftdrag.deck.dialect import LAMMPS, LAMMPS_2021, LIGGGHTS, Contact
from liftdrag.deck.tank import build, contact_of
from liftdrag.engines import ENGINES, engine
from liftdrag.engines.impact import Impact, Throw, impacts
from liftdrag.engines.probes import TANK, Subject, probe
from liftdrag.errors import CaseError
from liftdrag.granular import GRAVITY
from liftdrag.numerics import derive
from liftdrag.speed.skips import WORK
from liftdrag.tank import prepare

CASE = tiny_tank(tank={"thickness": "4 d"})
SLIPPERY = CASE.set("grains.friction", 0.0)
CLASSIC = CASE.set("numerics.pair_law", "hertz/history")
D = CASE.scene.grains.diameter

STEPS = 300

Change = Callable[[str], str]


@cache
def decks(name: str, slippery: bool):
    """The deck of the case, whose drive starts at once from the bed as packed, and is short."""
    case = SLIPPERY if slippery else CASE
    _, deck = prepare(case, dialect=engine(name).dialect)
    before, rest = deck.texts["in.tank"].split("# Stage 1")
    text = before + "#" + rest.split("# Stage 2")[1].replace("sort id", PRECISE[name])
    text = re.sub(r"(drive_steps index) \d+", rf"\1 {STEPS}", text)
    text = re.sub(r"(snapshots all custom) \d+", rf"\1 {STEPS}", text)
    plan = replace(deck.plan, stages={"drive": STEPS}, series={})
    return replace(deck, plan=plan), text


def driven(name: str, folder: Path, change: Change = str, slippery: bool = False) -> np.ndarray:
    """Positions and velocities (n, 6) after the first steps, in d and m/s."""
    deck, text = decks(name, slippery)
    replace(deck, texts=dict(deck.texts) | {"in.tank": change(text)}).write(folder)
    outcome = engine(name).run(deck.plan, folder, lambda *_: None)
    assert outcome.status == "finished", outcome.evidence
    *_, last = engine(name).snapshots(deck.plan, folder)
    assert last.time == pytest.approx(STEPS * deck.plan.time_step)
    return np.column_stack([last.position / D, last.velocity])


def with_springs(text: str) -> str:
    """The deck of grains without friction as of those with: springs, their damping, and spins."""
    text = text.replace("tangential linear_nohistory 0 0", "tangential mindlin NULL 0.8424 0")
    text = text.replace("tangential off primitive", "tangential history primitive")
    text = text.replace("tangential off", "tangential history tangential_damping off")
    text = text.replace("store_force yes", "store_force yes tangential_damping off")
    return re.sub(r"grains nve\b", "grains nve/sphere", text)


@pytest.mark.parametrize("name", ENGINES)
def test_grains_without_friction_need_neither_springs_nor_spins(name: str, tmp_path: Path):
    """The same steps to rounding, and quite others with friction."""
    words = " ".join(line.partition("#")[0] for line in decks(name, True)[1].splitlines()).split()
    assert not {"nve/sphere", "history", "mindlin"} & set(words)
    bare = driven(name, tmp_path / "bare", slippery=True)
    full = driven(name, tmp_path / "full", with_springs, slippery=True)
    assert np.abs(bare - full).max() < 1e-12
    if name == "lammps":
        assert np.abs(bare - driven(name, tmp_path / "rough")).max() > 1e-4


@pytest.mark.parametrize("name", ENGINES)
def test_probes_pass_without_friction(name: str):
    """Among them that the cylinder's wall does not slow a grain that slides along it."""
    subject = Subject(contact_of(SLIPPERY.scene), SLIPPERY.scene.grains.density)
    failed = [found for found in probe(engine(name), subject, TANK) if not found.passed]
    assert failed == []


SKIPPED = {
    "pairs among the fixed grains": WORK["pairs among the fixed grains"],
    "surfaces": (r"^dump(_modify)? +surface.*\n", ""),
}


@pytest.mark.parametrize("work", SKIPPED)
def test_what_is_skipped_changes_no_step(work: str, tmp_path: Path):
    """To the bit: forces among grains that do not obey them, and what is only looked at."""
    pattern, text = SKIPPED[work]

    def change(deck: str) -> str:
        changed = re.sub(pattern, text, deck, flags=re.MULTILINE)
        assert changed != deck
        return changed

    one, other = driven("lammps", tmp_path / "one"), driven("lammps", tmp_path / "other", change)
    assert np.array_equal(one, other)


def stepped(damping: float, step: float) -> float:
    """Speed after an impact, by the velocity-Verlet steps of an engine: a naive loop."""
    x, v, force = 0.0, 1.0, 0.0
    while True:
        v += 0.5 * step * force
        x += step * v
        if x < 0.0:
            return -v
        force = -(x**1.5) - damping * sqrt(x) * v
        v += 0.5 * step * force


@pytest.mark.parametrize("damping", [0.1, 0.459, 2.0])
def test_rebound_is_that_of_a_naive_loop(damping: float):
    assert rebound(damping) == pytest.approx(stepped(damping, 1e-4), abs=2e-4)


def test_weak_damping_takes_the_energy_of_its_work():
    """1 - e = c times the integral of sqrt(x) v over an elastic impact, to first order in c.

    With v^2 = 1 - 4/5 x^2.5 it is twice (5/4)^0.6 / 2.5 B(3/5, 3/2).
    """
    work = 2.0 * 1.25**0.6 / 2.5 * gamma(0.6) * gamma(1.5) / gamma(2.1)
    off = [(1.0 - rebound(c)) / c - work for c in (0.02, 0.01)]
    assert abs(off[1]) < 0.01 * work
    assert off[0] / off[1] == pytest.approx(2.0, abs=0.05)


@pytest.mark.parametrize("restitution", [0.051, 0.3, 0.6, 0.95, 1.0])
def test_damping_number_gives_the_restitution(restitution: float):
    assert rebound(damping_number(restitution)) == pytest.approx(restitution, abs=1e-8)


def test_damping_is_for_the_speed_of_the_drive_or_of_a_fall():
    """c = gamma sqrt(R) D^1.5 / v with D = (m v^2 / K)^0.4 is that of the restitution."""
    grains = CASE.scene.grains
    for speed, expected in ((0.01, sqrt(2.0 * GRAVITY * D)), (0.5, 0.5)):
        found = contact_of(CLASSIC.set("drive.speed", speed).scene).classic
        assert found.speed == pytest.approx(expected)
        length = (grains.mass / 2.0 * expected**2 / grains.stiffness) ** 0.4
        number = found.damping * sqrt(D / 4.0) * length**1.5 / expected
        assert rebound(number) == pytest.approx(0.6, abs=1e-8)


def test_numbers_of_the_classic_law_are_those_of_the_law():
    """Kn = 4/3 E*, Kt = 8 G*, in F = sqrt(R* a) (Kn a + ..), and the ratio of the dampings."""
    contact, nu = contact_of(CLASSIC.scene), 0.45
    numbers = LAMMPS.numbers(contact, 2)["classic"]
    kn, kt, gamma_n, gamma_t, friction, _ = map(float, numbers.split())
    assert kn == pytest.approx(4.0 / 3.0 * 5e6 / (2.0 * (1.0 - nu**2)), rel=1e-9)
    assert kt == pytest.approx(8.0 * 5e6 / (4.0 * (1.0 + nu) * (2.0 - nu)), rel=1e-9)
    assert gamma_n == pytest.approx(contact.classic.damping, rel=1e-9)
    assert gamma_t / gamma_n == pytest.approx(hertz.tangential_damping(nu), rel=1e-9)
    assert friction == 0.5
    assert LAMMPS_2021.numbers(contact, 2)["classic"] == numbers


ANGLES = (30.0, 75.0)


def thrown(name: str, contact: Contact, speeds: tuple[float, ...]) -> list[Impact]:
    """Twins that meet at these closing speeds head-on, and at the first one at angles."""
    throws = [Throw(speed / 2.0) for speed in speeds]
    throws += [Throw(speeds[0] / 2.0, angle) for angle in ANGLES]
    density = CASE.scene.grains.density
    step = 0.0125 * hertz.rayleigh_time(D, density, 5e6, 0.45)
    return impacts(engine(name), contact, density, throws, step)


@pytest.mark.parametrize("name", ["lammps", "lmp"])
def test_classic_grains_rebound_as_asked_at_their_speed(name: str):
    """At a tenth of it as c (v/10) = c (v) / 10^0.2 says; sliding as Coulomb says at 75 degrees."""
    contact = contact_of(CLASSIC.scene)
    speed = contact.classic.speed
    head_on, slow, _, sliding = thrown(name, contact, (speed, speed / 10.0))
    assert head_on.normal_restitution == pytest.approx(0.6, rel=2e-3)
    weaker = rebound(damping_number(0.6) / 10.0**0.2)
    assert slow.normal_restitution == pytest.approx(weaker, rel=2e-3)
    assert weaker > 0.7
    expected = 1.0 - 0.5 * (1.0 + sliding.normal_restitution) / tan(radians(75.0))
    assert sliding.tangential_restitution == pytest.approx(expected, rel=0.02)


def test_classic_grains_that_lose_nothing_roll_off_as_others():
    """At e = 1 the laws differ in the arm of the torque alone, by half the overlap."""
    contact = replace(contact_of(CASE.scene), restitution=1.0)
    speed = 0.1
    law = classic(1.0, CASE.scene.grains.stiffness, D / 4.0, CASE.scene.grains.mass / 2.0, speed)
    *_, one, _ = thrown("lammps", contact, (speed,))
    *_, other, _ = thrown("lammps", replace(contact, classic=law), (speed,))
    assert other.spin == pytest.approx(one.spin, rel=0.02)
    assert other.tangential_restitution == pytest.approx(one.tangential_restitution, rel=0.02)


def test_classic_law_passes_the_probes_of_its_engine():
    subject = Subject(contact_of(CLASSIC.scene), CLASSIC.scene.grains.density)
    names = ("pair_restitution", "pair_energy")
    assert [found.passed for found in probe(engine("lammps"), subject, names)] == [True, True]


def test_deck_of_the_classic_law_keeps_the_wall():
    text = build(CLASSIC.scene, derive(CLASSIC.scene), "", "").texts["in.tank"]
    assert re.search(r"^pair_style +gran/hertz/history \d", text, re.MULTILINE)
    usual = build(CASE.scene, derive(CASE.scene), "", "").texts["in.tank"]
    walls = [re.findall(r"^fix +wall .*", deck, re.MULTILINE) for deck in (text, usual)]
    assert walls[0] == walls[1] != []


def test_classic_law_is_refused_where_it_is_not_known():
    with pytest.raises(CaseError, match=r"numerics\.pair_law.*--engine lammps or lmp") as caught:
        prepare(CLASSIC, dialect=LIGGGHTS)
    assert caught.value.key == "numerics.pair_law"
    with pytest.raises(CaseError, match=r"grains\.restitution.*leave numerics\.pair_law out"):
        prepare(CLASSIC.set("grains.restitution", 0.05))
