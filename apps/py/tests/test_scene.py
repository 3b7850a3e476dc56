"""Scenes from Python: results as arrays, mistakes by name, Ctrl-C."""

import json
import os
import pathlib
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest

import arlequin
from arlequin import Scene, errors
from codes import raises

SCENES = pathlib.Path(__file__).parents[3] / "examples" / "scenes"

BAR = """
title = "A bar"
[model.bar]
kind = "fem"
shape.bar = { from = 0.0, to = 1.0, section = 1e-4 }
spacing = 0.01
material = { young = 210e9, density = 7800.0 }
[[support]]
model = "bar"
where = "x-min"
[[load]]
model = "bar"
where = "x-max"
force = [1e3, 0.0, 0.0]
time = "step"
[time]
end = 3.854e-4
[probe.tip]
model = "bar"
where = "x-max"
component = "x"
[probe.speed]
model = "bar"
where = "x-max"
quantity = "velocity"
component = "x"
"""


@pytest.fixture(scope="module")
def bar():
    return Scene.from_text(BAR)


@pytest.fixture(scope="module")
def run(bar):
    return bar.run(frames=4)


def test_a_scene_gives_the_tip_of_a_pulled_bar(run):
    tip = run.probes["tip"]
    assert abs(tip.u[-1] / (2e3 / 2.1e7) - 1) < 0.02
    assert (tip.quantity, tip.unit, tip.symbol) == ("displacement", "m", "u")
    assert len(tip.t) == len(tip.u) == run.summary.steps + 1
    # Velocity Verlet: velocities are central differences of displacements.
    slope = (tip.u[2:] - tip.u[:-2]) / (tip.t[2:] - tip.t[:-2])
    assert abs(slope - run.probes["speed"].v[1:-1]).max() < 1e-12 * abs(slope).max()


def test_the_energy_is_a_table_of_columns(run):
    energy = run.energy
    assert energy.H is energy["invariant [J]"] is energy["invariant"]
    assert np.allclose(energy.total, energy.kinetic + energy.internal, rtol=1e-14)
    assert abs(energy.relative_drift).max() < 1e-12
    assert run.summary.energy.h_drift_max < 1e-12


def test_frames_are_the_states_of_the_run(run):
    assert len(run.times) == 5 and run.times[0] == 0.0
    last = run.fields()
    assert abs(last.time - run.summary.time) < 1e-15
    u = last["bar"]["displacement"]
    assert u.shape == (101, 3) and u[-1, 0] == run.probes["tip"].u[-1]
    assert abs(run.fields(1e-4).time - 1e-4) < 0.5 * run.summary.time / 4
    grid = run.grids["bar"]
    assert grid.points.shape == (101, 3) and grid.cells.shape == (100, 2) and grid.cell_type == 3
    # The stress behind the front of a sudden force is that force over the section.
    assert abs(run.fields(1e-4)["bar"]["von Mises stress"][-10] / 1e7 - 1) < 0.2


def test_changes_are_values_of_any_kind(bar):
    other = bar.changed(**{"load.0.force": np.array([2e3, 0.0, 0.0]), "time.end": 1e-4, "model.bar.spacing": 0.02})
    assert len(other.changes) == 3
    assert other.run().summary.time >= 1e-4
    assert Scene.from_text(BAR, **{"title": 'a "new" one'}).title == 'a "new" one'


def test_check_plans_and_runs_nothing(bar):
    plan = bar.check()
    assert plan.models[0].unknowns == 101 and plan.steps > 100
    assert "dt" in plan._repr_html_()


def test_a_results_folder_is_what_the_command_line_writes(bar, tmp_path):
    source = tmp_path / "bar.toml"
    source.write_text(BAR)
    done = Scene(source).run(out=tmp_path / "out")
    assert done.folder == tmp_path / "out"
    told = json.loads((done.folder / "summary.json").read_text())
    assert told["energy"] == done.summary["energy"]
    table = np.genfromtxt(done.folder / "probes.csv", delimiter=",", names=True, deletechars="")
    assert np.array_equal(table["tip_displacement_[m]"], done.probes["tip"].u)
    with raises("Exists", match="--force"):
        Scene(source).run(out=tmp_path / "out")
    Scene(source).run(out=tmp_path / "out", force=True)
    with raises("Checkpoint", match="has a run that has ended"):
        arlequin.resume(tmp_path / "out")


