"""Lessons ask before they answer, each question has its answer, and the numbers of the answers are right."""

import math
import re
from pathlib import Path

import numpy as np
import pytest

import lcpimpact as li
from lcpimpact.course import LESSONS, PROJECTS

PAGES = Path(__file__).parents[2] / "docs" / "course"
FOLDED = re.compile(r"^<details>\n<summary>Answer</summary>\n\n(.*?)\n\n</details>$", re.DOTALL | re.MULTILINE)


def page(lesson: str) -> str:
    return (PAGES / f"lesson-{int(lesson.split('-')[1]):02d}.md").read_text(encoding="utf-8")


def answers(lesson: str) -> str:
    """The folded answers of a lesson, white space as single blanks."""
    return " ".join(" ".join(FOLDED.findall(page(lesson))).split())


@pytest.mark.parametrize("lesson", LESSONS)
def test_a_prediction_comes_before_the_cell_and_its_answer_after(lesson):
    text = page(lesson)
    predictions = text.split("**Predict.** ")[1:]
    assert predictions
    for each in predictions:
        asked, cell, rest = re.split(r"^```\{code-cell\}|^```$", each, maxsplit=2, flags=re.MULTILINE)
        assert "(a)" in asked
        assert "(b)" in asked
        if ":tags: [hide-input]" in cell:  # a model solution stands between
            rest = re.split(r"^```$", rest, maxsplit=1, flags=re.MULTILINE)[1]
        answer = FOLDED.match(rest.lstrip())
        assert answer, "a folded answer right after the cell"
        assert re.search(r"\([abc]\)", answer[1]), "which says what is right"


@pytest.mark.parametrize("lesson", LESSONS)
def test_every_question_has_its_answer(lesson):
    part = page(lesson).split("## Questions\n")[1].split("\n## ")[0]
    questions = re.split(r"^\d\. ", part, flags=re.MULTILINE)[1:]
    assert len(questions) == 3
    for each in questions:
        assert len(FOLDED.findall(each)) == 1
        assert each.rstrip().endswith("</details>")
    assert page(lesson).count("<details>") == len(FOLDED.findall(page(lesson)))


@pytest.mark.parametrize("lesson", LESSONS)
def test_code_fits_into_the_column(lesson):
    cells = re.findall(r"^```(?:python|\{code-cell\}.*?)\n(.*?)^```", page(lesson), re.DOTALL | re.MULTILINE)
    assert [line for cell in cells for line in cell.splitlines() if len(line) > 78] == []


def test_lesson_2_needs_numpy_alone_until_the_library_is_met():
    own = page("lesson-2").split("## The library's step")[0]
    assert "import numpy as np" in own
    assert "lcpimpact" not in "".join(re.findall(r"^```.*?^```", own, re.DOTALL | re.MULTILINE))


# ---- the numbers, each by a route of its own --------------------------------------------------------------------------

g = 9.81
v1 = math.sqrt(2.0 * g)
t1 = math.sqrt(2.0 / g)


def deepest(h: float) -> float:
    """The greatest penetration of the ball of lesson 2, by its four lines [m]."""
    x = v = most = 0.0
    for _ in range(round(2.5 / h)):
        after = min(v + h * g, -0.8 * v) if x + 0.5 * h * v >= 1.0 else v + h * g
        x, v = x + 0.5 * h * (v + after), after
        most = max(most, x - 1.0)
    return most


def vibration(c: float) -> tuple[float, float, float, float]:
    """Instant and value of the peak force of System 1, instant of the lowest point and force there [s, N, s, N]."""
    from scipy.linalg import expm
    from scipy.optimize import brentq, minimize_scalar

    m, k, v0 = 100.0, 3924.0, math.sqrt(2.0 * g * 5.0)
    A = np.array([[0.0, 1.0, 0.0], [-k / m, -c / m, g], [0.0, 0.0, 0.0]])

    def state(t: float) -> np.ndarray:
        return expm(A * t) @ [0.0, v0, 1.0]

    def force(t: float) -> float:
        x, v, _ = state(t)
        return k * x + c * v

    peak = minimize_scalar(lambda t: -force(t), bounds=(0.0, 0.4), method="bounded", options={"xatol": 1e-10}).x
    lowest = brentq(lambda t: state(t)[1], 0.1, 0.4)
    return peak, force(peak), lowest, force(lowest)


