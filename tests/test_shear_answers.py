"""The answers of a shear flow from made-up samples whose truth is known."""

from __future__ import annotations

from collections.abc import Iterator
from math import exp, hypot

import numpy as np
import pytest
from test_shear_scene import scene_of

from liftdrag.analysis.compared import compared
from liftdrag.analysis.invariants import broken, sheared_invariants
from liftdrag.analysis.quantity import Quantity
from liftdrag.analysis.shear import ShearAnswers, answers, early_answers, normalised
from liftdrag.analysis.structure import structure_series
from liftdrag.deck.shear import CHANNELS
from liftdrag.errors import InputError
from liftdrag.kinetic import steady_shear
from liftdrag.scene import ShearScene
from liftdrag.series import Series
from liftdrag.snapshot import Snapshot

TENSORS = {
    "kinetic": np.array([[3.0, -0.5, 0.0], [-0.5, 1.0, 0.0], [0.0, 0.0, 2.0]]),
    "contact": np.array([[4.0, -1.5, 0.1], [-1.4, 6.0, 0.0], [0.1, 0.0, 5.0]]),
}
"""Stresses over rho d_v^2 rate^2: shear stress 2, pressure 7."""


def sampled(scene: ShearScene, rows: int = 600, noise: float = 0.05) -> Series:
    """Those stresses with white noise, and energies of a grain of 0.5, 0.25 and 0.01."""
    rng, scale = np.random.default_rng(1), 2500.0 * (0.238e-3 * 100.0) ** 2
    energy = scene.grain_count * scene.mass * (0.238e-3 * 100.0) ** 2
    names = [f"{i}{j}" for i in "xyz" for j in "xyz"]
    channels = {
        f"{part}_{name}": scale * (value + noise * rng.normal(size=rows))
        for part, tensor in TENSORS.items()
        for name, value in zip(names, tensor.ravel(), strict=True)
    }
    flat = {"fluctuation": 0.5 * energy, "rotation": 0.25 * energy, "elastic": 0.01 * energy}
    flat |= {"momentum": 0.0, "jumps": 1.0, "overlap": 0.02}
    channels |= {name: np.full(rows, value) for name, value in flat.items()}
    time = np.arange(1, rows + 1) * scene.drive.strain / 100.0 / rows
    return Series(time, {name: channels[name] for name in CHANNELS}, CHANNELS)


def moments(scene: ShearScene, count: int = 31) -> Iterator[Snapshot]:
    """Grains on a grid: species 1 along x, the first two stacked, 2 along x, y and z by turns."""
    kind = np.repeat([1, 2], scene.counts)
    grid = np.array(np.meshgrid(*[np.arange(4)] * 3)).reshape(3, -1).T[: len(kind)] / 4.0
    place = grid * scene.sides
    across = scene.species[0].sides(scene.grains.diameter)[0]
    place[1] = place[0] + [0.0, 0.0, 1.2 * across]
    axis = np.where((kind == 1)[:, None], np.eye(3)[0], np.eye(3)[np.arange(len(kind)) % 3])
    for time in np.linspace(0.0, scene.drive.strain / 100.0, count):
        yield Snapshot(float(time), kind, place, np.zeros_like(place), axis=axis)


def found_of(scene: ShearScene, noise: float = 0.05) -> ShearAnswers:
    return answers(scene, sampled(scene, noise=noise), moments(scene))


def test_stresses_are_those_that_were_put_in():
    """Each over rho d_v^2 rate^2, as the sum of both parts, within four standard errors."""
    found = found_of(scene_of()).quantities
    truth = {"shear_stress": 2.0, "pressure": 7.0, "bulk_friction": 2.0 / 7.0}
    truth |= {"kinetic_share": 2.0 / 7.0, "normal_difference": 0.0}
    for name, value in truth.items():
        quantity = found[name]
        assert abs(quantity.mean - value) < 4.0 * quantity.standard_error, name
        assert 0.0 < quantity.standard_error < 0.02, name
        assert quantity.converged, name
    assert found["fluctuation_energy"].mean == pytest.approx(0.5)
    assert found["rotational_energy"].mean == pytest.approx(0.25)


