"""General forces: what a `Load` and a `Force` take, their Jacobians by mpmath, and what is refused."""

import functools
import math

import mpmath
import numpy as np
import pytest
from numpy.testing import assert_allclose

import lcpimpact as li
from lcpimpact.plotting.schematic import draw_scheme
from lcpimpact.scheme.force_law import ForceLaw

PAIR = np.array([1.0, -1.0])


def smooth(t, q, v):
    """Two coupled forces with everything that is analytic in them."""
    return np.array(
        [np.sin(q[0]) * np.exp(-q[1]) + t * np.arctan(v[0] / 0.1), q[0] ** 3 * v[1] - np.sqrt(v[0] ** 2 + 1e-4)]
    )


def smooth_by_mpmath(t, q0, q1, v0, v1):
    return (
        mpmath.sin(q0) * mpmath.exp(-q1) + t * mpmath.atan(v0 / 0.1),
        q0**3 * v1 - mpmath.sqrt(v0**2 + mpmath.mpf("1e-4")),
    )


@pytest.mark.parametrize("at", [(0.3, 0.2, -0.7, 0.05, 1.1), (0.0, 1e-9, 2.0, -3.0, 0.0), (2.0, -40.0, 0.1, 1e-6, 1e3)])
def test_the_complex_step_has_all_digits(at):
    t, *state = at
    law = ForceLaw("law", ("x", "y"), smooth)
    by_q, by_v = law.tangents(t, np.array(state[:2]), np.array(state[2:]))
    with mpmath.workdps(40):
        for i in range(2):
            for j in range(4):
                order = tuple(int(j == k) for k in range(4))
                exact = mpmath.diff(lambda *s, i=i: smooth_by_mpmath(t, *s)[i], tuple(map(mpmath.mpf, state)), order)
                assert_allclose((by_q, by_v)[j // 2][i, j % 2], float(exact), rtol=1e-12, atol=1e-25)


def test_a_jacobian_that_is_given_is_taken():
    law = ForceLaw("law", ("x",), lambda t, q, v: -math.sin(q), lambda t, q, v: (-math.cos(q), 0.0), scalar=True)
    law.check(0.0, np.array([0.3]), np.array([0.0]))
    assert law.tangents(0.0, np.array([0.3]), np.zeros(1))[0] == pytest.approx(-math.cos(0.3))


def assembled(*elements):
    return li.Scheme(li.Mass("x", 1.0), *elements).assemble()


class Counter:
    def __call__(self, t):
        return t


def two_constants(t, q, v, c, d):
    return -c * q - d * v


@pytest.mark.parametrize(
    ("f", "laws"),
    [
        (lambda t: t, 0), (lambda t, k=3.0: k * t, 0), (np.sin, 0), (math.sin, 0), (li.Harmonic(1.0, 2.0), 0),
        (Counter(), 0), (functools.partial(lambda t, a, b: a * t + b, a=1.0, b=2.0), 0), (2.0, 0), (li.Square(1.0, 2.0), 0),
        (lambda t, q, v: -q, 1), (lambda t, q, v, c=2.0: -c * q, 1), (functools.partial(two_constants, c=1.0, d=2.0), 1),
    ],
)  # fmt: skip
def test_the_number_of_arguments_says_what_a_function_is_of(f, laws):
    d = assembled(li.Load("x", f))
    assert (len(d.force_laws), len(d.loads)) == (laws, 1 - laws)
    assert d.constant_loads == (f == 2.0)


@pytest.mark.parametrize("f", [lambda *a: 1.0, lambda t, q=0.0, v=0.0: 1.0, lambda t=0.0, q=0.0, v=0.0: 1.0])
def test_what_could_be_called_both_ways_is_refused(f):
    with pytest.raises(
        li.InputError, match=r"^Load at 'x': f can be called as f\(t\) and as f\(t, q, v\): give it one"
    ):
        assembled(li.Load("x", f))


@pytest.mark.parametrize("f", [lambda: 1.0, lambda t, q: 1.0, lambda t, q, v, w: 1.0])
def test_functions_of_other_numbers_of_arguments_are_refused(f):
    with pytest.raises(li.InputError, match=r"^Load at 'x': f must take t, or t, q and v"):
        assembled(li.Load("x", f))


REFUSED = {
    "text": (lambda t, q, v: "1", r"f\(0\.0, 0\.0, 1\.0\) returns '1'; return a number"),
    "None": (lambda t, q, v: None, r"returns None; return a number"),
    "array": (lambda t, q, v: np.ones(2), r"returns \[1\.0, 1\.0\]; return a number"),
    "array of one": (lambda t, q, v: [q], r"returns \[0\.0\]; return a number"),
    "bool": (lambda t, q, v: True, r"returns True; return a number"),
    "complex": (lambda t, q, v: 1j * q, r"returns .*j.*; return a number"),
    "division": (lambda t, q, v: 1.0 / q, r"fails by ZeroDivisionError: .*; a function takes t, q and v"),
    "key": (lambda t, q, v: {}[q], r"fails by KeyError"),
    "not finite": (lambda t, q, v: math.inf, r"is \[inf\] where the run starts; return finite numbers"),
    "nan": (lambda t, q, v: math.nan, r"is \[nan\] where the run starts"),
    "math.sin": (
        lambda t, q, v: math.sin(q),
        r"take np\.sin in place of math\.sin|by the complex step where differences",
    ),
    "math.exp of v": (lambda t, q, v: -math.exp(v), r"np\.sin.* or give jacobian="),
    "abs": (
        lambda t, q, v: -abs(v) * v,
        r"∂f/∂v is -1\.\d+ by the complex step where differences of f give -2\.0\d+: abs, ",
    ),
    "np.abs at rest": (lambda t, q, v: -np.abs(q) * q, r"∂f/∂q is .* by the complex step where differences of f give"),
    "float": (
        lambda t, q, v: -float(np.real(q)),
        r"∂f/∂q is 0 by the complex step where differences of f give -1: abs",
    ),
}


if np.lib.NumpyVersion(np.__version__) >= "2.0.0":
    # Before NumPy 2 the sign of a complex number is that of its real part, of which the complex step is right.
    REFUSED["np.sign"] = (
        lambda t, q, v: -np.sign(v) * v**2,
        r"∂f/∂v is .* by the complex step where differences of f give",
    )


@pytest.mark.parametrize("method", ["moreau-jean", "event-driven", "rk4"])
@pytest.mark.parametrize("case", REFUSED)
def test_a_load_that_is_none_is_refused_before_the_run_with_one_sentence(case, method):
    f, says = REFUSED[case]
    problem = li.Problem("mine", li.Scheme(li.Mass("x", 1.0), li.Load("x", f)), v0={"x": 1.0})
    with pytest.raises(li.InputError, match=rf"^Load at 'x': .*{says}") as caught:
        li.simulate(problem, method, dt=1e-2, t_end=1e-1)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "f",
    [
        lambda t, q, v: -v * np.sqrt(v**2), lambda t, q, v: np.where(q > 0.0, -q, 0.0), lambda t, q, v: -max(v, 0.0) ** 2,
        lambda t, q, v: -np.tanh(v / 1e-6), lambda t, q, v: 1.0, lambda t, q, v: np.float32(2.0), lambda t, q, v: 3,
        lambda t, q, v: -1e12 * q, lambda t, q, v: 1e9 + 1e-3 * q, lambda t, q, v: np.array(2.0),
    ],
)  # fmt: skip
def test_what_the_complex_step_can_do_is_taken(f):
    ForceLaw("law", ("x",), f, scalar=True).check(0.0, np.zeros(1), np.ones(1))
    ForceLaw("law", ("x",), f, scalar=True).check(0.0, np.array([1e-7]), np.array([-1e3]))


REFUSED_FORCES = {
    "shape": (lambda t, q, v: np.ones(3), None, r"returns \[?.*; return real numbers of the shape \(2,\)"),
    "number": (lambda t, q, v: 1.0, None, r"returns 1\.0; return real numbers of the shape \(2,\)"),
    "ragged": (lambda t, q, v: [1.0, [2.0]], None, r"returns .*; return real numbers of the shape \(2,\)"),
    "math.sin": (lambda t, q, v: [math.sin(q[0]), 0.0], None, r"np\.sin"),
    "index": (lambda t, q, v: [q[2], 0.0], None, r"fails by IndexError"),
    "no pair": (lambda t, q, v: -q, lambda t, q, v: np.eye(3), r"jacobian returns .*; return the pair of ∂f/∂q and ∂f/∂v"),
    "shape of ∂f/∂q": (
        lambda t, q, v: -q, lambda t, q, v: (np.eye(3), np.eye(2)), r"jacobian\(.*real numbers of the shape \(2, 2\)"
    ),
    "shape of ∂f/∂v": (
        lambda t, q, v: -q, lambda t, q, v: (np.eye(2), 1.0), r"jacobian\(.*return real numbers of the shape \(2, 2\)"
    ),
    "infinite": (lambda t, q, v: -q, lambda t, q, v: (np.eye(2) * math.inf, 0.0 * np.eye(2)), r"jacobian.* where the run"),
    "wrong sign": (
        lambda t, q, v: -q, lambda t, q, v: (np.eye(2), 0.0 * np.eye(2)), r"∂f/∂q is .* by jacobian .*: mend jacobian"
    ),
    "forgotten": (
        lambda t, q, v: -q - v[::-1], lambda t, q, v: (-np.eye(2), 0.0 * np.eye(2)), r"∂f/∂v is .*by jacobian where diff"
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED_FORCES)
def test_a_force_that_is_none_is_refused_before_the_run_with_one_sentence(case):
    f, jacobian, says = REFUSED_FORCES[case]
    scheme = li.Scheme(li.Mass("x", 1.0), li.Mass("y", 1.0), li.Force(("x", "y"), f, jacobian))
    with pytest.raises(li.InputError, match=rf"^Force between 'x' and 'y': .*{says}") as caught:
        li.simulate(li.Problem("mine", scheme, v0={"x": 1.0}), dt=1e-2, t_end=1e-1)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("method", ["moreau-jean", "event-driven", "dopri5"])
@pytest.mark.parametrize(
    ("late", "says"),
    [
        (lambda: None, r"returns None; return a number"),
        (lambda: [][1], r"fails by IndexError"),
        (lambda: "3", r"returns '3'"),
    ],
)
def test_a_force_that_fails_later_ends_the_run_with_a_sentence(late, says, method):
    scheme = li.Scheme(li.Mass("x", 1.0), li.Load("x", lambda t, q, v: -q if t < 0.05 else late()))
    with pytest.raises(li.InputError, match=rf"^Load at 'x': f\(0\.\d+, .*{says}"):
        li.simulate(li.Problem("mine", scheme, v0={"x": 1.0}), method, dt=1e-2, t_end=1e-1)


@pytest.mark.parametrize("method", ["moreau-jean", "event-driven", "dopri5", "heun"])
@pytest.mark.parametrize("late", [math.nan, math.inf])
def test_a_force_that_becomes_infinite_ends_the_run_there_and_is_named(late, method):
    scheme = li.Scheme(li.Mass("x", 1.0), li.Load("x", lambda t, q, v: -q + (late if t > 0.352 else 0.0)))
    traj = li.simulate(li.Problem("mine", scheme, v0={"x": 1.0}), method, dt=1e-2, t_end=0.7, throw=False)
    assert traj.status is li.Status.NON_FINITE
    assert f"The force of Load at 'x' is {late:g}" in traj.message
    assert 0.3 < traj.t[-1] < 0.36


def test_what_a_force_cannot_be():
    def f(t, q, v):
        return -q

    for nodes in ("xy", None, 3, ()):
        with pytest.raises(li.InputError, match=r"^nodes = .* of a Force must be a sequence of the nodes"):
            li.Force(nodes, f)
    for given, says in (
        ({"nodes": ("x", "x"), "f": f}, "both ends are one node"), ({"nodes": ("x", ""), "f": f}, "be a string, not empty"),
        ({"nodes": ("x", "ground"), "f": f}, "a force on the ground moves nothing"), ({"nodes": ("x",)}, "f is missing"),
        ({"nodes": ("x",), "f": 3.0}, "f = 3.0 must be a function"),
        ({"nodes": ("x",), "f": f, "jacobian": 3.0}, "jacobian = 3.0 must be a function"),
    ):  # fmt: skip
        with pytest.raises(li.InputError, match=says):
            li.Force(**given)
    assert li.Force(["x", "y"], f) == li.Force(("x", "y"), f)
    assert hash(li.Force(["x", "y"], f)) == hash(li.Force(("x", "y"), f))
    for given in ({"f": 1.0}, {"f": lambda t: t}, {"f": li.Harmonic(1.0, 2.0)}):
        with pytest.raises(
            li.InputError, match=r"^Load at 'x': jacobian = .* must be a function of t, q and v, beside"
        ):
            li.Load("x", **given, jacobian=lambda t, q, v: (0.0, 0.0))


def test_three_nodes_of_a_force_are_no_inner_nodes():
    three = li.Force(("x", "y", "z"), lambda t, q, v: -q)
    d = li.Scheme(*(li.Mass(node, 1.0) for node in "xyz"), three, li.Force(("z", "y", "x"), three.f)).assemble()
    assert d.nodes == ("x", "y", "z")
    assert d.acted_on.tolist() == [0, 1, 2, 2, 1, 0]
    assert_allclose(d.applied(0.0, np.array([1.0, 2.0, 3.0]), np.zeros(3)), [-2.0, -4.0, -6.0])


def test_forces_at_nodes_that_springs_alone_hold_are_refused():
    law = li.Load("z", lambda t, q, v: -q)
    with pytest.raises(li.InputError, match=r"^Load at 'z': 'z' is quasi-static.*give the node a Mass or a Dashpot$"):
        assembled(li.Spring("x", "z", 1.0), li.Spring("z", "ground", 1.0), law)


def test_the_picture_has_an_arrow_at_each_node():
    force = li.Force(("x", "y"), lambda t, q, v: -q, symbols=("F_m",))
    assert [(each.nodes, each.symbols) for each in force.drawn()] == [(("x",), ("F_m",)), (("y",), ("F_m",))]
    scheme = li.Scheme(li.Mass("x", 1.0), li.Mass("y", 1.0), li.Spring("x", "y", 1.0), force)
    labels = [text.get_text() for text in draw_scheme(scheme).axes[0].texts]
    assert labels.count("$F_m$") == 2
