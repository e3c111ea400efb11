"""Systems given by A, B, C, D: the diode bridge, the paper's systems by both doors, and refusals."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import lcpimpact as li
from lcpimpact import Harmonic, LinearComplementaritySystem
from lcpimpact.integrators import METHODS
from lcpimpact.scheme.first_order import first_order_form
from lcpimpact.scheme.structure import Feature

L, C, R = 1e-2, 1e-6, 1e3
BRIDGE = LinearComplementaritySystem(
    A=[[0.0, -1.0 / C], [1.0 / L, 0.0]],
    B=[[0.0, 0.0, -1.0 / C, 1.0 / C], [0.0, 0.0, 0.0, 0.0]],
    C=[[0.0, 0.0], [0.0, 0.0], [-1.0, 0.0], [1.0, 0.0]],
    D=[[1 / R, 1 / R, -1.0, 0.0], [1 / R, 1 / R, 0.0, -1.0], [1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0]],
    states=("v", "i"),
)


def damped_lc(t):
    """v of the LC circuit that the bridge's resistor always sees: C v'' + v'/R + v/L = 0 from v = 10, i = 0."""
    ω, ζ = 1.0 / math.sqrt(L * C), 0.5 / R * math.sqrt(L / C)
    ω_d = ω * math.sqrt(1.0 - ζ**2)
    return 10.0 * np.exp(-ζ * ω * t) * (np.cos(ω_d * t) - ζ / math.sqrt(1.0 - ζ**2) * np.sin(ω_d * t))


def test_exact_solves_the_diode_bridge():
    run = li.simulate(li.Problem("bridge", BRIDGE, q0={"v": 10.0}), "exact", dt=5e-6, t_end=5e-3)
    np.testing.assert_allclose(run["v"], damped_lc(run.t), rtol=0.0, atol=1e-10)
    assert run["v"][-1] == pytest.approx(0.790322819644, abs=1e-11)
    assert run["i"][-1] == pytest.approx(-0.0026478501601, abs=1e-13)
    # The current through the resistor is a rectified v.
    np.testing.assert_allclose(run["λ1"] + run["λ2"], np.abs(run["v"]), rtol=0.0, atol=1e-9)
    assert run.certificate.penetration < 1e-12
    assert math.isnan(run.certificate.energy_balance)


def test_moreau_jean_solves_the_diode_bridge_with_order_two():
    problem = li.Problem("bridge", BRIDGE, q0={"v": 10.0})
    counts, errors = (997, 1499, 2503, 4001, 6007, 9001), []
    for n in counts:
        run = li.simulate(problem, dt=5e-3 / n, t_end=5e-3)
        errors.append(np.abs(run["v"] - damped_lc(run.t)).max())
        assert run.certificate.complementarity < 1e-12
        assert run.certificate.penetration < 1e-12
    assert -np.polyfit(np.log(counts), np.log(errors), 1)[0] == pytest.approx(2.0, abs=0.2)
    np.testing.assert_allclose(run["λ1"] + run["λ2"], np.abs(damped_lc(run.t_reaction)), rtol=0.0, atol=1e-3)


@pytest.mark.parametrize("name", ["system-1", "system-2", "system-3"])
@pytest.mark.parametrize("method", ["exact", "moreau-jean"])
def test_both_doors_give_the_same_motion(name, method):
    """The paper's systems, given by their own first-order form; relative degree 1, 0 and 1."""
    problem = li.load_problem(name)
    form = first_order_form(problem.dynamics)
    N = form.constant
    system = LinearComplementaritySystem(form.A[:N, :N], form.B[:N], form.C[:, :N], form.D, form.A[:N, N], form.C[:, N])
    assert [each.relative_degree for each in system.assemble().contacts] == problem.dynamics.relative_degree.tolist()
    start = dict(
        zip(system.states, form.state(problem.initial_coordinates, problem.initial_velocities)[:N], strict=True)
    )
    given = li.simulate(li.Problem("given", system, q0=start), method, dt=1e-3, t_end=3.0)
    scheme = li.simulate(problem, method, dt=1e-3, t_end=3.0)
    tolerance = 1e-9 if method == "exact" else 5e-5
    np.testing.assert_allclose(given["x1"], scheme["x"], rtol=0.0, atol=tolerance)
    # The first sample aside, at which R jumps from zero.
    np.testing.assert_allclose(given["λ1"][1:], scheme["R"][1:], rtol=0.0, atol=1e-6 if method == "exact" else 30.0)
    assert [event.kind for event in given.events] == [event.kind for event in scheme.events]


