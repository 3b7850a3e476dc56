"""What users do by mistake with models, solvers and links of their own: named at once, never a wrong number without a word."""

import socket

import numpy as np
import pytest

import arlequin as aq
from arlequin import errors
from codes import raises
from test_plug import V0, X, Chain, LinearChain, Verlet, coupled, gap, states


class Once(RuntimeError):
    """Raised once."""


def failing_once(solver, method):
    """The same solver, of which the method raises at its 40th call."""
    whole, calls = getattr(solver, method), [0]

    def flaky(*given):
        calls[0] += 1
        if calls[0] == 40:
            raise Once
        return whole(*given)

    setattr(solver, method, flaky)
    return solver


@pytest.mark.parametrize("method", ["advance", "velocities", "kick"])
def test_a_run_that_ended_within_a_step_goes_on_from_a_snapshot_only(method):
    whole, run = (coupled(s) for s in (Verlet(Chain(X, 1.0, 1.0), V0), failing_once(Verlet(Chain(X, 1.0, 1.0), V0), method)))
    run.run(5)
    kept = run.snapshot()
    with pytest.raises(Once):
        run.run(100)
    for go_on in (lambda: run.run(1), run.snapshot):
        with raises("Unsupported", match="restore"):
            go_on()
    run.restore(kept)
    run.run(100)
    whole.run(105)
    assert gap(states(run), states(whole)) < 1e-12


def test_an_object_that_keeps_a_state_is_in_one_run_at_a_time():
    solver = Verlet(Chain(X, 1.0, 1.0), V0)
    run = coupled(solver)
    for again in (lambda: coupled(solver), lambda: aq.conformance.check(solver, step=0.8)):
        with raises("Unsupported", match="still there"):
            again()
    del run
    coupled(solver).run(1)
    model = Chain(X, 1.0, 1.0)
    first = aq.Subdomain.fine(model)
    with raises("Unsupported", match="still there"):
        aq.Subdomain.fine(model)
    del first
    # Its matrix was taken once and for all.
    linear = LinearChain(X, 1.0, 1.0)
    assert gap(*(states(r) for r in (coupled(linear), coupled(linear)))) == 0.0


@pytest.mark.parametrize("name, value", [("components", 7), ("components", -1), ("rotations", 10**12), ("rotations", "3")])
def test_unknowns_that_no_node_has_are_refused(name, value):
    model = Chain(X, 1.0, 1.0)
    setattr(model, name, value)
    with raises("InvalidParameter", match=f"{name} of 'chain' = .* a node has one of"):
        aq.Subdomain.fine(model)


@pytest.mark.parametrize("bonds", [[0, 1, 2], [], [[0, 1, 2]], np.zeros((3, 4), int)])
def test_bonds_are_pairs(bonds):
    model = Chain(X, 1.0, 1.0)
    model.bonds = bonds
    with raises("SizeMismatch", match="bonds of 'chain'"):
        aq.Subdomain.fine(model)


def test_cells_of_a_mesh_have_the_corners_of_their_kind():
    corners = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]]
    assert len(aq.Mesh("tet", corners, [[0, 1, 2, 3]]).points) == 4
    with raises("SizeMismatch", match=r"give \(n, 4\)"):
        aq.Mesh("tet", corners, [[0, 1], [2, 3]])


def test_what_is_no_number_is_named_with_the_method_that_answered_it():
    def broken(q):
        f = Chain.internal_forces(model, q)
        f[3] = np.nan
        return f

    model = Chain(X, 1.0, 1.0)
    model.internal_forces = broken
    with raises("NotFinite", match="internal_forces of 'chain': entry 3"):
        coupled(model)
    for method, what in (("velocities", "NotFinite"), ("displacements", "NotFinite"), ("invariant", None)):
        solver = Verlet(Chain(X, 1.0, 1.0), V0)
        whole = getattr(solver, method)
        setattr(solver, method, lambda whole=whole: whole() * np.nan)
        with raises(what, match=f"{method} of 'chain'"):
            coupled(solver).run(20)


