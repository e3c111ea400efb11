"""Kane's paradox: what Newton's law of impact gains with friction, and what belts and moving walls add."""

import dataclasses
from math import cos, radians, sin, sqrt

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

import lcpimpact as li
from lcpimpact.certificate import ImpactGain, gain_eigenvalue
from lcpimpact.certificate.impacts import RunImpacts
from lcpimpact.events import steps_of
from lcpimpact.integrators import METHODS
from lcpimpact.record import State
from lcpimpact.scheme.structure import Feature

RUBBING = [name for name, kind in METHODS.items() if Feature.FRICTION in kind.declared.handles]
MEETING_MOTIONS = [
    name
    for name, kind in METHODS.items()
    if 2 in kind.declared.relative_degrees and {Feature.MOTIONS, Feature.RESTITUTION} <= set(kind.declared.handles)
]
STICKS = 5.0
"""A coefficient of friction with which all that touches sticks."""

UPPER, LOWER = radians(20.0), radians(30.0)
KANE_M = np.array([[4.0 / 3.0, 0.5 * cos(LOWER - UPPER)], [0.5 * cos(LOWER - UPPER), 1.0 / 3.0]])
KANE_H = np.array([[sin(UPPER), sin(LOWER)], [cos(UPPER), cos(LOWER)]])
KANE_V = np.array([-0.1, -0.2])


def kane(*elements, e=0.5, e_T=0.0, mu=0.5, gap=0.0, surface="ground", v=KANE_V):
    """Kane's two hinged rods of 1 m and 1 kg at 20° and 30°, whose tip strikes a rough floor."""
    scheme = li.Scheme.of_matrices(KANE_M, H=KANE_H[:1], gaps=[gap], e=[e], coordinates=("α", "β"), contacts=("N",))
    scheme.add(li.Friction(surface, {"α": KANE_H[1, 0], "β": KANE_H[1, 1]}, mu, "N", e_T=e_T, name="T"), *elements)
    return li.Problem("kane", scheme, v0={"α": v[0], "β": v[1]}, t_end=0.1)


def two_row_eigenvalue(W, δ_N, δ_T):
    """Return the least eigenvalue of ΔW + WΔ for two rows."""
    a, b, c = 2.0 * δ_N * W[0, 0], (δ_N + δ_T) * W[0, 1], 2.0 * δ_T * W[1, 1]
    return 0.5 * (a + c) - sqrt(0.25 * (a - c) ** 2 + b**2)


# ---- closed forms ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("method", RUBBING)
def test_the_gain_of_kanes_rods(method):
    """The tip sticks, so W P = -(1 + e) U_N⁻, -U_T⁻; the digits are those of a solution in 30 digits."""
    run = li.simulate(kane(gap=0.005), method, dt=1e-3, t_end=0.1)
    found, W = run.certificate.impact_gain, KANE_H @ np.linalg.solve(KANE_M, KANE_H.T)
    U = KANE_H @ KANE_V
    P = -np.linalg.solve(W, [1.5 * U[0], U[1]])
    gained = P @ (0.5 * np.array([0.5, 1.0]) * U)
    assert gained == pytest.approx(0.0368003665813 - 0.0231814108635, abs=2e-14)
    assert_allclose([found.gained, found.largest], gained, rtol=1e-9)
    assert found.instant == pytest.approx(-0.005 / U[0], abs=1e-3)
    assert found.eigenvalue == pytest.approx(two_row_eigenvalue(W, 1.0 / 3.0, 1.0), rel=1e-12)
    assert found.eigenvalue == pytest.approx(2.0 * -0.0727779, abs=1e-6)
    assert found.case == "gained"
    assert found.by_motions == 0.0
    # It is a property of the law, so that the run is solved, and says what happened.
    assert run.success
    assert "Newton's law gained 0.0136 J, at most 0.0136 J at 0.03" in repr(run)


