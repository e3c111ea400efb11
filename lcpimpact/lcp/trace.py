"""Traces of solvers: pivots or iterates with their tableaux."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from lcpimpact.arrays import Array, Indices, Matrix, Vector
from lcpimpact.compiled import compiled
from lcpimpact.interpreter import interpreted
from lcpimpact.registry import html_of

NONE = -1
"""Index when no single variable entered or left the basis."""


@compiled()
def note(z: Vector, basis: Indices, entering: int, leaving: int) -> None:
    """Do nothing; a traced run replaces this function by one that records the arguments.

    Variables are numbered w_1 ... w_n, z_1 ... z_n, z0 from 0 to 2n; ``basis[i]`` is the basic variable of row i.
    """


@compiled()
def note_covered(z: Vector, basis: Indices, entering: int, leaving: int, shift: Vector) -> None:
    """Do nothing, like `note`, for a point of Lemke's method: w = M z + q + shift with shift = d z0."""


@compiled()
def note_problem(M: Matrix, q: Vector) -> None:
    """Do nothing, like `note`, at the beginning of a method that reduces the problem to LCP(M, q)."""


@dataclass(frozen=True)
class TraceStep:
    """One basis or iterate.

    Attributes
    ----------
    z, w : (n,) arrays      the point, with w = M z + q + z0
    z0 : float              the covering variable of Lemke's method, 0 elsewhere
    basis : (n,) tuple      name of the basic variable of each row
    entering, leaving : str the exchange that led here, "" for none or a block pivot
    """

    z: Array
    w: Array
    z0: float
    basis: tuple[str, ...]
    entering: str
    leaving: str


@dataclass(frozen=True)
class Trace:
    """The steps of a run on LCP(M, q).

    ``print`` shows a table of all steps; `tableau` returns the tableau of one.

    Attributes
    ----------
    M : (n, n) array
    q : (n,) array
    solver : str
    steps : tuple of TraceStep

    Examples
    --------
    >>> from lcpimpact import solve_lcp
    >>> print(solve_lcp([[2.0, 1.0], [1.0, 2.0]], [-5.0, -6.0], "lemke", trace=True).trace)
    lemke on an LCP of order 2
    step  enters  leaves  basis       z1       z2  w1  w2  z0
       1  z0      w2      w1 z0        0        0   1   0   6
       2  z2      w1      z2 z0        0        1   0   0   4
       3  z1      z0      z2 z1  1.33333  2.33333   0   0   0
    """

    M: Array
    q: Array
    solver: str
    steps: tuple[TraceStep, ...]

    def ending(self, z: Array) -> Trace:
        """Return the trace with the solution z as its last step, which some methods do not record or refine later.

        Methods without bounds are traced on the LCP of `to_lcp`, whose unknowns are not z.
        """
        if len(z) != len(self.q):
            return self
        if self.steps and np.abs(self.steps[-1].z - z).max() <= 1e-12 * np.abs(z).max():
            return self
        basis = tuple(f"z{i + 1}" if z[i] != 0.0 else f"w{i + 1}" for i in range(len(z)))
        return replace(self, steps=(*self.steps, TraceStep(z, self.M @ z + self.q, 0.0, basis, "", "")))

    def __len__(self) -> int:
        return len(self.steps)

    def __str__(self) -> str:
        n = len(self.q)
        covered = any("z0" in (*step.basis, step.entering, step.leaving) for step in self.steps)
        names = [f"z{i + 1}" for i in range(n)] + [f"w{i + 1}" for i in range(n)] + ["z0"] * covered
        rows = [["step", "enters", "leaves", "basis", *names]]
        for number, step in enumerate(self.steps, 1):
            values = [*step.z, *step.w, *[step.z0] * covered]
            rows.append([str(number), step.entering, step.leaving, " ".join(step.basis), *map(_short, values)])
        return "\n".join([f"{self.solver} on an LCP of order {n}", *_lines(rows, left=(1, 2, 3))])

    def _repr_html_(self) -> str:
        return html_of(self)

    def tableau(self, k: int) -> str:
        """Return the tableau of step k: each basic variable in terms of the nonbasic ones.

        A row reads basic = constant + Σ coefficient · nonbasic.
        """
        n, basis = len(self.q), self.steps[k].basis
        names = [f"w{i + 1}" for i in range(n)] + [f"z{i + 1}" for i in range(n)] + ["z0"]
        full = np.hstack([np.eye(n), -self.M, -np.ones((n, 1))])  # full (w, z, z0) = q
        inside = [names.index(name) for name in basis]
        # The column of Lemke's covering variable is dropped if unused.
        outside = [i for i in range(2 * n + ("z0" in basis)) if i not in inside]
        try:
            solved = np.linalg.solve(full[:, inside], np.column_stack([self.q, -full[:, outside]]))
        except np.linalg.LinAlgError:
            return f"step {k + 1}: the basis {' '.join(basis)} is singular"
        rows = [[name, *map(_short, row)] for name, row in zip(basis, solved, strict=True)]
        return "\n".join(_lines([["", "1", *(names[i] for i in outside)], *rows], left=(0,)))


def _lines(rows: list[list[str]], left: tuple[int, ...]) -> list[str]:
    """Return a table as lines, each column as wide as its texts, those numbered in ``left`` flush left."""
    sides = ["<" if i in left else ">" for i in range(len(rows[0]))]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [
        "  ".join(f"{text:{side}{width}}" for text, side, width in zip(row, sides, widths, strict=True)) for row in rows
    ]


def _short(value: float) -> str:
    return f"{0.0 if abs(value) < 1e-14 else value:.6g}"


def traced(kernel: Callable[..., Any], M: Array, q: Array, name: str) -> tuple[Callable[..., Any], Callable[[], Trace]]:
    """Return a recording kernel that runs in the interpreter, and the function that returns its `Trace`.

    A method without bounds is traced on the LCP to which it reduces the problem.
    """
    steps: list[TraceStep] = []
    problem = [M, q]

    def begin(N: Array, p: Array) -> None:
        problem[:] = N.copy(), p.copy()
        steps.clear()

    def take(z: Array, basis: Indices, entering: int, leaving: int, shift: Array | None = None) -> None:
        n = len(z)
        names = [f"w{i + 1}" for i in range(n)] + [f"z{i + 1}" for i in range(n)] + ["z0", ""]
        covered = np.zeros(n) if shift is None else shift
        w = problem[0] @ z + problem[1] + covered
        inside = tuple(names[i] for i in basis)
        steps.append(TraceStep(z.copy(), w, float(covered.max()), inside, names[entering], names[leaving]))

    recording = interpreted(kernel, note=take, note_covered=take, note_problem=begin)
    return recording, lambda: Trace(problem[0], problem[1], name, tuple(steps))
