"""Start a program, watch it, and stop it with everything that it started."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
from collections.abc import Callable, Mapping
from pathlib import Path

POLL_S = 0.2


def watch(
    command: list[str],
    folder: Path,
    environment: Mapping[str, str],
    poll: Callable[[], None],
    errors: str,
    own_group: bool = True,
) -> int:
    """Run `command` in `folder`, calling `poll` until it ends; its exit status.

    What it says on standard output and error goes to the file `errors`. An
    exception, Ctrl-C among them, ends the whole process group first.
    """
    with (folder / errors).open("wb") as sink:
        process = subprocess.Popen(
            command,
            cwd=folder,
            env=dict(environment),
            stdin=subprocess.DEVNULL,
            stdout=sink,
            stderr=subprocess.STDOUT,
            start_new_session=own_group,
            close_fds=own_group,
        )
        try:
            return _wait(process, poll)
        finally:
            stop(process, own_group)


def _wait(process: subprocess.Popen[bytes], poll: Callable[[], None]) -> int:
    while True:
        try:
            return process.wait(POLL_S)
        except subprocess.TimeoutExpired:
            poll()


def stop(process: subprocess.Popen[bytes], own_group: bool) -> None:
    """End a process and, when it leads its own group, the group: politely, then firmly."""
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
