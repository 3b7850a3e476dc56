"""A bar of LAMMPS particles as the fine participant of our finite elements, in one Python process.

The bar is that of `lammps_springs.py`, LAMMPS as it is. `mpiexec -n 2 python lammps_bar.py` shares its particles between two
processes, each of which has the whole coarse model.
"""

import sys

import numpy as np
from lammps_springs import Springs

import arlequin as aq


class LammpsBar(Springs, aq.Participant):
    """The bar with the shape functions of a line."""

    name, kind = "particles", "lammps"

    def __init__(self, x, spring, mass, velocity, own_steps=1):
        super().__init__(x, spring, mass, velocity, own_steps)
        self.mesh = aq.Mesh.line(x)

    def weigh(self, weights):
        return self.share(weights.internal, weights.kinetic)


X = np.arange(-20.0, 41.0)
# Small enough that no particle passes another: between those the springs of LAMMPS are linear.
PULSE = np.where(abs(X - 20) < 15, 1e-2 * np.cos(np.pi * (X - 20) / 30) ** 2, 0.0)


def couple(fine, own_steps=1):
    """A coarse bar of ours from -100 to 0, and particles from -20 on: LAMMPS, a model of ours, or what makes a subdomain."""
    share = aq.Weights.same(aq.Ramp(aq.Slab(fine=0.0, coarse=-20.0), "cubic", 1e-3))
    rest = aq.Weights.complement_of(share)
    bar = aq.FemModel("bar", aq.Mesh.bar(-100.0, 0.0, 10), aq.Elastic(1.0, 0.0, 1.0))
    if isinstance(fine, aq.Participant):
        right = aq.Subdomain.participant(fine, rest)
    elif callable(fine):
        right = fine(rest)
    else:
        right = aq.Subdomain.fine(fine, rest).with_initial(0 * PULSE, PULSE).with_step(ratio=own_steps)
    tie = aq.Interface("overlap", "bar", right.name, aq.Mesh.bar(-20.0, 0.0, 2))
    return aq.Coupled([aq.Subdomain.coarse(bar, share), right], [tie], seconds=0.5 * own_steps)


def beside_ours(theirs, how, steps, own_steps=1):
    """Drift of a run, and how far its velocities are from those with a chain of ours after so many steps."""
    ours = couple(aq.ChainModel("particles", -20.0, 1.0, 60, 1.0, 1.0), own_steps)
    for run in (theirs, ours):
        run.run(steps)
    gap = max(abs(theirs.velocity(n) - ours.velocity(n)).max() for n in ours.names)
    print(f"{steps} steps {how}: drift {theirs.drift:.1e}, apart from our chain by {gap:.1e}")
    return theirs.drift, gap


def main(own_steps=1, steps=10_000):
    bar = LammpsBar(X, 1.0, 1.0, PULSE, own_steps)
    how = f"of {own_steps} own ones with {bar.lmp.extract_setting('world_size')} processes"
    return beside_ours(couple(bar, own_steps), how, steps, own_steps)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
