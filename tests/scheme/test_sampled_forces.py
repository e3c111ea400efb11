"""Sampled forces: the loop with a zero-order hold by SciPy, its stability limits, and impacts by hand-written cases."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.signal import cont2discrete

import lcpimpact as li
from lcpimpact.integrators import METHODS
from lcpimpact.integrators.printed.lanes import Lanes
from lcpimpact.study.dynamics.shooting import refuse_power_laws
from lcpimpact.sweeps import side_by_side
from lcpimpact.truth.document import document

EXACT = [("exact", {}, 1e-12), ("event-driven", {"rtol": 1e-12}, 1e-10)]
SAMPLES = 40


def servo(T: float, m=2.0, k=30.0, c=0.7, kp=40.0, kd=6.0, reference=0.3, **given) -> li.Problem:
    """A mass on a spring and a dashpot, steered to the reference."""
    held = li.SampledForce("x", kp=kp, kd=kd, reference=reference, period=T, **given)
    joined = [li.Spring("x", "ground", k=k), li.Dashpot("x", "ground", c=c)] if k else []
    return li.Problem("servo", li.Scheme(li.Mass("x", m=m), *joined, held), q0={"x": 0.2}, v0={"x": -1.0})


def loop(A, B, law, x, T: float, samples: int, phase: float = 0.0) -> np.ndarray:
    """The states of x' = A x + B u at the instants phase + k T, with u held between them and zero before."""
    A, B = np.array(A, dtype=float), np.array(B, dtype=float)
    Φ, Γ, *_ = cont2discrete((A, B, np.eye(len(A)), 0.0 * B), T, "zoh")
    states = [cont2discrete((A, B, np.eye(len(A)), 0.0 * B), phase, "zoh")[0] @ x if phase else np.array(x)]
    for i in range(samples):
        states.append(Φ @ states[-1] + Γ @ np.atleast_1d(law(phase + i * T, states[-1])))
    return np.array(states)


def servo_loop(T: float, samples: int = SAMPLES, m=2.0, k=30.0, c=0.7, phase: float = 0.0, reference=lambda t: 0.3):
    def law(t, x):
        return -40.0 * (x[0] - reference(t)) - 6.0 * x[1]

    return loop([[0.0, 1.0], [-k / m, -c / m]], [[0.0], [1.0 / m]], law, [0.2, -1.0], T, samples, phase)


def off(run, truth, every: int = 1, first: int = 0) -> float:
    """The largest error of q and v at the samples, relative to their largest values."""
    n = len(run.nodes)
    found = np.hstack([run.q, run.v])[first::every]
    return max(float(np.abs((found - truth)[:, [i]]).max() / np.abs(truth[:, i]).max()) for i in range(2 * n))


@pytest.mark.parametrize(("method", "options", "within"), EXACT)
@pytest.mark.parametrize("T", [0.1, 0.5])  # the second loop is unstable
def test_the_loop_is_that_of_the_zero_order_hold(method, options, within, T):
    truth = servo_loop(T)
    assert (np.abs(truth[-1]).max() > 10.0) == (T > 0.2)
    run = li.simulate(servo(T), method, dt=T, t_end=SAMPLES * T, **options)
    assert run.success
    assert off(run, truth) < within


@pytest.mark.parametrize(("method", "options", "within"), EXACT)
def test_the_first_instant_is_the_phase_and_the_reference_is_read_there(method, options, within):
    T, wave = 0.1, li.Harmonic(amplitude=0.5, omega=3.0, phase=0.4)
    truth = servo_loop(T, phase=0.05, reference=wave)
    run = li.simulate(servo(T, phase=0.05, reference=wave), method, dt=T / 2, t_end=T * (SAMPLES + 0.5), **options)
    assert off(run, truth, every=2, first=1) < within


