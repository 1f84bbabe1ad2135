"""A study carried out: what has not finished is run, then claims, tables and pictures."""

from __future__ import annotations

import errno
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

from liftdrag.cost import cores
from liftdrag.engines import mpi
from liftdrag.errors import InputError, RunFailed
from liftdrag.folder import check_place
from liftdrag.study import slurm, team
from liftdrag.study.carried import answer
from liftdrag.study.drawn import draw
from liftdrag.study.findings import findings, growths
from liftdrag.study.plan import Plan, default_folder, read
from liftdrag.study.points import Point, points_of
from liftdrag.study.pool import Pool, Watch
from liftdrag.study.state import LEFT, State, states_of
from liftdrag.study.studied import Studied
from liftdrag.study.tables import write_tables
from liftdrag.study.tasks import Task, distinct

_UNSEEN = Watch()


def sweep(
    study: str,
    out: str | Path | None = None,
    settings: list[str] | None = None,
    jobs: int | None = None,
    ranks: int | None = None,
    scale: str | None = None,
    watch: Watch = _UNSEEN,
) -> Studied:
    """Run what has not finished of a study, and weigh its claims.

    `settings` (KEY=VALUE) hold for all runs; `jobs` runs go on at a time in processes of their
    own, each on `ranks` ranks, by default as many as there are cores for; `scale` names one of
    the study's. Under `mpiexec` its first rank hands the runs out to the others, which end here.
    A run that fails does not stop the others. Raises InputError for a bad study before anything
    runs.
    """
    world = mpi.world(program="liftdrag")
    if world.size > 1 and jobs is not None:
        raise InputError("Under mpiexec its ranks are used; leave out --jobs.")
    _check_counts(jobs, ranks)
    begun = begin(study, out, settings, scale)
    states = states_of(begun.tasks.values(), begun.folder)
    left = [task for task in begun.tasks.values() if not states[task.digest].finished]
    if world.size > 1:
        return conclude(begun, states | dict(team.carry_out(left, begun.folder, ranks or 1, watch)))
    many = jobs or max(1, cores() // (ranks or 1))
    pool = Pool(begun.folder, many, ranks or _ranks(left, many), watch)
    return conclude(begun, states | dict(pool.carry_out(left)))


def on_slurm(
    study: str,
    out: str | Path | None = None,
    settings: list[str] | None = None,
    scale: str | None = None,
) -> tuple[Studied, list[str]]:
    """Submit what neither has finished, goes on nor waits in the queue of SLURM.

    The study as it then stands, and the numbers of the jobs. Raises InputError before anything
    is submitted, RunFailed where SLURM refuses.
    """
    slurm.check_sbatch()
    begun = begin(study, out, settings, scale)
    with slurm.submitting(begun.folder):
        states = slurm.with_queue(states_of(begun.tasks.values(), begun.folder), begun.folder)
        left = [task for task in begun.tasks.values() if states[task.digest].status in LEFT]
        jobs = slurm.submit(left, begun.folder, begun.plan.slurm)
    return conclude(begun, states | {task.digest: State("queued") for task in left}), jobs


def status(
    study: str,
    out: str | Path | None = None,
    settings: list[str] | None = None,
    scale: str | None = None,
) -> Studied:
    """The study as it stands, by the folders of its runs and, where there is one, the queue."""
    begun = begin(study, out, settings, scale)
    states = states_of(begun.tasks.values(), begun.folder)
    with suppress(RunFailed):
        states = slurm.with_queue(states, begun.folder)
    return conclude(begun, states) if begun.folder.exists() else weighed(begun, states)


class Begun:
    """A study as it was read: its plan, its folder, its points by name and tasks by digest."""

    def __init__(self, plan: Plan, folder: Path, points: Mapping[str, Point]):
        self.plan, self.folder, self.points = plan, folder, points
        self.tasks: dict[str, Task] = distinct(points.values())


def begin(
    study: str, out: str | Path | None, settings: list[str] | None, scale: str | None
) -> Begun:
    """The study with its points, before anything is written. Raises InputError."""
    plan = read(study)
    points = points_of(plan, scale, settings or [])
    folder = Path(out) if out is not None else default_folder(study)
    check_place(folder)
    return Begun(plan, folder, points)


def weighed(begun: Begun, states: Mapping[str, State]) -> Studied:
    """What the runs that have finished say."""
    results = {name: answer(point, states) for name, point in begun.points.items()}
    found = list(findings(begun.plan, results))
    grown = list(growths(begun.plan, results))
    return Studied(begun.plan, begun.folder, results, found, grown)


def conclude(begun: Begun, states: Mapping[str, State]) -> Studied:
    """The same, written to the study's folder, too. Raises RunFailed."""
    said = weighed(begun, states)
    try:
        begun.folder.mkdir(parents=True, exist_ok=True)
        write_tables(begun.folder, begun.plan, said.results, said.findings, said.growths)
        draw(begun.folder, begun.plan, said.results)
    except OSError as error:
        status = "disk_full" if error.errno == errno.ENOSPC else "engine_error"
        where = f"Nothing was written to {begun.folder}"
        raise RunFailed(status, f"{where}: {error.strerror}.") from None
    return said


def _check_counts(jobs: int | None, ranks: int | None) -> None:
    for name, count in (("jobs", jobs), ("ranks", ranks)):
        if count is not None and count < 1:
            raise InputError(f"--{name} {count} is not at least 1.")


def _ranks(left: list[Task], jobs: int) -> int:
    """Packings at a time of each run, where cores would idle; one rank for what is shared."""
    ensembles = all(task.case.tables["scene"] == "drag2d" for task in left)
    return max(1, cores() // min(jobs, len(left))) if left and ensembles else 1
