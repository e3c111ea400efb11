"""Cross-validation finds out a wrong route, and raises no false alarm over the registry."""

import inspect
from dataclasses import dataclass, replace

import numpy as np
import pytest
from lagrangian_names import LAGRANGIAN

import lcpimpact as li
from lcpimpact.integrators import METHODS
from lcpimpact.integrators.exact import Exact
from lcpimpact.integrators.moreau_jean import MoreauJean
from lcpimpact.integrators.radau_fesd import RadauFESD
from lcpimpact.problems import PROBLEMS
from lcpimpact.record import Event, State
from lcpimpact.study.accuracy import routes as routes_module
from lcpimpact.study.accuracy.cross_validation import Outcome
from lcpimpact.study.accuracy.paired_events import Pairing, pair_events
from lcpimpact.study.accuracy.routes import CLOSED_FORM, POINTS, default_routes
from lcpimpact.study.accuracy.siconos import PYTHON, python_with_siconos, siconos

BARS = ("bar-impact", "bouncing-bar", "plastic-bar-impact")
SOME = ("exact", "event-driven", "moreau-jean", "moreau-jean:pgs")


def routes_of(problem):
    return [*SOME, *([CLOSED_FORM] if problem.motion is not None else [])]


# ---- no false alarm -------------------------------------------------------------------------------------------------

ENDS = {"woodpecker": 0.05}
"""Ends of runs in s that differ from the problem's: of one peck, since many impacts are out of step after a few cycles."""


HEAVY = ("ball-in-air", "diode-bridge", "hereditary-impact", "jenkins-cycle", "relay-oscillator", "twisting")
"""Problems whose runs take seconds: what is slow runs them by these routes and all others."""


def with_slow(names):
    return [pytest.param(name, marks=pytest.mark.slow) if name in HEAVY else name for name in names]


