"""Problems whose parameters are formulas: what builders compute is repeated for other values, or refused."""

import math

import numpy as np
import pytest

import lcpimpact as li
from lcpimpact.formula import Formula, Program
from lcpimpact.problems import PROBLEMS
from lcpimpact.problems.base import defaults
from lcpimpact.problems.parameters import changes_at

TRACED = 200
"""Number of parameters that may be formulas, over all registered problems."""

SMALL = {key: {"elements": 6} for key in ("bar-impact", "bouncing-bar", "plastic-bar-impact")}
"""Finite elements are repeated with few."""

ARRAYS = ("M", "C", "K", "H", "u0", "restitution", "r_min", "r_max", "mu", "mu_s", "power_laws", "relative_degree")


def numbers(problem):
    """Return all that a run is computed from, one number a name."""
    d = problem.dynamics
    arrays = {name: getattr(d, name) for name in ARRAYS}
    arrays |= {"q": problem.initial_coordinates, "v": problem.initial_velocities}
    arrays["loads"] = [load for _, load in d.loads if not callable(load)]
    found = {f"{name}_{i}": each for name, array in arrays.items() for i, each in enumerate(np.ravel(array).tolist())}
    # Those of a Lagrangian system that depend on where it is are no numbers.
    return {name: each for name, each in found.items() if isinstance(each, Formula) or not math.isnan(each)}


def trace(name, key):
    """Return the program of a problem with one parameter as a formula, its value, and its numbers; None if refused."""
    problem = li.load_problem(name, **SMALL.get(name, {}))
    value = float(problem.parameters[key])
    program = Program()
    try:
        return program, value, numbers(changes_at(problem, [key])({key: program.parameter(value)}))
    except TypeError:  # NotTracedError, or of NumPy, which knows no formulas
        return None


def repeated(program, found, value):
    """Return the numbers by the lines of a program, at another value of its parameter; None where it does not hold."""
    names = {"sqrt": math.sqrt, "INFINITY": math.inf, "p0": value}
    exec("\n".join(map(str, program.assignments({}))), names)
    if not all(eval(str(each), names) for each in program.assumptions()):
        return None
    exec("\n".join(map(str, program.assignments(found))), names)
    return {name: names[name] for name in found}


@pytest.mark.parametrize("name", PROBLEMS)
def test_formulas_of_a_problem_are_its_numbers_at_other_values_too(name):
    problem = li.load_problem(name, **SMALL.get(name, {}))
    for key in defaults(PROBLEMS[name]):
        traced = trace(name, key)
        if traced is None:
            continue
        program, value, found = traced
        assert any(isinstance(each, Formula) for each in found.values()) or program.assumed
        assert repeated(program, found, value) == numbers(changes_at(problem, [key])({key: value}))
        for other in (value * 0.5, value * 0.97, value * 1.001, value * 1.4, value + 0.1):
            again = repeated(program, found, other)
            if again is not None:
                assert again == numbers(changes_at(problem, [key])({key: other})), key


def test_most_parameters_may_be_formulas():
    parameters = [(name, key) for name, builder in PROBLEMS.items() for key in defaults(builder)]
    assert sum(trace(*each) is not None for each in parameters) >= TRACED


def test_closed_forms_that_no_float_holds_are_refused_when_they_are_read():
    problem = li.load_problem("hertz-impact", v0=1e200)
    for name in ("facts", "t_end"):
        with pytest.raises(li.InputError, match=r"hertz-impact cannot be computed with .*v0 = 1e"):
            getattr(problem, name)
