"""The command solve: one LCP from a file, with its solution, trace and properties."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import click
import numpy as np

from lcpimpact.arrays import Array
from lcpimpact.cli.options import PATH, names_of
from lcpimpact.cli.output import DECIMAL, print_answer, table_output_options
from lcpimpact.errors import FailureError, InputError
from lcpimpact.files import check_outputs, whole_file
from lcpimpact.lcp import SOLVERS
from lcpimpact.registry import load

if TYPE_CHECKING:
    from lcpimpact.lcp.files import LCPFile
    from lcpimpact.lcp.operators import Delassus
    from lcpimpact.lcp.problem import LCPSolution

SAVED_AS = (".csv", ".npz")


@click.command()
@click.argument("file", type=PATH, help="The LCP: .lcp, .txt, .csv, .npz, .npy or .mtx.")
@click.option("--q", type=PATH, help="File with q, if the first has only M.")
@click.option("--solver", default="auto", shell_complete=names_of(SOLVERS), help="A name of `lcpimpact list solvers`.")
@click.option("--tol", type=float, help="Largest scaled residual; by default the solver's own.")
@click.option("--max-iter", type=int, help="Limit of iterations; by default the solver's own.")
@click.option("--lower", metavar="X", help="Lower bound instead of the file's: a number, or n with commas.")
@click.option("--upper", metavar="X", help="Upper bound, likewise.")
@click.option("--trace", is_flag=True, help="Show each pivot or iterate.")
@click.option("--tableau", type=int, metavar="K", help="Show the tableau of step K of the trace.")
@click.option("--all", "every", is_flag=True, help="List all solutions, for n <= 15.")
@click.option("--out", type=PATH, help="File for z and w: .csv or .npz.")
@click.option("--plot", type=PATH, help="File for the complementary cones, for n = 2 or 3: .png, .svg or .pdf.")
@click.option(
    "--plot-trace", type=PATH, help="File for the path of z in the trace, for n = 2 or 3: .png, .svg or .pdf."
)
@table_output_options
def solve(
    file: Path, q: Path | None, solver: str, tol: float | None, max_iter: int | None, lower: str | None,
    upper: str | None, trace: bool, tableau: int | None, every: bool, out: Path | None, plot: Path | None,
    plot_trace: Path | None,
) -> None:  # fmt: skip
    """Solve the LCP of a file, w = M z + q, 0 <= z ⟂ w >= 0 or between bounds, and print the solution and its properties.

    A text file holds the rows of M, and q as one further row. Rows that begin with lower: and upper: are bounds. The exit
    code is 0 only if the solution is verified.

    Example: lcpimpact solve three.lcp --solver lemke --trace --tableau 2
    """
    from lcpimpact.lcp.files import read_lcp
    from lcpimpact.lcp.problem import bounds
    from lcpimpact.lcp.solve import solve_lcp
    from lcpimpact.plotting.style import METADATA as DRAWN_AS

    check_outputs(((out, SAVED_AS), (plot, DRAWN_AS), (plot_trace, DRAWN_AS)), (file,) if q is None else (file, q))
    problem = read_lcp(file, q)
    M, n = problem.M, problem.M.n
    low, high, bounded = bounds(
        n,
        problem.lower if lower is None else _numbers("--lower", lower, n),
        problem.upper if upper is None else _numbers("--upper", upper, n),
    )
    if plot is not None and (n not in (2, 3) or bounded):
        raise InputError("--plot needs an LCP with n = 2 or 3 and without bounds, whose cones it draws: leave it out")
    if plot_trace is not None and n not in (2, 3):
        raise InputError("--plot-trace needs an LCP with n = 2 or 3, whose z it draws: leave it out")
    if every:
        _check_bases(low, high)

    solution = solve_lcp(
        M, problem.q, solver, lower=low, upper=high, tol=tol, max_iter=max_iter,
        throw=False, trace=trace or tableau is not None or plot_trace is not None,
    )  # fmt: skip
    side = _row_sides(solution, problem.q, low, high)
    lines = _description(problem, solution, side, low, high)
    if trace:
        lines += ["", str(solution.trace)]
    if tableau is not None:
        lines += ["", f"tableau of step {tableau}", _tableau(solution, tableau)]
    if every:
        lines += ["", *_all(M, problem.q, low, high)]
    if out is not None and solution.success:
        _write(out, solution, side)
        lines += [f"  wrote       {out}"]
    if plot is not None:
        from lcpimpact.plotting.cones import plot_cones

        plot_cones(M, problem.q, plot)
        lines += [f"  drew        {plot}"]
    if plot_trace is not None:
        assert solution.trace is not None
        load("lcpimpact.plotting.pivots:plot_trace")(solution.trace, plot_trace)
        lines += [f"  drew        {plot_trace}"]
    print_answer(
        lines,
        lambda: {
            "problem": problem.name,
            "solver": solution.solver,
            "route": solution.route,
            "status": solution.status,
            "success": solution.success,
            "message": solution.message,
            "residual": solution.residual,
            "iterations": solution.iterations,
            "z": solution.z,
            "w": solution.w,
            "ray": solution.ray,
            "files": [path for path in (out if solution.success else None, plot, plot_trace) if path is not None],
        },
    )
    if not solution.success:
        unwritten = f" ({str(out)!r} was not written)" if out is not None else ""
        raise FailureError(f"{problem.name} by {solution.solver}: {solution.message}{unwritten}", solution)


def _description(problem: LCPFile, solution: LCPSolution, side: list[str], lower: Array, upper: Array) -> list[str]:
    """Return the lines on the problem and its solution: z and w, or a proof that there is no solution."""
    from lcpimpact.trajectory import folded

    M, q = problem.M, problem.q
    facts = (
        f"  M           {M.storage}; {_properties(M)}",
        f"  bounds      {_bounds(lower, upper)}",
        f"  solver      {solution.explanation}",
        f"  status      {solution.message}",
    )
    return [
        f"LCP {problem.name} of order {M.n} by {solution.solver}: {solution.status.name.lower().replace('_', '-')}",
        *(part for fact in facts for part in folded(fact)),
        "",
        *(_answer(solution, side) if solution.ray is None else _infeasibility_proof(M, q, lower, upper, solution.ray)),
    ]


def _numbers(option: str, text: str, n: int) -> Array:
    try:
        values = np.array([float(each) for each in text.split(",")])
    except ValueError:
        values = np.empty(0)
    if len(values) not in (1, n):
        raise InputError(f"{option} {text!r} must be one number, or {n} separated by commas, as in {option} 0 or -inf")
    return np.array(np.broadcast_to(values, (n,)))


def _check_bases(lower: Array, upper: Array, *, max_bases: int = 3**10) -> None:
    # max_bases: maximum number of complementary bases to enumerate, which takes seconds.
    choices = np.where(lower == upper, 1.0, 1.0 + np.isfinite(lower) + np.isfinite(upper))
    if (count := float(np.exp(np.log(choices).sum()))) > max_bases * 1.001:
        raise InputError(
            f"--all enumerates every basis, and this LCP has {count:.2g}: leave it out for n > 15, or n > 10 with two bounds"
        )


def _properties(M: Delassus, *, max_examined_order: int = 2_000) -> str:
    """Describe the properties of M; the P-property may be undecided for more than ten rows.

    ``max_examined_order``: maximum order of a matrix whose properties are determined, by one or two factorisations.
    """
    from lcpimpact.lcp.operators import Property

    if M.n > max_examined_order:
        known = ", ".join(each.value for each in Property if each in M.tags)
        return f"{known or 'no property is declared'} (n > {max_examined_order}: others were not checked)"
    holds = {each: M.has(each) for each in Property}
    undecided = M.n > 10 and holds[Property.POSITIVE_DIAGONAL] and not (holds[Property.SYMMETRIC] or holds[Property.P])
    parts = [", ".join(each.value for each in Property if holds[each])]
    missing = [each.value for each in Property if not holds[each] and not (undecided and each is Property.P)]
    parts.append(f"not {', not '.join(missing)}" if missing else "")
    parts.append(f"whether {Property.P.value} is not known" if undecided else "")
    return "; ".join(part for part in parts if part)


def _bounds(lower: Array, upper: Array) -> str:
    unilateral = int(((lower == 0.0) & (upper == np.inf)).sum())
    free = int(((lower == -np.inf) & (upper == np.inf)).sum())
    other = len(lower) - unilateral - free
    counts = ((unilateral, "with z >= 0"), (free, "free"), (other, "between bounds"))
    if unilateral == len(lower):
        return "z >= 0"
    return ", ".join(f"{count} row{'s' if count > 1 else ''} {kind}" for count, kind in counts if count)


def _row_sides(solution: LCPSolution, q: Array, lower: Array, upper: Array) -> list[str]:
    """Return the position of z in each row; a solution with z at a bound and w = 0 is degenerate."""
    z, w = solution.z, solution.w
    tolerance = 1e-12 * float(np.abs(q).max())
    sides = []
    for i in range(len(z)):
        if lower[i] < z[i] < upper[i]:
            sides.append("between" if np.isfinite(lower[i]) or np.isfinite(upper[i]) else "free")
        else:
            bound = "lower" if z[i] <= lower[i] else "upper"
            sides.append(f"{bound}, w = 0" if abs(w[i]) <= tolerance else bound)
    return sides


def _answer(solution: LCPSolution, side: list[str]) -> Iterator[str]:
    yield f"{'row':>5} {'z':>14} {'w':>14}  side"
    for i in _shown_rows(len(solution.z)):
        yield (
            "  ..." if i is None else f"{i + 1:>5} {solution.z[i] + 0.0:>14.6g} {solution.w[i] + 0.0:>14.6g}  {side[i]}"
        )


def _shown_rows(n: int, *, max_rows: int = 20) -> Iterator[int | None]:
    """Yield the rows to print, with None for omitted ones.

    ``max_rows``: maximum number of rows printed; otherwise the first and the last ones.
    """
    if n <= max_rows:
        yield from range(n)
        return
    yield from range(max_rows // 2)
    yield None
    yield from range(n - max_rows // 2, n)


def _tableau(solution: LCPSolution, step: int) -> str:
    assert solution.trace is not None
    count = len(solution.trace)
    if not 1 <= step <= count:
        raise InputError(f"--tableau {step}: the trace has the steps 1 to {count}; see --trace")
    return solution.trace.tableau(step - 1)


def _infeasibility_proof(M: Delassus, q: Array, lower: Array, upper: Array, v: Array) -> Iterator[str]:
    """Yield the lines of the proof of infeasibility: an upper bound of w·v that contradicts the signs of w."""
    v = v / np.abs(v).max()
    full = M.array()
    c = full.T @ v
    c[np.abs(c) <= 1e-11 * np.abs(full).max()] = 0.0
    largest = float(q @ v) + sum(float(c[j] * (upper[j] if c[j] > 0.0 else lower[j])) for j in np.flatnonzero(c))
    yield f"{'row':>5} {'v':>14} {'Mᵀ v':>14} {'q':>14}"
    for i in _shown_rows(M.n):
        yield "  ..." if i is None else f"{i + 1:>5} {v[i]:>14.6g} {c[i]:>14.6g} {q[i]:>14.6g}"
    yield f"There is no solution: the signs of w require v·w >= 0, but v·w = (Mᵀ v)·z + q·v <= {largest:.6g} for all z."


def _all(M: Delassus, q: Array, lower: Array, upper: Array) -> Iterator[str]:
    from lcpimpact.lcp.solvers.enumeration import all_solutions

    found = all_solutions(M.array(), q, lower=lower, upper=upper)
    yield f"{len(found)} solution{'' if len(found) == 1 else 's'} at complementary bases"
    for number, z in enumerate(found, 1):
        yield f"{number:>5}  z = ({', '.join(f'{x:.6g}' for x in z)})"


def _write(path: Path, solution: LCPSolution, side: list[str]) -> None:
    z, w = solution.z, solution.w
    with whole_file(path) as part:
        if path.suffix == ".npz":
            with part.open("wb") as file:
                np.savez_compressed(
                    file, z=z, w=w, status=solution.status.name, residual=solution.residual,
                    iterations=solution.iterations, solver=solution.solver, route=np.array(solution.route),
                )  # fmt: skip
            return
        from lcpimpact.run_files import write_csv

        rows = zip(range(1, len(z) + 1), z.tolist(), w.tolist(), side, strict=True)
        write_csv(part, ["row", "z", "w", "side"], rows, DECIMAL.get())
