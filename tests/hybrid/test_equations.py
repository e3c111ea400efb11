"""Equations y = 0 in complementarity systems, alone and beside contacts and relays, against closed forms."""

import math

import matplotlib.pyplot as plt
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import brentq

import lcpimpact as li
from lcpimpact import Harmonic, InputError, LinearComplementaritySystem, UnsupportedError
from lcpimpact.integrators import METHODS
from lcpimpact.plotting.block_diagram import draw_system
from lcpimpact.scheme.structure import Feature

LOCATING = ("exact", "radau-fesd", "event-driven")
ABLE = ("moreau-jean", "radau", *LOCATING)
TOLERANCE = {"exact": 1e-13, "radau-fesd": 1e-9, "event-driven": 1e-8, "moreau-jean": 2e-5, "radau": 1e-8}
FREE = math.inf


def system(A, B, C, *, x0, equations=None, **given):
    """A system whose rows, or the first ``equations`` of them, are equations, from x0."""
    m = len(C)
    k = m if equations is None else equations
    bounds = {"lower": k * [-FREE] + (m - k) * [0.0], "upper": m * [FREE]}
    made = LinearComplementaritySystem(A, B, C, **bounds | given)
    return li.Problem("equations", made, q0=dict(zip(made.states, x0, strict=True)))


def loop_of_capacitors(c=-1.0):
    """x1 + x2 = -c: two capacitors in a loop with a source, a resistor beside the second; λ is the current."""
    return system([[0.0, 0.0], [0.0, -1.0]], [[1.0], [1.0]], [[1.0, 1.0]], c=[c], x0=[0.0, 1.0])


def driven_loop():
    """x1 + x2 = cos t: x2' = -(x2 + sin t)/2."""
    return loop_of_capacitors(Harmonic(-1.0, 1.0))


def driven_x2(t):
    return 0.4 * np.cos(t) - 0.2 * np.sin(t) + 0.6 * np.exp(-0.5 * t)


def linked_masses():
    """x'' = -x + λ and y'' = -λ with x = y: 2 x'' = -x, a descriptor system of index 3."""
    A = np.zeros((4, 4))
    A[0, 2] = A[1, 3] = 1.0
    A[2, 0] = -1.0
    return system(A, [[0.0], [0.0], [1.0], [-1.0]], [[1.0, -1.0, 0.0, 0.0]], x0=[1.0, 1.0, 0.0, 0.0])


@pytest.mark.parametrize("method", ABLE)
def test_a_loop_of_capacitors_and_a_source(method):
    near = TOLERANCE[method]
    run = li.simulate(loop_of_capacitors(), method, dt=1e-2, t_end=3.0)
    assert run.success
    assert not run.events
    assert run["x2"] == pytest.approx(np.exp(-0.5 * run.t), abs=near)
    assert run["λ1"] == pytest.approx(0.5 * np.exp(-0.5 * run.t_reaction), abs=near)
    driven = li.simulate(driven_loop(), method, dt=1e-2, t_end=3.0)
    assert driven.success
    assert driven["x2"] == pytest.approx(driven_x2(driven.t), abs=near)
    assert driven["x1"] + driven["x2"] == pytest.approx(
        np.cos(driven.t), abs=near if method != "moreau-jean" else 1e-14
    )
    t = driven.t_reaction
    assert driven["λ1"] == pytest.approx(0.5 * (driven_x2(t) - np.sin(t)), abs=2.0 * near)


@pytest.mark.parametrize("method", ABLE)
def test_an_ideal_transformer(method):
    """A source of 2 V and 1 Ω feeds by 3:1 a capacitor of 1 F with 1 Ω: λ1 = 3 x, λ2 = 2 - λ1, x' = 3 λ2 - x."""
    problem = system([[-1.0]], [[0.0, 3.0]], [[-3.0], [0.0]], D=[[1.0, 0.0], [1.0, 1.0]], c=[0.0, -2.0], x0=[0.0])
    near = TOLERANCE[method] * (1.0 if method != "moreau-jean" else 10.0)
    run = li.simulate(problem, method, dt=1e-3, t_end=1.0)
    assert run["x1"] == pytest.approx(0.6 * (1.0 - np.exp(-10.0 * run.t)), abs=near)
    x = 0.6 * (1.0 - np.exp(-10.0 * run.t_reaction))
    assert run["λ1"] == pytest.approx(3.0 * x, abs=3.0 * near)
    assert run["λ2"] == pytest.approx(2.0 - 3.0 * x, abs=3.0 * near)
    # A gyrator: D is skew, x1 + λ2 = 0 and x2 - λ1 = 0 turn x.
    gyrator = system(np.zeros((2, 2)), np.eye(2), np.eye(2), D=[[0.0, 1.0], [-1.0, 0.0]], x0=[1.0, 0.0])
    run = li.simulate(gyrator, method, dt=1e-2, t_end=6.0)
    assert run["x1"] == pytest.approx(np.cos(run.t), abs=5.0 * near)
    # An equation that feels another's λ directly, and one that x alone must satisfy.
    mixed = system(
        [[0.0, 0.0], [0.0, -1.0]], [[1.0, 0.0], [1.0, 1.0]], [[1.0, 1.0], [1.0, 0.0]], D=[[0.0, 1.0], [0.0, 0.0]],
        c=[0.0, -1.0], x0=[1.0, 0.0],
    )  # fmt: skip
    held = li.simulate(mixed, method, dt=1e-2, t_end=1.0)
    assert held["x2"] == pytest.approx(0.5 * np.expm1(-2.0 * held.t), abs=5.0 * near)
    assert run["λ2"] == pytest.approx(-np.cos(run.t_reaction), abs=5.0 * near)


