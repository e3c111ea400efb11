"""Derivatives of peaks and of quantities of whole runs: closed forms by hand, ties, and differences of exact runs."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

import lcpimpact as li
from lcpimpact import Bumper, Dashpot, Harmonic, KelvinVoigt, Load, Mass, Problem, Scheme, Spring
from lcpimpact.problems.parameters import value_at, with_values
from lcpimpact.quantities import SUMMARY, quantity
from lcpimpact.study.sensitivity import ONE_SIDED

OUTPUTS = [name for name in SUMMARY if name not in ("impacts", "peak_time")]
"""Quantities of whole runs that are measured to rounding."""


def slopes(problem, wrt, outputs, **options):
    """The derivatives, outputs by parameters."""
    return li.sensitivity(problem, wrt, outputs, **options).table[list(wrt)].to_numpy()


def test_quantities_of_a_ball_that_strikes_twice():
    g, H, e, m = 9.81, 1.0, 0.8, 2.0
    v = math.sqrt(2.0 * g * H)
    problem = li.load_problem("bouncing-ball", e=e, m=m)
    outputs = ["contact_time", "restitution", "rebound_speed", "impulse", "dissipated"]
    found = slopes(problem, ["H", "e", "m"], outputs, t_end=1.2)
    # m v (1 + e) (1 + e) of impulse, and 1 - e⁴ of the energy m g H.
    by_hand = [
        [0.0, 0.0, 0.0],
        [0.0, 1.0, 0.0],
        [e * 0.5 * v / H, v, 0.0],
        [m * (1.0 + e) ** 2 * 0.5 * v / H, 2.0 * m * v * (1.0 + e), v * (1.0 + e) ** 2],
        [m * g * (1.0 - e**4), -4.0 * m * g * H * e**3, g * H * (1.0 - e**4)],
    ]
    assert_allclose(found, by_hand, rtol=1e-11, atol=1e-12)


def test_quantities_of_a_mass_that_meets_a_spring():
    m, k, gap, v = 2.0, 300.0, 0.1, 1.5
    scheme = Scheme(Mass("x", m=m), Bumper("x", "y", gap=gap, name="R"), Spring("y", "ground", k=k))
    problem = Problem("buffer", scheme, v0={"x": v})
    wrt = ["Spring.k", "Mass.m", "R.gap", "v0.x"]
    outputs = [
        "peak_force",
        "R.max",
        "peak_time",
        "contact_time",
        "restitution",
        "impulse",
        "dissipated",
        "deformation",
    ]
    found = slopes(problem, wrt, outputs, t_end=1.0)
    F, T, depth = v * math.sqrt(k * m), math.pi * math.sqrt(m / k), v * math.sqrt(m / k)
    by_F = [0.5 * F / k, 0.5 * F / m, 0.0, F / v]
    by_T = [-0.5 * T / k, 0.5 * T / m, 0.0, 0.0]
    by_peak_time = [0.5 * by_T[0], 0.5 * by_T[1], 1.0 / v, -gap / v**2]
    by_depth = [-0.5 * depth / k, 0.5 * depth / m, 0.0, depth / v]
    by_hand = [by_F, by_F, by_peak_time, by_T, [0.0] * 4, [0.0, 2.0 * v, 0.0, 2.0 * m], [0.0] * 4, by_depth]
    assert_allclose(found, by_hand, rtol=1e-11, atol=1e-11)


@pytest.mark.parametrize("name", ["system-1", "system-2", "system-3"])
def test_quantities_against_differences_of_exact_runs(name):
    problem, t_end, wrt = li.load_problem(name), 3.0, ["c_o", "k_o", "m", "h_o"]

    def at(values):
        other = with_values(problem, values)
        run = li.simulate(other, "exact", dt=t_end / 200, t_end=t_end, error=False)
        return np.array([float(quantity(each, other).measure(run)) for each in OUTPUTS])

    found = slopes(problem, wrt, OUTPUTS, t_end=t_end)
    for j, name in enumerate(wrt):
        p, by_differences = value_at(problem, name), []
        for h in (2e-4 * p, 1e-4 * p):
            by_differences.append((at({name: p + h}) - at({name: p - h})) / (2.0 * h))
        coarse, fine = by_differences
        assert_allclose(found[:, j], fine + (fine - coarse) / 3.0, rtol=2e-8, atol=1e-11)


def test_equal_peaks_with_different_derivatives_are_refused():
    """A ball that loses nothing comes back to x = 0, and with e < 1 to H (1 - e²)."""
    ball = li.load_problem("bouncing-ball", e=1.0)
    with pytest.raises(li.UnsupportedError, match=r"x.min is reached at t = 0 s and at 0.903047 s alike"):
        slopes(ball, ["e"], ["x.min"], t_end=1.0)
    assert_allclose(slopes(ball, ["e"], ["x.min"], t_end=0.8), [[0.0]], rtol=0, atol=1e-14)
    # By the other parameters both have one derivative; and so have all peaks of a vibration.
    assert_allclose(slopes(ball, ["g", "H"], ["x.min"], t_end=1.0), [[0.0, 0.0]], rtol=0, atol=1e-12)
    m, k, v0 = 1.0, 9.0, 2.0
    free = Problem("free", Scheme(Mass("x", m=m), Spring("x", "ground", k=k)), v0={"x": v0})
    by_hand = [[-0.5 * v0 / (3.0 * k), 0.5 * v0 / (3.0 * m), 1.0 / 3.0]]
    assert_allclose(slopes(free, ["Spring.k", "Mass.m", "v0.x"], ["x.max"], t_end=9.0), by_hand, rtol=1e-11)


def test_a_plateau_has_a_derivative_where_it_moves_as_one():
    ball = Scheme(Mass("x", m=2.0), Load("x", f=9.81), Bumper("x", "ground", gap=1.0, e=0.0, name="R"))
    rest = Problem("plastic", ball)
    # x is at the stop and R = f from the impact on.
    found = slopes(rest, ["R.gap", "Load.f", "Mass.m"], ["x.max", "R.max", "peak_force", "R.min"], t_end=1.0)
    assert_allclose(found, [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 0.0]], rtol=0, atol=1e-12)
    lying = Problem("lying", Scheme(Mass("x", m=1.0)), q0={"x": 0.5})
    assert_allclose(slopes(lying, ["q0.x"], ["x.max"], t_end=1.0), [[1.0]], rtol=1e-14)
    with pytest.raises(li.UnsupportedError, match=r"x.max is reached at t = 0 s and at 1 s alike"):
        slopes(lying, ["v0.x"], ["x.max"], t_end=1.0)


def test_a_peak_at_the_end_or_the_start_of_the_run():
    a, ω, v0, m, t_end = 2.0, 3.0, 0.7, 2.0, 0.4
    problem = Problem("driven", Scheme(Mass("x", m=m), Load("x", f=Harmonic(a, ω))), q0={"x": 0.1}, v0={"x": v0})
    found = slopes(problem, ["Load.f.amplitude", "v0.x", "q0.x"], ["x.max", "x.min", "v_x.max"], t_end=t_end)
    by_a, by_v = (1.0 - math.cos(ω * t_end)) / (m * ω**2), math.sin(ω * t_end) / (m * ω)
    assert_allclose(found, [[by_a, t_end, 1.0], [0.0, 0.0, 1.0], [by_v, 1.0, 0.0]], rtol=1e-11, atol=1e-14)


@pytest.mark.parametrize(
    ("output", "reason"),
    [
        ("impacts", "is a number of events"),
        ("restitution", "not in the run up to 0.3 s"),
        ("contact_time", "not in the run"),
        ("deformation", "not in the run"),
    ],
)
def test_quantities_that_a_run_does_not_have(output, reason):
    with pytest.raises(li.InputError, match=reason):
        slopes(li.load_problem("bouncing-ball"), ["g"], [output], t_end=0.3)


# ---- near a grazing ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("beyond", [1e-2, 1e-5, 1e-8, 1e-11, 1e-13])
def test_the_derivative_grows_as_the_inverse_square_root_towards_a_grazing(beyond):
    """x = (v0/ω) sin ω t meets a stop at d with v² = v0² - (ω d)²."""
    ω, d, e = 2.0, 0.5, 0.5
    v0 = ω * d * (1.0 + beyond)
    scheme = Scheme(Mass("x", m=1.0), Spring("x", "ground", k=ω**2), Bumper("x", "ground", gap=d, e=e))
    found = slopes(Problem("grazing", scheme, v0={"x": v0}), ["v0.x"], ["impact:1", "impact:1.speed", "x@1"], t_end=1.2)
    v = math.sqrt((v0 - ω * d) * (v0 + ω * d))
    t_1, by_t = math.atan2(ω * d, v) / ω, -d / (v0 * v)
    # x(1) = d cos s - (e v/ω) sin s, s = ω (1 - t_1)
    s = ω * (1.0 - t_1)
    by_x = ω * by_t * (d * math.sin(s) + e * v / ω * math.cos(s)) - e * v0 / (ω * v) * math.sin(s)
    assert_allclose(found[:, 0], [by_t, v0 / v, by_x], rtol=1e-9)


def test_a_grazing_is_refused_where_the_derivative_would_hold_for_rounding_only():
    scheme = Scheme(Mass("x", m=1.0), Spring("x", "ground", k=4.0), Bumper("x", "ground", gap=0.5, e=0.5))
    for beyond, reason in ((1e-15, "only touches"), (0.0, "without an event"), (-1e-15, "without an event")):
        with pytest.raises(li.UnsupportedError, match=reason):
            slopes(Problem("grazing", scheme, v0={"x": 1.0 + beyond}), ["v0.x"], ["x@1"], t_end=1.2)
    found = slopes(Problem("grazing", scheme, v0={"x": 1.0 - 1e-13}), ["v0.x"], ["x@1"], t_end=1.2)
    assert found == pytest.approx(0.5 * math.sin(2.0), rel=1e-12)


# ---- impacts that accumulate ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("e", [0.5, 0.8])
def test_a_ball_that_comes_to_rest(e):
    """Its impacts end at t = T (1 + e)/(1 - e), T = sqrt(2 H/g)."""
    g, H, m = 9.81, 1.0, 2.0
    T = math.sqrt(2.0 * H / g)
    end = T * (1.0 + e) / (1.0 - e)
    t_end = end + 1.0
    outputs = [
        f"x@{end + 0.5!r}",
        f"v_x@{end + 0.5!r}",
        f"R@{end + 0.5!r}",
        "x.max",
        "impulse",
        "dissipated",
        "impact:40",
    ]
    found = li.sensitivity(li.load_problem("bouncing-ball", e=e, m=m), ["H", "g", "e", "m"], outputs, t_end=t_end)
    # Until impact 40 there are T and 39 flights of 2 T e^k.
    powers = e ** np.arange(1, 40)
    last, by_e = T * (1.0 + 2.0 * powers.sum()), 2.0 * T * (np.arange(1, 40) * powers).sum() / e
    by_hand = [
        [1.0, 0.0, 0.0, 0.0],
        [0.0, 0.0, 0.0, 0.0],
        [0.0, m, 0.0, g],
        [1.0, 0.0, 0.0, 0.0],
        [0.0, m * t_end, 0.0, g * t_end],
        [m * g, m * H, 0.0, g * H],
        [0.5 * last / H, -0.5 * last / g, by_e, 0.0],
    ]
    assert_allclose(found.table[["H", "g", "e", "m"]], by_hand, rtol=1e-12, atol=1e-12)
    # The instant of the end itself.
    variation = found.variation
    rest = next(k for k, each in enumerate(variation.solution.segments) if each.mode.closed)
    t_p = variation.arrival(rest - 1).t_p
    assert_allclose(t_p, [0.5 * end / H, -0.5 * end / g, 2.0 * T / (1.0 - e) ** 2, 0.0], rtol=1e-12, atol=1e-14)


def test_impacts_that_accumulate_on_a_moving_plate_against_differences():
    scheme = Scheme(
        Mass("a", m=1.0), Load("a", f=9.81), Mass("b", m=3.0), Spring("b", "ground", k=400.0),
        Dashpot("b", "ground", c=5.0), Load("b", f=Harmonic(20.0, 3.0)), Bumper("a", "b", gap=0.3, e=0.4, name="R"),
    )  # fmt: skip
    problem, t_end = Problem("plate", scheme), 1.6
    outputs = ["a@1.5", "v_b@1.5", "R@1.5", "dissipated", "impulse"]

    def at(name, p):
        other = with_values(problem, {name: p})
        run = li.simulate(other, "exact", dt=t_end / 200, t_end=t_end, error=False)
        assert run.events[-1].kind == "close"
        return np.array([float(quantity(each, other).measure(run)) for each in outputs])

    wrt = ["R.e", "R.gap", "Spring.k", "0.m", "5.f.omega"]
    found = slopes(problem, wrt, outputs, t_end=t_end)
    for j, name in enumerate(wrt):
        p = value_at(problem, name)
        coarse, fine = (at(name, p + h * p) - at(name, p - h * p) for h in (2e-3, 1e-3))
        assert_allclose(found[:, j], (8.0 * fine - coarse) / (12e-3 * p), rtol=1e-7, atol=1e-9)


# ---- the range in which the events keep their order ----------------------------------------------------------------


def test_the_range_of_a_sample_ends_where_an_impact_passes_it():
    g, H, e, t = 9.81, 1.0, 0.8, 1.0
    found = li.sensitivity(li.load_problem("bouncing-ball", e=e), ["H", "e", "g"], [f"x@{t}"], t_end=1.2, ranges=True)
    rows = found.ranges.set_index("parameter")
    passed = "impact of R instead of the sample at 1 s"
    # Impact 1 is at T = sqrt(2 H/g), and impact 2 at (1 + 2 e) T.
    bounds = {
        ("H", "low"): (g * t**2 / 2.0 / (1.0 + 2.0 * e) ** 2, passed),
        ("H", "high"): (2.0 * H, ""),
        ("e", "low"): (0.5 * (t * math.sqrt(g / (2.0 * H)) - 1.0), passed),
        ("g", "low"): (2.0 * H / t**2, "the sample at 1 s instead of impact of R"),
        ("g", "high"): (2.0 * H * (1.0 + 2.0 * e) ** 2 / t**2, passed),
    }
    for (name, side), (bound, what) in bounds.items():
        p, reached = rows.loc[name, "value"], rows.loc[name, side]
        assert abs(reached - p) <= abs(bound - p) * (1.0 + 1e-12), (name, side)
        assert abs(reached - p) >= 0.985 * abs(bound - p), (name, side)
        assert rows.loc[name, f"at {side}"] == what
    assert "must lie between 0 and 1" in rows.loc["e", "at high"]
    assert "keep their order" in found.summary()
    assert passed in found.summary()


def test_the_range_ends_where_two_events_are_exchanged():
    """Two balls that fall on two floors, and later events do not count."""
    elements = [Mass("a", m=1.0), Mass("b", m=1.0), Load("a", f=9.81), Load("b", f=9.81)]
    elements += [Bumper("a", "ground", gap=1.0, e=0.5, name="A"), Bumper("b", "ground", gap=1.2, e=0.5, name="B")]
    problem = Problem("pair", Scheme(*elements))
    found = li.sensitivity(problem, ["B.gap"], ["B.impact:1"], t_end=0.6, ranges=True).ranges.iloc[0]
    assert 1.0 <= found["low"] <= 1.0 + 0.015 * 0.2
    assert found["at low"] == "impact of B instead of impact of A"
    # With B.gap = 1.765 m the ball does not land in 0.6 s.
    assert 0.985 * 0.5658 <= found["high"] - 1.2 <= 0.5658
    assert found["at high"] == "the end of the run instead of impact of B"


# ---- derivatives to one side ----------------------------------------------------------------------------------------


def pair(*more):
    """Two balls that fall on two floors at once."""
    elements = [Mass("a", m=1.0), Mass("b", m=2.0), Load("a", f=9.81), Load("b", f=2.0 * 9.81)]
    elements += [Bumper("a", "ground", gap=1.0, e=0.5, name="A"), Bumper("b", "ground", gap=1.0, e=0.8, name="B")]
    return Problem("pair", Scheme(*elements, *more))


def test_the_first_of_two_impacts_at_once():
    T = math.sqrt(2.0 / 9.81)
    with pytest.raises(li.UnsupportedError, match="together"):
        slopes(pair(), ["A.gap"], ["impact:1"], t_end=0.6)
    for side, by_gap in (("left", 0.5 * T), ("right", 0.0)):
        found = li.sensitivity(pair(), ["A.gap"], ["impact:1", "A.impact:1"], t_end=0.6, side=side).table
        assert_allclose(found["A.gap"], [by_gap, 0.5 * T], rtol=1e-10, atol=1e-12)
        assert found["note"].tolist() == [ONE_SIDED] * 2


@pytest.mark.parametrize(("side", "sign"), [("left", -1.0), ("right", 1.0)])
def test_two_impacts_at_once_against_differences_to_one_side(side, sign):
    """The dashpot pulls the ball that lands last by the jump of the velocity of the first, so their order counts."""
    problem, t_end, outputs = pair(Dashpot("a", "b", c=3.0)), 0.6, ["a@0.55", "v_b@0.55", "dissipated"]

    def at(h):
        other = with_values(problem, {"A.gap": 1.0 + h})
        run = li.simulate(other, "exact", dt=t_end / 200, t_end=t_end, error=False)
        return np.array([float(quantity(each, other).measure(run)) for each in outputs])

    y = [at(sign * h) for h in (0.0, 5e-4, 1e-3, 1.5e-3, 2e-3)]
    by_differences = sign * (-25.0 * y[0] + 48.0 * y[1] - 36.0 * y[2] + 16.0 * y[3] - 3.0 * y[4]) / (12.0 * 5e-4)
    found = slopes(problem, ["A.gap"], outputs, t_end=t_end, side=side)[:, 0]
    assert_allclose(found, by_differences, rtol=1e-7)
    other = slopes(problem, ["A.gap"], outputs, t_end=t_end, side="right" if side == "left" else "left")[:, 0]
    assert (np.abs(found - other) > 1e-2 * np.abs(found)).all()


def test_where_there_are_derivatives_to_both_sides_these_are_returned():
    ball = li.load_problem("bouncing-ball", e=0.8)
    table = li.sensitivity(ball, ["g", "H"], ["x@1"], t_end=1.2).table
    for side in ("left", "right"):
        assert li.sensitivity(ball, ["g", "H"], ["x@1"], t_end=1.2, side=side).table.equals(table)


def test_a_contact_that_touches_at_the_start():
    scheme = Scheme(Mass("x", m=1.0), Load("x", f=9.81), Bumper("x", "ground", gap=0.0, e=0.0, name="R"))
    touching = Problem("touching", scheme)
    assert_allclose(slopes(touching, ["R.gap"], ["x@0.5"], t_end=0.7, side="right"), [[1.0]], rtol=1e-12)
    with pytest.raises(li.InputError, match=r"R.gap to the left: .* penetrated"):
        slopes(touching, ["R.gap"], ["x@0.5"], t_end=0.7, side="left")


def test_a_sample_at_an_impact_is_of_the_motion_on_the_side():
    ball = li.load_problem("bouncing-ball", e=0.8, H=9.81 / 2.0)  # impact 1 at t = 1 s
    # With a larger H it is still falling at 1 s.
    assert_allclose(slopes(ball, ["H"], ["x@1"], t_end=1.5, side="right"), [[0.0]], rtol=0, atol=1e-11)
    assert_allclose(slopes(ball, ["H"], ["x@1"], t_end=1.5, side="left"), [[1.8]], rtol=1e-10)
    with pytest.raises(li.UnsupportedError, match=r"H to the right: .* jumps there, from -7.848 to 9.81"):
        slopes(ball, ["H"], ["v_x@1"], t_end=1.5, side="right")


def test_a_grazing_has_a_derivative_to_one_side():
    scheme = Scheme(Mass("x", m=1.0), Spring("x", "ground", k=4.0), Bumper("x", "ground", gap=0.5, e=0.5))
    grazing = Problem("grazing", scheme, v0={"x": 1.0})
    found = slopes(grazing, ["v0.x"], ["x@1"], t_end=1.2, side="left")
    assert_allclose(found, [[0.5 * math.sin(2.0)]], rtol=1e-10)
    with pytest.raises(li.UnsupportedError, match=r"v0.x to the right: .* grow without bound"):
        slopes(grazing, ["v0.x"], ["x@1"], t_end=1.2, side="right")


def test_equal_peaks_have_a_derivative_to_one_side():
    ball = li.load_problem("bouncing-ball", e=1.0)
    assert_allclose(slopes(ball, ["e"], ["x.min"], t_end=1.0, side="left"), [[0.0]], rtol=0, atol=1e-12)
    # The height to which it comes back is H e².
    assert_allclose(slopes(ball, ["e"], ["x@0.9030472819714618"], t_end=1.0, side="left"), [[-2.0]], rtol=1e-10)


# ---- second derivatives -----------------------------------------------------------------------------------------------


def test_second_derivatives_of_the_bouncing_ball():
    """t_1 = √(2 H/g), and x(1) = H - e v (1 - t_1) + g (1 - t_1)²/2 after the impact, with v = √(2 g H)."""
    H, g, e = 1.0, 9.81, 0.8
    ball = li.load_problem("bouncing-ball", H=H, g=g, e=e)
    found = li.sensitivity(ball, ["H", "g", "e"], ["impact:1", "x@1"], t_end=1.1, order=2)
    t = math.sqrt(2.0 * H / g)
    instant = [
        [-t / (4.0 * H**2), -t / (4.0 * H * g), 0.0],
        [-t / (4.0 * H * g), 3.0 * t / (4.0 * g**2), 0.0],
        [0.0] * 3,
    ]
    assert_allclose(found.hessian["impact:1"], instant, rtol=1e-10, atol=1e-11)
    # x(1) = H - e √(2 g H) + 2 e H + g/2 - √(2 g H) + H: by √(2 g H) = v, v_HH = -v/(4 H²), v_Hg = v/(4 H g).
    v = math.sqrt(2.0 * g * H)
    by_v = -(1.0 + e)
    place = [
        [-by_v * v / (4.0 * H**2), by_v * v / (4.0 * H * g), 2.0 - v / (2.0 * H)],
        [by_v * v / (4.0 * H * g), -by_v * v / (4.0 * g**2), -v / (2.0 * g)],
        [2.0 - v / (2.0 * H), -v / (2.0 * g), 0.0],
    ]
    assert_allclose(found.hessian["x@1"], place, rtol=1e-10, atol=1e-10)
    assert found.asymmetry < 1e-10
    assert "d²/dp² of x@1" in found.summary()


def test_second_derivatives_at_the_end_of_a_domain_and_of_several_bodies():
    elastic = li.sensitivity(li.load_problem("bouncing-ball", e=1.0), ["e"], ["x@1"], t_end=1.1, order=2)
    assert_allclose(elastic.hessian["x@1"], [[0.0]], rtol=0, atol=1e-9)
    problem, size, names = li.load_problem("system-3"), 1e-3, ["k_o", "Mass.m", "v0.x"]
    H = li.sensitivity(problem, names, ["x@1.5"], t_end=1.5, order=2).hessian["x@1.5"].to_numpy()
    for j, name in enumerate(names):
        p = value_at(problem, name)
        high, low = (value_at_15(problem, names, {name: p * (1.0 + h)}) for h in (size, -size))
        assert_allclose(H[:, j], (high - low) / (2.0 * size * p), rtol=1e-4, atol=1e-9)


def value_at_15(problem, names, changes):
    """The derivatives of x at 1.5 s, with other values of parameters that may be in one another."""
    values = {name: value_at(problem, name) for name in names} | changes
    slopes = []
    for name in names:
        h = 1e-4 * values[name]
        sides = []
        for there in (values[name] - h, values[name] + h):
            run = li.simulate(with_values(problem, {**values, name: there}), "exact", dt=0.1, t_end=1.5, error=False)
            sides.append(run.q[-1, 0])
        slopes.append((sides[1] - sides[0]) / (2.0 * h))
    return np.array(slopes)


@pytest.mark.parametrize(
    ("options", "reason"), [({"order": 3}, "order = 3 must be 1"), ({"order": 2, "side": "left"}, "leave one out")]
)
def test_bad_orders_are_named(options, reason):
    with pytest.raises(li.InputError, match=reason):
        li.sensitivity(li.load_problem("bouncing-ball"), ["H"], ["impact:1"], t_end=0.6, **options)


@pytest.mark.parametrize("c", [1e3, 1e6, 1e9])
def test_the_peak_of_a_strong_dashpot(c):
    """A body of 1 kg meets a plate on a dashpot at v = √(v0² + 2 f a/m): the force begins at its peak c v."""
    f, a, v0 = 9.81, 0.1, 1.0
    plate = [KelvinVoigt("p", "ground", k=1e3, c=c), Bumper("x", "p", gap=a, name="R")]
    problem = Problem("strong", Scheme(Mass("x", m=1.0), Load("x", f=f), *plate), v0={"x": v0})
    found = li.sensitivity(problem, ["Mass.m", "KelvinVoigt.c", "R.gap"], ["R.max"], t_end=0.5)
    v = math.sqrt(v0**2 + 2.0 * f * a)
    assert_allclose(found.table.iloc[0, 3:6].astype(float), [-c * f * a / v, v, c * f / v], rtol=1e-13)
