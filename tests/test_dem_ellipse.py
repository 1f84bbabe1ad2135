"""Contacts of ellipses against dense searches, sampled boundaries and the gradient of an energy."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from beds import grains, law_of
from hypothesis import given, settings
from hypothesis import strategies as st

from liftdrag.dem import Bed, Contacts, Memory, advance, contacts, forces

LAW = law_of()

APART = 60.0
"""Distance of the couples of a bed; no ellipse here is longer than 10."""


@dataclass
class Couples:
    """Couples of ellipses: semi-axes (m, 2, 2), angles (m, 2), and (m, 2) from centre to centre."""

    axes: np.ndarray
    angle: np.ndarray
    offset: np.ndarray

    def __len__(self) -> int:
        return len(self.axes)

    def some(self, which: Any) -> Couples:
        return Couples(self.axes[which], self.angle[which], self.offset[which])

    def bed(self, contact: str = "common normal") -> Bed:
        """All couples in one bed, far from one another: bodies 2k and 2k + 1."""
        columns = int(np.ceil(np.sqrt(len(self))))
        place = APART * np.column_stack(np.divmod(np.arange(len(self)), columns)).astype(float)
        position = np.stack([place, place + self.offset], axis=1).reshape(-1, 2)
        return grains(position, self.axes.reshape(-1, 2), angle=self.angle.ravel(), contact=contact)


def supports(couples: Couples, normal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Support function (m, 2, ...) of each ellipse for the angles (m, ...), its derivative."""
    shape = (len(couples), 2) + (1,) * (normal.ndim - 1)
    turned = normal[:, None] - couples.angle.reshape(shape)
    a, b = couples.axes[:, :, 0].reshape(shape), couples.axes[:, :, 1].reshape(shape)
    height = np.hypot(a * np.cos(turned), b * np.sin(turned))
    return height, (b**2 - a**2) * np.sin(turned) * np.cos(turned) / height


def overlap_along(couples: Couples, normal: np.ndarray) -> np.ndarray:
    """How far ellipse 2 must go in each direction n until a line across n separates the two."""
    x, y = couples.offset.T.reshape((2, len(couples)) + (1,) * (normal.ndim - 1))
    ahead = x * np.cos(normal) + y * np.sin(normal)
    return supports(couples, normal)[0].sum(axis=1) - ahead


def least(values_at: Any, count: int, samples: int = 720) -> tuple[np.ndarray, np.ndarray]:
    """Angle and value of the least of each function of an angle: sampled, then zoomed in."""
    width = 2.0 * np.pi / samples
    start = np.zeros((count, 1)) + width * np.arange(samples)
    middle = np.take_along_axis(start, values_at(start).argmin(axis=1)[:, None], axis=1)
    for _ in range(7):
        near = middle + width * np.linspace(-1.0, 1.0, 41)
        values = values_at(near)
        middle = np.take_along_axis(near, values.argmin(axis=1)[:, None], axis=1)
        width /= 15.0
    return middle[:, 0], values.min(axis=1)


def touching(rng: np.random.Generator, count: int, ratio: Any, share: Any) -> Couples:
    """Couples whose depth is this share of the sum of the least radii of curvature, b^2/a.

    So deep, the direction in which they were pushed together is the only stationary one that low.
    """
    width = rng.uniform(0.4, 1.5, (count, 2))
    axes = np.stack([width * np.broadcast_to(ratio, (count, 2)), width], axis=2)
    couples = Couples(axes, rng.uniform(0.0, 7.0, (count, 2)), np.zeros((count, 2)))
    return pushed(couples, rng.uniform(0.0, 7.0, count), share * tips(couples))


def tips(couples: Couples) -> np.ndarray:
    """The sum of the least radii of curvature (m,)."""
    return (couples.axes[:, :, 1] ** 2 / couples.axes[:, :, 0]).sum(axis=1)