@pytest.mark.parametrize("method", ABLE)
def test_an_equation_of_relative_degree_two(method):
    run = li.simulate(linked_masses(), method, dt=1e-2, t_end=6.0)
    near = TOLERANCE[method]
    x = np.cos(run.t / math.sqrt(2.0))
    assert run.success
    assert run["x1"] == pytest.approx(x, abs=5.0 * near)
    assert run["x1"] - run["x2"] == pytest.approx(0.0, abs=1e-9 if method in ("event-driven", "radau-fesd") else 1e-13)
    assert run["λ1"] == pytest.approx(0.5 * np.cos(run.t_reaction / math.sqrt(2.0)), abs=5.0 * near)


@pytest.mark.parametrize("problem", [driven_loop, linked_masses])
def test_the_order_of_steps_with_equations(problem):
    """The θ-step with θ = 1/2 is of order 2 in x and in λ at its middle."""
    counts, errors = (50, 100, 200, 400), []
    truth = li.simulate(problem(), "exact", dt=0.1, t_end=3.0)
    for n in counts:
        run = li.simulate(problem(), dt=3.0 / n, t_end=3.0)
        off = np.abs(run.reaction - truth.sample(run.t_reaction).reaction).max()
        errors.append((np.abs(run.q - truth.sample(run.t).q).max(), off))
    slopes = -np.polyfit(np.log(counts), np.log(errors), 1)[0]
    assert slopes == pytest.approx([2.0, 2.0], abs=0.1)


@pytest.mark.parametrize("method", ABLE)
def test_an_equation_beside_a_diode(method):
    """A node of voltage e = λ1 with (V - e)/R = λ2, and a diode from it to a capacitor; without e it is one row."""
    R, V = 0.5, Harmonic(1.0, 2.0)
    by_equation = system(
        [[-1.0]], [[0.0, 1.0]], [[0.0], [1.0]], D=[[-1.0 / R, -1.0], [-1.0, 0.0]],
        c=[Harmonic(1.0 / R, 2.0), 0.0], x0=[0.0], equations=1,
    )  # fmt: skip
    by_hand = system([[-1.0]], [[1.0]], [[1.0]], D=[[R]], c=[Harmonic(-1.0, 2.0)], x0=[0.0], equations=0)
    dt = 1e-3 if method == "moreau-jean" else 0.02
    a, b = (li.simulate(each, method, dt=dt, t_end=8.0) for each in (by_equation, by_hand))
    assert a.success
    assert [event.kind for event in a.events] == [event.kind for event in b.events]
    assert a["x1"] == pytest.approx(b["x1"], abs=1e-9)
    assert a["λ2"] == pytest.approx(b["λ1"], abs=1e-9)
    e = np.array([V(t) for t in a.t_reaction]) - R * a["λ2"]
    assert a["λ1"] == pytest.approx(e, abs=1e-8 if method != "moreau-jean" else 1e-5)


@pytest.mark.parametrize("method", ABLE)
def test_an_equation_beside_a_relay(method):
    """x1' = λ1 - λ2 and x2' = -λ1 with x1 = x2, λ2 in Sgn x1: x = 1 - t/2 until it slides with both at zero."""
    problem = system(
        np.zeros((2, 2)), [[1.0, -1.0], [-1.0, 0.0]], [[1.0, -1.0], [-1.0, 0.0]], x0=[1.0, 1.0],
        lower=[-FREE, -1.0], upper=[FREE, 1.0],
    )  # fmt: skip
    run = li.simulate(problem, method, dt=0.01, t_end=3.0)
    assert run.success
    assert [event.kind for event in run.events] == ["slide"]
    assert run.events[0].t == pytest.approx(2.0, abs=1e-8 if method in LOCATING else 0.02)
    assert run["x2"] == pytest.approx(np.maximum(1.0 - 0.5 * run.t, 0.0), abs=1e-8)
    assert run["λ1"][run.t_reaction < 1.98] == pytest.approx(0.5, abs=1e-8)
    assert run["λ1"][run.t_reaction > 2.02] == pytest.approx(0.0, abs=1e-8)


