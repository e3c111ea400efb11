"""Functions that run one method take its options and its LCP solver as `simulate` does, and refuse in its words."""

from __future__ import annotations

import pytest

import lcpimpact as li
from lcpimpact.integrators.exact import Exact
from lcpimpact.integrators.moreau_jean import MoreauJean
from lcpimpact.study.accuracy.orders import observed_order
from lcpimpact.study.design import fit as fits
from lcpimpact.study.dynamics import sections

DRIVEN = li.load_problem("impact-oscillator")


def simulated(**options):
    return li.simulate(DRIVEN, dt=1e-2, t_end=1.0, **{"method": "moreau-jean"} | options)


def cut(**options):
    return li.poincare(DRIVEN, points=2, **{"method": "moreau-jean"} | options)


def swept(**options):
    def family(f):
        return li.load_problem("impact-oscillator", f=f)

    return li.bifurcation(family, [1.0], skip=0, points=2, progress=False, **{"method": "moreau-jean"} | options)


def fitted(**options):
    target = li.Target(lambda run: float(run["x"][-1]), -0.1)
    return li.fit(
        DRIVEN, ["f"], outputs={"x": target}, dt=0.05, t_end=0.5, progress=False, **{"method": "moreau-jean"} | options
    )


def ordered(**options):
    return observed_order(DRIVEN, counts=(101, 211), t_end=1.0, **{"method": "moreau-jean"} | options)


RUNS = [simulated, cut, swept, fitted, ordered]


@pytest.mark.parametrize("function", RUNS)
def test_another_word_for_the_solver_offers_the_right_one(function):
    for wrong in ("solver", "lcp", "lcp_sover"):
        with pytest.raises(li.InputError, match=f"unknown option of moreau-jean '{wrong}': did you mean 'lcp_solver'"):
            function(**{wrong: "lemke"})


@pytest.mark.parametrize("function", RUNS)
def test_an_unknown_option_offers_the_nearest(function):
    with pytest.raises(li.InputError, match="unknown option of moreau-jean 'teta': did you mean 'theta'"):
        function(teta=1.0)
    with pytest.raises(li.InputError, match="unknown option of moreau-jean 'tend': did you mean 't_end'"):
        function(tend=1.0)


@pytest.mark.parametrize("function", RUNS)
def test_options_beside_an_object_are_refused(function):
    with pytest.raises(li.InputError, match="theta: options belong in the integrator object"):
        function(method=MoreauJean(), theta=1.0)


@pytest.mark.parametrize("function", RUNS)
def test_the_solver_is_looked_up_before_the_run(function):
    with pytest.raises(li.UnknownNameError, match="did you mean 'lemke'"):
        function(lcp_solver="lemk")
    with pytest.raises(li.InputError, match="rk4-paper solves no LCP, so lcp_solver = 'lemke' means nothing"):
        function(method="rk4-paper", lcp_solver="lemke")


@pytest.mark.parametrize(("function", "module"), [(cut, sections), (swept, sections), (fitted, fits)])
@pytest.mark.parametrize("method", ["moreau-jean", MoreauJean()], ids=["name", "object"])
def test_the_solver_reaches_the_run(monkeypatch, function, module, method):
    seen = []

    def watched(*args, **kwargs):
        seen.append(kwargs["lcp_solver"])
        return li.simulate(*args, **kwargs)

    monkeypatch.setattr(module, "simulate", watched)
    function(method=method, lcp_solver="lemke")
    assert set(seen) == {"lemke"}


def test_the_solver_reaches_the_exact_motion(monkeypatch):
    seen = []
    motion = Exact.motion

    def watched(self, problem, end, lcp_solver):
        seen.append(lcp_solver)
        return motion(self, problem, end, lcp_solver)

    monkeypatch.setattr(Exact, "motion", watched)
    for function in RUNS[:4]:
        function(method="exact", lcp_solver="lemke")
    assert set(seen) == {"lemke"}


def test_the_fit_takes_an_object():
    by_name, by_object = fitted(theta=1.0), fitted(method=MoreauJean(theta=1.0))
    assert by_object.values == by_name.values
