"""Errors over steps and costs, the orders that are observed, their pictures, the commands, and the public table."""

from __future__ import annotations

import importlib.util
import math
import re
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.figure import Figure
from matplotlib.patches import Polygon
from numpy.testing import assert_allclose
from scipy.stats import linregress

import lcpimpact as li
from lcpimpact.cli.main import main
from lcpimpact.integrators.dopri5 import DormandPrince
from lcpimpact.integrators.event_driven import EventDriven
from lcpimpact.integrators.moreau_jean import MoreauJean
from lcpimpact.plotting.convergence import _limit_errors
from lcpimpact.study.accuracy.convergence import (
    COSTS,
    Convergence,
    WorkPrecision,
    convergence,
    labelled,
    observed_orders,
    steps_clear_of,
    work_precision,
)
from lcpimpact.study.accuracy.fitted_order import fit
from lcpimpact.study.accuracy.limits import IMPACT, SMOOTH, declared_order, limits_of
from lcpimpact.study.accuracy.reference import reference

ROOT = Path(__file__).parents[2]
SIX = [3.0 / n for n in (101, 163, 257, 409, 653, 1049)]


def oscillator(k=4.0):
    return li.Problem("oscillator", li.Scheme(li.Mass("x", 1.0), li.Spring("x", "ground", k)), q0={"x": 1.0}, t_end=3.0)


def call(capsys, *arguments):
    with pytest.raises(SystemExit) as stop:
        main([str(each) for each in arguments])
    captured = capsys.readouterr()
    return stop.value.code, captured.out, captured.err


# ---- steps ----------------------------------------------------------------------------------------------------------


@settings(max_examples=60)
@given(
    n=st.integers(2, 3000),
    places=st.lists(st.tuples(st.integers(1, 60), st.integers(2, 61)), max_size=5),
)
def test_steps_are_a_prime_and_no_event_is_on_the_grid(n, places):
    events = [2.5 * a / b for a, b in places if a < b]
    found = steps_clear_of(events, 2.5, 2.5 / n)
    assert found >= n
    assert all(found % d for d in range(2, found))
    for t in events:
        place = t * found / 2.5
        assert abs(place - round(place)) > 1e-6
    # No smaller prime would have done.
    for other in range(n, found):
        if other > 1 and all(other % d for d in range(2, other)):
            assert any(abs(t * other / 2.5 - round(t * other / 2.5)) <= 1e-6 for t in events)


def test_events_at_both_ends_do_not_count():
    assert steps_clear_of([0.0, 1.0], 1.0, 0.1) == 11


def test_the_grid_keeps_clear_of_an_impact():
    """H is such that the ball falls for 3/11 of the run: eleven steps would meet the impact."""
    t_end = 1.0
    ball = li.load_problem("bouncing-ball", H=0.5 * 9.81 * (3.0 / 11.0 * t_end) ** 2)
    table = convergence(ball, ["moreau-jean"], [0.1, 0.095], t_end=t_end, norms=["sup_q"])
    assert list(table["steps"]) == [13], "two steps that become one are one"
    assert table["dt"].item() == t_end / 13


# ---- errors ---------------------------------------------------------------------------------------------------------


def test_errors_are_those_of_a_loop_by_hand():
    """Heun's method on x'' = -4 x, against cos 2t."""
    table = convergence(oscillator(), ["heun"], SIX[:3], norms=["sup_q"])
    for row in table.itertuples():
        x, v, worst = 1.0, 0.0, 0.0
        for i in range(row.steps):
            X, V = x + row.dt * v, v - 4.0 * row.dt * x
            x, v = x + 0.5 * row.dt * (v + V), v - 2.0 * row.dt * (x + X)
            worst = max(worst, abs(x - math.cos(2.0 * (i + 1) * row.dt)))
        assert row.sup_q == pytest.approx(worst, rel=1e-9)
        assert row.evaluations == 2 * row.steps


