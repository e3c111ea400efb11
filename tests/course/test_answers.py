"""Model answers are right, typical wrong answers get the sentence that helps, and whatever else a file does is refused."""

import importlib.util
import json
import math
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import lcpimpact as li
from lcpimpact.cli.main import main
from lcpimpact.course import LESSONS
from lcpimpact.course.ball_on_a_floor import apex, impact_time
from lcpimpact.course.buffer import CASES, best_damping, peak_force
from lcpimpact.course.check import check_answer
from lcpimpact.course.derivative import place_by_height, saltation
from lcpimpact.course.energy import dissipated, energy_ratio
from lcpimpact.course.friction import stop_time
from lcpimpact.course.grazing import contraction, grazing_force
from lcpimpact.course.lesson import FunctionTask
from lcpimpact.course.own_integrator import smooth_order
from lcpimpact.course.pendulum import first_impact, turning_angle
from lcpimpact.course.pendulum import order as frozen_order
from lcpimpact.course.process import verdict_on
from lcpimpact.course.step_as_lcp import bounce, delassus, free_rates
from lcpimpact.course.three_views import contact_time, impulse, stiffness
from lcpimpact.course.three_views import peak_force as spring_peak
from lcpimpact.course.zeno import rest_time
from lcpimpact.errors import InputError

ANSWERS = Path(__file__).parent / "answers"
PAGES = Path(__file__).parents[2] / "docs" / "course"


def model(lesson):
    return (ANSWERS / f"{lesson.replace('-', '_')}.py").read_text(encoding="utf-8")


def judged(tmp_path, lesson, text):
    file = tmp_path / "answer.py"
    file.write_text(text, encoding="utf-8")
    return verdict_on(lesson, str(file))


@pytest.mark.parametrize("lesson", LESSONS)
def test_the_model_answer_is_right(lesson, tmp_path):
    verdict = judged(tmp_path, lesson, model(lesson))
    assert verdict.right, verdict.message


VERLET = """
    def equations(self, y, d, h):
        v_half = y.solve(d.M, y.momentum(y.v) + 0.5 * h * y.force(0.0, y.q, y.v))
        q = y.q + h * v_half
        v = y.solve(d.M, y.momentum(v_half) + 0.5 * h * y.force(1.0, q, v_half) + y.push(y.P[0]))
        impact = Law(
            L=y.gap_rate(v) + d.restitution[:, None] * y.gap_rate(y.v), touching=y.gap(q), springs_at=(y.q, y.v)
        )
        return Step(q=q, v=v, impulse=y.P[0], laws=(impact,))
"""
MIDPOINT = """
    def equations(self, y, d, h):
        A = d.M + 0.25 * h**2 * d.K
        start = y.momentum(y.v) + h * y.force(0.5, y.q + 0.25 * h * y.v, y.v)
        v = y.solve(A, start + y.push(y.P[0]))
        impact = Law(
            L=y.gap_rate(v) + d.restitution[:, None] * y.gap_rate(y.v),
            touching=y.gap(y.q + 0.5 * h * y.v),
            springs_at=(y.q, y.v),
        )
        return Step(q=y.q + 0.5 * h * (y.v + v), v=v, impulse=y.P[0], laws=(impact,))
"""


@pytest.mark.parametrize(("instants", "equations"), [("(0.0, 1.0)", VERLET), ("(0.5,)", MIDPOINT)])
def test_other_methods_of_order_two_are_right(instants, equations, tmp_path):
    head = model("lesson-10").split("    def equations")[0].rstrip() + "\n"
    verdict = judged(tmp_path, "lesson-10", head.replace("(0.5,)", instants) + equations)
    assert verdict.right, verdict.message


def test_a_damping_found_by_simulations_is_right(tmp_path):
    text = """
import numpy as np
from lcpimpact import load_problem, simulate

def damping(m, k_o, g, v_o):
    h = 2e-3 * np.sqrt(m / k_o)
    def peak(c):
        problem = load_problem("system-1", m=m, k_o=k_o, g=g, v_o=v_o, c_o=c)
        return simulate(problem, dt=h, t_end=1500 * h)["R"].max()
    trials = np.sqrt(m * k_o) * np.linspace(0.4, 1.2, 33)
    peaks = [peak(c) for c in trials]
    return trials[int(np.argmin(peaks))]
"""
    verdict = judged(tmp_path, "lesson-3", text)
    assert verdict.right, verdict.message


