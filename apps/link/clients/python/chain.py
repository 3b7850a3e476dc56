"""Masses and springs along x, with velocity Verlet of their own, as the fine side of a run: `python3 chain.py [address]`."""
import sys

import numpy as np

from arlequin_link import Solver, serve


class Chain(Solver):
    name, kind, components, shape = "chain", "python-chain", 1, "line"

    def __init__(self, start, spacing, bonds, mass, stiffness):
        self.nodes = np.zeros((bonds + 1, 3))
        self.nodes[:, 0] = start + spacing * np.arange(bonds + 1)
        self.cells = np.column_stack([np.arange(bonds), np.arange(1, bonds + 1)])
        self.bond_mass, self.stiffness, self.step = mass, stiffness, 0.0
        self.q, self.v = np.zeros(bonds + 1), np.zeros(bonds + 1)

    def weigh(self, weights):
        bonds = self.nodes[self.cells]
        self.k = self.stiffness * weights.internal.mean(bonds)
        half = 0.5 * self.bond_mass * weights.kinetic.mean(bonds)
        self.m = np.zeros(len(self.q))
        self.m[:-1] += half
        self.m[1:] += half
        self.find_forces()
        # 2/omega: of an inner spring between two masses at least.
        self.critical_step = np.sqrt(self.bond_mass / self.stiffness)
        return self.m

    def find_forces(self):
        tension = self.k * np.diff(self.q)
        self.f = np.zeros(len(self.q))
        self.f[:-1] += tension
        self.f[1:] -= tension

    def advance(self, time, step):
        self.v += 0.5 * step * self.f / self.m
        self.q += step * self.v
        self.find_forces()
        self.v += 0.5 * step * self.f / self.m
        self.step = step

    def velocities(self):
        return self.v

    def displacements(self):
        return self.q

    def accelerations(self):
        return self.f / self.m

    def kick(self, impulse):
        self.v += impulse / self.m

    def invariant(self):
        """What velocity Verlet keeps at whole steps."""
        kinetic = 0.5 * self.m @ self.v**2 + 0.5 * self.k @ np.diff(self.q) ** 2
        return kinetic - 0.125 * self.step**2 * (self.f / self.m) @ self.f

    def save(self):
        return np.concatenate([self.q, self.v, [self.step]])

    def restore(self, numbers):
        n = len(self.q)
        self.q, self.v, self.step = numbers[:n].copy(), numbers[n : 2 * n].copy(), numbers[-1]
        self.find_forces()


if __name__ == "__main__":
    serve(Chain(-20.0, 1.0, 60, 1.0, 1.0), *sys.argv[1:])
