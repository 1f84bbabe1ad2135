"""The answers of a Janssen piston from series and profiles of which they are known."""

from __future__ import annotations

import json
from dataclasses import replace
from math import exp, pi

import numpy as np
import pandas as pd
import pytest
from scipy.signal import lfilter

from liftdrag.analysis.janssen import FillWindow, answers, rankine, write_curve, write_profile
from liftdrag.analysis.janssen_curve import curve_points
from liftdrag.analysis.janssen_fit import apparent_mass
from liftdrag.errors import InputError
from liftdrag.granular import GRAVITY
from liftdrag.pictures.janssen import draw_curve, draw_profile
from liftdrag.profile import Profile
from liftdrag.scene import JanssenScene
from liftdrag.series import Series

ROWS, BLOCKS, STEP, GAP = 200, 20, 0.01, 0.5
"""Rows and blocks of a fill, s between rows, s between fills."""

FRACTION, RATIO, SHARE, ROLLING = 0.6, 0.5, 0.8, 0.3
"""Of the column made here: solid fraction, K, mobilised friction, rolling."""


def make_scene(**changes) -> JanssenScene:
    tables = {
        "scene": "janssen",
        "seed": 1,
        "grains": {
            "diameter": 3e-3,
            "density": 2500.0,
            "restitution": 0.6,
            "friction": 0.5,
            "contact": "linear",
        },
        "tube": {"diameter": 0.04, "height": 0.2, "friction": 0.5},
        "fill": {"mass": 0.2, "levels": 8},
        "drive": {"motion": "piston down", "speed": 0.01, "distance": 3e-3},
    }
    for key, value in changes.items():
        tables[key] = {**tables.get(key, {}), **value}
    return JanssenScene.model_validate(tables)


def make_fills(scene: JanssenScene) -> list[FillWindow]:
    length = ROWS * STEP
    begins = [GAP + k * (length + GAP) for k in range(len(scene.counts))]
    pairs = zip(scene.counts, begins, strict=True)
    return [FillWindow(count, begin, begin + length) for count, begin in pairs]


def sense_of(scene: JanssenScene) -> float:
    return -1.0 if scene.drive.motion == "piston up" else 1.0


def saturation(scene: JanssenScene) -> float:
    """M_sat (kg) of K = RATIO, of whose friction the wall mobilises SHARE."""
    solid = FRACTION * scene.grains.density * pi * scene.tube.diameter**3
    return solid / (16.0 * max(scene.tube.friction, 1e-12) * RATIO * SHARE)


def loads(scene: JanssenScene) -> np.ndarray:
    """Apparent mass (n,) in kg at each fill by Janssen's form."""
    masses = np.array(scene.masses)
    if not scene.tube.friction:
        return masses + scene.lid_mass
    return apparent_mass(masses, sense_of(scene), scene.lid_mass, saturation(scene))


def make_series(scene: JanssenScene, noise: float = 0.0, seed: int = 1, tau: float = 3.0) -> Series:
    """Rows in the windows and between them; AR(1) `noise`, relative, that piston and tube share."""
    fills, loaded = make_fills(scene), loads(scene)
    count = round(fills[-1].end / STEP)
    time = STEP * np.arange(1, count + 1)
    rows = np.minimum(np.searchsorted([fill.end + 1e-6 for fill in fills], time), len(fills) - 1)
    piston = GRAVITY * loaded[rows]
    weight = GRAVITY * (np.array(scene.masses) + scene.lid_mass)[rows]
    phi = (tau - 1.0) / (tau + 1.0)
    shocks = np.random.default_rng(seed).normal(size=count + 200) * np.sqrt(1.0 - phi**2)
    piston = piston * (1.0 + noise * lfilter([1.0], [1.0, -phi], shocks)[200:])
    outside = ~np.any([(time > f.begin + 1e-6) & (time < f.end + 1e-6) for f in fills], axis=0)
    piston[outside] = 1e3
    tube = weight - piston
    normal = sense_of(scene) * tube / (max(scene.tube.friction, 1e-12) * SHARE)
    channels = {"piston": piston, "tube": tube, "wall_normal": normal}
    channels["kinetic"] = np.zeros(count)
    units = {"piston": "N", "tube": "N", "wall_normal": "N", "kinetic": "J"}
    return Series(time, channels, units)