WRONG = [
    ("lesson-1", "(1 + 2 * e", "(1 + e", "only the first fall is half a flight"),
    ("lesson-1", "(1 + 2 * e", "(2 + 2 * e", "begins at rest"),
    ("lesson-1", "e ** (2 * n)", "e**n", "the square of the speed"),
    ("lesson-1", "e ** (2 * n)", "e ** (2 * n - 2)", "before the n-th impact"),
    ("lesson-1", "sqrt(2 * H / g) *", "0.4515 + 0 *", "the same for all parameters"),
    ("lesson-1", "return H *", "return 'H' or", "returns 'H', and one number is asked for"),
    ("lesson-2", "x[n] + 0.5 * h * v[n] >= H", "x[n] >= H", "not at its beginning"),
    ("lesson-2", "0.5 * h * v[n] >= H", "h * v[n] >= H", "not at its end"),
    ("lesson-2", "0.5 * h * (v[n] + v[n + 1])", "h * v[n + 1]", "not with the new one alone"),
    ("lesson-2", "0.5 * h * (v[n] + v[n + 1])", "h * v[n]", "not with the old one alone"),
    ("lesson-2", "max(0.0, free + e * v[n])", "free + e * v[n]", "never pulls"),
    ("lesson-2", "free + e * v[n]", "free + e * free", "not with -e (v + h g)"),
    ("lesson-2", "free + e * v[n]", "free", "stops at the floor"),
    ("lesson-2", "free + e * v[n]", "free - e * v[n]", "a step: the free velocity"),
    ("lesson-2", "return x[-1], v[-1]", "return x", "2 numbers is asked for"),
    ("lesson-2", "-1 / m1", "1 / m1", "coupled with a negative sign"),
    ("lesson-2", "-1 / m1", "0", "both hold the lower ball"),
    ("lesson-2", "[[1 / m1, -1 / m1], [-1 / m1, 1 / m1 + 1 / m2]]", "[[m1, -m1], [-m1, m1 + m2]]", "inverses of the masses"),
    ("lesson-2", "[[1 / m1, -1 / m1], [-1 / m1, 1 / m1 + 1 / m2]]", "[1 / m1, 1 / m2]", "a 2 x 2 matrix is asked for"),
    ("lesson-2", " - e * v1, (1 + e)", ", 1", "e times the gap rates before the step"),
    ("lesson-2", " - e * v1, (1 + e)", " + e * v1, (1 - e)", "e has the wrong sign"),
    ("lesson-2", "(v1 + h * g)", "v1", "h g belongs to the velocities"),
    ("lesson-2", "[-(v1 + h * g) - e * v1, (1 + e)", "[v1 + h * g + e * v1, -(1 + e)", "all signs are reversed"),
    ("lesson-3", "return (low + high) / 2", "return sqrt(k_o * m)", "smallest peak is that of another c"),
    ("lesson-3", "return (low + high) / 2", "return 2 * sqrt(k_o * m)", "critical damping"),
    ("lesson-3", "return (low + high) / 2", "return 0.53 * sqrt(k_o * m)", "the best c without gravity"),
    ("lesson-3", "return (low + high) / 2", "return 250.0", "published value"),
    ("lesson-3", "return (low + high) / 2", "return 0", "too small"),
    ("lesson-3", "return (low + high) / 2", "return 1.3 * (low + high) / 2", "too large"),
    ("lesson-3", "return (low + high) / 2", "return float('nan')", "not negative, is asked for"),
    ("lesson-4", "return m * (v / d) ** 2", "return 0.5 * m * (v / d) ** 2", "factor one half"),
    ("lesson-4", "pi * sqrt", "2 * pi * sqrt", "a whole period"),
    ("lesson-4", "pi * sqrt(m / k)", "pi * sqrt(k / m)", "exchanged"),
    ("lesson-4", "v * sqrt(m * k)", "2 * v * sqrt(m * k) / pi", "mean force"),
    ("lesson-4", "(1 + e)", "(1 - e)", "the momenta add up"),
    ("lesson-4", "(1 + e)", "1", "the rebound needs an impulse too"),
    ("lesson-5", "(1 - e**2)", "(1 - e)", "by its square"),
    ("lesson-5", "m1 * m2 / (m1 + m2) * (v1 - v2) ** 2", "(m1 * v1**2 + m2 * v2**2)", "centre of mass"),
    ("lesson-5", "return 0.5 * (1", "return -0.5 * (1", "counted positive"),
    ("lesson-5", "a = omega * h", "a = omega * h; theta = 1 - theta", "exchanged"),
    ("lesson-5", "after @ after", "np.sqrt(after @ after)", "ratio of the amplitudes"),
    ("lesson-5", "a = omega * h", "a = omega * h; theta = 1", "θ = 1 only"),
    ("lesson-5", "after @ after", "1.0", "θ = 1/2 only"),
    ("lesson-6", "2 * e * v", "2 * v", "begins with e"),
    ("lesson-6", "2 * e * v", "e * v", "up and down"),
    ("lesson-6", "(v - v0)", "(v + v0)", "sign is reversed"),
    ("lesson-6", "(v - v0)", "v", "is shorter for v0 > 0"),
    ("lesson-6", "floor(", "(", "whole number"),
    ("lesson-6", "/ log(e))", "/ log(e)) + 1", "one too many"),
    ("lesson-6", "/ log(e))", "/ (2 * log(e)))", "in proportion to its speed"),
    ("lesson-7", "v0)\n", "1)\n    v0 = abs(v0)\n", "gravity and friction together"),
    ("lesson-7", "return -v0 / a if a * v0 < 0 else inf", "return abs(v0) / (mu * g * cos(alpha))", "gravity pulls down"),
    ("lesson-7", "mu * g * cos(alpha)", "mu * g", "m g cos α"),
    ("lesson-7", "needed if needed <= largest else largest", "largest", "is the largest friction"),
    ("lesson-7", "needed if needed <= largest else largest", "needed", "cannot exceed"),
    ("lesson-8", "return (1 + e) * v,", "return (1 + e) * v * delta,", "sup stays"),
    ("lesson-8", "(1 + e)", "(1 - e)", "differ by their sum"),
    ("lesson-8", "delta**0.5", "delta", "one half"),
    ("lesson-8", "return np", "return -np", "is positive"),
    ("lesson-8", "np.polyfit(np.log(h), np.log(error), 1)", "np.polyfit(h, error, 1)", "not of the error over h"),
    ("lesson-8", "np.polyfit(np.log(h), np.log(error), 1)[0]", "np.mean(np.log2(error[:-1] / error[1:]))", "halved"),
    ("lesson-9", " + (c * omega) ** 2", "", "damping belongs"),
    ("lesson-9", "gap * sqrt((k - m * omega**2) ** 2 + (c * omega) ** 2)", "k * gap", "static force"),
    ("lesson-9", "(2 * impacts)", "impacts", "twice on its diagonal"),
    ("lesson-9", " * exp(-2 * pi * c / (m * omega))", "", "the dashpot contracts"),
    ("lesson-9", "-2 * pi", "-pi", "twice as fast as amplitudes"),
    ("lesson-10", "q_half = y.q + 0.5 * h * y.v", "q_half = y.q", "in smooth motion MyMethod has the order"),
    ("lesson-10", "order_smooth=2", "order_smooth=1", "declares order_smooth=1"),
    ("lesson-10", " + d.restitution[:, None] * y.gap_rate(y.v)", "", "e does not reach the law"),
    ("lesson-10", " + d.restitution", " - d.restitution", "is expected"),
    ("lesson-10", "h * y.force", "2 * h * y.force", "another motion"),
    ("lesson-11", "earlier = 1 / v", "earlier = 0", "as if its instant did not move"),
    ("lesson-11", "speed = (a_after + e * a) * earlier", "speed = 0", "the time for which each acceleration acts"),
    ("lesson-11", "(a_after + e * a)", "a_after", "goes through the law as well"),
    ("lesson-11", "(a_after + e * a)", "-(a_after + e * a)", "the one after it for longer"),
    ("lesson-11", "[[place, 0], [speed, -e]]", "[[place, speed], [0, -e]]", "rows are what changes"),
    ("lesson-11", "[[place, 0], [speed, -e]]", "[place, 0, speed, -e]", "a 2 x 2 matrix is asked for"),
    ("lesson-11", "delay = 1 / v", "delay = 0", "a step says that keeps it"),
    ("lesson-11", " - (1 + e) * g * delay", " - 0 * g * delay", "leaves with another speed"),
    ("lesson-11", " - (1 + e) * g * delay", " - e * g * delay", "for a shorter time, too"),
    ("lesson-11", "return (1 + e)", "return 1 or (1 + e)", "has left it before t"),
    ("lesson-12", "return (ellipk(k**2) + to_wall)", "return acos(wall / phi)", "large angles swing slowly"),
    ("lesson-12", " + to_wall)", ")", "the wall stands beyond it"),
    ("lesson-12", " + to_wall)", " - to_wall)", "the two times add up"),
    ("lesson-12", "(asin(sin(wall / 2) / k), k**2)\n    return (ellipk(k**2)",
     "(asin(sin(wall / 2) / k), k)\n    return (ellipk(k)", "take m = k², not k"),
    ("lesson-12", "return -acos(", "return acos(", "where angles are below zero"),
    ("lesson-12", "return -acos(", "return e * phi or acos(", "not the angle"),
    ("lesson-12", "return -acos(", "return -sqrt(wall**2 + e**2 * (phi**2 - wall**2)) or acos(", "goes with 1 - cos φ"),
    ("lesson-12", "kinetic = e**2 *", "kinetic = e *", "e² times the kinetic energy"),
    ("lesson-12", "-acos(cos(wall) - kinetic)", "-acos(1 - e**2 * (1 - cos(phi)))", "does not take of that"),
    ("lesson-12", "half = q + h / 2 * v\n            F, K = -g / L * sin(half), g / L * cos(half)",
     "half = q\n            F, K = -g / L * sin(half), 0.0", "that of its beginning"),
    ("lesson-12", "g / L * cos(half)", "0.0", "its slope K is missing"),
    ("lesson-12", "half = q + h / 2 * v", "half = q", "not at the beginning of the step"),
    ("lesson-12", "error(n) / error(2 * n)", "error(2 * n) / error(n)", "positive where smaller steps help"),
    ("lesson-12", "return log2(error(n) ", "return 0.6931471805599453 * log2(error(n) ", "base 2"),
]  # fmt: skip


