"""The LAMMPS bar of `lammps_bar.py` in a process of its own: the run starts this file once more, with `serve`.

LAMMPS then shares neither memory nor licence with the run; a round trip costs some microseconds.
"""

import pathlib
import sys
from types import SimpleNamespace

import numpy as np

import lammps_bar

HERE = pathlib.Path(__file__).resolve()
sys.path.append(str(HERE.parents[2] / "arlequin-link" / "clients" / "python"))


def serve():
    from arlequin_link import Solver
    from arlequin_link import serve as answer

    class Behind(Solver):
        name, kind, components, shape = "particles", "lammps", 1, "line"

        def __init__(self):
            x, n = lammps_bar.X, len(lammps_bar.X)
            self.bar = bar = lammps_bar.LammpsBar(x, 1.0, 1.0, lammps_bar.PULSE)
            self.nodes = np.column_stack([x, 0 * x, 0 * x])
            self.cells = np.column_stack([np.arange(n - 1), np.arange(1, n)])
            self.advance, self.velocities, self.displacements = bar.advance, bar.velocities, bar.displacements
            self.kick, self.accelerations, self.invariant = bar.kick, bar.accelerations, bar.invariant

        def weigh(self, weights):
            bonds = self.nodes[self.cells]
            shares = SimpleNamespace(internal=weights.internal.mean(bonds), kinetic=weights.kinetic.mean(bonds))
            return self.bar.weigh(shares)

    answer(Behind())


def main(steps=10_000):
    import arlequin as aq

    def there(weights):
        return aq.Subdomain.remote("particles", [sys.executable, str(HERE), "serve"], weights, timeout=20.0)

    theirs = lammps_bar.couple(there)
    ours = lammps_bar.couple(aq.ChainModel("particles", -20.0, 1.0, 60, 1.0, 1.0))
    for run in (theirs, ours):
        run.run(steps)
    gap = max(abs(theirs.velocity(n) - ours.velocity(n)).max() for n in ours.names)
    print(f"{steps} steps behind a socket: drift {theirs.drift:.1e}, apart from our chain by {gap:.1e}")
    return theirs.drift, gap


if __name__ == "__main__":
    serve() if sys.argv[1:] == ["serve"] else main(*map(int, sys.argv[1:]))
