"""The step that breaks a bed, derived, against the in-house engine and against exact modes."""

from __future__ import annotations

from dataclasses import replace
from math import inf, pi, sqrt

import numpy as np
import pytest
from beds import MODULUS, POISSON, grains, law_of

from liftdrag.case import load, packaged
from liftdrag.dem import Bed, Law, advance
from liftdrag.numerics import derive
from liftdrag.numerics.bounds import bounds_of
from liftdrag.stability import Crowd, damping_ratio, hertz_slope, largest_step

MASS = pi
"""Of a disc of radius and density one."""

OVERLAP, NUDGE = 1e-2, 1e-8
WALL = 4.0 / 3.0 * MODULUS / (2.0 * (1.0 - POISSON**2))
SLOPE = hertz_slope(WALL, OVERLAP)
MINDLIN = 2.0 * (1.0 - POISSON) / (2.0 - POISSON)
FREE = (-np.inf, np.inf)


def between_walls() -> Bed:
    """A disc pressed by two walls."""
    half = 1.0 - OVERLAP
    return grains([[0.0, 0.0]], walls=(-half, half, *FREE))


def pair_between_walls() -> Bed:
    """Two discs pressed by two walls; their contact bears the same force on half the radius."""
    reach = 1.0 - 0.5 * OVERLAP * 2.0 ** (1.0 / 3.0)
    half = reach + 1.0 - OVERLAP
    return grains([[-reach, 0.0], [reach, 0.0]], walls=(-half, half, *FREE))


def shaken(bed: Bed, name: str, law: Law, step: float) -> float:
    """How many times the energy of a small motion has grown at its largest over 300 steps."""
    nudged = getattr(bed, name).copy()
    nudged.reshape(len(nudged), -1)[0, 0] += NUDGE
    energy = advance(replace(bed, **{name: nudged}), law, step, rows=300).kinetic
    return float(energy.max() / energy[:2].max())


MODES = {
    "one disc": (between_walls, "position", law_of(), 2.0 * SLOPE / MASS, 0.0),
    "two discs": (
        pair_between_walls,
        "position",
        law_of(),
        (SLOPE + 2.0 * hertz_slope(WALL / sqrt(2.0), OVERLAP * 2.0 ** (1.0 / 3.0))) / MASS,
        0.0,
    ),
    "one disc, damped": (
        between_walls,
        "position",
        law_of(restitution=0.4),
        2.0 * SLOPE / MASS,
        sqrt(2.0 * 5.0 / 6.0) * damping_ratio(0.4),
    ),
    "one disc, turning": (
        between_walls,
        "spin",
        law_of(friction=9.0, tangential_damping=0.0),
        4.0 * MINDLIN * SLOPE / MASS,
        0.0,
    ),
}


@pytest.mark.parametrize("name", MODES)
def test_step_that_breaks_is_the_derived_one_within_3_percent(name: str):
    """Of discs between walls, whose modes are known: it breaks 3 % above and not 3 % below."""
    make, moved, law, square, ratio = MODES[name]
    limit = largest_step(sqrt(square), ratio)
    assert shaken(make(), moved, law, 0.97 * limit) < 100.0
    assert shaken(make(), moved, law, 1.03 * limit) > 1e6


def largest_rate(bonds: np.ndarray, tangential: float) -> float:
    """The largest omega^2 in K/m of a lattice of discs or spheres with these unit `bonds` (b, D),
    each with its opposite, over waves of all kinds: displacements, and turns in the plane."""
    dimensions, found = bonds.shape[1], 0.0
    waves = np.random.default_rng(1).uniform(-2.0 * pi, 2.0 * pi, (1500, dimensions))
    for wave in waves:
        found = max(found, np.linalg.eigvalsh(dynamical(bonds, tangential, wave))[-1])
    return found


def dynamical(bonds: np.ndarray, tangential: float, wave: np.ndarray) -> np.ndarray:
    """The dynamical matrix over K/m; in the plane with the turn, by the root of its inertia."""
    plane = bonds.shape[1] == 2
    whole = np.zeros((3, 3), complex)
    for bond in bonds:
        phase = np.exp(1j * wave @ bond)
        rows = [(1.0, np.append(bond, 0.0) if plane else bond, 0.0)]
        if plane:
            rows.append((tangential, np.array([-bond[1], bond[0], 0.0]), sqrt(2.0)))
        for weight, direction, turn in rows:
            own = direction + np.array([0.0, 0.0, turn])
            other = -direction + np.array([0.0, 0.0, turn])
            stretch = own + phase * other
            whole += 0.5 * weight * np.outer(stretch.conj(), stretch)
    return whole


ANGLES = np.arange(6) * pi / 3.0
TRIANGULAR = np.column_stack([np.cos(ANGLES), np.sin(ANGLES)])
CLOSE = np.array(
    [
        [a, b, c]
        for a in (-1, 0, 1)
        for b in (-1, 0, 1)
        for c in (-1, 0, 1)
        if a * a + b * b + c * c == 2
    ]
) / sqrt(2.0)


@pytest.mark.parametrize(
    ("bonds", "crowding"), [(TRIANGULAR, 3.0), (CLOSE, 4.0)], ids=["triangular", "close packing"]
)
def test_crowding_without_friction_is_reached_by_lattices(bonds: np.ndarray, crowding: float):
    ((found, _),) = Crowd(len(bonds), bonds.shape[1], 0.0, 0.0).modes
    assert found == pytest.approx(crowding)
    assert largest_rate(bonds, 0.0) / 2.0 == pytest.approx(crowding, rel=0.02)
    assert largest_rate(bonds, 0.0) / 2.0 <= crowding * (1.0 + 1e-9)


@pytest.mark.parametrize("tangential", [0.1, 2.0 / 7.0, 0.8, 1.0])
def test_crowding_bounds_a_lattice_with_friction(tangential: float):
    modes = Crowd(6.0, 2, tangential, 0.0).modes
    bound = max(crowding for crowding, _ in modes)
    assert 0.7 * bound < largest_rate(TRIANGULAR, tangential) / 2.0 <= bound * (1.0 + 1e-9)


def test_amplification_of_a_damped_mode_has_a_root_at_minus_one():
    """The scheme written out, as a matrix of position and half-step velocity."""
    for ratio in (0.0, 0.1, 0.5, 2.0):
        h = largest_step(1.0, ratio)
        scheme = np.array([[1.0, h], [-h, 1.0 - 2.0 * ratio * h - h * h]])
        assert np.linalg.eigvals(scheme).min() == pytest.approx(-1.0)
    assert largest_step(0.0) == inf


@pytest.mark.parametrize("name", list(packaged()))
def test_own_step_of_a_packaged_case_is_below_the_predicted(name: str):
    scene = load(name).scene
    bounds = bounds_of(scene)
    assert bounds.earliest < bounds.expected
    assert bounds.own * bounds.scale == pytest.approx(derive(scene).time_step.value)
    assert bounds.expected / bounds.own > 1.4
