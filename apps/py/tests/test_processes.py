"""Several processes and threads: forked ones compute, results are sent between them, and Ctrl-C is heard."""

import copy
import json
import os
import pathlib
import pickle
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest

import arlequin as aq
from arlequin import Scene, errors
from codes import raises
from test_scene import BAR

# Enough unknowns that all threads compute: 7 203.
PLATE = """
import multiprocessing, sys, threading
import numpy as np
import arlequin as aq

def energy(k):
    plate = aq.FemModel("plate", aq.Mesh.block("hex", [0, 0, 0], [1, 1, 1], [20, 20, 15]), aq.Elastic(1.0, 0.3, 1.0))
    n = 3 * len(plate.nodes)
    forces = plate.internal_forces(np.sin(np.arange(n)))
    run = aq.Coupled([aq.Subdomain.fine(plate).with_initial(np.zeros(n), np.sin(k + np.arange(n)))])
    run.run(20)
    return float(run.energy), float(np.abs(forces).sum()), run.momentum

def in_a_thread(k):
    out = []
    thread = threading.Thread(target=lambda: out.append(energy(k)))
    thread.start()
    thread.join()
    return out[0]

def in_a_child(k):
    with multiprocessing.get_context("fork").Pool(1) as pool:
        return pool.apply(energy, (k,))

if __name__ == "__main__":
    aq.set_threads(2)
    here = [energy(k) for k in range(3)]
    with multiprocessing.get_context("fork").Pool(2) as pool:
        assert pool.map(energy, range(3)) == here, "a forked process computes something else"
        assert pool.map(in_a_thread, range(3)) == here, "a thread of a forked process computes something else"
    # A process that is forked from a forked one.
    with multiprocessing.get_context("fork").Pool(1) as pool:
        assert pool.map(energy, range(1)) == here[:1]
    import concurrent.futures
    with concurrent.futures.ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("fork")) as pool:
        assert pool.submit(energy, 0).result() == here[0]
        assert pool.submit(in_a_child, 0).result() == here[0]
    print("all the same")
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="nothing is forked here")
def test_a_forked_process_computes_with_threads_of_its_own(tmp_path):
    script = tmp_path / "forks.py"
    script.write_text(PLATE)
    # Without threads of its own it would wait for ever.
    call = [sys.executable, "-W", "ignore", str(script)]
    done = subprocess.run(call, capture_output=True, text=True, timeout=300)
    assert done.stdout.strip() == "all the same", done.stderr


def test_what_a_run_leaves_can_be_sent_to_another_process():
    run = Scene.from_text(BAR).run(frames=2)
    probe = run.probes["tip"]
    for again in (pickle.loads(pickle.dumps(probe)), copy.copy(probe), copy.deepcopy(probe)):
        assert repr(again) == repr(probe) and np.array_equal(again.u, probe.u) and again.facts == probe.facts
        with pytest.raises(AttributeError, match="ask for 'u'"):
            again.v
    for thing in (run.probes, run.energy, run.effects, run.summary, run.fields(), run.fields()["bar"]):
        again = pickle.loads(pickle.dumps(thing))
        assert repr(again) == repr(thing) and list(again) == list(thing)
    assert np.array_equal(pickle.loads(pickle.dumps(run.energy)).H, run.energy.H)
    with pytest.raises(KeyError, match="there is no probe 'top'"):
        pickle.loads(pickle.dumps(run.probes))["top"]


def test_an_error_of_another_process_says_the_same():
    with pytest.raises(errors.InputError) as caught:
        Scene.from_text(BAR.replace("young = 210e9", "young = -1.0")).check()
    again = pickle.loads(pickle.dumps(caught.value))
    assert type(again) is type(caught.value) and str(again) == str(caught.value)
    assert (again.key, again.line) == (caught.value.key, caught.value.line)


def test_a_run_can_be_shown_while_another_thread_computes():
    bar = aq.Subdomain.fine(aq.FemModel("bar", aq.Mesh.bar(0.0, 1.0, 1000), aq.Elastic(1.0, 0.0, 1.0)))
    run = aq.Coupled([bar])
    ends = threading.Event()
    thread = threading.Thread(target=lambda: run.run(10**9, lambda _: not ends.is_set(), every=200_000))
    thread.start()
    try:
        begin, shown = time.monotonic(), set()
        while not any("another thread" in s for s in shown) and time.monotonic() - begin < 20.0:
            shown |= {repr(run), run._repr_html_()}
    finally:
        ends.set()
        thread.join()
    assert any("<Coupled bar: computing in another thread>" == s for s in shown), shown
    assert repr(run).startswith("<Coupled bar: step ")


def pressed(after, work):
    """Presses Ctrl-C while something computes; how long after it that ends."""
    at = []

    def press():
        at.append(time.monotonic())
        signal.raise_signal(signal.SIGINT) if sys.platform == "win32" else os.kill(os.getpid(), signal.SIGINT)

    timer = threading.Timer(after, press)
    timer.start()
    with pytest.raises(KeyboardInterrupt):
        work()
    timer.join()
    return time.monotonic() - at[0]


def test_ctrl_c_is_heard_while_spheres_are_packed():
    late = pressed(1.0, lambda: aq.Packing.block([0, 0, 0], [1, 1, 1], 200_000))
    assert late < 3.0, f"heard after {late:.1f} s"


def test_ctrl_c_while_a_run_of_a_sweep_packs_spheres_ends_the_sweep(tmp_path, monkeypatch):
    monkeypatch.setenv("ARLEQUIN_CACHE", str(tmp_path / "packings"))
    block = '[model.block]\nkind = "dem"\nshape.box = { low = [0.0, 0.0, 0.0], high = [1.0, 1.0, 1.0] }\nspacing = 0.018\n'
    material = "material = { young = 1e9, poisson = 0.2, density = 1000.0 }\n"
    (tmp_path / "block.toml").write_text(block + material + "[time]\nend = 1e-3\n")
    file = tmp_path / "sweep.toml"
    file.write_text('scene = "block.toml"\n[axis.end]\nvalues = [1e-3, 2e-3, 3e-3]\nset = ["time.end={}"]\n')
    Scene(tmp_path / "block.toml", **{"model.block.spacing": 0.2}).check()
    late = pressed(2.0, lambda: aq.sweep(file, out=tmp_path / "out"))
    assert late < 3.0, f"heard after {late:.1f} s"
    assert json.loads((tmp_path / "out" / "sweep.json").read_text())["status"] == "interrupted"


@pytest.mark.skipif(sys.platform == "win32", reason="no such signals there")
def test_ctrl_c_is_heard_while_a_solver_starts():
    command = [sys.executable, "-c", "import time; time.sleep(60)"]
    late = pressed(0.5, lambda: aq.Subdomain.remote("mine", command, timeout=40.0))
    assert late < 3.0, f"heard after {late:.1f} s"


def test_a_solver_may_take_longer_to_start_than_to_answer(tmp_path):
    # As an interpreter does on a busy machine that loads its packages.
    client = pathlib.Path(__file__).resolve().parents[3] / "apps" / "link" / "clients" / "python"
    script = tmp_path / "slow.py"
    script.write_text(
        f"import sys, time\ntime.sleep(1.5)\nsys.path.insert(0, {str(client)!r})\nfrom chain import Chain, serve\n"
        "serve(Chain(-20.0, 1.0, 60, 1.0, 1.0))\n"
    )
    command = [sys.executable, str(script)]
    assert aq.Subdomain.remote("mine", command, timeout=1.0).name == "mine"
    with raises("Silent", match="a connection to .* within 0.5 s"):
        aq.Subdomain.remote("mine", command, start_timeout=0.5)


@pytest.mark.parametrize("cells", [[[0.5, 1, 2, 3]], [[0, 1, 2, np.nan]], [[0, 1, 2, -1]]])
def test_node_numbers_are_whole(cells):
    corners = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]]
    with raises("InvalidParameter", match="node number .*; they are whole"):
        aq.Mesh("tet", corners, cells)
    for whole in ([[0, 1, 2, 3]], [[0.0, 1.0, 2.0, 3.0]], np.array([[0, 1, 2, 3]], np.uint8)):
        assert aq.Mesh("tet", corners, whole).cells.tolist() == [[0, 1, 2, 3]]


def test_progress_is_a_switch_or_an_object(tmp_path):
    file = tmp_path / "bar.toml"
    file.write_text(BAR)
    assert aq.run(file, **{"time.end": 1e-5}).summary.time >= 1e-5
    with raises("Value", match="progress = 0.5"):
        aq.run(file, progress=0.5)
