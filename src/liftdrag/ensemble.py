"""An ensemble of runs, from a case to its result: the same scene in many random packings.

The packings are grown and run by themselves, spread over threads, each of which drives an engine
of one rank, or over the ranks of the MPI job around us. Each has a folder with its deck.
"""

from __future__ import annotations

import contextlib
import sys
import threading
import time
from collections.abc import Callable, Container, Iterator
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from liftdrag import seal
from liftdrag.analysis import drag2d
from liftdrag.analysis.drag2d import EnsembleAnswers, Packing
from liftdrag.analysis.invariants import check_sound, plane_invariants, watched
from liftdrag.analysis.overlaps import deepest_in_plane
from liftdrag.analysis.stopping import EnsembleStopping, missed
from liftdrag.case import Case
from liftdrag.cost import Estimate, check_means, cores, foresee
from liftdrag.deck import Deck
from liftdrag.deck.dialect import IN_HOUSE, Dialect
from liftdrag.deck.drag2d import build, check_shape, contact_of, read_bed
from liftdrag.dem import Bed, is_cold
from liftdrag.engines import engine as engine_called
from liftdrag.engines import mpi
from liftdrag.engines.base import Engine, Outcome, Progress, silent
from liftdrag.engines.identity import identity
from liftdrag.engines.probes import PLANAR, Probe, Subject
from liftdrag.engines.watchdog import Watchdog, limits
from liftdrag.errors import InputError, RunFailed
from liftdrag.execution import Asked, how_on
from liftdrag.folder import (
    FULL,
    RESULT,
    Record,
    changed,
    check_free,
    claimed,
    fresh,
    read_json,
    write_json,
    writing,
)
from liftdrag.numerics import Drag2DNumerics, derive, explained
from liftdrag.packing.drag2d import packed
from liftdrag.pictures import drag2d as pictures
from liftdrag.result import Result, begun, cost, provenance
from liftdrag.result import answered as quantities_of
from liftdrag.scene import Drag2DScene
from liftdrag.series import Series
from liftdrag.snapshot import Snapshot
from liftdrag.tables import column, read_table
from liftdrag.trust import trusted
from liftdrag.version import VERSION

OUTCOME = "outcome.json"

PACKINGS = "packings.csv"
"""The table of the packings."""

CHANNELS = frozenset("drag lift left right bottom top".split())
"""What the series of every engine has."""

FILES = (RESULT, "drag.csv", "packings.csv", "drag.png", "flow.png")


@dataclass(frozen=True)
class _Task:
    """What each packing of an ensemble is made from; of the first, what `_made` gave.

    `expected` is what all of them should cost, known where they are begun.
    """

    case: Case
    scene: Drag2DScene
    engine: Engine
    folder: Path
    first: tuple[Deck, float] | None = None
    expected: Estimate | None = None
    watchdog: Watchdog | None = None


def packing_folder(folder: Path, number: int) -> Path:
    """The folder of packing `number`, from 0, of an ensemble."""
    return folder / f"packing-{number + 1:03d}"


def prepare(case: Case, scene: Drag2DScene, number: int, dialect: Dialect = IN_HOUSE) -> Deck:
    """The deck of packing `number`, from 0. Raises CaseError when it cannot be packed."""
    check_shape(scene, dialect)
    bed = packed(scene, number)
    return build(scene, derive(scene), bed, case.name, VERSION, dialect)


def write_decks(case: Case, engine: Engine, out: str | Path | None) -> tuple[Path, Drag2DNumerics]:
    """The decks of all packings, each in its folder, and the reasons for their numbers.

    Raises InputError before anything is written.
    """
    scene = _planar(case)
    numerics = derive(scene)
    with ThreadPoolExecutor(cores()) as pool:
        numbers = range(scene.ensemble.runs)
        decks = list(pool.map(lambda k: prepare(case, scene, k, engine.dialect), numbers))
    folder = fresh(out, case.name, "decks")
    (folder / "numerics.txt").write_text(explained(numerics), "utf-8")
    for number, deck in enumerate(decks):
        deck.write(packing_folder(folder, number))
    return folder, numerics


