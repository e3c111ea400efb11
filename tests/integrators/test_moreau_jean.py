"""The θ-step: its orders, its accuracy on the paper's systems, impacts, energy, and that all LCP solvers agree."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

import lcpimpact as li
from lcpimpact.lcp import SOLVERS
from lcpimpact.lcp.solver import SolverState
from lcpimpact.lcp.solvers.auto import Auto
from lcpimpact.problems.bouncing_ball import closed_form
from lcpimpact.problems.reference import KNOWN
from lcpimpact.reproduce.runs import DIRECT_SOLVERS, ORDER_COUNTS, QP_SOLVERS, observed_orders


def run(problem, dt=1e-2, t_end=3.0, **options):
    return li.simulate(problem, "moreau-jean", dt=dt, t_end=t_end, **options)


def problem_of(known):
    return li.load_problem(known.problem, **known.parameters)


@pytest.mark.parametrize("known", KNOWN, ids=lambda known: known.label)
def test_error_of_x_at_three_steps(known):
    for h, limit in zip((1e-2, 1e-3, 1e-4), known.limits, strict=True):
        exact = li.simulate(problem_of(known), "exact", dt=h, t_end=3.0)
        error = np.abs(run(problem_of(known), dt=h)["x"] - exact["x"]).max()
        assert limit / 100 < error <= limit


@pytest.mark.parametrize("known", KNOWN, ids=lambda known: known.label)
@pytest.mark.parametrize(("theta", "order"), [(0.5, 2.0), (1.0, 1.0)])
def test_observed_order(known, theta, order):
    assert len(ORDER_COUNTS) >= 6
    found = observed_orders(known.label, "moreau-jean", (("theta", theta),))
    assert found.x > order - 0.1
    assert found.v > order - 0.1
    if theta == 1.0:
        assert found.x < 1.1
        assert found.v < 1.1


@pytest.mark.parametrize("known", KNOWN[:3], ids=lambda known: known.label)
def test_mean_force_lives_at_mid_step(known):
    # L1 error over the length of the run, in N: 2.22, 0.53, 0.41 at mid-step, about 29, 20, 19 at the end of the step.
    found = run(problem_of(known))
    exact = li.simulate(problem_of(known), "exact", dt=1e-2, t_end=3.0)
    at_mid = np.abs(found["R"] - exact.sample(found.t_reaction).reaction[:, 0]).mean()
    at_end = np.abs(found["R"] - exact.sample(found.t[1:]).reaction[:, 0]).mean()
    assert_allclose(found.t_reaction, found.t[:-1] + 0.5e-2, rtol=0, atol=1e-12)
    assert at_mid < 2.5
    assert at_end > 8 * at_mid


def test_force_does_not_ring():
    found = run(li.load_problem("system-1"), dt=1e-3)["R"]
    assert 5800.0 < found.max() < 5830.0
    contact = found[10:500]
    assert np.abs(np.diff(contact, 2)).max() < 2.0


def test_static_node_does_not_alternate():
    for h in (1e-2, 1e-3):
        found = run(li.load_problem("system-2"), dt=h)
        flight = (found.t > 1.1) & (found.t < 2.6)
        assert_allclose(found["y"][flight], found["x"][flight], rtol=0, atol=1e-12)


@pytest.mark.parametrize("theta", [0.5, 1.0])
@pytest.mark.parametrize("known", KNOWN, ids=lambda known: known.label)
def test_every_solver_gives_the_same_trajectory(known, theta):
    reference = run(problem_of(known), theta=theta, lcp_solver="lemke")
    for solver in (*DIRECT_SOLVERS, "auto", *QP_SOLVERS):
        found = run(problem_of(known), theta=theta, lcp_solver=solver)
        tolerance = 1e-7 if solver in QP_SOLVERS else 1e-10
        for name in ("q", "v", "reaction"):
            expected = getattr(reference, name)
            assert_allclose(getattr(found, name), expected, rtol=0, atol=tolerance * np.abs(expected).max())


@pytest.mark.parametrize("e", [0.0, 0.5, 0.8])
def test_bouncing_ball_through_its_accumulation_and_to_rest(e):
    errors = []
    for steps in (1009, 4001):
        found = run(li.load_problem("bouncing-ball", e=e), dt=5.0 / steps, t_end=5.0)
        x, _ = closed_form(found.t, 9.81, 1.0, e)
        errors.append(np.abs(found["x"] - x).max())
        assert abs(found["v_x"][-1]) < 1e-9
        assert_allclose(found["R"][-1], 9.81, rtol=1e-9)
        assert found.success
    assert errors[0] < 0.05
    assert errors[1] < 0.5 * errors[0]


def test_newtons_law_holds_at_each_impact():
    found = run(li.load_problem("bouncing-ball", e=0.8), dt=1e-3)
    first = next(event for event in found.events if event.kind == "impact")
    assert_allclose(first.t, np.sqrt(2.0 / 9.81), rtol=0, atol=1e-3)
    assert_allclose(first.right.v[0], -0.8 * first.left.v[0], rtol=1e-12)
    assert_allclose(first.impulse, 1.8 * first.left.v[0], rtol=1e-2)
    assert found.certificate.complementarity < 1e-12


@pytest.mark.parametrize("gap", [0.0, 1e-3])
def test_an_impact_in_the_first_step_is_an_event(gap):
    scheme = li.Scheme(li.Mass("x", 2.0), li.Bumper("x", "ground", gap=gap, e=0.5))
    for t_end in (1e-2, 1e-1):
        found = run(li.Problem("thrown", scheme, v0={"x": 1.0}), t_end=t_end)
        assert [event.kind for event in found.events] == ["impact"]
        assert 0.0 <= found.events[0].t <= 1e-2
        assert_allclose(found.events[0].impulse, 2.0 * 1.5, rtol=1e-12)
        assert_allclose(found.reaction, 0.0, atol=0.0)


def test_a_body_at_rest_on_the_ground_makes_no_event():
    scheme = li.Scheme(li.Mass("x", 2.0), li.Load("x", 20.0), li.Bumper("x", "ground", e=0.5))
    found = run(li.Problem("resting", scheme), t_end=0.1)
    assert found.events == ()
    assert_allclose(found["R"], 20.0, rtol=1e-12)


def test_impulses_and_forces_are_kept_apart():
    found = run(li.load_problem("bouncing-ball", e=0.5), dt=1e-3, t_end=5.0)
    impulses = sum(event.impulse for event in found.events)
    # Forces hold the weight and no impulse; together they take all the momentum that gravity gave.
    assert found["R"].max() < 2.0 * 9.81
    assert_allclose(impulses + found["R"].sum() * 1e-3, 9.81 * 5.0 - found["v_x"][-1], rtol=1e-10)


@given(e=st.floats(0.0, 1.0), relative=st.floats(0.0, 1.0), h=st.floats(1e-4, 5e-2), height=st.floats(0.05, 3.0))
def test_impacts_of_approaching_bodies_never_gain_energy(e, relative, h, height):
    theta = 0.5 + relative * (1.0 / (1.0 + e) - 0.5)
    found = run(li.load_problem("bouncing-ball", e=e, H=height), dt=h, t_end=400 * h, theta=theta)
    total = 0.5 * found["v_x"] ** 2 - 9.81 * found["x"]
    gain, approaching = np.diff(total), found["v_x"][:-1] >= 0.0
    rounding = 1e-9 * (1.0 + np.abs(total).max())
    assert gain[approaching].max() < rounding
    # A step that begins with the ball leaving, and still below the ground, may give back what one step of fall holds.
    assert gain[~approaching].max(initial=0.0) < 0.5 * (9.81 * h) ** 2 + rounding


def test_momentum_passes_through_an_inner_contact():
    scheme = li.Scheme(li.Mass("a", 1.0), li.Mass("b", 3.0), li.Bumper("a", "b", gap=0.5, e=0.7))
    found = run(li.Problem("two", scheme, v0={"a": 2.0}), dt=1e-3, t_end=1.0)
    momentum = found.v @ [1.0, 3.0]
    assert_allclose(momentum, 2.0, rtol=1e-13)
    assert_allclose(found["v_b"][-1] - found["v_a"][-1], 0.7 * 2.0, rtol=1e-12)


def test_energy_is_balanced_to_rounding_at_one_half_and_lost_at_one():
    for name in ("system-1", "system-3"):
        half = run(li.load_problem(name)).certificate
        assert half.energy_balance < 1e-12 * half.energy_scale
        assert half.penetration < 1e-13
        assert half.complementarity < 1e-9
        assert run(li.load_problem(name), theta=1.0).certificate.energy_balance > 1e-2 * half.energy_scale


@pytest.mark.parametrize("kind", [li.Scheme, li.SparseScheme])
def test_a_long_way_is_no_loss_of_energy(kind):
    """A body falls by 20 km at the speed at which its dashpot bears it: the places of all its steps are rounded alike."""
    falling = li.Problem(
        "falling", kind(li.Mass("x", 1.0), li.Dashpot("x", "ground", 3.0), li.Load("x", 9.81)), t_end=6e3
    )
    found = run(falling, dt=0.03, t_end=6e3, error=False)
    assert found.success
    c = found.certificate
    supplied = 9.81 * found["x"][-1]
    assert 1e-13 * supplied < c.energy_balance < 1e-11 * supplied
    assert c.limits["energy_balance"] < 1e-10 * supplied


def test_load_of_time_is_followed_at_order_two():
    scheme = li.Scheme(li.Mass("x", 2.0), li.Spring("x", "ground", 50.0), li.Load("x", lambda t: 3.0 * np.cos(4.0 * t)))
    same = li.Scheme(li.Mass("x", 2.0), li.Spring("x", "ground", 50.0), li.Load("x", li.Harmonic(3.0, 4.0)))
    errors = []
    for h in (1e-2, 1e-3):
        exact = li.simulate(li.Problem("exact", same), "exact", dt=h, t_end=2.0)
        errors.append(np.abs(run(li.Problem("load", scheme), dt=h, t_end=2.0)["x"] - exact["x"]).max())
        again = run(li.Problem("harmonic", same), dt=h, t_end=2.0)
        assert_allclose(again["x"], run(li.Problem("load", scheme), dt=h, t_end=2.0)["x"], rtol=0, atol=1e-13)
    assert 1.9 < np.log10(errors[0] / errors[1]) < 2.1


@pytest.mark.parametrize("solver", ["auto", "pgs"])
def test_blocks_do_not_change_the_bits(solver, monkeypatch):
    import lcpimpact.simulation

    whole = run(li.load_problem("system-3"), dt=1e-3, lcp_solver=solver)
    monkeypatch.setattr(lcpimpact.simulation, "BLOCK_SECONDS", 0.0)
    pieces = run(li.load_problem("system-3"), dt=1e-3, lcp_solver=solver)
    assert pieces.q.tobytes() == whole.q.tobytes()
    assert pieces.reaction.tobytes() == whole.reaction.tobytes()


def test_a_shorter_run_is_the_beginning_of_a_longer_one():
    short = run(li.load_problem("system-3"), dt=2.0**-10, t_end=1.0)
    whole = run(li.load_problem("system-3"), dt=2.0**-10, t_end=3.0)
    assert whole.q[: len(short.q)].tobytes() == short.q.tobytes()


def test_starved_solver_stops_the_run_and_says_where():
    scheme = li.Scheme(
        *(li.Mass(f"m{i}", 1.0) for i in range(6)),
        *(li.Load(f"m{i}", 10.0) for i in range(6)),
        *(li.Bumper(f"m{i}", f"m{i + 1}" if i < 5 else "ground", e=0.0, name=f"R{i}") for i in range(6)),
    )
    pile = li.Problem("pile", scheme)
    failed = run(pile, t_end=0.1, lcp_solver="pgs", max_iter=1, throw=False)
    assert failed.status is li.Status.MAX_ITER
    assert len(failed.t) == 1
    assert "step 0" in failed.message
    with pytest.raises(li.FailureError, match="max_iter"):
        run(pile, t_end=0.1, lcp_solver="pgs", max_iter=1)
    settled = run(pile, t_end=0.1, lcp_solver="pgs")
    assert_allclose(settled.reaction[-1], 10.0 * np.arange(1, 7), rtol=1e-9)


def test_a_step_that_one_method_does_not_solve_is_tried_by_the_next(monkeypatch):
    """Every third solve fails; the steps that auto's second method takes over are those of that method alone."""
    solves = []

    def lazy(W, q, lower, upper, z, tol, max_iter):
        solves.append(len(q))
        if len(solves) % 3 == 0:
            return int(li.Status.SINGULAR), 1
        return lemke.kernel(W, q, lower, upper, z, tol, max_iter)

    lemke = SOLVERS["lemke"]
    problem = li.load_problem("system-3")
    expected = run(problem, lcp_solver="lemke", t_end=0.5)
    monkeypatch.setattr(Auto, "init", lambda self, M: SolverState(M.W, lazy, False, "lazy", ("pgs", "lemke")))
    monkeypatch.setattr(type(SOLVERS["pgs"]), "init", _refusing(type(SOLVERS["pgs"]).init, "pgs"))
    found = run(problem, lcp_solver="auto", t_end=0.5)
    assert len(solves) >= 50
    assert_allclose(found.q, expected.q, rtol=0.0, atol=1e-12)
    assert_allclose(found.reaction, expected.reaction, rtol=0.0, atol=1e-9)
    assert found.stats.lcp_solves == expected.stats.lcp_solves