def test_error_of_the_friction_is_that_of_a_ratio():
    """White noise: s_f^2 = (s_t^2 + f^2 s_p^2)/(n p^2), rows before the strain left out."""
    found, rows = found_of(scene_of()).quantities["bulk_friction"], 400
    shear, pressure = 0.05 * np.sqrt(2.0), 0.05 * np.sqrt(6.0) / 3.0
    error = hypot(shear, 2.0 / 7.0 * pressure) / 7.0 / np.sqrt(rows)
    assert found.standard_error == pytest.approx(error, rel=0.2)


def test_tensor_has_each_component():
    tensor = found_of(scene_of(), noise=1e-6).tensor
    for part, values in TENSORS.items():
        got = [[tensor[f"{part}_{i}{j}"].mean for j in "xyz"] for i in "xyz"]
        assert got == pytest.approx(values, abs=1e-6)


def test_stresses_do_not_depend_on_units():
    """Twice the rate, another size and density, and samples that scale as they must."""
    grains = {"diameter": 1e-3, "density": 1000}
    other = scene_of(grains=grains, drive={"shear_rate": 200.0})
    series = sampled(other)
    scale = 1000 * (1e-3 * 200.0) ** 2 / (2500 * (0.238e-3 * 100.0) ** 2)
    scaled = {name: series[name] * scale for name in CHANNELS if CHANNELS[name] == "Pa"}
    rest = {name: series[name] for name in CHANNELS if name not in scaled}
    got = normalised(other, Series(series.time, scaled | rest, CHANNELS))
    assert got["shear_stress"].mean() == pytest.approx(2.0, abs=0.02)
    assert got["strain"][-1] == pytest.approx(2.0 * 1.5)


def test_transient_is_left_out():
    scene = scene_of(drive={"strain": 30.0, "average_from": 10.0})
    series = sampled(scene)
    early = series.time * 100.0 < 10.0
    jumped = series["contact_xy"] - 50.0 * early
    channels = dict(series.channels) | {"contact_xy": jumped}
    found = answers(scene, Series(series.time, channels, CHANNELS), moments(scene))
    assert found.quantities["shear_stress"].mean == pytest.approx(2.0, abs=0.02)
    assert found.series["strain"][found.window.start] >= 10.0
    early_only = early_answers(scene, Series(series.time, channels, CHANNELS))
    assert early_only["shear_stress"].mean == found.quantities["shear_stress"].mean


def test_series_that_ends_too_soon_is_refused():
    scene = scene_of()
    with pytest.raises(InputError, match="before what is averaged begins"):
        answers(scene, sampled(scene).first(150), moments(scene))
    with pytest.raises(InputError, match="axes of the grains were not recorded"):
        answers(scene, sampled(scene), list(moments(scene))[:3])


def test_order_is_the_mean_of_the_species_by_their_numbers():
    """Aligned rods 1, three perpendicular ways 0: a quarter of rods gives 0.25."""
    species = [{"aspect_ratio": 2, "share": 0.25}, {"aspect_ratio": 0.5, "share": 0.75}]
    scene = scene_of(species=species, cell={"solid_fraction": 0.02})
    structure = structure_series(scene, moments(scene, 2))
    assert structure["order_parameter_1"] == pytest.approx([1.0, 1.0])
    assert structure["order_parameter_2"] == pytest.approx([0.0, 0.0], abs=1e-12)
    assert structure["order_parameter"] == pytest.approx([0.25, 0.25])
    assert structure["stack_size"][0] == 2.0
    assert structure["stacking_fraction_1"][0] == pytest.approx(2.0 / 15.0)
    assert structure["stacking_fraction"][0] == pytest.approx(2.0 / 60.0)


