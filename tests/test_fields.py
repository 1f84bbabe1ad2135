"""Fields and the stress around the cylinder, against closed forms and naive sums."""

from __future__ import annotations

import itertools
from dataclasses import replace
from math import pi

import numpy as np
import pytest
from conftest import tiny_tank, with_lid
from numpy.testing import assert_allclose

from liftdrag.analysis import fields, ring
from liftdrag.analysis.around import apart, around, quantities, warnings
from liftdrag.analysis.blocks import Blocks, BlockSums
from liftdrag.analysis.fields import Grid, branches, loop_force, moments, split
from liftdrag.analysis.quantity import Quantity
from liftdrag.analysis.window import common_volume, share_inside, spread_branches
from liftdrag.granular import GRAVITY
from liftdrag.snapshot import ForceSnapshot

SCENE = tiny_tank().scene
D = SCENE.grains.diameter
RADIUS = SCENE.intruder.diameter / 2.0
AXIS = np.array([SCENE.axis_x, 0.0, SCENE.axis_height])
LENGTH, THICKNESS = SCENE.tank.length, SCENE.tank.thickness
RNG = np.random.default_rng(5)


def grains(position, velocity=0.0, wall=0.0, pair=(), force=()) -> ForceSnapshot:
    """Grains at these places (n, 3), m from the axis."""
    whole = np.broadcast_to(0.0, np.shape(position))
    return ForceSnapshot(
        0.0,
        np.asarray(position) + AXIS,
        whole + velocity,
        whole + wall,
        np.reshape(pair, (-1, 2)).astype(int),
        np.reshape(force, (-1, 3)).astype(float),
    )


class TestOfAWindow:
    @pytest.mark.parametrize("distance", [0.0, 0.4, 0.5, 0.9, 1.3, 1.49, 1.6])
    def test_the_common_volume_is_that_of_the_slices(self, distance):
        x = (np.arange(20000) + 0.5) / 20000 * 5.0 - 2.5
        squares = np.minimum(1.0 - x**2, 0.25 - (x - distance) ** 2)
        slices = pi * np.maximum(squares, 0.0)
        assert_allclose(common_volume(distance, 1.0, 0.5), slices.sum() * 5.0 / 20000, atol=1e-6)

    def test_the_share_of_a_branch_is_that_of_its_points(self):
        along = (np.arange(20000) + 0.5)[:, None] / 20000
        for start, branch in RNG.uniform(-1.5, 1.5, (50, 2, 3)):
            inside = np.linalg.norm(start + along * branch, axis=1) < 1.0
            assert_allclose(share_inside(*start, *branch, 1.0), inside.mean(), atol=1.1e-4)

    def test_sums_are_those_over_all_periodic_images(self):
        grid = Grid.of(SCENE, 1.2 * D, 0.9 * D)
        start, branch = RNG.uniform(-6 * D, 6 * D, (5, 3)), RNG.uniform(-D, D, (5, 3))
        force, found = RNG.normal(size=(5, 3)), np.zeros((len(grid.x), len(grid.z), 9))
        spread_branches(
            start, branch, force, grid.radius, grid.origin, grid.step, grid.shape, found
        )
        expected = np.zeros_like(found)
        rows = (np.arange(grid.rows) + 0.5) * THICKNESS / grid.rows
        for (i, x), y, (m, z) in itertools.product(enumerate(grid.x), rows, enumerate(grid.z)):
            for k, nx, ny in itertools.product(range(5), (-1, 0, 1), range(-4, 5)):
                image = start[k] - [x - nx * LENGTH, y - ny * THICKNESS, z]
                if np.linalg.norm(image) < 4.0 * D:
                    share = share_inside(*image, *branch[k], grid.radius)
                    expected[i, m] += share * np.outer(force[k], branch[k]).ravel()
        assert_allclose(found, expected, atol=1e-12 * abs(expected).max())