@pytest.mark.parametrize(("lesson", "right", "wrong", "said"), WRONG)
def test_a_typical_wrong_answer_gets_its_sentence(lesson, right, wrong, said, tmp_path):
    text = model(lesson)
    assert right in text
    verdict = judged(tmp_path, lesson, text.replace(right, wrong))
    assert not verdict.right
    assert said in verdict.message
    assert "\n" not in verdict.message


@pytest.mark.parametrize(
    ("right", "wrong", "said"),
    [
        ("instants = (0.5,)", "instants = (0.0,)", "declare 0.5 in instants"),
        ("MyMethod(LinearStep)", "Other(LinearStep)", "does not define MyMethod"),
        ("return Step", "return None; Step", "MyMethod of"),
    ],
)
def test_a_method_that_does_not_run_is_refused(right, wrong, said, tmp_path):
    with pytest.raises(InputError, match=said):
        judged(tmp_path, "lesson-10", model("lesson-10").replace(right, wrong))


def test_a_registered_method_is_no_answer(tmp_path):
    text = "from lcpimpact.integrators.moreau_jean import MoreauJean\nclass MyMethod(MoreauJean):\n    pass\n"
    verdict = judged(tmp_path, "lesson-10", text)
    assert not verdict.right
    assert "moreau-jean, which is registered" in verdict.message