@pytest.mark.parametrize("method", ["exact", "event-driven", "moreau-jean"])
@pytest.mark.parametrize("e_T", [0.5, 0.8])
def test_with_a_tangential_restitution_of_at_least_e_kanes_rods_do_not_gain(method, e_T):
    run = li.simulate(kane(e_T=e_T), method, dt=1e-3, t_end=0.1)
    assert run.certificate.impact_gain == ImpactGain()
    assert run.certificate.impact_gain.case == "cannot gain"
    assert "Newton's law" not in repr(run)
    T = run.problem.dynamics.kinetic_energy(run.q[[-1]], run.v[[-1]])[0]
    assert T < 0.0231814108635


@pytest.mark.parametrize("method", ["exact", "event-driven", "moreau-jean"])
@pytest.mark.parametrize("e", [0.5, 1.0])
def test_rods_that_could_gain_and_do_not(method, e):
    """Without slip before the impact friction does no work; with e = 1 nothing is lost either, but for rounding."""
    v = np.linalg.solve(KANE_H, [-0.2, 0.0])
    run = li.simulate(kane(v=v, mu=STICKS, e=e), method, dt=1e-3, t_end=0.1)
    found = run.certificate.impact_gain
    T = run.problem.dynamics.kinetic_energy(run.q[-1], np.array([v, run.v[-1]]))
    W = KANE_H @ np.linalg.solve(KANE_M, KANE_H.T)
    assert T[0] - T[1] == pytest.approx(0.5 * (1.0 - e**2) * 0.2**2 * np.linalg.inv(W)[0, 0], abs=1e-13)
    assert (found.case, found.gained, found.instant) == ("can gain", 0.0, None)
    assert "Newton's law could gain energy, and did not" in repr(run)


@pytest.mark.parametrize("method", ["exact", "event-driven", "moreau-jean"])
@pytest.mark.parametrize("e", [(0.2, 0.9), (1.0, 0.0), (0.7, 0.7)])
def test_impacts_without_friction_never_gain(method, e):
    """A bar with J > m l² falls on two edges at once: W couples them, and each loses -P (1 - e) U⁻/2."""
    M = np.diag([1.0, 1.5])
    H = np.array([[1.0, -1.0], [1.0, 1.0]])
    scheme = li.Scheme.of_matrices(M, H=H, e=e)
    run = li.simulate(li.Problem("bar", scheme, v0={"q1": -1.0, "q2": 0.02}), method, dt=1e-3, t_end=0.01)
    U = H @ run.problem.initial_velocities
    P = -np.linalg.solve(H @ np.linalg.solve(M, H.T), (1.0 + np.array(e)) * U)
    assert (P > 0.0).all()
    T = run.problem.dynamics.kinetic_energy(run.q[-1], np.array([run.problem.initial_velocities, run.v[-1]]))
    assert T[1] - T[0] == pytest.approx(0.5 * P @ ((1.0 - np.array(e)) * U), rel=1e-9)
    assert run.certificate.impact_gain == ImpactGain()


def rubbing(method):
    """Return another body that a slider drags along with the wall, where the method takes one: it is no part of impacts."""
    if Feature.SLIDERS not in METHODS[method].declared.handles:
        return ()
    return li.Mass("z", 1.0), li.Slider("wall", "z", 0.5)


@pytest.mark.parametrize("method", MEETING_MOTIONS)
def test_a_moving_wall_does_the_work_of_its_speed(method):
    """With v⁺ = V - e (v - V) a wall of speed V adds m V (v⁺ - v), and the body loses (1 - e²) m (v - V)²/2."""
    m, e, v, V = 2.0, 0.6, -1.0, 0.3
    scheme = li.Scheme(
        li.Mass("x", m), li.PrescribedMotion("wall", li.Polynomial([0.0, V])),
        li.Bumper("wall", "x", gap=0.05, e=e, name="R"), *rubbing(method),
    )  # fmt: skip
    run = li.simulate(li.Problem("wall", scheme, v0={"x": v}), method, dt=1e-3, t_end=0.1)
    found, after = run.certificate.impact_gain, V - e * (v - V)
    assert found == ImpactGain(by_motions=found.by_motions)
    assert found.by_motions == pytest.approx(m * V * (after - v), rel=1e-6)
    assert 0.5 * m * (run.v[-1, 0] ** 2 - v**2) == pytest.approx(
        found.by_motions - 0.5 * m * (1.0 - e**2) * (v - V) ** 2, rel=1e-6
    )
    assert "prescribed motions added 1.25 J" in repr(run)