def run(case: Case, asked: Asked) -> Result:
    """Run all packings of a case, `ranks` at a time, and answer with their means.

    Under MPICH's `mpiexec` each rank runs its share, and all but the first end here. Raises
    InputError before anything is started, RunFailed when a packing does not finish.
    """
    with contextlib.ExitStack() as own:
        return _run(case, asked, own)


def _run(case: Case, asked: Asked, own: contextlib.ExitStack) -> Result:
    scene = _planar(case)
    check_shape(scene, asked.engine.dialect)
    world, start = mpi.world(program="liftdrag"), time.monotonic()
    if world.size > 1:
        task, record, outcomes = _in_team(case, asked, world, own)
        return _conclude(task, record, outcomes, scene.ensemble.runs, time.monotonic() - start)
    workers = asked.ranks or cores()
    task, record = _begin(case, asked, workers, own)
    task = replace(task, watchdog=_watchdog(asked.timeout_s))
    outcomes, count = _recorded(task, record, asked.progress, workers)
    return _conclude(task, record, outcomes, count, time.monotonic() - start)


def resumed(
    case: Case,
    engine: Engine,
    folder: Path,
    record: Record,
    ranks: int | None = None,
    progress: Progress = silent,
    timeout_s: float | None = None,
) -> Result:
    """Go on with an ensemble that was cut short: packings that have finished are kept.

    Raises InputError in an MPI job of several ranks, RunFailed when a packing does not finish.
    """
    if mpi.world(program="liftdrag").size > 1:
        raise InputError("An ensemble is gone on with in one process; start it without mpiexec.")
    start = time.monotonic()
    task = _Task(case, _planar(case), engine, folder, watchdog=_watchdog(timeout_s))
    outcomes, count = _recorded(task, record, progress, ranks or cores())
    return _conclude(task, record, outcomes, count, time.monotonic() - start)


def _watchdog(timeout_s: float | None) -> Watchdog:
    return Watchdog(limits(timeout_s, 0.0), ())


def answered(folder: Path, scene: Drag2DScene, record: Record, result: dict[str, Any]) -> Result:
    """The answers from the files in the folder, written to `result.json`, tables and pictures."""
    packings = [_packing(folder, record, k) for k in range(_count(folder, scene, result))]
    found = drag2d.answers(scene, packings)
    short = missed(scene.targets, found.quantities, "ensemble.runs")
    warnings = [*record.alarms, *found.warnings, *record.warnings, *short]
    result = result | quantities_of(found.quantities) | {"warnings": warnings}
    deepest = max(_deepest(folder, record, k, found) for k in range(len(packings)))
    result = watched(result, plane_invariants(scene, [p.series for p in packings], deepest))
    try:
        write_json(folder / RESULT, result)
        _write_tables(folder, scene, found)
        pictures.draw_drag(scene, [p.series for p in packings], found, folder / "drag.png")
        pictures.draw_flow(scene, *_frames(folder, record), folder / "flow.png")
    except (OSError, RunFailed) as error:
        result["warnings"] = [f"Nothing was written to {folder}: {error}", *warnings]
    check_sound(result)
    return Result(folder, result, found.quantities, found.series, None, FILES)


def _count(folder: Path, scene: Drag2DScene, result: dict[str, Any]) -> int:
    """How many packings were run. Raises InputError when `result` does not say it."""
    count = result.get("packings", scene.ensemble.runs)
    if not isinstance(count, int) or not 2 <= count <= scene.ensemble.runs:
        raise InputError(f"{folder / RESULT} is damaged; run the case again.")
    return count


def each_of(folder: Path, quantity: str, unit: str) -> np.ndarray:
    """The quantity of each packing (n,), as `packings.csv` has it. Raises InputError."""
    return column(read_table(folder / PACKINGS, "csv"), f"{quantity} ({unit})")


def _planar(case: Case) -> Drag2DScene:
    if not isinstance(case.scene, Drag2DScene):
        raise InputError(f"The case {case.name} is no ensemble; its scene is {case.scene.scene}.")
    return case.scene


