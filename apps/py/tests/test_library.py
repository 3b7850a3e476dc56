"""Objects of the library from Python."""

import numpy as np
import pytest

import arlequin as aq
from arlequin import errors
from codes import raises


def test_a_bar_of_three_kinds_of_models_is_one_body():
    """Natural elements, finite elements and particles side by side keep energy and momentum."""
    silica = aq.Elastic(72.5e9, 0.17, 2200.0)
    rng = np.random.default_rng(3)
    across = np.linspace(0, 1e-3, 4)
    grid = np.array([(x, y, z) for z in across for y in across for x in np.linspace(0, 3e-3, 9)])
    left = aq.CnemModel("left", grid, silica)
    packing = aq.Packing.block((2e-3, 0, 0), (5e-3, 1e-3, 1e-3), 800, seed=2, quench=True)
    right = aq.DemModel("right", packing, 2200.0)
    assert right.rotations == 3 and left.rotations == 0
    share = aq.Weights.same(aq.Ramp(aq.Slab(fine=(3e-3, 0, 0), coarse=(2e-3, 0, 0)), "cubic", 1e-3))
    particles = len(right.nodes)
    bodies = [aq.Subdomain.coarse(left, share), aq.Subdomain.fine(right, aq.Weights.complement_of(share))]
    v = np.concatenate([rng.normal(size=3 * particles), np.zeros(3 * particles)])
    bodies[1].with_initial(0 * v, v).with_partition("unchecked")
    overlap = aq.Mesh.block("hex", (2e-3, 0, 0), (3e-3, 1e-3, 1e-3), (2, 2, 2))
    tie = aq.Interface("tie", "left", "right", overlap, sampling="particles")
    run = aq.Coupled(bodies, [tie], chosen=0.8)
    before = run.momentum
    run.run(200)
    assert run.drift < 1e-10 and run.constraint_residual < 1e-10
    assert np.allclose(run.momentum[0], before[0], atol=1e-12 * abs(v).max() * run.inertia("right").sum())
    assert run.rotation("right").shape == (particles, 3) and run.displacement("left").shape == (len(grid), 3)
    with raises("Unsupported", match="part of a run"):
        aq.Subdomain.fine(right)


def test_a_clamped_bar_under_a_load_rests_and_swings_as_in_books():
    n, length = 40, 1.0
    bar = aq.FemModel("bar", aq.Mesh.bar(0.0, length, n, 1e-4), aq.Elastic(210e9, 0.3, 7800.0))
    body = aq.Subdomain.fine(bar).with_support([0]).with_effect(aq.Load("pull", [n], [1e3]))
    run = aq.Coupled([body], fraction=0.9)
    rest = 1e3 * length / (210e9 * 1e-4)
    assert abs(run.equilibrium()[0][-1] / rest - 1) < 1e-12
    period = 4 * length / bar_speed()
    tip = []
    run.run_until(period / 2, lambda r: tip.append(r.displacement("bar")[-1, 0]))
    # A suddenly applied load moves the tip to twice its rest.
    assert abs(max(tip) / (2 * rest) - 1) < 0.02 and run.drift < 1e-11


def bar_speed():
    return aq.Elastic(210e9, 0.3, 7800.0).bar_speed


@pytest.mark.parametrize("time", [None, "function", "table"])
def test_gravity_over_time_brings_its_momentum(time):
    bar = aq.FemModel("bar", aq.Mesh.bar(0.0, 1.0, 4, 1.0), aq.Elastic(1.0, 0.0, 2.0))
    over = {None: None, "function": lambda t: t, "table": aq.TimeFunction.table([0.0, 10.0], [0.0, 10.0])}[time]
    run = aq.Coupled([aq.Subdomain.fine(bar).with_effect(aq.BodyForce((3.0, 0, 0), over))], seconds=0.01)
    run.run(100)
    expected = 2.0 * 3.0 * (run.time if time is None else run.time**2 / 2)
    assert abs(run.momentum[0][0] / expected - 1) < 1e-12


def test_damping_takes_energy_and_says_so():
    bar = aq.FemModel("bar", aq.Mesh.bar(0.0, 1.0, 10, 1.0), aq.Elastic(1.0, 0.0, 1.0))
    v = np.ones(11)
    body = aq.Subdomain.fine(bar).with_initial(0 * v, v).with_effect(aq.MassDamping(0.5))
    run = aq.Coupled([body], seconds=0.01)
    run.run(100)
    # Of first order in the step: half of it times the rate.
    assert abs(run.energy / (0.5 * np.exp(-2 * 0.5 * run.time)) - 1) < 0.5 * 0.01 * 0.51
    assert run.drift < 1e-12


def test_weights_sum_to_one_and_profiles_have_names():
    shell = aq.Shell(aq.Region.ball((0, 0, 0), 1.0), aq.Region.ball((0, 0, 0), 2.0))
    x = np.random.default_rng(0).normal(size=(50, 3)) * 2
    share = aq.Weights.same(aq.Ramp(shell, "quintic"))
    rest = aq.Weights.complement_of(share)
    for a, b in zip(share.at(x), rest.at(x)):
        assert abs(a + b - 1).max() < 1e-15
    r = np.linalg.norm(x, axis=1)
    assert (share.at(x)[0][r < 1] == 0).all() and (share.at(x)[0][r > 2] == 1).all()
    with raises("InvalidParameter", match="cubic"):
        aq.Ramp(shell, "kubic")
    with raises("InvalidParameter", match="epsilon"):
        aq.Ramp(shell, "cubic", 0.7)


