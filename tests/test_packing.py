"""The packed bed against naive distance loops, a crystal, and the fraction asked for."""

from __future__ import annotations

from math import pi, sqrt

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from liftdrag.packing import Container, random_bed, square_layer
from liftdrag.packing.relaxation import TOLERANCE

BOX = Container(
    length=9.3,
    thickness=4.4,
    bottom=0.8,
    top=9.0,
    axis=(5.8, 5.0),
    radius=1.2,
    floor=square_layer(9.3, 4.4, 0.5),
)
FRACTION = 0.59
COUNT = round(FRACTION * ((9.0 - 0.8) * 9.3 - pi * 1.2**2) * 4.4 / (pi / 6.0))

SLAB = Container(
    length=9.0,
    thickness=9.0,
    bottom=0.8,
    top=12.0,
    axis=(5.6, -50.0),
    radius=0.5,
    floor=square_layer(9.0, 9.0, 0.5),
)
"""A box whose cylinder is far away: bulk."""

SLAB_COUNT = round(FRACTION * (12.0 - 0.8) * 81.0 / (pi / 6.0))


@pytest.fixture(scope="module")
def bed() -> np.ndarray:
    return random_bed(BOX, COUNT, np.random.default_rng(1))


@pytest.fixture(scope="module")
def slab() -> np.ndarray:
    return random_bed(SLAB, SLAB_COUNT, np.random.default_rng(2))


def gaps(first: np.ndarray, second: np.ndarray, box: Container) -> np.ndarray:
    """Distances (n, m), each the least over the nine nearest periodic images, by brute force."""
    best = np.full((len(first), len(second)), np.inf)
    for x in (-box.length, 0.0, box.length):
        for y in (-box.thickness, 0.0, box.thickness):
            shifted = first[:, None, :] - second[None, :, :] + [x, y, 0.0]
            best = np.minimum(best, np.sqrt((shifted**2).sum(axis=2)))
    return best


def shell_density(centres: np.ndarray, box: Container, low: float, high: float) -> float:
    """Pair distribution g averaged over low < r < high, around grains far from top and floor."""
    middle = (box.bottom + box.top) / 2.0
    inner = centres[np.abs(centres[:, 2] - middle) < 2.5]
    r = gaps(inner, centres, box)
    found = ((r > low) & (r < high)).sum() / len(inner)
    reach = 2.0
    near = ((r > 1e-9) & (r < reach)).sum() / len(inner)
    density = near / (4.0 / 3.0 * pi * (reach**3))
    return found / (density * 4.0 / 3.0 * pi * (high**3 - low**3))


def fcc(spacing: float, cells: int) -> np.ndarray:
    """A cube of face-centred cubic crystal, nearest neighbours `spacing` apart, a little shaken."""
    corner = np.array([[0, 0, 0], [0, 1, 1], [1, 0, 1], [1, 1, 0]]) / 2.0
    grid = np.stack(np.meshgrid(*[np.arange(cells)] * 3, indexing="ij"), axis=-1).reshape(-1, 1, 3)
    points = (grid + corner).reshape(-1, 3) * spacing * sqrt(2.0)
    return points + np.random.default_rng(0).normal(0.0, 0.01, points.shape)


def test_no_two_grains_overlap_across_any_boundary(bed: np.ndarray):
    distance = gaps(bed, bed, BOX)
    np.fill_diagonal(distance, np.inf)
    assert distance.min() > 1.0 - TOLERANCE
    assert distance.min() < 1.0 + TOLERANCE


def test_no_grain_overlaps_the_bottom_layer(bed: np.ndarray):
    assert gaps(bed, BOX.floor, BOX).min() > 1.0 - TOLERANCE


def test_no_grain_overlaps_the_cylinder(bed: np.ndarray):
    away = np.hypot(bed[:, 0] - BOX.axis[0], bed[:, 2] - BOX.axis[1])
    assert away.min() > BOX.radius + 0.5 - TOLERANCE
    assert away.min() < BOX.radius + 0.5 + 0.05