@pytest.mark.parametrize("method", ["exact", "event-driven", "moreau-jean"])
@pytest.mark.parametrize(("mu", "e_T"), [(0.2, 0.0), (2.0, 0.0), (2.0, 0.5)], ids=str)
def test_a_belt_drags_a_ball_along(method, mu, e_T):
    """A ball dropped on a belt of speed c feels P_T = min(μ P_N, (1 + e_T) c/W_T), and the belt does the work P_T c."""
    m, k, e, v, c = 1.0, 0.4, 0.5, -2.0, 1.5
    scheme = li.Scheme(
        li.Mass("x", m), li.Mass("y", m), li.Mass("s", k * m), li.PrescribedMotion("belt", li.Polynomial([0.0, c])),
        li.Bumper("ground", "y", gap=0.01, e=e, name="N"),
        li.Friction("belt", {"x": 1.0, "s": 1.0}, mu, "N", e_T=e_T, name="T"),
    )  # fmt: skip
    run = li.simulate(li.Problem("belt", scheme, v0={"y": v}), method, dt=1e-3, t_end=0.05)
    P_N, W_T = -m * (1.0 + e) * v, (1.0 + 1.0 / k) / m
    P_T = min(mu * P_N, (1.0 + e_T) * c / W_T)
    found = run.certificate.impact_gain
    # W has no coupling, so that nothing is gained beside.
    assert found == ImpactGain(by_motions=found.by_motions)
    assert found.by_motions == pytest.approx(P_T * c, rel=1e-9)
    lost = 0.5 * P_N * (1.0 - e) * v + P_T * (0.5 * W_T * P_T - c)
    T = run.problem.dynamics.kinetic_energy(run.q, run.v[:, :].copy() * [1, 1, 1, 0])
    assert T[-1] - T[0] == pytest.approx(found.by_motions + lost, rel=1e-9)


@pytest.mark.parametrize("method", ["exact", "moreau-jean"])
def test_kanes_rods_on_a_belt(method):
    """A belt changes ξ_T only: what the law gains is as if the tip had that slip, and -P_T χ comes from the belt."""
    c = -0.03
    belt = li.PrescribedMotion("belt", li.Polynomial([0.0, c]))
    run = li.simulate(kane(belt, surface="belt", mu=STICKS, gap=0.005), method, dt=1e-3, t_end=0.1)
    U = KANE_H @ KANE_V - [0.0, c]
    P = -np.linalg.solve(KANE_H @ np.linalg.solve(KANE_M, KANE_H.T), [1.5 * U[0], U[1]])
    gained, found = P @ (0.5 * np.array([0.5, 1.0]) * U), run.certificate.impact_gain
    assert gained > 0.005
    assert_allclose([found.gained, found.by_motions], [gained, P[1] * c], rtol=1e-9)
    assert run.success


def test_rounding_is_no_gain():
    """With e = 1 and no slip nothing is gained or lost, whatever the speed."""
    for speed in np.linspace(0.1, 0.9, 40):
        v = np.linalg.solve(KANE_H, [-speed, 0.0])
        run = li.simulate(kane(v=v, mu=STICKS, e=1.0), "exact", dt=1e-3, t_end=2e-3)
        assert run.certificate.impact_gain.case == "can gain"


