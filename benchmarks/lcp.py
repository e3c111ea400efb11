r"""LCP solvers beside each other: lcpimpact's, those of qpsolvers, and peers, on every family of test problems.

    python benchmarks/lcp.py [--classes spd,psd,...] [--sizes 1,4,16,64,256] [--solvers auto,lemke,...] [--instances 5]
                             [--budget SECONDS] [--goals yes|no|only] [--out lcp.csv] [--plot profile.svg]

First the goals, then for each family the median seconds of a call, with the answers that are wrong or missed, then the
sums. Every answer is judged here by its natural residual, and by nothing that the solver says of it. What cannot be
measured stays in the table, with the reason. The exit code is 1 if a solver of lcpimpact called a wrong answer solved,
and 0 otherwise, whatever the speed.
"""

from __future__ import annotations

import os

from conditions import print_conditions
from tiny import add_tiny

# Before NumPy is loaded: one thread for everyone.
os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1"))

import argparse
import csv
import sys
import tempfile
import time
import zlib
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING

import numpy as np
from lcp_contestants import Contestant, Instance, Ring, Siconos, Verdict, everyone
from lcp_families import FAMILIES, Family
from rich.console import Console
from rich.table import Table
from scipy.linalg.lapack import dposv

from lcpimpact.arrays import Array, Matrix, Vector
from lcpimpact.compiled import compiled
from lcpimpact.errors import InputError
from lcpimpact.files import check_output, whole_file
from lcpimpact.lcp.operators import Banded
from lcpimpact.lcp.solve import prepare_lcp, solve_lcp
from lcpimpact.lcp.solvers.closed_form import closed_form

if TYPE_CHECKING:
    from matplotlib.figure import Figure

WRONG = 1e-6
TURNS = 3
CURVES = 12
MARKERS = 9
STEPS = {1_000: 400, 10_000: 100, 100_000: 30, 1_000_000: 8}


# ---- the goals ------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Goal:
    """One line of the first table: a goal is a bound, as "<= 1.2"; without one the line is for comparison."""

    what: str
    value: float
    unit: str
    goal: str = ""

    @property
    def reached(self) -> str:
        """Whether the value keeps to the bound."""
        if not self.goal:
            return ""
        return "yes" if self.value <= float(self.goal.removeprefix("<= ")) else "no"


def seconds_of(calls: Mapping[str, Callable[[], object]], repeats: int) -> dict[str, float]:
    """Let the calls take turns, and return their medians; the first turn warms up."""
    samples = defaultdict(list)
    for _ in range(repeats + 1):
        for name, call in calls.items():
            began = time.perf_counter()
            call()
            samples[name].append(time.perf_counter() - began)
    return {name: median(values[1:]) for name, values in samples.items()}


def dense_goals(rng: np.random.Generator) -> Iterator[Goal]:
    """Compare the whole of solve_lcp with one Cholesky solution, on SPD problems."""
    for n, goal, repeats in ((64, 2.0, 100), (256, 1.2, 30), (1000, 1.2, 5)):
        both = defaultdict(list)
        for _ in range(5):
            case = FAMILIES["spd"].make(n, rng)
            M, q = Instance.of(case).full, case.q
            columns, b = np.asfortranarray(M), -q
            calls = {"solve_lcp": partial(solve_lcp, M, q), "dposv": partial(dposv, columns, b)}
            found = seconds_of(calls, repeats)
            for name, seconds in found.items():
                both[name].append(seconds)
        total, floor = median(both["solve_lcp"]), median(both["dposv"])
        yield Goal(
            f"solve_lcp over dposv, SPD, n = {n} ({si(total)} over {si(floor)})", total / floor, "", f"<= {goal}"
        )


def small_goals(rng: np.random.Generator) -> Iterator[Goal]:
    """Time the checked Python call, and the kernel inside compiled code, for few rows."""
    for n in (1, 2, 4, 8):
        case = FAMILIES["spd"].make(n, rng)
        prepared, right = prepare_lcp(case.M, tags=case.tags), rng.normal(size=(500, n))
        samples = []
        for q in right:
            began = time.perf_counter()
            prepared.solve(q)
            samples.append(time.perf_counter() - began)
        yield Goal(f"checked Python call, n = {n}", 1e6 * median(samples), "µs", "<= 5")
    for n in (1, 2):
        case = FAMILIES["spd"].make(n, rng)
        right = rng.normal(size=(200_000, n))
        lower, upper, z = np.zeros(n), np.full(n, np.inf), np.zeros(n)
        M = Instance.of(case).full
        found = seconds_of({"loop": partial(compiled_loop, M, right, lower, upper, z)}, 5)
        yield Goal(f"inside compiled code, n = {n}", 1e9 * found["loop"] / len(right), "ns", "<= 30")