@pytest.mark.parametrize("method", ABLE)
def test_a_jump_keeps_to_the_equations(method):
    """x1 = x2 >= 0 from -1: the contact's impulse is 2, of which the equation takes half to x2."""
    problem = system(
        np.zeros((2, 2)), [[1.0, 1.0], [-1.0, 0.0]], [[1.0, -1.0], [1.0, 0.0]], a=[-1.0, -1.0], x0=[-1.0, -1.0],
        equations=1,
    )  # fmt: skip
    run = li.simulate(problem, method, dt=0.1, t_end=1.0)
    assert run.success
    assert [(event.contact, event.impulse) for event in run.events if event.kind == "jump"] == [
        ("λ1", -1.0),
        ("λ2", 2.0),
    ]
    assert run.q == pytest.approx(0.0, abs=1e-14)
    assert (run["λ1"][-1], run["λ2"][-1]) == pytest.approx((-1.0, 2.0), abs=1e-12)


def test_a_jump_where_a_contact_is_felt_by_way_of_an_equation():
    """A diode and a node's voltage e: reversed, the capacitor takes what the source gives, and nothing jumps."""
    problem = system(
        [[-1.0]], [[0.0, 1.0]], [[0.0], [1.0]], D=[[-2.0, -1.0], [-1.0, 0.0]], c=[2.0, 0.0], x0=[-1.0], equations=1
    )
    run = li.simulate(problem, "exact", dt=0.1, t_end=1.0)
    assert not [event for event in run.events if event.kind == "jump"]
    assert run["λ2"][0] == pytest.approx(4.0)


def test_a_changed_system_does_not_certify_a_run():
    for method in ABLE:
        run = li.simulate(loop_of_capacitors(), method, dt=1e-2, t_end=1.0)
        assert run.certify().holds
        wrong = system([[0.0, 0.0], [0.0, -1.0]], [[1.0], [1.0]], [[1.0, 1.0 + 1e-3]], c=[-1.0 - 1e-3], x0=[0.0, 1.0])
        assert run.certify(wrong).failures


def test_equations_that_do_not_hold_or_do_not_determine_their_multipliers_are_refused():
    with pytest.raises(InputError, match=r"starts off the equation of 'λ1': y is -0\.5"):
        system([[0.0]], [[1.0]], [[1.0]], c=[-1.0], x0=[0.5])
    with pytest.raises(InputError, match="starts off the equation of 'λ1': the rate of y is 1"):
        system(np.eye(2, k=1), [[0.0], [1.0]], [[1.0, 0.0]], x0=[0.0, 1.0])
    with pytest.raises(InputError, match="equations of 'λ1', 'λ2' do not determine λ"):
        system(np.zeros((2, 2)), np.eye(2), [[1.0, 1.0], [2.0, 2.0]], x0=[0.0, 0.0])
    with pytest.raises(InputError, match="equation of 'λ1' does not feel λ before its third derivative"):
        system(np.eye(3, k=1), [[0.0], [0.0], [1.0]], [[1.0, 0.0, 0.0]], x0=[0.0, 0.0, 0.0])
    with pytest.raises(InputError, match="equation of 'λ1' does not feel λ"):
        system([[0.0]], [[0.0]], [[1.0]], x0=[0.0])
    with pytest.raises(InputError, match="y of 'λ2' feels λ only by way of the equations, which cancel it"):
        system([[0.0]], [[1.0, 1.0]], [[1.0], [1.0]], x0=[0.0], equations=1)
    with pytest.raises(InputError, match="bounds -inf and 1"):
        system([[0.0]], [[1.0]], [[1.0]], x0=[0.0], upper=[1.0])


def test_equations_of_degree_two_that_a_method_cannot_take():
    A = np.eye(2, k=1)
    with pytest.raises(UnsupportedError, match=r"'λ1' has relative degree 2 and a signal in c.*'exact'"):
        li.simulate(system(A, [[0.0], [1.0]], [[1.0, 0.0]], c=[Harmonic(1.0, 1.0)], x0=[-1.0, 0.0]), dt=0.1, t_end=1.0)
    moved = system(A, [[0.0], [1.0]], [[1.0, 0.0]], a=[lambda t: math.sin(t), 0.0], x0=[0.0, 0.0])
    with pytest.raises(UnsupportedError, match=r"'λ1' has relative degree 2, so λ depends on the derivative"):
        li.simulate(moved, "event-driven", dt=0.1, t_end=1.0)
    run = li.simulate(moved, dt=0.01, t_end=1.0)
    assert run["x1"] == pytest.approx(0.0, abs=1e-14)
    assert run["x2"] == pytest.approx(-np.sin(run.t), abs=1e-14)