def make_profiles(
    scene: JanssenScene, noise: float = 0.0, seed: int = 2, slices: int | None = None
) -> list[Profile]:
    """Twenty blocks of each fill; slices of 2 d, the one at each end with another K."""
    rng, result = np.random.default_rng(seed), list[Profile]()
    thickness, section = 2.0 * scene.grains.diameter, scene.tube.section
    density = FRACTION * scene.grains.density
    for fill in make_fills(scene):
        top = fill.count * scene.grains.mass / (density * section)
        number = slices or int(np.ceil(top / thickness))
        edges = thickness * np.arange(number + 3)
        filled = np.clip((top - edges[:-1]) / thickness, 0.0, 1.0)
        height = thickness * (np.arange(number + 2) + 0.5)
        volume = section * thickness * filled
        beta = sense_of(scene) * density * section / saturation(scene)
        depth = np.maximum(top - height, 0.1 * thickness)
        lid = scene.lid_mass * GRAVITY / section
        decay = np.exp(-beta * depth)
        stress = density * GRAVITY / beta * (1.0 - decay) + lid * decay
        ends = (height < 9e-3) | (height > top - 9e-3)
        ratio = np.where(ends, 3.0 * RATIO, RATIO)
        contacts = 40.0 * filled
        for block in range(1, BLOCKS + 1):
            scatter = 1.0 + noise * rng.normal(size=len(height))
            normal = ratio * stress * scatter * pi * scene.tube.diameter * thickness * filled
            spin = ROLLING * scene.wall_speed / (scene.grains.diameter / 2.0) * contacts
            result.append(
                Profile(
                    fill.begin + block * (fill.end - fill.begin) / BLOCKS,
                    height,
                    density * volume / scene.grains.mass,
                    stress * volume,
                    normal,
                    SHARE * scene.tube.friction * normal,
                    contacts,
                    0.7 * contacts,
                    0.25 * contacts,
                    spin,
                )
            )
    return result


def found_of(scene: JanssenScene, **noise):
    series, profiles = make_series(scene, **noise), make_profiles(scene)
    return answers(scene, series, profiles, make_fills(scene))


def warned(found, words: str) -> list[str]:
    return [text for text in found.warnings if words in text]


@pytest.mark.parametrize(
    "changes", [{}, {"drive": {"motion": "piston up"}}, {"overload": {"mass": 0.05}}]
)
def test_exact_column_gives_back_what_it_was_made_of(changes):
    scene = make_scene(**changes)
    found = found_of(scene)
    known = {
        "apparent_mass": loads(scene)[-1],
        "weight_balance": 1.0,
        "solid_fraction": FRACTION,
        "saturation_mass": saturation(scene),
        "janssen_ratio": RATIO * SHARE,
        "janssen_ratio_mobilised": RATIO,
        "janssen_ratio_direct": RATIO,
        "mobilised_friction": SHARE,
        "wall_mobilisation": 0.7,
        "wall_sliding": 0.25,
        "wall_rolling": ROLLING,
        "chi_square": 0.0,
    }
    assert found.quantities.keys() == known.keys() | {"hydrostatic_cap"}
    for name, value in known.items():
        assert found.quantities[name].mean == pytest.approx(value, rel=1e-6, abs=1e-6), name
        assert found.quantities[name].converged, name
    assert found.quantities["hydrostatic_cap"].mean < 1e-3 * scene.masses[-1]
    assert found.quantities["chi_square"].standard_error == pytest.approx(np.sqrt(2.0 / 7.0))


def test_curve_has_a_point_for_each_fill():
    scene = make_scene()
    found = found_of(scene)
    for point, mass, load in zip(found.curve, scene.masses, loads(scene), strict=True):
        assert point.mass == pytest.approx(mass)
        assert point.apparent_mass.mean == pytest.approx(load)
        assert point.tube_mass.mean == pytest.approx(mass - load)
        assert point.weight_balance.mean == pytest.approx(1.0)
        assert point.mobilised_friction.mean == pytest.approx(SHARE)


def test_rows_on_the_bounds_of_a_window_belong_to_its_end():
    fill = FillWindow(1, 0.3, 0.9)
    assert list(fill.holds(0.1 * np.arange(11.0))) == [False] * 4 + [True] * 6 + [False]


