"""Where the ranks of a job meet: the file's name, its message, and its end."""

from __future__ import annotations

import os
import threading
from pathlib import Path

import pytest

from liftdrag.engines import meeting
from liftdrag.errors import InputError


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working folder, and no job around."""
    for name in ("PMIX_NAMESPACE", "SLURM_JOB_ID", "SLURM_STEP_ID"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(meeting, "GRACE_S", 0.0)
    return tmp_path


@pytest.mark.parametrize(
    ("environment", "name"),
    [
        ({"PMIX_NAMESPACE": "n.1/2"}, ".liftdrag-n-1-2"),
        ({"PMIX_NAMESPACE": "n", "SLURM_JOB_ID": "7", "SLURM_STEP_ID": "0"}, ".liftdrag-n"),
        ({"SLURM_JOB_ID": "7", "SLURM_STEP_ID": "0"}, ".liftdrag-7-0"),
        ({}, f".liftdrag-{os.getppid()}"),
    ],
)
def test_file_is_named_after_the_job(environment, name, here, monkeypatch):
    for key, value in environment.items():
        monkeypatch.setenv(key, value)
    assert meeting.place() == here / name


def test_waiting_rank_hears_of_the_folder(here):
    heard: list[Path | None] = []
    waiting = threading.Thread(target=lambda: heard.append(meeting.wait()))
    waiting.start()
    meeting.announce(here / "run")
    waiting.join(5.0)
    assert heard == [here / "run"]


def test_waiting_rank_is_sent_home(here):
    meeting.announce(None)
    assert meeting.wait() is None
    meeting.dismiss()
    assert list(here.iterdir()) == []


def test_message_of_an_earlier_job_is_not_heard(here, monkeypatch):
    meeting.announce(here / "old")
    long_ago = meeting.place().stat().st_mtime - 2.0 * meeting.RECENT_S
    os.utime(meeting.place(), (long_ago, long_ago))
    monkeypatch.setattr(meeting.time, "sleep", lambda _: meeting.announce(here / "new"))
    assert meeting.wait() == here / "new"


def test_folder_that_cannot_be_written_is_refused(monkeypatch):
    monkeypatch.chdir("/proc")
    with pytest.raises(InputError, match="cannot be written"):
        meeting.check()
