"""The witness: the paper's explicit equations, independent of the LCP path, and what "z - x = 0" does to them."""

import ast
import inspect

import numpy as np
import pytest
from numpy.testing import assert_allclose

import lcpimpact as li
import lcpimpact.integrators.rk4_paper as module
from lcpimpact.integrators.rk4_paper import right_side
from lcpimpact.problems.reference import KNOWN

CONSTANTS = np.array([100.0, 9.81, 1962.0, 125.0, 3924.0, 250.0])


def error(known, h, contact="project"):
    problem = li.load_problem(known.problem, **known.parameters)
    exact = li.simulate(problem, "exact", dt=h, t_end=3.0)
    # The rule "equal" lets the bodies pass through one another, and other rules break their laws a little.
    found = li.simulate(problem, "rk4-paper", dt=h, t_end=3.0, contact=contact, throw=contact == "project")
    assert found.ended
    return np.abs(found["x"] - exact["x"]).max()


@pytest.mark.parametrize("known", KNOWN, ids=lambda known: known.label)
def test_converges_to_the_exact_solution(known):
    assert error(known, 1e-4) < 2e-4
    assert error(known, 1e-5) < 2e-5


def test_order_four_between_the_switches():
    # System 1 stays in contact until t = 0.522.
    errors = []
    for steps in (20, 40):
        exact = li.simulate(li.load_problem("system-1"), "exact", dt=0.5 / steps, t_end=0.5)
        found = li.simulate(li.load_problem("system-1"), "rk4-paper", dt=0.5 / steps, t_end=0.5)
        errors.append(np.abs(found["x"] - exact["x"]).max())
    assert 3.8 < np.log2(errors[0] / errors[1]) < 4.4


def test_effect_of_the_contact_rule():
    three = KNOWN[2]
    assert error(three, 1e-3, "project") < 0.5 * error(three, 1e-3, "clip")
    assert error(three, 1e-3, "clip") < 0.5 * error(three, 1e-3, "sign")
    for known in KNOWN:
        assert error(known, 1e-3, "equal") > 0.1


def test_a_contact_rule_that_lets_bodies_pass_is_not_called_solved():
    with pytest.raises(li.FailureError, match="bodies penetrate by"):
        li.simulate(li.load_problem(KNOWN[1].problem), "rk4-paper", dt=1e-3, t_end=3.0, contact="equal")


@pytest.mark.parametrize(
    ("system", "state", "R", "rates"),
    [
        (1, (0.1, 2.0, 0.0, 0.1), 250 * 2 + 3924 * 0.1, (2.0, 9.81 - 8.924, None, 2.0)),
        (1, (0.1, 2.0, 0.0, 0.2), 0.0, (2.0, 9.81, None, -3924 / 250 * 0.2)),
        (1, (0.1, -3.0, 0.0, 0.1), 0.0, (-3.0, 9.81, None, -3924 / 250 * 0.1)),
        (2, (0.3, 1.0, 0.1, 0.1), 1962 * 0.2, (1.0, 9.81 - 3.924, 0.0, 0.0)),
        (2, (0.3, 1.0, 0.1, 0.2), 0.0, (1.0, 9.81, 1.0, -3924 / 250 * 0.2)),
        (3, (0.3, 1.0, 0.1, 0.1), 250 / 3 * 5.7088, (1.0, 9.81 - 250 / 300 * 5.7088, None, None)),
        (3, (0.3, 1.0, 0.1, 0.2), 0.0, (1.0, 9.81, 1.0 + 1962 / 125 * 0.2, -3924 / 250 * 0.2)),
    ],
)
def test_right_sides_by_hand(system, state, R, rates):
    found = np.empty(4)
    assert_allclose(right_side(system, 0, np.array(state), CONSTANTS, found), R, rtol=1e-13)
    for value, expected in zip(found, rates, strict=True):
        if expected is not None:
            assert_allclose(value, expected, rtol=1e-12, atol=1e-12)


def test_shares_no_code_with_the_lcp_path():
    imports = [node for node in ast.walk(ast.parse(inspect.getsource(module))) if isinstance(node, ast.ImportFrom)]
    names = [(each.module, name.name) for each in imports for name in each.names]
    shared = [name for name in names if (name[0] or "").startswith(("lcpimpact.lcp", "lcpimpact.scheme"))]
    assert shared == [("lcpimpact.scheme.structure", "Feature")], "what it declares, and nothing that computes"
    assert ".dynamics" not in inspect.getsource(module).replace("lcpimpact.scheme.structure", "")


def test_refuses_what_the_paper_does_not_print():
    with pytest.raises(li.UnsupportedError, match="moreau-jean"):
        li.simulate(li.load_problem("bouncing-ball"), "rk4-paper", dt=1e-2, t_end=1.0)
    other = li.Problem("system-1", li.load_problem("system-3").scheme, v0={"x": 1.0})
    with pytest.raises(li.UnsupportedError, match="system-1"):
        li.simulate(other, "rk4-paper", dt=1e-2, t_end=1.0)


def test_a_contact_that_is_closed_from_the_start_does_not_close_there_again():
    """The force of System 2 starts from zero between plates that touch."""
    problem = li.load_problem("system-2")
    exact, found = (li.simulate(problem, method, dt=1e-3, t_end=3.0) for method in ("exact", "rk4-paper"))
    assert [event.kind for event in found.events] == [event.kind for event in exact.events] == ["open", "close"]
    assert_allclose([event.t for event in found.events], [event.t for event in exact.events], atol=2e-3)