@compiled()
def compiled_loop(M: Matrix, right: Matrix, lower: Vector, upper: Vector, z: Vector) -> float:
    """Solve one problem for each row of ``right``, from compiled code, and return the sum of the answers."""
    q, found = np.empty(len(z)), 0.0
    for k in range(len(right)):
        for i in range(len(z)):
            q[i] = right[k, i]
        closed_form(M, q, lower, upper, z, 1e-12, 9)
        found += z[0]
    return found


def chain_goals(rng: np.random.Generator) -> Iterator[Goal]:
    """Step chains of growing length in time."""
    found = {n: stack_steps(n, steps, rng) for n, steps in STEPS.items()}
    for n, (seconds, unsolved) in found.items():
        yield Goal(f"chain of {n:,} contacts, a step", 1e6 * seconds, "µs", "<= 20" if n == min(found) else "")
        yield Goal(f"chain of {n:,} contacts, steps not solved of {STEPS[n]}", unsolved, "", "<= 0")
    first, last = min(found), max(found)
    power = np.log(found[last][0] / found[first][0]) / np.log(last / first)
    yield Goal(f"chains: power of n that a step grows with from {first:,} to {last:,}", float(power), "", "<= 1.1")


def stack_steps(n: int, steps: int, rng: np.random.Generator) -> tuple[float, int]:
    """Return the median seconds of the LCP of a step of n bodies stacked on a vibrating table, and how many were not solved.

    In the step, y are the velocities without contact, g the gaps, q_i = y_i - y_{i-1} + g_i / h; then
    v_i = y_i + (z_i - z_{i+1}) / m_i. Each step starts from the answer of the last one. At three times its weight the
    table throws the stack, which flies, lands and is compacted.
    """
    gravity, h, omega, acceleration = 9.81, 1e-3, 2.0 * np.pi * 20.0, 3.0
    m = 10.0 ** rng.uniform(-0.5, 0.5, n)
    c = 1.0 / m
    # The solver that auto takes for bands, by its name, so that a step that fails does not go on to a dense matrix.
    prepared = prepare_lcp(Banded([c + np.append(0.0, c[:-1]), -c], ["psd", "p", "positive_diagonal"]), "banded")
    table = acceleration * gravity / omega**2 * np.sin(omega * h * np.arange(steps + 1))
    x, v, z = np.zeros(n), 0.01 * rng.normal(size=n), np.zeros(n)
    samples, unsolved = [], 0
    for k in range(steps):
        y = v - h * gravity
        gap = np.diff(x, prepend=table[k])
        q = np.diff(y, prepend=(table[k + 1] - table[k]) / h) + gap / h
        began = time.perf_counter()
        solution = prepared.solve(q, z0=z, max_iter=20, throw=False)
        samples.append(time.perf_counter() - began)
        unsolved += not solution.success
        z = solution.z
        v = y + (z - np.append(z[1:], 0.0)) / m
        x += h * v
    return median(samples), unsolved


def warm_goals(rng: np.random.Generator) -> Iterator[Goal]:
    """Follow a slowly changing q, and count the factorisations of the steps that keep their free rows."""
    n, steps = 64, 200
    case = FAMILIES["spd"].make(n, rng)
    prepared, turning = prepare_lcp(case.M, tags=case.tags), rng.normal(size=n)
    before = prepared.solve(case.q)
    kept = []
    cold, warm = [], []
    for k in range(steps):
        q = case.q + 0.2 * np.sin(2.0 * np.pi * k / steps) * turning
        began = time.perf_counter()
        prepared.solve(q)
        middle = time.perf_counter()
        after = prepared.solve(q, z0=before.z)
        cold.append(middle - began)
        warm.append(time.perf_counter() - middle)
        if ((before.z > 0.0) == (after.z > 0.0)).all():
            kept.append(after.iterations)
        before = after
    what = f"warm start, SPD, n = {n}: factorisations, most of {len(kept)} of {steps} steps that keep their free rows"
    yield Goal(what, max(kept, default=steps), "", "<= 1")
    yield Goal(f"warm start, SPD, n = {n}: seconds over those of a cold start", median(warm) / median(cold), "")