def pushed(couples: Couples, normal: np.ndarray, depth: np.ndarray) -> Couples:
    """The couples moved so that they overlap by this depth along this normal, stationary."""
    height, slope = (value.sum(axis=1) for value in supports(couples, normal))
    c, s, ahead = np.cos(normal), np.sin(normal), height - depth
    return replace(couples, offset=np.column_stack([ahead * c - slope * s, ahead * s + slope * c]))


def many(count: int) -> Couples:
    """From barely apart to as deep as the smaller semi-axis, mostly along a stationary normal."""
    rng = np.random.default_rng(11)
    couples = touching(rng, count, rng.uniform(1.0, 5.0, (count, 2)), 0.0)
    normal = rng.uniform(0.0, 7.0, count)
    smaller = couples.axes[:, :, 1].min(axis=1)
    depth = smaller * rng.choice([-1e-6, 1e-6, -0.01, 0.001, 0.03, 0.2, 0.6, 1.0], count)
    return pushed(couples, normal, depth * rng.uniform(0.9, 1.0, count))


MANY = many(3000)


@pytest.fixture(scope="module")
def found() -> Contacts:
    """The contacts of all the couples, asked for at once."""
    return contacts(MANY.bed(), LAW)


def index_of(found: Contacts) -> np.ndarray:
    """Which couple each contact belongs to."""
    assert np.array_equal(found.pair[:, 0] + 1, found.pair[:, 1])
    assert not (found.pair[:, 0] % 2).any()
    return found.pair[:, 0] // 2


def angles_of(found: Contacts) -> np.ndarray:
    return np.arctan2(found.normal[:, 1], found.normal[:, 0])


