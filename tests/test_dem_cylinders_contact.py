"""Where cylinders and spheres touch: by hand for each type, against points, planes, directions."""

from __future__ import annotations

from math import cos, pi, sin, sqrt

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from liftdrag.dem.cylinders import KINDS
from liftdrag.dem.cylinders.touching import meetings

DEPTH = 0.01
Z = np.array([0.0, 0.0, 1.0])


def tilted(angle: float, about: float = 0.0) -> np.ndarray:
    """The axis z turned away by an angle, toward the direction `about` in the plane of x and y."""
    return np.array([sin(angle) * cos(about), sin(angle) * sin(about), cos(angle)])


def hand_made(kind: str) -> tuple:
    """The first's radius and half length, the second's, its way and axis, the normal, the point.

    They overlap by DEPTH; the first is about z. A sphere has no half length.
    """
    d, half = DEPTH, 0.5 * DEPTH
    if "sphere" in kind:
        return with_a_sphere(kind)
    c, s = cos(0.3), sin(0.3)
    if kind == "face-face":
        return (1.0, 0.5), (0.8, 0.4), [0.5, 0.0, 0.9 - d], Z, Z, [0.35, 0.0, 0.5 - half]
    if kind == "face-face within":
        return (1.0, 0.5), (0.3, 0.4), [0.5, 0.0, 0.9 - d], Z, Z, [0.5, 0.0, 0.5 - half]
    if kind == "face-band":
        way, axis = [0.3, 0.9, 0.3 - d], [0.0, 1.0, 0.0]
        low, high = 0.4, sqrt(1.0 - 0.09)
        return (1.0, 0.1), (0.2, 0.5), way, axis, Z, [0.3, 0.5 * (low + high), 0.1 - half]
    if kind == "face-edge":
        way = [0.2, 0.1 + 0.5 * s - 0.2 * c, 0.1 - d + 0.5 * c + 0.2 * s]
        return (1.0, 0.1), (0.2, 0.5), way, [0.0, s, c], Z, [0.2, 0.1, 0.1 - half]
    if kind == "parallel bands":
        way = [0.7 - d, 0.0, 0.5]
        return (0.5, 1.0), (0.2, 0.8), way, Z, [1.0, 0.0, 0.0], [0.5 - half, 0.0, 0.35]
    if kind == "skewed bands":
        way = [0.7 - d, 0.2 * s, 0.3 + 0.2 * c]
        return (0.5, 1.0), (0.2, 0.8), way, [0.0, s, c], [1.0, 0.0, 0.0], [0.5 - half, 0.0, 0.3]
    if kind == "band-edge":
        way = [0.5 - d + 0.8 * s + 0.2 * c, 0.0, 0.1 + 0.8 * c - 0.2 * s]
        return (0.5, 1.0), (0.2, 0.8), way, [s, 0.0, c], [1.0, 0.0, 0.0], [0.5 - half, 0.0, 0.1]
    normal = np.array([1.0, 0.0, 1.0]) / sqrt(2.0)
    rim = np.array([0.6, 0.0, 0.3]) - d * normal
    axis = np.array([1.0, 1.0, 1.0]) / sqrt(3.0)
    across = normal - (normal @ axis) * axis
    way = rim + 0.3 * axis + 0.6 * across / np.linalg.norm(across)
    return (0.6, 0.3), (0.6, 0.3), way, axis, normal, rim + half * normal


def with_a_sphere(kind: str) -> tuple:
    """The same of a sphere of radius 0.3 and what it touches."""
    d, half = DEPTH, 0.5 * DEPTH
    if kind == "face-sphere":
        return (1.0, 0.5), (0.3, 0.0), [0.4, 0.2, 0.8 - d], 0 * Z, Z, [0.4, 0.2, 0.5 - half]
    if kind == "band-sphere":
        normal, point = [0.6, 0.8, 0.0], [0.3 - 0.6 * half, 0.4 - 0.8 * half, -0.4]
        way = [0.48 - 0.6 * d, 0.64 - 0.8 * d, -0.4]
        return (0.5, 1.0), (0.3, 0.0), way, 0 * Z, normal, point
    normal = np.array([0.6, 0.0, 0.8])
    if kind == "spheres":
        return (0.6, 0.0), (0.3, 0.0), (0.9 - d) * normal, 0 * Z, normal, (0.6 - half) * normal
    rim = np.array([0.6, 0.0, 0.3])
    return (0.6, 0.3), (0.3, 0.0), rim + (0.3 - d) * normal, 0 * Z, normal, rim - half * normal