def stick_slip(mu_s: float, m: float = 1.0, k: float = 100.0, mu: float = 0.3, v_b: float = 0.2) -> tuple[float, float]:
    """Amplitude [m] and period [s] of a block on a belt: it sticks on a line and slips on an arc of an ellipse."""
    ω = math.sqrt(k / m)
    a = (mu_s - mu) * m * g / k  # the displacement from the centre of the slip at which it breaks loose
    slip = 2.0 * (math.pi - math.atan2(a, v_b / ω)) / ω
    return math.hypot(a, v_b / ω), slip + 2.0 * a / v_b


def missing(h: float) -> float:
    """The energy that System 1 misses by θ = 1 [J]."""
    run = li.simulate(li.load_problem("system-1"), dt=h, t_end=3.0, theta=1.0, throw=False)
    return -float(li.energy_ledger(run).totals.set_index("item")["change"]["balance"])


def wide(steps: int) -> float:
    """The difference of two runs of the ball by the four lines of lesson 2, H ± 0.01 m, over their distance."""
    ends = []
    for H in (1.01, 0.99):
        x = v = 0.0
        h = 1.0 / steps
        for _ in range(steps):
            after = min(v + h * g, -0.8 * v) if x + 0.5 * h * v >= H else v + h * g
            x, v = x + 0.5 * h * (v + after), after
        ends.append(x)
    return (ends[0] - ends[1]) / 0.02


def strike(phi: float, wall: float) -> float:
    """The time when a pendulum of 1 m, let go at phi < 0, strikes a wall, by quadrature [s]."""
    from scipy.integrate import quad

    k = math.sin(-0.5 * phi)
    end = math.asin(math.sin(0.5 * wall) / k)
    return quad(lambda u: 1.0 / math.sqrt(1.0 - (k * math.sin(u)) ** 2), -0.5 * math.pi, end)[0] / math.sqrt(g)


def early(phi: float, wall: float) -> float:
    """By how much the linear pendulum strikes early, relative to the true instant."""
    return 1.0 - math.acos(wall / phi) / math.sqrt(g) / strike(phi, wall)


def back(wall: float) -> float:
    """The angle where the pendulum that came from -1 rad turns after the wall, by its energy [rad]."""
    kinetic = 0.64 * 2.0 * g * (math.cos(wall) - math.cos(1.0))
    return -math.acos(math.cos(wall) - kinetic / (2.0 * g))


def swings(number: int) -> float:
    """The time between an impact and the next one, with the energy after it [s]."""
    kinetic = 0.64**number * (math.cos(0.3) - math.cos(1.0))
    return 2.0 * strike(-math.acos(math.cos(0.3) - kinetic), 0.3)


def off(n: int, step: str) -> float:
    """The error of the angle at 0.6 s of the pendulum from -1 rad, after n steps of one kind [rad]."""
    from scipy.integrate import solve_ivp

    exact = solve_ivp(
        lambda t, y: [y[1], -g * math.sin(y[0])], (0.0, 0.6), [-1.0, 0.0], "DOP853", rtol=1e-12, atol=1e-13
    )
    h, q, v = 0.6 / n, -1.0, 0.0
    place, speed = -1j * np.exp(-1j), 0.0  # the bob in the complex plane
    for _ in range(n):
        if step == "beginning":
            v, q = v - h * g * math.sin(q), q + h * v - 0.5 * h * h * g * math.sin(q)
        elif step == "frozen":
            middle = q + 0.5 * h * v
            w = v - 0.5 * h * g * math.sin(middle) / (1.0 + 0.25 * h * h * g * math.cos(middle))
            q, v = q + h * w, 2.0 * w - v
        else:
            half = place + 0.5 * h * speed
            row = (place + h * speed) if step == "end" else half
            free = speed - 1j * h * g
            after = free - half * (row.conjugate() * free).real / (row.conjugate() * half).real
            place, speed = place + 0.5 * h * (speed + after), after
            place = place / abs(place)
    angle = q if step in ("beginning", "frozen") else np.angle(1j * place)
    return abs(angle - exact.y[0, -1])


