"""What the README shows runs as it stands there."""

import pathlib
import re

import numpy as np
import pytest

import arlequin as aq

FOLDER = pathlib.Path(__file__).parents[1]
BLOCKS = re.findall(r"```python\n(.*?)```", (FOLDER / "README.md").read_text(), re.S)
SCENES = FOLDER.parents[1] / "examples" / "scenes"


def test_the_pulse_of_the_first_example_arrives_whole():
    space = {}
    exec(BLOCKS[0], space)  # noqa: S102 - our own text
    run, u, x = space["run"], space["u"], space["x"]
    assert run.drift < 1e-12 and run.own_steps == [1, 4]
    # It has run by half a metre, all of it; 20 coarse elements per pulse disperse it by a few per cent.
    where = np.linspace(0.2, 0.4, 41)
    now, _ = run.sample("coarse", where)
    before = np.interp(where + 0.5, x, u)
    assert abs(now[:, 0] - before).max() < 0.1 * abs(u).max()


def test_a_scene_runs_in_one_line(monkeypatch):
    monkeypatch.chdir(SCENES)
    space = {"aq": aq}
    exec(BLOCKS[1], space)  # noqa: S102
    assert space["run"].summary.status == "complete"


def test_a_model_of_ones_own_is_fit():
    scipy_sparse = pytest.importorskip("scipy.sparse")
    import scipy

    assert scipy.sparse is scipy_sparse
    space = {"aq": aq, "scipy": scipy}
    exec(BLOCKS[2], space)  # noqa: S102
    assert len(BLOCKS[2].strip().splitlines()) <= 15
    aq.conformance.check(space["Bar"](np.linspace(0, 1, 11), 1.0, 0.1))


def test_pictures_of_the_readme_are_there():
    for name in re.findall(r"!\[.*?\]\((.*?)\)", (FOLDER / "README.md").read_text()):
        assert (FOLDER / name).exists(), name