HAND_MADE = ["face-face within", *KINDS]


def met(one, axis, other, other_axis, way):
    """Type, depth, normal and point of pairs: (n, 2) radius and half length, (n, 3) the rest."""
    one, axis, other, other_axis, way = map(np.atleast_2d, (one, axis, other, other_axis, way))
    n = len(way)
    place = np.zeros((2 * n, 8))
    place[:n, 3:6], place[:n, 6:], place[n:, 3:6], place[n:, 6:] = axis, one, other_axis, other
    pair = np.column_stack([np.arange(n), n + np.arange(n)])
    kind, found = meetings(place, pair, np.array(way, float))
    return kind, found[:, 0], found[:, 1:4], found[:, 4:]


@pytest.mark.parametrize("swapped", [False, True])
@pytest.mark.parametrize("name", HAND_MADE)
def test_a_pair_made_by_hand_touches_as_its_type_says(name: str, swapped: bool):
    """Table A1 of Liu et al. 2020: type, overlap, normal and point, in any frame, either first."""
    one, other, way, axis, normal, point = map(np.array, hand_made(name))
    for turn in [Rotation.identity(), *Rotation.random(5, random_state=1)]:
        u, w, r, n, p = (turn.apply(v) for v in (Z, axis, way, normal, point))
        if swapped:
            kind, depth, found, at = met(other, -w, one, u, -r)
            found, at = -found, at + r
        else:
            kind, depth, found, at = met(one, u, other, w, r)
        assert KINDS[kind[0]] == name.removesuffix(" within")
        assert depth[0] == pytest.approx(DEPTH, abs=1e-9)
        assert found[0] == pytest.approx(n, abs=1e-9)
        assert at[0] == pytest.approx(p, abs=1e-6)


# A pair of edges that is not symmetric: Table A1 has chords, where the engine has the edges.


def chord(radius, centre, axis, way, other_radius, other_half, other_axis):
    """Ends of the arc of one cylinder's edge that is within another, which is `way` off."""
    side = np.cross(axis, [0.3, 0.5, 0.8])
    side /= np.linalg.norm(side)
    angle = np.linspace(0.0, 2.0 * pi, 400_001)[:, None]
    edge = centre + radius * (np.cos(angle) * side + np.sin(angle) * np.cross(axis, side))
    away = edge - way
    along = away @ other_axis
    within = (abs(along) < other_half) & ((away**2).sum(axis=1) - along**2 < other_radius**2)
    ends = edge[np.flatnonzero(np.diff(within))]
    return ends[0], ends[-1]


def test_edges_overlap_as_their_chords_to_the_second_order():
    """Distance of the chords AB and CD and the normal across them, as the overlap goes to zero."""
    one, other, way, axis, normal, _ = hand_made("edge-edge")
    errors = []
    for depth in (0.02, 0.01):
        off = np.array(way) + (DEPTH - depth) * normal
        _, found, direction, _ = met(one, Z, other, axis, off)
        c, d = chord(0.6, 0.3 * Z, Z, off, 0.6, 0.3, axis)
        a, b = chord(0.6, off - 0.3 * axis, axis, np.zeros(3), 0.6, 0.3, Z)
        across = np.cross(d - c, b - a)
        across *= np.sign(across @ normal) / np.linalg.norm(across)
        assert found[0] == pytest.approx(depth, rel=1e-9)
        assert direction[0] == pytest.approx(across, abs=2.0 * depth)
        errors.append(abs((c - a) @ across - depth))
    assert errors[0] < 0.1 * 0.02
    assert errors[1] < 0.3 * errors[0]


# Pairs at random: rods and disks of one volume, about to touch.


