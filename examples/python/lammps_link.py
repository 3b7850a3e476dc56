"""The LAMMPS bar of `lammps_bar.py` in a process of its own: the run starts this file once more, with `serve`.

LAMMPS then shares neither memory nor licence with the run; a round trip costs some microseconds.
"""

import pathlib
import sys

import lammps_bar

HERE = pathlib.Path(__file__).resolve()
sys.path.append(str(HERE.parents[2] / "apps" / "link" / "clients" / "python"))


def serve():
    import arlequin_link
    from lammps_ranks import Bar

    arlequin_link.serve(Bar(lammps_bar.X, 1.0, 1.0, lammps_bar.PULSE))


def main(steps=10_000):
    import arlequin as aq

    def there(weights):
        return aq.Subdomain.remote("particles", [sys.executable, str(HERE), "serve"], weights, timeout=20.0)

    return lammps_bar.beside_ours(lammps_bar.couple(there), "behind a socket", steps)


if __name__ == "__main__":
    serve() if sys.argv[1:] == ["serve"] else main(*map(int, sys.argv[1:]))
