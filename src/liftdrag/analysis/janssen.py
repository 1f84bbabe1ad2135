"""The answers of a Janssen piston: its curve, the fits, K in two ways, and the wall's friction."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import hypot, inf, pi, sqrt
from pathlib import Path
from typing import Any

import numpy as np

from liftdrag.analysis.column import ENDS, Column, ColumnProfile
from liftdrag.analysis.errorbars import MINIMUM_CORRELATION_TIMES
from liftdrag.analysis.janssen_curve import CurvePoint, curve_points, curve_table, fitted_curve
from liftdrag.analysis.janssen_curve import FillWindow as FillWindow
from liftdrag.analysis.janssen_curve import sense as sense
from liftdrag.analysis.janssen_fit import JanssenFit, apparent_mass, fit_one, fit_two, with_scatter
from liftdrag.analysis.janssen_stop import LEAST_WAY
from liftdrag.analysis.quantity import Quantity, ratio, rounded
from liftdrag.analysis.stopping import reached
from liftdrag.profile import Profile
from liftdrag.scene import JanssenScene
from liftdrag.series import Series

FEWEST_FILLS = 3
"""Fills from which on a curve is fitted."""

OUT_OF_BALANCE = 0.01
"""Relative departure of piston and tube from the weight that is warned about."""

MOBILISED = 0.95
"""Share of the wall's friction below which it is not called mobilised."""

LARGEST_DRIFT = 3.0
"""Drift of the piston's force in its errors above which it is not steady."""

APART = 2.0
"""Combined errors beyond which two ways to K disagree."""

DOUBTED = 0.05
"""p-value under which a form does not hold within the errors."""


@dataclass(frozen=True)
class JanssenAnswers:
    """The quantities by name, the points of the curve, its fits by name, and warnings.

    `rankine` are the active and the passive bounds of K; `profile` is that of the last fill,
    None where none was recorded.
    """

    quantities: dict[str, Quantity]
    curve: tuple[CurvePoint, ...]
    fits: dict[str, JanssenFit]
    rankine: tuple[float, float]
    profile: ColumnProfile | None
    warnings: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """What `result.json` holds besides the quantities."""
        active, passive = self.rankine
        return {
            "fits": {name: fit.to_dict() for name, fit in self.fits.items()},
            "rankine": {"active": active, "passive": passive},
        }


def answers(
    scene: JanssenScene,
    series: Series,
    profiles: Sequence[Profile],
    fills: Sequence[FillWindow],
) -> JanssenAnswers:
    """The answers of a piston from its series and profiles, a window for each fill, ascending.

    `series` has the channels piston, tube and wall_normal (N). Raises InputError where a fill
    has no samples.
    """
    points = curve_points(scene, series, fills)
    column = _column(scene, profiles, fills[-1])
    fits = _fits(scene, points)
    wall = _wall(scene, points[-1], column)
    quantities = {
        "apparent_mass": points[-1].apparent_mass,
        "weight_balance": points[-1].weight_balance,
        **({} if column is None else {"solid_fraction": column.solid_fraction}),
        **wall,
    }
    quantities |= dict(_fitted(scene, points, fits, quantities))
    warnings = _warnings(scene, points, fits, column, quantities)
    return JanssenAnswers(
        quantities,
        points,
        fits,
        rankine(scene.grains.friction),
        None if column is None else column.profile,
        tuple(warnings),
    )


def rankine(friction: float) -> tuple[float, float]:
    """Horizontal over vertical stress at failure, active and passive.

    (1 - sin psi)/(1 + sin psi) and its inverse, tan psi the `friction` of the grains (Mohr and
    Coulomb; that of a bed of rolling grains is another).
    """
    sine = friction / hypot(1.0, friction)
    return (1.0 - sine) / (1.0 + sine), (1.0 + sine) / (1.0 - sine)


def janssen_curves(
    scene: JanssenScene, fits: Mapping[str, JanssenFit], mass: np.ndarray
) -> dict[str, np.ndarray]:
    """The apparent mass of each fit, and the hydrostatic one, at fills of `mass` (n,), in kg."""
    curves = {
        name: apparent_mass(
            mass, sense(scene), scene.lid_mass, fit.saturation_mass, fit.hydrostatic_cap
        )
        for name, fit in fits.items()
    }
    return curves | {"hydrostatic": mass + scene.lid_mass}


def write_curve(scene: JanssenScene, found: JanssenAnswers, path: Path) -> None:
    """The points of the curve and the fits there, a row for each fill, as CSV."""
    forms = janssen_curves(scene, found.fits, np.array([point.mass for point in found.curve]))
    forms = {name.replace("_", " "): values for name, values in forms.items()}
    curve_table(found.curve, forms).to_csv(path, index=False)


def write_profile(found: JanssenAnswers, path: Path) -> None:
    """The last fill slice by slice, a row for each, as CSV; nothing without a profile."""
    if found.profile is not None:
        found.profile.to_pandas().to_csv(path, index=False)