def _begin(
    case: Case, asked: Asked, workers: int, own: contextlib.ExitStack
) -> tuple[_Task, Record]:
    """Probe the engine, and write all of the record that is known before the packings are."""
    engine, scene = asked.engine, _planar(case)
    engine.check(1)
    check_free(asked.out)
    numerics = derive(scene)
    check_means(scene, numerics, engine, workers, asked.out)
    probes, alarms = list[Probe](), list[str]()
    if engine.dialect is not IN_HOUSE:
        subject = Subject(contact_of(scene), scene.grains.density)
        probes, alarms = trusted(engine, subject, PLANAR, asked.ignored_probes)
    if is_cold():
        asked.progress("compile", 0, 1)
    with ThreadPoolExecutor(1) as aside:  # a signal in compiled code would end the process
        first = aside.submit(_made, case, scene, 0, engine.dialect).result()
    folder = own.enter_context(claimed(asked.out, case.name))
    expected = foresee(scene, numerics, engine, workers)
    numerics = replace(numerics, warnings=(*numerics.warnings, *expected.warnings))
    with writing(folder):
        (folder / "numerics.txt").write_text(explained(numerics), "utf-8")
    made = provenance(first[0]) | {
        "probes": [found.to_dict() for found in probes],
        "engine": identity(engine),
    }
    record = Record(
        case.name,
        dict(case.tables),
        engine.name,
        first[0].plan,
        list(numerics.warnings),
        made,
        alarms,
        expected.to_dict(),
    )
    record.write(folder)
    return _Task(case, scene, engine, folder, first, expected), record


def _in_team(
    case: Case, asked: Asked, world: mpi.World, own: contextlib.ExitStack
) -> tuple[_Task, Record, list[Outcome]]:
    """This rank's share of the packings; only the first rank returns, with those of all."""
    from mpi4py import MPI

    team, first = MPI.COMM_WORLD, None
    try:
        if world.rank == 0:
            first = _begin(case, asked, world.size, own)
    finally:
        place = team.bcast(str(first[0].folder) if first else "", root=0)
    if not place:
        sys.exit(2)
    scene = _planar(case)
    task = first[0] if first else _Task(case, scene, asked.engine, Path(place))
    mine = range(world.rank, scene.ensemble.runs, world.size)
    shares = team.gather(_share(task, mine, asked.progress if first else silent), root=0)
    if first is None or shares is None:
        sys.exit(0)
    for share in shares:
        if isinstance(share, str):
            raise _failed(task, first[1], "engine_error", share)
    return task, first[1], [outcome for share in shares for outcome in share]


def _share(task: _Task, numbers: range, progress: Progress) -> list[Outcome] | str:
    """The outcomes of these packings, or why they cannot be made: the others wait for a word."""
    try:
        return _run_all(task, numbers, 1, progress)
    except (InputError, RunFailed, OSError) as error:
        return str(error)
    except KeyboardInterrupt:
        return "the run was interrupted"


def _recorded(
    task: _Task, record: Record, progress: Progress, workers: int
) -> tuple[list[Outcome], int]:
    """The outcomes of the packings, and how many of them, from the first on, are enough.

    An interruption is written down before it goes on.
    """
    enough = _Enough(task, record)
    try:
        outcomes = _run_all(task, range(task.scene.ensemble.runs), workers, progress, enough)
        return outcomes, enough.count or task.scene.ensemble.runs
    except KeyboardInterrupt:
        raise _failed(task, record, "killed", "the run was interrupted") from None
    except InputError as error:
        raise _failed(task, record, "engine_error", str(error)) from None
    except RunFailed as failure:
        raise _failed(task, record, failure.status, failure.reason) from None
    except OSError as error:
        status = "disk_full" if error.errno in FULL else "engine_error"
        raise _failed(task, record, status, str(error)) from None


def _failed(task: _Task, record: Record, status: str, reason: str) -> RunFailed:
    """The failure of a run without outcomes, written down where that is possible."""
    with contextlib.suppress(RunFailed):
        write_json(task.folder / RESULT, begun(record, status, [reason]))
    how = how_on(task.folder, status)
    return RunFailed(status, f"{status} in {task.folder}: {reason}{how and '.'}{how}")


