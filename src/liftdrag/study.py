"""A study: many cases run one after another, what they claim together, and pictures of both.

A study file (TOML) has `title`, `[set]` with keys of the case files for all runs, `[runs.NAME]`
with a `case` and its own `set`, `[[claims]]` and `[[pictures]]`.
"""

from __future__ import annotations

import errno
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from importlib import resources
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import AfterValidator, Field, ValidationError, model_validator

from liftdrag.analysis.claims import (
    Finding,
    difference,
    difference_of_means,
    within,
    within_of_means,
)
from liftdrag.analysis.quantity import Quantity
from liftdrag.case import Case, load, parse, read_text, with_settings
from liftdrag.engines import mpi
from liftdrag.engines.base import Progress, silent
from liftdrag.ensemble import PACKINGS, each_of
from liftdrag.errors import CaseError, InputError, RunFailed, escaped, shown
from liftdrag.files import is_file
from liftdrag.folder import RECORD, RESULT, read_json
from liftdrag.pictures.study import draw_against, draw_bars
from liftdrag.result import Result
from liftdrag.runner import analyze, run
from liftdrag.scene.model import Part

ENDING = ".study"

KNOWN = {
    "drag2d": ("drag", "lift", "drag_fluctuation", "rest_pressure", "irregularity"),
    "janssen": (
        "apparent_mass",
        "weight_balance",
        "solid_fraction",
        "saturation_mass",
        "hydrostatic_cap",
        "chi_square",
        "janssen_ratio",
        "janssen_ratio_mobilised",
        "janssen_ratio_direct",
        "mobilised_friction",
        "wall_mobilisation",
        "wall_sliding",
        "wall_rolling",
    ),
    "shear": (
        "shear_stress",
        "pressure",
        "bulk_friction",
        "kinetic_share",
        "normal_difference",
        "fluctuation_energy",
        "rotational_energy",
        "order_parameter",
        "stack_size",
        "stacking_fraction",
    ),
    "tank": ("drag", "lift", "drag_coefficient", "lift_coefficient", "solid_fraction"),
}
"""What a study may claim or draw of each scene, whatever the engine."""


def _known(name: str) -> str:
    if not any(name in names for names in KNOWN.values()):
        raise ValueError(f"no scene has a quantity {shown(name)}")
    return name


Name = Annotated[str, AfterValidator(_known)]


class Run(Part):
    """One case, with keys of its own."""

    case: str
    set: dict[str, Any] = Field(default_factory=dict)


class Claim(Part):
    """That a quantity of `larger` exceeds that of `smaller`, or differs by at most `within` of it.

    Of ensembles it is a quantity that each packing has.
    """

    says: str
    larger: str
    smaller: str
    within: Annotated[float, Field(gt=0.0)] | None = None
    quantity: Name = "drag"


class Picture(Part):
    """Bars of a quantity, a group for each list of runs, written to `file`.

    With `against`, a key of the cases, points at its values instead, a line for each group.
    """

    file: Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]+\.png$")]
    title: str
    groups: Annotated[list[Annotated[list[str], Field(min_length=1)]], Field(min_length=1)]
    against: str | None = None
    quantity: Name = "drag"


class Plan(Part):
    """A study file as read; `engine` is that of all its runs, the usual one when absent."""

    title: str
    engine: str | None = None
    set: dict[str, Any] = Field(default_factory=dict)
    runs: Annotated[
        dict[Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]+$")], Run], Field(min_length=1)
    ]
    claims: list[Claim] = Field(default_factory=list)
    pictures: list[Picture] = Field(default_factory=list)

    @model_validator(mode="after")
    def _check(self) -> Plan:
        claimed = [name for claim in self.claims for name in (claim.larger, claim.smaller)]
        drawn = [name for picture in self.pictures for group in picture.groups for name in group]
        for name in (*claimed, *drawn):
            if name not in self.runs:
                raise CaseError(
                    "runs", name, "no run has this name", f"choose one of {', '.join(self.runs)}"
                )
        return self