def test_mistakes_are_exceptions_with_name_key_and_line(tmp_path):
    wrong = BAR.replace("young = 210e9", "young = -1.0")
    with pytest.raises(errors.InputError) as caught:
        Scene.from_text(wrong).check()
    assert isinstance(caught.value, ValueError)
    assert caught.value.key.startswith("model.bar") and caught.value.line is not None
    with raises("Syntax", match="scene:4"):
        Scene.from_text(BAR.replace("kind", "kynd"))
    with raises("Set", match="time.end"):
        Scene.from_text(BAR, **{"time.end": "soon"})
    with raises("Read", match="check the path"):
        Scene(tmp_path / "none.toml")
    with raises("Value", match="no value of a scene"):
        Scene.from_text(BAR, title=object())
    with pytest.raises(KeyError, match="tip"):
        Scene.from_text(BAR, **{"time.end": 1e-5}).run().probes["top"]
    with pytest.raises(AttributeError, match="ask for 'u'"):
        Scene.from_text(BAR, **{"time.end": 1e-5}).run().probes["tip"].v
    with raises("Key", match="error or time"):
        Scene.from_text(BAR).suggest()


def test_failures_of_a_run_have_their_own_names(bar):
    with raises("UnstableStep") as caught:
        bar.changed(**{"time.step": {"seconds": 1e-3}, "time.end": 1e-2}).run()
    assert "critical step" in str(caught.value)


def test_ctrl_c_ends_a_run_at_once_and_keeps_what_was_computed(bar):
    long = bar.changed(**{"time.end": 10.0})
    threading.Timer(0.3, lambda: os.kill(os.getpid(), signal.SIGINT)).start()
    begin = time.monotonic()
    with pytest.raises(KeyboardInterrupt) as caught:
        long.run(frames=0)
    assert time.monotonic() - begin < 5.0
    part = caught.value.run
    assert part.summary.status == "interrupted" and 0 < part.summary.steps
    assert len(part.probes["tip"].u) == part.summary.steps + 1


@pytest.mark.parametrize("count", [0, 10**6])
def test_threads_are_bounded_by_the_machine(count):
    with raises("InvalidParameter", match=f"threads = {count}: must be from 1 to"):
        arlequin.set_threads(count)


def test_the_variable_for_threads_is_bounded_by_the_machine():
    code = "import warnings; warnings.simplefilter('error'); import arlequin"
    env = {**os.environ, "RAYON_NUM_THREADS": "1000000"}
    done = subprocess.run([sys.executable, "-c", code], env=env, capture_output=True, text=True, timeout=60)
    assert "RAYON_NUM_THREADS = 1000000" in done.stderr and "cores of this machine" in done.stderr
    if pathlib.Path("/proc/self/task").exists():
        code = "import arlequin, os; print(len(os.listdir('/proc/self/task')))"
        call = [sys.executable, "-W", "ignore", "-c", code]
        done = subprocess.run(call, env=env, capture_output=True, text=True, timeout=60)
        assert 1 < int(done.stdout) < 100 + 8 * (os.cpu_count() or 1), done.stderr


def test_other_threads_go_on_while_a_scene_runs(bar):
    count, stop = [0], threading.Event()

    def busy():
        while not stop.is_set():
            count[0] += 1
            time.sleep(1e-3)

    thread = threading.Thread(target=busy)
    thread.start()
    begin = time.monotonic()
    bar.changed(**{"time.end": 3e-2}).run(frames=0)
    taken = time.monotonic() - begin
    stop.set()
    thread.join()
    assert count[0] > 50 * taken, f"{count[0]} turns in {taken:.2f} s"


def test_progress_and_warnings_reach_python(bar):
    class Heard(arlequin.Progress):
        steps, warned = [], []

        def step(self, done, planned):
            self.steps.append((done, planned))

        def warning(self, text):
            self.warned.append(text)

    done = bar.changed(**{"time.end": 0.5, "load.0.force": [1e9, 0.0, 0.0]}).run(progress=Heard(), frames=0)
    assert Heard.steps and all(d <= p == done.summary.steps for d, p in Heard.steps)
    assert Heard.warned == done.warnings and Heard.warned


def test_an_exception_of_a_listener_ends_the_run(bar):
    class Tired(arlequin.Progress):
        def step(self, done, planned):
            raise RuntimeError("enough")

    with pytest.raises(RuntimeError, match="enough"):
        bar.changed(**{"time.end": 10.0}).run(progress=Tired(), frames=0)