def test_no_method_is_its_own_reference():
    problem = li.load_problem("system-1")
    table = convergence(problem, ["exact", "event-driven", "moreau-jean"], [0.03], norms=["sup_q"])
    assert [name.split(" ")[0] for name in table["reference"]] == ["event-driven", "exact", "exact"]
    assert 0.0 < table["sup_q"].iloc[0] < 1e-9
    ours = li.simulate(problem, "dopri5", dt=3.0 / 30011, t_end=3.0)
    table = convergence(problem, ["moreau-jean"], [0.03], norms=["sup_q"], reference=ours)
    assert table["reference"].item().startswith("dopri5")
    with pytest.raises(li.InputError, match=r"reference ends at 1 s, before t_end = 3 s"):
        convergence(problem, ["heun"], [0.03], reference=li.simulate(problem, "exact", dt=0.1, t_end=1.0))
    own = convergence(problem, ["dopri5", "moreau-jean"], [0.03], norms=["sup_q"], reference=ours)
    assert own.table["failure"].iloc[0].startswith("the reference that is given is by dopri5 itself")
    assert np.isnan(own.table["sup_q"].iloc[0])
    assert own.table["sup_q"].iloc[1] > 0.0


@pytest.mark.parametrize(
    "study", [lambda *a, **k: convergence(*a, [0.03], **k), lambda *a, **k: li.compare(*a, dt=0.03, **k)]
)
def test_a_reference_of_other_parameters_is_refused(study):
    other = li.simulate(li.load_problem("system-1", c_o=300.0), "exact", dt=0.1, t_end=3.0)
    with pytest.raises(li.InputError, match=r"reference is of 'system-1' with c_o = 300, and the problem has 250"):
        study(li.load_problem("system-1"), ["moreau-jean"], reference=other)


def test_what_is_refused_or_fails_is_a_row():
    stiff = oscillator(k=1e8)
    table = convergence(stiff, ["rk4", "schatzman-paoli", "rk4-paper"], [0.01], norms=["sup_q"])
    assert list(table["method"]) == ["rk4", "schatzman-paoli", "rk4-paper"]
    unstable, _, refused = table.itertuples()
    assert unstable.failure
    assert math.isnan(unstable.sup_q)
    assert "knows only" in refused.failure
    assert refused.steps == 307
    assert pd.isna(refused.evaluations)
    verdicts = observed_orders(table, "sup_q").set_index("method")["verdict"]
    assert verdicts["rk4"] == verdicts["rk4-paper"] == "failed"


# ---- what limits an order -------------------------------------------------------------------------------------------

LIMITS = [
    ("system-1", 0.5, ["smooth"], 2, 4, 5),
    ("system-1", 3.0, ["smooth", "force jump"], 2, 2, 5),
    ("system-2", 3.0, ["smooth", "force kink"], 2, 2, 5),
    ("bouncing-ball", 2.5, ["smooth", "impact"], 1, 1, 5),
    ("coulomb-oscillator", 3.0, ["smooth", "friction"], 1, None, 5),
]


@pytest.mark.parametrize(("name", "t_end", "limits", "moreau_jean", "rk4", "fesd"), LIMITS)
def test_the_events_of_the_reference_say_what_is_to_be_expected(name, t_end, limits, moreau_jean, rk4, fesd):
    problem = li.load_problem(name)
    found = limits_of(reference(problem, t_end).trajectory)
    assert [limit.name for limit in found] == limits
    table = convergence(problem, ["moreau-jean", "rk4", "radau-fesd"], [t_end / 50], t_end=t_end, norms=["l1_v"])
    declared = dict(zip(table["method"], table["declared"], strict=True))
    assert (declared["moreau-jean"], declared["radau-fesd"]) == (moreau_jean, fesd)
    if rk4 is not None:
        assert declared["rk4"] == rk4
    assert table.limited_by.name == limits[-1]
    assert table.limited_by.norm == ("l1_v" if "impact" in limits else "sup_q")


