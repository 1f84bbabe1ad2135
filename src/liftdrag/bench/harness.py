"""A bench carried out: points chosen one after another while time is left, some at a time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from liftdrag.analysis.quantity import rounded
from liftdrag.bench.axes import axes_of, wanted
from liftdrag.bench.benched import Benched
from liftdrag.bench.judged import CASE, finished, tolerances
from liftdrag.bench.points import REFERENCE, points_of, reference
from liftdrag.bench.prepared import prepared, stand_of
from liftdrag.bench.runs import Run, earlier
from liftdrag.bench.schedule import State, left_out
from liftdrag.bench.working import check_jobs, through
from liftdrag.bench.written import begin, write
from liftdrag.case import Case
from liftdrag.errors import RunFailed


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
    runs = list(state.runs)

    def ended(one: Run) -> None:
        runs.append(one)
        tell(_line(one))

    try:
        through(state, found.stand, jobs, ended)
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
    plain, chosen, folder = prepared(case, engine, engine_path, out, "bench")
    known = axes_of(plain, chosen.name)
    looked_at = wanted([axis.name for axis in known], axes)
    others, refused = points_of(plain, known)
    points = (reference(plain), *others)
    goals, stand = tolerances(plain.scene), stand_of(folder, chosen, engine_path, plain.scene)
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
