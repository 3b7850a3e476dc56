"""Every choice that Python hands over arrives: a run with it differs from one without as the theory says."""

import numpy as np
import pytest

import arlequin as aq
from codes import raises
from test_plug import V0, X, Chain, coupled, gap, states

UNIT = aq.Elastic(1.0, 0.3, 1.0)


def bar(name="bar", start=0.0, end=10.0, count=10):
    return aq.FemModel(name, aq.Mesh.bar(start, end, count), aq.Elastic(1.0, 0.0, 1.0))


def test_a_model_that_advances_is_told_of_every_state_that_is_reached():
    class Told(Chain):
        def advance(self, q):
            self.reached = getattr(self, "reached", [])
            self.reached.append(q.copy())
            return self.internal_forces(q)

    model = Told(X, 1.0, 1.0)
    run = coupled(model, ratio=1)
    model.reached.clear()
    run.run(20)
    assert len(model.reached) == 20
    assert abs(model.reached[-1] - run.displacement("chain")[:, 0]).max() == 0.0


def test_masses_per_node_count_for_each_of_its_displacements():
    mesh = aq.Mesh.block("tet", (0, 0, 0), (1, 1, 1), (2, 2, 2))
    sound = aq.FemModel("sound", mesh, UNIT)
    per_node = sound.lumped_inertia().reshape(-1, 3)[:, 0]
    model = aq.LinearModel("mine", mesh, aq.stiffness(sound), per_node)
    assert aq.conformance.mass(model, 1.0) < 1e-14


def test_weights_of_elements_with_warped_faces_are_means_over_the_whole_of_them():
    corners = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1.6, 1.3, 1.4], [0, 1, 1]]
    mesh = aq.Mesh("hex", corners, [range(8)])
    share = aq.Weights.same(aq.Ramp(aq.Slab(fine=(0, 0, 0), coarse=(2, 0, 0)), "linear"))

    class Told(aq.Model):
        def __init__(self):
            self.name, self.mesh, self.told = "told", mesh, []

        def inertia(self, weight):
            self.told.append(weight.copy())
            return np.ones(8) * weight[0]

        def set_internal_weight(self, weight):
            self.told.append(weight.copy())

        def internal_forces(self, q):
            return 0 * q

        def internal_energy(self, q):
            return 0.0

        def critical_step(self, inverse):
            return 1.0

    model = Told()
    aq.Coupled([aq.Subdomain.fine(model, share).with_partition("unchecked")])
    sound = aq.FemModel("sound", mesh, UNIT)
    expected = sound.lumped_inertia(share).sum() / sound.lumped_inertia().sum()
    assert 0.2 < expected < 0.8 and abs(model.told[-1][0] - expected) < 1e-12, (model.told, expected)


@pytest.mark.parametrize("form", [list, np.float32, lambda f: np.asarray(f)[:, None]])
def test_answers_of_any_form_are_looked_through(form):
    """A list, another precision, a column."""
    for bad, what in ((None, None), (np.nan, "NotFinite")):
        model = Chain(X, 1.0, 1.0)

        def forces(q, model=model, bad=bad):
            f = Chain.internal_forces(model, q)
            f[7] = f[7] if bad is None else bad
            return form(f)

        model.internal_forces = forces
        if what is None:
            assert coupled(model).run(10) == 10
        else:
            with raises(what, match="entry 7"):
                coupled(model)


def test_energies_are_those_of_motion_and_of_strain():
    v = np.sin(np.arange(11.0))
    run = aq.Coupled([aq.Subdomain.fine(bar()).with_initial(0 * v, v)], seconds=0.1, energy_every=1)
    run.run(20)
    kinetic = 0.5 * run.inertia("bar") @ run.velocity("bar")[:, 0] ** 2
    internal = 0.5 * np.sum(np.diff(run.displacement("bar")[:, 0]) ** 2)
    assert abs(run.energies.kinetic[-1] / kinetic - 1) < 1e-12
    assert abs(run.energies.internal[-1] / internal - 1) < 1e-12
    assert run.rotation("bar").size == 0


def test_rotations_are_those_of_particles():
    packing = aq.Packing.block((0, 0, 0), (1e-3, 1e-3, 1e-3), 100, seed=1, quench=True)
    model = aq.DemModel("grains", packing, 2200.0)
    n = len(model.nodes)
    q = np.concatenate([np.full(3 * n, 1e-9), np.full(3 * n, 2e-9)])
    run = aq.Coupled([aq.Subdomain.fine(model).with_initial(q, 0 * q)])
    assert (run.displacement(0) == 1e-9).all() and (run.rotation(0) == 2e-9).all()


