"""The models of the page "Plug your solver in", from the smallest on."""

# ANCHOR: linear
import numpy as np
import scipy.sparse as sp

import arlequin as aq


class Bar(aq.LinearModel):
    def __init__(self, x, k, m):
        self.name, self.mesh, self.k, self.m = "mine", aq.Mesh.line(x), k, m
        self.B = sp.diags_array([-1.0, 1.0], offsets=[0, 1], shape=(len(x) - 1, len(x)))

    def stiffness(self, weight):  # of every element
        return self.B.T @ sp.diags_array(self.k * weight) @ self.B

    def inertia(self, weight):
        return abs(self.B).T @ (self.m / 2 * weight)


# ANCHOR_END: linear


# ANCHOR: run
def couple(mine, pulse):
    bar = aq.FemModel("bar", aq.Mesh.bar(-100.0, 0.0, 10), aq.Elastic(young=1.0, poisson=0.0, density=1.0))
    share = aq.Weights.same(aq.Ramp(aq.Slab(fine=0.0, coarse=-20.0), "cubic"))  # falls from 1 at -20 to 0 at 0
    rest = aq.Weights.complement_of(share)
    if isinstance(mine, aq.Participant):
        fine = aq.Subdomain.participant(mine, rest)
    else:
        fine = aq.Subdomain.fine(mine, rest).with_initial(0 * pulse, pulse)
    tie = aq.Interface("overlap", "bar", "mine", aq.Mesh.bar(-20.0, 0.0, 2))
    return aq.Coupled([aq.Subdomain.coarse(bar, share), fine], [tie], seconds=0.8)


x = np.arange(-20.0, 41.0)
pulse = np.where(abs(x - 20) < 15, np.cos(np.pi * (x - 20) / 30) ** 2, 0.0)
run = couple(Bar(x, k=1.0, m=1.0), pulse)
run.run_until(100.0)
print(f"drift {run.drift:.0e}; largest velocity now in the bar {abs(run.velocity('bar')).max():.2f}")
# ANCHOR_END: run


# ANCHOR: solver
class Stepper(aq.Participant):
    """Stands for a program with a stepping of its own."""

    def __init__(self, bar, v):
        self.name, self.mesh, self.bar = "mine", bar.mesh, bar
        self.q, self.v = 0 * v, v.copy()

    def weigh(self, weights):  # of internal, kinetic and external energy
        self.K = self.bar.stiffness(weights.internal)
        self.M = self.bar.inertia(weights.kinetic)
        return self.M

    def advance(self, time, step):
        self.v = self.v - step / 2 * (self.K @ self.q) / self.M
        self.q = self.q + step * self.v
        self.v = self.v - step / 2 * (self.K @ self.q) / self.M

    def velocities(self):
        return self.v

    def displacements(self):
        return self.q

    def kick(self, impulse):
        self.v = self.v + impulse / self.M

    def accelerations(self):  # optional: smooth first step
        return -(self.K @ self.q) / self.M


# ANCHOR_END: solver
again = couple(Stepper(Bar(x, 1.0, 1.0), pulse), pulse)
again.run(run.steps)
assert abs(again.velocity("mine") - run.velocity("mine")).max() < 1e-12
assert run.drift < 1e-12

# ANCHOR: check
print(aq.conformance.check(Bar(x, 1.0, 1.0)))
print(aq.conformance.check(Stepper(Bar(x, 1.0, 1.0), pulse), step=0.8))
# ANCHOR_END: check