@dataclass(frozen=True)
class Studied:
    """The results of a study's runs by name, and what they say of its claims, in its folder."""

    plan: Plan
    folder: Path
    results: Mapping[str, Result]
    findings: list[tuple[Claim, Finding]]


def packaged() -> Iterator[str]:
    """The names of the packaged studies: paths below the cases, without their ending."""
    for folder in resources.files("liftdrag.cases").iterdir():
        if folder.is_dir():
            for file in folder.iterdir():
                if file.name.endswith(ENDING):
                    yield f"{folder.name}/{file.name.removesuffix(ENDING)}"


def read(study: str) -> Plan:
    """The study of a path, or a packaged one by its name. Raises InputError."""
    try:
        return Plan.model_validate(parse(_text(study), f"study {escaped(study)}"))
    except ValidationError as error:
        detail = error.errors()[0]
        inner = detail.get("ctx", {}).get("error")
        if isinstance(inner, CaseError):
            raise inner from None
        key = ".".join(map(str, detail["loc"]))
        where = f"{shown(study)} is wrong at {escaped(key[:60])}"
        raise InputError(f"The study {where}: {detail['msg']}.") from None


def _text(study: str) -> str:
    if study in packaged():
        return (resources.files("liftdrag.cases") / f"{study}{ENDING}").read_text("utf-8")
    if not is_file(Path(study)):
        names = ", ".join(sorted(packaged()))
        raise InputError(f"There is no study {shown(study)}; give a file, or one of {names}.")
    return read_text(Path(study), "study")


def sweep(
    study: str,
    out: str | Path | None = None,
    settings: list[str] | None = None,
    jobs: int | None = None,
    progress: Progress = silent,
) -> Studied:
    """Run each case of a study that has not finished before, and weigh its claims.

    `settings` (KEY=VALUE) hold for all runs; `jobs` packings run at a time. Raises InputError
    for a bad study before anything runs, RunFailed when a run does not finish.
    """
    if mpi.world(program="liftdrag").size > 1:
        raise InputError("A study runs its cases one by one; start it without mpiexec.")
    plan = read(study)
    cases = {name: _case(plan, one, settings or []) for name, one in plan.runs.items()}
    _check_quantities(plan, cases)
    folder = Path(out) if out is not None else _default_folder(study)
    results = dict[str, Result]()
    for done, (name, case) in enumerate(cases.items()):
        progress("cases", done, len(cases))
        results[name] = _finished(folder / name, case) or run(
            case, folder / name, plan.engine, jobs, progress=silent
        )
    progress("cases", len(cases), len(cases))
    findings = [(claim, _found(claim, results)) for claim in plan.claims]
    try:
        _write(folder, results, findings)
        _draw(folder, plan, cases, results)
    except OSError as error:
        status = "disk_full" if error.errno == errno.ENOSPC else "engine_error"
        raise RunFailed(status, f"Nothing was written to {folder}: {error.strerror}.") from None
    return Studied(plan, folder, results, findings)


def _default_folder(study: str) -> Path:
    """Below runs/: the name of a packaged study, or of a file without its folders."""
    return Path("runs") / (study if study in packaged() else Path(study).stem)


def _case(plan: Plan, one: Run, settings: list[str]) -> Case:
    case = load(one.case)
    for key, value in (plan.set | one.set).items():
        case = case.set(key, value)
    case = with_settings(case, settings)
    case.scene  # noqa: B018 - a bad case is refused before anything else
    return case


