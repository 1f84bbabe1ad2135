"""Solid fraction and free surface against sphere caps, random points and layered beds."""

from __future__ import annotations

from math import pi

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from liftdrag.analysis.surface import solid_fraction_profile, surface_height

DIAMETER, AREA = 1.5e-3, 4e-4
VOLUME = pi * DIAMETER**3 / 6.0


def cap_volume(height: float, radius: float) -> float:
    """Volume of a sphere's cap of `height`."""
    return pi * height**2 * (3.0 * radius - height) / 3.0


def layered_bed(layers: int, base: float, per_layer: int) -> np.ndarray:
    """Heights of the centres of layers one diameter apart, the lowest at `base`."""
    return np.repeat(base + DIAMETER * np.arange(layers), per_layer)


@pytest.mark.parametrize("share", [0.05, 0.3, 0.5, 0.8, 1.0])
def test_plane_through_a_sphere_cuts_off_its_cap(share: float):
    radius, bottom = DIAMETER / 2.0, 3.0 * DIAMETER
    cut = bottom + share * DIAMETER
    edges = np.array([0.0, cut, 6.0 * DIAMETER])
    profile = solid_fraction_profile(np.array([bottom + radius]), DIAMETER, AREA, edges)
    below = cap_volume(share * DIAMETER, radius)
    above = cap_volume((1.0 - share) * DIAMETER, radius)
    expected = np.array([below, above]) / (AREA * np.diff(edges))
    np.testing.assert_allclose(profile, expected, rtol=1e-10, atol=1e-15)


@given(st.lists(st.floats(0.0, 10.0), min_size=1, max_size=30), st.integers(1, 40))
def test_profile_holds_the_volume_of_all_spheres(heights: list[float], bins: int):
    edges = np.linspace(-1.0, 12.0, bins + 1)
    profile = solid_fraction_profile(np.array(heights), 1.0, 7.0, edges)
    held = (profile * np.diff(edges)).sum() * 7.0
    assert held == pytest.approx(len(heights) * pi / 6.0, rel=1e-9)
    assert np.all(profile >= -1e-12)


def test_profile_agrees_with_points_thrown_into_the_box():
    rng = np.random.default_rng(3)
    centres = np.array([[x, y] for x in (1, 2, 3) for y in (1, 2, 3)]) + 0.0
    heights = rng.uniform(0.5, 3.5, len(centres))
    edges = np.linspace(0.0, 4.0, 9)
    points = rng.uniform([0.0, 0.0, 0.0], [4.0, 4.0, 4.0], (200_000, 3))
    inside = np.zeros(len(points), dtype=bool)
    for (x, y), z in zip(centres, heights, strict=True):
        inside |= ((points - [x, y, z]) ** 2).sum(axis=1) < 0.25
    thrown = np.histogram(points[:, 2], edges)[0]
    expected = np.histogram(points[inside, 2], edges)[0] / thrown
    profile = solid_fraction_profile(heights, 1.0, 16.0, edges)
    error = np.sqrt(expected * (1.0 - expected) / thrown)
    assert np.all(np.abs(profile - expected) < 4.5 * error + 1e-4)
    assert profile.max() > 0.1


@pytest.mark.parametrize("layers", [8, 20])
def test_surface_of_a_layered_bed_is_the_top_of_its_last_layer(layers: int):
    heights = layered_bed(layers, DIAMETER / 2.0, 100)
    bulk = (2.0 * DIAMETER, (layers - 2.0) * DIAMETER)
    surface = surface_height(heights, DIAMETER, AREA, bulk)
    assert surface == pytest.approx(layers * DIAMETER, rel=1e-9)


@given(st.floats(0.0, 0.999))
def test_surface_follows_a_raised_bed_within_a_quarter_grain(raised: float):
    heights = layered_bed(12, (0.5 + raised) * DIAMETER, 10)
    surface = surface_height(heights, DIAMETER, AREA, (3.0 * DIAMETER, 9.0 * DIAMETER))
    assert surface == pytest.approx((12.0 + raised) * DIAMETER, abs=0.25 * DIAMETER)


def test_few_grains_on_top_of_the_bed_do_not_raise_its_surface():
    heights = layered_bed(10, DIAMETER / 2.0, 100)
    strays = np.full(10, 10.5 * DIAMETER)
    bulk = (2.0 * DIAMETER, 8.0 * DIAMETER)
    flat = surface_height(heights, DIAMETER, AREA, bulk)
    strewn = surface_height(np.concatenate([heights, strays]), DIAMETER, AREA, bulk)
    assert flat <= strewn < flat + 0.1 * DIAMETER


def test_surface_is_measured_against_the_bulk_not_against_a_denser_layer():
    dense = layered_bed(3, DIAMETER / 2.0, 300)
    bed = layered_bed(9, 3.5 * DIAMETER, 100)
    bulk = (4.0 * DIAMETER, 10.0 * DIAMETER)
    surface = surface_height(np.concatenate([dense, bed]), DIAMETER, AREA, bulk)
    assert surface == pytest.approx(12.0 * DIAMETER, rel=1e-9)
