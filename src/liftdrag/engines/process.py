"""Start a program, watch it, and stop it with everything that it started."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from liftdrag import lock
from liftdrag.errors import RunFailed

POLL_S = 0.2
REAP_S = 0.01
_PR_SET_PDEATHSIG = 1


@dataclass(frozen=True)
class Started:
    """A running program, and whether it leads a process group of its own."""

    process: subprocess.Popen[bytes]
    own_group: bool


@dataclass(frozen=True)
class Ended:
    """How a program ended: its exit status, and the processor time (s) of it and its children."""

    code: int
    cpu_s: float


def start(
    command: list[str],
    folder: Path,
    environment: Mapping[str, str],
    says: str,
    own_group: bool = True,
) -> Started:
    """Start `command` in `folder`; what it says goes to the file `says`.

    Without `own_group` it shares this process's group and open files, as a rank
    of the MPI job that started this process must. Raises RunFailed.
    """
    try:
        with (folder / says).open("wb") as sink:
            process = subprocess.Popen(
                command,
                cwd=folder,
                env=dict(environment),
                stdin=subprocess.DEVNULL,
                stdout=sink,
                stderr=subprocess.STDOUT,
                start_new_session=own_group,
                close_fds=own_group,
                pass_fds=lock.descriptors() if own_group else (),
                preexec_fn=_end_with_parent,
            )
    except OSError as error:
        raise RunFailed("engine_error", f"the engine did not start: {error}") from None
    return Started(process, own_group)


def _end_with_parent() -> None:
    """Ask Linux to end this process when the one that started it ends, however it ends."""
    if sys.platform == "linux":
        import ctypes

        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)


def watch(started: Started, folder: Path, poll: Callable[[], None]) -> Ended:
    """Call `poll` until the program ends; how it did.

    An exception, Ctrl-C among them, ends the whole process group first. Raises
    RunFailed when the folder vanishes.
    """
    try:
        while (ended := _reaped(started.process)) is None:
            _look(folder, poll)
        return ended
    finally:
        stop(started)


def _reaped(process: subprocess.Popen[bytes]) -> Ended | None:
    """How the program ended within the time of a poll, None when it has not.

    A system that is told to ignore the end of children does not say how they did.
    """
    until = time.monotonic() + POLL_S
    while time.monotonic() < until:
        try:
            pid, status, used = os.wait4(process.pid, os.WNOHANG)
        except ChildProcessError:
            return Ended(process.wait(), 0.0)
        if pid:
            process.returncode = os.waitstatus_to_exitcode(status)
            return Ended(process.returncode, used.ru_utime + used.ru_stime)
        time.sleep(REAP_S)
    return None


def _look(folder: Path, poll: Callable[[], None]) -> None:
    if not folder.is_dir():
        raise RunFailed("engine_error", f"the folder {folder} vanished during the run")
    poll()


def stop(started: Started) -> None:
    """End a program and, when it leads its own group, the group: politely, then firmly."""
    process, own_group = started.process, started.own_group
    for signal_number, patience in ((signal.SIGTERM, 3.0), (signal.SIGKILL, 3.0)):
        if process.poll() is not None:
            break
        _send(process.pid, signal_number, own_group)
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(patience)
    if own_group:
        _send(process.pid, signal.SIGKILL, own_group)


def _send(pid: int, signal_number: int, own_group: bool) -> None:
    with contextlib.suppress(ProcessLookupError, PermissionError):
        (os.killpg if own_group else os.kill)(pid, signal_number)