def test_meshes_and_fields_have_arrays():
    mesh = aq.Mesh.block("tet", (0, 0, 0), (1, 1, 1), (2, 2, 2))
    again = aq.Mesh("tet", mesh.points, mesh.cells)
    assert mesh.cells.shape == (48, 4) and abs(again.volume - 1) < 1e-14
    nodes, values = mesh.field.shape_at((0.3, 0.4, 0.1))
    assert np.allclose(values @ mesh.points[nodes], (0.3, 0.4, 0.1), atol=1e-15)
    natural = aq.Field.natural(mesh.points)
    nodes, values = natural.shape_at((0.3, 0.4, 0.1))
    assert np.allclose(values @ mesh.points[nodes], (0.3, 0.4, 0.1), atol=1e-13)
    with raises("OutsideDomain", match="outside"):
        mesh.field.shape_at((2, 0, 0))
    with raises("InvalidParameter", match="bar, tet or hex"):
        aq.Mesh("tri", mesh.points, mesh.cells)
    with raises("SizeMismatch", match=r"\(n, 3\)"):
        aq.Mesh("tet", mesh.points[:, :2], mesh.cells)
    with raises("File", match="none.msh"):
        aq.Mesh.read("none.msh")
    with raises("InvalidParameter", match="node number -1"):
        aq.Mesh("tet", mesh.points, -np.ones((1, 4), int))


def test_particles_of_ones_own_are_bonded():
    points = np.array([(i, j, k) for i in range(4) for j in range(3) for k in range(3)], float)
    d = np.linalg.norm(points[:, None] - points[None], axis=2)
    pairs = np.argwhere(np.triu((d > 0) & (d < 1.5)))
    spheres = points, np.full(len(points), 0.5), pairs, 36.0
    model = aq.DemModel("grains", spheres, 2.0, young=1.0, poisson=0.3, radius_ratio=0.7)
    assert abs(model.lumped_inertia()[: 3 * len(points)].sum() / 3 - 72.0) < 1e-10
    assert sorted(model.order) == list(range(len(points)))
    assert np.allclose(model.nodes, points[model.order])
    with raises("Unsupported", match="particles only"):
        aq.Subdomain.coarse(model)


def test_a_mediator_of_bars_needs_no_section():
    """The section of the mediator scales multipliers alone."""
    share = aq.Weights.same(aq.Ramp(aq.Slab(fine=1.0, coarse=0.0), "cubic"))
    moved = []
    for section in (1e-4, 1.0):
        models = [aq.FemModel(n, aq.Mesh.bar(*x, 1e-4), aq.Elastic(1.0, 0.0, 1.0)) for n, x in (("a", (-9, 1, 20)), ("b", (0, 10, 80)))]
        right = aq.Subdomain.fine(models[1], aq.Weights.complement_of(share)).with_initial(np.zeros(81), np.sin(np.arange(81.0)))
        tie = aq.Interface("tie", "a", "b", aq.Mesh.bar(0.0, 1.0, 2, section))
        run = aq.Coupled([aq.Subdomain.coarse(models[0], share), right], [tie])
        run.run(200)
        assert run.drift < 1e-12
        moved.append(run.velocity("a"))
    assert abs(moved[0] - moved[1]).max() < 1e-12


def test_choices_that_contradict_are_refused():
    bar = aq.FemModel("bar", aq.Mesh.bar(0.0, 1.0, 10), aq.Elastic(1.0, 0.0, 1.0))
    with raises("InvalidParameter", match="one of fraction, seconds and chosen"):
        aq.Coupled([aq.Subdomain.fine(bar)], fraction=0.5, seconds=0.1)
    with raises("InvalidParameter", match="one of ratio"):
        aq.Subdomain.fine(bar).with_step(ratio=2, implicit=True)
    with raises("UnstableStep", match="exceeds the critical step"):
        aq.Coupled([aq.Subdomain.fine(bar)], seconds=1.0)
    with raises("UnknownName", match="there are: bar"):
        aq.Coupled([aq.Subdomain.fine(bar)], [aq.Interface("tie", "bar", "bor", aq.Mesh.bar(0.0, 1.0, 2))])
    with raises("SizeMismatch", match="forces on"):
        aq.Load("pull", [1, 2], [1.0, 2.0, 3.0])
    body = aq.Subdomain.fine(bar)
    aq.Coupled([body])
    with raises("Unsupported", match="make another"):
        aq.Coupled([body])
    with raises("InvalidParameter", match="arlequin.Mesh"):
        aq.Subdomain.fine(bar, field=3)


def test_codes_of_failed_runs_are_those_of_rust():
    """The codes are written down in Python; this keeps the list true."""
    import pathlib
    import re

    root = pathlib.Path(__file__).parents[3]
    names = set()
    for crate in ("apps/scene", "arlequin-core", "apps/link", "fem-ref", "dem-beam", "cnem"):
        text = (root / crate / "src" / "error.rs").read_text()
        body = text[text.index("pub enum Error") :]
        found = re.findall(r"^    ([A-Z]\w+)(?: \{|\(|,)", body[: body.index("\n}")], re.M)
        assert len(found) > 10, crate
        names.update(found)
    assert errors._RUN <= names, errors._RUN - names


def test_errors_keep_their_fields_in_a_copy():
    import copy
    import pickle

    e = errors._make("UnstableStep", "step too long", "time.step", 7)
    assert isinstance(e, errors.InputError) and isinstance(e, ValueError)
    for other in (copy.copy(e), pickle.loads(pickle.dumps(e))):
        assert (str(other), other.code, other.key, other.line) == ("step too long", "UnstableStep", "time.step", 7)
    assert isinstance(errors._make("Diverged", "gone", None, None), errors.RunError)