def _column(scene: JanssenScene, profiles: Sequence[Profile], fill: FillWindow) -> Column | None:
    """The blocks of a fill, None where there is none, or no grain in them."""
    held = [profile for profile in profiles if fill.holds(np.array(profile.time))]
    held = [profile for profile in held if profile.count.sum() > 0.0]
    return Column(scene, held, (fill.end - fill.begin) / len(held)) if held else None


def _fits(scene: JanssenScene, points: Sequence[CurvePoint]) -> dict[str, JanssenFit]:
    if len(points) < FEWEST_FILLS or not scene.tube.friction:
        return {}
    curve = fitted_curve(scene, points)
    forms = {"one_parameter": fit_one, "two_parameter": fit_two}
    fits = {name: with_scatter(form, curve) for name, form in forms.items()}
    return {
        name: fit
        for name, fit in fits.items()
        if fit is not None and fit.saturation_error < fit.saturation_mass
    }


def _wall(scene: JanssenScene, last: CurvePoint, column: Column | None) -> dict[str, Quantity]:
    """What is measured at the wall of the last fill, without what cannot be."""
    friction = {"mobilised_friction": last.mobilised_friction}
    found: dict[str, Quantity | None] = {}
    if column is not None:
        found |= {"janssen_ratio_direct": column.janssen_ratio}
        found |= {"wall_rolling": column.wall_rolling}
        friction |= {"wall_mobilisation": column.wall_mobilisation}
        friction |= {"wall_sliding": column.wall_sliding}
    if scene.tube.friction:
        found |= friction
    return {name: quantity for name, quantity in found.items() if quantity is not None}


def _fitted(
    scene: JanssenScene,
    points: Sequence[CurvePoint],
    fits: Mapping[str, JanssenFit],
    measured: Mapping[str, Quantity],
) -> Iterator[tuple[str, Quantity]]:
    converged = all(point.apparent_mass.converged for point in points)
    if "two_parameter" in fits:
        two = fits["two_parameter"]
        yield "hydrostatic_cap", _parameter(two.hydrostatic_cap, two.cap_error, converged)
    if "one_parameter" not in fits:
        return
    one = fits["one_parameter"]
    saturation = _parameter(one.saturation_mass, one.saturation_error, converged)
    scatter = sqrt(2.0 / one.degrees_of_freedom)
    yield "saturation_mass", saturation
    yield "chi_square", Quantity(one.reduced, scatter, "1", None, None, converged)
    if "solid_fraction" not in measured:
        return
    fitted = _janssen_ratio(scene, saturation, measured["solid_fraction"])
    yield "janssen_ratio", fitted
    share = measured.get("mobilised_friction")
    if share is not None and share.mean > 0.0:
        yield "janssen_ratio_mobilised", _plain(ratio(fitted, 1.0, [share], "1"))


def _parameter(value: float, error: float, converged: bool) -> Quantity:
    """A parameter, kg."""
    return Quantity(value, error, "kg", None, None, converged)


def _janssen_ratio(scene: JanssenScene, saturation: Quantity, fraction: Quantity) -> Quantity:
    """K = rho_b pi D^3/(16 mu_w M_sat)."""
    solid = scene.grains.density * pi * scene.tube.diameter**3 / (16.0 * scene.tube.friction)
    return _plain(ratio(fraction, solid, [saturation], "1"), saturation.converged)


def _plain(quantity: Quantity, converged: bool | None = None) -> Quantity:
    """A quantity that is not the average of one series."""
    enough = quantity.converged if converged is None else converged
    return replace(quantity, correlation_time=None, n_independent=None, converged=enough)


def _warnings(
    scene: JanssenScene,
    points: Sequence[CurvePoint],
    fits: Mapping[str, JanssenFit],
    column: Column | None,
    quantities: Mapping[str, Quantity],
) -> Iterator[str]:
    yield from _series_warnings(points)
    yield from _missed(scene, points)
    if scene.drive.motion == "none":
        yield (
            "Nothing moves: the wall's friction is what the filling left, not its limit, and so "
            "is janssen_ratio."
        )
    if len(points) >= FEWEST_FILLS and scene.tube.friction:
        yield from _fit_warnings(points, fits, quantities)
    yield from _column_warnings(column)
    yield from _wall_warnings(quantities)


def _series_warnings(points: Sequence[CurvePoint]) -> Iterator[str]:
    unsure = [k for k, point in enumerate(points) if not point.apparent_mass.converged]
    if unsure:
        yield (
            f"NOT CONVERGED: {_named(unsure, points)} averaged over fewer than "
            f"{MINIMUM_CORRELATION_TIMES} correlation times of the piston's force, so the errors "
            "are guesses: run longer."
        )
    drifting = [k for k, point in enumerate(points) if abs(point.drift) > LARGEST_DRIFT]
    if drifting:
        most = max((points[k].drift for k in drifting), key=abs)
        yield (
            f"NOT STEADY: the piston's force still drifts within {_named(drifting, points)}, by "
            f"up to {most:.1f} standard errors: raise drive.mobilise, or drive.distance."
        )
    off = [k for k, point in enumerate(points) if _imbalance(point) > _tolerated(point)]
    if off:
        worst = max((points[k] for k in off), key=_imbalance).weight_balance
        yield (
            f"Out of balance: in {_named(off, points)} piston and tube do not carry the weight "
            f"but, at worst, {_shown(worst)} of it: the grains are not in steady motion."
        )