def unit(vectors: np.ndarray) -> np.ndarray:
    """The directions of vectors."""
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def height(size, axis, direction):
    """The support function of cylinders (n, 2), (n, 3) in a direction (3,) or in one each."""
    along = np.minimum(abs((direction * axis).sum(axis=1)), 1.0)
    return size[:, 1] * along + size[:, 0] * np.sqrt(1.0 - along**2)


def directions(count: int) -> np.ndarray:
    """Directions all over, a spiral."""
    k = np.arange(count) + 0.5
    level, angle = 1.0 - 2.0 * k / count, pi * (1.0 + sqrt(5.0)) * k
    ring = np.sqrt(1.0 - level**2)
    return np.column_stack([ring * np.cos(angle), ring * np.sin(angle), level])


def random_pairs(count: int, seed: int):
    """Cylinders of aspect 0.1 to 6, as far apart as makes them overlap or miss by a little.

    The last tenth are about parallel, the tenth before about perpendicular: exactly or not. Of the
    first fifth one is a sphere, of the first tenth both.
    """
    rng = np.random.default_rng(seed)
    aspect = np.exp(rng.uniform(np.log(0.1), np.log(6.0), (2, count)))
    radius = (2.0 / (3.0 * aspect)) ** (1.0 / 3.0) / 2.0
    one, other = np.stack([radius, radius * aspect], axis=-1)
    u, w = unit(rng.normal(size=(2, count, 3)))
    part, slight = count // 10, 10.0 ** rng.uniform(-9.0, -2.0, (count, 1))
    slight[::2] = 0.0
    noise = slight * rng.normal(size=(count, 3))
    w[-2 * part :] = unit(np.cross(u, w) + noise)[-2 * part :]
    w[-part:] = unit(u + noise)[-part:]
    other[: 2 * part], w[: 2 * part] = [0.5, 0.0], 0.0
    one[:part], u[:part] = [0.4, 0.0], 0.0
    way, touch = unit(rng.normal(size=(count, 3))), np.full(count, np.inf)
    for n in directions(300):
        toward = way @ n
        reach = height(one, u, n) + height(other, w, n)
        touch = np.minimum(touch, np.where(toward > 1e-3, reach / np.maximum(toward, 1e-3), np.inf))
    return one, u, other, w, way * (touch * rng.uniform(0.88, 1.02, count))[:, None]


def inside(point, size, axis):
    """How deep a point is in a cylinder about the origin, negative outside."""
    along = (point * axis).sum(axis=1)
    across = np.linalg.norm(point - along[:, None] * axis, axis=1)
    ends = np.where(size[:, 1] > 0.0, size[:, 1] - abs(along), np.inf)
    return np.minimum(ends, size[:, 0] - across)


PAIRS, ROUNDING = 12_000, 3e-6
"""The second is the length of the longest rod times the sine at which axes count as parallel."""


def test_contacts_are_true_and_the_shallowest_and_gaps_are_true():
    """No contact is missed or made up, and no direction of 400 has less overlap, of 12 000 pairs.

    A contact has a point in both cylinders; the others have a plane between them.
    """
    one, u, other, w, way = random_pairs(PAIRS, 1)
    kind, depth, normal, point = met(one, u, other, w, way)
    touching = depth > 0.0
    assert 0.55 < touching.mean() < 0.95
    assert np.linalg.norm(normal, axis=1) == pytest.approx(1.0, abs=1e-12)
    overlap = height(one, u, normal) + height(other, w, normal) - (way * normal).sum(axis=1)
    assert (overlap[~touching] <= ROUNDING).all()
    assert overlap[touching] == pytest.approx(depth[touching], abs=ROUNDING)
    within = np.minimum(inside(point, one, u), inside(point - way, other, w))
    assert (within[touching] >= -ROUNDING).all()
    least = np.full(PAIRS, np.inf)
    for n in directions(400):
        least = np.minimum(least, height(one, u, n) + height(other, w, n) - way @ n)
    assert (depth[touching] <= least[touching] + ROUNDING).all()
    assert (np.bincount(kind[touching], minlength=len(KINDS)) > 20).all()