class _Enough:
    """Whether the packings that have finished reach the targets of the scene's stop."""

    def __init__(self, task: _Task, record: Record):
        self.count: int | None = None
        self._packings = list[Packing]()
        self._folder, self._record = task.folder, record
        self._stopping = EnsembleStopping(
            task.scene.targets,
            lambda count: drag2d.answers(task.scene, self._packings[:count]).quantities,
        )

    def __call__(self, finished: Container[int]) -> bool:
        """With the numbers of those finished, of which the first without a gap count."""
        if not self._stopping.targets:
            return False
        while len(self._packings) in finished:
            self._packings.append(_packing(self._folder, self._record, len(self._packings)))
        self.count = self._stopping(len(self._packings))
        return self.count is not None


def _never(_finished: Container[int]) -> bool:
    return False


def _run_all(
    task: _Task,
    numbers: range,
    workers: int,
    progress: Progress,
    enough: Callable[[Container[int]], bool] = _never,
) -> list[Outcome]:
    """The outcomes of these packings, those after a failure or after `enough` left out."""
    halted, outcomes = threading.Event(), dict[int, Outcome]()
    pool = ThreadPoolExecutor(workers)
    progress("packings", 0, len(numbers))
    try:
        running = {pool.submit(_run_one, task, number, halted): number for number in numbers}
        for done in as_completed(running):
            outcomes[running[done]] = outcome = done.result()
            progress("packings", len(outcomes), len(numbers))
            if outcome.status != "finished" or enough(outcomes):
                break
    finally:
        halted.set()
        pool.shutdown(cancel_futures=True)
    return list(outcomes.values())


class _Halted(Exception):
    """Another packing failed, or the user stopped the run."""


def _run_one(task: _Task, number: int, halted: threading.Event) -> Outcome:
    """Pack and run packing `number`, from 0, and write down how that ended."""

    def look(_stage: str, _done: int, _total: int) -> None:
        if halted.is_set():
            raise _Halted
        if task.watchdog:
            task.watchdog.look()

    folder = packing_folder(task.folder, number)
    if not task.folder.is_dir():
        raise RunFailed("engine_error", f"the folder {task.folder} vanished during the run")
    if (before := _finished(task, number)) is not None:
        return before
    made = task.first if number == 0 else None
    deck, packing_s = made or _made(task.case, task.scene, number, task.engine.dialect)
    deck.write(folder)
    outcome = task.engine.run(deck.plan, folder, look, alone=True)
    outcome = replace(outcome, cpu_s=outcome.cpu_s + packing_s)
    named = replace(outcome, reason=f"packing {number + 1}: {outcome.reason}")
    ended = asdict(named) | {"path": str(outcome.path), "deck_files": deck.digests}
    write_json(folder / OUTCOME, ended)
    return outcome if outcome.status == "finished" else named


def _finished(task: _Task, number: int) -> Outcome | None:
    """The outcome of a packing that had finished before: whole, and its deck as it was written."""
    folder = packing_folder(task.folder, number)
    if not (folder / OUTCOME).exists():
        return None
    ended = read_json(folder / OUTCOME)
    files = ended.pop("deck_files", None)
    if ended.get("status") != "finished" or not files or changed(folder, files):
        return None
    try:
        _packing(task.folder, Record.read(task.folder), number)
    except InputError:
        return None
    return Outcome(**ended | {"path": Path(ended["path"])})


def _made(case: Case, scene: Drag2DScene, number: int, dialect: Dialect) -> tuple[Deck, float]:
    """The deck of packing `number`, and the processor time (s) that it took."""
    start = time.thread_time()
    deck = prepare(case, scene, number, dialect)
    return deck, time.thread_time() - start


