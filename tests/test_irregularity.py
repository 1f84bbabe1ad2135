"""The irregularity of a flow: nothing for motions that are linear, and known for noise."""

from __future__ import annotations

from math import cos, sin, sqrt

import numpy as np
import pytest

from liftdrag.analysis.mixing import irregularity

REACH = 2.5
SHIFT = np.array([3.0, -2.0])

LINEAR = {
    "rest": [[1.0, 0.0], [0.0, 1.0]],
    "rotation": [[cos(0.7), -sin(0.7)], [sin(0.7), cos(0.7)]],
    "simple shear": [[1.0, 0.8], [0.0, 1.0]],
    "stretch": [[1.5, 0.0], [0.0, 0.6]],
    "reflection": [[-1.0, 0.0], [0.0, 1.0]],
    "collapse": [[0.3, 0.6], [0.1, 0.2]],
}


def grid(side: int, seed: int = 1, shake: float = 0.2) -> np.ndarray:
    """Places about one apart, in disorder."""
    rng = np.random.default_rng(seed)
    x, y = np.meshgrid(np.arange(side, dtype=float), np.arange(side, dtype=float))
    place = np.column_stack([x.ravel(), y.ravel()])
    return place + shake * rng.uniform(-1.0, 1.0, place.shape)


@pytest.mark.parametrize("motion", LINEAR)
def test_linear_motion_is_regular(motion: str):
    before = grid(12)
    after = before @ np.array(LINEAR[motion]).T + SHIFT
    assert irregularity(before, after, REACH) < 1e-12


def test_bent_motion_is_not_regular():
    """Neighbours at (1, 0), (-1, 0), (0, 1), (0, -1) move by c x^2: no linear map does that.

    The two along x are left with c each, the two along y with nothing, so c / sqrt(2) about the
    middle; seen alone, for the grains at the rim have too few neighbours.
    """
    before = np.array([[0.0, 0.0], [1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
    after = before + np.column_stack([np.zeros(5), 0.3 * before[:, 0] ** 2])
    assert irregularity(before, after, 1.2) == pytest.approx(0.3 / sqrt(2.0), rel=1e-12)


def test_noise_leaves_what_its_size_and_the_neighbours_say():
    """Of each neighbour's motion, size s, the map takes its two directions of all of them off.

    The grain's own motion is common to its neighbours; hardly any of that looks linear.
    """
    rng, size = np.random.default_rng(2), 1e-3
    before = grid(60)
    found = irregularity(before, before + size * rng.normal(size=before.shape), REACH)
    assert found == pytest.approx(size * left_of_noise(before), rel=0.01)
    assert found == pytest.approx(size * sqrt(2.0 * (1.0 - 2.0 / 20.0) + 2.0), rel=0.03)


def left_of_noise(before: np.ndarray) -> float:
    """Root mean square that noise of unit size leaves, expected: traces of projectors, by grain."""
    left = []
    for i in range(len(before)):
        old = before - before[i]
        near = (np.hypot(*old.T) <= REACH) & (np.arange(len(before)) != i)
        arms = old[near]
        rest = np.eye(len(arms)) - arms @ np.linalg.pinv(arms)
        noise = np.eye(len(arms)) + np.ones((len(arms), len(arms)))
        left.append(2.0 * np.trace(rest @ noise) / len(arms))
    return sqrt(np.mean(left))


@pytest.mark.parametrize("motion", LINEAR)
def test_linear_motion_before_the_noise_is_taken_off(motion: str):
    """after = A before + noise leaves what the noise alone does."""
    rng = np.random.default_rng(4)
    before = grid(12)
    noise = 0.1 * rng.normal(size=before.shape)
    alone = irregularity(before, before + noise, REACH)
    both = irregularity(before, before @ np.array(LINEAR[motion]).T + SHIFT + noise, REACH)
    assert both == pytest.approx(alone, rel=1e-9)


@pytest.mark.parametrize("factor", [1e-3, 7.0])
def test_irregularity_is_a_length(factor: float):
    rng = np.random.default_rng(5)
    before = grid(10)
    after = before + 0.1 * rng.normal(size=before.shape)
    found = irregularity(factor * before, factor * after, factor * REACH)
    assert found == pytest.approx(factor * irregularity(before, after, REACH), rel=1e-9)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("reach", [1.3, 2.5])
def test_irregularity_is_that_of_a_plain_loop(seed: int, reach: float):
    rng = np.random.default_rng(seed)
    before = grid(9, seed, shake=0.4)[rng.permutation(81)[:70]]
    after = before @ rng.normal(size=(2, 2)) + 0.3 * rng.normal(size=before.shape)
    assert irregularity(before, after, reach) == pytest.approx(plain(before, after, reach))


def plain(before: np.ndarray, after: np.ndarray, reach: float) -> float:
    """Falk and Langer's D^2_min per neighbour, with their X and Y (eqs. 2.12 to 2.14)."""
    squares = []
    for i in range(len(before)):
        arms = [
            (before[j] - before[i], after[j] - after[i])
            for j in range(len(before))
            if j != i and np.hypot(*(before[j] - before[i])) < reach
        ]
        if len(arms) < 3:
            continue
        x = sum(np.outer(new, old) for old, new in arms)
        y = sum(np.outer(old, old) for old, _ in arms)
        best = x @ np.linalg.inv(y)
        squares.append(sum(((new - best @ old) ** 2).sum() for old, new in arms) / len(arms))
    return sqrt(sum(squares) / len(squares))


def test_lonely_grains_are_left_out():
    """A pair far away that flies apart changes nothing."""
    rng = np.random.default_rng(6)
    before = grid(8)
    after = before + 0.1 * rng.normal(size=before.shape)
    pair = np.array([[100.0, 100.0], [101.0, 100.0]])
    more = np.vstack([before, pair]), np.vstack([after, pair * [[0.9, 1.0], [1.0, 1.1]]])
    assert irregularity(*more, REACH) == irregularity(before, after, REACH)


def test_grains_that_are_all_lonely_are_refused():
    before = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    with pytest.raises(ValueError, match="no grain has enough neighbours"):
        irregularity(before, before, REACH)