@pytest.mark.parametrize("step", [0.0, -1.0, np.nan])
def test_critical_steps_are_positive(step):
    model, solver = Chain(X, 1.0, 1.0), Verlet(Chain(X, 1.0, 1.0), V0)
    model.critical_step, solver.critical_step = (lambda inverse: step), (lambda: step)
    for object in (model, solver):
        with raises("InvalidParameter", match="critical_step of 'chain'"):
            coupled(object)


def test_a_table_of_time_has_as_many_values_as_times_and_runs_end_at_a_time():
    with raises("SizeMismatch", match="3 times and 2 values"):
        aq.TimeFunction.table([0, 1, 2], [0, 1])
    run = coupled(Chain(X, 1.0, 1.0))
    for time in (np.nan, np.inf):
        with raises("InvalidParameter", match="finite"):
            run.run_until(time)


def bar_under(time):
    bar = aq.Subdomain.fine(aq.FemModel("bar", aq.Mesh.bar(0.0, 10.0, 10), aq.Elastic(1.0, 0.0, 1.0)))
    return bar.with_support([0], 1e-3, time), bar.with_effect(aq.Load("pull", [10], [1e-3], time))


@pytest.mark.parametrize("raised", [IndexError, KeyboardInterrupt])
@pytest.mark.parametrize("where", [0, 1])
def test_an_exception_in_a_function_of_time_comes_back_as_it_is(raised, where):
    healed = []

    def time(t):
        if t >= 3.0 and not healed:
            raise raised
        return 1e-3 * t

    run = aq.Coupled([bar_under(time)[where]], seconds=0.5)
    kept = run.snapshot()
    with pytest.raises(raised):
        run.run(100)
    assert run.time < 5.0
    with raises("Unsupported", match="restore"):
        run.run(1)
    run.restore(kept)
    healed.append(True)
    assert run.run(100) == 100


def test_a_function_of_time_need_not_make_sense_before_time_zero():
    import math

    assert aq.Coupled([bar_under(lambda t: 1e-3 * math.sqrt(t))[0]], seconds=0.5).run(10) == 10


def test_a_solver_that_saves_nothing_is_named():
    solver = Verlet(Chain(X, 1.0, 1.0), V0)
    solver.save = lambda: None
    with raises("InvalidParameter", match="save of 'chain' answers None"):
        coupled(solver).snapshot()


@pytest.mark.parametrize("what", ["name", "kind"])
def test_names_and_kinds_are_texts(what):
    for make, part in ((lambda: Chain(X, 1.0, 1.0), aq.Subdomain.fine), (lambda: Verlet(Chain(X, 1.0, 1.0), V0), aq.Subdomain.participant)):
        object = make()
        setattr(object, what, 3)
        with raises("InvalidParameter", match=f"{what} = 3: .* a text"):
            part(object)


def test_models_are_counted_from_zero():
    run = coupled(Chain(X, 1.0, 1.0))
    for number in (-1, 2):
        with raises("UnknownName", match="there is no subdomain .*; there are: bar, chain"):
            run.velocity(number)


def test_a_name_that_two_models_have_names_none():
    run = aq.Coupled([aq.Subdomain.fine(Chain(X, 1.0, 1.0)) for _ in range(2)], seconds=0.5)
    with raises("UnknownName", match="several are named 'chain'"):
        run.velocity("chain")
    assert run.velocity(1).shape == (61, 1)


@pytest.mark.skipif(not hasattr(socket, "AF_UNIX"), reason="no such sockets here")
def test_the_socket_of_a_run_that_was_killed_is_taken_over_and_that_of_a_living_one_is_not(tmp_path):
    path = tmp_path / "link"

    def refused():
        with pytest.raises(errors.Error) as caught:
            aq.Subdomain.remote("mine", address=f"unix:{path}", start_timeout=0.05)
        return str(caught.value)

    with socket.socket(socket.AF_UNIX) as living:
        living.bind(str(path))
        living.listen()
        living.settimeout(0.05)
        assert "in use" in refused()
        # Nobody knocked there.
        with pytest.raises(TimeoutError):
            living.accept()
    assert path.exists() and "was due within" in refused() and not path.exists()
    path.write_text("precious")
    assert "in use" in refused() and path.read_text() == "precious"
