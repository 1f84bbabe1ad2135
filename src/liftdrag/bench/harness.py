"""A bench carried out: points chosen one after another while time is left, some at a time."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import replace
from pathlib import Path

from liftdrag.analysis.quantity import rounded
from liftdrag.bench.axes import axes_of, wanted
from liftdrag.bench.benched import Benched
from liftdrag.bench.judged import CASE, finished, tolerances
from liftdrag.bench.points import REFERENCE, points_of, reference
from liftdrag.bench.runs import Run, Stand, earlier
from liftdrag.bench.schedule import State, left_out
from liftdrag.bench.working import check_jobs, own_beds, spent, working
from liftdrag.bench.written import begin, write
from liftdrag.case import Case
from liftdrag.cost import cores
from liftdrag.errors import RunFailed
from liftdrag.runner import engine_for


def bench(
    case: Case,
    engine: str | None = None,
    out: str | Path | None = None,
    budget_s: float = 1800.0,
    jobs: int | None = None,
    axes: Sequence[str] = (),
    engine_path: str | Path | None = None,
    tell: Callable[[str], None] = lambda _words: None,
) -> Benched:
    """Run a case, and what differs from it in one choice, while the budget (s) lasts.

    `jobs` runs go on at a time, each on one core, by default one a core; `axes` are the choices
    to look at, by default all. What finished in the folder before, by default below runs/bench,
    is not run again. Raises InputError before anything runs, RunFailed when the case itself does
    not finish; a value that fails is a finding.
    """
    check_jobs(jobs)
    found, state = _planned(case, engine, out, axes, engine_path, budget_s)
    halted, runs = threading.Event(), list(state.runs)
    work = working(found.stand, halted)
    try:
        with own_beds(), closing(spent(state, work, jobs or cores(), halted)) as ended:
            for one in ended:
                runs.append(one)
                tell(_line(one))
        _check(runs)
    finally:
        left = left_out(replace(state, runs=tuple(runs)))
        found = replace(found, runs=tuple(runs), left=left)
        write(found)
    return found


def _planned(
    case: Case,
    engine: str | None,
    out: str | Path | None,
    axes: Sequence[str],
    engine_path: str | Path | None,
    budget_s: float,
) -> tuple[Benched, State]:
    """The bench with the runs of before, and where it goes on; its folder is made."""
    plain = Case(case.name, {key: table for key, table in case.tables.items() if key != "stop"})
    chosen = engine_for(plain, engine, engine_path)
    chosen.check(1)
    known = axes_of(plain, chosen.name)
    looked_at = wanted([axis.name for axis in known], axes)
    others, refused = points_of(plain, known)
    points = (reference(plain), *others)
    goals = tolerances(plain.scene)
    folder = Path(out) if out is not None else Path("runs") / "bench" / case.name
    path = None if engine_path is None else Path(engine_path)
    stand = Stand(folder, chosen.name, chosen.about().version, path, tuple(goals))
    notes = [
        f"{axis} {name} is left out: {why}"
        for (axis, name), why in refused.items()
        if axis in looked_at
    ]
    found = Benched(case, stand, known, goals, (), notes)
    begin(found)
    asked = tuple(point for point in points if point.axis in (REFERENCE, *looked_at))
    return found, State(asked, tuple(earlier(points, stand)), (), goals, budget_s)


def _check(runs: Sequence[Run]) -> None:
    """Raise RunFailed when the case itself has no answer."""
    failed = [one for one in runs if one.key == CASE and not one.finished]
    if CASE not in finished(runs):
        raise RunFailed(failed[0].status, f"The case itself failed: {failed[0].reason}")


def _line(one: Run) -> str:
    """What is said of a run that ended."""
    name = f"{one.axis} {one.name}".strip() + f", run {one.replica}"
    if one.answers is None:
        return f"{name}: {one.status}, {one.reason}"
    answers = (
        f"{quantity} {' ± '.join(rounded(found.mean, found.standard_error))}"
        for quantity, found in one.answers.items()
    )
    return f"{name}: {one.cpu_s:.3g} s of processor time, {', '.join(answers)}"
