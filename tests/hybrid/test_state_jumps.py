"""Systems that start outside their constraint: they jump into it by the law of the storage function, or are refused."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import nnls

import lcpimpact as li
from lcpimpact.hybrid.state_jump import state_jump
from lcpimpact.integrators import METHODS
from lcpimpact.scheme.structure import Feature

METHODS_FOR_SYSTEMS = [name for name, kind in METHODS.items() if Feature.SYSTEMS in kind.declared.handles]
SOURCE = 2.0 * np.pi


def problem(A, B, C, *, x0, **given):
    system = li.LinearComplementaritySystem(A, B, C, **given)
    return li.Problem("system", system, q0=dict(zip(system.states, x0, strict=True)))


def half_wave_rectifier(w=0.0):
    """A capacitor of 1 F with a load of 2 Ω behind a diode at the voltage s = cos 2π t: λ is the current."""
    A = [[-0.5, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -(SOURCE**2), 0.0]]
    return problem(A, [[1.0], [0.0], [0.0]], [[1.0, -1.0, 0.0]], x0=(w, 1.0, 0.0), states=("w", "s", "ds"))


def full_wave_rectifier(w=0.0, s=1.0):
    """The same behind four ideal diodes: i_F1, i_R1, the potential of one pole over the minus of the bridge, i_F2."""
    A = [[-0.5, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -(SOURCE**2), 0.0]]
    B = [[1.0, 1.0, 0.0, 0.0], [0.0] * 4, [0.0] * 4]
    C = [[1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 0.0, 0.0], [0.0, -1.0, 0.0]]
    D = [[0.0, 0.0, -1.0, 0.0], [0.0, 0.0, -1.0, 0.0], [1.0, 1.0, 0.0, -1.0], [0.0, 0.0, 1.0, 0.0]]
    names = {"states": ("w", "s", "ds"), "multipliers": ("i_F1", "i_R1", "v_a", "i_F2")}
    return problem(A, B, C, D=D, x0=(w, s, 0.0), **names)


@pytest.mark.parametrize("method", METHODS_FOR_SYSTEMS)
def test_every_method_jumps_to_the_constraint(method):
    """x' = 1/2 + λ, 0 <= λ ⟂ x >= 0, x(0) = -1: x = t/2, after an impulse of 1."""
    run = li.simulate(problem([[0.0]], [[1.0]], [[1.0]], a=[0.5], x0=(-1.0,)), method, dt=1e-2, t_end=1.0)
    assert run["x1"] == pytest.approx(0.5 * run.t, abs=1e-9)
    (jump,) = (event for event in run.events if event.kind == "jump")
    assert (jump.t, jump.contact, jump.impulse) == (0.0, "λ1", 1.0)
    assert (jump.left.q[0], jump.right.q[0]) == (-1.0, 0.0)


def test_a_system_that_starts_inside_does_not_jump():
    run = li.simulate(problem([[0.0]], [[1.0]], [[1.0]], a=[-0.5], x0=(0.25,)), dt=1e-2, t_end=1.0)
    assert run["x1"][0] == 0.25
    assert "jump" not in {event.kind for event in run.events}


@given(st.integers(0, 2**32 - 1).map(np.random.default_rng))
def test_a_passive_system_goes_to_the_nearest_point_of_its_constraint(rng):
    """In the metric of the storage function ½ xᵀ K x, by Lawson and Hanson's least distance programming."""
    n, m = rng.integers(1, 5), rng.integers(1, 4)
    root = rng.normal(size=(n, n)) + 2.0 * np.eye(n)
    K = root.T @ root
    B, x = rng.normal(size=(n, m)), rng.normal(size=n)
    C, c = B.T @ K, rng.normal(size=m) * (m <= n)
    p = state_jump(B, C, np.zeros((m, m)), C @ x + c)
    # min |y| with G y >= h, y = root (x⁺ - x): NNLS of [G, h]ᵀ u = (0, 1).
    G, h = C @ np.linalg.inv(root), -(C @ x + c)
    E, f = np.vstack([G.T, h]), np.append(np.zeros(n), 1.0)
    u, distance = nnls(E, f)
    if distance < 1e-8:
        assert p is None
        return
    residual = E @ u - f
    nearest = x + np.linalg.solve(root, -residual[:n] / residual[n])
    assert p is not None
    assert x + B @ p == pytest.approx(nearest, rel=1e-6, abs=1e-6 * np.abs(x).max())


@pytest.mark.parametrize(("w", "s"), [(0.0, 1.0), (0.25, -1.0), (-0.5, 0.0), (0.0, -3.0)])
def test_ideal_diodes_charge_a_capacitor_to_the_voltage_of_the_source(w, s):
    """D is skew here, and impulses pass in D p >= 0: w jumps to |s|."""
    d = full_wave_rectifier(w, s).dynamics
    x = np.array([w, s, 0.0])
    p = state_jump(d.B, d.H, d.D, d.gap(0.0, x))
    assert x + d.B @ p == pytest.approx([abs(s), s, 0.0], abs=1e-12)
    # It is what a short step of backward Euler tends to.
    h = 1e-5
    step = li.solve_lcp(d.D + h * d.H @ d.B, d.gap(0.0, x), "lemke")
    assert x + h * d.B @ step.z == pytest.approx([abs(s), s, 0.0], abs=1e-4)


def test_a_resistance_takes_the_voltage_and_nothing_jumps():
    assert not state_jump(np.eye(1), np.eye(1), np.eye(1), np.array([-1.0])).any()


@pytest.mark.parametrize("θ", [0.5, 1.0])
@pytest.mark.parametrize("circuit", [half_wave_rectifier, full_wave_rectifier])
def test_a_rectifier_does_not_keep_a_wrong_voltage(circuit, θ):
    """While a diode conducts w = |s| and its current is C s' + s/R; θ = 1/2 once doubled w and let the current ring."""
    dt = 1e-3
    run = li.simulate(circuit(), dt=dt, t_end=1.0, theta=θ)
    t = run.t_reaction
    current = run.reaction[:, 0]
    conducting = (t > 0.003) & (t < 0.010) | (t > 0.92) & (t < 0.997)
    expected = np.maximum(-SOURCE * np.sin(SOURCE * t) + 0.5 * np.cos(SOURCE * t), 0.0)
    assert current[conducting] == pytest.approx(expected[conducting], abs=100.0 * dt)
    on = (run.t > 0.92) & (run.t < 0.997)
    assert run["w"][on] == pytest.approx(run["s"][on], abs=1e-12)
    assert run.certificate.complementarity < 1e-12


def test_a_system_without_a_law_is_refused():
    """λ pushes the state further out, or nothing tells two jumps apart."""
    for B, C in (([[-1.0]], [[1.0]]), ([[1.0, 2.0], [2.0, 1.0]], np.eye(2))):
        outside = problem(np.zeros((len(B), len(B))), B, C, x0=[-1.0] * len(B))
        with pytest.raises(li.UnsupportedError, match=r"starts outside its constraint.*start it inside"):
            li.simulate(outside, dt=1e-2, t_end=1.0)


def test_a_scheme_never_jumps():
    scheme = li.Scheme(li.Mass("x", m=1.0), li.Bumper("x", "z"), li.KelvinVoigt("z", "ground", k=1.0, c=1.0))
    with pytest.raises(li.InputError, match="starts penetrated"):
        li.Problem("inside", scheme, q0={"x": 0.1})