def test_a_double_integrator_is_stable_up_to_its_limit():
    # m x'' = u, u = -kp x - kd v: det z = 1 + kp T²/2m - kd T/m < 1, and z = -1 at kd T = 2 m.
    for kp, kd in ((10.0, 2.0), (1.0, 10.0)):
        limit = min(2.0 * kd / kp, 2.0 / kd)
        for part, grows in ((0.98, False), (1.02, True)):
            T = part * limit
            run = li.simulate(servo(T, m=1.0, k=0.0, kp=kp, kd=kd, reference=0.0), "exact", dt=T, t_end=600 * T)
            early, late = np.abs(run.q[200:240]).max(), np.abs(run.q[560:]).max()
            assert (late > 2.0 * early) if grows else (late < 0.5 * early), (kp, kd, part)


@pytest.mark.parametrize("method", ["moreau-jean", "exact"])
def test_a_loop_that_grows_beyond_all_numbers_ends_with_its_status(method):
    run = li.simulate(servo(1.0, m=1.0, k=0.0, kp=1e3, kd=1e3), method, dt=1.0, t_end=300.0, throw=False)
    assert not run.success
    assert run.t[-1] < 300.0 or run.status is li.Status.VIOLATED
    assert run.message.startswith(method)


@pytest.mark.parametrize("theta", [0.5, 1.0])
def test_the_order_of_moreau_jean_is_that_without_a_controller(theta):
    T, samples = 0.1, 20
    errors = [
        off(li.simulate(servo(T), dt=T / n, t_end=samples * T, theta=theta), servo_loop(T, samples), every=n)
        for n in (16, 32, 64)
    ]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert abs(orders - (2.0 if theta == 0.5 else 1.0)).max() < 0.06


PAIR = li.Scheme(li.Mass("x", m=1.0), li.Mass("y", m=3.0), li.Spring("y", "ground", k=20.0))


@pytest.mark.parametrize(
    "held",
    [
        li.SampledForce(("x", "y"), kp=8.0, kd=1.5, reference=0.1, period=0.2),
        li.SampledForce(
            ("x", "y"),
            lambda t, q, v: (8.0 * (q[1] - q[0] - 0.1) + 1.5 * (v[1] - v[0])) * np.array([1.0, -1.0]),
            period=0.2,
        ),
    ],
    ids=["linear", "function"],
)
def test_between_two_nodes(held):
    problem = li.Problem("pair", li.Scheme(*PAIR.elements, held), q0={"x": 0.5}, v0={"y": 1.0})
    A = np.zeros((4, 4))
    A[[0, 1], [2, 3]], A[3, 1] = 1.0, -20.0 / 3.0
    B = [[0.0], [0.0], [-1.0], [1.0 / 3.0]]

    def law(t, x):
        return -8.0 * (x[1] - x[0] - 0.1) - 1.5 * (x[3] - x[2])

    truth = loop(A, B, law, [0.5, 0.0, 0.0, 1.0], 0.2, 20)
    for method, options, within in EXACT:
        assert off(li.simulate(problem, method, dt=0.2, t_end=4.0, **options), truth) < within
    assert off(li.simulate(problem, dt=0.2 / 64, t_end=4.0), truth, every=64) < 1e-3


def test_a_node_that_is_driven_is_read():
    wall = li.Harmonic(amplitude=0.2, omega=4.0)

    def f(t, q, v):
        return np.array([50.0 * (q[1] - q[0]) + 5.0 * (v[1] - v[0]), 0.0])

    law = li.SampledForce(("x", "w"), f, period=0.1)
    problem = li.Problem("tracking", li.Scheme(li.Mass("x", m=1.0), li.PrescribedMotion("w", wall), law))

    def by_hand(t, x):
        return 50.0 * (wall(t) - x[0]) + 5.0 * (wall.rate(t) - x[1])

    truth = loop([[0.0, 1.0], [0.0, 0.0]], [[0.0], [1.0]], by_hand, [0.0, 0.0], 0.1, 30)
    for method, options, within in (*EXACT, ("moreau-jean", {}, 1e-10)):  # a constant force, which θ = 1/2 has exactly
        run = li.simulate(problem, method, dt=0.1, t_end=3.0, **options)
        assert np.abs(np.column_stack([run["x"], run["v_x"]]) - truth).max() < 10.0 * within