def goals(seed: int) -> list[Goal]:
    """Measure what there are goals for."""
    rng = np.random.default_rng(seed)
    return [goal for part in (dense_goals, small_goals, chain_goals, warm_goals) for goal in part(rng)]


# ---- the comparison -------------------------------------------------------------------------------------------------


def residuals(instance: Instance, z: Array) -> tuple[float, float]:
    """Return ‖z - P(z - w)‖_inf over max(1, ‖q‖_inf), and the same in units where max |M| = max |q| = 1."""
    M, q = instance.full, instance.case.q
    s, p = np.abs(M).max() or 1.0, np.abs(q).max() or 1.0

    def natural(a: float, b: float) -> float:
        x, w = a * z, b * (M @ z + q)
        # In this form of x - P(x - w), a large x does not swallow w.
        return float(np.abs(np.maximum(np.minimum(w, x - a * instance.lower), x - a * instance.upper)).max())

    with np.errstate(all="ignore"):
        found = natural(1.0, 1.0) / max(1.0, p), natural(s / p, 1.0 / p)
    return found if np.isfinite(found).all() else (np.inf, np.inf)


@dataclass
class Cell:
    """One contestant on one family and order.

    Attributes
    ----------
    seconds : list of float         median of a call, for each instance
    preparing : list of float       what was done beforehand, for each instance
    natural, scaled : float         worst residuals of the answers that were called solved
    solved : int                    how many were called solved
    wrong : int                     of those: how many have a scaled residual above WRONG
    missed : int                    how many were not called solved, though there is a solution
    undecided : int                 how many ended without saying that there is no solution, where there is none
    right : list of bool            for each instance, whether what was said of it is true
    reason : str                    why there is nothing, or no more
    """

    family: str
    n: int
    contestant: str
    seconds: list[float] = field(default_factory=list)
    preparing: list[float] = field(default_factory=list)
    natural: float = 0.0
    scaled: float = 0.0
    solved: int = 0
    wrong: int = 0
    missed: int = 0
    undecided: int = 0
    right: list[bool] = field(default_factory=list)
    spent: float = 0.0
    reason: str = ""

    def judge(self, instance: Instance, z: Array | None, verdict: Verdict, solvable: bool) -> None:
        """Count an answer."""
        scaled = np.inf
        if verdict is Verdict.SOLVED:
            natural, scaled = (np.inf, np.inf) if z is None else residuals(instance, z)
            self.natural, self.scaled = max(self.natural, natural), max(self.scaled, scaled)
            self.solved += 1
            self.wrong += scaled > WRONG
        elif solvable:
            self.missed += 1
        else:
            self.undecided += verdict is Verdict.FAILED
        self.right.append(scaled <= WRONG if solvable else verdict is Verdict.NONE)


def draw(family: Family, n: int, instances: int, seed: int) -> list[Instance]:
    """Return instances that do not depend on what else is measured; one where the family is a formula."""
    found: list[Instance] = []
    for k in range(instances):
        case = family.make(n, np.random.default_rng([seed, zlib.crc32(family.name.encode()), n, k]))
        if found and np.array_equal(case.q, found[0].case.q):
            break
        found.append(Instance.of(case))
    return found


def stage(
    family: Family,
    n: int,
    contestants: list[Contestant],
    reasons: dict[str, str],
    ring: Ring,
    options: argparse.Namespace,
) -> list[Cell]:
    """Let the contestants take turns on the instances of one order; who has overdrawn the budget gets no more of them."""
    instances = draw(family, n, options.instances, options.seed)
    order = len(instances[0].case.q)
    cells = {each.name: Cell(family.name, order, each.name, reason=reasons.get(each.name, "")) for each in contestants}
    judged = {each.name for each in contestants if each.kind != "floor"}
    for k, instance in enumerate(instances):
        samples = defaultdict(list)
        playing = [cell for cell in cells.values() if not cell.reason]
        for turn in range(TURNS):
            for cell in playing:
                if cell.reason or (turn > 0 and cell.spent > options.budget):
                    continue
                reply = ring.turn(instance, cell.contestant)
                cell.spent += reply.spent
                cell.reason = reply.reason
                if reply.turn is None:
                    continue
                samples[cell.contestant].append(reply.turn.seconds)
                if turn == 0:
                    cell.preparing.append(reply.preparing)
                    if cell.contestant in judged:
                        cell.judge(instance, reply.turn.z, reply.turn.verdict, family.solvable)
        for name, values in samples.items():
            cell = cells[name]
            cell.seconds.append(median(values))
            if cell.spent > options.budget and k + 1 < len(instances) and not cell.reason:
                cell.reason = f"{k + 1} of {len(instances)} instances within {options.budget:g} s"
    return list(cells.values())