@pytest.mark.parametrize("name", LESSONS)
def test_every_known_mistake_is_wrong_and_told_from_the_others(name):
    """A mistake that gives the truth in all cases would call a right answer wrong in words."""
    for task in LESSONS[name].tasks:
        if not isinstance(task, FunctionTask):
            continue
        truth = [np.asarray(task.truth(**case), dtype=float) for case in task.cases]
        for mistake in task.mistakes:
            values = [np.asarray(mistake.value(**case), dtype=float) for case in task.cases]
            far = [not np.allclose(a, b, rtol=1e-3, atol=0.0) for a, b in zip(values, truth, strict=True)]
            assert any(far), mistake.hint
        assert any(not np.allclose(each, truth[0], rtol=1e-3) for each in truth), "a constant would be right"


# ---- the truths, by other routes ------------------------------------------------------------------------------------


@pytest.mark.parametrize("e", [0.6, 0.9])
def test_the_bouncing_ball_is_that_of_exact(e):
    run = li.simulate(li.load_problem("bouncing-ball", e=e), "exact", dt=1e-2, t_end=1.5)
    impacts = [event.t for event in run.events if event.kind == "impact"]
    for n, t in enumerate(impacts[:3], 1):
        assert impact_time(n, 9.81, 1.0, e) == pytest.approx(t, rel=1e-12)
    top = run.sample(0.5 * (impacts[0] + impacts[1])).q[0, 0]
    assert apex(1, 1.0, e) == pytest.approx(1.0 - top, rel=1e-12)
    assert rest_time(9.81, 1.0, 0.0, e) == pytest.approx(math.sqrt(2 / 9.81) * (1 + e) / (1 - e), rel=1e-12)