def test_nothing_is_declared_for_compliant_laws_and_other_options():
    hertz = li.load_problem("hertz-impact")
    found = limits_of(reference(hertz).trajectory)
    assert found[-1].name == "compliant law"
    assert math.isnan(declared_order(MoreauJean(), found))
    smooth = found[:1]
    assert declared_order(MoreauJean(rtol=1e-6, max_iter=50), smooth) == 2.0
    assert math.isnan(declared_order(MoreauJean(theta=0.7), smooth))


# ---- orders ---------------------------------------------------------------------------------------------------------


def test_the_fit_is_that_of_a_linear_regression():
    rng = np.random.default_rng(1)
    dts = 3.0 / np.array([100, 163, 257, 409, 653, 1049])
    errors = 0.3 * dts**1.7 * 10.0 ** rng.normal(0.0, 0.1, 6)
    found, known = fit(dts, errors), linregress(np.log10(dts), np.log10(errors))
    assert_allclose((found.slope, found.standard_error), (known.slope, known.stderr), rtol=1e-10)
    rest = np.log10(errors) - known.slope * np.log10(dts) - known.intercept
    assert_allclose(found.scatter, np.std(rest), rtol=1e-10)
    assert math.isnan(fit(dts[:2], errors[:2]).standard_error)
    with pytest.raises(li.InputError, match="at least two steps"):
        fit(dts[:1], errors[:1])


def made(errors, declared=2.0, limited_by=SMOOTH, failure="", rtol=math.nan, reference="exact"):
    """A study as `convergence` makes it, with errors of our own; an impact limits the order in sup q here too."""
    n = len(errors)
    dts = [3.0 / count for count in (101, 163, 257, 409, 653, 1049)][:n]
    table = pd.DataFrame({
        "method": "ours", "law": "rigid", "k": math.inf, "rtol": rtol, "dt": dts, "sup_q": errors,
        "declared": declared, "reference": reference, "violation": "", "failure": failure,
    })  # fmt: skip
    limit = replace(limited_by, norm="sup_q")
    return Convergence(oscillator(), 3.0, table, "sup_q", limited_by=limit, scales={"sup_q": 2.0})


def verdict(*arguments, **options):
    return observed_orders(made(*arguments, **options))["verdict"].item()


def test_verdicts():
    h = np.array(SIX)
    assert verdict(h**2.19) == "as declared"
    assert verdict(h**1.81) == "as declared"
    assert verdict(h**1.79) == verdict(h**2.21) == "off"
    assert verdict(h**2.21, limited_by=IMPACT) == "as declared"
    assert verdict(h**1.64, limited_by=IMPACT) == "off"
    noisy = h**1.6 * np.array([1.0, 1.4, 1.0, 1.0, 1.4, 1.0])
    assert verdict(noisy, limited_by=IMPACT) == "too few steps to tell"
    assert verdict(noisy) == "off"
    assert verdict(h[:5] ** 2, limited_by=IMPACT) == "too few steps to tell"
    assert verdict(h[:5] ** 2) == "as declared"
    assert verdict(h**3.0, declared=math.nan) == ""
    assert verdict(np.full(6, 1.9e-12)) == "rounding"
    assert verdict(np.full(6, np.nan), failure="broken") == "failed"
    assert verdict(np.full(6, 1e-10), declared=math.inf) == "as declared"
    assert verdict(np.full(6, 1e-8), declared=math.inf) == "off"
    assert verdict(np.full(6, 1e-8), declared=math.inf, rtol=1e-10) == "as declared"
    assert verdict(np.full(6, 1e-8), declared=math.inf, reference="moreau-jean (1000003 steps)") == "as declared"


def test_an_order_is_stated_with_its_standard_error_which_two_points_do_not_tell():
    errors = np.array([1.0, 0.5, 0.1])
    error = linregress(np.log10([3.0 / count for count in (101, 163, 257)]), np.log10(errors)).stderr
    assert f" ± {error:.2f} " in made(errors).summary()
    two = made(errors[:2]).summary()
    assert "±" not in two
    assert " by two points" in two