def compare(
    contestants: list[Contestant], missing: dict[str, str], ring: Ring, options: argparse.Namespace
) -> Iterator[list[Cell]]:
    """Yield the cells of one family after another; sizes above one that overdrew the budget are left out."""
    for name in options.classes:
        family, cells, reasons = FAMILIES[name], [], dict(missing)
        for n in options.sizes:
            if not family.has_order(n):
                continue
            found = stage(family, n, contestants, reasons, ring, options)
            if found[0].n in {cell.n for cell in cells}:
                continue  # two sizes that the family rounds to one order
            cells += found
            for cell in found:
                if cell.spent > options.budget:
                    reasons[cell.contestant] = f"n = {cell.n} took more than {options.budget:g} s"
        if cells:
            yield cells


# ---- tables ---------------------------------------------------------------------------------------------------------


def si(seconds: float) -> str:
    """Return seconds with three digits and a unit."""
    for unit, size in (("s", 1.0), ("ms", 1e-3), ("µs", 1e-6)):
        if seconds >= 0.9995 * size:
            return f"{seconds / size:.3g} {unit}"
    return f"{seconds / 1e-9:.3g} ns"


def text(cell: Cell | None) -> str:
    """Return the median time, and what went wrong."""
    if cell is None or not cell.seconds:
        return "-"
    notes = [f"[red]{cell.wrong} wrong[/]"] if cell.wrong else []
    notes += [f"[yellow]{cell.missed} missed[/]"] if cell.missed else []
    notes += [f"{cell.undecided} undecided"] if cell.undecided else []
    return " ".join([si(median(cell.seconds)), *notes])


def goal_table(title: str, rows: list[Goal]) -> Table:
    """Return the goals."""
    drawn = Table("what", "measured", "goal", "reached", title=title, title_justify="left")
    for row in rows:
        bound = f"{row.goal} {row.unit}".strip() if row.goal else ""
        drawn.add_row(row.what, f"{row.value:.4g} {row.unit}".strip(), bound, row.reached)
    return drawn


def family_table(cells: list[Cell], contestants: list[Contestant]) -> Table:
    """Return one row for each contestant that took a problem of the family, and the reasons of the others below."""
    family = FAMILIES[cells[0].family]
    orders = sorted({cell.n for cell in cells})
    by = {(cell.contestant, cell.n): cell for cell in cells}
    drawn = Table(title=f"{family.name}: {family.summary}", title_justify="left", caption_justify="left")
    drawn.add_column("solver", no_wrap=True)
    for n in orders:
        drawn.add_column(f"n = {n}")
    drawn.add_column("residual, scaled")
    drawn.add_column("residual")
    reasons = defaultdict(list)
    for each in contestants:
        row = [by[each.name, n] for n in orders]
        for cell in row:
            if cell.reason and (not cell.seconds or cell.n == orders[-1]):
                start = "" if cell.n == orders[0] or cell.seconds else f" (from n = {cell.n})"
                reasons[cell.reason].append(each.name + start)
                break
        if any(cell.seconds for cell in row):
            judged = any(cell.solved for cell in row)
            worst = [f"{max(c.scaled for c in row):.1e}", f"{max(c.natural for c in row):.1e}"] if judged else ["", ""]
            drawn.add_row(each.name, *map(text, row), *worst)
    drawn.caption = "\n".join(f"{reason}: {', '.join(names)}" for reason, names in reasons.items()) or None
    return drawn


def sum_table(cells: list[Cell], contestants: list[Contestant], missing: dict[str, str]) -> Table:
    """Return the sums over families and orders."""
    sums = ("wrong", "missed", "undecided")
    columns = ("solver", "how it was called", "problems", "right", *sums, "residual, scaled")
    drawn = Table(*columns, title="All families", title_justify="left")
    for each in contestants:
        mine = [cell for cell in cells if cell.contestant == each.name and cell.right]
        if not mine:
            drawn.add_row(each.name, missing.get(each.name, each.how), *["-"] * 6)
            continue
        verdicts = [right for cell in mine for right in cell.right]
        counts = [len(verdicts), sum(verdicts), *(sum(getattr(cell, name) for cell in mine) for name in sums)]
        worst = f"{max(cell.scaled for cell in mine):.1e}" if any(cell.solved for cell in mine) else "-"
        drawn.add_row(each.name, each.how, *map(str, counts), worst)
    return drawn