@pytest.mark.parametrize(("e", "h"), [(0.0, 1e-2), (0.5, 0.0123), (0.8, 1e-2), (1.0, 2e-3)])
def test_the_steps_of_the_ball_are_those_of_moreau_jean(e, h):
    run = li.simulate(li.load_problem("bouncing-ball", e=e), "moreau-jean", dt=h, t_end=200 * h, throw=False)
    for n in (40, 100, 200):
        assert bounce(1.0, 9.81, e, h, n) == pytest.approx([run.q[n, 0], run.v[n, 0]], rel=1e-12, abs=1e-12)


def test_the_lcp_of_the_pile_gives_the_step_of_moreau_jean():
    m1, m2, v1, v2, h, e = 1.0, 2.0, 1.0, 2.0, 0.01, 0.5
    scheme = li.Scheme(
        li.Mass("a", m1), li.Mass("b", m2), li.Load("a", 9.81 * m1), li.Load("b", 9.81 * m2),
        li.Bumper("a", "ground", e=e), li.Bumper("b", "a", e=e),
    )  # fmt: skip
    run = li.simulate(li.Problem("pile", scheme, v0={"a": v1, "b": v2}, t_end=h), dt=h, t_end=h)
    q = free_rates(v1, v2, 9.81, h, e)
    P = li.solve_lcp(delassus(m1, m2), q).z
    after = np.array([v1, v2]) + h * 9.81 + np.array([(P[1] - P[0]) / m1, -P[1] / m2])
    assert run.v[-1] == pytest.approx(after, rel=1e-10)


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("part", [0.0, 0.5, 1.0, 2.5])
def test_the_peak_force_is_that_of_exact(case, part):
    c = part * math.sqrt(case["k_o"] * case["m"])
    problem = li.load_problem("system-1", c_o=max(c, 1e-9), **case)
    run = li.simulate(
        problem, "exact", dt=1e-3 * math.sqrt(case["m"] / case["k_o"]), t_end=3 * math.sqrt(case["m"] / case["k_o"])
    )
    assert peak_force(c, **case) == pytest.approx(run.summary()["peak_force"], rel=1e-5)
    assert best_damping(**case) < 2.0 * math.sqrt(case["k_o"] * case["m"])


