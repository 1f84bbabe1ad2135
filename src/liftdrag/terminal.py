"""What was found, as tables for the terminal."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from liftdrag.analysis.meanings import MEANINGS
from liftdrag.analysis.quantity import Quantity, rounded
from liftdrag.study.state import STATUSES

if TYPE_CHECKING:
    from rich.table import Table

    from liftdrag.analysis.precision import Deviation
    from liftdrag.bench import Benched
    from liftdrag.doctor import Patient
    from liftdrag.engines.probes import Probe
    from liftdrag.result import Result
    from liftdrag.stress import Stressed
    from liftdrag.study import Studied
    from liftdrag.study.carried import Answer
    from liftdrag.study.findings import Grown
    from liftdrag.verify import Verified

MOST_TOLD = 20
"""Runs whose reasons are shown."""

NARROW = 110
"""Width of a terminal in characters below which the meanings are left out."""


def table(quantities: Mapping[str, Quantity], width: int) -> Table:
    """The quantities as a table for a terminal `width` characters wide."""
    from rich.table import Table

    wide = width >= NARROW
    result = Table()
    for heading in ("quantity", "mean", "standard error", "unit", "independent samples"):
        result.add_column(heading, overflow="fold")
    if wide:
        result.add_column("meaning")
    for name, quantity in quantities.items():
        result.add_row(name, *_cells(quantity), *([MEANINGS.get(name, "")] if wide else []))
    return result


def _cells(quantity: Quantity) -> Iterator[str]:
    from rich.markup import escape

    mean, error = rounded(quantity.mean, quantity.standard_error)
    share = abs(quantity.standard_error / quantity.mean) if quantity.mean else float("inf")
    yield mean
    yield f"{error} ({100 * share:.2g} %)" if share < 10 else error
    yield "" if quantity.unit == "1" else escape(quantity.unit)
    count = quantity.n_independent
    mark = "" if quantity.converged else " (not converged)"
    yield ("" if count is None else f"{count:.0f}") + mark


def budget_lines(result: Result) -> Iterator[str]:
    """What is known of the errors beside the statistical ones, a line for a quantity."""
    budgets = result.record["error_budget"]
    for name, one in budgets.items():
        if one["biases"]:
            yield f"Error budget of {name}: {', '.join(_shares(one))}."
    unknown: list[str] = next((one["not_measured"] for one in budgets.values()), [])
    if unknown:
        yield (
            f"Not in the standard errors, and not measured: the biases of {', '.join(unknown)}; "
            "see liftdrag bench."
        )


def _shares(budget: Mapping[str, Any]) -> Iterator[str]:
    yield f"statistical {100 * budget['statistical']:.2g} %"
    for axis, bias in budget["biases"].items():
        yield f"{axis} {100 * bias['relative']:+.1f} ± {100 * bias['standard_error']:.1f} %"


def stress_table(found: Stressed) -> Table:
    """The values of each axis, and what became of them."""
    from rich.table import Table

    result = Table(title=f"{found.case.name} on {found.stand.engine}")
    for heading in (
        "axis",
        "value",
        "broken by",
        "overlap / bound",
        "agitation",
        *_deviating(found),
    ):
        result.add_column(heading)
    for one, row in zip(found.outcomes, found.rows(), strict=True):
        deepest = one.tried.invariants.get("largest_overlap")
        shifts = [one.deviations.get(name) for name in found.stand.judged]
        result.add_row(
            row["axis"],
            row["value"],
            row["causes"] or "-",
            "" if deepest is None else f"{deepest['value'] / deepest['bound']:.2f}",
            "" if one.heating is None else f"x{one.heating:.2g}",
            *("" if d is None else _shift(d) for d in shifts),
        )
    return result


def _deviating(found: Stressed) -> list[str]:
    return [f"{name} off by" for name in found.stand.judged]


def _shift(found: Deviation) -> str:
    return f"{100.0 * found.relative:+.1f} ± {100.0 * found.standard_error:.1f} %"


def state_table(found: Studied) -> Table:
    """How many runs of a study have come how far, and those that nobody is at by name."""
    from rich.markup import escape
    from rich.table import Table

    runs = {
        task.digest: (task, state) for one in found.results.values() for task, state in one.runs
    }
    result = Table(title="runs")
    for heading in ("status", "runs", "of these"):
        result.add_column(heading, overflow="fold")
    for status in STATUSES:
        group = [(task, state) for task, state in runs.values() if state.status == status]
        told = [f"{task.name}: {state.reason}" for task, state in group if state.reason]
        result.add_row(status, str(len(group)), escape("\n".join(told[:MOST_TOLD])))
    return result


def run_table(found: Studied) -> Table:
    """The runs of a study, and of each the quantities that tell most."""
    from rich.markup import escape
    from rich.table import Table

    result = Table(title=escape(found.plan.title))
    result.add_column("point")
    known = {name for one in found.results.values() for name in one.quantities}
    studied = [name for name in _STUDIED if name in known]
    for name in studied:
        result.add_column(name, overflow="fold")
    finished = all(one.whole for one in found.results.values())
    if not finished:
        result.add_column("status")
    for name, one in found.results.items():
        cells = (one.quantities.get(quantity) for quantity in studied)
        shown = ("-" if cell is None else _with_error(cell) for cell in cells)
        result.add_row(name, *shown, *([] if finished else [_so_far(one)]))
    return result


def _so_far(one: Answer) -> str:
    """The status of a point, and how many of its replicas its numbers are of."""
    done, many = one.replicas
    return f"{one.status}, {done} of {many} replicas" if done and not one.whole else one.status


_STUDIED = (
    "drag",
    "lift",
    "drag_coefficient",
    "lift_coefficient",
    "drag_deviation",
    "drag_fluctuation",
    "rest_pressure",
    "irregularity",
    "shear_stress",
    "pressure",
    "order_parameter",
    "stacking_fraction",
    "apparent_mass",
    "saturation_mass",
    "janssen_ratio",
    "janssen_ratio_mobilised",
    "mobilised_friction",
    "wall_sliding",
    "wall_rolling",
)


def _with_error(quantity: Quantity) -> str:
    unit = "" if quantity.unit == "1" else f" {quantity.unit}"
    return " ± ".join(rounded(quantity.mean, quantity.standard_error)) + unit


def growth_lines(found: Studied) -> Iterator[str]:
    """Where each growing quantity of a study saturates, a line for each."""
    for grown in found.growths:
        growth, at = grown.growth, grown.saturation
        over = f" / {growth.over}" if growth.over else ""
        if not at.saturates:
            none = f"{growth.quantity} has no plateau over these points"
            yield f"{growth.says}: {none}{_left(grown)}."
            continue
        plateau = " ± ".join(rounded(at.plateau, at.plateau_error))
        depth = " ± ".join(rounded(at.depth, at.depth_error))
        yield (
            f"{growth.says}: {growth.quantity} saturates at {plateau}, and has 90 % of it at "
            f"{growth.against}{over} = {depth} (chi-square {at.chi_square:.1f} of {at.freedom})"
            f"{_left(grown)}."
        )


def _left(grown: Grown) -> str:
    """What a fit still lacks, if anything."""
    if grown.finished == grown.points:
        return ""
    return f", so far: {grown.finished} of {grown.points} points have all their replicas"


def claim_table(found: Studied) -> Table:
    """What the runs say of each claim."""
    from rich.markup import escape
    from rich.table import Table

    result = Table(title="claims")
    for heading in ("claim", "difference", "p-value", "packings", "verdict"):
        result.add_column(heading, overflow="fold")
    for claim, finding in found.findings:
        size = " ± ".join(rounded(finding.size, finding.standard_error))
        one, other = finding.packings
        unit = "" if finding.unit == "1" else f" {finding.unit}"
        p = f"{finding.p_value:.2g}"
        result.add_row(escape(claim.says), size + unit, p, f"{one} + {other}", finding.verdict)
    return result


def engine_table(patients: list[Patient]) -> Table:
    """The engines: version, place, MPI and its launcher."""
    from rich.markup import escape
    from rich.table import Table

    result = Table()
    for heading in ("engine", "version", "program", "MPI", "launcher", "packages", "probes"):
        result.add_column(heading, overflow="fold")
    for patient in patients:
        if patient.about is None:
            result.add_row(patient.name, "not installed", escape(patient.missing))
            continue
        passed = sum(found.passed for found in patient.probes)
        about = patient.about
        result.add_row(
            about.name,
            escape(about.version),
            escape(str(about.path)),
            about.mpi,
            escape(patient.launcher),
            _packages(patient),
            f"{passed} of {len(patient.probes)} passed",
        )
    return result


def _packages(patient: Patient) -> str:
    """How many, and whether those of grains are among them."""
    if not patient.packages:
        return "not listed"
    grains = [name for name in ("GRANULAR", "RIGID", "ASPHERE") if name in patient.packages]
    return f"{len(patient.packages)}, with {', '.join(grains) or 'none for grains'}"


def probe_table(patients: list[Patient]) -> Table:
    """What each probe found of each engine."""
    from rich.table import Table

    installed = [patient for patient in patients if patient.about is not None]
    result = Table()
    for heading in ("probe", "asked", "error allowed", *(patient.name for patient in installed)):
        result.add_column(heading, overflow="fold")
    for found in zip(*(patient.probes for patient in installed), strict=True):
        first = next((one for one in found if one.expected is not None), found[0])
        asked = "" if first.expected is None else f"{first.expected:.4g} {first.unit}"
        bound = f"{100 * first.bound:.2g} %" if first.expected else f"{first.bound:.2g}"
        result.add_row(first.name, asked, bound, *map(_verdict, found))
    return result


def _verdict(found: Probe) -> str:
    from rich.markup import escape

    value = escape(found.failure) if found.measured is None else f"{found.measured:.6g}"
    return value if found.passed else f"[bold red]FAILED: {value}[/]"


def check_table(found: Verified) -> Table:
    """Each test of `verify`: measured, expected, error."""
    from rich.table import Table

    result = Table(title=f"{found.engine}: impacts of two bodies")
    for heading in ("test", "quantity", "measured", "expected", "source", "error", "allowed"):
        result.add_column(heading, overflow="fold")
    for check in found.checks:
        allowed = "reported" if check.bound is None else f"{100 * check.bound:.2g} %"
        unit = "" if check.unit == "1" else f" {check.unit}"
        error = f"{100 * check.error:.2g} %"
        result.add_row(
            check.test,
            check.quantity,
            f"{check.measured:.6g}{unit}",
            f"{check.expected:.6g}{unit}",
            check.source,
            error if check.passed else f"[bold red]FAILED: {error}[/]",
            allowed,
        )
    return result


def convergence_table(found: Verified) -> Table:
    """The errors of an elastic impact over the time step."""
    from rich.table import Table

    result = Table(title="relative error over time step / Rayleigh time")
    result.add_column("quantity")
    for fraction in found.convergence[0].fractions:
        result.add_column(f"{fraction:g}")
    result.add_column("order")
    for row in found.convergence:
        result.add_row(row.quantity, *(f"{e:.2g}" for e in row.errors), f"{row.order:.2f}")
    return result


def bench_table(found: Benched) -> Table:
    """The points of a bench: what each took and answered, and how far that is from the case's."""
    from rich.markup import escape
    from rich.table import Table

    result = Table(
        title=f"{escape(found.case.name)} on {found.stand.engine}: run time against error"
    )
    for heading in ("axis", "value", "runs", "CPU (s)", "grain-steps/s"):
        result.add_column(heading, overflow="fold")
    for name in found.tolerances:
        result.add_column(name, overflow="fold")
        result.add_column("deviation (%)", overflow="fold")
    rows: dict[tuple[str, str], list[dict[str, Any]]] = {}
    for row in found.rows():
        rows.setdefault((row["axis"], row["value"]), []).append(row)
    for mine in rows.values():
        result.add_row(*_bench_cells(mine))
    return result


def _bench_cells(rows: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    """The cells of a point, from its rows, one for each quantity."""
    first = rows[0]
    yield from (first["axis"], first["value"], str(first["runs"]))
    if "quantity" not in first:
        yield from ("", f"[bold red]{first['status']}[/]")
        return
    yield from (f"{first['cpu_s']:.3g}", f"{first['grain_steps_per_s']:.3g}")
    for row in rows:
        unit = "" if row["unit"] == "1" else f" {row['unit']}"
        yield " ± ".join(rounded(row["mean"], row["standard_error"])) + unit
        size, error = (100.0 * row[name] for name in ("deviation", "deviation_error"))
        yield " ± ".join(rounded(size, error)) if error else ""