def test_an_impact_after_the_end_of_the_record_does_not_count():
    rods = kane(li.Mass("z", 1.0), li.Bumper("ground", "z", gap=0.04, e=0.5, name="R"), gap=0.005)
    problem = li.Problem("rods and a body", rods.scheme, v0={**rods.v0, "z": -1.0})
    run = li.simulate(problem, "exact", dt=0.05, t_end=0.1, max_events=1, throw=False)
    assert not run.success
    assert run.events[0].impulse > 0.0
    assert run.events[0].t > run.t[-1]
    assert run.certificate.impact_gain == ImpactGain()


# ---- the rows -------------------------------------------------------------------------------------------------------


def test_rows_that_are_none_one_or_unimpulsive():
    d = kane().dynamics
    assert gain_eigenvalue(d, []) == gain_eigenvalue(d, [0]) == 0.0
    assert gain_eigenvalue(d, [1]) == pytest.approx(2.0 * KANE_H[1] @ np.linalg.solve(KANE_M, KANE_H[1]))
    assert gain_eigenvalue(d, [0, 1]) == gain_eigenvalue(d, np.array([True, True])) == gain_eigenvalue(d) < 0.0
    oscillator = li.Scheme(li.Mass("x", 1.0), li.Slider("x", "ground", 1.0)).assemble()
    assert gain_eigenvalue(oscillator) == gain_eigenvalue(li.Scheme(li.Mass("x", 1.0)).assemble()) == 0.0


def test_redundant_contacts_with_one_e_cannot_gain():
    """W is singular: the eigenvalue is zero, and its rounding is no gain."""
    scheme = li.Scheme.of_matrices(
        KANE_M, H=np.repeat(KANE_H[:1], 3, axis=0), e=[0.3] * 3, coordinates=("α", "β"), contacts=("N", "N2", "N3")
    )
    tip = {"α": KANE_H[1, 0], "β": KANE_H[1, 1]}
    for e_T, sign in ((0.3, 0), (0.0, -1)):
        d = li.Scheme(*scheme.elements, *(li.Friction("ground", tip, 0.5, "N", e_T=e_T) for _ in range(3))).assemble()
        assert np.sign(gain_eigenvalue(d)) == sign


def test_the_sign_does_not_depend_on_the_units_of_a_row():
    """A gap in other units scales its row: the eigenvalue then lies below the rounding of the matrix, and is no rounding."""
    rods = kane().scheme
    for unit in 10.0 ** -np.arange(12.0):
        tip = {"α": unit * KANE_H[0, 0], "β": unit * KANE_H[0, 1]}
        bumpers = [li.Bumper("ground", tip, e=e, name=f"N{e}") for e in (0.5, 0.6, 0.7)]
        rough = [dataclasses.replace(rods.elements[2], normal=each.name, name=f"T{each.name}") for each in bumpers]
        assert gain_eigenvalue(li.Scheme(rods.elements[0], *bumpers, *rough).assemble()) < 0.0


def test_joints_act_as_one_body():
    """Two masses that a link joins act as their sum, whatever rows the link couples."""

    def eigenvalue(*elements, x):
        tip, slip = {"y": 1.0, "φ": 1.0}, {x: 1.0, "φ": -1.0}
        rough = li.Bumper("ground", tip, e=0.8, name="N"), li.Friction(slip, "ground", 0.8, "N", e_T=0.0)
        return gain_eigenvalue(li.Scheme(li.Mass("y", 3.0), li.Mass("φ", 0.5), *elements, *rough).assemble())

    masses = li.Mass("x", 1.0), li.Mass("z", 2.0)
    whole = eigenvalue(li.Mass("x", 3.0), x="x")
    assert whole < 0.0
    assert eigenvalue(*masses, li.RigidLink("x", "z"), x="z") == pytest.approx(whole, rel=1e-12)
    twice = li.RigidLink("x", "z", name="J1"), li.RigidLink("x", "z", name="J2")
    assert eigenvalue(*masses, *twice, x="z") == pytest.approx(whole, rel=1e-12)
    assert eigenvalue(*masses, x="z") != pytest.approx(whole, rel=1e-2)


