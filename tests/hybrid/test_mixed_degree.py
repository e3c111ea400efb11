"""Contacts whose relative degree rises while all of them are closed: a body on a massless plate that meets a stop."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import expm
from scipy.optimize import brentq, linprog

import lcpimpact as li
from lcpimpact.hybrid.event_loop import follow as follow_motion
from lcpimpact.hybrid.impact_law import restitution
from lcpimpact.hybrid.motion import begin_problem, state_before
from lcpimpact.hybrid.tangent import tangent
from lcpimpact.integrators import METHODS
from lcpimpact.problems import PROBLEMS
from lcpimpact.scheme.impulse_paths import impulse_paths
from lcpimpact.scheme.structure import Feature

M, G, K, C, GAP, V0 = 100.0, 9.81, 3924.0, 250.0, 0.5, 9.9
E_R, E_S = 0.3, 0.4


def buffer_with_a_stop(e_R=E_R, e_S=E_S, m=M):
    """System No. 1 with a stop under its plate."""
    return li.Scheme(
        li.Mass("x", m=m),
        li.Load("x", f=m * G),
        li.Bumper("x", "z", name="R", e=e_R),
        li.KelvinVoigt("z", "ground", k=K, c=C),
        li.Bumper("z", "ground", gap=GAP, name="S", e=e_S),
    )


def run(scheme, t_end, dt=1e-3, q0=None, v0=None, **options):
    problem = li.Problem("stopped plate", scheme, q0=q0 or {}, v0=v0 or {}, t_end=t_end)
    return li.simulate(problem, "moreau-jean", dt=dt, t_end=t_end, **options)


def riding(x, v, t, m=M):
    """Return x and v after a time t of a body that rides on its plate: the flow of System No. 1."""
    A = np.array([[0.0, 1.0, 0.0], [-K / m, -C / m, G], [0.0, 0.0, 0.0]])
    return (expm(A * t) @ [x, v, 1.0])[:2]


def closed_form(t_end):
    """Return the instant of the impact, the speed before it, and x and v at t_end, after the plate has been left."""
    t_1 = brentq(lambda t: riding(0.0, V0, t)[0] - GAP, 0.01, 0.1, xtol=1e-15)
    speed = riding(0.0, V0, t_1)[1]
    # The plate, which the spring drives home faster than the body leaves, goes on pushing: R = k x + c v.
    after = GAP, -E_S * speed
    t_2 = brentq(lambda t: np.dot([K, C], riding(*after, t)), 1e-3, 0.2, xtol=1e-15)
    x, v = riding(*after, t_2)
    rest = t_end - t_1 - t_2
    return t_1, speed, x + v * rest + 0.5 * G * rest**2, v + G * rest


EVENT_METHODS = {"exact": 1e-12, "radau-fesd": 1e-9, "event-driven": 1e-7}
"""Methods that find events, and what they may be off by here, relative to the motion."""


def follow(scheme, t_end, method="exact", q0=None, v0=None, dt=None):
    """Run a method that finds events, and check that no impact gains energy."""
    problem = li.Problem("stopped plate", scheme, q0=q0 or {}, v0=v0 or {}, t_end=t_end)
    trajectory = li.simulate(problem, method, dt=dt or t_end / 400.0, t_end=t_end)
    d = problem.dynamics
    for event in trajectory.events:
        gain = d.kinetic_energy(event.left.q, event.right.v) - d.kinetic_energy(event.left.q, event.left.v)
        assert gain <= 1e-12 * d.kinetic_energy(event.left.q, event.left.v)
    return trajectory


def impacts(trajectory):
    """Return instant, contact and impulse of each impact."""
    return [(event.t, event.contact, event.impulse) for event in trajectory.events if event.kind == "impact"]


def graphs():
    """Random nodes with or without mass, contacts between them, rates and coefficients of restitution."""
    return st.integers(0, 2**32 - 1).map(np.random.default_rng)


def impulses(H, masses, U, e):
    """Return P and the jump of v of the masses, which come first in H, by the law on impulse paths."""
    massive = len(masses)
    paths, jump = impulse_paths(H[:, :massive].T, H[:, massive:].T), np.linalg.solve(masses, H[:, :massive].T)
    if not len(paths):
        return np.zeros(len(H)), np.zeros(massive)
    W, q = paths @ H[:, :massive] @ jump @ paths.T, paths @ U + restitution(paths, U, e)
    P = li.solve_lcp(W, q).z @ paths
    return P, jump @ P


@given(graphs())
def test_the_impulses_solve_the_mixed_complementarity_problem(rng):
    """P >= 0 balances on massless nodes, and rates w of them exist with 0 <= P ⟂ U⁺ + e U⁻ >= 0."""
    massive, massless = rng.integers(1, 4), rng.integers(0, 4)
    n = massive + massless
    v = rng.choice([-2.0, -1.0, 0.0, 0.5, 3.0], n)
    rows = []
    for _ in range(rng.integers(1, 7)):
        a, b = rng.choice(n + 1, 2, replace=False)
        row = np.eye(n + 1, n)[b] - np.eye(n + 1, n)[a]
        # The left limit of a contact that touches never opens.
        trial = [*rows, -row if row @ v > 0.0 else row]
        if np.linalg.matrix_rank(trial) == len(trial):
            rows = trial
    H = np.array(rows)
    masses = np.diag(10.0 ** rng.uniform(-1.0, 1.0, massive))
    U = H @ v
    e = rng.choice([0.0, 0.3, 1.0], len(H))
    P, jump = impulses(H, masses, U, e)

    assert (P >= 0.0).all()
    assert pytest.approx(0.0, abs=1e-12) == H[:, massive:].T @ P
    after = H[:, :massive] @ (v[:massive] + jump) + e * U
    pushing = P > 1e-9
    found = (
        linprog(
            np.zeros(massless),
            A_ub=-H[~pushing][:, massive:],
            b_ub=after[~pushing] + 1e-8,
            A_eq=H[pushing][:, massive:],
            b_eq=-after[pushing],
            bounds=(None, None),
        )
        if massless
        else None
    )
    if massless:
        assert found.status == 0, found.message
    else:
        assert (after[~pushing] >= -1e-8).all()
        assert after[pushing] == pytest.approx(0.0, abs=1e-8)


@given(graphs())
def test_closed_contacts_that_are_hit_never_gain_energy(rng):
    """With U⁻ <= 0 on all contacts, as the left limit always has it, the loss is ½ P (1 - e) U⁻ for each."""
    e = rng.uniform(0.0, 1.0, 3)
    v_x, v_y = rng.uniform(0.0, 3.0), rng.uniform(-3.0, 0.0)
    H = np.array([[-1.0, 0.0, 1.0, 0.0], [0.0, 0.0, -1.0, 1.0], [0.0, 1.0, 0.0, -1.0]])
    masses = np.diag(rng.uniform(0.1, 10.0, 2))
    z = np.sort(rng.uniform(v_y, v_x, 2))[::-1]
    U = H @ [v_x, v_y, *z]
    (P, jump), before = impulses(H, masses, U, e), np.array([v_x, v_y])
    after = before + jump
    change = 0.5 * (after @ masses @ after - before @ masses @ before)
    assert change <= 1e-12 * (before @ masses @ before)
    assert change == pytest.approx(0.5 * (P * (1.0 - e) * U).sum(), rel=1e-9, abs=1e-12)
    assert np.diag(masses) @ after == pytest.approx(np.diag(masses) @ before, rel=1e-9, abs=1e-12)


def test_restitution_is_asked_for_where_impulses_can_act():
    with pytest.raises(li.InputError, match=r"between 'x' and 'z'.*'R' and 'S' are all closed.*give e="):
        buffer_with_a_stop(e_R=None).assemble()
    with pytest.raises(li.InputError, match=r"between 'z' and 'ground'.*'S' and 'R' are all closed.*give e="):
        buffer_with_a_stop(e_S=None).assemble()
    dynamics = buffer_with_a_stop().assemble()
    assert dynamics.impulse_paths.tolist() == [[1.0, 1.0]]
    assert "'R', 'S'" in dynamics.features[Feature.IMPULSE_PATHS]


def test_restitution_is_refused_where_none_can():
    """A stop over the plate pushes it the way that the body does: no impulse passes from one to the other."""
    elements = (*buffer_with_a_stop().elements, li.Bumper("ground", "z", gap=0.1, name="T"))
    assert li.Scheme(*elements).assemble().impulse_paths.tolist() == [[1.0, 1.0, 0.0]]
    with pytest.raises(li.InputError, match=r"e = 0\.5 means nothing"):
        li.Scheme(*elements[:-1], li.Bumper("ground", "z", gap=0.1, name="T", e=0.5)).assemble()


@pytest.mark.parametrize("θ", [0.5, 0.75, 1.0])
def test_the_body_leaves_a_stopped_plate_with_e_of_the_stop(θ):
    t_end = 0.4
    t_1, speed, x, v = closed_form(t_end)
    errors = []
    for dt in (1e-3, 1e-4):
        trajectory = run(buffer_with_a_stop(), t_end, dt, v0={"x": V0}, theta=θ)
        R, S = (event for event in trajectory.events if event.kind == "impact")
        assert (R.contact, S.contact) == ("R", "S")
        assert R.t == pytest.approx(t_1, abs=dt)
        errors.append(
            [
                R.right.v[0] + E_S * speed,
                R.impulse - M * (1.0 + E_S) * speed,
                S.impulse - M * (1.0 + E_S) * speed,
                trajectory["x"][-1] - x,
                trajectory["v_x"][-1] - v,
            ]
        )
        # Between events R = k x + c v, which is greatest just before the impact.
        assert trajectory["R"].max() == pytest.approx(K * GAP + C * speed, rel=10.0 * dt)
        assert trajectory["S"].max() == 0.0
        assert trajectory.certificate.penetration <= V0 * dt
    scale = np.array([speed, M * speed, M * speed, 1.0, speed])
    assert (np.abs(errors[0]) <= 0.02 * scale).all()
    assert (np.abs(errors[1]) <= 0.002 * scale).all()


def test_a_body_that_hits_a_pressed_plate_leaves_with_e_of_its_own_contact():
    scheme = li.Scheme(
        li.Mass("x", m=10.0),
        li.Bumper("x", "z", gap=1.0, name="R", e=0.7),
        li.Load("z", f=1000.0),
        li.KelvinVoigt("z", "ground", k=1000.0, c=50.0),
        li.Bumper("z", "ground", gap=0.5, name="S", e=0.1),
    )
    trajectory = run(scheme, 0.6, 1e-4, q0={"z": 0.5}, v0={"x": 3.0})
    assert trajectory["v_x"][-1] == pytest.approx(-0.7 * 3.0, rel=1e-9)
    (impact, _) = (event for event in trajectory.events if event.kind == "impact")
    assert impact.impulse == pytest.approx(10.0 * 1.7 * 3.0, rel=1e-9)
    assert trajectory["S"][-1] == pytest.approx(1000.0 - 1000.0 * 0.5, rel=1e-9)


@pytest.mark.parametrize("θ", [0.5, 1.0])
def test_a_heavy_body_comes_to_rest_on_the_stop(θ):
    trajectory = run(buffer_with_a_stop(m=1000.0), 3.0, v0={"x": V0}, theta=θ)
    assert trajectory["R"][-1] == pytest.approx(1000.0 * G, rel=1e-9)
    assert trajectory["S"][-1] == pytest.approx(1000.0 * G - K * GAP, rel=1e-3)
    assert trajectory["x"][-1] == pytest.approx(GAP, abs=1e-3)
    assert trajectory["v_x"][-1] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(
    ("gaps", "e"),
    [((0.2, 0.0, 0.05), (0.5, 0.9, 0.0)), ((0.0, 0.05, 0.0), (0.0, 0.9, 0.5)), ((0.2, 0.2, 0.0), (0.5, 0.0, 0.5))],
)
def test_forces_between_impacts_stay_bounded_and_nothing_is_gained(gaps, e):
    """The rate of a plate in the step of an impact is a mean, no left limit: it must not make a rebound of its own."""
    scheme = li.Scheme(
        li.Mass("a", m=5.0),
        li.Load("a", f=5.0 * G),
        li.Mass("b", m=20.0),
        li.Load("b", f=20.0 * G),
        li.Bumper("a", "z", gap=gaps[0], name="A", e=e[0]),
        li.Bumper("b", "z", gap=gaps[1], name="B", e=e[1]),
        li.KelvinVoigt("z", "ground", k=1000.0, c=10.0),
        li.Bumper("z", "ground", gap=gaps[2], name="S", e=e[2]),
    )
    for dt in (1e-3, 1e-4):
        trajectory = run(scheme, 0.6, dt, v0={"a": 2.0, "b": 4.0})
        d = trajectory.problem.dynamics
        energy = d.energy(trajectory.q, trajectory.v) - trajectory.q @ d.force(0.0)
        assert np.diff(energy).max() <= 5.0 * dt * np.abs(energy).max()
        assert trajectory.reaction.max() <= 2.0 * 25.0 * G


def two_plates_in_line():
    """A body above a damped and a static plate, which meet each other and the ground."""
    return li.Scheme(
        li.Mass("x", m=10.0),
        li.Load("x", f=98.1),
        li.Bumper("x", "y", gap=0.1, name="R", e=0.3),
        li.KelvinVoigt("y", "ground", k=500.0, c=30.0),
        li.Bumper("y", "z", gap=0.2, name="T", e=0.6),
        li.Spring("z", "ground", k=300.0),
        li.Bumper("z", "ground", gap=0.3, name="S", e=0.5),
    )


def test_impulses_pass_through_two_plates_in_line():
    """The speed of the impact is that of the body before it, which the impulse carries through y and z to the ground."""
    scheme = two_plates_in_line()
    trajectory = run(scheme, 0.3, 1e-4, v0={"x": 4.0})
    impacts = [event for event in trajectory.events if event.kind == "impact"]
    assert [event.contact for event in impacts] == ["R", "T", "S"]
    before, after = impacts[0].left.v[0], impacts[0].right.v[0]
    assert after == pytest.approx(-0.5 * before, rel=1e-3)
    assert [event.impulse for event in impacts] == pytest.approx([15.0 * before] * 3, rel=5e-3)


def test_two_bodies_share_a_plate_and_its_stop():
    scheme = li.Scheme(
        li.Mass("a", m=10.0),
        li.Load("a", f=98.1),
        li.Mass("b", m=5.0),
        li.Load("b", f=49.05),
        li.Bumper("a", "z", name="A", e=0.3),
        li.Bumper("b", "z", gap=0.2, name="B", e=0.6),
        li.KelvinVoigt("z", "ground", k=500.0, c=30.0),
        li.Bumper("z", "ground", gap=0.3, name="S", e=0.5),
    )
    assert sorted(scheme.assemble().impulse_paths.tolist()) == [[0.0, 1.0, 1.0], [1.0, 0.0, 1.0]]
    trajectory = run(scheme, 0.5, 1e-4, v0={"a": 3.0, "b": 2.0})
    for name, node in (("A", 0), ("B", 1)):
        impact = next(event for event in trajectory.events if (event.kind, event.contact) == ("impact", name))
        assert impact.right.v[node] == pytest.approx(-0.5 * impact.left.v[node], rel=2e-3)


def test_momentum_is_kept_where_a_plate_is_struck_between_two_bodies():
    scheme = li.Scheme(
        li.Mass("x", m=2.0),
        li.Mass("y", m=3.0),
        li.KelvinVoigt("x", "z", k=50.0, c=1.0),
        li.Bumper("z", "y", gap=0.1, name="T", e=0.6),
        li.Bumper("x", "z", gap=0.2, name="R", e=0.4),
    )
    trajectory = run(scheme, 0.8, 1e-4, q0={"y": 0.2}, v0={"x": 4.0})
    assert trajectory.v[:, :2] @ [2.0, 3.0] == pytest.approx(8.0, rel=1e-9)
    impact = next(event for event in trajectory.events if event.kind == "impact")
    approach, rebound = (state.v[1] - state.v[0] for state in (impact.left, impact.right))
    assert rebound == pytest.approx(-0.4 * approach, rel=2e-3)


def test_a_plate_may_stop_at_a_driven_one():
    """The impact is with a table that moves by itself: U⁺ = -e U⁻ relative to it."""
    table = li.Harmonic(0.1, 20.0)
    scheme = li.Scheme(
        li.Mass("x", m=10.0),
        li.Load("x", f=98.1),
        li.Bumper("x", "z", name="R", e=0.5),
        li.KelvinVoigt("z", "table", k=500.0, c=30.0),
        li.Bumper("z", "table", gap=0.1, name="S", e=0.5),
        li.PrescribedMotion("table", table),
    )
    trajectory = run(scheme, 0.3, 1e-4, q0={"x": 0.1, "z": 0.1}, v0={"x": 1.0})
    impacts = [event for event in trajectory.events if (event.kind, event.contact) == ("impact", "S")]
    assert impacts
    for event in impacts[:2]:
        before, after = (state.v[0] - state.v[2] for state in (event.left, event.right))
        assert after == pytest.approx(-0.5 * before, abs=0.02)


def test_halved_steps_find_the_impact():
    *_, x, v = closed_form(0.4)
    trajectory = run(buffer_with_a_stop(), 0.4, 1e-2, v0={"x": V0}, rtol=1e-6)
    assert trajectory["x"][-1] == pytest.approx(x, abs=1e-4)
    assert trajectory["v_x"][-1] == pytest.approx(v, abs=1e-3)


def test_the_certificate_judges_a_path_by_its_law_of_impact():
    trajectory = run(buffer_with_a_stop(), 0.4, v0={"x": V0})
    assert trajectory.certificate.complementarity <= 1e-9 * M * V0**2
    assert trajectory.certificate.energy_balance <= 1e-9 * trajectory.certificate.energy_scale


@pytest.mark.parametrize("method", EVENT_METHODS)
def test_methods_that_find_events_have_the_closed_form(method):
    t_end, off = 0.4, EVENT_METHODS[method]
    t_1, speed, x, v = closed_form(t_end)
    trajectory = follow(buffer_with_a_stop(), t_end, method, v0={"x": V0})
    (t, R, P_R), (_, S, P_S) = impacts(trajectory)
    assert (R, S) == ("R", "S")
    assert t == pytest.approx(t_1, rel=off)
    assert pytest.approx([M * (1.0 + E_S) * speed] * 2, rel=off) == [P_R, P_S]
    event = trajectory.events[0]
    assert event.left.reaction == pytest.approx([K * GAP + C * speed, 0.0], rel=off)
    assert [event.left.v[0], event.right.v[0]] == pytest.approx([speed, -E_S * speed], rel=off)
    assert trajectory["x"][-1] == pytest.approx(x, rel=10.0 * off)
    assert trajectory["v_x"][-1] == pytest.approx(v, rel=10.0 * off)


@pytest.mark.parametrize("method", EVENT_METHODS)
@pytest.mark.parametrize("e_S", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("c", [1.0, 1e6])
def test_the_stop_sends_the_body_back_by_its_own_coefficient(method, e_S, c):
    """A soft spring, or a dashpot that hardly gives way, changes the speed before the impact, and nothing else."""
    scheme = li.Scheme(
        li.Mass("x", m=2.0),
        li.Bumper("x", "z", name="R", e=0.9),
        li.KelvinVoigt("z", "ground", k=5.0, c=c),
        li.Bumper("z", "ground", gap=1e-3, name="S", e=e_S),
    )
    v0 = 1.0 + c * 1e-3
    event = next(event for event in follow(scheme, 0.02, method, v0={"x": v0}).events if event.kind == "impact")
    assert event.contact == "R"
    assert event.right.v[0] == pytest.approx(-e_S * event.left.v[0], rel=1e-9, abs=1e-12)
    # The dashpot takes c times the way, but for what the spring adds.
    assert event.left.v[0] == pytest.approx(v0 - 0.5 * c * 1e-3, rel=1e-4)


@pytest.mark.parametrize("method", EVENT_METHODS)
def test_a_pressed_plate_answers_with_e_of_the_body(method):
    scheme = li.Scheme(
        li.Mass("x", m=10.0),
        li.Bumper("x", "z", gap=1.0, name="R", e=0.7),
        li.Load("z", f=1000.0),
        li.KelvinVoigt("z", "ground", k=1000.0, c=50.0),
        li.Bumper("z", "ground", gap=0.5, name="S", e=0.1),
    )
    trajectory = follow(scheme, 0.6, method, q0={"z": 0.5}, v0={"x": 3.0})
    (t, R, P), (_, S, Q) = impacts(trajectory)
    assert (R, S) == ("R", "S")
    assert t == pytest.approx(0.5, rel=1e-9)
    assert pytest.approx([51.0, 51.0], rel=1e-9) == [P, Q]
    assert trajectory["v_x"][-1] == pytest.approx(-2.1, rel=1e-9)
    assert trajectory["S"] == pytest.approx(500.0, rel=1e-9)


@pytest.mark.parametrize("method", EVENT_METHODS)
def test_a_heavy_body_comes_to_rest_and_stays(method):
    trajectory = follow(buffer_with_a_stop(m=1000.0), 30.0, method, v0={"x": V0}, dt=0.01)
    assert trajectory["x"][-1] == pytest.approx(GAP, rel=1e-12)
    assert trajectory["v_x"][-1] == pytest.approx(0.0, abs=1e-12)
    assert trajectory["R"][-1] == pytest.approx(1000.0 * G, rel=1e-12)
    assert trajectory["S"][-1] == pytest.approx(1000.0 * G - K * GAP, rel=1e-12)
    assert trajectory.events[-1].t < 15.0


@pytest.mark.parametrize("method", EVENT_METHODS)
@pytest.mark.parametrize(("v_z", "rebound"), [(0.0, 0.3), (2.0, 0.4), (0.5, 0.75 * 0.3 + 0.25 * 0.4)])
def test_a_start_on_both_contacts_takes_the_rate_of_the_plate_as_given(method, v_z, rebound):
    """U_R and U_S before the start are z' - x' and -z': each part of the approach comes back by its own coefficient."""
    trajectory = follow(buffer_with_a_stop(), 0.01, method, q0={"x": GAP, "z": GAP}, v0={"x": 2.0, "z": v_z})
    assert [t for t, *_ in impacts(trajectory)[:2]] == [0.0, 0.0]
    assert trajectory["v_x"][0] == pytest.approx(-2.0 * rebound, rel=1e-12)
    assert trajectory["x"][0] == GAP