def test_spheres_have_no_order_and_leave_that_of_the_others_alone():
    """Perpendicular disks among spheres; the share in stacks is of the disks."""
    species = [{"shape": "sphere", "share": 0.25}, {"aspect_ratio": 0.5, "share": 0.75}]
    scene = scene_of(species=species, cell={"solid_fraction": 0.02})
    structure = structure_series(scene, moments(scene, 2))
    assert structure["order_parameter"] == pytest.approx([0.0, 0.0], abs=1e-12)
    assert (structure["order_parameter_2"] == structure["order_parameter"]).all()
    assert (structure["stacking_fraction_2"] == structure["stacking_fraction"]).all()
    assert "order_parameter_1" not in structure.channels
    assert not any(name.endswith(("liu", "theory")) for name in found_of(scene).quantities)


def test_spheres_alone_are_beside_theory_while_they_are_a_fluid():
    alone = [{"shape": "sphere", "share": 1.0}]
    found = found_of(scene_of(species=alone, cell={"solid_fraction": 0.3}))
    there = steady_shear(0.3, 0.9)
    assert found.quantities["shear_stress_over_theory"].mean == pytest.approx(
        found.quantities["shear_stress"].mean / there.shear_stress
    )
    assert found.comparison["fluctuation_energy"].curve.mean == pytest.approx(there.energy)
    assert "order_parameter" not in found.quantities
    frozen = found_of(scene_of(species=alone, cell={"solid_fraction": 0.52}))
    assert frozen.comparison == {}


def quantity(mean: float, error: float) -> Quantity:
    return Quantity(mean, error, "1", 1.0, 100.0, True)


def test_difference_from_the_papers_curve_is_in_combined_errors():
    """A stress 10 % above exp(a S + b), 3 % its error and 0.01 that of S: the errors by hand."""
    curve = exp(-5.0174 * 0.7 + 2.2389)
    stress = quantity(1.1 * curve, 0.03 * curve)
    measured = {"order_parameter": quantity(0.7, 0.01), "pressure": quantity(1.0, 0.1)}
    measured["bulk_friction"] = quantity(0.3, 0.01)
    beside = compared(0.5, measured | {"shear_stress": stress})["shear_stress"]
    error = hypot(0.03 * curve, 5.0174 * 0.01 * curve)
    assert beside.curve.mean == pytest.approx(curve)
    assert beside.difference_in_errors == pytest.approx(0.1 * curve / error)
    assert beside.ratio.mean == pytest.approx(1.1)
    assert beside.ratio.standard_error == pytest.approx(hypot(0.03, 1.1 * 5.0174 * 0.01))
    assert compared(0.3, measured | {"shear_stress": stress}) == {}


def test_comparison_is_reported_at_the_papers_fractions_alone():
    species = [{"aspect_ratio": 2, "share": 0.25}, {"aspect_ratio": 0.5, "share": 0.75}]
    dense = scene_of(cell={"solid_fraction": 0.5}, species=species)
    assert "shear_stress_over_liu" in found_of(dense).quantities
    assert any("below 0.5" in warning for warning in found_of(dense).warnings)
    assert "shear_stress_over_liu" not in found_of(scene_of()).quantities


def test_invariants_hold_and_break():
    scene = scene_of()
    series = sampled(scene, noise=0.0)
    assert all(one.holds for one in sheared_invariants(scene, series).values())

    def holds(**changed: np.ndarray) -> dict[str, bool]:
        whole = Series(series.time, dict(series.channels) | changed, CHANNELS)
        return {name: one.holds for name, one in sheared_invariants(scene, whole).items()}

    assert not holds(overlap=series["overlap"] + 1.0)["largest_overlap"]
    assert not holds(momentum=series["momentum"] + 1e-9)["momentum"]
    assert not holds(fluctuation=1e4 * series["fluctuation"])["agitation"]
    work = scene.stress_scale * 2.0 * scene.volume * np.arange(600) * 1.5 / 600
    held = series["rotation"]
    assert holds(rotation=held + 0.99 * work)["energy_created"]
    assert not holds(rotation=held + 1.1 * work)["energy_created"]
    assert list(broken(sheared_invariants(scene, series))) == []
