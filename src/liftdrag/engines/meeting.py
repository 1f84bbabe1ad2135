"""Where the ranks of an MPI job meet: a file in the folder that they were started in.

A program reads its deck on its first rank alone, but opens the deck's files on all. So the
ranks of liftdrag wait here until the first has made the run's folder, go there, and become
the program.
"""

from __future__ import annotations

import contextlib
import json
import os
import time
from pathlib import Path

from liftdrag.errors import InputError

POLL_S = 0.1

GRACE_S = 3.0
"""Time for the others to hear that there is nothing to run."""

RECENT_S = 60.0
"""Age at which the file is of another job, which ended before it could tidy up."""


def place() -> Path:
    """The file of this job, by what its launcher calls it, or by the launcher's own process.

    The latter is of one node: MPICH's mpiexec without Slurm names its jobs no better.
    """
    slurm = "-".join(os.environ.get(name, "") for name in ("SLURM_JOB_ID", "SLURM_STEP_ID"))
    job = os.environ.get("PMIX_NAMESPACE") or slurm.strip("-") or str(os.getppid())
    safe = "".join(letter if letter.isalnum() else "-" for letter in job)
    return Path.cwd() / f".liftdrag-{safe}"


def check() -> None:
    """Raise InputError when the ranks cannot meet."""
    try:
        place().with_suffix(".check").touch()
        place().with_suffix(".check").unlink()
    except OSError as error:
        raise InputError(
            f"The folder {Path.cwd()} cannot be written ({error.strerror}), and the ranks of the "
            "MPI job have to meet in it; start liftdrag in another."
        ) from None


def dismiss() -> None:
    """Send the waiting ranks home."""
    with contextlib.suppress(OSError):
        announce(None)
    time.sleep(GRACE_S)
    end()


def announce(folder: Path | None) -> None:
    """Tell the waiting ranks where to go."""
    beside = place().with_suffix(".part")
    beside.write_text(json.dumps(None if folder is None else str(folder)), "utf-8")
    beside.replace(place())


def wait() -> Path | None:
    """The folder to go to, once it is announced; None when there is nothing to run."""
    since = time.time() - RECENT_S
    while True:
        try:
            if place().stat().st_mtime >= since:
                folder = json.loads(place().read_text("utf-8"))
                return None if folder is None else Path(folder)
        except FileNotFoundError:
            pass
        time.sleep(POLL_S)


def end() -> None:
    """Tidy up, when all ranks have been seen to run."""
    place().unlink(missing_ok=True)