def test_errors_that_are_rounding_are_left_out_and_counted():
    errors = 0.1 * np.array(SIX) ** 4
    errors[4:] = 1e-13
    row = observed_orders(made(errors, declared=4.0)).iloc[0]
    assert (row["points"], row["rounding"], row["failed"]) == (4, 2, 0)
    assert row["order"] == pytest.approx(4.0, abs=1e-9)
    row = observed_orders(made(errors, declared=4.0, reference="event-driven (rtol=1e-12)")).iloc[0]
    assert row["points"] == 2, "what that reference may be off by is more"


@pytest.mark.slow
def test_orders_of_runs():
    table = convergence(li.load_problem("system-1"), ["moreau-jean", "heun", "radau-fesd", "exact"], SIX)
    orders = observed_orders(table)
    here = orders[orders["norm"] == "sup_q"].set_index("method")
    assert list(here["verdict"]) == ["as declared"] * 4
    assert_allclose(here["order"], [2.0, 2.0, 5.0, math.nan], atol=0.35)
    assert set(orders.loc[orders["norm"] != "sup_q", "verdict"]) == {""}
    with pytest.raises(li.InputError, match="norm = 'sup_v' is not in the table; it has sup_q"):
        observed_orders(table, "sup_v")
    latex = here.reset_index().to_latex(index=False, escape=True)
    assert all(rule in latex for rule in (r"\toprule", r"\midrule", r"\bottomrule", r"sup\_q"))


# ---- costs ----------------------------------------------------------------------------------------------------------


def test_costs_are_counted():
    table = convergence(
        li.load_problem("system-1"),
        {
            "θ": "moreau-jean",
            "rk4": "rk4",
            "paper": "rk4-paper",
            "halved": MoreauJean(rtol=1e-5),
            "dopri5": DormandPrince(rtol=1e-6),
            "fesd": "radau-fesd",
            "events": EventDriven(rtol=1e-6),
            "exact": "exact",
        },
        [0.1],
        norms=["sup_q"],
    )
    rows = {row.method: row for row in table.itertuples()}
    assert (rows["θ"].steps, rows["θ"].lcp_solves, rows["θ"].evaluations) == (31, 31, 31)
    assert (rows["rk4"].lcp_solves, rows["rk4"].evaluations) == (124, 124)
    assert (rows["paper"].lcp_solves, rows["paper"].evaluations) == (0, 155)
    assert rows["halved"].steps > 62
    assert rows["halved"].evaluations > 1.5 * rows["halved"].steps, "steps that were tried count too"
    assert rows["dopri5"].steps > 31
    assert rows["dopri5"].evaluations >= 6 * rows["dopri5"].steps
    assert rows["fesd"].evaluations >= rows["fesd"].steps >= 31
    assert rows["events"].evaluations > rows["events"].steps > 0
    assert rows["exact"].evaluations == 0
    assert list(table["rtol"].dropna()) == [1e-5, 1e-6, 1e-6]
    assert (table["closings"] == table["closings"].iloc[0]).all()
    assert (table["seconds"] > 0.0).all()


def test_tolerances_are_swept_where_a_method_has_them():
    table = work_precision(
        oscillator(),
        {
            "fixed": "rk4",
            "halved": MoreauJean(rtol=1e-3),
            "events": EventDriven(rtol=1e-3, atol=1e-5),
            "exact": "exact",
        },
        [0.3, 0.1],
        rtols=[1e-3, 1e-5],
        norms=["sup_q"],
        repeats=1,
    )
    assert [
        (row.method, row.rtol if row.rtol == row.rtol else None, round(3.0 / row.dt)) for row in table.itertuples()
    ] == [
        ("fixed", None, 11),
        ("fixed", None, 31),
        ("halved", 1e-3, 11),
        ("halved", 1e-5, 11),
        ("events", 1e-3, 11),
        ("events", 1e-5, 11),
        ("exact", None, 11),
    ]
    errors = {(row.method, row.rtol): row.sup_q for row in table.itertuples()}
    assert errors[("halved", 1e-5)] < 0.1 * errors[("halved", 1e-3)]
    # atol follows rtol: were it still 1e-5, the tight run would be far from this.
    tight = li.simulate(oscillator(), EventDriven(rtol=1e-5, atol=1e-7), dt=3.0 / 11, t_end=3.0)
    assert table["evaluations"].iloc[5] == tight.stats.evaluations