def write(path: Path, cells: list[Cell]) -> None:
    """Write one row for each cell; the file appears whole or not at all."""
    lists = ("seconds", "preparing", "right")
    with whole_file(path) as part, part.open("w", newline="", encoding="utf-8") as file:
        names = [name for name in Cell.__dataclass_fields__ if name != "right"]
        writer = csv.DictWriter(file, ["instances", *names])
        writer.writeheader()
        for cell in cells:
            row = {key: value for key, value in asdict(cell).items() if key not in lists}
            medians = {key: median(values) for key in lists[:2] if (values := getattr(cell, key))}
            writer.writerow({"instances": len(cell.seconds), **row, **medians})


# ---- the performance profile ----------------------------------------------------------------------------------------


def profiles(cells: list[Cell], contestants: list[Contestant]) -> dict[str, Array]:
    """Return for each contestant its time over the best, on each problem that somebody solved; inf where it did not."""
    problems: dict[tuple[str, int, int], dict[str, float]] = defaultdict(dict)
    for cell in cells:
        if FAMILIES[cell.family].solvable:
            for k, seconds in enumerate(cell.seconds):
                if k < len(cell.right) and cell.right[k]:
                    problems[cell.family, cell.n, k][cell.contestant] = seconds
    solved = [times for times in problems.values() if times]
    best = np.array([min(times.values()) for times in solved])
    return {
        each.name: np.array([times.get(each.name, np.inf) for times in solved]) / best
        for each in contestants
        if each.kind != "floor" and any(each.name in times for times in solved)
    }


