"""Lesson 8: norms of the error about an impact, and the slope of errors over steps."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from lcpimpact.arrays import Array
from lcpimpact.course.lesson import (
    Answer,
    FunctionTask,
    Lesson,
    Mistake,
    Task,
    Verdict,
    close,
    described,
    numbers,
    shown,
    written,
)


def jump_errors(v: float, e: float, delta: float) -> Array:
    """Return sup, L¹ and L² norm of the difference of two velocities that jump from v to -e v with delta between them."""
    jump = v + e * v
    return np.array([jump, jump * delta, np.sqrt(jump * jump * delta)])


SERIES: tuple[tuple[tuple[float, ...], tuple[float, ...]], ...] = (
    ((0.1, 0.05, 0.025, 0.0125), (0.2, 0.05, 0.0125, 0.003125)),
    ((0.3, 0.1, 0.02, 0.007), (0.61, 0.19, 0.042, 0.0139)),
    ((0.001, 0.01, 0.02, 0.16), (1.1e-2, 3.0e-2, 4.7e-2, 1.2e-1)),
)
"""Steps and errors: halved, of mixed ratios with scatter, and in another order."""


def slope(h: ArrayLike, error: ArrayLike) -> float:
    """Return the slope of the line of least squares through log error over log h."""
    x, y = np.log(h), np.log(error)
    x = x - x.mean()
    return float(x @ y / (x @ x))


def _fits(h: tuple[float, ...], error: tuple[float, ...]) -> tuple[tuple[float, str], ...]:
    """Return wrong slopes, each with its mistake in words."""
    with np.errstate(all="ignore"):
        halved = np.log2(np.array(error[:-1]) / np.array(error[1:]))
        ends = np.log(error[-1] / error[0]) / np.log(h[-1] / h[0])
        return (
            (
                -slope(h, error),
                "the order is the slope of log error over log h, which is positive where smaller steps help",
            ),
            (float(np.polyfit(h, error, 1)[0]), "the slope is that of log error over log h, not of the error over h"),
            (
                float(halved.mean()),
                "log2 of the ratio of successive errors is the order only where the steps are halved",
            ),
            (float(ends), "the first and the last error alone let scatter decide: fit a line to all of them"),
            (1.0 / slope(h, error), "the axes are exchanged: the error is the ordinate"),
            (float(np.polyfit(np.log(h), error, 1)[0]), "the error belongs to the line by its logarithm too"),
        )


class SlopeTask(Task):
    """The function ``slope`` of two sequences."""

    name = "slope"

    @property
    def stated(self) -> str:
        """First line of the definition."""
        return "def slope(h, error)"

    def judge(self, answer: Answer) -> Verdict:
        """Compare with the line of least squares."""
        found = []
        for h, error in SERIES:
            value = answer.call(self.name, ("h", "error"), {"h": np.array(h), "error": np.array(error)})
            array = numbers(value)
            if array.shape != ():
                return Verdict(False, f"slope returns {shown(value)}, and one number is asked for", shown(value))
            found.append(array)
        for i, (h, error) in enumerate(SERIES):
            right = numbers(slope(h, error))
            if not close(found[i], right, 1e-6):
                said, expected = written(found[i]), written(right)
                call = f"slope({described({'h': h, 'error': error})})"
                return Verdict(
                    False, f"{call} is {said}, and {expected} is expected: {self._hint(found)}", said, expected
                )
        return Verdict(True, f"slope is right for {len(SERIES)} series")

    def _hint(self, found: list[Array]) -> str:
        tables = [_fits(*each) for each in SERIES]
        for j, (_, hint) in enumerate(tables[0]):
            if all(close(value, numbers(table[j][0]), 1e-6) for value, table in zip(found, tables, strict=True)):
                return hint
        return "fit one straight line by least squares to log error over log h, with equal weights"


LESSON = Lesson(
    "honest convergence",
    (
        FunctionTask(
            "jump_errors",
            jump_errors,
            (
                {"v": 4.0, "e": 0.5, "delta": 0.01},
                {"v": 4.0, "e": 0.8, "delta": 0.0001},
                {"v": 0.3, "e": 0.0, "delta": 0.04},
            ),
            "(m/s, m, m/s^(1/2))",
            "between the two instants the velocities differ by (1 + e) v, and elsewhere by nothing",
            (
                Mistake(
                    "between the instants the velocities differ by the whole jump, however near they are: sup stays",
                    lambda v, e, delta: jump_errors(v, e, delta) * np.array([delta, 1.0, 1.0]),
                ),
                Mistake(
                    "one velocity is v, the other -e v: they differ by their sum",
                    lambda v, e, delta: jump_errors(v, -e, delta),
                ),
                Mistake(
                    "the L² norm is the root of an integral: its order in delta is one half",
                    lambda v, e, delta: jump_errors(v, e, delta) * np.array([1.0, 1.0, delta**0.5]),
                ),
                Mistake(
                    "the L² norm is the root of the integral of the square; the root is missing",
                    lambda v, e, delta: np.array([(1.0 + e) * v, (1.0 + e) * v * delta, ((1.0 + e) * v) ** 2 * delta]),
                ),
            ),
        ),
        SlopeTask(),
    ),
)