def test_notebooks_show_tables(run):
    page = run._repr_html_()
    assert "<table>" in page and "tip" in page and "A bar" in page
    assert "kinetic" in run.energy._repr_html_()
    assert "tip" in repr(run)


def test_a_mesh_of_pyvista_has_the_fields(run):
    pyvista = pytest.importorskip("pyvista")
    mesh = run.mesh("bar")
    assert isinstance(mesh, pyvista.UnstructuredGrid) and mesh.n_cells == 100
    assert mesh.point_data["displacement [m]"].shape == (101, 3)
    assert (mesh.celltypes == pyvista.CellType.LINE).all()
    # Moved by its displacements, as its own documentation does.
    tip = mesh.warp_by_vector("displacement [m]").points[-1, 0]
    assert abs(tip - 1.0 - run.probes["tip"].u[-1]) < 1e-7
    early, late = (run.mesh("bar", t)["displacement [m]"] for t in run.times[1:3])
    assert (early != late).any()


def test_meshes_of_solids_and_particles_fill_their_bodies():
    pyvista = pytest.importorskip("pyvista")
    scene = Scene(SCENES / "dem-fem-beam.toml", **{"time.end": 1e-7})
    run = scene.run(frames=1)
    kinds = {n: {int(k) for k in run.mesh(n).celltypes} for n in run.grids}
    solid = {pyvista.CellType.TETRA, pyvista.CellType.HEXAHEDRON}
    filled = [n for n, k in kinds.items() if k <= solid]
    assert filled and len(filled) < len(kinds), kinds
    for name, model in run.grids.items():
        mesh = run.mesh(name)
        assert np.array_equal(mesh.points, model.points.astype(mesh.points.dtype))
        if name in filled:
            length = np.ptp(model.points[:, 0])
            assert abs(mesh.volume / (np.pi * 1e-3**2 * length) - 1) < 1e-6, "a rod of 2 mm"


def test_probes_are_drawn_where_matplotlib_is(run):
    matplotlib = pytest.importorskip("matplotlib")
    matplotlib.use("Agg")
    assert len(run.plot().axes) == 2
    assert run.energy.plot("kinetic", "internal").get_xlabel() == "time [s]"


def test_suggestions_are_records_and_scenes(tmp_path):
    # A probe in the overlap does not keep narrower ones from being proposed, but those that end before it.
    scene = Scene(SCENES / "bar-1d.toml")
    found = scene.suggest(error=0.05, apply=tmp_path / "better.toml")
    assert found.proposed.errors.displacement < 0.05
    assert found["set"] and found.proposed.seconds > 0.0
    assert any("a probe looks at 'chain'" in n for n in found.notes)
    better, given = Scene(tmp_path / "better.toml"), scene.check()
    assert better.check().models[0].unknowns != given.models[0].unknowns


def test_a_sweep_holds_runs_against_each_other(tmp_path):
    (tmp_path / "bar.toml").write_text(BAR)
    file = tmp_path / "sweep.toml"
    file.write_text(
        """
title = "Spacing of a bar"
scene = "bar.toml"
reference = { run = "finest" }
[axis.spacing]
values = [0.04, 0.02]
set = ["model.bar.spacing={}"]
[run.finest]
scene = "bar.toml"
"""
    )
    made = arlequin.sweep(file, out=tmp_path / "out")
    assert made.status == "complete" and len(made.runs) == 3
    errors_found = made.column("error_judged")
    assert errors_found[1] > errors_found[2] > 0.0, errors_found
    assert json.loads((tmp_path / "out" / "sweep.json").read_text()) == made
    # The reference has no parameter; its place stays free, so that columns belong together.
    assert made.column("spacing") == [r.parameters.get("spacing") for r in made.runs]
    assert made.column("spacing").count(None) == 1 and len(made.column("cost")) == 3
    with pytest.raises(KeyError, match="no run has 'mesh'; there are: .*error_judged.*spacing"):
        made.column("mesh")
    again = arlequin.sweep(file, out=tmp_path / "out")
    assert all(r.reused for r in again.runs)
    with raises("Read"):
        arlequin.sweep(tmp_path / "none.toml", out=tmp_path / "out")


def test_a_panic_becomes_an_exception():
    from arlequin import _native

    with pytest.raises(errors.InternalError, match="a mistake in arlequin itself: seven.*report"):
        _native._mistake("seven")