NUMBERS = [
    ("lesson-1", "-3.54$ m/s", lambda: -0.8 * v1),
    ("lesson-1", "1.355 s", lambda: 3.0 * t1),
    ("lesson-1", "4.43 N s", lambda: v1),
    ("lesson-1", "8.86 N s", lambda: 2.0 * v1),
    ("lesson-1", "0.722438 s", lambda: 1.6 * v1 / g),
    ("lesson-1", "0.577950 s", lambda: 1.28 * v1 / g),
    ("lesson-2", "27 mm", lambda: 600.0 * 0.01 * v1),
    ("lesson-2", "15.45 mm", lambda: 1e3 * deepest(0.01)),
    ("lesson-3", "5818 N", lambda: vibration(250.0)[1]),
    ("lesson-3", "0.184 s", lambda: vibration(250.0)[0]),
    ("lesson-3", "0.249 s", lambda: vibration(250.0)[2]),
    ("lesson-3", "5438 N", lambda: vibration(250.0)[3]),
    ("lesson-3", "5728 N", lambda: vibration(500.0)[1]),
    ("lesson-3", "0.220 s", lambda: vibration(150.0)[0]),
    ("lesson-3", "678$ N s/m", lambda: np.roots([-math.sqrt(10 * g) / 100, g, 3924 * math.sqrt(10 * g)]).max()),
    ("lesson-3", "626$ N s/m", lambda: math.sqrt(392400.0)),
    ("lesson-4", "7.9730 N s", lambda: 1.8 * v1),
    ("lesson-4", "0.098 N s", lambda: g * 0.01),
    ("lesson-4", "0.4515236409857309$", lambda: t1),
    ("lesson-5", "1.333 J", lambda: 0.25 * 16.0 / 3.0),
    ("lesson-5", "0.167$ J", lambda: 1.0 / 6.0),
    ("lesson-5", "704 J", lambda: missing(1e-2)),
    ("lesson-5", "377 and", lambda: missing(5e-3)),
    ("lesson-5", "195 J", lambda: missing(2.5e-3)),
    ("lesson-5", "-2.35$ J", lambda: (1.0 - 1.44) * 16.0 / 3.0),
    ("lesson-6", "10.3 for", lambda: math.log(10.0) / math.log(1.25)),
    ("lesson-6", "3.3 for", lambda: math.log(10.0) / math.log(2.0)),
    ("lesson-6", "89.85$ s", lambda: 199.0 * t1),
    ("lesson-7", "5.947 N", lambda: 0.7 * g * math.cos(math.pi / 6)),
    ("lesson-7", "0.657$ m/s", lambda: g * (0.5 - 0.5 * math.cos(math.pi / 6))),
    ("lesson-7", "3.643 m/s", lambda: 2.0 + 2.5 * g * (0.5 - 0.5 * math.cos(math.pi / 6))),
    ("lesson-7", "0.217, 0.109", lambda: 0.02 * g * (0.5 + 0.7 * math.cos(math.pi / 6))),
    ("lesson-7", "28.0, 22.3", lambda: 1e3 * stick_slip(0.5)[0]),
    ("lesson-7", "22.3 and", lambda: 1e3 * stick_slip(0.4)[0]),
    ("lesson-7", "20.6 mm", lambda: 1e3 * stick_slip(0.35)[0]),
    ("lesson-7", "0.669, 0.635", lambda: stick_slip(0.5)[1]),
    ("lesson-7", "0.635 and", lambda: stick_slip(0.4)[1]),
    ("lesson-7", "0.629 s", lambda: stick_slip(0.35)[1]),
    ("lesson-7", "0.6283 s", lambda: 0.2 * math.pi),
    ("lesson-9", "0.785$ in", lambda: math.exp(-0.2 * math.pi / 2.6)),
    ("lesson-9", "0.505 throughout", lambda: 0.64 * math.exp(-0.2 * math.pi / 2.655)),
    ("lesson-10", "3.1 m/s", lambda: 0.7 * v1),
    ("lesson-11", "0.39 mm", lambda: -1.8 * (1.0 - g * (1.0 - t1) / v1)),
    ("lesson-11", "-0.420$, off", lambda: wide(1009)),
    ("lesson-11", "-0.384$. The", lambda: wide(10007)),
    ("lesson-11", "1.8 mm;", lambda: 1.8),
    ("lesson-11", "4.0 mm/s", lambda: 1.8 * g / v1),
    ("lesson-11", "0.55 s", lambda: 1.0 - t1),
    ("lesson-11", "-4.429 \\cdot", lambda: -v1),
    ("lesson-11", "-2.429$ m", lambda: -v1 * (1.0 - t1)),
    ("lesson-12", "5.9 % or", lambda: 1e2 * early(-1.0, 0.3)),
    ("lesson-12", "38 ms", lambda: 1e3 * early(-1.0, 0.3) * strike(-1.0, 0.3)),
    ("lesson-12", "-0.8097$ rad. The", lambda: back(0.3)),
    ("lesson-12", "-0.7873$ rad", lambda: back(0.0)),
    ("lesson-12", "9.4e-4 to", lambda: 1e4 * off(20, "frozen")),
    ("lesson-12", "3.7e-6 rad with the order 2.00", lambda: 1e6 * off(320, "frozen")),
    ("lesson-12", "2.00; with", lambda: math.log2(off(160, "frozen") / off(320, "frozen"))),
    ("lesson-12", "2.5e-2 to", lambda: 1e2 * off(20, "beginning")),
    ("lesson-12", "1.6e-3 rad, with", lambda: 1e3 * off(320, "beginning")),
    ("lesson-12", "1.00 at the last", lambda: math.log2(off(160, "beginning") / off(320, "beginning"))),
    ("lesson-12", "5.1e-4 to", lambda: 1e4 * off(20, "end")),
    ("lesson-12", "1.5e-6 rad and", lambda: 1e6 * off(320, "end")),
    ("lesson-12", "2.03 at", lambda: math.log2(off(160, "end") / off(320, "end"))),
    ("lesson-12", "1.7e-2 to", lambda: 1e2 * off(20, "half way")),
    ("lesson-12", "1.0e-3 rad and", lambda: 1e3 * off(320, "half way")),
    ("lesson-12", "1.00 from", lambda: math.log2(off(160, "half way") / off(320, "half way"))),
    ("lesson-12", "1.5 %, a quarter", lambda: 1e2 * early(-0.5, 0.15)),
    ("lesson-12", "0.6364 s", lambda: strike(-1.0, 0.3)),
    ("lesson-12", "1.295 s", lambda: swings(1)),
    ("lesson-12", "1.335 s", lambda: swings(2)),
    ("lesson-12", "1.388 s", lambda: swings(3)),
    ("lesson-12", "2.017 s, a", lambda: swings(60)),
]
"""Lesson, the number as its answers have it with what stands beside it, and its value."""