def test_grains_lie_inside_the_box(bed: np.ndarray):
    low = bed.min(axis=0) - [0.0, 0.0, BOX.bottom - TOLERANCE]
    high = [BOX.length, BOX.thickness, BOX.top - 0.5 + TOLERANCE] - bed.max(axis=0)
    assert np.all(low >= 0.0)
    assert np.all(high >= 0.0)


def test_every_grain_asked_for_is_there(bed: np.ndarray):
    assert bed.shape == (COUNT, 3)


def test_same_seed_gives_the_same_bits(bed: np.ndarray):
    again = random_bed(BOX, COUNT, np.random.default_rng(1))
    assert again.tobytes() == bed.tobytes()


def test_other_seed_gives_another_bed(bed: np.ndarray):
    other = random_bed(BOX, COUNT, np.random.default_rng(2))
    assert gaps(other, bed, BOX).min(axis=1).mean() > 0.1


def test_bulk_is_as_dense_as_asked_for(slab: np.ndarray):
    low, high = 3.0, 10.0
    cap = np.clip(high - slab[:, 2] + 0.5, 0.0, 1.0), np.clip(low - slab[:, 2] + 0.5, 0.0, 1.0)
    below_high, below_low = (np.sum(pi * c**2 * (0.5 - c / 3.0)) for c in cap)
    fraction = (below_high - below_low) / (81.0 * (high - low))
    assert fraction == pytest.approx(FRACTION, abs=0.015)


def test_bed_is_random_not_crystalline(slab: np.ndarray):
    first = shell_density(slab, SLAB, 0.99, 1.05)
    second = shell_density(slab, SLAB, sqrt(2.0) - 0.05, sqrt(2.0) + 0.05)
    assert first > 3.0
    assert second < 1.1
    assert second < first / 3.0


def test_measure_of_randomness_sees_a_crystal():
    cells = 6
    side = cells * 1.02 * sqrt(2.0)
    floor = np.empty((0, 3))
    crystal = Container(side, side, 0.0, side, (0.0, -50.0), 0.5, floor)
    second = shell_density(fcc(1.02, cells), crystal, sqrt(2.0) - 0.05, sqrt(2.0) + 0.05)
    assert second > 1.4


def test_hopeless_count_is_refused():
    box = Container(4.0, 4.0, 0.8, 5.0, (2.5, -50.0), 0.5, square_layer(4.0, 4.0, 0.5))
    with pytest.raises(ValueError, match="cannot be packed: its 115 grains"):
        random_bed(box, 115, np.random.default_rng(1))


@given(st.floats(1.0, 40.0), st.floats(1.0, 15.0))
def test_square_layer_repeats_itself_across_the_box(length: float, thickness: float):
    layer = square_layer(length, thickness, 0.5)
    columns, rows = np.unique(layer[:, 0]), np.unique(layer[:, 1])
    assert len(layer) == len(columns) * len(rows)
    for places, period in ((columns, length), (rows, thickness)):
        steps = np.diff(np.append(places, places[0] + period))
        np.testing.assert_allclose(steps, period / len(places), rtol=1e-6)
        assert steps.min() >= 1.0 - 1e-8
        assert period / (len(places) + 1) < 1.0


@pytest.mark.parametrize(("length", "thickness"), [(9.3, 4.4), (12.0, 4.0), (60.0, 5.0)])
def test_grains_of_a_square_layer_keep_clear_of_their_images(length: float, thickness: float):
    layer = square_layer(length, thickness, 0.5)
    box = Container(length, thickness, 0.0, 1.0, (0.0, 0.0), 0.0, layer)
    distance = gaps(layer, layer, box)
    np.fill_diagonal(distance, np.inf)
    assert distance.min() >= 1.0 - 1e-9
    assert np.all(layer[:, 2] == 0.5)