class TestFields:
    def test_a_lattice_has_the_stress_of_its_cell(self):
        """The virial f b / cell, in the mean over the windows of a cell."""
        place = np.array(list(itertools.product(range(-8, 8), range(3), range(-4, 5)))) * D
        ends = np.array([[1.0, 2.0, 3.0], [1.5, 4.0, 0.5], [0.0, 1.0, 5.0]])
        pair, force = [], []
        for k, axis in itertools.product(range(len(place)), range(3)):
            other = place[k] + D * np.eye(3)[axis]
            other[:2] = (other[0] + 8 * D) % (16 * D) - 8 * D, other[1] % (3 * D)
            near = np.flatnonzero(np.linalg.norm(place - other, axis=1) < 0.1 * D)
            pair += [(k, n) for n in near]
            force += [-ends[axis] for _ in near]
        bed = grains(place, pair=pair, force=force)
        grid = Grid(
            x=((np.arange(65) + 0.5) / 65 - 0.5) * LENGTH,
            z=((np.arange(24) + 0.5) / 24 - 0.5) * D,
            rows=26,
            radius=D,
            thickness=THICKNESS,
        )
        found = moments(loose(), grid, bed).mean(axis=(0, 1))
        assert_allclose(fields.stress(found) * D**2, ends.T, atol=2e-3)
        assert_allclose(fields.pressure(found) * D**2, 10.0 / 3.0, rtol=5e-4)

    def test_grains_pressed_together_have_a_positive_pressure(self):
        pressed = grains([[-0.5 * D, D, 3 * D], [0.5 * D, D, 3 * D]], pair=(0, 1), force=(-1, 0, 0))
        found = moments(SCENE, Grid.of(SCENE, D, D / 2), pressed)
        assert_allclose(fields.stress(found).max(axis=(0, 1))[1:].max(), 0.0)
        assert fields.pressure(found).min() == 0.0
        assert fields.pressure(found).max() > 0.0

    def test_the_cylinder_presses_through_half_a_grain(self):
        """On the other side of the tank's end, the branch is that from the nearest image."""
        centre = np.array([[-RADIUS - 0.45 * D, D, 0.0]])
        grid = Grid.of(SCENE, D, D / 8)
        for moved in (0.0, LENGTH):
            bed = grains(centre + moved * np.eye(3)[0], wall=[[-3.0, 0.0, 0.0]])
            found = fields.stress(moments(SCENE, grid, bed)).sum((0, 1))
            total = found * grid.step[0] * grid.step[2] * THICKNESS
            assert_allclose(total, [[3.0 * 0.45 * D, 0, 0], [0] * 3, [0] * 3], rtol=0.02)

    def test_plug_flow_is_exact_and_no_volume_is_lost(self):
        place = RNG.uniform([-8 * D, 0, -3 * D], [8 * D, 3 * D, 3 * D], (100, 3))
        grid = Grid.of(SCENE, D, D / 4)
        found = moments(SCENE, grid, grains(place, velocity=(0.2, -0.1, 0.03)))
        solid = found[..., 0]
        filled = solid > 0.0
        velocity = fields.velocity(found)[filled]
        assert_allclose(velocity, np.broadcast_to((0.2, -0.1, 0.03), velocity.shape), rtol=1e-12)
        assert np.isnan(fields.velocity(found)[~filled]).all()
        volume = solid.sum() * grid.step[0] * grid.step[2] * THICKNESS
        assert_allclose(volume, 100 * pi / 6 * D**3, rtol=2e-3)

    def test_pure_shear_has_no_pressure(self):
        sheared = np.zeros(19)
        sheared[[10 + 2, 10 + 6]] = 7.0
        assert fields.pressure(sheared) == 0.0
        assert_allclose(fields.deviator(sheared), 7.0)

    @pytest.mark.parametrize("gravity", [0.0, 1.0])
    def test_what_flows_through_a_loop_is_the_force_on_the_cylinder(self, gravity):
        """Chains of grains carry forces of the cylinder, and the grains' weight, outwards."""
        grain = SCENE.grains.mass * GRAVITY
        weight, thrusts = np.array([0.0, 0.0, gravity * grain]), RNG.uniform(5, 9, 12) * grain
        place, wall, pair, force = [], [], [], []
        for angle, thrust in zip(np.arange(12) * pi / 6, thrusts, strict=True):
            outward = np.array([np.cos(angle), 0.0, np.sin(angle)])
            carried = thrust * outward
            for k in range(5):
                place.append((RADIUS + (k + 0.5) * D) * outward + [0.0, D, 0.0])
                wall.append(carried if k == 0 else 0.0 * carried)
                carried = carried - weight
                pair.append((len(place) - 1, len(place)))
                force.append(-carried)
            del pair[-1], force[-1]
        bed = grains(place, wall=np.array(wall), pair=pair, force=force)
        grid = Grid.of(SCENE, D, D / 12)
        found = moments(loose(), grid, bed)
        found[..., 0] *= gravity
        expected = -np.sum(wall, axis=0)[[0, 2]]
        assert_allclose(loop_force(SCENE, grid, found, 2.5 * D), expected, atol=0.1 * grain)

    def test_momentum_that_flows_through_counts(self):
        """Grains that come in faster than they leave push the cylinder along."""
        grid = Grid.of(SCENE, D, D / 2)
        found = np.zeros((len(grid.x), len(grid.z), 19))
        speed = np.where(grid.x < 0.0, 0.2, 0.1)
        found[..., 4] = 0.6 * (speed**2)[:, None]
        drag, lift = loop_force(SCENE, grid, found, 3.0 * D)
        height = np.ptp(grid.z[abs(grid.z) <= 3.5 * D])
        flow = 0.6 * SCENE.grains.density * (0.2**2 - 0.1**2)
        assert_allclose([drag, lift], [flow * height * THICKNESS, 0.0], atol=1e-15)

    def test_the_parts_of_a_split_add_up_and_are_even_and_odd(self):
        grid = Grid.of(SCENE, D, D / 2)
        x, z = np.meshgrid(grid.x, grid.z, indexing="ij")
        even, odd = split(grid, x + z**2 + 3.0 * z)
        inside = np.isfinite(even)
        assert inside[:, abs(grid.z) < 4.0 * D].all()
        assert_allclose(even[inside], (x + z**2)[inside], atol=1e-15)
        assert_allclose(odd[inside], (3.0 * z)[inside], atol=1e-15)


