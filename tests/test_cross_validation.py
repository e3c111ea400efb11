"""Cross-validation finds out a wrong route, and raises no false alarm over the registry."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

import lcpimpact as li
from lcpimpact.integrators.moreau_jean import MoreauJean
from lcpimpact.integrators.radau_fesd import RadauFESD
from lcpimpact.problems import PROBLEMS
from lcpimpact.study import cross_validation
from lcpimpact.study.cross_validation import CLOSED_FORM, POINTS, default_routes
from lcpimpact.study.siconos import PYTHON, python_with_siconos

BARS = ("bar-impact", "bouncing-bar", "plastic-bar-impact")
SOME = ("exact", "event-driven", "moreau-jean", "moreau-jean:pgs")


def routes_of(problem):
    return [*SOME, *([CLOSED_FORM] if problem.motion is not None else [])]


# ---- no false alarm -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", [name for name in PROBLEMS if name not in (*BARS, "diode-bridge", "two-balls-spring")])
def test_no_false_alarm(name):
    problem = li.load_problem(name)
    verdict = li.cross_validate(problem, routes_of(problem))
    assert verdict.agree, verdict.reasons
    taken = verdict.table[verdict.table["failure"] == ""]
    assert len(taken) >= 2
    assert (taken["difference"] <= taken["allowed"]).all()
    assert verdict.pairs["agrees"].all()


@pytest.mark.slow
@pytest.mark.parametrize("name", PROBLEMS)
def test_no_false_alarm_by_any_route(name):
    problem = li.load_problem(name)
    routes = [
        each for each in default_routes(problem) if name not in BARS or each not in ("radau-fesd", "event-driven")
    ]
    verdict = li.cross_validate(problem, routes)
    assert verdict.agree, verdict.reasons
    assert (verdict.table["failure"] == "").sum() >= 2


@pytest.mark.parametrize("t_end", [0.4, 1.7])
def test_no_false_alarm_at_other_ends_and_steps(t_end):
    for dt in (None, t_end / 1700):
        for name in ("system-1", "system-3", "bouncing-ball"):
            verdict = li.cross_validate(li.load_problem(name), ["exact", "moreau-jean"], t_end=t_end, dt=dt)
            assert verdict.agree, (name, verdict.reasons)


# ---- a wrong route is found out -------------------------------------------------------------------------------------


def heavier(element):
    return replace(element, m=1.03 * element.m) if isinstance(element, li.Mass) else element


def deaf(element):
    """A bumper that has forgotten its restitution."""
    bounces = isinstance(element, li.Bumper) and element.e
    return replace(element, e=0.0) if bounces else element


def upside_down(element):
    weighs = isinstance(element, li.Load) and not callable(element.f)
    return replace(element, f=-element.f) if weighs else element


def undamped(element):
    if isinstance(element, li.KelvinVoigt):
        return li.Spring(element.a, element.b, element.k)
    return element


def softer(element):
    springs = (li.Spring, li.KelvinVoigt, li.Maxwell)
    return replace(element, k=0.97 * element.k) if isinstance(element, springs) else element


def wider(element):
    return replace(element, gap=element.gap + 0.02) if isinstance(element, li.Bumper) else element


SPOILS = {each.__name__: each for each in (heavier, deaf, upside_down, undamped, softer, wider)}


def spoiled(problem, spoil):
    scheme = li.Scheme(*(spoil(element) for element in problem.scheme.elements))
    return replace(problem, scheme=scheme, motion=None, facts=())


@dataclass(frozen=True)
class Wrong(MoreauJean):
    """Solves another problem than it was given.

    spoil : str     what it does to each element
    """

    spoil: str = "heavier"

    def start(self, problem, grid, lcp_solver, record):
        return super().start(spoiled(problem, SPOILS[self.spoil]), grid, lcp_solver, record)


WRONG = [
    *[(name, "heavier") for name in ("system-1", "system-2", "system-3", "kelvin-voigt-impact", "maxwell-impact",
                                     "oscillator-stop", "two-balls-spring")],
    *[(name, "deaf") for name in ("bouncing-ball", "impact-oscillator", "oscillator-stop", "vibrating-table")],
    *[(name, "upside_down") for name in ("system-1", "bouncing-ball", "two-balls-spring")],
    *[(name, "undamped") for name in ("system-1", "system-3", "kelvin-voigt-impact", "kelvin-voigt-tension")],
    *[(name, "softer") for name in ("system-2", "oscillator-stop", "bilinear-oscillator", "coulomb-oscillator")],
    *[(name, "wider") for name in ("bouncing-ball", "three-balls", "two-ball-drop", "vibrating-table")],
]  # fmt: skip


@pytest.mark.parametrize(("name", "spoil"), WRONG)
def test_a_route_that_solves_another_problem_is_found_out(name, spoil):
    problem = li.load_problem(name)
    assert spoiled(problem, SPOILS[spoil]).scheme != problem.scheme
    verdict = li.cross_validate(problem, {"exact": "exact", "wrong": Wrong(spoil=spoil), "moreau-jean": "moreau-jean"})
    assert not verdict.agree
    judged = verdict.table.set_index("route")["agrees"]
    assert not judged["wrong"]
    assert judged["exact"]
    assert judged["moreau-jean"]
    (reason,) = verdict.reasons
    assert reason.startswith("'wrong' disagrees with 'exact': ")


CLOSED_FORMS = [name for name in PROBLEMS if name != "diode-bridge" and li.load_problem(name).motion is not None]


@pytest.mark.parametrize("name", [*CLOSED_FORMS, pytest.param("diode-bridge", marks=pytest.mark.slow)])
def test_a_wrong_closed_form_is_found_out(name):
    problem = li.load_problem(name)
    motion, end = problem.motion, problem.t_end

    def stretched(t):
        return tuple(1.0001 * each for each in motion(t))

    def late(t):
        return motion(np.maximum(t - 1e-4 * end, 0.0))

    for wrong in (stretched, late):
        verdict = li.cross_validate(problem, {"mine": wrong, "exact": "exact", "event-driven": "event-driven"})
        assert verdict.table.set_index("route")["agrees"].to_dict() == {
            "mine": False,
            "exact": True,
            "event-driven": True,
        }
    right = li.cross_validate(problem, {"mine": motion, "exact": "exact", "event-driven": "event-driven"})
    assert right.agree


@dataclass(frozen=True)
class Impostor(MoreauJean):
    """Says that it is of the second order.

    theta : float   that of an implicit Euler step
    """

    theta: float = 1.0


@pytest.mark.parametrize("name", ["system-1", "system-2", "system-3", "kelvin-voigt-tension", "maxwell-impact"])
def test_an_impostor_of_a_lower_order_is_found_out(name):
    routes = {"exact": "exact", "impostor": Impostor(), "moreau-jean": "moreau-jean"}
    verdict = li.cross_validate(li.load_problem(name), routes)
    judged = verdict.table.set_index("route")
    assert judged["agrees"].to_dict() == {"exact": True, "impostor": False, "moreau-jean": True}
    assert judged["observed"]["impostor"] < 1.3
    assert judged["observed"]["moreau-jean"] > 1.7
    # The same steps under their own name are right.
    assert li.cross_validate(li.load_problem(name), ["exact", MoreauJean(theta=1.0), "moreau-jean"]).agree


@dataclass(frozen=True)
class LowRadau(RadauFESD):
    """Says that it has three stages.

    stages : int    two, of the third order
    """

    stages: int = 2


def test_an_impostor_of_a_high_order_is_found_out():
    verdict = li.cross_validate(
        li.load_problem("kelvin-voigt-impact"), {"exact": "exact", "low": LowRadau(), "event": "event-driven"}
    )
    assert verdict.table.set_index("route")["agrees"].to_dict() == {"exact": True, "low": False, "event": True}


def test_two_routes_that_differ_are_both_told():
    """With two routes nobody can say which is wrong, only that they differ."""
    verdict = li.cross_validate(li.load_problem("system-1"), {"exact": "exact", "wrong": Wrong()})
    assert not verdict.agree
    assert len(verdict.reasons) == 1
    assert "differ by" in verdict.reasons[0]
    assert not verdict.pairs["agrees"].any()


def test_a_wrong_majority_of_sloppy_routes_does_not_outvote_two_exact_ones():
    problem = li.load_problem("system-1")
    routes = {f"wrong {k}": replace(Wrong(), theta=0.5) for k in range(3)}
    verdict = li.cross_validate(problem, {**routes, "exact": "exact", "event-driven": "event-driven"})
    judged = verdict.table.set_index("route")["agrees"]
    assert judged["exact"]
    assert judged["event-driven"]
    assert not judged[list(routes)].any()


def test_a_solver_that_errs_is_found_out(monkeypatch):
    """The run with another solver is spoiled, as if the solver had stopped early."""
    real = cross_validation.simulate

    def spoil(problem, method, *, lcp_solver="auto", **options):
        run = real(problem, method, lcp_solver=lcp_solver, **options)
        return replace(run, q=run.q + 1e-6) if lcp_solver == "pgs" else run

    monkeypatch.setattr(cross_validation, "simulate", spoil)
    verdict = li.cross_validate(
        li.load_problem("system-1"), ["exact", "moreau-jean", "moreau-jean:pgs", "moreau-jean:lemke"]
    )
    judged = verdict.table.set_index("route")["agrees"]
    assert judged.to_dict() == {"exact": True, "moreau-jean": True, "moreau-jean:pgs": False, "moreau-jean:lemke": True}
    assert "solver's tolerance" in verdict.reasons[0]


# ---- what stands in the verdict -------------------------------------------------------------------------------------


def test_a_refusal_is_a_reason_but_no_disagreement():
    problem = li.load_problem("hertz-impact")
    verdict = li.cross_validate(problem, ["exact", "moreau-jean", "event-driven"])
    assert verdict.agree
    assert verdict.reasons == (f"'exact' was not taken: {verdict.table['failure'][0]}",)
    assert "does not handle non-linear springs" in verdict.reasons[0]
    assert str(verdict).startswith("hertz-impact: 2 routes agree\n  'exact' was not taken")


def test_one_route_is_no_cross_validation():
    verdict = li.cross_validate(li.load_problem("system-1"), ["exact"])
    assert not verdict.agree
    assert verdict.reasons == ("fewer than two routes were taken, so nothing was compared",)
    verdict = li.cross_validate(li.load_problem("system-1"), ["exact", "moreau-jean:pgs"])
    assert not verdict.agree
    assert "no run with the same steps" in " ".join(verdict.reasons)


def test_the_tolerance_forgives():
    problem = li.load_problem("kelvin-voigt-tension")
    motion = problem.motion
    routes = {"exact": "exact", "mine": lambda t: (1.001 * motion(t)[0], None)}
    assert not li.cross_validate(problem, routes).agree
    assert li.cross_validate(problem, routes, tolerance=1e-2).agree


def test_the_estimate_of_a_route_is_its_error():
    """Against the exact solution, for a method without kinks in its way: neither wide nor too small."""
    for name in ("kelvin-voigt-tension", "system-1", "bilinear-oscillator"):
        table = li.cross_validate(li.load_problem(name), ["exact", "moreau-jean"]).table.set_index("route")
        ratio = table["difference"]["moreau-jean"] / table["estimate"]["moreau-jean"]
        assert 0.3 < ratio < 2.0


def test_siconos_is_a_route_or_says_how_to_get_it(monkeypatch):
    problem = li.load_problem("bouncing-ball")
    if python_with_siconos() is not None:
        verdict = li.cross_validate(problem, ["exact", "moreau-jean", "siconos"], t_end=1.0)
        assert verdict.agree
        pair = verdict.pairs[(verdict.pairs["a"] == "moreau-jean") & (verdict.pairs["b"] == "siconos")]
        assert pair["difference"].item() < 1e-9
    monkeypatch.setenv(PYTHON, "/nowhere/python3")
    python_with_siconos.cache_clear()
    try:
        verdict = li.cross_validate(problem, ["exact", "moreau-jean", "siconos"], t_end=1.0)
    finally:
        python_with_siconos.cache_clear()
    assert verdict.agree
    assert verdict.table["failure"].iloc[2] == "not installed: apt-get install python3-siconos"


@pytest.mark.parametrize(
    ("routes", "options", "match"),
    [
        (["no-such"], {}, "unknown method 'no-such'"),
        (["moreau-jean:no-such"], {}, "unknown solver 'no-such'"),
        ("exact", {}, r"must be a list of routes: write \['exact'\]"),
        (["exact", "exact"], {}, "'exact' stands there twice"),
        (["closed form"], {}, "'system-1' has no closed form"),
        ([3.0], {}, "must be a name, an Integrator, or a function"),
        (["exact"], {"t_end": -1.0}, "t_end = -1.0 must be a positive finite number"),
        (["exact"], {"dt": 0.0}, "dt = 0.0 must be a positive"),
        (["exact"], {"tolerance": 2.0}, "tolerance = 2.0 must be a number between 0 and 1"),
    ],
)
def test_wrong_input_is_one_sentence(routes, options, match):
    with pytest.raises(li.InputError, match=match):
        li.cross_validate(li.load_problem("system-1"), routes, **options)


def test_a_closed_form_of_the_wrong_shape_is_a_reason():
    verdict = li.cross_validate(
        li.load_problem("system-1"), {"mine": lambda t: (np.zeros(POINTS + 1), None), "exact": "exact"}
    )
    assert "returned q of shape (196,)" in " ".join(verdict.reasons)