def test_methods_take_turns_and_the_least_time_is_kept(monkeypatch):
    import lcpimpact.sweeps.job as module

    seen, told = [], []
    clock = iter([5.0, 7.0, 3.0, 8.0])
    simulate = module.simulate

    def slow(problem, method, **options):
        run = simulate(problem, method, **options)
        if len(run.t) == 2:
            return run  # what compiles
        seen.append(method.name)
        run.stats.seconds = next(clock)
        return run

    def watch(items, total, what):
        told.append((total, what))
        return items

    monkeypatch.setattr(module, "simulate", slow)
    table = work_precision(oscillator(), ["rk4", "heun"], [0.3], norms=["sup_q"], repeats=2, progress=watch)
    assert seen == ["rk4", "heun", "rk4", "heun"]
    assert list(table["seconds"]) == [3.0, 7.0]
    assert told == [(4, "runs")]


def test_a_compliant_run_ends_at_the_error_of_its_model():
    ball = li.load_problem("bouncing-ball", e=0.8)
    table = work_precision(
        ball, ["event-driven"], [0.01], rtols=[1e-5, 1e-9], penalties=[("kelvin-voigt", 1e6)], norms=["l1_v"], t_end=1.0,
        repeats=1,
    )  # fmt: skip
    rigid, soft = table[table["law"] == "rigid"]["l1_v"], table[table["law"] == "kelvin-voigt"]["l1_v"]
    assert rigid.max() < 1e-10
    assert_allclose(soft.iloc[0], soft.iloc[1], rtol=0.05)
    assert soft.min() > 1e-2


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("moreau-jean", [0.1]), r"methods = 'moreau-jean' must be a sequence: write \['moreau-jean'\]"),
        (([], [0.1]), r"methods is empty"),
        ((["rk4", "rk4"], [0.1]), r"methods: 'rk4' is listed twice"),
        ((["rk5"], [0.1]), r"unknown method 'rk5': did you mean 'rk4'"),
        ((["rk4"], []), r"dts is empty"),
        ((["rk4"], [0.1, -0.1]), r"dts = -0.1 must be a positive finite number"),
        ((["rk4"], [1e-12]), r"more than 1e9 steps"),
    ],
)
def test_wrong_input_is_named(arguments, says):
    with pytest.raises(li.InputError, match=says):
        convergence(oscillator(), *arguments)


def test_more_wrong_input_is_named():
    with pytest.raises(li.InputError, match="unknown norm 'sup'"):
        convergence(oscillator(), ["rk4"], [0.1], norms=["sup"])
    with pytest.raises(li.InputError, match=r"t_end = 0.0 must be"):
        convergence(oscillator(), ["rk4"], [0.1], t_end=0.0)
    with pytest.raises(li.InputError, match=r"repeats = 0 must be"):
        convergence(oscillator(), ["rk4"], [0.1], repeats=0)
    with pytest.raises(li.InputError, match=r"rtols = 0.0 must be"):
        work_precision(oscillator(), ["rk4"], [0.1], rtols=[0.0])
    with pytest.raises(li.InputError, match="must be a Problem: get one from"):
        convergence("system-1", ["rk4"], [0.1])


def test_labels():
    assert list(labelled({"a": "rk4", "b": MoreauJean(theta=1.0)})) == ["a", "b"]
    assert list(labelled([MoreauJean(theta=1.0, tol=1e-9), "rk4"])) == ["moreau-jean(tol=1e-09, theta=1.0)", "rk4"]


