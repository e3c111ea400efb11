r"""Lesson 3: the dashpot that makes the peak force of System 1 smallest.

In contact the mass moves by m x'' + c x' + k x = m g, so that its acceleration a is a free vibration from a(0) = g - c v_o/m
and a'(0) = -(c a(0) + k v_o)/m, and the force is R = m (g - a).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import minimize_scalar

from lcpimpact.course.lesson import Answer, Lesson, Task, Verdict, close, described, numbers, shown
from lcpimpact.problems.free_vibration import free_vibration

CASES: tuple[dict[str, float], ...] = (
    {"m": 100.0, "k_o": 3924.0, "g": 9.81, "v_o": 9.90454},
    {"m": 1.0, "k_o": 100.0, "g": 9.81, "v_o": 1.5},
    {"m": 20.0, "k_o": 9000.0, "g": 1.62, "v_o": 0.6},
)


def peak_force(c: float, m: float, k_o: float, g: float, v_o: float) -> float:
    """Return the greatest force of the first contact, read at 4001 instants of it [N]."""
    ω, ζ = math.sqrt(k_o / m), 0.5 * c / math.sqrt(k_o * m)
    a = g - c * v_o / m
    S, C, _ = free_vibration(np.linspace(0.0, 2.0 * math.pi / ω, 4001), ω, ζ)
    return float((m * (g - C * a + S * (c * a + k_o * v_o) / m)).max())


def best_damping(m: float, k_o: float, g: float, v_o: float) -> float:
    """Return the damping constant with the smallest peak force [N s/m]."""
    critical = 2.0 * math.sqrt(k_o * m)
    found = minimize_scalar(lambda c: peak_force(c, m, k_o, g, v_o), bounds=(0.0, critical), method="bounded")
    return float(found.x)


RULES: tuple[tuple[Callable[..., float], str], ...] = (
    (
        lambda m, k_o, g, v_o: 0.5294 * math.sqrt(k_o * m),
        "this is the best c without gravity; the weight presses too, and shifts it",
    ),
    (
        lambda m, k_o, g, v_o: math.sqrt(k_o * m),
        "from this c on the force without gravity is greatest at its first instant; the smallest peak is that of another c",
    ),
    (
        lambda m, k_o, g, v_o: 2.0 * math.sqrt(k_o * m),
        "this is critical damping, by which a free vibration dies soonest; it says nothing on the peak force",
    ),
    (lambda m, k_o, g, v_o: 250.0, "this is the published value of System 1; compute c from the parameters"),
)
"""Known rules for c, each with its mistake in words."""


@dataclass(frozen=True)
class DampingTask(Task):
    """A damping constant, judged by the peak force that it gives, which is flat about its minimum."""

    name: str = "damping"

    @property
    def stated(self) -> str:
        """First line of the definition."""
        return "def damping(m, k_o, g, v_o)"

    def judge(self, answer: Answer, *, tolerance: float = 5e-4) -> Verdict:
        """Compare the peak force by the answer's c with the smallest one.

        ``tolerance``: largest relative excess of the peak force over the smallest one.
        """
        found = [answer.call(self.name, tuple(case), case) for case in CASES]
        for case, value in zip(CASES, found, strict=True):
            c = numbers(value)
            call = f"damping({described(case)})"
            if c.shape != () or not np.isfinite(c) or c < 0.0:
                text = shown(value)
                return Verdict(False, f"{call} returns {text}, and a number in N s/m, not negative, is asked for", text)
            peak = peak_force(float(c), **case)
            least = peak_force(best_damping(**case), **case)
            if peak > (1.0 + tolerance) * least:
                return Verdict(
                    False,
                    f"{call} is {float(c):.6g} N s/m, with a peak force of {peak:.6g} N, and {least:.6g} N is possible: "
                    f"{_hint(found, float(c) > best_damping(**case))}",
                    f"{peak:.6g} N",
                    f"{least:.6g} N",
                )
        return Verdict(True, f"the peak force is the smallest for {len(CASES)} sets of parameters")


def _hint(found: list[ArrayLike], too_large: bool, *, rule_rtol: float = 0.01) -> str:
    # rule_rtol: relative difference at which a damping constant is that of a known rule.
    values = [numbers(each) for each in found]
    for rule, hint in RULES:
        if all(close(each, numbers(rule(**case)), rule_rtol) for each, case in zip(values, CASES, strict=True)):
            return hint
    if too_large:
        return "c is too large: the force c v_o of the first instant counts too"
    return "c is too small: more damping takes more energy on the way down, and the spring has less to take"


LESSON = Lesson("a buffer", (DampingTask(),))
