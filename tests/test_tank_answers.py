"""The answers of a tank from series that are made up, and so known."""

from __future__ import annotations

from dataclasses import replace
from math import hypot, pi

import numpy as np
import pytest
from conftest import tiny_tank, with_lid

from liftdrag.analysis.quantity import Quantity, ratio, rounded
from liftdrag.analysis.tank import answers
from liftdrag.errors import InputError
from liftdrag.series import Series

SCENE = tiny_tank(tank={"length": "60 d", "height": "40 d"}, drive={"distance": "40 D"}).scene
LIDDED = {
    name: with_lid(bulk_gravity).scene for name, bulk_gravity in (("on", True), ("off", False))
}
UNITS = {"drag": "N", "lift": "N", "bed_speed": "m/s", "solid_fraction": "1", "overburden": "Pa"}


def made_up(scene, count=4000, **means) -> Series:
    """White noise of a hundredth about these means, over the scene's distance."""
    rng = np.random.default_rng(5)
    values = {"drag": 2.0, "lift": 0.5, "bed_speed": scene.drive.speed, "solid_fraction": 0.6}
    values |= {"overburden": 100.0} | means
    end = scene.drive.distance / scene.drive.speed
    channels = {name: values[name] * (1.0 + 0.01 * rng.standard_normal(count)) for name in UNITS}
    return Series(np.linspace(end / count, end, count), channels, UNITS)


def column(scene, level: float) -> np.ndarray:
    """Heights of grains of solid fraction 0.6 in the far field, evenly up to `level` (m)."""
    (left, right), d = scene.far_field, scene.grains.diameter
    bottom = scene.far_band[0]
    volume = (right - left) * scene.tank.thickness * (level - bottom)
    count = round(0.6 * volume / (pi * d**3 / 6.0))
    return bottom + (np.arange(count) + 0.5) * (level - bottom) / count


def surfaces(scene, levels) -> list[tuple[float, np.ndarray]]:
    end = scene.drive.distance / scene.drive.speed
    times = np.linspace(0.0, end, len(levels))
    return [(time, column(scene, level)) for time, level in zip(times, levels, strict=True)]


def level(scene, depth: float) -> float:
    return scene.axis_height + depth


def test_depth_is_that_of_the_steady_window():
    """The surface sinks during the transient; the depth reported is that after it."""
    levels = [level(SCENE, 0.03)] * 3 + [level(SCENE, 0.012)] * 77
    found = answers(SCENE, made_up(SCENE), surfaces(SCENE, levels))
    assert found.quantities["depth"].mean == pytest.approx(0.012, abs=0.1 * SCENE.grains.diameter)


def test_depth_that_varies_has_an_error():
    rng = np.random.default_rng(1)
    levels = level(SCENE, 0.012) + 1e-3 * rng.standard_normal(400)
    depth = answers(SCENE, made_up(SCENE), surfaces(SCENE, levels)).quantities["depth"]
    assert depth.standard_error == pytest.approx(1e-3 / np.sqrt(380), rel=0.3)
    assert depth.converged


def test_coefficients_of_known_means():
    depth, d = 0.012, SCENE.intruder.diameter
    found = answers(SCENE, made_up(SCENE), surfaces(SCENE, [level(SCENE, depth)] * 60)).quantities
    weight = 0.6 * 2500.0 * 9.81
    h, side = found["depth"].mean, SCENE.tank.thickness
    assert found["drag_coefficient"].mean == pytest.approx(2.0 / (weight * h * d * side), rel=2e-3)
    lift = 0.5 / (weight * pi * d**2 / 4.0 * side)
    assert found["lift_coefficient"].mean == pytest.approx(lift, rel=2e-3)
    by_weight = 2.0 / (100.0 * d * side)
    assert found["drag_coefficient_overburden"].mean == pytest.approx(by_weight, rel=2e-3)
    inertial = SCENE.drive.speed / d * 1.5e-3 / np.sqrt(100.0 / 2500.0)
    assert found["inertial_number"].mean == pytest.approx(inertial, rel=2e-3)


@pytest.mark.parametrize(("name", "own"), [("on", 1.0), ("off", 0.0)])
def test_effective_depth_under_a_lid(name, own):
    scene = LIDDED[name]
    q = answers(scene, made_up(scene), surfaces(scene, [level(scene, 0.03)] * 60)).quantities
    lid = pi * 1.5e-3 / 6.0 * 60.0 / q["solid_fraction"].mean
    assert q["effective_depth"].mean == pytest.approx(own * q["depth"].mean + lid, rel=1e-9)


def test_the_solid_fraction_cancels_where_only_the_lid_has_weight():
    """rho h~ is then (pi d / 6) rho*, whatever the bulk is; its error adds nothing to C_d."""
    scene = LIDDED["off"]
    levels = surfaces(scene, [level(scene, 0.03)] * 60)
    for fraction in (0.5, 0.6):
        q = answers(scene, made_up(scene, solid_fraction=fraction), levels).quantities
        front = scene.intruder.diameter * scene.tank.thickness
        pressure = pi * 1.5e-3 / 6.0 * 60.0 * 2500.0 * 9.81
        drag = q["drag_coefficient"]
        assert drag.mean == pytest.approx(q["drag"].mean / (pressure * front), rel=1e-9)
        share = drag.standard_error / drag.mean
        assert share == pytest.approx(q["drag"].standard_error / q["drag"].mean, rel=1e-9)