def _conclude(
    task: _Task, record: Record, outcomes: list[Outcome], count: int, wall_s: float
) -> Result:
    """The result of `count` packings. Raises RunFailed with the first that did not finish."""
    whole = _total(outcomes)
    failed = next((one for one in outcomes if one.status != "finished"), None)
    status, reasons = (failed.status, [failed.reason]) if failed else ("finished", [])
    result = begun(record, status, reasons) | cost(whole, wall_s)
    result["engine"] |= {"version": whole.version, "path": str(whole.path)}
    result["packings"] = count
    if not failed and count < task.scene.ensemble.runs:
        result["stopped_by"] = "precision"
    if not failed:
        with writing(task.folder):
            result["sealed"] = seal.digests(task.folder, record)
    write_json(task.folder / RESULT, result)
    if failed:
        raise RunFailed(status, f"{status}: {failed.reason}.", failed.evidence)
    if task.expected:
        beds = len(outcomes)
        task.expected.compare(whole, whole.grains * whole.steps / beds, beds)
    return answered(task.folder, task.scene, record, result)


def _total(outcomes: list[Outcome]) -> Outcome:
    """The outcomes as one: steps and times added up."""
    return replace(
        outcomes[0],
        steps=sum(one.steps for one in outcomes),
        loop_s=sum(one.loop_s for one in outcomes),
        cpu_s=sum(one.cpu_s for one in outcomes),
    )


def _packing(folder: Path, record: Record, number: int) -> Packing:
    """What a packing left. Raises InputError when its files are damaged."""
    place = packing_folder(folder, number)
    try:
        series = engine_called(record.engine).series(record.plan, place)
        _check_complete(series, record)
        frames = list(_centres(place, record))
    except (OSError, ValueError, LookupError) as error:
        raise InputError(
            f"The files in {place} are damaged ({error}); run the case again."
        ) from error
    return Packing(series, frames[0], frames[-1])


def _deepest(folder: Path, record: Record, number: int, found: EnsembleAnswers) -> float:
    """The deepest overlap of a packing over the smaller radius, sampled or seen at its moments."""
    if "overlap_ratio" in found.values:
        return float(found.values["overlap_ratio"][number])
    place = packing_folder(folder, number)
    moments = engine_called(record.engine).snapshots(record.plan, place)
    bed = read_bed(place)
    return max((deepest_in_plane(bed, moment) for moment in moments), default=0.0)


def _check_complete(series: Series, record: Record) -> None:
    if missing := CHANNELS - series.channels.keys():
        raise ValueError(f"the series has no {min(missing)}")
    whole = record.plan.stages["drive"] * record.plan.time_step
    if abs(series.time[-1] / whole - 1.0) > 1e-6:
        raise ValueError(f"the series ends at {series.time[-1]:.4g} s, not at {whole:.4g} s")


def _centres(folder: Path, record: Record) -> Iterator[np.ndarray]:
    """The centres (n, 2) of the grains at each moment, m."""
    body = read_bed(folder).body[:-1]
    for snapshot in engine_called(record.engine).snapshots(record.plan, folder):
        x, y = snapshot.position[: len(body), :2].T
        discs = np.bincount(body)
        yield np.column_stack([np.bincount(body, x), np.bincount(body, y)]) / discs[:, None]


def _frames(folder: Path, record: Record) -> tuple[Bed, list[Snapshot]]:
    """The first packing and its moments, to be drawn."""
    place = packing_folder(folder, 0)
    return read_bed(place), list(engine_called(record.engine).snapshots(record.plan, place))


def _write_tables(folder: Path, scene: Drag2DScene, found: EnsembleAnswers) -> None:
    """`drag.csv`, the mean over the packings against displacement; `packings.csv`, each's means."""
    import pandas as pd

    table = found.series.to_pandas().reset_index()
    table.insert(0, "displacement (m)", drag2d.displacement(scene, found.series))
    table.insert(3, "drag standard error (N)", found.drag_error)
    table.to_csv(folder / "drag.csv", index=False)
    units = {name: found.quantities[name].unit for name in found.values}
    each = {f"{name} ({units[name]})": values for name, values in found.values.items()}
    pd.DataFrame(
        each, index=pd.RangeIndex(1, 1 + len(found.values["drag"]), name="packing")
    ).to_csv(folder / PACKINGS)