def loose(scene=SCENE):
    """The scene with so much friction that no force is cut back."""
    return scene.model_copy(update={"grains": scene.grains.model_copy(update={"friction": 1e6})})


def test_a_sliding_contact_has_no_more_than_its_friction():
    bed = grains(
        [[0, 0, 4 * D], [0, 0, 5 * D]], pair=(0, 1), force=(2.0, 0.0, -1.0), wall=[[0.0] * 3] * 2
    )
    _, branch, force = branches(SCENE, bed)
    assert_allclose(branch, [[0, 0, -D]], atol=1e-12)
    assert_allclose(force, [[0.5, 0.0, -1.0]])


class TestAroundTheCylinder:
    def bed(self, angles, normal, tangential=0.0):
        """Grains at these angles of the paper, on which the cylinder has these forces."""
        out = np.column_stack([-np.cos(angles), 0 * angles, -np.sin(angles)])
        along = np.column_stack([np.sin(angles), 0 * angles, -np.cos(angles)])
        wall = np.reshape(normal, (-1, 1)) * out - np.reshape(tangential, (-1, 1)) * along
        return grains(out * (RADIUS + D / 2), wall=wall)

    def ring(self, bed):
        forces = ring.ring_forces(SCENE, bed)
        return ring.Ring.of(SCENE, Blocks(np.array([forces, forces]), np.array([1, 1])))

    def test_stresses_add_up_to_the_force(self):
        bed = self.bed(RNG.uniform(-pi, pi, 9), RNG.uniform(0, 1, 9), RNG.normal(size=9))
        found = self.ring(bed)
        normal, tangential = found.normal()[0], found.tangential()[0]
        drag = np.sum(normal * np.cos(ring.ANGLES) + tangential * np.sin(ring.ANGLES)) * found.area
        lift = np.sum(normal * np.sin(ring.ANGLES) - tangential * np.cos(ring.ANGLES)) * found.area
        expected = -bed.wall.sum(axis=0)[[0, 2]]
        assert_allclose([drag, lift], expected, rtol=1e-12)
        assert_allclose(found.forces()[0], expected, rtol=1e-12)

    def test_an_even_pressure_is_even(self):
        angles = (np.arange(640) + 0.25) * 2 * pi / 640
        total = 100.0 * pi * SCENE.intruder.diameter * THICKNESS
        found = self.ring(self.bed(angles, total / 640, 0.1 * total / 640))
        smoothing = np.exp(-0.5 * ring.WIDTH**2)
        assert_allclose(found.normal()[0], 100.0 * smoothing, rtol=1e-3)
        assert_allclose(found.tangential()[0], 10.0 * smoothing, rtol=1e-3)

    def test_the_front_is_where_grains_come_from_and_below_lifts(self):
        front, below = self.ring(self.bed(np.zeros(1), 1.0)), self.ring(self.bed(np.ones(1), 1.0))
        assert_allclose(front.forces()[0], [1.0, 0.0], atol=1e-12)
        assert front.peak()[0] == max(front.normal()[0])
        assert abs(ring.ANGLES[np.argmax(front.normal()[0])]) < 0.1
        assert below.forces()[0][1] > 0.0

    def test_the_tangential_share_is_that_of_what_rubs(self):
        rubbed = self.ring(self.bed(np.array([0.0, pi / 2]), [1.0, 0.0], [0.0, 0.25]))
        assert_allclose(rubbed.tangential_shares()[0][0], 0.2, atol=0.02)

    def test_an_even_stress_is_lifted_by_its_buoyancy(self):
        assert_allclose(ring.predicted_lift(np.full(64, 30.0), 30.0), 1.0)
        front = np.where(np.cos(ring.ANGLES) > 0.0, 15.0, 0.0)
        assert_allclose(ring.predicted_lift(front, 1.0), 7.5, rtol=1e-3)

    def test_what_eq_4_adds_has_that_lift(self):
        normal = RNG.uniform(0.0, 9.0, 64)
        normal += ring.mirrored(normal)
        added = ring.weighted_stress(SCENE, normal, 3.0, 1500.0)
        area = pi * SCENE.intruder.diameter * THICKNESS / 64
        lift = np.sum(added * np.sin(ring.ANGLES)) * area
        buoyancy = 1500.0 * GRAVITY * SCENE.intruder.section * THICKNESS
        assert_allclose(lift / buoyancy, ring.predicted_lift(normal, 3.0))