@pytest.mark.parametrize(("lesson", "said", "value"), NUMBERS, ids=[f"{lesson}: {said}" for lesson, said, _ in NUMBERS])
def test_a_number_of_an_answer_is_right(lesson, said, value):
    assert said in answers(lesson)
    number = re.match(r"-?[\d.]+", said)[0]
    digits = len(number.partition(".")[2])
    assert f"{value():.{digits}f}" == number


EXAM = [
    ("$5/3$ m", lambda: 1.0 + 2.0 * sum(0.25**n for n in range(1, 60)), 5.0 / 3.0),
    ("0.157 s", lambda: math.pi * math.sqrt(2.0 / 800.0), 0.157),
    ("0.15 m", lambda: 3.0 * math.sqrt(2.0 / 800.0), 0.15),
    ("120 N", lambda: 3.0 * math.sqrt(2.0 * 800.0), 120.0),
    ("4.5 J", lambda: 8.0 - 0.5 * (2.5**2 + 3.0 * 0.5**2), 4.5),
    ("0.342\\,m g", lambda: math.sin(math.radians(20.0)), 0.342),
    ("0.470\\,m g", lambda: 0.5 * math.cos(math.radians(20.0)), 0.470),
    ("n \\le 30", lambda: sum(2.0 * v1 / g * 0.8**n >= 1e-3 for n in range(1, 100)), 30),
    ("n \\le 61", lambda: sum(2.0 * v1 / g * 0.8**n >= 1e-6 for n in range(1, 100)), 61),
    ("= 1.961$ s", lambda: math.sqrt(1.0 / g) * 1.72 / 0.28, 1.961),
    ("33 ms", lambda: 2e3 * math.sqrt(1.0 / g) * 0.72**9, 33.0),
    ("1456 N", lambda: 300.0 * math.sqrt(2.4 * g), 1456.0),
    ("= 27.25 mm", lambda: 250.0 * 2.0 * g / 180.0, 27.25),
    ("= 45.8 mm", lambda: 420.0 * 2.0 * g / 180.0, 45.8),
    ("9.49$ rad/s", lambda: math.sqrt(90.0), 9.49),
    ("1.254$ m/s²", lambda: g * (0.5 * math.cos(math.radians(20.0)) - math.sin(math.radians(20.0))), 1.254),
    ("2.62$ m/N", lambda: 1.0 / math.hypot(0.36, 0.128), 2.62),
    ("0.382 N", lambda: math.hypot(0.36, 0.128), 0.382),
]
"""What the lecturer's kit says in its folded answers, the value, and the number there."""