@pytest.mark.parametrize(
    "name", [name for name in PROBLEMS if name not in (*BARS, *HEAVY, *LAGRANGIAN, "two-balls-spring")]
)
def test_no_false_alarm(name):
    problem = li.load_problem(name)
    verdict = li.cross_validate(problem, routes_of(problem), t_end=ENDS.get(name))
    assert verdict.agree, verdict.reasons
    taken = verdict.table[verdict.table["failure"] == ""]
    assert len(taken) >= 2
    assert (taken["difference"] <= taken["allowed"]).all()
    assert verdict.pairs["agrees"].all()


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in PROBLEMS if name not in LAGRANGIAN])
def test_no_false_alarm_by_any_route(name):
    """Bars have four elements: of more, whose waves are shorter than the steps, no route shows an order."""
    problem = li.load_problem(name, **({"elements": 4.0} if name in BARS else {}))
    verdict = li.cross_validate(problem, default_routes(problem), t_end=ENDS.get(name))
    assert verdict.outcome is Outcome.AGREE, verdict.reasons
    assert verdict.table.loc[verdict.table["failure"] == "", "agrees"].all()
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
    lax : bool      whether its certificate allows everything, so that only the comparison can find it out
    """

    spoil: str = "heavier"
    lax: bool = True

    def limits(self):
        return replace(super().limits(), precision=1e30) if self.lax else super().limits()

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
    assert all(reason.startswith("'wrong' ") for reason in verdict.reasons)
    assert any(reason.startswith("'wrong' disagrees with 'exact': ") for reason in verdict.reasons) or (
        verdict.reasons[0].startswith("'wrong' is wrong by a closed form: ")
    )


def test_a_route_that_breaks_the_laws_of_the_problem_is_no_vote_and_says_so():
    routes = {"exact": "exact", "wrong": Wrong(lax=False), "moreau-jean": "moreau-jean"}
    verdict = li.cross_validate(li.load_problem("system-1"), routes)
    assert not verdict.agree
    assert "breaks its laws by more than its method allows" in " ".join(str(verdict).split())


CLOSED_FORMS = [name for name in PROBLEMS if name != "ball-in-air" and li.load_problem(name).motion is not None]


@pytest.mark.parametrize(
    "name",
    with_slow(CLOSED_FORMS),
)
def test_a_wrong_closed_form_is_found_out(name):
    problem = li.load_problem(name)
    motion, end = problem.motion, problem.t_end

    def stretched(t):
        return tuple(1.0001 * each for each in motion(t))

    def late(t):
        return motion(np.maximum(t - 1e-4 * end, 0.0))

    # `exact` does not follow Lagrangian systems, so that the problem's own closed form is the third of them.
    others = {"closed form": "closed form"} if name in LAGRANGIAN else {"exact": "exact"}
    others["event-driven"] = "event-driven"
    for wrong in (stretched, late):
        verdict = li.cross_validate(problem, {"mine": wrong, **others})
        assert verdict.table.set_index("route")["agrees"].to_dict() == {"mine": False, **dict.fromkeys(others, True)}
    # The forces of a closed form are not known, and those of event-driven alone confirm nothing.
    right = li.cross_validate(problem, {"mine": motion, **others})
    assert right.outcome is (Outcome.NOTHING if name in LAGRANGIAN else Outcome.AGREE)
    assert right.table["agrees"].all()


def test_two_routes_that_disagree_are_neither_called_right():
    problem = li.load_problem("kelvin-voigt-tension")
    wrong = {"mine": lambda t: tuple(1.0001 * each for each in problem.motion(t)), "event-driven": "event-driven"}
    verdict = li.cross_validate(problem, wrong)
    assert verdict.outcome is Outcome.DISAGREE
    assert not verdict.table["agrees"].any()
    assert "no two routes agree, which would tell the wrong one: add a route of another family" in verdict.reasons[0]


def test_a_coarse_route_that_agrees_with_both_does_not_make_a_wrong_closed_form_right():
    problem = li.load_problem("kelvin-voigt-tension")
    routes = {
        "mine": lambda t: tuple((1.0 + 1e-7) * each for each in problem.motion(t)),
        "event-driven": "event-driven",
        "moreau-jean": "moreau-jean",
    }
    verdict = li.cross_validate(problem, routes)
    assert verdict.table.set_index("route")["agrees"].to_dict() == {
        "mine": False, "event-driven": True, "moreau-jean": True,
    }  # fmt: skip


@pytest.mark.slow
def test_a_wrong_closed_form_under_a_force_that_exact_does_not_handle():
    problem = li.load_problem("ball-in-air")
    for factor in (1.0, 1.0001):

        def mine(t, factor=factor):
            return tuple(factor * each for each in problem.motion(t))

        routes = {"mine": mine, "event-driven": "event-driven", "moreau-jean": "moreau-jean"}
        assert li.cross_validate(problem, routes).agree == (factor == 1.0)


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
    """Of two routes that differ only what is known in closed form can say which is wrong."""
    verdict = li.cross_validate(li.load_problem("system-1"), {"exact": "exact", "wrong": Wrong()})
    assert not verdict.agree
    differs, wrong = verdict.reasons
    assert "they differ by" in differs
    assert wrong.startswith("'wrong' is wrong by a closed form: ")
    assert not verdict.pairs["agrees"][verdict.pairs["quantity"] == "coordinates"].any()


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
    real = routes_module.simulate

    def spoil(problem, method, *, lcp_solver="auto", **options):
        run = real(problem, method, lcp_solver=lcp_solver, **options)
        return replace(run, q=run.q + 1e-6) if lcp_solver == "pgs" else run

    monkeypatch.setattr(routes_module, "simulate", spoil)
    verdict = li.cross_validate(
        li.load_problem("system-1"), ["exact", "moreau-jean", "moreau-jean:pgs", "moreau-jean:lemke"]
    )
    judged = verdict.table.set_index("route")["agrees"]
    assert judged.to_dict() == {"exact": True, "moreau-jean": True, "moreau-jean:pgs": False, "moreau-jean:lemke": True}
    assert "the tolerance of the solver allows" in verdict.reasons[0]


# ---- what a route tells beside its coordinates ------------------------------------------------------------------------


@dataclass(frozen=True)
class Told(MoreauJean):
    """The θ-step, whose run is told otherwise than it went."""


def faster(run):
    return replace(run, v=1.5 * run.v)


def stronger(run):
    return replace(run, reaction=1.1 * run.reaction)


def harder(run):
    return replace(run, events=tuple(replace(event, impulse=1.1 * event.impulse) for event in run.events))


def forgetful(run):
    return replace(run, events=run.events[:1] + run.events[2:])


def late(run):
    shift = 0.01 * run.t[-1]
    return replace(run, events=(replace(run.events[0], t=run.events[0].t + shift), *run.events[1:]))


def imagining(run):
    first, second = run.events[:2]
    return replace(run, events=(first, replace(first, t=0.5 * (first.t + second.t)), *run.events[1:]))


def other_way_round(run):
    kinds = {"open": "close", "close": "open", "stick": "slip", "slip": "stick", "impact": "open"}
    return replace(run, events=tuple(replace(event, kind=kinds[event.kind]) for event in run.events))


TOLD = [
    ("system-1", faster, "velocities"), ("system-1", stronger, "forces"), ("system-1", forgetful, "one has"),
    ("system-1", late, "one has"), ("system-1", imagining, "one has"), ("system-1", other_way_round, "in the other"),
    ("impact-oscillator", faster, "velocities"), ("impact-oscillator", harder, "impulses"),
    ("impact-oscillator", forgetful, "one has an impact"), ("impact-oscillator", late, "one has an impact"),
    ("impact-oscillator", imagining, "one has an impact"), ("oscillator-stop", harder, "impulses"),
    ("two-ball-drop", harder, "impulses"), ("bouncing-ball", harder, "impulses"), ("bouncing-ball", faster, "velocities"),
    ("coulomb-oscillator", stronger, "forces"), ("coulomb-oscillator", other_way_round, "in the other"),
    ("maxwell-impact", stronger, "forces"), ("kelvin-voigt-tension", faster, "velocities"),
]  # fmt: skip


@pytest.mark.parametrize(("name", "spoil", "said"), TOLD, ids=lambda each: getattr(each, "__name__", str(each)))
def test_a_run_with_the_right_coordinates_that_is_told_otherwise_is_found_out(name, spoil, said, monkeypatch):
    real = routes_module.simulate

    def tell(problem, method, **options):
        run = real(problem, method, **options)
        return spoil(run) if isinstance(method, Told) else run

    monkeypatch.setattr(routes_module, "simulate", tell)
    verdict = li.cross_validate(
        li.load_problem(name), {"exact": "exact", "event-driven": "event-driven", "told": Told()}
    )
    assert not verdict.agree
    assert verdict.table.set_index("route")["agrees"].to_dict() == {"exact": True, "event-driven": True, "told": False}
    assert verdict.reasons[0].startswith("'told' disagrees with 'exact': ")
    assert said in verdict.reasons[0]
    pairs = verdict.pairs[(verdict.pairs["b"] == "told") & (verdict.pairs["quantity"] == "coordinates")]
    assert pairs["agrees"].all()


def test_openings_that_exact_alone_has_are_no_agreement(monkeypatch):
    """A contact that is pressed shut and said to open and close again, for less than any step."""
    real = routes_module.simulate

    def tell(problem, method, **options):
        run = real(problem, method, **options)
        if getattr(method, "name", "") != "exact":
            return run
        t = 0.5 * (run.events[1].t + run.events[2].t)
        opening, closing = run.events[:2]
        false = (replace(opening, t=t), replace(closing, t=t + 1e-9))
        return replace(run, events=(*run.events[:2], *false, *run.events[2:]))

    monkeypatch.setattr(routes_module, "simulate", tell)
    verdict = li.cross_validate(li.load_problem("system-1"), ["exact", "moreau-jean"])
    assert not verdict.agree
    assert "one has an opening of R" in " ".join(verdict.reasons)


def test_a_wrong_closed_form_of_a_number_is_said_of_every_route():
    problem = li.load_problem("impact-oscillator")
    wrong = replace(problem, facts=(replace(problem.facts[0], value=1.2 * problem.facts[0].value),))
    assert li.cross_validate(problem, ["exact", "moreau-jean"]).agree
    verdict = li.cross_validate(wrong, ["exact", "moreau-jean"])
    assert not verdict.agree
    assert [reason.split(":")[0] for reason in verdict.reasons] == [
        "'exact' is wrong by a closed form",
        "'moreau-jean' is wrong by a closed form",
    ]


# ---- what is no evidence ------------------------------------------------------------------------------------------------


def a_stop_behind_a_massless_plate():
    """System 1 with a stop under the plate: with both closed, the body meets the ground."""
    scheme = li.Scheme(
        li.Mass("x", m=100.0), li.Load("x", f=981.0), li.Bumper("x", "z", e=0.3, name="R"),
        li.KelvinVoigt("z", "ground", k=3924.0, c=250.0), li.Bumper("z", "ground", gap=0.5, e=0.4, name="S"),
    )  # fmt: skip
    return li.Problem("a stop behind a plate", scheme, v0={"x": 9.9}, t_end=0.4)


def test_variants_of_one_method_do_not_confirm_each_other():
    """Whatever becomes of such schemes, five variants of one method prove nothing about them."""
    variants = {f"θ = {theta}": MoreauJean(theta=theta) for theta in (0.5, 0.75, 1.0)}
    routes = {**variants, "lemke": "moreau-jean:lemke", "primal": "moreau-jean:qp:osqp:primal"}
    for problem in (a_stop_behind_a_massless_plate(), li.load_problem("system-1"), li.load_problem("bouncing-ball")):
        assert not li.cross_validate(problem, routes).agree
    verdict = li.cross_validate(li.load_problem("system-1"), ["moreau-jean", "moreau-jean:lemke", "moreau-jean:pgs"])
    assert verdict.outcome is Outcome.NOTHING
    assert verdict.reasons[0].startswith("fewer than two routes were run")
    verdict = li.cross_validate(li.load_problem("impact-oscillator"), ["moreau-jean", "moreau-midpoint", "newmark-ns"])
    assert verdict.outcome is Outcome.NOTHING
    assert "are of one family, Moreau time stepping" in verdict.reasons[0]


def test_a_relative_degree_that_changes_with_the_mode_is_agreed_on_only_by_independent_routes():
    verdict = li.cross_validate(a_stop_behind_a_massless_plate())
    if verdict.agree:
        sound = verdict.table[(verdict.table["failure"] == "") & (verdict.table["doubt"] == "")]
        assert sound["family"].nunique() >= 2


def test_one_choice_of_modes_is_one_source_where_there_are_contacts():
    routes = ["exact", "event-driven", "radau-fesd"]
    verdict = li.cross_validate(li.load_problem("system-1"), routes)
    assert verdict.outcome is Outcome.NOTHING
    assert "take the contact mode from one source" in verdict.reasons[0]
    assert verdict.table["agrees"].all()
    assert li.cross_validate(li.load_problem("kelvin-voigt-tension"), routes).agree
    assert li.cross_validate(li.load_problem("system-1"), [*routes, "rk4-paper"]).agree


def test_forces_and_events_that_one_route_alone_tells_are_not_confirmed():
    verdict = li.cross_validate(li.load_problem("kelvin-voigt-impact"), ["exact", "closed form"])
    assert verdict.outcome is Outcome.NOTHING
    assert verdict.reasons == ("forces are computed by 'exact' alone", "times of events are computed by 'exact' alone")


def test_a_route_that_errs_as_much_as_the_motion_is_large_confirms_nothing(monkeypatch):
    real = routes_module.simulate

    def blur(problem, method, *, dt, **options):
        run = real(problem, method, dt=dt, **options)
        wave = np.sin(run.t / run.t[-1])[:, None]
        return replace(run, q=run.q + 500.0 * dt * wave) if isinstance(method, Told) else run

    monkeypatch.setattr(routes_module, "simulate", blur)
    verdict = li.cross_validate(li.load_problem("system-1"), {"exact": "exact", "blurred": Told(theta=1.0)})
    assert verdict.outcome is Outcome.NOTHING
    assert verdict.table["agrees"].all()
    assert "coordinates are computed by 'exact' alone; not by 'blurred' (too rough: " in verdict.reasons[0]
    assert "too rough" in verdict.table["doubt"][1]


def test_an_estimate_is_trusted_only_of_a_route_that_converges(monkeypatch):
    """It differs by the same from run to run, as a method does that rings."""
    real = routes_module.simulate

    def ring(problem, method, *, dt, **options):
        run = real(problem, method, dt=dt, **options)
        level = round(np.log(run.t[-1] / dt / POINTS) / np.log(3.0))
        return replace(run, q=run.q + 5e-3 * (-1.0) ** level) if isinstance(method, Told) else run

    monkeypatch.setattr(routes_module, "simulate", ring)
    verdict = li.cross_validate(li.load_problem("system-1"), {"exact": "exact", "rings": Told()})
    assert not verdict.agree
    assert "and it declares 2 for such a motion" in verdict.table["doubt"][1]


def test_a_reference_that_breaks_off_is_no_agreement():
    routes = {"closed form": "closed form", "exact": Exact(max_events=3), "moreau-jean": "moreau-jean"}
    verdict = li.cross_validate(li.load_problem("bouncing-ball"), routes)
    assert verdict.outcome is Outcome.DISAGREE
    assert "More events than max_events" in verdict.table["failure"][1]
    assert any(reason.startswith("'exact' broke off: ") for reason in verdict.reasons)


def test_every_method_says_of_which_family_it_is():
    families = {name: kind.family for name, kind in METHODS.items()}
    assert all(families.values())
    assert families["moreau-jean"] == families["newmark-ns"] != families["schatzman-paoli"]
    assert families["radau"] == families["radau-fesd"]
    assert families["rk4"] == families["rk4-paper"]
    assert len(set(families.values())) == 6


def test_methods_that_choose_modes_by_one_module_say_so():
    """Those whose modules import the choice, or what makes it."""
    words = ("choose_mode", "transition import", "motion import")
    sources = {name: inspect.getsource(inspect.getmodule(kind)) for name, kind in METHODS.items()}
    shared = {name for name, source in sources.items() if any(word in source for word in words)}
    assert (
        shared
        == {name for name, kind in METHODS.items() if kind.mode_choice}
        == {"exact", "event-driven", "radau-fesd"}
    )


# ---- events of two runs side by side ----------------------------------------------------------------------------------


def event(t, kind="impact", impulse=1.0, contact="R"):
    state = State(np.zeros(1), np.zeros(1), np.zeros(1))
    return Event(t, contact, kind, state, state, impulse if kind == "impact" else 0.0)


def test_events_correspond_within_the_window_only():
    a, b = [event(0.2), event(0.5, "open")], [event(0.21), event(0.52, "open")]
    assert pair_events(a, b, 0.03, 1.0, 0.0) == Pairing(pytest.approx(0.02), 0.0, ())
    assert len(pair_events(a, b, 0.005, 1.0, 0.0).missing) == 4
    assert len(pair_events(a, [event(0.21, contact="S"), b[1]], 0.03, 1.0, 0.0).missing) == 2


def test_events_that_cannot_be_told_apart_count_by_their_sum_and_by_what_they_leave():
    many = [event(0.5 + 1e-4 * k, impulse=0.1) for k in range(10)]
    assert pair_events(many, [event(0.5)], 1e-3, 1.0, 0.0).missing == ()
    assert pair_events(many, [event(0.5)], 1e-3, 1.0, 0.0).impulse == pytest.approx(0.0)
    assert pair_events(many, [event(0.5, impulse=0.7)], 1e-3, 1.0, 0.0).impulse == pytest.approx(0.3)
    closes = [event(0.5, "open"), event(0.5001, "close")]
    assert len(pair_events(closes, [event(0.5, "open")], 1e-3, 1.0, 0.0).missing) == 1
    assert pair_events(closes, [event(0.5, "close")], 1e-3, 1.0, 0.0).missing == ()


def test_an_impact_is_missing_unless_it_is_too_slight():
    assert pair_events([event(0.5, impulse=0.1)], [], 1e-3, 1.0, 0.2) == Pairing(0.0, 0.1, ())
    assert pair_events([event(0.5, impulse=0.1)], [], 1e-3, 1.0, 0.05).missing == ("an impact of R at t = 0.5 s",)
    assert pair_events([event(0.9999)], [], 1e-3, 1.0, 0.0).missing == ()


# ---- what stands in the verdict -------------------------------------------------------------------------------------


def test_a_refusal_is_a_reason_but_no_disagreement():
    problem = li.load_problem("hertz-impact")
    verdict = li.cross_validate(problem, ["exact", "moreau-jean", "event-driven"])
    assert verdict.agree
    assert verdict.reasons == (f"'exact' was not run: {verdict.table['failure'][0]}",)
    assert "does not handle non-linear springs" in verdict.reasons[0]
    assert str(verdict).startswith(
        "hertz-impact: 2 routes of 2 families agree, to 3e-05 of the motion\n  'exact' was not"
    )


def test_one_route_is_no_cross_validation():
    verdict = li.cross_validate(li.load_problem("system-1"), ["exact"])
    assert not verdict.agree
    assert verdict.reasons == ("fewer than two routes were run, so nothing was compared",)
    verdict = li.cross_validate(li.load_problem("system-1"), ["exact", "moreau-jean:pgs"])
    assert not verdict.agree
    assert verdict.outcome.value == "nothing to judge by"
    assert "'moreau-jean:pgs' only solve the LCPs of the same steps again" in verdict.reasons[0]
    assert "no run with the same steps" in verdict.table["failure"][1]


def test_the_tolerance_forgives():
    problem = li.load_problem("kelvin-voigt-tension")
    motion = problem.motion
    routes = {"exact": "exact", "mine": lambda t: tuple(1.001 * each for each in motion(t))}
    assert not li.cross_validate(problem, routes).agree
    assert li.cross_validate(problem, routes, tol=1e-2).agree


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
        ("exact", {}, r"must be a sequence: write \['exact'\]"),
        (["exact", "exact"], {}, "'exact' is listed twice"),
        (["closed form"], {}, "'system-1' has no closed form"),
        ([3.0], {}, r"routes\[0\] = 3.0 must be a string or an Integrator or a function"),
        (["exact"], {"t_end": -1.0}, "t_end = -1.0 must be a positive finite number"),
        (["exact"], {"dt": 0.0}, "dt = 0.0 must be a positive"),
        (["exact"], {"tol": 2.0}, "tol = 2.0 must be a number between 0 and 1"),
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


@pytest.mark.parametrize(
    ("element", "what"),
    [
        (li.Friction("x", "ground", mu=0.5, normal="N"), "friction that a normal force bounds"),
        (li.RigidLink("x", {"y": 2.0}), "rigid links"),
    ],
)
def test_the_route_by_siconos_refuses_rows_that_it_would_take_for_contacts(element, what):
    scheme = li.Scheme(
        li.Mass("x", 1.0), li.Mass("y", 1.0), li.Load("y", 9.81), li.Bumper("y", "ground", e=0.5, name="N"), element
    )
    with pytest.raises(li.UnsupportedError, match=f"has {what}, which the route by Siconos does not handle"):
        siconos(li.Problem("rows", scheme), steps=10, t_end=0.1)


@pytest.mark.parametrize(("e", "load"), [(0.0, 2.0), (0.5, 2.0), (0.5, 0.0)])
def test_impacts_at_instants_of_all_grids_are_agreed_on(e, load):
    """A ball lands after 1 s, which is an instant of the grids of all routes with steps, by rounding before or after."""
    scheme = li.Scheme(li.Mass("x", 1.0), li.Bumper("x", "ground", gap=1.0, e=e), li.Load("x", load))
    ball = li.Problem("ball", scheme, v0={"x": 1.0 - 0.5 * load})
    verdict = li.cross_validate(
        ball, ["exact", "event-driven", "radau-fesd", "moreau-jean"], t_end=1.95, progress=False
    )
    assert verdict.agree, str(verdict)