def test_many_nodes():
    column = li.Chain(n=24, m=1.0, k=400.0, c=2.0, b="ground")
    scheme = li.Scheme(column, li.SampledForce("x.1", kp=50.0, kd=10.0, reference=0.2, period=0.05))
    problem = li.Problem("column", scheme)
    exact, run = (li.simulate(problem, name, dt=0.05 / 32, t_end=1.0) for name in ("exact", "moreau-jean"))
    assert run.success
    assert np.abs(run.q - exact.q).max() < 2e-4 * np.abs(exact.q).max()


# ---- impacts ------------------------------------------------------------------------------------------------------------

T_PLATE, GAP, E, BALL, PLATE, G = 0.05, 0.3, 0.7, 0.5, 2.0, 9.81


def juggler(**given) -> li.Problem:
    """A ball on a plate that a controller holds at its place."""
    return li.Problem(
        "juggler",
        li.Scheme(
            li.Mass("b", m=BALL), li.Load("b", f=BALL * G), li.Bumper("b", "p", gap=GAP, e=E),
            li.Mass("p", m=PLATE), li.SampledForce("p", kp=400.0, kd=30.0, period=T_PLATE, **given),
        ),
        t_end=0.8,
    )  # fmt: skip


def juggled(end: float) -> np.ndarray:
    """b, p and their velocities at the end, by SciPy from sample to sample and from impact to impact."""
    x, t = np.zeros(4), 0.0
    for k in range(round(end / T_PLATE)):
        force = -400.0 * x[1] - 30.0 * x[3]

        def rate(t, x, force=force):
            return [x[2], x[3], G, force / PLATE]

        def meets(t, x):
            return x[1] - x[0] + GAP

        meets.terminal, meets.direction = True, -1.0
        while t < (k + 1) * T_PLATE:
            run = solve_ivp(rate, (t, (k + 1) * T_PLATE), x, "DOP853", rtol=1e-12, atol=1e-14, events=meets)
            t, x = float(run.t[-1]), run.y[:, -1]
            if run.status == 1:
                Λ = (1.0 + E) * (x[2] - x[3]) / (1.0 / BALL + 1.0 / PLATE)
                x = x + np.array([0.0, 0.0, -Λ / BALL, Λ / PLATE])
    return x


def test_a_ball_on_a_controlled_plate():
    truth = juggled(0.8)
    for method, options, _ in EXACT:
        run = li.simulate(juggler(), method, dt=T_PLATE, **options)
        assert run.success
        assert sum(event.kind == "impact" for event in run.events) > 1
        assert np.abs(np.hstack([run.q[-1], run.v[-1]]) - truth).max() < 1e-9
    for theta in (0.5, 1.0):
        run = li.simulate(juggler(), dt=T_PLATE / 500, theta=theta)
        assert run.success
        assert np.abs(run.q[-1] - truth[:2]).max() < 2e-3
    adaptive = li.simulate(juggler(), dt=T_PLATE / 10, rtol=1e-7)
    assert adaptive.success
    assert np.abs(adaptive.q[-1] - truth[:2]).max() < 1e-5


@pytest.mark.parametrize(("method", "options", "within"), EXACT)
def test_an_impact_at_an_instant_comes_before_the_sample(method, options, within):
    # At 1 m/s the mass meets the stop at 0.5 s, where the controller reads its velocity after the impact.
    scheme = li.Scheme(
        li.Mass("x", m=1.0),
        li.Bumper("x", "ground", gap=0.5, e=0.6),
        li.SampledForce("x", lambda t, q, v: 3.0 * v, period=0.25, phase=0.5),
    )
    run = li.simulate(li.Problem("met", scheme, v0={"x": 1.0}), method, dt=0.25, t_end=0.75, **options)
    assert [event.kind for event in run.events] == ["impact"]
    assert abs(run["v_x"][-1] - (-0.6 - 3.0 * 0.6 * 0.25)) < within
    ((node, force),) = run.dynamics.loads
    assert (node, force(0.49)) == (0, 0.0)
    assert abs(force(0.6) + 1.8) < within