@pytest.mark.parametrize(("said", "value", "number"), EXAM, ids=[said for said, *_ in EXAM])
def test_a_number_of_the_lecturers_kit_is_right(said, value, number):
    assert said in " ".join((PAGES / "lecturer.md").read_text(encoding="utf-8").split())
    assert value() == pytest.approx(number, rel=7e-3)


def test_the_lcps_of_the_exam():
    solution = li.solve_lcp([[2.0, -1.0], [-1.0, 2.0]], [1.0, -2.0])
    assert solution.z == pytest.approx([0.0, 1.0])
    assert solution.w == pytest.approx([0.0, 0.0])
    H = np.array([[-1.0, 0.0], [1.0, -1.0]])
    assert (H @ H.T == [[1.0, -1.0], [-1.0, 2.0]]).all()


def test_the_kit_states_every_project_with_its_noise_and_folds_every_answer():
    text = (PAGES / "lecturer.md").read_text(encoding="utf-8")
    unit = {"t": (1e3, "ms"), "R": (1.0, "N"), "x": (1e3, "mm"), "x_max": (1e3, "mm")}
    for name, project in PROJECTS.items():
        (row,) = re.findall(rf"^\| `{name}` \|.*$", text, re.MULTILINE)
        for column, sigma in project.noise.items():
            factor, symbol = unit[column]
            assert f"| {sigma * factor:g} {symbol} |" in row
    questions = re.split(r"^\d+\. ", text.split("## Exam questions\n")[1], flags=re.MULTILINE)[1:]
    assert len(questions) == 10
    assert all(len(FOLDED.findall(each)) == 1 for each in questions)


def test_the_multipliers_of_lesson_9_pass_minus_one():
    text = answers("lesson-9")
    for omega in (2.65, 2.66):
        orbit = li.periodic_orbit(li.load_problem("shaw-holmes", omega=omega), progress=False)
        for each in np.linalg.eigvals(orbit.monodromy):
            assert f"{each.real:.3f}" in text


def test_two_starts_of_lesson_9_part_or_become_one():
    def apart(omega: float) -> np.ndarray:
        x = [
            li.poincare(
                li.load_problem("shaw-holmes", omega=omega, x0=x0), "force", skip=0, points=60, progress=False
            ).table["x"]
            for x0 in (-0.3, -0.3 + 1e-6)
        ]
        return np.abs(x[0].to_numpy() - x[1].to_numpy())

    assert f"after {1 + int(np.argmax(apart(2.8) > 0.1))} periods" in answers("lesson-9")
    assert not apart(2.9)[1:].any()


def test_the_first_six_steps_of_lesson_8_and_halved_ones():
    ball = li.load_problem("bouncing-ball", e=0.8)
    truth = li.reference(ball, 1.7).trajectory
    scatter = {}
    for name, counts in (("halved", [34 * 2**i for i in range(6)]), ("primes", (53, 83, 131, 211, 331, 523))):
        for method in ("moreau-jean", "rattle-ns"):
            runs = [li.simulate(ball, method, dt=1.7 / n, t_end=1.7) for n in counts]
            y = np.log10([li.error_norms(run, truth, ["l1_v"])["l1_v"] for run in runs])
            x = np.log10(counts)
            residual = y - np.polyval(np.polyfit(x, y, 1), x)
            scatter[name, method] = f"{math.sqrt(residual @ residual / 4):.2f}"
    text = answers("lesson-8")
    assert f"{scatter['halved', 'moreau-jean']} and {scatter['halved', 'rattle-ns']} decades" in text
    assert f"it is {scatter['primes', 'moreau-jean']} and {scatter['primes', 'rattle-ns']}." in text


def test_the_plans_name_slides_that_are_there():
    slides = re.findall(r"^##? (.*)$", (PAGES / "slides.md").read_text(encoding="utf-8"), re.MULTILINE)
    kit = (PAGES / "lecturer.md").read_text(encoding="utf-8")
    for number, subject in (
        (2, "ball"),
        (3, "velocity jumps"),
        (5, "NumPy"),
        (6, "views"),
        (7, "force"),
        (8, "Infinitely"),
    ):
        assert subject in slides[number - 1]
    assert {int(each) for each in re.findall(r"slides? (\d)", kit)} <= set(range(1, len(slides) + 1))


def test_the_page_of_slides_gets_its_template():
    template = (PAGES.parent / "_templates" / "slides.html").read_text(encoding="utf-8")
    configuration = (PAGES.parent / "conf.py").read_text(encoding="utf-8")
    assert '"slides.html" if page == "course/slides"' in configuration
    assert "{{ body }}" in template
    assert "http" not in template, "it works without a network"