def test_a_massless_plate_passes_the_impulse_on():
    """Body, plate and ground act as one contact, with the larger e of both; a driven node takes up no impulse."""

    def eigenvalue(*elements, e, lower="ground"):
        bumper = li.Bumper(lower, "y", e=e, name="N")
        mass = li.Substructure(("x", "y"), M=[[1.0, 0.6], [0.6, 1.0]])
        rough = li.Friction("x", "ground", 0.8, "N", e_T=0.0, name="T")
        return gain_eigenvalue(li.Scheme(mass, bumper, rough, *elements).assemble())

    plate = li.Dashpot("plate", "ground", 3.0), li.Bumper("ground", "plate", e=0.9, name="N2")
    assert eigenvalue(e=0.9) < eigenvalue(e=0.2)
    assert eigenvalue(e=0.9) < 0.0
    for e in (0.2, 0.9):
        assert eigenvalue(*plate, e=e, lower="plate") == pytest.approx(eigenvalue(e=0.9), rel=1e-12)
    wall = li.PrescribedMotion("wall", li.Polynomial([0.0, 1.0]))
    assert eigenvalue(wall, e=0.9, lower="wall") == pytest.approx(eigenvalue(e=0.9), rel=1e-12)


# ---- the law --------------------------------------------------------------------------------------------------------


def rough_body(seed):
    """A body of random inertia with one or two rough contacts, on walls and belts that move or do not."""
    rng = np.random.default_rng(seed)
    n, count, names = 4, int(rng.integers(1, 3)), ("a", "b", "c", "d")
    L = np.tril(rng.uniform(-1.0, 1.0, (n, n)), -1) + np.diag(rng.uniform(0.5, 2.0, n))
    M, H, χ = L @ L.T, rng.uniform(-1.0, 1.0, (2 * count, n)), rng.uniform(-0.5, 0.5, 2 * count) * rng.integers(2)
    e = rng.choice([0.0, 0.3, 0.8, 1.0, rng.uniform()], 2 * count)
    if rng.integers(4) == 0:
        e[:] = e[0]
    scheme = li.Scheme(li.Substructure(names, M=M.tolist()))
    for k in range(count):
        for i, kind in ((k, "wall"), (count + k, "belt")):
            scheme.add(li.PrescribedMotion(f"{kind}{k}", li.Polynomial([0.0, -χ[i]])))
        point, slip = (dict(zip(names, H[i], strict=True)) for i in (k, count + k))
        scheme.add(li.Bumper(f"wall{k}", point, e=e[k], name=f"N{k}"))
        mu = rng.choice([0.0, 0.3, 1.0, 10.0])
        scheme.add(li.Friction(f"belt{k}", slip, mu, f"N{k}", e_T=e[count + k], name=f"T{k}"))
    U_N = -rng.uniform(0.0, 1.0, count)
    slips = np.linalg.lstsq(H[:count], U_N - χ[:count], rcond=None)[0]
    free = np.eye(n) - np.linalg.pinv(H[:count]) @ H[:count]
    v = slips + free @ rng.uniform(-2.0, 2.0, n)
    return li.Problem("rough body", scheme, v0=dict(zip(names, v, strict=True)), t_end=1e-3), M, H, χ, e