def test_a_diode_against_an_input_of_time():
    """x' = -x + λ + cos t, 0 <= λ ⟂ x >= 0: x is held at zero while the input pulls down, against DOP853."""
    system = LinearComplementaritySystem(
        [[-1.0]], [[1.0]], [[1.0]], a=[Harmonic(1.0, 1.0)], states="x", multipliers="λ"
    )
    run = li.simulate(li.Problem("diode", system, q0={"x": 0.5}), "exact", dt=1e-2, t_end=6.0)

    def dry(t, x):
        return x[0]

    dry.terminal, dry.direction = True, -1
    first = solve_ivp(lambda t, x: -x + math.cos(t), (0.0, 6.0), [0.5], "DOP853", events=dry, rtol=1e-12, atol=1e-13)
    closing, opening = run.events
    assert (closing.kind, opening.kind) == ("close", "open")
    assert closing.t == pytest.approx(first.t[-1], abs=1e-9)
    assert opening.t == pytest.approx(1.5 * math.pi, abs=1e-12)
    held = (run.t > closing.t) & (run.t < opening.t)
    np.testing.assert_allclose(run["λ"][held], -np.cos(run.t[held]), rtol=0.0, atol=1e-12)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ({"A": [[1.0, 2.0]]}, r"A of the system has the shape \(1, 2\), and A and C ask for \(1, 1\)"),
        ({"B": [[1.0, 2.0]]}, r"B of the system has the shape \(1, 2\)"),
        ({"D": [[1.0, 2.0]]}, r"D of the system has the shape"),
        ({"A": [[math.nan]]}, r"A of the system holds a number that is not finite"),
        ({"A": "x"}, r"A of the system must be a matrix of numbers"),
        ({"a": [1.0, 2.0]}, r"a of the system must hold 1 finite numbers or functions"),
        ({"states": ("x", "y")}, r"states of the system must hold 1 names"),
        ({"states": ("t",)}, r"two series of the name 't'"),
        ({"lower": [1.0], "upper": [-1.0]}, r"lower = 1 of 'λ1' is above upper = -1: exchange them"),
        ({"lower": [1.0], "upper": [1.0]}, r"lower and upper of 'λ1' are both 1: a λ that is given is an input"),
        ({"lower": [-1.0]}, r"'λ1' has the bounds -1 and inf, and a row has 0 and inf, two finite ones, or none"),
        ({"lower": [-math.inf], "upper": [0.0]}, r"'λ1' has the bounds -inf and 0"),
        ({"lower": [math.nan]}, r"lower of the system must hold 1 numbers or infinities"),
        ({"upper": [1.0, 1.0]}, r"upper of the system must hold 1 numbers or infinities"),
        ({"upper": "1"}, r"upper of the system must hold 1 numbers or infinities"),
        ({"c": [math.sin]}, r"c of the system must hold 1 finite numbers or Harmonic\(...\), Polynomial"),
        ({"c": [1.0, 2.0]}, r"c of the system must hold 1 finite numbers"),
        ({"c": [li.Square(1.0, 1.0)]}, r"c\[0\] of the system jumps, and so would x"),
        ({"c": [Harmonic(1.0, 1.0)], "states": ("c_λ1",)}, r"two series of the name 'c_λ1'"),
        ({"B": [[0.0]]}, r"u of 'λ1' does not feel λ before its second derivative"),
    ],
)
def test_matrices_that_do_not_fit_are_refused(arguments, says):
    given = {"A": [[0.0]], "B": [[1.0]], "C": [[1.0]]} | arguments
    with pytest.raises(li.InputError, match=says):
        LinearComplementaritySystem(**given)


def test_an_input_of_a_contact_row():
    """x' = -1 + λ, 0 <= λ ⟂ x - cos t >= 0: x stays on the curve where the curve falls slower than 1, by all methods."""
    system = LinearComplementaritySystem([[0.0]], [[1.0]], [[1.0]], a=[-1.0], c=[Harmonic(-0.5, 1.0)])
    for name, kind in METHODS.items():
        if not {Feature.SYSTEMS, Feature.MOTIONS} <= set(kind.declared.handles):
            continue
        run = li.simulate(li.Problem("curve", system, q0={"x1": 1.0}), name, dt=1e-3, t_end=6.0)
        assert run.success, name
        on = run.t > 2.0
        assert run["x1"][on] == pytest.approx(0.5 * np.cos(run.t[on]), abs=2e-3), name
        assert run["c_λ1"] == pytest.approx(-0.5 * np.cos(run.t), abs=1e-6)
    # One that starts outside jumps onto it.
    run = li.simulate(li.Problem("curve", system, q0={"x1": 0.0}), "exact", dt=1e-2, t_end=6.0)
    assert run["x1"] == pytest.approx(0.5 * np.cos(run.t), abs=1e-12)


def test_the_papers_method_refuses_a_system_by_name():
    with pytest.raises(li.UnsupportedError, match=r"rk4-paper does not handle systems given directly"):
        li.simulate(li.Problem("bridge", BRIDGE, q0={"v": 10.0}), "rk4-paper", dt=1e-5, t_end=1e-3)


def test_equality_is_that_of_the_matrices():
    again = LinearComplementaritySystem(BRIDGE.A, BRIDGE.B, BRIDGE.C, BRIDGE.D, states=("v", "i"))
    assert again == BRIDGE
    assert again != LinearComplementaritySystem(BRIDGE.A, BRIDGE.B, BRIDGE.C, BRIDGE.D)
