"""The study file (TOML): runs, the values that they vary over, claims, pictures and the cluster.

`title`, `[set]` with keys of the case files for all runs, `[grid]` with lists of values of which
each combination is run, `[together]` with lists of one length that are gone through side by side,
`replicas` with so many seeds of each, `[runs.NAME]` with a `case` and its own `set`, `grid`,
`together` and `replicas`, `[scales.NAME]` of which one holds at a time, the first unless asked,
`[scales.NAME.runs.NAME]` for one run of it, `[[claims]]`, `[[saturations]]`, `[[pictures]]` and
`[slurm]`. A run's own keys go before those of all, those of the scale before both, and those of
its run before all.
"""

from __future__ import annotations

from collections.abc import Iterator
from difflib import get_close_matches
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, ValidationError, model_validator

from liftdrag.case import parse, read_text
from liftdrag.errors import CaseError, InputError, escaped, shown
from liftdrag.files import is_file
from liftdrag.liu import CURVES
from liftdrag.refusals import refusal, written_as
from liftdrag.scene.model import Part

ENDING = ".study"

SEE = "see 'Whole studies' in the README"

MAX_VALUE = 60
"""Characters of a text that is varied, which becomes part of a name."""

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
    "tank": (
        "drag",
        "lift",
        "drag_coefficient",
        "lift_coefficient",
        "drag_coefficient_overburden",
        "solid_fraction",
        "depth",
        "effective_depth",
        "overburden",
        "bed_speed_ratio",
        "inertial_number",
    ),
}
"""What a study may claim or draw of each scene, whatever the engine."""

OF_AXES = ("order_parameter", "rotational_energy", "stack_size", "stacking_fraction")
"""What spheres alone do not have, without friction."""


def is_quantity(name: str) -> bool:
    """Whether some scene answers with it."""
    return any(name in names for names in KNOWN.values())


def _known(name: str) -> str:
    if is_quantity(name):
        return name
    known = dict.fromkeys(one for names in KNOWN.values() for one in names)
    close = get_close_matches(name, known, n=1)
    raise ValueError(f"no scene has such a quantity; choose one of {', '.join(close or known)}")


def _plain(value: Any) -> Any:
    if isinstance(value, bool | int | float):
        return value
    if isinstance(value, str) and len(value) <= MAX_VALUE:
        return value
    raise ValueError(f"a value is a number, true, false or text of up to {MAX_VALUE} characters")


QuantityName = Annotated[str, AfterValidator(_known)]
Label = Annotated[str, written_as(r"[A-Za-z0-9_-]{1,60}", "in up to 60 letters, digits, - and _")]
Value = Annotated[Any, AfterValidator(_plain)]
Values = Annotated[list[Value], Field(min_length=1)]
Count = Annotated[int, Field(ge=1)]
Groups = Annotated[list[Annotated[list[str], Field(min_length=1)]], Field(min_length=1)]
Grid = dict[str, Values]
"""By key of a case, the values that it takes."""


class Varied(Part):
    """Keys of the cases, the values that they take, and so many seeds of each."""

    set: dict[str, Any] = Field(default_factory=dict)
    grid: Grid = Field(default_factory=dict)
    together: Grid = Field(default_factory=dict)
    replicas: Count | None = None

    @model_validator(mode="after")
    def _check_lengths(self) -> Varied:
        lengths = {len(values) for values in self.together.values()}
        if len(lengths) > 1:
            counts = ", ".join(f"{key} {len(values)}" for key, values in self.together.items())
            raise CaseError(
                "together", counts, "the lists differ in length", "make them equally long"
            )
        return self

    def under(self, other: Varied) -> Varied:
        """Both, where the other's own keys go before these."""
        return Varied(
            set=self.set | other.set,
            grid=self.grid | other.grid,
            together=other.together or self.together,
            replicas=other.replicas or self.replicas,
        )


class Run(Varied):
    """One case, with keys and values of its own."""

    case: str


class Scale(Varied):
    """What a study is on a machine of some size, and some of its runs there."""

    runs: dict[Label, Varied] = Field(default_factory=dict)


class Claim(Part):
    """That a quantity of `larger` exceeds that of `smaller`, or differs by at most `within` of it.

    Both name a point. Of ensembles it is a quantity that each packing has.
    """

    says: str
    larger: str
    smaller: str
    within: Annotated[float, Field(gt=0.0)] | None = None
    quantity: QuantityName = "drag"


class Growth(Part):
    """How a quantity of a run grows over another, or a key, to a plateau: where it has 90 % of it.

    In the unit of `against`, or in that of the key `over` of the cases.
    """

    says: str
    run: str
    quantity: QuantityName = "lift_coefficient"
    against: str = "effective_depth"
    over: str | None = "intruder.diameter"


class Reference(Part):
    """A level to compare a picture with, in the unit of its quantity."""

    value: float
    label: str