@pytest.mark.parametrize("tau", [1.0, 3.0, 8.0])
def test_error_of_a_point_is_its_scatter_over_correlated_series(tau):
    scene = make_scene()
    fills, exact = make_fills(scene), loads(scene)
    seen, stated, times = list[float](), list[float](), list[float]()
    for seed in range(60):
        points = curve_points(scene, make_series(scene, 0.1, seed, tau), fills)
        for point, load in zip(points, exact, strict=True):
            seen.append(point.apparent_mass.mean / load - 1.0)
            stated.append(point.apparent_mass.standard_error / load)
            times.append(point.apparent_mass.correlation_time)
    assert np.mean(stated) == pytest.approx(np.sqrt(np.mean(np.square(seen))), rel=0.15)
    assert np.mean(times) == pytest.approx(tau * STEP, rel=0.4)


def test_error_of_the_balance_is_that_of_the_sum():
    """What the piston loses and the tube gains leaves the sum as it is."""
    found = found_of(make_scene(), noise=0.2)
    assert found.curve[-1].apparent_mass.standard_error > 1e-3 * found.curve[-1].mass
    assert found.quantities["weight_balance"].standard_error < 1e-12


def test_error_of_the_fitted_ratio_holds_that_of_the_solid_fraction():
    scene = make_scene()
    profiles, rng = make_profiles(scene), np.random.default_rng(5)
    profiles = [replace(p, count=p.count * (1.0 + 0.05 * rng.normal())) for p in profiles]
    found = answers(scene, make_series(scene, 0.1), profiles, make_fills(scene)).quantities
    parts = [found["saturation_mass"], found["solid_fraction"]]
    shares = [part.standard_error / part.mean for part in parts]
    assert shares[1] > 0.2 * shares[0]
    expected = found["janssen_ratio"].mean * np.hypot(*shares)
    assert found["janssen_ratio"].standard_error == pytest.approx(expected)


def test_scatter_of_the_blocks_is_the_error_of_the_direct_ratio():
    scene = make_scene()
    fills, series = make_fills(scene), make_series(scene)
    runs = [answers(scene, series, make_profiles(scene, 0.3, seed), fills) for seed in range(24)]
    direct = [run.quantities["janssen_ratio_direct"] for run in runs]
    means, errors = ([getattr(q, k) for q in direct] for k in ("mean", "standard_error"))
    assert abs(np.mean(means) - RATIO) < 5.0 * np.std(means) / np.sqrt(24)
    assert np.mean(errors) == pytest.approx(np.std(means), rel=0.35)


def test_bulk_is_clear_of_both_ends():
    """The ends of the column made here have three times the ratio; a low one has no bulk."""
    low = make_scene(fill={"mass": 0.02, "curve": False})
    found = found_of(low)
    assert warned(found, "too low for a bulk")
    assert found.quantities["janssen_ratio_direct"].mean == pytest.approx(3.0 * RATIO)
    assert not warned(found_of(make_scene()), "too low for a bulk")


def test_few_blocks_give_their_scatter_and_are_not_converged():
    scene = make_scene()
    fills = make_fills(scene)
    last = [p for p in make_profiles(scene, 0.3) if p.time > fills[-1].begin + 1e-6][:4]
    found = answers(scene, make_series(scene), last, fills).quantities["janssen_ratio_direct"]
    assert not found.converged
    assert found.standard_error > 0.0


def test_profile_of_the_last_fill():
    scene = make_scene()
    found = found_of(scene).profile
    inside = slice(2, -3)
    assert found.height[0] == pytest.approx(scene.grains.diameter)
    assert found.ratio[inside] == pytest.approx(RATIO)
    assert found.ratio[0] == pytest.approx(3.0 * RATIO)
    assert found.radial_stress == pytest.approx(found.ratio * found.vertical_stress)
    assert found.mobilisation == pytest.approx(0.7)
    assert found.sliding == pytest.approx(0.25)
    assert found.solid_fraction[:-1] == pytest.approx(FRACTION)
    assert 0.0 < found.solid_fraction[-1] < FRACTION
    assert found.spin == pytest.approx(ROLLING * 0.01 / 1.5e-3)
    bottom = GRAVITY * loads(scene)[-1] / scene.tube.section
    assert found.vertical_stress[0] == pytest.approx(bottom, rel=0.05)


def test_smooth_tube_says_nothing_of_friction():
    scene = make_scene(tube={"friction": 0.0})
    found = found_of(scene)
    kept = {"apparent_mass", "weight_balance", "solid_fraction", "janssen_ratio_direct"}
    assert found.quantities.keys() == kept | {"wall_rolling"}
    assert found.quantities["apparent_mass"].mean == pytest.approx(scene.masses[-1])
    assert found.fits == {}
    assert found.curve[0].mobilised_friction is None


