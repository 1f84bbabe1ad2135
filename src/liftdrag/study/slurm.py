"""A study on a cluster: what is missing goes to SLURM as array jobs, a run to each element.

What has been done is read from the folders of the runs. SLURM is only asked which elements are
still to come, so that none is submitted twice.
"""

from __future__ import annotations

import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

from liftdrag.errors import InputError, RunFailed, escaped
from liftdrag.folder import read_json, write_json, writing
from liftdrag.lock import held
from liftdrag.study.plan import Slurm
from liftdrag.study.state import State
from liftdrag.study.tasks import Task, request

JOBS = "slurm"
"""The folder of the array jobs of a study, each with its script, its tasks and what they said."""

SCRIPT, LIST, JOB = "job.sh", "tasks.txt", "job.json"

MOST = 1000
"""Elements of an array, the number that SLURM takes unless a cluster says otherwise."""

COMING = {"PENDING", "CONFIGURING", "RUNNING", "SUSPENDED", "REQUEUED", "REQUEUE_HOLD", "RESIZING"}
"""States of a job in which its element is still to run, or does."""


def check_sbatch() -> None:
    """Raise InputError where there is no SLURM."""
    if shutil.which("sbatch") is None:
        raise InputError("--slurm needs sbatch on the PATH: start it where jobs are submitted.")


def with_queue(states: Mapping[str, State], study: Path) -> dict[str, State]:
    """The states by digest; those that a job of the study is still to run are "queued".

    Raises RunFailed where SLURM does not answer.
    """
    coming = queued(study)
    return {
        digest: State("queued", folder=state.folder)
        if digest in coming and state.status not in ("finished", "running")
        else state
        for digest, state in states.items()
    }


def queued(study: Path) -> set[str]:
    """The digests of the tasks that are in SLURM's queue. Raises RunFailed."""
    jobs = {_job(folder): folder for folder in (study / JOBS).glob("*")}
    jobs.pop("", None)
    if not jobs:
        return set()
    said = _asked(["squeue", "-h", "-r", "--me", "-o", "%F %K %T"], study)
    found = set[str]()
    for job, element, state in (line.split() for line in said.splitlines()):
        if job in jobs and state in COMING and element.isdecimal():
            found.add((jobs[job] / LIST).read_text("utf-8").split()[int(element) - 1])
    return found


@contextmanager
def submitting(study: Path) -> Iterator[None]:
    """For the block nobody else submits runs of the study. Raises InputError."""
    (study / JOBS).mkdir(parents=True, exist_ok=True)
    with held(study / JOBS):
        yield


def submit(tasks: Sequence[Task], study: Path, asked: Slurm) -> list[str]:
    """Submit these tasks; the numbers of the jobs. Raises InputError and RunFailed.

    Of several arrays each waits for the one before where there is a limit on how many runs go on.
    """
    jobs = list[str]()
    for first in range(0, len(tasks), MOST):
        after = jobs[-1] if jobs and asked.array_limit else None
        jobs.append(_submitted(tasks[first : first + MOST], study, asked, after))
    return jobs


def _submitted(tasks: Sequence[Task], study: Path, asked: Slurm, after: str | None) -> str:
    for task in tasks:
        request(task, study)
    folder = _next(study / JOBS)
    with writing(folder):
        folder.mkdir()
        (folder / LIST).write_text("".join(f"{task.digest}\n" for task in tasks), "utf-8")
        (folder / SCRIPT).write_text(script(asked, study, folder, len(tasks)), "utf-8")
    wait = [] if after is None else [f"--dependency=afterany:{after}"]
    said = _asked(["sbatch", "--parsable", *wait, SCRIPT], folder)
    job = said.strip().partition(";")[0]
    if not job.isdecimal():
        raise RunFailed("engine_error", f"sbatch names no job but {escaped(said.strip()[:60])}.")
    write_json(folder / JOB, {"job": job})
    return job


def script(asked: Slurm, study: Path, folder: Path, count: int) -> str:
    """The batch script of an array of `count` tasks, listed in `folder`."""
    lines = ["#!/bin/bash -l" if asked.modules else "#!/bin/bash"]
    lines += [f"#SBATCH --{option}" for option in _options(asked, study, count)]
    lines += [f"module load {module}" for module in asked.modules]
    command = [sys.executable, "-m", "liftdrag.study.child", str(study.absolute())]
    command += ["--list", str((folder / LIST).absolute()), "--ranks", str(asked.ranks)]
    return "\n".join([*lines, f"exec {shlex.join(command)}", ""])


def _options(asked: Slurm, study: Path, count: int) -> Iterator[str]:
    name = re.sub(r"[^A-Za-z0-9_.-]", "", study.absolute().name)[:40]
    limit = f"%{asked.array_limit}" if asked.array_limit else ""
    yield from (f"job-name=liftdrag-{name}", f"array=1-{count}{limit}", "output=%a.out")
    yield from ("open-mode=append", "requeue" if asked.requeue else "no-requeue", "nodes=1")
    for key in ("partition", "account", "qos", "time", "mem", "ntasks", "cpus_per_task"):
        value = getattr(asked, key)
        if value is not None:
            yield f"{key.replace('_', '-')}={value}"


def _next(parent: Path) -> Path:
    numbers = [int(entry.name) for entry in parent.iterdir() if entry.name.isdecimal()]
    return parent / f"{max(numbers, default=0) + 1:04d}"


def _job(folder: Path) -> str:
    """The number of a job that was submitted, none where it was not."""
    try:
        return str(read_json(folder / JOB).get("job", ""))
    except InputError:
        return ""


def _asked(command: Sequence[str], folder: Path) -> str:
    """What a program of SLURM says, started in `folder`. Raises RunFailed."""
    try:
        done = subprocess.run(
            command, cwd=folder, capture_output=True, text=True, errors="replace", timeout=120
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        raise RunFailed("engine_error", f"{command[0]} cannot be asked: {error}.") from None
    if done.returncode != 0:
        why = " ".join(done.stderr.split()) or f"exit status {done.returncode}"
        raise RunFailed("engine_error", f"{command[0]} refuses: {escaped(why[:300])}")
    return done.stdout