class Picture(Part):
    """Bars of a quantity, a group for each list of runs or points, written to `file`.

    With `against`, a key of the cases or another quantity, points at its values instead, over those
    of the key `over` if there is one, and a line for each run, or for each group that is named.
    Against the order parameter of shear flows, `curve` adds the paper's own at each solid fraction.
    """

    file: Annotated[str, written_as(r"[A-Za-z0-9_-]+\.png", 'as "lift.png"')]
    title: str
    groups: Groups | None = None
    against: str | None = None
    over: str | None = None
    quantity: QuantityName = "drag"
    logarithmic: list[Literal["x", "y"]] = Field(default_factory=list)
    reference: list[Reference] = Field(default_factory=list)
    curve: Literal["liu2020"] | None = None

    @model_validator(mode="after")
    def _check_curve(self) -> Picture:
        if self.curve and (self.against != "order_parameter" or self.quantity not in CURVES):
            raise CaseError(
                "pictures.curve",
                self.curve,
                f"the paper has no curve of {self.quantity} against {self.against}",
                f'set against = "order_parameter" and quantity to one of {", ".join(CURVES)}',
            )
        return self


_Name = Annotated[str, written_as(r"[A-Za-z0-9_][A-Za-z0-9_.,+-]{0,63}", 'as "long" or "group_1"')]
_Time = Annotated[str, written_as(r"(\d{1,3}-)?\d{1,4}(:\d{2}){0,2}", 'as "24:00:00"')]
_Memory = Annotated[str, written_as(r"\d{1,9}[KMGT]?", 'as "2G" or "500M"')]
_Module = Annotated[str, written_as(r"[A-Za-z0-9_][A-Za-z0-9_.+/-]{0,127}", 'as "openmpi/4.1"')]


class Slurm(Part):
    """What each run asks of SLURM, in sbatch's words; `array_limit` runs go on at a time.

    A run has `ntasks` x `cpus_per_task` ranks, or packings at a time.
    """

    partition: _Name | None = None
    account: _Name | None = None
    qos: _Name | None = None
    time: _Time | None = None
    mem: _Memory | None = None
    ntasks: Count | None = None
    cpus_per_task: Count | None = None
    array_limit: Count | None = None
    requeue: bool = True
    modules: list[_Module] = Field(default_factory=list)

    @property
    def ranks(self) -> int:
        """Those of each run."""
        return (self.ntasks or 1) * (self.cpus_per_task or 1)


class Plan(Varied):
    """A study file as read; `engine` is that of all its runs, the usual one when absent."""

    title: str
    engine: str | None = None
    runs: Annotated[dict[Label, Run], Field(min_length=1)]
    scales: dict[Label, Scale] = Field(default_factory=dict)
    claims: list[Claim] = Field(default_factory=list)
    saturations: list[Growth] = Field(default_factory=list)
    pictures: list[Picture] = Field(default_factory=list)
    slurm: Slurm = Slurm()

    @model_validator(mode="after")
    def _check(self) -> Plan:
        for name, scale in self.scales.items():
            for run in scale.runs:
                if run not in self.runs:
                    raise CaseError(
                        f"scales.{name}.runs",
                        run,
                        "the study has no such run",
                        f"choose one of {', '.join(self.runs)}",
                    )
        for picture in self.pictures:
            if picture.against is None and (picture.over or "x" in picture.logarithmic):
                raise CaseError(
                    "pictures",
                    picture.file,
                    "bars have no axis to scale",
                    "name a key of the cases by against",
                )
        return self

    def varied(self, run: str, scale: Scale) -> Varied:
        """What a run is made of on this scale."""
        here = scale.runs.get(run, Varied())
        return self.under(self.runs[run]).under(scale).under(here)

    def scale(self, name: str | None) -> Scale:
        """The scale of this name, the first when none is asked for. Raises InputError."""
        if name is None:
            return next(iter(self.scales.values()), Scale())
        if name not in self.scales:
            known = f"choose one of {', '.join(self.scales)}" if self.scales else "it has none"
            raise InputError(f"The study has no scale {shown(name)}; {known}.")
        return self.scales[name]


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
        unknown_first = sorted(error.errors(), key=lambda one: one["type"] != "extra_forbidden")
        raise refusal(unknown_first[0], Plan, SEE) from None


def _text(study: str) -> str:
    if study in packaged():
        return (resources.files("liftdrag.cases") / f"{study}{ENDING}").read_text("utf-8")
    if not is_file(Path(study)):
        names = ", ".join(sorted(packaged()))
        raise InputError(f"There is no study {shown(study)}; give a file, or one of {names}.")
    return read_text(Path(study), "study")


def default_folder(study: str) -> Path:
    """Below runs/: the name of a packaged study, or of a file without its folders."""
    return Path("runs") / (study if study in packaged() else Path(study).stem)