def test_the_spring_is_that_of_a_penalized_run():
    m, v, k = 0.2, 2.0, 1e4
    run = li.simulate(li.load_problem("kelvin-voigt-impact", m=m, k=k, c=1e-9, v0=v), "exact", dt=1e-5, t_end=0.03)
    found = run.summary()
    assert spring_peak(m, v, k) == pytest.approx(found["peak_force"], rel=1e-6)
    assert contact_time(m, k) == pytest.approx(found["contact_time"], rel=1e-9)
    assert impulse(m, v, 1.0) == pytest.approx(found["impulse"], rel=1e-6)
    assert stiffness(m, v, run.q[:, 0].max()) == pytest.approx(k, rel=1e-5)


@pytest.mark.parametrize("theta", [0.5, 0.75, 1.0])
def test_the_energy_of_a_step_is_that_of_moreau_jean(theta):
    k, h = 25.0, 0.05
    scheme = li.Scheme(li.Mass("x", 1.0), li.Spring("x", "ground", k))
    run = li.simulate(li.Problem("oscillator", scheme, q0={"x": 1.0}, t_end=h), dt=h, t_end=h, theta=theta, throw=False)
    energy = k * run.q[:, 0] ** 2 + run.v[:, 0] ** 2
    assert energy[1] / energy[0] == pytest.approx(energy_ratio(5.0, h, theta), rel=1e-12)


def test_the_energy_of_an_impact_is_that_of_the_ledger():
    scheme = li.Scheme(li.Mass("a", 1.0), li.Mass("b", 2.0), li.Bumper("a", "b", gap=0.1, e=0.5))
    run = li.simulate(li.Problem("two", scheme, v0={"a": 3.0, "b": -1.0}, t_end=0.1), "exact", dt=1e-2, t_end=0.1)
    kinetic = 0.5 * (run.v**2) @ [1.0, 2.0]
    assert kinetic[0] - kinetic[-1] == pytest.approx(dissipated(1.0, 2.0, 3.0, -1.0, 0.5), rel=1e-12)


def test_the_block_stops_as_the_problem_says():
    problem = li.load_problem("block-on-incline")
    p = problem.parameters
    t = stop_time(p["g"], p["alpha"], p["mu"], p["v0"])
    run = li.simulate(problem, dt=1e-4, t_end=2.5)
    assert np.abs(run.v[run.t > t + 2e-4]).max() < 1e-9
    assert run.v[run.t < t - 2e-4, 0].min() > 0.0


def test_the_steady_vibration_grazes():
    m, k, c, omega = 1.0, 4.0, 0.3, 3.0
    gap = 0.2
    scheme = li.Scheme(
        li.Mass("x", m), li.Spring("x", "ground", k), li.Dashpot("x", "ground", c),
        li.Load("x", li.Harmonic(grazing_force(m, k, c, gap, omega), omega)),
    )  # fmt: skip
    run = li.simulate(li.Problem("steady", scheme, t_end=120.0), "exact", dt=1e-2, t_end=120.0)
    assert np.abs(run.q[-1000:, 0]).max() == pytest.approx(gap, rel=1e-4)


def test_the_contraction_is_the_product_of_floquet_multipliers():
    orbit = li.periodic_orbit(li.load_problem("shaw-holmes"))
    found = np.prod(np.linalg.eigvals(orbit.monodromy)).real
    assert contraction(1.0, 0.1, 0.8, 2.6, 1) == pytest.approx(found, rel=1e-9)


def test_the_saltation_matrix_is_that_of_sensitivity():
    """An impact between two constant accelerations: the load is another one from some instant of the impact on."""
    v, e, a, t = 3.0, 0.7, 2.0, 0.8
    scheme = li.Scheme(li.Mass("x", 1.0), li.Load("x", a), li.Bumper("x", "ground", gap=1.5, e=e))
    problem = li.Problem("thrown", scheme, v0={"x": v}, t_end=t)
    found = li.sensitivity(problem, ["q0.x", "v0.x"], [f"x@{t}", f"v_x@{t}", "impact:1", "impact:1.speed"], t_end=t)
    instant, speed = found.table["value"][2:]
    before, after = np.array([[1.0, instant], [0.0, 1.0]]), np.array([[1.0, t - instant], [0.0, 1.0]])
    S = np.array(saltation(speed, e, a, a))
    assert found.table[["q0.x", "v0.x"]].to_numpy()[:2] == pytest.approx(after @ S @ before, rel=1e-10)
    assert np.linalg.det(S) == pytest.approx(e**2)


