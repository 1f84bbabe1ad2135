"""A run's folder is one liftdrag's at a time, and what is written there is whole or not there."""

from __future__ import annotations

import errno
import json
import os
import subprocess
import sys
import time
from math import inf
from pathlib import Path

import pytest
from conftest import tiny_tank

from liftdrag.cost import disk
from liftdrag.errors import InputError, RunFailed
from liftdrag.folder import claimed, fresh, write_json
from liftdrag.lock import LOCK, held
from liftdrag.runner import run

HOLD = """
import subprocess, sys, time
from math import inf
from pathlib import Path
from liftdrag import lock
from liftdrag.engines import process
folder = Path(sys.argv[1])
with lock.held(folder):
    if "engine" in sys.argv:
        command = ["sh", "-c", "trap '' TERM; echo; exec sleep 1.5"]
        process.start(command, folder, {}, "said")
    print("held", flush=True)
    time.sleep(60)
"""


def holder(folder: Path, *words: str) -> subprocess.Popen[str]:
    """Another process that holds the folder by now."""
    command = [sys.executable, "-c", HOLD, str(folder), *words]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stdout.readline() == "held\n"
    return process


def test_a_second_liftdrag_is_refused_and_told_who_is_there(tmp_path):
    with holder(tmp_path) as process:
        for start in (lambda: fresh(tmp_path, ""), lambda: held(tmp_path).__enter__()):
            with pytest.raises(InputError) as caught:
                start()
            said = str(caught.value)
            assert f"in use by process {process.pid} on {os.uname().nodename} since 20" in said
            assert len(said.splitlines()) == 1
        with pytest.raises(InputError, match=f"in use by process {process.pid}"):
            run(tiny_tank(), tmp_path)
        assert [entry.name for entry in tmp_path.iterdir()] == [LOCK]
        process.kill()


def test_the_lock_of_a_dead_holder_is_free(tmp_path):
    with holder(tmp_path) as process:
        process.kill()
        process.wait()
        with claimed(tmp_path, "") as folder:
            assert f"process {os.getpid()} on" in (folder / LOCK).read_text()


def test_an_engine_that_outlives_liftdrag_keeps_the_folder_until_it_ends(tmp_path):
    with holder(tmp_path, "engine") as process:
        while (tmp_path / "said").read_bytes() != b"\n":
            time.sleep(0.01)
        process.kill()
        process.wait()
        begin = time.monotonic()
        with held(tmp_path):
            waited = time.monotonic() - begin
        assert waited > 0.2


@pytest.mark.parametrize(
    ("code", "status", "words"),
    [
        (errno.ENOSPC, "disk_full", "No space left on device"),
        (errno.EDQUOT, "disk_full", "Disk quota exceeded"),
        (errno.EROFS, "engine_error", "Read-only file system"),
    ],
)
@pytest.mark.parametrize("call", ["fsync", "replace"])
def test_a_write_that_fails_leaves_the_file_that_was(call, code, status, words, tmp_path, patched):
    file = tmp_path / "result.json"
    write_json(file, {"status": "killed"})
    patched(call, code)
    with pytest.raises(RunFailed) as caught:
        write_json(file, {"status": "finished"})
    assert caught.value.status == status
    assert str(caught.value) == f"{file} cannot be written: {words}."
    assert json.loads(file.read_text()) == {"status": "killed"}


@pytest.fixture
def patched(monkeypatch):
    """A function that makes a call of the system fail."""

    def patch(name: str, code: int) -> None:
        def fail(*_):
            raise OSError(code, os.strerror(code))

        monkeypatch.setattr(*((os, name) if name == "fsync" else (Path, name)), fail)

    return patch


def test_what_is_written_and_its_name_are_on_the_disk(tmp_path, monkeypatch):
    """The file before it is renamed, and its folder after."""
    synced = list[str]()
    real = os.fsync

    def fsync(number: int) -> None:
        synced.append(Path(f"/proc/self/fd/{number}").readlink().name)
        real(number)

    monkeypatch.setattr(os, "fsync", fsync)
    write_json(tmp_path / "result.json", {})
    assert synced == ["result.part", tmp_path.name]


def test_a_full_disk_is_one_sentence_of_status_disk_full(small_disk, monkeypatch):
    """A megabyte that others fill once the run was let begin."""
    monkeypatch.setattr(disk, "free", lambda _place: inf)
    (small_disk / "other").write_bytes(bytes(1_000_000))
    with pytest.raises(RunFailed) as caught:
        run(tiny_tank(), small_disk / "out")
    assert caught.value.status == "disk_full"
    assert "cannot be written: No space left on device." in str(caught.value)
    assert not (small_disk / "out" / "result.json").exists()


@pytest.fixture
def small_disk(tmp_path: Path):
    """A file system of a megabyte, where one may be mounted."""
    made = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=1m", "liftdrag", str(tmp_path)],
        capture_output=True,
        check=False,
    )
    if made.returncode:
        pytest.skip("no file system can be mounted here")
    yield tmp_path
    subprocess.run(["umount", "--lazy", str(tmp_path)], check=True)