# ---- certificates, errors, files ----------------------------------------------------------------------------------------


def test_runs_are_judged_by_the_law():
    for method in ("moreau-jean", "event-driven", "exact"):
        run = li.simulate(juggler(), method, dt=T_PLATE / 50)
        assert run.certify().holds
        other = juggler().scheme.elements[:-1]
        stiffer = li.Scheme(*other, li.SampledForce("p", kp=500.0, kd=30.0, period=T_PLATE))
        assert not run.certify(li.Problem("stiffer", stiffer)).holds, "the force that another law would have set"
        if method != "moreau-jean":
            continue
        ledger = li.energy_ledger(run)
        assert abs(ledger.table["loads"].iloc[-1]) > 0.1, "the controller does work"
        assert ledger.balance < 1e-9


def test_errors_by_halving_and_by_the_exact_motion_are_those_of_the_run():
    T = 0.1
    run = li.simulate(servo(T), dt=T / 8, t_end=4.0)
    truth = float(np.abs(run["x"] - li.simulate(servo(T), "exact", dt=T / 8, t_end=4.0)["x"]).max())
    for how in ("exact", "halving"):
        error = run.estimate_error(how)
        assert error.how == how
        assert 0.8 * truth < error["x"] < 1.25 * truth
    for n in (20, 50):
        bounced = li.simulate(juggler(), dt=T_PLATE / n)
        error = bounced.estimate_error("halving")
        assert "dt/17" in error.reason, "the steps of the fourth run end at the instants too"
        assert 0.95 < error["b"] / bounced.estimate_error("exact")["b"] < 1.3


def test_a_run_equals_its_two_halves():
    for method in ("moreau-jean", "exact"):
        whole = li.simulate(juggler(), method, dt=T_PLATE / 50)
        middle = 8 * 50
        state = [dict(zip(("b", "p"), each[middle].tolist(), strict=True)) for each in (whole.q, whole.v)]
        later = li.Problem("later", juggler().scheme, q0=state[0], v0=state[1])
        rest = li.simulate(later, method, dt=T_PLATE / 50, t_end=0.4)
        assert np.abs(rest.q - whole.q[middle:]).max() < 1e-12


def test_runs_and_schemes_come_back_from_files(tmp_path):
    wave = li.Ramp(0.0, 1.0, 0.2, 0.4) + li.Harmonic(amplitude=0.1, omega=5.0)
    held = li.SampledForce(("x", "y"), kp=8.0, kd=1.5, reference=wave, period=0.2, phase=0.1)
    problem = li.Problem("pair", li.Scheme(*PAIR.elements, held), q0={"x": 0.5})
    assert li.read_scheme_file(li.write_scheme_file(problem, tmp_path / "pair.toml")).problem == problem
    run = li.simulate(problem, dt=0.01, t_end=1.0)
    again = li.read_run(run.save(tmp_path / "pair.npz"))
    assert again.certify().holds
    assert again.dynamics.loads == run.dynamics.loads
    text = (tmp_path / "pair.toml").read_text().replace("kp = 8.0", "kp = nan")
    (tmp_path / "bad.toml").write_text(text)
    with pytest.raises(
        li.InputError, match=r"elements\[3\].*SampledForce between 'x' and 'y': kp = nan must be a finite"
    ):
        li.read_scheme_file(tmp_path / "bad.toml")