def best_curves(curves: dict[str, Array], own: set[str]) -> tuple[list[str], list[str]]:
    """Return the best curves of lcpimpact, and the best others: that of each package first."""
    ranked = sorted(curves, key=lambda name: -curves[name].mean())
    inside = [name for name in ranked if name in own][: CURVES // 2]
    others = [name for name in ranked if name not in own]
    first = {name.split(":")[0]: name for name in reversed(others)}
    outside = sorted(others, key=lambda name: name not in first.values())[: CURVES - len(inside)]
    return inside, sorted(outside, key=ranked.index)


def plot(path: Path, cells: list[Cell], contestants: list[Contestant]) -> None:
    """Draw the performance profile of Dolan and Moré for the best solvers of lcpimpact and the best others."""
    from lcpimpact.plotting.style import save

    found = profiles(cells, contestants)
    tau = np.geomspace(1.0, 2.0**14, 500)
    curves = {name: np.array([(ratios <= t).mean() for t in tau]) for name, ratios in found.items()}
    inside, outside = best_curves(curves, {each.name for each in contestants if each.kind == "lcpimpact"})
    last = max(ratios[np.isfinite(ratios)].max() for ratios in (found[name] for name in (*inside, *outside)))
    end = min(max(2.0 ** np.ceil(np.log2(last)), 2.0), tau[-1])
    count = len(next(iter(found.values())))
    title = f"{count} problems of {len({cell.family for cell in cells})} families, each solved by someone"
    best = ({name: curves[name] for name in chosen} for chosen in (inside, outside))
    save(draw_profile(tau, *best, end, title), path)


def draw_profile(
    tau: Array, inside: Mapping[str, Array], outside: Mapping[str, Array], end: float, title: str
) -> Figure:
    """Draw curves over tau: those of lcpimpact full, and the others dashed, each with its own marker."""
    from matplotlib.figure import Figure
    from matplotlib.ticker import FuncFormatter

    from lcpimpact.plotting.style import PALETTE, style

    with style():
        figure = Figure(figsize=(9.0, 4.6), layout="constrained")
        axes = figure.add_subplot()
        every = max(1, np.searchsorted(tau, end) // MARKERS)
        for curves, line, ground in ((inside, "-", None), (outside, "--", "white")):
            for i, (name, colour, marker) in enumerate(zip(curves, PALETTE, "osD^vP*", strict=False)):
                axes.step(
                    tau, curves[name], line, where="post", color=colour, label=name, marker=marker, markersize=5.0,
                    markerfacecolor=ground or colour, markevery=(i * every // len(curves), every),
                )  # fmt: skip
        axes.set_xscale("log", base=2)
        axes.xaxis.set_major_formatter(FuncFormatter(lambda t, _: f"{t:g}"))
        axes.set(xlim=(1.0, end), ylim=(0.0, 1.02))
        axes.set_xlabel("factor over the fastest on each problem")
        axes.set_ylabel("fraction of the problems solved")
        axes.set_title(title)
        figure.legend(loc="outside right center", title="full: lcpimpact\ndashed: others", alignment="left")
    return figure


# ---- the command ----------------------------------------------------------------------------------------------------


def names(text: str) -> list[str]:
    """Read "a,b,c"."""
    return [each.strip() for each in text.split(",") if each.strip()]


def arguments() -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--classes", type=names, default=list(FAMILIES), help="families, with commas between")
    parser.add_argument("--sizes", type=names, default=["1", "4", "16", "64", "256"], help="orders n")
    parser.add_argument("--solvers", type=names, help="contestants; all if not given")
    parser.add_argument("--instances", type=int, default=5, help="problems of each family and order")
    parser.add_argument("--budget", type=float, default=0.2, help="seconds for each solver, family and order")
    parser.add_argument("--goals", choices=("yes", "no", "only"), default="yes", help="whether to measure the goals")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path, help="write the figures to a .csv file")
    add_tiny(parser, classes=list(FAMILIES)[:2], sizes=["4"], instances=1, budget=1e-3, goals="no")
    parser.add_argument("--plot", type=Path, help="draw the performance profile: .svg, .png or .pdf")
    options = parser.parse_args()
    unknown = [name for name in options.classes if name not in FAMILIES]
    if unknown:
        parser.error(f"--classes: unknown {', '.join(unknown)}; known are {', '.join(FAMILIES)}")
    if not all(size.isdecimal() and int(size) > 0 for size in options.sizes):
        parser.error("--sizes must be whole numbers above zero, with commas between")
    options.sizes = sorted({int(size) for size in options.sizes})
    if options.instances < 1 or not options.budget > 0.0:
        parser.error("--instances must be at least 1, and --budget above zero")
    for path, endings in ((options.out, [".csv"]), (options.plot, [".svg", ".png", ".pdf"])):
        if path is not None:
            try:
                check_output(path, endings)
            except InputError as error:
                parser.error(str(error))
    return options


def chosen(contestants: list[Contestant], wanted: list[str] | None) -> list[Contestant]:
    """Return those that are wanted, or stop with a message."""
    known = [each.name for each in contestants]
    unknown = [name for name in wanted or [] if name not in known]
    if unknown:
        sys.exit(f"--solvers: unknown {', '.join(unknown)}; known are {', '.join(known)}")
    return [each for each in contestants if wanted is None or each.name in wanted]


def main() -> int:
    """Measure, print, and return the exit code."""
    options = arguments()
    print_conditions()
    out = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # OSQP prints whatever it is told
    console = Console(file=out, width=None if out.isatty() else 170)
    if options.goals != "no":
        console.print(goal_table("Goals, medians", goals(options.seed)))
        console.print()
    if options.goals == "only":
        return 0

    with tempfile.TemporaryDirectory() as folder:
        ring = Ring(Path(folder))
        try:
            return run(console, ring, options)
        finally:
            ring.stop()


def run(console: Console, ring: Ring, options: argparse.Namespace) -> int:
    """Compare, print and write."""
    contestants = chosen(everyone(Siconos(ring.folder)), options.solvers)
    missing = {each.name: reason for each in contestants if (reason := ring.load(each.name))}
    cells: list[Cell] = []
    for found in compare(contestants, missing, ring, options):
        console.print(family_table(found, contestants))
        console.print()
        cells += found
    if not cells:
        sys.exit("no family has a problem of these orders")
    console.print(sum_table(cells, contestants, missing))
    own = {each.name for each in contestants if each.kind in ("lcpimpact", "qpsolvers")}
    wrong = sum(cell.wrong for cell in cells if cell.contestant in own)
    missed = sum(cell.missed for cell in cells if cell.contestant == "auto")
    last = [Goal("wrong answers called solved by lcpimpact", wrong, "", "<= 0"), Goal("missed by auto", missed, "")]
    console.print(goal_table("Goals, answers", last))
    if options.out is not None:
        write(options.out, cells)
    if options.plot is not None:
        plot(options.plot, cells, contestants)
    return 1 if wrong else 0


if __name__ == "__main__":
    os.environ.setdefault("LCPIMPACT_COMPILE", "first")  # compiled code is measured
    sys.exit(main())
