"""The declared order of every registered method is measured: in smooth motion, across switches, and across impacts."""

import importlib.util
import math
from pathlib import Path

import numpy as np
import pytest

import lcpimpact as li
from lcpimpact.errors import InputError
from lcpimpact.integrators import METHODS
from lcpimpact.integrators.stepping.time_stepping import TimeStepping
from lcpimpact.simulation import simulate
from lcpimpact.study.accuracy.fitted_order import EVENT_BAND, SMOOTH_BAND
from lcpimpact.study.accuracy.norms import l1_v, sup_q
from lcpimpact.study.accuracy.orders import COARSER_COUNTS, COUNTS, RoundingError, observed_order

MANY = (*COUNTS, 4903, 7789, 12373, 19661, 31223, 49597)
"""Where errors scatter, because a switch falls now early and now late into its step."""

TIGHT = {"event-driven": {"rtol": 1e-12, "atol": 1e-12}}
"""Options of methods whose order is that of a tolerance."""

TO_ROUNDING = 1e-9
"""What "to rounding" may leave, relative to the largest value, of methods whose own tolerance is as tight."""


def chain():
    """Two masses, three springs, two dashpots and a shaker: smooth for ever."""
    scheme = li.Scheme(
        li.Mass("a", 1.0), li.Mass("b", 2.0), li.Spring("a", "ground", 40.0), li.Spring("a", "b", 60.0),
        li.Dashpot("a", "b", 0.3), li.Dashpot("b", "ground", 0.2), li.Load("b", li.Harmonic(5.0, 3.0)),
    )  # fmt: skip
    return li.Problem("chain", scheme, q0={"a": 0.2}, v0={"b": 1.0}, t_end=3.0)


def lumped_bar(n=4):
    """A bar of lumped masses that falls on the ground: the first mass stops there at each arrival of a wave."""
    elements = []
    for i in range(n):
        elements += [li.Mass(f"b{i}", 1.0 / n), li.Load(f"b{i}", 10.0 / n)]
        if i:
            elements.append(li.Spring(f"b{i - 1}", f"b{i}", 9.0 * n))
    scheme = li.Scheme(*elements, li.Bumper(f"b{n - 1}", "ground", gap=0.5, e=0.0))
    return li.Problem("lumped bar", scheme, t_end=1.1)


def before(name, t_end, **parameters):
    problem = li.load_problem(name, **parameters)
    return li.Problem(problem.name, problem.scheme, problem.q0, problem.v0, t_end, problem.parameters)


SMOOTH = {
    "chain": chain(),
    "system-1 in contact": before("system-1", 0.5),
    "system-3 in contact": before("system-3", 1.0),
}
FORCE_JUMPS = {
    "system-1": before("system-1", 3.0),
    "system-3": before("system-3", 3.0),
    "system-3, c=60": before("system-3", 3.0, c=60.0),
}
FORCE_KINKS = {"system-2": before("system-2", 3.0), "bouncing-bar": before("bouncing-bar", 2.0, elements=6.0)}
IMPACTS = {
    "bouncing-ball": before("bouncing-ball", 2.5),
    "impact-oscillator": before("impact-oscillator", 10.0),
    "two-balls-spring": before("two-balls-spring", 0.5),
    "lumped bar": lumped_bar(),
}


def order_as_declared(problem, name, declared, norm, low):
    """Observe an order with step counts that suit it; None where a method is exact but for rounding with any of them."""
    for counts in [low] if declared <= 2.0 else COARSER_COUNTS:
        try:
            return observed_order(problem, name, counts, norm=norm)
        except RoundingError:
            if declared <= 2.0:
                raise
    return None


def measure(name, problem, order, norm, tolerance, low=COUNTS):
    """Compare a declared order with the one that is observed; skip what the method refuses."""
    try:
        simulate(problem, name, dt=problem.t_end / 1000, t_end=problem.t_end / 1000, progress=False)
    except li.UnsupportedError as refusal:
        pytest.skip(str(refusal))
    assert order > 0, "what is refused is declared as 0, and what is not is declared"
    if math.isinf(order):
        run = simulate(problem, name, dt=problem.t_end / 307, t_end=problem.t_end, **TIGHT.get(name, {}))
        truth = simulate(problem, "exact", dt=problem.t_end / 307, t_end=problem.t_end)
        assert sup_q(run, truth) < TO_ROUNDING * max(1.0, np.abs(truth.q).max())
        return
    found = order_as_declared(problem, name, order, norm, low)
    if found is None:
        return  # exact with a handful of steps: a parabola, for one
    said = f"{name} on {problem.name}: declared {order}, seen {found.slope:.2f}, scatter {found.scatter:.2f}, {found.errors}"
    assert abs(found.slope - order) < tolerance, said


@pytest.mark.parametrize("problem", SMOOTH)
@pytest.mark.parametrize("name", METHODS)
def test_order_in_smooth_motion(name, problem):
    measure(name, SMOOTH[problem], METHODS[name].declared.order_smooth, "sup_q", SMOOTH_BAND)


@pytest.mark.parametrize("problem", FORCE_JUMPS)
@pytest.mark.parametrize("name", METHODS)
def test_order_where_forces_jump(name, problem):
    measure(name, FORCE_JUMPS[problem], METHODS[name].declared.order_force_jump, "sup_q", EVENT_BAND, MANY[:10])


@pytest.mark.parametrize("problem", FORCE_KINKS)
@pytest.mark.parametrize("name", METHODS)
def test_order_where_forces_bend(name, problem):
    measure(name, FORCE_KINKS[problem], METHODS[name].declared.order_force_kink, "sup_q", EVENT_BAND, MANY[:9])