# ---- pictures -------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def table():
    methods = ["moreau-jean", "heun", "radau-fesd", "exact", "schatzman-paoli"]
    return convergence(li.load_problem("system-1"), methods, SIX, norms=["sup_q", "l1_v"])


def test_a_picture_shows_the_errors_and_the_orders(table, tmp_path):
    figure = table.plot(tmp_path / "orders.svg")
    assert (tmp_path / "orders.svg").stat().st_size > 1000
    (ax,) = figure.axes
    lines = {line.get_label().split(":")[0]: line for line in ax.get_lines()}
    for method in ("moreau-jean", "heun", "radau-fesd"):
        rows = table[table["method"] == method]
        assert_allclose(lines[method].get_xdata(), rows["dt"])
        assert_allclose(lines[method].get_ydata(), rows["sup_q"])
    assert len(lines["exact"].get_xdata()) == 0, "rounding would stretch the axis"
    assert lines["exact"].get_label().endswith("rounding")
    assert lines["schatzman-paoli"].get_label().endswith("no result")
    order = observed_orders(table, "sup_q").set_index("method").loc["heun"]
    assert f"{order['order']:.2f} ± {order['standard_error']:.2f}" in lines["heun"].get_label()


def test_triangles_have_the_slopes_that_are_seen_and_lie_clear_of_the_lines(table):
    (ax,) = table.plot().axes
    corners = [np.log10(patch.get_xy()[:3]) for patch in ax.patches if isinstance(patch, Polygon)]
    slopes = sorted((xy[2, 1] - xy[0, 1]) / (xy[1, 0] - xy[0, 0]) for xy in corners)
    assert_allclose(slopes, [2.0, 5.0], rtol=1e-9)
    for line in ax.get_lines():
        x, y = np.log10(np.asarray(line.get_data(), dtype=float))
        if len(x) == 0:
            continue
        for xy in corners:
            inside = np.linspace(xy[0, 0], xy[1, 0], 50)
            known = inside[(inside >= x.min()) & (inside <= x.max())]
            curve = np.interp(known, x[::-1], y[::-1])
            hypotenuse = np.interp(known, xy[[0, 2], 0], xy[[0, 2], 1])
            assert ((curve > hypotenuse) | (curve < xy[0, 1])).all()


def test_costs_are_drawn_and_what_has_none_is_said(table):
    costs = WorkPrecision(**{each.name: getattr(table, each.name) for each in fields(table)})
    (ax,) = costs.plot(cost="evaluations").axes
    labels = [line.get_label() for line in ax.get_lines()]
    none = "exact: no evaluations of the right-hand side"
    assert labels == ["moreau-jean", "heun", "radau-fesd", none, "schatzman-paoli: no result"]
    assert [line.get_marker() for line in ax.get_lines()[3:]] == ["", ""]
    rows = table[table["method"] == "heun"]
    assert_allclose(ax.get_lines()[1].get_xdata(), rows["evaluations"].astype(float))
    assert_allclose(ax.get_lines()[1].get_ydata(), rows["sup_q"])
    for cost in COSTS:
        assert costs.plot(norm="l1_v", cost=cost).axes[0].get_xlabel()
    with pytest.raises(li.InputError, match="unknown cost 'second': did you mean 'seconds'"):
        costs.plot(cost="second")
    with pytest.raises(li.InputError, match="unknown norm of this table 'l2_v'"):
        table.plot(norm="l2_v")
    with pytest.raises(li.InputError, match="must end in one of"):
        table.plot("orders.txt")


def test_a_run_that_fails_is_marked():
    table = made(np.array(SIX) ** 2)
    table.table.loc[0, ["sup_q", "failure"]] = (math.nan, "broken")
    (ax,) = table.plot().axes
    marks = [line for line in ax.get_lines() if line.get_marker() == "x"]
    assert [list(line.get_xdata()) for line in marks] == [[SIX[0]]]


# ---- the command line -----------------------------------------------------------------------------------------------