def between(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Angle from one direction to another, between -pi and pi."""
    return (one - other + np.pi) % (2.0 * np.pi) - np.pi


def test_contact_and_depth_are_the_least_overlap_over_all_directions(found: Contacts):
    """3000 couples against a dense search over directions."""
    depth = least(lambda angle: overlap_along(MANY, angle), len(MANY))[1]
    reported = np.full(len(MANY), -1.0)
    reported[index_of(found)] = found.depth
    assert 1500 < (depth > 0.0).sum() < 2900
    assert np.array_equal(reported > 0.0, depth > 0.0)
    assert abs(reported - depth)[depth > 0.0].max() < 1e-11


def test_normal_is_where_the_overlap_is_least(found: Contacts):
    """The overlap along it is the depth, and its direction that of a dense search."""
    couples, angle = MANY.some(index_of(found)), angles_of(found)
    assert abs(overlap_along(couples, angle) - found.depth).max() < 1e-11
    searched, depth = least(lambda angle: overlap_along(couples, angle), len(couples))
    elsewhere = overlap_along(couples, searched[:, None] + np.linspace(0.2, 6.08, 400))
    only = elsewhere.min(axis=1) > depth + 1e-3
    assert only.mean() > 0.95
    assert abs(between(angle, searched)[only]).max() < 2e-7


def test_normal_of_a_couple_pushed_together_along_one_is_that_one():
    """Shallower than the radii of curvature, depth and normal are known beforehand."""
    rng = np.random.default_rng(2)
    share = np.geomspace(1e-6, 0.99, 1000)
    couples = touching(rng, 1000, rng.uniform(1.0, 5.0, (1000, 2)), 0.0)
    normal = rng.uniform(0.0, 7.0, 1000)
    result = contacts(pushed(couples, normal, share * tips(couples)).bed(), LAW)
    assert np.array_equal(index_of(result), np.arange(1000))
    assert result.depth == pytest.approx(share * tips(couples), rel=1e-9, abs=1e-11)
    assert abs(between(angles_of(result), normal)).max() < 1e-7


def outline(couples: Couples, which: int, samples: int) -> np.ndarray:
    """Points (m, samples, 2) on the boundary, about the centre of that ellipse."""
    angle = np.linspace(0.0, 2.0 * np.pi, samples, endpoint=False)
    x = couples.axes[:, which, :1] * np.cos(angle)
    y = couples.axes[:, which, 1:] * np.sin(angle)
    c, s = np.cos(couples.angle[:, which, None]), np.sin(couples.angle[:, which, None])
    return np.stack([c * x - s * y, s * x + c * y], axis=-1)


def level(couples: Couples, which: int, points: np.ndarray) -> np.ndarray:
    """G of that ellipse at points (m, ..., 2) about its centre: 1 on it, less inside."""
    shape = (len(couples),) + (1,) * (points.ndim - 2)
    c, s = np.cos(couples.angle[:, which]), np.sin(couples.angle[:, which])
    a, b = couples.axes[:, which].T.reshape((2, *shape))
    x, y = points[..., 0], points[..., 1]
    c, s = c.reshape(shape), s.reshape(shape)
    return ((c * x + s * y) / a) ** 2 + ((c * y - s * x) / b) ** 2


def invades(couples: Couples, shift: np.ndarray, samples: int = 4000) -> np.ndarray:
    """Whether ellipse 2, shifted by `shift` (m, 2), has a boundary point inside ellipse 1."""
    moved = outline(couples, 1, samples) + (couples.offset + shift)[:, None]
    return (level(couples, 0, moved) < 1.0 - 1e-9).any(axis=1)


def test_ellipses_moved_apart_by_the_depth_touch_and_by_less_overlap(found: Contacts):
    """Against points on the boundaries: no support function has a say."""
    chosen = np.flatnonzero(found.depth > 0.02)[:400]
    couples = MANY.some(index_of(found)[chosen])
    way = found.depth[chosen, None] * found.normal[chosen]
    assert not invades(couples, way).any()
    assert invades(couples, 0.98 * way).all()


def test_no_other_direction_leads_out_by_less_than_the_depth(found: Contacts):
    """In none of 48 directions are the boundaries apart after 0.98 of the depth."""
    chosen = np.flatnonzero(found.depth > 0.05)[:60]
    couples = MANY.some(index_of(found)[chosen])
    for angle in np.linspace(0.0, 2.0 * np.pi, 48, endpoint=False):
        way = np.array([np.cos(angle), np.sin(angle)])
        assert invades(couples, 0.98 * found.depth[chosen, None] * way, 2000).all()


def test_contact_point_is_half_a_depth_from_both_boundaries(found: Contacts):
    couples, bed = MANY.some(index_of(found)), MANY.bed()
    half = 0.5 * found.depth[:, None] * found.normal
    one = found.point + half - bed.place[found.pair[:, 0]]
    other = found.point - half - bed.place[found.pair[:, 1]]
    assert abs(level(couples, 0, one) - 1.0).max() < 1e-6
    assert abs(level(couples, 1, other) - 1.0).max() < 1e-6


def paper_search(couples: Couples) -> tuple[np.ndarray, np.ndarray]:
    """The points of each boundary that lie deepest in the other, by a dense search."""
    points = []
    for which, sign in ((0, -1.0), (1, 1.0)):

        def point(alpha: np.ndarray, which: int = which) -> np.ndarray:
            x = couples.axes[:, which, :1] * np.cos(alpha)
            y = couples.axes[:, which, 1:] * np.sin(alpha)
            c, s = np.cos(couples.angle[:, which, None]), np.sin(couples.angle[:, which, None])
            return np.stack([c * x - s * y, s * x + c * y], axis=-1)

        shift = sign * couples.offset[:, None]
        alpha = least(
            lambda alpha, point=point, shift=shift, which=which: level(
                couples, 1 - which, point(alpha) + shift
            ),
            len(couples),
        )[0]
        points.append(point(alpha[:, None])[:, 0])
    return points[0], points[1] + couples.offset


def test_paper_takes_the_line_of_the_two_inmost_points():
    """Depth, normal and point against a dense search along both boundaries."""
    rng = np.random.default_rng(4)
    couples = touching(rng, 500, rng.uniform(1.0, 3.0, (500, 2)), rng.uniform(0.01, 0.6, 500))
    result = contacts(couples.bed("paper"), LAW)
    one, other = paper_search(couples)
    line = one - other
    depth = np.hypot(*line.T)
    assert np.array_equal(index_of(result), np.arange(500))
    assert result.depth == pytest.approx(depth, abs=1e-6)
    aside = (line / depth[:, None] * result.normal[:, ::-1] * [1.0, -1.0]).sum(axis=1)
    assert abs(aside * depth).max() < 1e-6
    centre = couples.bed().place[::2] + 0.5 * (one + other)
    assert abs(result.point - centre).max() < 1e-6


def test_paper_normal_is_nine_degrees_off_the_common_one_at_ratio_1_375():
    """Root mean square over orientations in shallow contacts, and nothing for discs."""
    rng = np.random.default_rng(8)
    for ratio, expected in ((1.0, 0.0), (1.375, 9.0)):
        couples = touching(rng, 3000, ratio, 0.01)
        couples.axes[:] = [ratio, 1.0]
        normal = rng.uniform(0.0, 7.0, 3000)
        couples = pushed(couples, normal, 0.01 * tips(couples))
        off = between(angles_of(contacts(couples.bed("paper"), LAW)), normal)
        assert np.degrees(np.sqrt((off**2).mean())) == pytest.approx(expected, abs=0.3)


ANGLE = st.floats(0.0, 6.28)
CONTACT = {
    "ratio": st.tuples(st.floats(1.0, 5.0), st.floats(1.0, 5.0)),
    "width": st.tuples(st.floats(0.3, 1.5), st.floats(0.3, 1.5)),
    "angle": st.tuples(ANGLE, ANGLE),
    "normal": ANGLE,
    "share": st.floats(0.01, 0.95),
}


@st.composite
def couple(draw: Any) -> Couples:
    """One couple in contact, less deep than the sum of its radii of curvature."""
    drawn = {name: np.array([draw(values)]) for name, values in CONTACT.items()}
    axes = np.stack([drawn["ratio"] * drawn["width"], drawn["width"]], axis=2)
    still = Couples(axes, drawn["angle"], np.zeros((1, 2)))
    return pushed(still, drawn["normal"], drawn["share"] * tips(still))


def touch(couple: Couples) -> tuple[float, np.ndarray, np.ndarray]:
    """Depth, normal, and point from the centre of the first."""
    result = contacts(couple.bed(), LAW)
    assert len(result.depth) == 1
    return result.depth[0], result.normal[0], result.point[0]


def turn(angle: float) -> np.ndarray:
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


@settings(deadline=None, max_examples=100)
@given(couple())
def test_other_way_round_the_normal_is_reversed(one: Couples):
    swapped = Couples(one.axes[:, ::-1], one.angle[:, ::-1], -one.offset)
    (depth, normal, point), (same, reverse, other) = touch(one), touch(swapped)
    assert same == pytest.approx(depth, rel=1e-9)
    assert reverse == pytest.approx(-normal, abs=1e-7)
    assert other == pytest.approx(point - one.offset[0], abs=1e-6)


@settings(deadline=None, max_examples=100)
@given(couple(), ANGLE)
def test_turned_as_a_whole_the_contact_turns(one: Couples, angle: float):
    turned = Couples(one.axes, one.angle + angle, one.offset @ turn(angle).T)
    (depth, normal, point), (same, after, there) = touch(one), touch(turned)
    assert same == pytest.approx(depth, rel=1e-9)
    assert after == pytest.approx(turn(angle) @ normal, abs=1e-7)
    assert there == pytest.approx(turn(angle) @ point, abs=1e-6)


@settings(deadline=None, max_examples=100)
@given(couple(), st.floats(0.01, 5.0))
def test_mirrored_and_scaled_the_contact_is_mirrored_and_scaled(one: Couples, size: float):
    mirror = np.array([1.0, -1.0])
    image = Couples(size * one.axes, -one.angle, size * one.offset * mirror)
    (depth, normal, point), (scaled, mirrored, there) = touch(one), touch(image)
    assert scaled == pytest.approx(size * depth, rel=1e-9)
    assert mirrored == pytest.approx(normal * mirror, abs=1e-7)
    assert there == pytest.approx(size * point * mirror, abs=1e-6)


@pytest.mark.parametrize("contact", ["disc", "common normal", "paper"])
def test_concentric_parts_are_refused(contact: str):
    """Below a thousandth of the smaller semi-axis, and not above."""
    for ask in (contacts, forces):
        with pytest.raises(ValueError, match="parts 1 and 2 are nearly concentric"):
            ask(grains([[9, 0], [0, 0], [0.0009, 0]], contact=contact), LAW)
    assert len(contacts(grains([[0, 0], [0.0011, 0]], contact=contact), LAW).depth) == 1


def dense_bed(contact: str, ratio: float = 1.0) -> Bed:
    """256 grains at uneven places in a box, none inside another, with velocities and spins."""
    rng = np.random.default_rng(3)
    width = rng.uniform(0.5, 1.0, (256, 1))
    place = 1.3 * np.stack(np.meshgrid(np.arange(16), np.arange(16)), axis=-1).reshape(-1, 2)
    return grains(
        place + rng.uniform(-0.2, 0.2, (256, 2)),
        np.hstack([ratio * width, width]),
        rng.normal(size=(256, 2)),
        rng.uniform(0.0, 7.0, 256),
        rng.normal(size=256),
        contact,
        (-0.5, 20.0, -0.5, 20.0),
    )


@pytest.mark.parametrize("contact", ["common normal", "paper"])
def test_ellipses_as_round_as_discs_push_like_discs(contact: str):
    """Forces and torques of all, with damping, friction and walls."""
    law = law_of(0.5, friction=0.4)
    discs, ellipses = forces(dense_bed("disc"), law), forces(dense_bed(contact), law)
    assert (abs(discs[:, 0]) > 0.0).sum() > 200
    assert abs(ellipses - discs).max() < 1e-10 * abs(discs).max()


def energies(couples: Couples, contact: str) -> np.ndarray:
    """Elastic energy (m,) of each couple, 2/5 k depth^2.5, from the depth alone."""
    bed = couples.bed(contact)
    result = contacts(bed, LAW)
    radius = bed.radius.reshape(-1, 2)
    spring = LAW.stiffness * np.sqrt(radius.prod(axis=1) / radius.sum(axis=1))
    return 0.4 * spring[index_of(result)] * result.depth**2.5


def gradient(couples: Couples, contact: str) -> np.ndarray:
    """Minus the derivative of the energy by place and angle of the second, central differences."""
    step, columns = 1e-5, []
    for k in range(3):
        shift = np.eye(3)[k] * step
        ends = [
            energies(
                Couples(
                    couples.axes,
                    couples.angle + sign * shift[2] * np.array([0.0, 1.0]),
                    couples.offset + sign * shift[:2],
                ),
                contact,
            )
            for sign in (1.0, -1.0)
        ]
        columns.append((ends[1] - ends[0]) / (2.0 * step))
    return np.column_stack(columns)


def mismatch(contact: str) -> np.ndarray:
    """Force and torque less minus the gradient, over the force, of 400 couples."""
    rng = np.random.default_rng(6)
    couples = touching(rng, 400, rng.uniform(1.0, 3.0, (400, 2)), rng.uniform(0.05, 0.9, 400))
    force = forces(couples.bed(contact), LAW)[1::2]
    return (force - gradient(couples, contact)) / np.hypot(*force[:, :2].T)[:, None]


def test_force_and_torque_are_minus_the_gradient_of_the_energy():
    assert abs(mismatch("common normal")).max() < 1e-7


def test_forces_of_the_paper_are_the_gradient_of_no_energy_of_its_depth():
    """So its elastic grains gain and lose energy; the mismatch is a good part of the force."""
    assert np.sqrt((mismatch("paper") ** 2).mean()) > 0.4


@pytest.mark.parametrize("contact", ["common normal", "paper"])
@pytest.mark.parametrize("wall", range(4))
def test_wall_pushes_by_the_depth_of_the_farthest_boundary_point(wall: int, contact: str):
    """N = k depth^1.5 at the middle of the overlap, against 200 000 points on the boundary."""
    inward = np.array([[1, 0], [-1, 0], [0, 1], [0, -1]])[wall]
    walls = tuple(np.where(np.arange(4) == wall, 0.0, [-np.inf, np.inf, -np.inf, np.inf]))
    for angle in np.linspace(0.0, np.pi, 13):
        one = Couples(np.full((1, 2, 2), [1.7, 0.6]), np.full((1, 2), angle), np.zeros((1, 2)))
        points = outline(one, 0, 200_000)[0]
        farthest = points[(points @ inward).argmin()]
        bed = grains([-0.95 * (farthest @ inward) * inward], [[1.7, 0.6]], angle=angle)
        bed = replace(bed, walls=walls, contact=contact)
        depth = -(bed.position[0] + farthest) @ inward
        push = LAW.stiffness * np.sqrt(np.sqrt(1.7 * 0.6)) * depth**1.5
        middle = farthest + 0.5 * depth * inward
        torque = push * (middle[0] * inward[1] - middle[1] * inward[0])
        result = forces(bed, LAW)[0]
        assert result[:2] == pytest.approx(push * inward, rel=1e-8, abs=1e-12)
        assert result[2] == pytest.approx(torque, abs=1e-4 * push)


@pytest.mark.parametrize("ratio", [1.375, 3.0])
def test_search_from_a_stale_start_finds_what_a_new_one_finds(ratio: float):
    """Forces with the memory of other angles, against those of a bed without memory."""
    rng = np.random.default_rng(9)
    known = advance(dense_bed("common normal", ratio), LAW, 1e-9, 1, 3).bed
    assert np.isfinite(known.memory.search).any()
    for most in (0.01, 0.3, 3.0):
        turned = replace(known, angle=known.angle + rng.uniform(-most, most, 256))
        stale, new = forces(turned, LAW), forces(replace(turned, memory=Memory()), LAW)
        assert abs(stale - new).max() < 1e-7 * abs(new).max()


def test_run_that_turns_all_around_feels_the_energies_of_new_searches():
    """Heavy ellipses that turn by up to 0.05 rad a step, the energy now and then searched anew."""
    rng = np.random.default_rng(10)
    bed = dense_bed("common normal", 2.0)
    bed = replace(bed, mass=bed.mass * 1e20, inertia=bed.inertia * 1e20)
    bed = replace(bed, velocity=0.0 * bed.velocity, spin=rng.uniform(-0.05, 0.05, 256))
    bed = replace(bed, walls=(-np.inf, np.inf, -np.inf, np.inf))
    elastic = advance(bed, LAW, 1.0, 8, 15, deepest=10.0).elastic
    for row in range(8):
        there = contacts(replace(bed, angle=bed.angle + 15 * (row + 1) * bed.spin), LAW)
        one, other = bed.radius[there.pair].T
        spring = LAW.stiffness * np.sqrt(one * other / (one + other))
        expected = (0.4 * spring * there.depth**2.5).sum()
        assert elastic[row] == pytest.approx(expected, rel=1e-7)


def test_run_past_where_another_normal_becomes_the_least_takes_that_one():
    """Two crossed ellipses, one drawn slowly from above the other to its side, searched anew.

    So deep, the normal that is remembered stays stationary when it is the least no more.
    """
    bed = grains([[0.0, 0.0], [0.3, 0.9]], [2.0, 0.5], angle=[0.0, np.pi / 2.0])
    bed = replace(bed, contact="common normal", mass=np.full(2, 1e20), inertia=np.full(2, 1e20))
    bed = replace(bed, velocity=np.array([[0.0, 0.0], [0.6, -0.6]]))
    elastic = advance(bed, LAW, 2e-5, 20, 2500, deepest=10.0).elastic
    across = []
    for row in range(20):
        there = replace(bed, position=bed.position + 0.05 * (row + 1) * bed.velocity)
        found = contacts(there, LAW)
        across.append(abs(found.normal[0, 1]) > 0.7)
        assert elastic[row] == pytest.approx(
            0.4 * LAW.stiffness * np.sqrt(0.5) * found.depth[0] ** 2.5, rel=1e-9
        )
    assert 5 < sum(across) < 15