@pytest.mark.parametrize("problem", IMPACTS)
@pytest.mark.parametrize("name", METHODS)
def test_order_across_impacts(name, problem):
    measure(name, IMPACTS[problem], METHODS[name].declared.order_impact, "l1_v", EVENT_BAND)


CHAINS = {"one body": 14, "two bodies": 1, "three bodies": 10}
"""Seeds of benchmarks/orders.py; in the last two impacts accumulate."""

STEPS = tuple(int(n) for n in np.geomspace(211, 6_000, 10))

TIME_STEPS = [name for name, kind in METHODS.items() if issubclass(kind, TimeStepping)]


@pytest.fixture(scope="module")
def chains():
    path = Path(__file__).parents[2] / "benchmarks" / "orders.py"
    spec = importlib.util.spec_from_file_location("orders_benchmark", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return {name: module.chain(seed) for name, seed in CHAINS.items()}


@pytest.mark.slow
@pytest.mark.parametrize("name", TIME_STEPS)
def test_order_across_many_impacts_of_random_chains(name, chains):
    """The median is as declared; the slope of one chain is not, since its errors scatter by where in a step impacts fall."""
    found = []
    for problem in chains.values():
        truth = simulate(problem, "exact", dt=problem.t_end / 200, t_end=problem.t_end)
        other = simulate(problem, "event-driven", dt=problem.t_end / 200, t_end=problem.t_end, **TIGHT["event-driven"])
        assert np.abs(truth.q - other.q).max() < 1e-8 * np.abs(truth.q).max(), "the truth is that of both"
        found.append(observed_order(problem, name, STEPS, norm="l1_v", reference=truth))
    assert abs(np.median([each.slope for each in found]) - METHODS[name].declared.order_impact) < 0.2
    assert all(abs(each.slope - 1.0) < EVENT_BAND for each in found)
    assert all(each.scatter < 0.3 for each in found)


@pytest.mark.parametrize("name", METHODS)
def test_order_where_a_slider_turns_and_stops(name):
    problem = before("coulomb-oscillator", 2.0)
    measure(name, problem, METHODS[name].declared.order_friction, "sup_q", EVENT_BAND, MANY[:9])


@pytest.mark.parametrize("name", METHODS)
def test_overlap_is_as_declared(name):
    """None beyond rounding, or no more than an impact can go in one step."""
    problem = IMPACTS["bouncing-ball"]
    for steps in (307, 773, 1951):
        h = problem.t_end / steps
        try:
            run = simulate(problem, name, dt=h, t_end=problem.t_end)
        except li.UnsupportedError as refusal:
            pytest.skip(str(refusal))
        fastest = math.sqrt(2.0 * 9.81 * 1.0)
        order = METHODS[name].declared.order_penetration
        assert run.certificate.penetration <= (1e-12 if math.isinf(order) else (h * fastest) ** order)


@pytest.mark.parametrize("name", METHODS)
def test_the_balance_of_energy_is_kept_between_impacts(name):
    """A flight under constant load is balanced to rounding, and what an impact takes is no imbalance.

    A method that corrects positions lifts the ball against its weight by what it corrects.
    """
    problem = IMPACTS["bouncing-ball"]
    try:
        run = simulate(problem, name, dt=problem.t_end / 2500, t_end=problem.t_end)
    except li.UnsupportedError as refusal:
        pytest.skip(str(refusal))
    assert len([event for event in run.events if event.kind == "impact"]) == 4
    # A velocity that is recorded without half a kick makes an impact work more or less by as much.
    h, g, fastest = problem.t_end / 2500, 9.81, math.sqrt(2.0 * 9.81)
    lacking = 4 * METHODS[name].declared.kick * h * g * fastest
    if run.dense is None:
        mean = np.diff(run.t) * 0.5 * (run.v[1:, 0] + run.v[:-1, 0])
        lifted = np.abs(np.diff(run.q[:, 0]) - mean)
        lacking += g * lifted[lifted > 1e-2 * h * h * g].sum()
        assert np.count_nonzero(lifted > 1e-2 * h * h * g) <= 8
    assert run.certificate.energy_balance < 1e-11 * run.certificate.energy_scale + lacking


# ---- the measuring itself -------------------------------------------------------------------------------------------


def test_norms_are_zero_for_the_truth_and_known_for_a_shift():
    problem = IMPACTS["bouncing-ball"]
    truth = simulate(problem, "exact", dt=2.5 / 307, t_end=2.5)
    assert sup_q(truth, truth) == 0.0
    assert l1_v(truth, truth) == 0.0
    # A ball dropped 1 mm higher: the first impact comes later by δt, and v differs by (1 + e) v_1 in between.
    higher = simulate(before("bouncing-ball", 0.9, H=1.001), "exact", dt=0.9 / 307, t_end=0.9)
    t_1, t_2 = (math.sqrt(2.0 * H / 9.81) for H in (1.0, 1.001))
    v = 9.81 * t_1
    expected = 1.8 * v * (t_2 - t_1) + 1.8 * 9.81 * (t_2 - t_1) * (0.9 - t_2)
    assert l1_v(higher, truth) == pytest.approx(expected, rel=1e-6)


def test_rounding_tells_no_order():
    with pytest.raises(InputError, match="rounding"):
        observed_order(SMOOTH["chain"], "exact", (101, 211))
    with pytest.raises(InputError, match="norm"):
        observed_order(SMOOTH["chain"], "moreau-jean", (101, 211), norm="sup v")
    with pytest.raises(InputError, match="counts"):
        observed_order(SMOOTH["chain"], "moreau-jean", (101,))