def _missed(scene: JanssenScene, points: Sequence[CurvePoint]) -> Iterator[str]:
    """What there is to say of fills that do not reach the targets of a stop."""
    drive, targets = scene.drive, scene.targets
    way = inf if drive.distance is None else drive.distance / scene.grains.diameter
    loads = [{"apparent_mass": point.apparent_mass} for point in points]
    short = [k for k, found in enumerate(loads) if not reached(targets, found)]
    if targets and way < LEAST_WAY:
        yield (
            f"[stop] had no effect: a load is not known before its packing is forgotten, over "
            f"{LEAST_WAY:g} d of the wall's way, and drive.distance is {way:.2g} d; raise it."
        )
    elif short:
        worst = max(points[k].apparent_mass.standard_error for k in short)
        longer = "distance" if drive.duration is None else "duration"
        yield (
            f"Not known as well as [stop] asks: the apparent_mass of {_named(short, points)}; its "
            f"standard error is up to {worst:.3g} kg; raise drive.{longer}."
        )


def _shown(quantity: Quantity) -> str:
    return " +- ".join(rounded(quantity.mean, quantity.standard_error))


def _tolerated(point: CurvePoint) -> float:
    """Departure from the weight that may be chance, or is small."""
    return max(OUT_OF_BALANCE, LARGEST_DRIFT * point.weight_balance.standard_error)


def _imbalance(point: CurvePoint) -> float:
    return abs(point.weight_balance.mean - 1.0)


def _named(fills: Sequence[int], points: Sequence[CurvePoint]) -> str:
    """Fills by their numbers from 1 on."""
    numbers = ", ".join(str(k + 1) for k in fills)
    return f"fill{'s' if len(fills) > 1 else ''} {numbers} of {len(points)}"


def _fit_warnings(
    points: Sequence[CurvePoint],
    fits: Mapping[str, JanssenFit],
    quantities: Mapping[str, Quantity],
) -> Iterator[str]:
    if "one_parameter" not in fits:
        yield (
            "No saturation mass: the load on the piston does not bend with the fill as Janssen's "
            "form asks for this motion, or hardly; fill higher, or run longer."
        )
        return
    if "two_parameter" not in fits:
        yield "No hydrostatic cap: the two-parameter form does not fit the load on the piston."
    if "janssen_ratio" not in quantities:
        yield "No janssen_ratio: without profiles of the last fill its density is not known."
    one = fits["one_parameter"]
    if one.p_value < DOUBTED:
        yield (
            "Janssen's one-parameter form does not hold within the errors: chi-square over the "
            f"{one.degrees_of_freedom} degrees of freedom is {one.reduced:.3g} (p = "
            f"{one.p_value:.2g}), so a scatter of {100.0 * one.scatter:.2g} % from fill to fill "
            "was added to them, which is in the errors of saturation_mass and janssen_ratio."
        )
    low, high = (points[k].mass / one.saturation_mass for k in (0, -1))
    if high < 1.0 or low > 1.0:
        yield (
            f"The fills, from {low:.2g} to {high:.2g} saturation masses, do not bracket one: the "
            "fit is ill-conditioned; change fill.mass, or fill.levels."
        )


def _column_warnings(column: Column | None) -> Iterator[str]:
    if column is None:
        yield "No profile of the last fill was recorded: no solid fraction and no direct ratio."
    elif not column.has_bulk:
        yield (
            f"The column is too low for a bulk {ENDS:g} d clear of both its ends: solid_fraction "
            "and janssen_ratio_direct are those of all of it but its top; fill higher."
        )


def _wall_warnings(quantities: Mapping[str, Quantity]) -> Iterator[str]:
    share = quantities.get("mobilised_friction")
    if share is not None and share.mean < MOBILISED and "janssen_ratio" in quantities:
        yield (
            f"The wall bears only {_shown(share)} of the friction it could: the fitted "
            "janssen_ratio is K times this share; see janssen_ratio_mobilised."
        )
    fitted = quantities.get("janssen_ratio_mobilised")
    direct = quantities.get("janssen_ratio_direct")
    if fitted is None or direct is None:
        return
    apart, error = fitted.mean - direct.mean, hypot(fitted.standard_error, direct.standard_error)
    if abs(apart) > APART * error:
        yield (
            "Janssen's assumption of one ratio everywhere, or the mean of the stress over a slice "
            f"for that at the wall, is off: janssen_ratio_mobilised is {fitted.mean:.3g}, "
            f"janssen_ratio_direct {direct.mean:.3g}, and they are apart by "
            f"{' +- '.join(rounded(apart, error))}."
        )