def test_a_drag_that_follows_a_slow_depth_has_a_steady_coefficient():
    """The far surface falls by a third: C_d's error is that of drag over depth, not the fall's."""
    series, depths = made_up(SCENE), np.linspace(0.016, 0.010, 400)
    noise = series["drag"] / series["drag"].mean()
    when = np.linspace(0.0, SCENE.drive.distance / SCENE.drive.speed, 400)
    follows = 150.0 * np.interp(series.time, when, depths) * noise
    series = replace(series, channels=dict(series.channels) | {"drag": follows})
    q = answers(SCENE, series, surfaces(SCENE, level(SCENE, depths))).quantities
    front = SCENE.intruder.diameter * SCENE.tank.thickness
    truth = 150.0 / (0.6 * 2500.0 * 9.81 * front)
    assert q["drag_coefficient"].mean == pytest.approx(truth, rel=5e-3)
    assert q["drag_coefficient"].converged
    own = float(noise.std()) / np.sqrt(len(series))
    assert q["drag_coefficient"].standard_error < 4.0 * own * truth
    assert q["depth"].standard_error > 0.05 * q["depth"].mean


def test_a_slipping_bed_is_said():
    series = made_up(SCENE, bed_speed=0.9 * SCENE.drive.speed)
    found = answers(SCENE, series, surfaces(SCENE, [level(SCENE, 0.012)] * 60))
    assert found.quantities["bed_speed_ratio"].mean == pytest.approx(0.9, rel=1e-3)
    assert any(text.startswith("The bed slips") and "0.900" in text for text in found.warnings)


def test_a_quiet_series_has_no_warnings():
    found = answers(SCENE, made_up(SCENE), surfaces(SCENE, [level(SCENE, 0.012)] * 60))
    assert found.warnings == ()
    assert found.window.steady


def test_a_far_field_that_only_drifts_is_said():
    series = made_up(SCENE)
    drifting = dict(series.channels) | {"overburden": np.linspace(90.0, 110.0, len(series))}
    series = replace(series, channels=drifting)
    found = answers(SCENE, series, surfaces(SCENE, [level(SCENE, 0.012)] * 60))
    assert not found.quantities["overburden"].converged
    assert found.quantities["overburden"].standard_error > 2.0
    assert any("overburden" in text and "slowly" in text for text in found.warnings)


def test_a_force_that_never_repeats_itself_is_not_converged():
    series = made_up(SCENE)
    walk = 2.0 + np.cumsum(np.random.default_rng(2).standard_normal(len(series))) / 50.0
    series = replace(series, channels=dict(series.channels) | {"drag": walk})
    found = answers(SCENE, series, surfaces(SCENE, [level(SCENE, 0.012)] * 60))
    assert not found.quantities["drag"].converged
    assert not found.quantities["drag_coefficient"].converged
    assert any(text.startswith("NOT CONVERGED: the drag") for text in found.warnings)


def test_a_series_that_ends_before_the_flow_is_steady_is_refused():
    series = made_up(SCENE)
    short = Series(series.time[:60], {k: v[:60] for k, v in series.channels.items()}, UNITS)
    with pytest.raises(InputError, match="before the flow is steady"):
        answers(SCENE, short, surfaces(SCENE, [level(SCENE, 0.012)] * 60))


def quantity(mean: float, error: float, converged: bool = True) -> Quantity:
    return Quantity(mean, error, "N", 1.0, 30.0, converged)


def test_ratio_adds_relative_errors_in_quadrature():
    found = ratio(quantity(-3.0, 0.3), 2.0, [quantity(4.0, 0.4), quantity(5.0, 1.0)], "1")
    assert found.mean == pytest.approx(-0.3)
    assert found.standard_error == pytest.approx(0.3 * hypot(0.1, 0.1, 0.2))


def test_ratio_of_a_force_that_is_zero_keeps_its_error():
    found = ratio(quantity(0.0, 0.3), 2.0, [quantity(4.0, 0.4)], "1")
    assert found.mean == 0.0
    assert found.standard_error == pytest.approx(0.15)


@pytest.mark.parametrize(
    ("force", "divisor", "converged"),
    [
        (quantity(1.0, 0.1), quantity(1.0, 0.2), True),
        (quantity(1.0, 0.1, False), quantity(1.0, 0.01), False),
        (quantity(1.0, 0.1), quantity(1.0, 0.04, False), True),
        (quantity(1.0, 0.1), quantity(1.0, 0.06, False), False),
    ],
)
def test_ratio_is_converged_when_all_that_matters_is(force, divisor, converged):
    assert ratio(force, 1.0, [divisor], "1").converged is converged


@pytest.mark.parametrize(
    ("mean", "error", "shown"),
    [
        (0.0669123, 0.00174, ("0.0669", "0.0017")),
        (10.26, 0.512, ("10.26", "0.51")),
        (559.87, 12.3, ("560", "12")),
        (-0.3, 0.0, ("-0.3", "0")),
        (3.2e-9, 1.1e-10, ("3.2e-09", "1.1e-10")),
    ],
)
def test_numbers_are_shown_to_the_second_digit_of_their_error(mean, error, shown):
    assert rounded(mean, error) == shown