@pytest.mark.parametrize("method", EVENT_METHODS)
def test_a_start_at_rest_on_both_contacts_is_no_event(method):
    """The spring is not strained: only the force of the body closes both."""
    scheme = li.Scheme(
        li.Mass("x", m=3.0),
        li.Load("x", f=30.0),
        li.Bumper("x", "z", name="R", e=0.5),
        li.KelvinVoigt("z", "ground", k=100.0, c=5.0),
        li.Bumper("z", "ground", name="S", e=0.5),
    )
    trajectory = follow(scheme, 1.0, method)
    assert trajectory.events == ()
    assert trajectory["R"] == pytest.approx(30.0, rel=1e-12)
    assert trajectory["S"] == pytest.approx(30.0, rel=1e-12)
    assert not trajectory.q.any()


@pytest.mark.parametrize("method", EVENT_METHODS)
def test_a_start_on_the_stop_with_the_bumper_open(method):
    """The spring drives the plate home as exp(-t k/c), and the body meets it on its way: only then R closes."""
    k, c = 100.0, 50.0
    scheme = li.Scheme(
        li.Mass("x", m=3.0),
        li.Bumper("x", "z", name="R", e=0.5),
        li.KelvinVoigt("z", "ground", k=k, c=c),
        li.Bumper("z", "ground", gap=0.2, name="S", e=0.5),
    )
    trajectory = follow(scheme, 0.5, method, q0={"x": -0.3, "z": 0.2}, v0={"x": 1.0})
    first = trajectory.events[0]
    t_1 = brentq(lambda t: 0.2 * np.exp(-k / c * t) + 0.3 - t, 0.0, 1.0, xtol=1e-15)
    assert (first.contact, first.kind) == ("R", "close")
    assert first.t == pytest.approx(t_1, rel=1e-8)
    assert first.right.v[0] == 1.0


