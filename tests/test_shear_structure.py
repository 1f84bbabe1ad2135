"""Alignment and stacks of rods and disks, against hand-made ones and naive loops."""

from __future__ import annotations

import numpy as np
import pytest

from liftdrag.analysis.alignment import director, order_parameter, orientation_tensor
from liftdrag.analysis.stacking import SlidingCell, stacks

X, Y, Z = np.eye(3)


def at_random(count: int, seed: int = 1) -> np.ndarray:
    axes = np.random.default_rng(seed).normal(size=(count, 3))
    return np.asarray(axes / np.linalg.norm(axes, axis=1, keepdims=True))


def test_order_of_axes_that_are_known():
    """All alike 1, either way round; three perpendicular ones 0; in a plane 1/4; at random 0."""
    signs = np.array([1, -1, 1, 1, -1, 1])[:, None]
    assert order_parameter(signs * at_random(1)) == pytest.approx(1.0)
    assert order_parameter(np.eye(3)) == pytest.approx(0.0, abs=1e-12)
    angle = np.linspace(0.0, np.pi, 1000, endpoint=False)
    ring = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(1000)])
    assert order_parameter(ring) == pytest.approx(0.25)
    assert order_parameter(at_random(100_000)) < 0.01


def test_order_is_the_mean_legendre_polynomial_about_the_director():
    """A cone of half angle t about an axis has S = (3 cos^2 t - 1)/2, and that axis."""
    t, turn = 0.4, np.linspace(0.0, 2.0 * np.pi, 12, endpoint=False)
    cone = np.column_stack(
        [np.cos(t) + 0 * turn, np.sin(t) * np.cos(turn), np.sin(t) * np.sin(turn)]
    )
    assert order_parameter(cone) == pytest.approx((3.0 * np.cos(t) ** 2 - 1.0) / 2.0)
    assert director(-cone) == pytest.approx(X)
    assert np.trace(orientation_tensor(cone)) == pytest.approx(0.0, abs=1e-12)


CELL = SlidingCell(np.array([10.0, 8.0, 6.0]), 3.0)


def along(place: list[list[float]], axes: object = X) -> tuple[np.ndarray, np.ndarray]:
    position = np.array(place, float)
    return position, np.broadcast_to(np.asarray(axes, float), position.shape)


def test_stacks_made_by_hand():
    """Three in a row, a pair, one alone: two stacks of 2.5 grains, 5/6 of all."""
    made = stacks(
        *along([[1, 1, 1], [1, 2, 1], [1, 3, 1], [5, 5, 3], [5, 5, 4], [8, 3, 3]]), CELL, 1.1
    )
    assert sorted(made.sizes) == [2, 3]
    assert (made.mean_size, made.fraction) == (2.5, pytest.approx(5.0 / 6.0))


@pytest.mark.parametrize(("degrees", "joined"), [(9.9, True), (10.1, False), (170.1, True)])
def test_stack_ends_at_ten_degrees(degrees: float, joined: bool):
    t = np.radians(degrees)
    axes = np.array([X, [np.cos(t), np.sin(t), 0.0]])
    position = np.array([[1.0, 1.0, 1.0], [1.0, 2.0, 1.0]])
    assert stacks(position, axes, CELL, 1.1).fraction == float(joined)


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ([0.2, 4, 3], [9.8, 4, 3]),
        ([5, 4, 0.2], [5, 4, 5.8]),
        ([5, 7.8, 3], [2, 0.2, 3]),
        ([1, 7.8, 3], [8, 0.2, 3]),
        ([1, 7.9, 5.9], [8, 0.1, 0.1]),
    ],
)
def test_stack_reaches_through_the_sides_of_the_cell(one: list[float], other: list[float]):
    """The neighbour above is ahead by the offset, 3: what leaves there at x = 5 enters at 2."""
    assert stacks(*along([one, other]), CELL, 0.5).fraction == 1.0
    assert stacks(*along([one, other]), SlidingCell(CELL.sides, 1.5), 0.5).fraction in (
        (0.0,) if abs(one[1] - other[1]) > 4 else (1.0,)
    )


def test_nobody_stacks_with_an_image_of_its_own():
    assert stacks(*along([[1, 1, 1]]), SlidingCell(np.full(3, 2.0), 0.0), 2.5).fraction == 0.0


def test_stacks_are_those_of_a_naive_loop():
    """Over all pairs and the 27 nearest images, and joined by walking from grain to grain."""
    rng, reach = np.random.default_rng(3), 1.2
    position = rng.uniform(-1.0, 1.0, (120, 3)) * CELL.sides
    axes = at_random(120, 4) * [1.0, 0.15, 0.15]
    axes = axes / np.linalg.norm(axes, axis=1, keepdims=True)
    lattice = np.array([[10.0, 0.0, 0.0], [3.0, 8.0, 0.0], [0.0, 0.0, 6.0]])
    steps = np.array(np.meshgrid(*[np.arange(-3, 4)] * 3)).reshape(3, -1).T @ lattice
    linked = [
        [
            i != j
            and bool((np.linalg.norm(position[j] + steps - position[i], axis=1) <= reach).any())
            and abs(axes[i] @ axes[j]) >= np.cos(np.radians(10.0))
            for j in range(120)
        ]
        for i in range(120)
    ]
    left, sizes = set(range(120)), []
    while left:
        stack = [left.pop()]
        for i in stack:
            found = {j for j in left if linked[i][j]}
            left -= found
            stack += found
        sizes.append(len(stack))
    made = stacks(position, axes, CELL, reach)
    assert sorted(made.sizes) == sorted(size for size in sizes if size > 1)
    assert len(made.sizes) > 5
