"""What the page shows of each folder: a run, replicas of one, or the runs of a study."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from liftdrag import replicas
from liftdrag.errors import InputError, escaped
from liftdrag.files import is_file, is_folder
from liftdrag.page import sheets
from liftdrag.page.chart import Chart, charts
from liftdrag.page.comparison import compared
from liftdrag.page.last_words import last_words
from liftdrag.page.pictures import Picture, pictures
from liftdrag.page.record import RunRecord, is_run, read_record
from liftdrag.page.sheets import Sheet
from liftdrag.page.study import is_study, runs_in, study_sheets, unfinished_in

LEADING = {
    "tank": ("drag", "lift", "drag_coefficient", "lift_coefficient"),
    "drag2d": ("drag", "lift", "irregularity"),
    "janssen": ("apparent_mass", "saturation_mass", "janssen_ratio"),
}
"""What a scene is run for; of another scene its first quantities."""

FIRST = 4

TABLES = {
    "packings.csv": "Each packing",
    "curve.csv": "The curve: apparent mass by fill",
    "profile.csv": "Profiles by height",
    "cylinder.csv": "Stress on the cylinder by angle",
}


@dataclass(frozen=True)
class Shown:
    """A section of the page, in the order in which it is read; what is empty is left out.

    `status` is a word, `reasons` why a run did not finish, `words` the last of its engine,
    `leading` its first answers by name. `open` are the tables that a reader sees at once, `folded`
    those to unfold.
    """

    anchor: str
    title: str
    folder: str
    about: str
    status: str
    leading: Mapping[str, str] = field(default_factory=dict)
    alarms: Sequence[str] = ()
    reasons: Sequence[str] = ()
    words: str = ""
    remarks: Sequence[str] = ()
    answers: Sequence[Sheet] = ()
    pictures: Sequence[Picture] = ()
    charts: Sequence[Chart] = ()
    open: Sequence[Sheet] = ()
    folded: Sequence[Sheet] = ()

    @property
    def finished(self) -> bool:
        """Whether it has answers."""
        return self.status == "finished"


def shown_all(folders: Sequence[Path]) -> list[Shown]:
    """A section for each folder. Raises InputError for one that holds no run."""
    return [shown(folder, f"run-{number}") for number, folder in enumerate(folders, start=1)]


def shown(folder: Path, anchor: str) -> Shown:
    """The section of a folder. Raises InputError where it holds no run."""
    name = escaped(str(folder))
    if not is_folder(folder):
        raise InputError(f"There is no folder {name}; give the folders of runs.")
    try:
        if replicas.is_replicas(folder):
            return _replicas(folder, anchor)
        if is_run(folder):
            return _run(folder, read_record(folder), anchor)
        if is_study(folder):
            return _study(folder, anchor)
    except OSError as error:
        raise InputError(f"The folder {name} cannot be read: {error.strerror}.") from None
    raise InputError(f"The folder {name} holds no run of liftdrag, nor those of a study.")


def _run(folder: Path, record: RunRecord, anchor: str) -> Shown:
    return Shown(
        anchor=anchor,
        title=record.case,
        folder=str(folder),
        about=_about(record),
        status=record.status,
        leading=_leading(record),
        alarms=record.alarms,
        reasons=record.reasons,
        words="" if record.finished else last_words(folder),
        remarks=[text for text in record.remarks if text not in record.alarms],
        answers=_filled(_answers(record)),
        pictures=pictures(folder),
        charts=charts(folder, record),
        open=_filled(
            [sheets.budget(record), sheets.invariants(record), sheets.case(record.tables)]
        ),
        folded=_filled(_folded(folder, record)),
    )


def _replicas(folder: Path, anchor: str) -> Shown:
    """The pooled answers, and the pictures, series and numerics of the first replica."""
    record, done = read_record(folder, replicas.CASE), runs_in(folder)
    whole, first = _run(folder, record, anchor), folder / next(iter(done), "")
    return replace(
        whole,
        about=f"{whole.about}; the pictures and the series are those of the first",
        reasons=[*whole.reasons, *_failures(done)],
        answers=[*whole.answers, *_filled([_runs("Each replica", done)])],
        pictures=pictures(first),
        charts=charts(first, record),
        folded=[*_filled([sheets.numerics(first)]), *whole.folded],
    )


def _failures(done: Mapping[str, RunRecord]) -> Iterator[str]:
    for name, record in done.items():
        yield from (f"{name}: {reason}" for reason in record.reasons)


def _study(folder: Path, anchor: str) -> Shown:
    done = runs_in(folder)
    cut = [name for name, record in done.items() if not record.finished]
    unfinished = unfinished_in(folder) or cut
    return Shown(
        anchor=anchor,
        title=folder.resolve().name,
        folder=str(folder),
        about=f"A study of {len(done)} runs",
        status=f"{len(unfinished)} unfinished" if unfinished else "finished",
        reasons=list(_failures(done)),
        answers=_filled([_runs("Runs", done), *study_sheets(folder)]),
        pictures=pictures(folder),
    )


def _runs(caption: str, done: Mapping[str, RunRecord]) -> Sheet:
    """A row for each run: its status and what it was run for."""
    leading = {name: _leading(record) for name, record in done.items()}
    names = list(dict.fromkeys(name for some in leading.values() for name in some))
    rows = [
        (
            run,
            record.status,
            "-" if record.seed is None else str(record.seed),
            *(leading[run].get(name, "-") for name in names),
        )
        for run, record in done.items()
    ]
    return Sheet(caption, ("run", "status", "seed", *names), rows)


def _about(record: RunRecord) -> str:
    """In a line: the scene, the engine, and how many."""
    engine = " ".join(str(record.engine.get(key, "")) for key in ("name", "version")).strip()
    many = ""
    if record.packings:
        many = f", {record.packings} packings"
    if record.replicas:
        many = f", {record.replicas} replicas"
    grains = f", {record.grains} grains" if record.grains else ""
    return f"Scene {record.scene}{f', engine {engine}' if engine else ''}{grains}{many}"


def _leading(record: RunRecord) -> dict[str, str]:
    found = record.quantities
    names = LEADING.get(record.scene, tuple(found)[:FIRST])
    return {sheets.words(name): sheets.with_error(found[name]) for name in names if name in found}


def _answers(record: RunRecord) -> Iterator[Sheet]:
    yield sheets.answers(record.quantities)
    yield sheets.comparison(compared(record.tables, record.quantities))


def _folded(folder: Path, record: RunRecord) -> Iterator[Sheet]:
    yield sheets.numerics(folder)
    for name, caption in TABLES.items():
        if is_file(folder / name):
            yield sheets.of_csv(folder / name, caption)
    yield sheets.probes(record)
    yield sheets.provenance(record, folder)


def _filled(found: Iterator[Sheet] | Sequence[Sheet]) -> list[Sheet]:
    return [sheet for sheet in found if sheet.rows]