@pytest.mark.parametrize("method", EVENT_METHODS)
def test_bodies_that_ride_on_one_plate_share_its_force_by_their_masses(method):
    """Their contacts have no common relative degree: together they hold the bodies to each other, and no impulse acts."""
    scheme = li.Scheme(
        li.Mass("a", 1.0),
        li.Mass("b", 3.0),
        li.Load("a", 10.0),
        li.Load("b", 30.0),
        li.Spring("p", "ground", 100.0),
        li.Bumper("a", "p", name="Ra"),
        li.Bumper("b", "p", name="Rb"),
    )
    trajectory = follow(scheme, 0.6, method, v0={"a": 2.0, "b": 2.0})
    ω = 5.0
    x = 0.4 * (1.0 - np.cos(ω * trajectory.t)) + 2.0 / ω * np.sin(ω * trajectory.t)
    assert trajectory.events == ()
    for name in "abp":
        assert trajectory[name] == pytest.approx(x, abs=1e-7)
    assert trajectory["Ra"] == pytest.approx(25.0 * x, abs=1e-5)
    assert trajectory["Rb"] == pytest.approx(75.0 * x, abs=1e-5)


def test_the_faster_body_takes_the_plate_away_from_the_other():
    scheme = li.Scheme(
        li.Mass("a", 1.0),
        li.Mass("b", 1.0),
        li.KelvinVoigt("p", "ground", 1.0, 1.0),
        li.Bumper("a", "p", name="Ra"),
        li.Bumper("b", "p", name="Rb"),
    )
    trajectory = follow(scheme, 0.3, v0={"a": 1.0, "b": 2.0})
    assert trajectory["a"] == pytest.approx(trajectory.t, rel=1e-13, abs=1e-13)
    assert not trajectory["Ra"].any()
    assert trajectory["Rb"][0] == pytest.approx(2.0, rel=1e-12)