def test_one_fill_has_no_fit_but_all_else():
    scene = make_scene(fill={"curve": False})
    found = found_of(scene)
    fitted = {"saturation_mass", "janssen_ratio", "janssen_ratio_mobilised", "chi_square"}
    assert not found.quantities.keys() & (fitted | {"hydrostatic_cap"})
    measured = {"janssen_ratio_direct", "mobilised_friction", "wall_mobilisation", "wall_rolling"}
    assert measured <= found.quantities.keys()
    assert found.fits == {}


def test_nothing_that_moves_is_warned_about_and_does_not_roll():
    still = {"motion": "none", "speed": None, "distance": None, "duration": 1.0}
    found = found_of(make_scene(drive=still))
    assert warned(found, "Nothing moves")
    assert "wall_rolling" not in found.quantities
    assert not warned(found_of(make_scene()), "Nothing moves")


def with_channel(series: Series, name: str, values: np.ndarray) -> Series:
    return replace(series, channels={**series.channels, name: values})


def test_balance_is_warned_about_with_its_fill():
    scene, fills = make_scene(), make_fills(make_scene())
    series = make_series(scene)
    fourth = fills[3].holds(series.time)
    off = with_channel(series, "tube", np.where(fourth, 1.1 * series["tube"], series["tube"]))
    found = answers(scene, off, make_profiles(scene), fills)
    (text,) = warned(found, "Out of balance")
    assert "fill 4 of 8" in text
    assert not warned(found_of(scene), "Out of balance")


def test_drift_is_warned_about_with_its_fills_in_one_sentence():
    scene, fills = make_scene(), make_fills(make_scene())
    series = make_series(scene, noise=0.05, seed=3, tau=2.0)
    piston = series["piston"].copy()
    for k in (1, 5):
        inside = fills[k].holds(series.time)
        piston[inside] *= np.linspace(0.8, 1.2, inside.sum())
    found = answers(scene, with_channel(series, "piston", piston), make_profiles(scene), fills)
    (text,) = warned(found, "NOT STEADY")
    assert "fills 2, 6 of 8" in text
    calm = answers(scene, series, make_profiles(scene), fills)
    assert not warned(calm, "NOT STEADY")
    assert not warned(calm, "NOT CONVERGED")


def test_slow_series_is_not_converged():
    found = found_of(make_scene(), noise=0.1, tau=40.0)
    (text,) = warned(found, "NOT CONVERGED")
    assert "of 8" in text
    assert not found.quantities["saturation_mass"].converged


def test_friction_short_of_its_limit_is_warned_about():
    (text,) = warned(found_of(make_scene()), "of the friction it could")
    assert "0.8 +-" in text
    scene = make_scene()
    series = make_series(scene)
    full = with_channel(series, "wall_normal", SHARE * series["wall_normal"])
    found = answers(scene, full, make_profiles(scene), make_fills(scene))
    assert found.quantities["mobilised_friction"].mean == pytest.approx(1.0)
    assert not warned(found, "of the friction it could")


def test_ratios_that_disagree_are_warned_about():
    scene = make_scene()
    series, fills = make_series(scene, noise=0.05), make_fills(scene)
    profiles = make_profiles(scene, 0.05)
    assert not warned(answers(scene, series, profiles, fills), "assumption of one ratio")
    more = [replace(p, wall_normal=1.3 * p.wall_normal) for p in profiles]
    (text,) = warned(answers(scene, series, more, fills), "assumption of one ratio")
    assert "apart by -0.1" in text


def test_two_parameter_data_widen_the_error_and_say_so():
    scene, fills = make_scene(), make_fills(make_scene())
    series = make_series(scene, noise=0.02)
    capped = apparent_mass(np.array(scene.masses), 1.0, 0.0, saturation(scene), 0.05)
    piston = series["piston"].copy()
    for fill, old, new in zip(fills, loads(scene), capped, strict=True):
        piston[fill.holds(series.time)] *= new / old
    found = answers(scene, with_channel(series, "piston", piston), make_profiles(scene), fills)
    fit, stated = found.fits["one_parameter"], found.quantities["saturation_mass"]
    assert fit.scatter > 0.01
    assert stated.standard_error == pytest.approx(fit.saturation_error)
    (text,) = warned(found, "does not hold within the errors")
    assert f"{fit.reduced:.3g}" in text
    assert f"scatter of {100 * fit.scatter:.2g} %" in text
    cap = found.quantities["hydrostatic_cap"]
    assert abs(cap.mean - 0.05) < 4.0 * cap.standard_error
    assert not warned(found_of(scene, noise=0.02), "does not hold within the errors")


