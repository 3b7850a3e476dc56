"""The bar of `lammps_springs.py` behind a link, in a process of its own or in several: the fine side of any run of ours.

    command = ["mpiexec", "-n", "2", "python3", "lammps_ranks.py"]

starts it from a scene. Its first process talks to the run and hands what it hears to the others. Needs arlequin_link.py.
"""

import ctypes
import os

import numpy as np
from arlequin_link import Link, Solver, serve
from lammps_springs import Springs

mpi = ctypes.CDLL("libmpi.so.12")  # loaded by now
BYTE, WORLD = 0x4C00010D, 0x44000000  # of MPICH


class Shared(Link):
    """A link of which every process hears the same, and the first one speaks."""

    def __init__(self, rank):
        self.rank = rank
        if rank == 0:
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


class Bar(Springs, Solver):
    """The bar as a link describes it."""

    name, kind, components, shape = "particles", "lammps", 1, "line"

    def __init__(self, x, spring, mass, velocity):
        super().__init__(x, spring, mass, velocity)
        n = len(x)
        self.nodes, self.critical_step = self.rest, np.sqrt(mass / spring)
        self.cells = np.column_stack([np.arange(n - 1), np.arange(1, n)])

    def weigh(self, weights):
        bonds = self.nodes[self.cells]
        return self.share(weights.internal.mean(bonds), weights.kinetic.mean(bonds))


if __name__ == "__main__":
    x = np.arange(-20.0, 41.0)
    bar = Bar(x, 1.0, 1.0, 0 * x)
    serve(bar, link=Shared(bar.lmp.extract_setting("world_rank")))