def test_converge_says_writes_and_draws(capsys, tmp_path):
    out, orders, plot, report = (tmp_path / name for name in ("runs.csv", "orders.tex", "orders.svg", "report.html"))
    code, said, _ = call(
        capsys, "converge", "system-1", "--set", "c_o=300", "--methods", "moreau-jean,moreau-jean:theta=1,schatzman-paoli",
        "--counts", "101,163,257,409,653,1049", "--check", "--out", out, "--orders", orders, "--plot", plot,
        "--report", report,
    )  # fmt: skip
    assert code == 0
    assert re.search(r"moreau-jean +order [12]\.\d+ ± \d\.\d+  declared 2  as declared", said)
    assert "6 without a result: schatzman-paoli does not handle relative degree 1" in said
    table = pd.read_csv(out)
    assert list(table["method"].unique()) == ["moreau-jean", "moreau-jean:theta=1", "schatzman-paoli"]
    expected = convergence(li.load_problem("system-1", c_o=300.0), ["moreau-jean"], SIX)
    assert_allclose(table["l1_v"][:6], expected["l1_v"], rtol=1e-12)
    assert r"\toprule" in orders.read_text(encoding="utf-8")
    assert "<svg" in plot.read_text(encoding="utf-8")
    html = report.read_text(encoding="utf-8")
    assert "Observed orders" in html
    assert "does not handle relative degree 1" in html


def test_check_makes_an_order_that_is_off_an_exit_code(capsys):
    """A hundred steps a period and fewer: not yet the order that the explicit method declares."""
    told = ("converge", "system-3", "--methods", "heun", "--counts", "5,7,11,13,17,23,29,37")
    code, said, _ = call(capsys, *told, "--check")
    assert "off" in said
    assert code == 1
    assert call(capsys, *told)[0] == 0


def test_work_precision_says_and_writes(capsys, tmp_path):
    out, plot, report = (tmp_path / name for name in ("runs.tex", "cost.pdf", "report.html"))
    code, said, _ = call(
        capsys, "work-precision", "bouncing-ball", "--set", "e=0.8", "--t-end", "1", "--methods", "moreau-jean,event-driven",
        "--dts", "0.05,0.02", "--rtols", "1e-4", "--repeats", "1", "--penalty", "kelvin-voigt:1e5:e=0.5", "--norm", "l1_v",
        "--cost", "evaluations", "--out", out, "--plot", plot, "--report", report,
    )  # fmt: skip
    assert code == 0
    assert "l1_v: integral of the error of the velocities, m" in said
    assert said.count("kelvin-voigt") >= 3
    assert r"\bottomrule" in out.read_text(encoding="utf-8")
    assert plot.read_bytes().startswith(b"%PDF")
    assert "Error over right sides" in report.read_text(encoding="utf-8") or report.stat().st_size > 10_000


@pytest.mark.parametrize(
    ("told", "says"),
    [
        (("--dts", "0.1,b"), "must be numbers separated by commas"),
        (("--dts", "0.1", "--counts", "3"), "give only one of them"),
        (("--counts", "0"), "must be step counts of at least 1"),
        (("--methods", "rk5"), "unknown method 'rk5'"),
        (("--methods", "rk4:theta=1"), "theta"),
        (("--methods", ","), "names no method"),
        (("--penalty", "hertz"), "must read LAW:K"),
        (("--norm", "sup", "--counts", "11", "--methods", "heun"), "unknown norm 'sup'"),
        (("--orders", "x.txt"), "must end in one of .csv, .tex"),
        (("--report", "x.pdf"), "must end in one of .html"),
    ],
)
def test_wrong_words_are_one_line_and_nothing_is_written(capsys, tmp_path, monkeypatch, told, says):
    monkeypatch.chdir(tmp_path)
    code, _, said = call(capsys, "converge", "system-1", "--out", "runs.csv", *told)
    assert code == 2
    assert says in said
    assert len([line for line in said.splitlines() if line.startswith("lcpimpact:")]) == 1
    assert list(tmp_path.iterdir()) == []