def test_runs_begin_when_they_are_told_to():
    times = []
    held = aq.Subdomain.fine(bar()).with_support([0], 1e-3, lambda t: times.append(t) or t)
    run = aq.Coupled([held], seconds=0.5, start=5.0)
    run.run(2)
    assert run.time == 6.0 and max(times) >= 6.0
    # The bar's end goes where it is led.
    assert abs(run.displacement("bar")[0, 0] - 1e-3 * 6.0) < 1e-15


def test_a_run_whose_energy_grows_ends_where_it_is_told_to():
    class Gains(Chain):
        """Forces that are weaker than their energy, which is more than the motion loses."""

        def internal_forces(self, q):
            return 0.8 * super().internal_forces(q)

    def run(growth):
        body = aq.Subdomain.fine(Gains(X, 1.0, 1.0)).with_initial(0 * X, V0)
        return aq.Coupled([body], seconds=0.5, growth=growth)

    with raises("EnergyGrowth"):
        run(1e-3).run(1000)
    assert run(10.0).run(1000) == 1000


def test_own_steps_are_those_asked_for():
    def pair(**own):
        left = aq.Subdomain.fine(bar("left")).with_step(**own)
        return aq.Coupled([left, aq.Subdomain.fine(bar("right", 20.0, 30.0))], seconds=0.5)

    assert pair().own_steps == [1, 1] and pair(ratio=3).own_steps == [3, 1]
    # 0.5 s are half of the critical step.
    assert pair(fraction=0.2).own_steps == [3, 1]
    with raises("UnstableStep"):
        aq.Coupled([aq.Subdomain.fine(bar())], seconds=3.0)
    assert aq.Coupled([aq.Subdomain.fine(bar()).with_step(implicit=True)], seconds=3.0).run(5) == 5


def tied(junction=None, **options):
    share = aq.Weights.same(aq.Ramp(aq.Slab(fine=(3.0, 0, 0), coarse=(1.0, 0, 0)), "cubic", 1e-3))
    meshes = aq.Mesh.block("hex", (0, 0, 0), (3, 1, 1), (6, 2, 2)), aq.Mesh.block("hex", (1, 0, 0), (4, 1, 1), (9, 3, 3))
    left, right = (aq.FemModel(n, m, UNIT) for n, m in zip("ab", meshes))
    v = np.random.default_rng(1).normal(size=3 * len(meshes[1].points))
    bodies = [aq.Subdomain.coarse(left, share), aq.Subdomain.fine(right, aq.Weights.complement_of(share))]
    bodies[1].with_initial(0 * v, v)
    tie = aq.Interface("tie", "a", "b", aq.Mesh.block("hex", (1, 0, 0), (3, 1, 1), (4, 2, 2)), junction, **options)
    run = aq.Coupled(bodies, [tie], seconds=0.05)
    run.run(50)
    return run


def test_junctions_have_their_length_and_interfaces_their_options():
    plain = states(tied())
    assert gap(plain, states(tied(aq.L2()))) == 0.0
    # Strain rates count with the square of the length: next to none is none.
    assert gap(plain, states(tied(aq.H1Strain(1e-6)))) < 1e-9
    small, large = (gap(plain, states(tied(aq.H1Strain(x)))) for x in (0.01, 0.5))
    assert 1e-9 < small < 0.1 * large
    # A lumped interface ties each multiplier for itself: velocities may jump.
    exact, lumped = tied(), tied(lumped=True)
    assert exact.constraint_residual < 1e-11 and lumped.constraint_residual > 1e-3


def test_the_jump_that_a_run_may_start_with_is_the_interface_s():
    def run(allowed):
        ramp = aq.Weights.same(aq.Ramp(aq.Slab(fine=0.0, coarse=-20.0), "cubic", 1e-6))
        fine = aq.Subdomain.fine(Chain(X, 1.0, 1.0), aq.Weights.complement_of(ramp)).with_initial(1e-3 + 0 * X, V0)
        tie = aq.Interface("overlap", 0, 1, aq.Mesh.bar(-20.0, 0.0, 2), start_jump=allowed)
        return aq.Coupled([aq.Subdomain.coarse(bar("bar", -100.0, 0.0), ramp), fine], [tie], seconds=0.8)

    # One body is where it was, the other a millimetre off: the whole displacement is a jump.
    assert run(1.5).run(1) == 1
    for allowed in (None, 0.5):
        with raises("InitialJump"):
            run(allowed)


def test_sections_of_bars_are_volumes_and_masses():
    x = [0.0, 1.0, 3.0]
    for mesh in (aq.Mesh.bar(0.0, 3.0, 2, 1e-4), aq.Mesh.line(x, 1e-4), aq.Mesh("bar", x, [[0, 1], [1, 2]], 1e-4)):
        assert abs(mesh.volume / 3e-4 - 1) < 1e-14
        assert abs(aq.FemModel("bar", mesh, UNIT).lumped_inertia().sum() / 3e-4 - 1) < 1e-14