@pytest.mark.parametrize("method", EVENT_METHODS)
def test_impulses_pass_through_a_chain_of_a_damped_and_a_static_plate(method):
    scheme = two_plates_in_line()
    trajectory = follow(scheme, 0.3, method, v0={"x": 4.0})
    found = impacts(trajectory)[:3]
    event = next(event for event in trajectory.events if event.kind == "impact")
    assert [contact for _, contact, _ in found] == ["R", "T", "S"]
    assert event.right.v[0] == pytest.approx(-0.5 * event.left.v[0], rel=1e-9)
    assert [P for *_, P in found] == pytest.approx([15.0 * event.left.v[0]] * 3, rel=1e-9)
    # All gaps are closed: the body has come as far as they allow.
    assert event.left.q[0] == pytest.approx(0.6, rel=1e-9)
    step = run(scheme, 0.3, 1e-4, v0={"x": 4.0})
    assert trajectory["x"][-1] == pytest.approx(step["x"][-1], abs=2e-3)


def test_a_body_beside_a_rest_that_lasts_keeps_all_events_true():
    """Nothing that happens elsewhere for a long time opens what is pressed to its stop."""
    scheme = li.Scheme(
        *buffer_with_a_stop(m=1000.0).elements,
        li.Mass("far", m=1.0),
        li.Spring("far", "ground", k=0.3),
        li.Bumper("far", "ground", gap=0.5, e=1.0, name="F"),
    )
    trajectory = follow(scheme, 300.0, q0={"x": GAP, "z": GAP, "far": 1.0 / 3.0}, v0={"far": 0.5}, dt=1.0)
    assert {event.contact for event in trajectory.events} == {"F"}
    assert trajectory["S"] == pytest.approx(1000.0 * G - K * GAP, rel=1e-12)
    # The other swings by A cos(ω t) but for the time that it would spend beyond its stop.
    ω = np.sqrt(0.3)
    period = 2.0 * (np.pi - np.arccos(0.5 / np.hypot(1.0 / 3.0, 0.5 / ω))) / ω
    assert len(trajectory.events) == pytest.approx(300.0 / period, abs=1.0)