# ---- pages and the public table -------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def public():
    spec = importlib.util.spec_from_file_location("public_table", ROOT / "benchmarks" / "table.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_page_is_that_of_the_csv(public):
    text = public.CSV.read_text(encoding="utf-8")
    assert public.PAGE.read_text(encoding="utf-8") == public.page(text), "run: python benchmarks/table.py"


def test_the_table_has_every_method_and_no_order_is_off(public):
    from lcpimpact.integrators import METHODS

    table = pd.read_csv(public.CSV, skiprows=1, keep_default_na=False)
    assert set(table["method"]) == set(METHODS)
    assert set(table["problem"]) == set(public.PROBLEMS)
    assert len(table) == len(METHODS) * len(public.PROBLEMS) * len(public.NORMS)
    assert list(table.loc[table["verdict"] == "off", ["method", "problem"]].itertuples(index=False, name=None)) == []
    seen = table.loc[table["verdict"] == "as declared", "method"]
    assert set(seen) == set(METHODS), "each method is seen to do what it declares"


def test_costs_and_errors_are_read_between_neighbours(public):
    """Points on error = 1000/cost²: the logarithms interpolate it exactly, and the envelope passes over a bad run."""
    cost = np.array([100.0, 1000.0, 2000.0, 10_000.0])
    costs = pd.DataFrame({"evaluations": cost, "seconds": cost / 1e6, "sup_q": 1e3 / cost**2, "failure": ""})
    costs.loc[2, "sup_q"] = 1.0
    row = public._read(costs, "sup_q", 0.2)
    ((x_0, x_1), (y_0, y_1)) = np.log(cost[[2, 3]]), np.log([1e-3, 1e-5])
    at = np.log(public.RIGHT_SIDES)
    assert row["error_at_evaluations"] == pytest.approx(
        math.exp(y_0 + (at - x_0) / (x_1 - x_0) * (y_1 - y_0)), rel=1e-9
    )
    assert row["error_at_seconds"] == pytest.approx(1e-5), "no more than the finest run that was taken"
    share = (math.log(2e-4) - y_0) / (y_1 - y_0)
    assert row["evaluations_at_error"] == pytest.approx(math.exp(x_0 + share * (x_1 - x_0)), rel=1e-9)
    assert math.isnan(public._read(costs, "sup_q", 1e-6)["evaluations_at_error"]), "never reached"


@pytest.mark.slow
def test_the_table_is_measured(public):
    found = public.judged("system-2", "heun").set_index("norm")
    assert found.loc["sup_q", "verdict"] == "as declared"
    assert found.loc["sup_q", "evaluations_at_error"] > 0.0
    refused = public.judged("system-2", "newmark-ns")
    assert set(refused["verdict"]) == {"failed"}
    assert refused["failure"].str.contains("does not handle").all()


@pytest.mark.parametrize("t_end", [1.3, 1.5])
def test_four_steps_do_not_tell_the_order_across_impacts(t_end):
    """The slopes are 1.26 and 0.25, with a small scatter each; the phase of an impact in its step is no noise of steps."""
    ball = li.load_problem("bouncing-ball", e=0.7)
    study = convergence(ball, ["moreau-jean"], [1e-2 / 2**i for i in range(4)], t_end=t_end, progress=False)
    assert "too few steps to tell" in study.summary()
    assert "raised to a prime" in study.summary()


def test_an_error_beyond_the_axis_is_marked_at_its_edge():
    ax = Figure().add_subplot()
    ax.plot([10.0, 100.0, 1000.0], [1e6, 1e-1, 1e-3], color="red")
    ax.set(xscale="log", yscale="log")
    _limit_errors(ax, 1.0, [])
    curve, beyond = ax.get_lines()
    assert (beyond.get_marker(), beyond.get_color()) == ("^", curve.get_color())
    assert beyond.get_xydata().tolist() == [[10.0, ax.get_ylim()[1]]]
    assert ax.get_ylim()[1] < 1e6
