"""The sheared cell of `gas` in LAMMPS: a box that deforms, and its own granular contacts."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
from gas import EVERY, Gas

from liftdrag.engines import mpi

DECK = """
units           lj
atom_style      sphere
atom_modify     map array
newton          off
comm_modify     vel yes
read_data       grains.data
pair_style      granular
pair_coeff      * * hertz/material {modulus} {restitution} 0.0 &
                tangential linear_nohistory 0.0 0.0 damping coeff_restitution
neighbor        0.2 bin
neigh_modify    every 1 delay 0 check yes
timestep        {time_step}
fix             move all nve/sphere
fix             shear all deform 1 xy erate 1.0 remap v flip yes
compute         own all temp/deform
compute         stress all pressure own
fix             rows all ave/time 1 {every} {every} c_own[*] c_stress[*] file rows.txt &
                format " %.12g"
thermo          {every}
thermo_style    custom step temp pxy xy
run             {steps}
"""
"""`erate` is over the height at the start; velocities change with the image (`remap v`)."""


def rows(gas: Gas, strain: float, folder: Path, every: float = EVERY, seed: int = 1) -> np.ndarray:
    """As `Gas.rows`, from the same grains at the same velocities."""
    steps = round(every / gas.time_step)
    (folder / "grains.data").write_text(_grains(gas, seed))
    deck = DECK.format(
        modulus=gas.modulus,
        restitution=gas.restitution,
        time_step=gas.time_step,
        every=steps,
        steps=round(strain / every) * steps,
    )
    (folder / "in.gas").write_text(deck)
    child = [sys.executable, "-m", "liftdrag.engines.lammps_child", str(folder), "in.gas"]
    subprocess.run(child, check=True, env=mpi.outside(dict(os.environ)))
    found = np.loadtxt(folder / "rows.txt", ndmin=2)
    kinetic = _tensor(found[:, 1:7]) / gas.cell.volume
    return np.stack([kinetic, _tensor(found[:, 7:13]) - kinetic], axis=1) * np.pi / 6.0


def _tensor(parts: np.ndarray) -> np.ndarray:
    """Of xx, yy, zz, xy, xz and yz (n, 6), the whole (n, 3, 3)."""
    return parts[:, [[0, 3, 4], [3, 1, 5], [4, 5, 2]]]


def _grains(gas: Gas, seed: int) -> str:
    """The grains in the words of LAMMPS, whose mean flow is at rest at the bottom.

    Its box is deformed at the end of a step, after the forces: here it is a step ahead.
    """
    grains, side = gas.start(seed), gas.cell.size[0]
    velocity = grains.velocity + np.array([0.5 * side, 0.0, 0.0])
    ahead = side * gas.time_step
    sides = "".join(f"0 {side:.16g} {a}lo {a}hi\n" for a in "xyz")
    head = f"# spheres\n\n{gas.count} atoms\n1 atom types\n{sides}{ahead:.16g} 0 0 xy xz yz\n"
    places = (
        f"{i} 1 1.0 {6.0 / np.pi:.16g} {x:.16g} {y:.16g} {z:.16g}\n"
        for i, (x, y, z) in enumerate(grains.position, start=1)
    )
    speeds = (
        f"{i} {x:.16g} {y:.16g} {z:.16g} 0 0 0\n" for i, (x, y, z) in enumerate(velocity, start=1)
    )
    return f"{head}\nAtoms # sphere\n\n{''.join(places)}\nVelocities\n\n{''.join(speeds)}"
