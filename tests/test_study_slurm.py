"""A study as array jobs: on a real SLURM, killed midway; and what no script may hold."""

from __future__ import annotations

import os
import signal
import subprocess
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest
from conftest import TINY, program
from slurm import NODE, asked, cluster, wait
from typer.testing import CliRunner

from liftdrag.cli import app
from liftdrag.errors import InputError, RunFailed
from liftdrag.lock import LOCK
from liftdrag.study import on_slurm, read, status
from liftdrag.study.plan import Slurm
from liftdrag.study.slurm import script
from liftdrag.study.tasks import Task, claim, folder_of

STUDY = """
title = "Speeds"
[set]
"drive.distance" = "5 D"
[runs.tank]
case = "{case}"
grid = {{ "drive.speed" = ["0.3 m/s", "0.4 m/s"] }}
[runs.long]
case = "{case}"
set = {{ "drive.distance" = "25 D" }}
[slurm]
time = "10"
requeue = false
"""


@pytest.fixture
def study(tmp_path: Path) -> str:
    (tmp_path / "tiny.toml").write_text(TINY)
    file = tmp_path / "speeds.study"
    file.write_text(STUDY.format(case=tmp_path / "tiny.toml"))
    return str(file)


@pytest.fixture(scope="module")
def conf(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    with cluster(tmp_path_factory.mktemp("slurm")) as found:
        yield found


def statuses(study: str, out: Path) -> Counter[str]:
    return Counter(one.status for one in status(study, out).results.values())


@pytest.fixture
def out(tmp_path: Path, conf: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder for the study, which SLURM can be asked about."""
    monkeypatch.setenv("SLURM_CONF", str(conf))
    return tmp_path / "out"


def long_run(study: str, out: Path) -> Task:
    """The task of the long run, whose folder is there once it drives."""
    ((task, _),) = status(study, out).results["long"].runs
    log = folder_of(task, out) / "log.lammps"
    wait(lambda: log.exists() and "STAGE drive" in log.read_text())
    return task


def is_empty(conf: Path) -> bool:
    return asked(conf, "squeue", "-h").strip() == ""


@pytest.mark.needs("slurm")
def test_array_killed_midway_is_finished_by_the_same_command(study: str, out: Path, conf: Path):
    first, jobs = on_slurm(study, out)
    assert len(jobs) == 1
    assert {one.status for one in first.results.values()} == {"queued"}
    assert on_slurm(study, out)[1] == []
    long = long_run(study, out)
    os.kill(int((claim(out, long.digest) / LOCK).read_text().split()[1]), signal.SIGKILL)
    wait(lambda: is_empty(conf))
    assert statuses(study, out) == {"finished": 2, "interrupted": 1}
    assert len(on_slurm(study, out)[1]) == 1
    wait(lambda: statuses(study, out) == {"finished": 3})
    assert on_slurm(study, out)[1] == []
    lists = [file.read_text().split() for file in sorted(out.glob("slurm/*/tasks.txt"))]
    assert [len(tasks) for tasks in lists] == [3, 1]
    assert lists[1] == [long.digest]


@pytest.mark.validate
@pytest.mark.needs("slurm")
def test_array_whose_node_goes_down_is_finished_by_the_same_command(
    study: str, out: Path, conf: Path
):
    on_slurm(study, out)
    long_run(study, out)
    node = f"nodename={NODE}"
    asked(conf, "scontrol", "update", node, "state=down", "reason=test")
    wait(lambda: is_empty(conf))
    wait(lambda: statuses(study, out)["running"] == 0)
    left = 3 - statuses(study, out)["finished"]
    assert left > 0
    asked(conf, "scontrol", "update", node, "state=resume")
    assert len(on_slurm(study, out)[1]) == 1
    wait(lambda: statuses(study, out) == {"finished": 3})
    assert len((out / "slurm" / "0002" / "tasks.txt").read_text().split()) == left


def test_script_is_what_was_asked_for(tmp_path: Path):
    asked_for = Slurm(
        partition="long,short",
        account="grains",
        time="1-12:00:00",
        mem="4G",
        ntasks=2,
        cpus_per_task=3,
        array_limit=20,
        modules=["python/3.11"],
    )
    study = tmp_path / "a b' $(x)\n#SBATCH --account=root"
    text = script(asked_for, study, study / "slurm" / "0001", 7)
    lines = text.split("\n")
    assert lines[:3] == [
        "#!/bin/bash -l",
        "#SBATCH --job-name=liftdrag-abxSBATCH--accountroot",
        "#SBATCH --array=1-7%20",
    ]
    command = text.index("exec ")
    options = [line for line in text[:command].split("\n") if line.startswith("#SBATCH")]
    assert options[5:] == [
        "#SBATCH --nodes=1",
        "#SBATCH --partition=long,short",
        "#SBATCH --account=grains",
        "#SBATCH --time=1-12:00:00",
        "#SBATCH --mem=4G",
        "#SBATCH --ntasks=2",
        "#SBATCH --cpus-per-task=3",
    ]
    assert text[:command].endswith("\nmodule load python/3.11\n")
    echo = text[command:].replace("exec", "printf '%s\\0'", 1)
    words = subprocess.run(["bash", "-c", echo], capture_output=True, text=True).stdout
    assert words.split("\0")[3:-1] == [
        str(study),
        "--list",
        str(study / "slurm" / "0001" / "tasks.txt"),
        "--ranks",
        "6",
    ]


@pytest.mark.parametrize(
    "line",
    [
        'partition = "a\\n#SBATCH --uid=0"',
        'partition = "a b"',
        'partition = "-p"',
        'account = "$(id)"',
        'qos = "a;b"',
        'time = "10\\n"',
        'time = "soon"',
        'mem = "4G --wrap=id"',
        "cpus_per_task = 0",
        "cpus_per_task = 1.5",
        'ntasks = "2"',
        "array_limit = -1",
        'modules = ["a\\nrm"]',
        'modules = ["-a"]',
        'modules = ["a;b"]',
        'modules = "python"',
        'output = "/etc/passwd"',
        'wrap = "id"',
    ],
)
def test_what_no_script_may_hold_is_refused(study: str, line: str):
    Path(study).write_text(Path(study).read_text().replace('time = "10"', line))
    with pytest.raises(InputError, match=r"slurm\."):
        read(study)


def test_without_slurm_it_is_said(study: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    out = ["--out", str(tmp_path / "out")]
    done = CliRunner().invoke(app, ["sweep", study, *out, "--slurm"])
    assert isinstance(done.exception, InputError)
    assert "sbatch" in str(done.exception)
    assert not (tmp_path / "out").exists()
    shown = CliRunner().invoke(app, ["sweep", study, *out, "--status"])
    assert shown.exit_code == 0
    assert "missing     │ 3" in shown.output
    refused = CliRunner().invoke(app, ["sweep", study, *out, "--status", "--jobs", "2"])
    assert "--jobs is for runs on this machine" in str(refused.exception)


def test_refusal_of_sbatch_is_told_in_a_line(
    study: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    program(tmp_path / "bin" / "sbatch", "sbatch: error: invalid account", "not there", to=2)
    with (tmp_path / "bin" / "sbatch").open("a") as file:
        file.write("exit 1\n")
    monkeypatch.setenv("PATH", f"{tmp_path / 'bin'}:{os.environ['PATH']}")
    with pytest.raises(RunFailed, match=r"^sbatch refuses: sbatch: error: invalid account not"):
        on_slurm(study, tmp_path / "out")
    assert statuses(study, tmp_path / "out") == {"missing": 3}
