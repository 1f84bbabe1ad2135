"""Runs of a study in processes of their own: claimed by one, ended together, gone on with."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

import pytest
from conftest import TINY, program

from liftdrag import engines
from liftdrag.lock import held, is_held
from liftdrag.study.child import ENDING, _interrupt, _leave_jobs, carry_out
from liftdrag.study.pool import SAYS, Pool, View, Watch, ended
from liftdrag.study.state import END, state_of
from liftdrag.study.swept import begin
from liftdrag.study.tasks import (
    FAILED,
    FINISHED,
    IN_USE,
    PROGRESS,
    Task,
    claim,
    folder_of,
    request,
)

STUDY = """
title = "Speeds"
[set]
"drive.distance" = "{distance} D"
[runs.tank]
case = "{case}"
grid = {{ "drive.speed" = ["0.2 m/s", "0.3 m/s"] }}
"""


def study_in(folder: Path, distance: float) -> tuple[Path, list[Task]]:
    """A study of two tanks, and its tasks."""
    (folder / "tiny.toml").write_text(TINY)
    file = folder / "speeds.study"
    file.write_text(STUDY.format(case=folder / "tiny.toml", distance=distance))
    begun = begin(str(file), folder / "out", None, None)
    return file, list(begun.tasks.values())


def state(task: Task, study: Path) -> str:
    return state_of(task, study, folder_of(task, study)).status


def wait_for(happened: Callable[[], bool]) -> None:
    until = time.monotonic() + 120.0
    while not happened():
        assert time.monotonic() < until
        time.sleep(0.05)


def test_task_is_carried_out_by_one_and_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("liftdrag.lock.PATIENCE_S", 0.0)
    _, (task, _) = study_in(tmp_path, 5)
    out = tmp_path / "out"
    place = request(task, out)
    assert state(task, out) == "missing"
    with held(place):
        assert carry_out(out, task.digest, None) == IN_USE
        assert state(task, out) == "running"
    assert carry_out(out, task.digest, None) == FINISHED
    result = folder_of(task, out) / "result.json"
    at = result.stat().st_mtime_ns
    assert carry_out(out, task.digest, None) == FINISHED
    assert result.stat().st_mtime_ns == at
    said = json.loads((place / PROGRESS).read_text())
    assert said["stage"] == "drive"


def test_pool_waits_for_what_another_process_is_at(tmp_path: Path):
    """The holder lets go without having done it, and the task is done here."""
    _, (task, _) = study_in(tmp_path, 5)
    out, lines = tmp_path / "out", list[str]()
    views, own = list[View](), ExitStack()
    own.enter_context(held(request(task, out)))

    def say(words: str) -> None:
        lines.append(words)
        if "another" in words:
            own.close()

    done = Pool(out, 1, None, Watch(views.append, say)).carry_out([task])
    assert done[task.digest].finished
    assert [line.partition(": ")[2] for line in lines] == [
        "another liftdrag is at it; waiting",
        "started",
        "finished (1 of 1)",
    ]
    assert (views[-1].ended, views[-1].total) == (1, 1)


def test_failure_is_written_down_in_a_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    _, (task, _) = study_in(tmp_path, 5)
    broken = Task(task.name, task.case, "lmp")
    out = tmp_path / "out"
    lmp = program(tmp_path / "lmp", "Large-scale Atomic/Molecular Massively Parallel Simulator")
    monkeypatch.setenv("LIFTDRAG_LMP", str(lmp))
    request(broken, out)
    engines._program.cache_clear()
    try:
        assert carry_out(out, broken.digest, None) == FAILED
    finally:
        engines._program.cache_clear()
    assert state(broken, out) == "failed"
    reason = json.loads((claim(out, broken.digest) / END).read_text())["reason"]
    assert str(lmp) in reason
    assert "\n" not in reason


def test_run_is_no_part_of_the_job_that_it_is_started_in(monkeypatch: pytest.MonkeyPatch):
    """Launchers would otherwise start the ranks by srun, out of sight of their lock."""
    for name in ("SLURM_JOB_ID", "SLURM_PROCID", "PMI_RANK", "OMPI_COMM_WORLD_SIZE"):
        monkeypatch.setenv(name, "3")
    monkeypatch.setenv("OMP_NUM_THREADS", "8")
    before = {name for name in os.environ if not name.startswith(("SLURM_", "PMI_", "OMPI_"))}
    _leave_jobs()
    assert set(os.environ) == before
    assert os.environ["OMP_NUM_THREADS"] == "1"


def test_process_that_dies_without_a_word_is_a_failure_with_its_last_line(tmp_path: Path):
    _, (task, _) = study_in(tmp_path, 5)
    (request(task, tmp_path) / SAYS).write_text("one\nout of memory\n\n")
    found = ended(task, tmp_path, -9)
    assert (found.status, found.reason) == (
        "failed",
        "its process ended with status -9. out of memory",
    )


def test_request_that_was_changed_is_written_again(tmp_path: Path):
    _, (task, _) = study_in(tmp_path, 5)
    file = request(task, tmp_path) / "task.json"
    whole = file.read_text()
    file.write_text(whole.replace('"seed": 1', '"seed": 2'))
    request(task, tmp_path)
    assert file.read_text() == whole


def test_second_signal_does_not_disturb_what_the_first_one_ends():
    """Linux sends one for each thread of a parent that was killed."""
    before = {number: signal.getsignal(number) for number in ENDING}
    try:
        signal.signal(signal.SIGTERM, _interrupt)
        with pytest.raises(KeyboardInterrupt):
            os.kill(os.getpid(), signal.SIGTERM)
        for number in ENDING:
            os.kill(os.getpid(), number)
        assert {signal.getsignal(number) for number in ENDING} == {signal.SIG_IGN}
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_study_that_is_ended_leaves_no_process(number: signal.Signals, tmp_path: Path):
    """Two long runs are cut short; the engines, which keep the locks while they live, are gone.

    Of a study that is killed, too, and so says nothing: its locks are free for the next.
    """
    file, tasks = study_in(tmp_path, 400)
    out = tmp_path / "out"
    words = [sys.executable, "-m", "liftdrag", "sweep", str(file), "--out", str(out), "--jobs", "2"]
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.STDOUT) as sweep:
        for task in tasks:
            wait_for((folder_of(task, out) / "log.lammps").exists)
        assert [state(task, out) for task in tasks] == ["running", "running"]
        sweep.send_signal(number)
        said = sweep.communicate(timeout=60)[0].decode()
    wait_for(lambda: not any(is_held(claim(out, task.digest)) for task in tasks))
    killed = number == signal.SIGKILL
    assert sweep.returncode == (-signal.SIGKILL if killed else 1)
    assert killed or said.endswith("Interrupted.\n")
    assert [state(task, out) for task in tasks] == ["interrupted", "interrupted"]