class TestBlocks:
    def test_the_error_of_a_mean_is_that_of_the_blocks(self):
        values = RNG.normal(size=40)
        sums = BlockSums(0.0, 40.0)
        for time, value in enumerate(values):
            sums.add(time, value)
        found, error = sums.blocks().estimate(lambda mean: mean)
        means = values.reshape(8, 5).mean(axis=1)
        assert_allclose([found, error], [values.mean(), means.std(ddof=1) / np.sqrt(8)])

    def test_one_block_has_no_error(self):
        error = Blocks(np.ones((1, 3)), np.array([2])).estimate(lambda mean: mean)[1]
        assert np.isnan(error).all()


@pytest.mark.parametrize("lid_only", [True, False])
def test_the_numbers_are_those_of_the_stress(lid_only):
    """Even pushes on the front half, of 15 times the confining pressure."""
    scene = with_lid(bulk_gravity=not lid_only).set("fields.snapshots", 8).scene
    angles = (np.arange(320) + 0.5) * pi / 320 - pi / 2
    out = np.column_stack([-np.cos(angles), 0 * angles, -np.sin(angles)])
    push = 15.0 * 200.0 * pi * RADIUS * scene.tank.thickness / 320
    axis = [scene.axis_x, 1e-3, scene.axis_height]
    beds = [
        ForceSnapshot(
            time + 0.5,
            axis + out * RADIUS,
            0.0 * out,
            push * (out + 1e-3 * (-1) ** time * np.eye(3)[2]),
            np.zeros((0, 2), int),
            out[:0],
        )
        for time in range(8)
    ]
    found = around(scene, beds, 0.0, 8.0)
    peak = 15.0 * np.exp(-0.5 * ring.WIDTH**2)
    told = quantities(scene, found, Quantity(200.0, 4.0, "Pa", None, None, True))
    assert_allclose(
        told["snapshot_drag"].mean, 15 * 200 * 2 * RADIUS * scene.tank.thickness, rtol=1e-4
    )
    assert_allclose(told["front_pressure_ratio"].mean, peak, rtol=1e-3)
    assert_allclose(told["front_pressure_ratio"].standard_error, 0.02 * peak, rtol=0.01)
    assert "loop_drag" not in told
    assert told["tangential_drag_share"].mean < 0.02
    assert "tangential_lift_share" not in told
    assert ("predicted_lift_coefficient" in told) == lid_only
    if lid_only:
        assert_allclose(told["predicted_lift_coefficient"].mean, 7.5, rtol=0.01)
    drag, lift = told["snapshot_drag"], told["snapshot_lift"]
    series = replace(lift, mean=lift.mean - 2.0 * lift.standard_error)
    known = {"drag": replace(drag, mean=1.1 * drag.mean), "lift": series}
    assert apart(found, known) == {"drag": None, "lift": pytest.approx(2.0)}
    (warning,) = warnings(found, known)
    assert warning.startswith(f"The snapshots' mean drag is {-0.1 * drag.mean:.2g} N off")
    assert around(scene, beds[:7], 0.0, 8.0) is None