def test_sweeps_are_the_runs_one_by_one():
    problem = servo(0.1)
    for name, values in (("k", [20.0, 30.0]), ("kp", [30.0, 40.0]), ("period", [0.1, 0.2])):
        table = li.sweep(problem, {name: values}, dt=0.01, t_end=1.0, outputs=("x@1.0",), progress=False)
        for value, found in zip(values, table["x@1.0"].values.tolist(), strict=True):
            alone = servo(**({"T": 0.1} | {("T" if name == "period" else name): value}))
            assert found == li.simulate(alone, dt=0.01, t_end=1.0)["x"][-1]


@pytest.mark.compiled
def test_many_sets_run_one_by_one(monkeypatch):
    monkeypatch.setattr(side_by_side, "WORTH_COMPILING", side_by_side.MIN_SETS)
    monkeypatch.setattr(Lanes, "take", None)  # their steps would not stop at the instants
    values = np.linspace(20.0, 40.0, 2 * side_by_side.MIN_SETS)
    table = li.sweep(servo(0.1), {"k": values}, dt=0.01, t_end=1.0, outputs=("x@1.0",), progress=False)
    for i in (0, 70, len(values) - 1):
        assert table["x@1.0"].values[i] == li.simulate(servo(0.1, k=values[i]), dt=0.01, t_end=1.0)["x"][-1]


def test_each_node_has_an_arrow_with_a_staircase():
    one, two = (li.SampledForce(node, kp=1.0, kd=0.0, period=1.0) for node in ("x", ("x", "y")))
    assert one.drawn() == (one,)
    assert [each.nodes for each in two.drawn()] == [("x",), ("y",)]
    assert len(one.strokes) == len(li.Load.strokes) + 1


# ---- refusals -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("node", "given", "says"),
    [
        ("x", {"period": 0.0}, "period = 0.0 must be a positive finite number in s"),
        ("x", {"period": -1.0}, "period = -1.0 must be a positive finite number in s"),
        ("x", {}, "period is missing; give a positive number in s"),
        ("x", {"period": 1.0, "phase": -0.1}, "phase = -0.1 must be a finite time in s, zero or more"),
        ("x", {"period": 1.0, "f": None}, "f is missing; give a function of t, q and v, or kp and kd"),
        ("x", {"period": 1.0, "f": None, "kp": 1.0}, "kd is missing; give a number, 0 for none"),
        ("x", {"period": 1.0, "f": None, "kp": np.inf, "kd": 0.0}, "kp = inf must be a finite number"),
        (
            "x",
            {"period": 1.0, "f": None, "kp": 1.0, "kd": 0.0, "reference": "a"},
            "reference = 'a' must be a finite place",
        ),
        ("x", {"period": 1.0, "kp": 1.0, "kd": 1.0}, "f is given beside constants of a linear law"),
        ("x", {"period": 1.0, "f": 3.0}, "f = 3.0 must be a function of t, q and v"),
        ("ground", {"period": 1.0}, "a force on the ground moves nothing"),
        (("x", "x"), {"period": 1.0}, "both ends are one node"),
        ((), {"period": 1.0}, r"node = \(\) of a SampledForce must be a node, or a tuple of nodes"),
        (["x", "y"], {"period": 1.0}, r"node = \['x', 'y'\] of a SampledForce must be a node, or a tuple of nodes"),
        (3, {"period": 1.0}, "node = 3 of a SampledForce must be a node, or a tuple of nodes"),
        (("x", "y", "z"), {"period": 1.0, "f": None, "kp": 1.0, "kd": 1.0}, "give f for 3 nodes"),
    ],
)
def test_bad_constants_are_refused(node, given, says):
    with pytest.raises(li.InputError, match=says):
        li.SampledForce(node, **({"f": lambda t, q, v: 0.0} | given))


def test_nodes_without_mass_are_refused():
    held = li.SampledForce("y", kp=1.0, kd=1.0, period=1.0)
    with pytest.raises(li.InputError, match="SampledForce at 'y': 'y' has no mass"):
        li.Scheme(li.Mass("x", m=1.0), li.Dashpot("x", "y", c=1.0), held).assemble()
    with pytest.raises(li.InputError, match="nothing holds node 'y'"):
        li.Scheme(li.Mass("x", m=1.0), held).assemble()