def _refusing(init, name):
    """An init whose kernel fails for the solver of that name, and is as it was for any other."""

    def replaced(self, M):
        state = init(self, M)
        fails = SolverState(state.W, lambda *_: (int(li.Status.UNDECIDED), 1), False, name)
        return fails if self.name == name else state

    return replaced


def test_inaccurate_answers_are_not_accepted(monkeypatch):
    def wrong(W, q, lower, upper, z, tol, max_iter):
        z[:] = 1.0
        return int(li.Status.SOLVED), 1

    import lcpimpact.lcp.solvers.qp as qp

    monkeypatch.setattr(qp.QPSolver, "init", lambda self, M: SolverState(M.W, wrong, False, "wrong"))
    failed = run(li.load_problem("system-1"), lcp_solver="qp:osqp", throw=False)
    assert failed.status is li.Status.INACCURATE
    assert len(failed.t) == 1


def test_a_contact_that_rounding_opens_stays_closed():
    """θ = 1 ends each step of a plastic impact with u = 0 and U = 0, up to rounding, which must not let the contact go."""
    problem = li.load_problem("plastic-bar-impact")
    found = li.simulate(problem, dt=problem.t_end / 300, theta=1.0)
    assert np.abs(problem.dynamics.gap(found.t, found.q)[:100, 0]).max() < 1e-12
    assert (found.reaction[1:100, 0] > 100.0).all()