def test_the_place_by_the_height_is_that_of_sensitivity():
    for case in ({"t": 1.0, "g": 9.81, "H": 1.0, "e": 0.8}, {"t": 3.0, "g": 1.62, "H": 2.5, "e": 0.6}):
        ball = li.load_problem("bouncing-ball", g=case["g"], H=case["H"], e=case["e"])
        found = li.sensitivity(ball, ["H"], [f"x@{case['t']:g}"], t_end=case["t"]).table["H"].item()
        assert place_by_height(**case) == pytest.approx(found, rel=1e-10)


def test_the_pendulum_strikes_and_turns_as_an_event_driven_run_does():
    for case in ({"phi": -1.0, "wall": 0.3, "e": 0.8}, {"phi": -2.5, "wall": 0.8, "e": 0.5}):
        problem = li.load_problem("pendulum-and-wall", L=0.7, **case)
        run = li.simulate(problem, "event-driven", dt=1e-3, t_end=2.6)
        first, second = (event.t for event in run.events[:2])
        assert first_impact(case["phi"], case["wall"], 9.81, 0.7) == pytest.approx(first, rel=1e-8)
        angles = run["φ"][(run.t > first) & (run.t < second)]
        assert turning_angle(**case) == pytest.approx(angles.min(), abs=2e-4)


def test_the_order_of_the_frozen_step_is_that_of_moreau_jean():
    fine = li.load_problem("pendulum-and-wall")
    free = li.Problem("free", fine.scheme, q0={"φ": -1.0}, t_end=0.6)
    truth = li.simulate(free, "dopri5", dt=1e-3, t_end=0.6)["φ"][-1]
    off = [abs(li.simulate(free, "moreau-jean", dt=0.6 / n, t_end=0.6)["φ"][-1] - truth) for n in (5, 10)]
    assert frozen_order(-1.0, 9.81, 1.0, 0.6, 5) == pytest.approx(math.log2(off[0] / off[1]), rel=1e-6)


@pytest.mark.parametrize(("method", "order"), [("moreau-jean", 2), ("heun", 2)])
def test_the_order_of_known_methods_is_measured(method, order):
    assert smooth_order(method) == pytest.approx(order, abs=0.05)


# ---- files that are no answers, and the command ---------------------------------------------------------------------

REFUSED = [
    ("", "does not define impact_time: write def impact_time(n, g, H, e)"),
    ("def impact_time(n, g, H, e)\n", "the code of 'answer.py' raises SyntaxError"),
    ("x = 1\n1/0\n", "raises ZeroDivisionError: division by zero, line 2"),
    ("impact_time = 3\n", "is no function"),
    ("def impact_time(n):\n    return 1.0\n", "takes other arguments"),
    ("def impact_time(n, g, H, e):\n    return\n    yield\n", None),
    ("def impact_time(n, g, H, e):\n    raise SystemExit\n", "(n=1, g=9.81, H=1, e=0.8) of 'answer.py' raises SystemExit"),
    ("import sys\nsys.exit(0)\n", "the code of 'answer.py' raises SystemExit: 0, line 2"),
    ("import os\nos._exit(0)\n", "ends the process that checks it"),
    ("input()\n", "EOFError"),
    ("def impact_time(n, g, H, e):\n    while True: pass\n", "does not end within 1 s"),
    ("\x00", "raises"),
]  # fmt: skip