def steered(f) -> li.Problem:
    return li.Problem("steered", li.Scheme(li.Mass("x", m=1.0), li.SampledForce("x", f, period=0.1)), q0={"x": 1.0})


class Counter:
    """A law with a memory."""

    def __init__(self):
        self.sum = 0.0

    def __call__(self, t, q, v):
        self.sum += q
        return -self.sum


@pytest.mark.parametrize(
    ("f", "says"),
    [
        (lambda t, q, v: None, r"f\(0.0, 1.0, 0.0\) returns None; return a number"),
        (lambda t, q, v: np.zeros(2), r"f\(0.0, 1.0, 0.0\) returns \[0.0, 0.0\]; return a number"),
        (lambda t, q, v: np.nan, r"f gives \[nan\] at t = 0 s for q = \[1.0\] and v = \[0.0\]; return finite numbers"),
        (lambda t, q, v: np.nan if t == 0.2 else 0.0, r"f gives \[nan\] at t = 0.2 s"),
        (lambda t: 0.0, r"f\(0.0, 1.0, 0.0\) fails by TypeError.*a function takes t, q and v"),
        (Counter(), r"f gives \[-\d.0\] and \[-\d.0\] .* must be a function of these alone, without a memory"),
    ],
)
@pytest.mark.parametrize("method", ["moreau-jean", "event-driven", "exact"])
def test_laws_that_give_no_force_are_refused(method, f, says):
    with pytest.raises(li.InputError, match=f"SampledForce at 'x': {says}") as refused:
        li.simulate(steered(f), method, dt=0.01, t_end=1.0)
    assert "\n" not in str(refused.value)


def test_a_step_that_holds_an_instant_is_refused_with_one_that_does():
    with pytest.raises(
        li.InputError, match=r"is set at t = 0.1 s, within a step of dt = 0.03 s: take dt = 0.025"
    ) as no:
        li.simulate(servo(0.1), dt=0.03, t_end=3.0)
    assert "method='exact'" in str(no.value)
    assert li.simulate(servo(0.1), dt=0.025, t_end=3.0).success
    assert li.simulate(servo(0.1), "exact", dt=0.03, t_end=3.0).success
    with pytest.raises(li.InputError, match="take a dt of which its phase and period are whole multiples"):
        li.simulate(servo(0.1, phase=0.1 / np.pi), dt=0.01, t_end=1.0)
    with pytest.raises(li.InputError, match="at most 1,000,000 times are followed: shorten the run, or take a longer"):
        li.simulate(servo(1e-7), "exact", dt=0.01, t_end=1.0)


def test_others_refuse_it_in_words(tmp_path, monkeypatch):
    problem = servo(0.1)
    able = {name for name, kind in METHODS.items() if "sampled forces" in kind.declared.handles}
    assert able == {"moreau-jean", "event-driven", "exact"}
    with pytest.raises(li.UnsupportedError, match=r"rk4 does not handle sampled forces .* take method='event-driven'"):
        li.simulate(problem, "rk4", dt=0.01, t_end=1.0)
    with pytest.raises(li.UnsupportedError, match="studies of orbits do not take them"):
        refuse_power_laws(problem)
    with pytest.raises(li.UnsupportedError, match="the explorer does not take 'servo': it has sampled forces"):
        li.explore(problem, tmp_path / "page.html")
    with pytest.raises(li.UnsupportedError, match=r"sparse steps take .* and not SampledForce at 'x'"):
        li.SparseScheme(*problem.scheme.elements).assemble()
    monkeypatch.setitem(document.__globals__, "PROBLEMS", {"servo": servo})
    with pytest.raises(
        li.InputError, match="SampledForce at 'x' is set at instants, and files of problems hold no such"
    ):
        document(problem)
