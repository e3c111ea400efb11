"""Lesson 10: an integrator of one's own, its order measured in smooth motion and across impacts."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from lcpimpact.course.lesson import Answer, Lesson, Task, Verdict
from lcpimpact.errors import InputError
from lcpimpact.integrators import METHODS
from lcpimpact.integrators.base import Integrator
from lcpimpact.problems import load_problem
from lcpimpact.problems.base import Problem
from lcpimpact.scheme.elements.base import GROUND
from lcpimpact.scheme.elements.load import Load
from lcpimpact.scheme.elements.mass import Mass
from lcpimpact.scheme.elements.spring import Spring
from lcpimpact.scheme.scheme import Scheme
from lcpimpact.simulation import simulate

COUNTS = (61, 89, 127, 181, 257, 367)
"""Step counts of the smooth runs: primes with ratios of about 1.4."""

RESTITUTIONS = (0.6, 0.0, 0.9)
STEPS = 1009
"""Steps of a run with impacts: a prime, so that no impact falls on the grid."""


@dataclass(frozen=True)
class MethodTask(Task):
    """A class of methods, judged by an oscillator and a bouncing ball with their closed forms.

    Attributes
    ----------
    name : str
    """

    name: str = "MyMethod"

    @property
    def stated(self) -> str:
        """First line of the definition."""
        return "class MyMethod(LinearStep)"

    def judge(self, answer: Answer) -> Verdict:
        """Measure the order in smooth motion, then the rebound."""
        kind = answer.get(self.name, f"write {self.stated}")
        if not (isinstance(kind, type) and issubclass(kind, Integrator)):
            raise InputError(f"MyMethod of {answer.file!r} is no class of methods: write {self.stated}")
        taken = [name for name, method in METHODS.items() if issubclass(kind, method)]
        if taken:
            return Verdict(
                False, f"MyMethod is {taken[0]}, which is registered: write the equations of a step yourself"
            )
        method = answer.guarded(kind, "MyMethod()")
        return answer.guarded(lambda: _judged(method), "MyMethod")


def _judged(method: Integrator, *, order: int = 2, band: float = 0.2) -> Verdict:
    # order: order in smooth motion that is asked for.
    # band: largest distance of a measured order from the one asked for.
    slope = smooth_order(method)
    if not abs(slope - order) <= band:
        hint = (
            "the error does not shrink with the step: the equations are those of another motion"
            if slope < 0.5
            else "take the force where the error of the velocities over a step cancels, at half of it for example"
        )
        return Verdict(
            False,
            f"in smooth motion MyMethod has the order {slope:.2f}, and {order} is asked for: {hint}",
            f"{slope:.2f}",
            f"{order}",
        )
    if method.declared.order_smooth != order:
        return Verdict(
            False,
            f"MyMethod declares order_smooth={method.declared.order_smooth}, and {slope:.2f} is measured",
            f"{method.declared.order_smooth}",
            f"{slope:.2f}",
        )
    for e in RESTITUTIONS:
        verdict = _rebound(method, e)
        if not verdict.right:
            return verdict
    return Verdict(True, f"MyMethod has the order {slope:.2f} in smooth motion, and bounces as it should")


def smooth_order(method: Integrator | str) -> float:
    """Return the slope of the error of a loaded oscillator at its end, by its closed form."""
    m = 1.3
    k = 50.0
    f = 4.0
    q0 = 0.2
    v0 = 1.5
    t_end = 2.0
    scheme = Scheme(Mass("x", m), Spring("x", GROUND, k), Load("x", f))
    problem = Problem("oscillator", scheme, q0={"x": q0}, v0={"x": v0}, t_end=t_end)
    ω, rest = math.sqrt(k / m), f / k
    errors = []
    for n in COUNTS:
        run = simulate(problem, method, dt=t_end / n, progress=False, throw=False)
        exact = rest + (q0 - rest) * np.cos(ω * run.t) + v0 / ω * np.sin(ω * run.t)
        errors.append(float(np.abs(run.q[:, 0] - exact).max()) if run.t[-1] == t_end else math.nan)
    if not all(0.0 < each < math.inf for each in errors):
        return math.nan
    return float(np.polyfit(np.log([t_end / n for n in COUNTS]), np.log(errors), 1)[0])


def _rebound(method: Integrator, e: float, *, largest_error: float = 0.02) -> Verdict:
    """Judge the speed of a ball after its first impact, and the whole run by its certificate.

    ``largest_error``: largest error of the rebound speed, relative to the approach speed; the step is a thousandth
    of the run.
    """
    g, H = 9.81, 1.0
    fall = math.sqrt(2.0 * H / g)
    approach = math.sqrt(2.0 * g * H)
    t_end = fall * (1.0 + max(e, 0.5))  # at most the apex of the first flight
    run = simulate(
        load_problem("bouncing-ball", g=g, H=H, e=e), method, dt=t_end / STEPS, t_end=t_end, progress=False, throw=False
    )
    after = run.t > fall + 3.0 * t_end / STEPS
    speed = g * (float(run.t[after][0]) - fall) - float(run.v[after, 0][0]) if after.any() else math.nan
    ball = f"a ball with e={e:g} falls with {approach:.6g} m/s and leaves"
    if not abs(speed - e * approach) <= largest_error * approach:
        hint = "the law of a closed contact is 0 <= P ⟂ U⁺ + e U⁻ >= 0; look at its signs and at e"
        if abs(speed) <= largest_error * approach:
            hint = "e does not reach the law: add d.restitution times the gap rate before the step"
        return Verdict(
            False,
            f"{ball} with {speed:.6g} m/s, and {e * approach:.6g} m/s is expected: {hint}",
            f"{speed:.6g} m/s",
            f"{e * approach:.6g} m/s",
        )
    if not run.success:
        return Verdict(False, f"{ball} as it should, but the run breaks its laws: {run.message}")
    return Verdict(True, f"{ball} as it should")


LESSON = Lesson("an integrator of your own", (MethodTask(),))