@pytest.mark.parametrize(("text", "said"), REFUSED)
def test_a_file_that_is_no_answer_is_refused_in_one_sentence(text, said, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("answer.py").write_text(text, encoding="utf-8")
    with pytest.raises(SystemExit) as stop:
        main(["check", "lesson-1", "answer.py", "--seconds", "1" if "while True" in text else "5"])
    captured = capsys.readouterr()
    if said is None:
        assert stop.value.code == 1
        assert "and one number is asked for" in captured.out
        return
    assert stop.value.code == 2
    assert captured.err.count("\n") == 1
    assert said in captured.err
    assert captured.out == ""


def test_bytes_that_are_no_text_are_refused(tmp_path):
    (tmp_path / "answer.py").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match="raises"):
        check_answer("lesson-1", tmp_path / "answer.py")


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["lesson-13", "answer.py"], "unknown lesson 'lesson-13'"),
        (["lesson-1", "nowhere.py"], "does not exist"),
        (["lesson-1", "."], "is a folder"),
        (["lesson-1"], "Missing argument 'FILE'"),
        (["lesson-1", "answer.py", "--seconds", "0"], "seconds"),
    ],
)
def test_wrong_words_of_the_command_are_refused(arguments, said, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("answer.py").write_text(model("lesson-1"), encoding="utf-8")
    with pytest.raises(SystemExit) as stop:
        main(["check", *arguments])
    assert stop.value.code == 2
    assert said in capsys.readouterr().err


def test_the_command_ignores_noise_and_leaves_nothing(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    noise = "import sys, threading, time\nprint('noise', flush=True)\nsys.stderr.write('noise')\n"
    noise += "open('left.txt', 'w').write('x')\nthreading.Thread(target=time.sleep, args=(1000,)).start()\n"
    noise += "from constants import ONE\n"
    Path("constants.py").write_text("ONE = 1\n", encoding="utf-8")
    Path("answer.py").write_text(noise + model("lesson-1"), encoding="utf-8")
    with pytest.raises(SystemExit) as stop:
        main(["check", "lesson-1", "answer.py"])
    captured = capsys.readouterr()
    assert (stop.value.code, captured.err) == (0, "")
    assert captured.out == "lesson-1: right: impact_time and apex are right\n"
    assert {each.name for each in tmp_path.iterdir()} - {"__pycache__"} == {"answer.py", "constants.py"}


def test_the_command_says_the_verdict_in_json(tmp_path):
    (tmp_path / "answer.py").write_text(model("lesson-4").replace("(1 + e)", "1"), encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "-m", "lcpimpact", "check", "lesson-4", str(tmp_path / "answer.py"), "--json"],
        capture_output=True, text=True, timeout=60,
    )  # fmt: skip
    assert done.returncode == 1
    verdict = json.loads(done.stdout)
    assert verdict["lesson"] == "lesson-4"
    assert verdict["right"] is False
    assert verdict["found"] == "4.43 N s"
    assert verdict["expected"] == "7.974 N s"


# ---- the notebooks --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("lesson", LESSONS)
def test_the_stub_of_the_notebook_is_no_answer(lesson, tmp_path):
    """The page shows what the answer must define, and its stub is wrong as it stands."""
    text = (PAGES / f"lesson-{int(lesson.split('-')[1]):02d}.md").read_text(encoding="utf-8")
    stub = re.search(r"^```python\n# answer\.py\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
    assert stub, "a block that begins with # answer.py"
    assert f"lcpimpact check {lesson} answer.py" in text
    for task in LESSONS[lesson].tasks:
        assert task.stated in stub[1]
    assert not judged(tmp_path, lesson, stub[1]).right


@pytest.mark.parametrize("page", sorted(PAGES.glob("lesson-*.md")), ids=lambda page: page.stem)
def test_a_lesson_is_a_notebook_that_jupyter_can_show(page):
    """Nothing that only Sphinx resolves is left in it, and its code compiles."""
    for package in ("jupytext", "sphinx"):
        pytest.importorskip(package)
    spec = importlib.util.spec_from_file_location("notebooks", PAGES.parent / "notebooks.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    cells = module.notebook_of(page).cells
    assert cells[0].source.startswith("# Lesson ")
    assert sum(cell.cell_type == "code" for cell in cells) >= 3
    for cell in cells:
        if cell.cell_type == "code":
            compile(cell.source, page.name, "exec")
        else:
            assert not re.search(r"\{(doc|eq|cite)|\.md\)|\$\$ \(|^:::|^```\{", cell.source, re.MULTILINE), cell.source