@settings(max_examples=150, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
@example(seed=693064780)  # only with Δ of the e themselves is the matrix positive definite
def test_the_formula_is_the_change_of_kinetic_energy(seed):
    """ΔT = Pᵀ(I+E)⁻¹ξ - ½PᵀΔWP - Pᵀχ at any impact, the first term never gains, and no eigenvalue lies."""
    problem, M, H, χ, e = rough_body(seed)
    run = li.simulate(problem, "moreau-jean", dt=1e-3, t_end=1e-3)
    struck = [event for event in run.events if event.impulse != 0.0]
    if not struck:
        return
    rows, P = [contact.name for contact in problem.dynamics.contacts], np.zeros(len(e))
    count = len(e) // 2
    order = [rows.index(f"{kind}{k}") for kind in "NT" for k in range(count)]
    for event in struck:
        P[order.index(rows.index(event.contact))] = event.impulse
    before, after = problem.initial_velocities[:4], struck[0].right.v[:4]
    U, U_after, W = H @ before + χ, H @ after + χ, H @ np.linalg.solve(M, H.T)
    Δ, ξ = np.diag((1.0 - e) / (1.0 + e)), U_after + e * U
    first, by_law = P @ (ξ / (1.0 + e)), -0.5 * P @ Δ @ W @ P
    size = 1e-12 * (1.0 + np.abs(P) @ np.abs(W) @ np.abs(P))
    change = 0.5 * (after @ M @ after - before @ M @ before)
    assert change == pytest.approx(first + by_law - P @ χ, abs=size)
    assert first <= size
    found = run.certificate.impact_gain
    assert found.by_motions == pytest.approx(-P @ χ, abs=size)
    assert found.gained == pytest.approx(max(first + by_law, 0.0), abs=1e3 * size)
    if gain_eigenvalue(problem.dynamics) >= 0.0 or np.linalg.eigvalsh(Δ @ W + W @ Δ)[0] >= 0.0:
        assert first + by_law <= size
        assert found.case == "cannot gain"


def test_the_law_is_the_reason_of_a_gain_where_there_is_one():
    """Among many random impacts some gain, and each of them has a negative eigenvalue."""
    cases = {"gained": 0, "can gain": 0, "cannot gain": 0}
    for seed in range(120):
        problem, *_ = rough_body(seed)
        run = li.simulate(problem, "moreau-jean", dt=1e-3, t_end=1e-3)
        cases[run.certificate.impact_gain.case] += 1
    assert min(cases.values()) > 0


# ---- errors of a method ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("method", RUBBING)
def test_a_gain_that_the_law_does_not_explain_is_found(method):
    """A run with the gain of e_T = 0 violates the law of e_T = 0.5; so does one with the momentum of another."""
    run = li.simulate(kane(gap=0.005), method, dt=1e-3, t_end=0.1)
    assert run.success
    assert not run.certify(kane(gap=0.005, e_T=0.5)).holds
    late, v = run.t > 0.06, run.v.copy()
    v[late] *= 1.01
    broken = dataclasses.replace(run, v=v)
    assert not broken.certify().holds
    events = tuple(
        dataclasses.replace(event, impulse=1.01 * event.impulse) if event.contact == "T" else event
        for event in run.events
    )
    assert not dataclasses.replace(run, events=events).certify().holds


def test_an_imbalance_is_found_beside_a_gain():
    """What the law gains is in the balance of a run, and no more: the same run with a 1 % lighter body is out of it."""
    run = li.simulate(kane(gap=0.005), "exact", dt=1e-3, t_end=0.1)
    assert run.certificate.energy_balance < 1e-14
    assert run.certificate.impact_gain.gained > 0.01
    events = tuple(
        dataclasses.replace(event, right=dataclasses.replace(event.right, v=1.01 * event.right.v))
        if event.kind == "impact"
        else event
        for event in run.events
    )
    wrong = dataclasses.replace(run, events=events).certify()
    assert "energy_balance" in {name for name, limit in wrong.limits.items() if getattr(wrong, name) > limit}


def test_what_no_law_explains_is_no_gain_of_the_law():
    """A frictionless impact that gains beside a moving wall is an error of the run."""
    scheme = li.Scheme(
        li.Mass("x", 2.0),
        li.PrescribedMotion("wall", li.Polynomial([0.0, 0.3])),
        li.Bumper("wall", "x", 0.05, 0.6, "R"),
    )
    run = li.simulate(li.Problem("wall", scheme, v0={"x": -1.0}), "exact", dt=1e-3, t_end=0.1)
    (event,) = (event for event in run.events if event.impulse)
    faster = dataclasses.replace(event.right, v=event.right.v * [4.0, 1.0])
    wrong = dataclasses.replace(run, events=(dataclasses.replace(event, right=faster),)).certify()
    assert not wrong.holds
    assert wrong.impact_gain.case == "cannot gain"


# ---- steps ----------------------------------------------------------------------------------------------------------


def test_the_step_of_an_event_is_the_one_with_its_left_limits():
    t, q = np.arange(5.0), np.array([[0.0], [1.0], [2.0], [2.0], [4.0]])

    def event(at, place):
        state = State(np.array([place]), np.array([place]), np.zeros(0))
        return li.Event(at, "R", "impact", state, state, 1.0)

    for at, place, step in (
        (1.5, 1.0, 1), (2.0, 1.0, 1), (0.99, 1.0, 1), (3.0, 2.0, 3), (2.5, 2.0, 2), (3.5, 9.0, 3), (4.0, 9.0, 3)
    ):  # fmt: skip
        assert steps_of([event(at, place)], t, q, q).tolist() == [step]
    assert steps_of([], t, q, q).tolist() == []


def test_an_impact_that_spreads_over_two_steps_is_one():
    run = li.simulate(li.load_problem("bouncing-ball"), "schatzman-paoli", dt=1e-3, t_end=1.0)
    d = run.problem.dynamics
    impacts = RunImpacts.of_steps(d, run, run.events, 2)
    change = (impacts.after - impacts.before) @ d.M.T - impacts.P @ d.B.T
    assert_allclose(change, [2e-3 * d.force(0.0)], rtol=1e-9)


def test_impacts_of_one_step_are_one():
    """Two contacts that close in one step at different instants have one impulse vector, and one gain."""
    scheme = li.Scheme.of_matrices(np.diag([1.0, 1.5]), H=[[1.0, -1.0], [1.0, 1.0]], gaps=[0.01, 0.0102], e=[0.5, 0.5])
    run = li.simulate(li.Problem("bar", scheme, v0={"q1": -1.0}), "moreau-jean", dt=1e-2, t_end=0.05)
    struck = [event for event in run.events if event.impulse]
    assert len({event.t for event in struck}) == 2
    impacts = RunImpacts.of_steps(run.problem.dynamics, run, run.events, 1)
    assert len(impacts.t) == 1
    assert_allclose(impacts.P, [[event.impulse for event in struck]], atol=1e-12)
    d = run.problem.dynamics
    assert_allclose((impacts.after - impacts.before) @ d.M.T, impacts.P @ d.B.T, atol=1e-12)


def resting_rods(load):
    """Kane's rods whose tip rests on the floor, pressed, while a hammer strikes the first of them."""
    scheme = li.Scheme.of_matrices(
        KANE_M, H=KANE_H[:1], e=[0.5], coordinates=("α", "β"), contacts=("N",), f=[0.0, -load]
    )
    scheme.add(
        li.Friction("ground", {"α": KANE_H[1, 0], "β": KANE_H[1, 1]}, STICKS, "N", e_T=0.0, name="T"),
        li.Mass("hammer", 0.5), li.Bumper("hammer", "α", gap=0.05, e=0.9, name="R"),
    )  # fmt: skip
    return li.Problem("resting rods", scheme, v0={"hammer": 1.0}, t_end=0.1)


def test_the_impulses_of_contacts_that_rest_are_counted():
    """In the step of a blow a resting contact has a reaction, not an impact of its own; its impulse takes part."""
    run = li.simulate(resting_rods(load=1.0), "moreau-jean", dt=1e-4, t_end=0.1)
    d = run.problem.dynamics
    impacts = RunImpacts.of_steps(d, run, run.events, 1)
    change = (impacts.after - impacts.before) @ d.M.T - impacts.P @ d.B.T
    assert np.abs(impacts.P).min(axis=1).max() > 0.0
    assert np.abs(change).max() < 2e-4