@pytest.mark.parametrize("sign", [1.0, -1.0], ids=["a + b - 1", "1 - a - b"])
@pytest.mark.parametrize(("method", "loops", "tolerance"), [("moreau-jean", 18, 2e-4), ("radau", 10, 1e-6)])
def test_ladders_of_loops_may_be_written_with_either_sign(method, loops, tolerance, sign):
    """Capacitors share their loops: x1 = x3 = ... = 1 - x2, and (n + 1) x1' = m - n x1 for n loops, m even capacitors."""
    B = np.eye(loops + 1, loops) + np.eye(loops + 1, loops, k=-1)
    leaks = -np.diag([0.0] + loops * [1.0])
    start = [float(i % 2 == 0) for i in range(loops + 1)]
    run = li.simulate(system(leaks, B, sign * B.T, c=loops * [-sign], x0=start), method, dt=0.05, t_end=0.1)
    rest = (loops + 1) // 2 / loops
    assert run["x1"] == pytest.approx(rest + (1.0 - rest) * np.exp(-loops / (loops + 1) * run.t), abs=tolerance)


def test_the_drawing_and_the_file_of_equations(tmp_path):
    problem = loop_of_capacitors()
    path = li.write_scheme_file(problem, tmp_path / "loop.toml")
    assert "lower = [-inf]" in path.read_text(encoding="utf-8")
    again = li.read_scheme_file(path).problem
    assert again.scheme == problem.scheme
    axes = plt.figure().add_subplot()
    draw_system(axes, problem.scheme)
    assert "$w = 0$" in [text.get_text() for text in axes.texts]
    plt.close("all")


def test_methods_without_equations_refuse_them_by_name():
    able = {name for name, kind in METHODS.items() if Feature.EQUATIONS in kind.declared.handles}
    assert able == set(ABLE)
    for name in set(METHODS) - able:
        with pytest.raises(UnsupportedError, match=name):
            li.simulate(loop_of_capacitors(), name, dt=1e-2, t_end=1.0)


REFERENCES = ["exact", "event-driven", "radau-fesd", "rk4"]


@pytest.mark.parametrize("method", REFERENCES)
def test_a_rectifier_with_smoothing(method):
    """Two ideal diodes charge one capacitor from sin ωt and -sin ωt: x = |sin ωt| while one conducts, else x' = -x."""
    ω, period = 6.0, np.pi / 6.0
    phases = (0.5 * np.pi, -0.5 * np.pi)
    rectifier = LinearComplementaritySystem(
        [[-1.0]], [[1.0, 1.0]], [[1.0], [1.0]], c=[Harmonic(1.0, ω, each) for each in phases], states=["x"]
    )
    run = li.simulate(li.Problem("rectifier", rectifier), method, dt=2e-3, t_end=2.0)
    ends = (np.pi - np.arctan(ω)) / ω
    begins = brentq(lambda t: np.sin(ω * ends) * np.exp(ends - t) - abs(np.sin(ω * t)), period + 0.01, 1.5 * period)
    conducts = (run.t <= ends) | (run.t % period < ends) & (run.t % period > begins - period)
    decays = np.sin(ω * ends) * np.exp(-((run.t - ends) % period))
    accuracy = 1e-5 if method == "rk4" else 1e-8
    assert_allclose(run["x"], np.where(conducts, np.abs(np.sin(ω * run.t)), decays), atol=accuracy)
    opens = [event.t for event in run.events if event.kind == "open"]
    assert_allclose(opens, ends + period * np.arange(len(opens)), atol=100.0 * accuracy)
    assert len(opens) == 4


@pytest.mark.parametrize("method", REFERENCES)
def test_a_rectifier_of_three_phases(method):
    """The current commutes at once to the diode of the highest voltage, whose source the capacitor follows."""
    phases = 2.0 * np.pi / 3.0 * np.arange(3)
    rectifier = LinearComplementaritySystem(
        [[-10.0]], [[1.0, 1.0, 1.0]], [[1.0]] * 3, c=[Harmonic(1.0, 3.0, np.pi + each) for each in phases], states=["x"]
    )
    run = li.simulate(li.Problem("three phases", rectifier, q0={"x": 1.0}), method, dt=2e-3, t_end=2.0)
    sources = np.cos(3.0 * run.t[:, None] + phases)
    assert_allclose(run["x"], sources.max(axis=1), atol=1e-5 if method == "rk4" else 1e-8)