def test_a_motion_begun_without_a_run_obeys_the_same_law():
    problem = li.Problem("stopped plate", buffer_with_a_stop(), v0={"x": V0}, t_end=0.4)
    motion = begin_problem(problem, "exact", 0.4)
    follow_motion(motion, 0.4)
    t_1, speed, *_ = closed_form(0.4)
    assert motion.events[0].t == pytest.approx(t_1, rel=1e-12)
    assert motion.events[0].right.v[0] == pytest.approx(-E_S * speed, rel=1e-12)


def test_the_derivative_of_a_motion_knows_impulse_paths():
    def state(change):
        place = {"x": -0.05 + change[0], "z": 0.01 + change[1]}
        problem = li.Problem("stopped plate", buffer_with_a_stop(), q0=place, v0={"x": V0 + change[2]})
        motion = begin_problem(problem, "exact", 1.2)
        follow_motion(motion, 1.2)
        return motion, state_before(motion, 1.2)[:3]

    motion, _ = state(np.zeros(3))
    assert len([event for event in motion.events if event.kind == "impact"]) == 4
    h = 1e-6
    measured = np.column_stack([(state(h * unit)[1] - state(-h * unit)[1]) / (2.0 * h) for unit in np.eye(3)])
    assert tangent(motion, 1.2)[:3, :3] == pytest.approx(measured, abs=1e-7)