def _check_quantities(plan: Plan, cases: Mapping[str, Case]) -> None:
    """Raise InputError for what a run will not have."""
    asked = [(claim.quantity, [claim.larger, claim.smaller]) for claim in plan.claims]
    for picture in plan.pictures:
        drawn = [name for group in picture.groups for name in group]
        asked.append((picture.quantity, drawn))
        for name in drawn if picture.against else ():
            _value(cases[name], picture.against or "")
    for quantity, names in asked:
        for name in names:
            scene = cases[name].scene.scene
            if quantity not in KNOWN[scene]:
                raise InputError(
                    f"The run {name} of the study is a {scene}, which has no {quantity}; choose "
                    f"one of {', '.join(KNOWN[scene])}."
                )


def _finished(folder: Path, case: Case) -> Result | None:
    """The result of the same case from before, None when it has not been run.

    Raises InputError when the folder holds another one, or one that did not finish.
    """
    if not folder.exists() or (folder.is_dir() and not any(folder.iterdir())):
        return None
    if not _is_finished(folder, case):
        raise InputError(
            f"{folder} holds another run, or one that did not finish; choose another --out, or "
            "remove it."
        )
    return analyze(folder)


def _is_finished(folder: Path, case: Case) -> bool:
    try:
        record, result = read_json(folder / RECORD), read_json(folder / RESULT)
    except InputError:
        return False
    return record.get("tables") == dict(case.tables) and result.get("status") == "finished"


def _found(claim: Claim, results: Mapping[str, Result]) -> Finding:
    larger, smaller = results[claim.larger], results[claim.smaller]
    one, other = (_quantity(result, claim.quantity) for result in (larger, smaller))
    if not _is_ensemble(larger) or not _is_ensemble(smaller):
        if claim.within is not None:
            return within_of_means(one, other, claim.within)
        return difference_of_means(one, other)
    many, others = (_each(result, claim.quantity) for result in (larger, smaller))
    if claim.within is not None:
        return within(many, others, claim.within)
    return difference(many, others, one.unit)


def _quantity(result: Result, name: str) -> Quantity:
    if name not in result.quantities:
        raise InputError(
            f"The run in {result.folder} has no {shown(name)}; it has "
            f"{', '.join(result.quantities)}."
        )
    return result.quantities[name]


def _is_ensemble(result: Result) -> bool:
    return (result.folder / PACKINGS).exists()


def _each(result: Result, quantity: str) -> np.ndarray:
    """The quantity of each packing (n,), from the table that the run wrote."""
    return each_of(result.folder, quantity, result.quantities[quantity].unit)


def _draw(
    folder: Path, plan: Plan, cases: Mapping[str, Case], results: Mapping[str, Result]
) -> None:
    for picture in plan.pictures:
        drawn = [name for group in picture.groups for name in group]
        found = {name: _quantity(results[name], picture.quantity) for name in drawn}
        path = folder / picture.file
        if picture.against is None:
            draw_bars(picture.title, picture.groups, picture.quantity, found, path)
        else:
            places = {name: _value(cases[name], picture.against) for name in drawn}
            axis = picture.against
            draw_against(picture.title, picture.groups, axis, places, picture.quantity, found, path)


def _value(case: Case, key: str) -> float:
    """What the case has at a dotted key, in SI units. Raises InputError when it is no number."""
    found: Any = case.scene
    for name in key.split("."):
        found = getattr(found, name, None)
    if isinstance(found, bool) or not isinstance(found, int | float):
        raise InputError(f"The case {case.name} has no number at {shown(key)} to draw against.")
    return float(found)


def _write(
    folder: Path, results: Mapping[str, Result], findings: list[tuple[Claim, Finding]]
) -> None:
    """`runs.csv`, a row for each run and quantity, and `claims.csv`."""
    import pandas as pd

    rows = [
        {"run": name, "quantity": quantity} | asdict(value)
        for name, result in results.items()
        for quantity, value in result.quantities.items()
    ]
    pd.DataFrame(rows).to_csv(folder / "runs.csv", index=False)
    claims = [
        {"claim": claim.says, "quantity": claim.quantity} | vars(finding)
        for claim, finding in findings
    ]
    pd.DataFrame(claims).to_csv(folder / "claims.csv", index=False)