@pytest.mark.parametrize(("mass", "levels"), [(0.05, 8), (0.9, 4)])
def test_fills_that_do_not_bracket_the_saturation_mass_are_warned_about(mass, levels):
    scene = make_scene(fill={"mass": mass, "levels": levels}, tube={"height": 0.6})
    assert warned(found_of(scene), "ill-conditioned")
    assert not warned(found_of(make_scene()), "ill-conditioned")


def test_load_that_does_not_bend_as_the_motion_asks_gives_a_warning():
    up, down = make_scene(drive={"motion": "piston up"}), make_scene()
    found = answers(up, make_series(down), make_profiles(up), make_fills(up))
    assert warned(found, "No saturation mass")
    assert "janssen_ratio" not in found.quantities
    assert "apparent_mass" in found.quantities


def test_without_profiles_there_is_a_fit_but_no_ratio():
    scene = make_scene()
    found = answers(scene, make_series(scene), [], make_fills(scene))
    assert found.quantities["saturation_mass"].mean == pytest.approx(saturation(scene))
    assert "janssen_ratio" not in found.quantities
    assert found.profile is None
    assert warned(found, "No profile")


def test_fill_without_samples_is_refused():
    scene = make_scene()
    late = [FillWindow(100, 1e3, 1e3 + 1.0)]
    with pytest.raises(InputError, match="samples of the fill of 100 grains"):
        answers(scene, make_series(scene), [], late)


@pytest.mark.parametrize(
    ("friction", "active"), [(0.0, 1.0), (0.5, 0.381966011250105), (3**-0.5, 1.0 / 3.0)]
)
def test_rankine_bounds(friction, active):
    assert rankine(friction) == pytest.approx((active, 1.0 / active))


def test_record_is_json_of_finite_numbers():
    record = found_of(make_scene(), noise=0.1).to_dict()
    assert json.loads(json.dumps(record, allow_nan=False)) == record
    assert record["fits"].keys() == {"one_parameter", "two_parameter"}
    assert record["rankine"]["active"] == pytest.approx(0.381966011250105)


def test_tables_hold_the_curve_and_the_profile(tmp_path):
    scene = make_scene()
    found = found_of(scene, noise=0.1)
    write_curve(scene, found, tmp_path / "curve.csv")
    write_profile(found, tmp_path / "profile.csv")
    curve, profile = (pd.read_csv(tmp_path / name) for name in ("curve.csv", "profile.csv"))
    assert list(curve["mass (kg)"]) == pytest.approx(scene.masses)
    stated = [point.apparent_mass.standard_error for point in found.curve]
    assert list(curve["apparent mass standard error (kg)"]) == pytest.approx(stated)
    fit = found.fits["one_parameter"].saturation_mass
    expected = [fit * (1.0 - exp(-mass / fit)) for mass in scene.masses]
    assert list(curve["one parameter (kg)"]) == pytest.approx(expected)
    assert list(curve["hydrostatic (kg)"]) == pytest.approx(scene.masses)
    assert list(curve["converged"]) == [True] * 8
    assert list(profile["vertical stress (Pa)"]) == pytest.approx(found.profile.vertical_stress)
    assert list(profile["ratio (1)"]) == pytest.approx(found.profile.ratio)


@pytest.mark.parametrize(
    "changes",
    [{}, {"fill": {"curve": False}}, {"tube": {"friction": 0.0}}, {"fill": {"levels": 2}}],
)
def test_pictures_and_tables_of_every_kind_of_result(changes, tmp_path):
    scene = make_scene(**changes)
    found = found_of(scene, noise=0.1)
    draw_curve(scene, found, tmp_path / "curve.png")
    draw_profile(scene, found, tmp_path / "profile.png")
    write_curve(scene, found, tmp_path / "curve.csv")
    assert all((tmp_path / f"{name}.png").stat().st_size > 10_000 for name in ("curve", "profile"))
    assert len(pd.read_csv(tmp_path / "curve.csv")) == len(scene.counts)