@pytest.mark.parametrize("method", [name for name in METHODS if name != "moreau-jean"])
def test_other_methods_refuse_or_are_right(method):
    t_end = 0.4
    problem = li.Problem("stopped plate", buffer_with_a_stop(), v0={"x": V0}, t_end=t_end)
    if Feature.IMPULSE_PATHS not in METHODS[method].declared.handles:
        with pytest.raises(li.UnsupportedError, match=rf"{method} does not handle .*'moreau-jean'"):
            li.simulate(problem, method, dt=1e-3, t_end=t_end)
        return
    *_, x, v = closed_form(t_end)
    trajectory = li.simulate(problem, method, dt=1e-3, t_end=t_end)
    assert trajectory["x"][-1] == pytest.approx(x, abs=0.02)
    assert trajectory["v_x"][-1] == pytest.approx(v, abs=0.02)


def test_bodies_that_overlap_through_static_nodes_are_refused():
    scheme = li.Scheme(
        li.Mass("x", m=10.0),
        li.Bumper("x", "z", name="R", e=0.2),
        li.Spring("z", "ground", k=500.0),
        li.Bumper("z", "ground", gap=0.3, name="S", e=0.6),
    )
    li.Problem("touching", scheme, q0={"x": 0.3})
    with pytest.raises(li.InputError, match=r"'R', 'S'.*penetrated by 0\.01 m together"):
        li.Problem("beyond", scheme, q0={"x": 0.31})


def test_no_registered_problem_has_such_a_path():
    """None of their sources states a restitution for one, so none must be asked for it."""
    assert not [name for name in PROBLEMS if len(li.load_problem(name).dynamics.impulse_lines)]
