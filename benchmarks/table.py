r"""The public table: methods x problems x norms, as CSV and as a page of the documentation.

    python benchmarks/table.py [--workers 2] [--problems system-1,...] [--methods rk4,...] [--csv FILE] [--page FILE]

Each method runs each problem with step counts that suit its order. The slope of log error against log dt is fitted in every
norm, with its scatter, and put beside what the method declares. Then every method runs with step counts from coarse to fine
(with tolerances, where it chooses its steps). From the lower envelope of error against cost are read, between neighbours in
log-log, the error at a fixed cost and the cost at a fixed error, counted in right sides and in seconds.

The exit code is 1 if an order lies outside the band about the declared one: 0.2 in smooth motion, 0.35 with events. What a
method refuses, and what fails, is a row with its reason.

The tables are in docs/benchmarks/table.md; benchmarks/table.csv has every number. The first line of the CSV says when
and with what they were made.
"""

from __future__ import annotations

import argparse
import math
import os
import platform
import sys
import time
import warnings
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from datetime import date
from io import StringIO
from pathlib import Path

import numpy as np
import pandas as pd
from conditions import print_conditions, processor
from tiny import add_tiny

import lcpimpact as li
from lcpimpact.files import whole_file
from lcpimpact.integrators import METHODS
from lcpimpact.integrators.event_driven import EventDriven
from lcpimpact.study.accuracy.convergence import Convergence, convergence, observed_orders, work_precision
from lcpimpact.study.accuracy.fitted_order import EVENT_BAND, SMOOTH_BAND
from lcpimpact.study.accuracy.norms import NORMS
from lcpimpact.study.accuracy.orders import COARSER_COUNTS, COUNTS
from lcpimpact.study.accuracy.reference import reference

CSV = Path(__file__).parent / "table.csv"
PAGE = Path(__file__).parent.parent / "docs" / "benchmarks" / "table.md"

MANY = tuple(round(307 * 1.25**i) for i in range(18))
"""Step counts of methods up to order 2, each raised to a prime. There are many, since the errors of a method that does not
know its switches are as scattered as the places of these in their steps."""

COARSE_TO_FINE = (31, 101, 307, 1009, 3089, 10007, 31223)
"""Step counts over which costs are read."""

RTOLS = (1e-3, 1e-5, 1e-7, 1e-9, 1e-11)

REPEATS = 3

RIGHT_SIDES, SECONDS, RELATIVE = 3000.0, 0.02, 1e-3
"""The fixed costs, and the fixed error relative to the scale of the norm."""

SHOWN = ("sup_q", "l1_v", "l2_v", "hausdorff_v", "event_times", "energy")
"""The norms of the page; the CSV has all."""


def chain() -> li.Problem:
    """Two masses, three springs, two dashpots and a shaker: smooth for ever."""
    scheme = li.Scheme(
        li.Mass("a", 1.0), li.Mass("b", 2.0), li.Spring("a", "ground", 40.0), li.Spring("a", "b", 60.0),
        li.Dashpot("a", "b", 0.3), li.Dashpot("b", "ground", 0.2), li.Load("b", li.Harmonic(5.0, 3.0)),
    )  # fmt: skip
    return li.Problem("chain", scheme, q0={"a": 0.2}, v0={"b": 1.0}, t_end=3.0)


def stiff_chain() -> li.Problem:
    """A mass on a soft spring, with a light one on it by a spring and a dashpot 100 times as stiff."""
    scheme = li.Scheme(
        li.Mass("a", 1.0), li.Mass("b", 0.01), li.Spring("a", "ground", 40.0), li.Spring("a", "b", 4e3),
        li.Dashpot("a", "b", 40.0),
    )  # fmt: skip
    return li.Problem("stiff chain", scheme, q0={"a": 0.2, "b": 0.2}, t_end=3.0)


def lumped_bar(n: int = 4) -> li.Problem:
    """A bar of lumped masses that falls on the ground: the first mass stops there at each arrival of a wave."""
    elements: list[object] = []
    for i in range(n):
        elements += [li.Mass(f"b{i}", 1.0 / n), li.Load(f"b{i}", 10.0 / n)]
        if i:
            elements.append(li.Spring(f"b{i - 1}", f"b{i}", 9.0 * n))
    scheme = li.Scheme(*elements, li.Bumper(f"b{n - 1}", "ground", gap=0.5, e=0.0))
    return li.Problem("lumped bar", scheme, t_end=1.1)


def named(title: str, name: str, t_end: float, **parameters: float) -> li.Problem:
    """Return a registered problem that ends at t_end, under a title of its own where rk4-paper does not know it."""
    found = li.load_problem(name, **parameters)
    name = found.name if name.startswith("system") else title
    return li.Problem(name, found.scheme, found.q0, found.v0, t_end, found.parameters)


PROBLEMS: dict[str, tuple[li.Problem, str]] = {
    "chain": (chain(), "smooth for ever: two masses on springs, shaken"),
    "stiff chain": (stiff_chain(), "smooth and stiff: steps of up to 40 times its shortest time constant"),
    "system-2": (named("system-2", "system-2", 3.0), "massless plate on a spring: force kinks"),
    "bouncing-bar": (named("bouncing-bar", "bouncing-bar", 2.0, elements=6.0), "force kinks, with waves in the bar"),
    "system-1": (named("system-1", "system-1", 3.0), "massless plate on a dashpot: force jumps"),
    "system-3": (named("system-3", "system-3", 3.0), "force jumps"),
    "system-3, c = 60": (named("system-3", "system-3", 3.0, c=60.0), "force jumps, with more damping"),
    "bouncing-ball": (named("bouncing-ball", "bouncing-ball", 2.5), "four impacts between parabolas"),
    "impact-oscillator": (named("impact-oscillator", "impact-oscillator", 10.0), "impacts of a forced oscillator"),
    "two-balls-spring": (named("two-balls-spring", "two-balls-spring", 0.5), "impacts of a body with a stiff spring"),
    "lumped bar": (lumped_bar(), "impacts with e = 0, and contact that lasts"),
    "bouncing-ball to rest": (
        named("bouncing-ball to rest", "bouncing-ball", 3.0, e=0.6),
        "infinitely many impacts in finite time, then rest",
    ),
    "coulomb-oscillator": (named("coulomb-oscillator", "coulomb-oscillator", 2.0), "dry friction: turns and stops"),
    "hertz-impact": (li.load_problem("hertz-impact"), "a compliant law, nothing rigid: nothing is declared for it"),
}


UNJUDGED = {
    "stiff chain": "explicit methods are unstable with the larger steps, and high orders fall to those of the stages: "
    "the orders are shown, and not judged"
}
"""Problems on which declared orders, which are for small steps, are not to be expected; and why."""


def counts_of(order: float) -> Iterator[tuple[int, ...]]:
    """Yield step counts that suit an order, the finest first."""
    yield from [MANY] if order <= 2.0 or math.isinf(order) else COARSER_COUNTS


def judged(title: str, method: str) -> pd.DataFrame:
    """Return the rows of one method on one problem: one for each norm."""
    warnings.simplefilter("ignore")
    problem, _ = PROBLEMS[title]
    end = problem.t_end
    chosen = EventDriven(rtol=1e-12) if method == "event-driven" else METHODS[method]()
    able = convergence(problem, {method: chosen}, [end / 307], norms=["sup_q"])
    order, failure = float(able["declared"].iloc[0]), str(able["failure"].iloc[0])
    norm = "sup_q" if able.limited_by is None else able.limited_by.norm
    truth = "auto" if failure else reference(problem, end, unlike=(method,))

    def observed(counts: Sequence[int], norms: Sequence[str]) -> tuple[Convergence, pd.DataFrame]:
        found = convergence(problem, {method: chosen}, [end / n for n in counts], norms=norms, reference=truth)
        return found, observed_orders(found)

    others = [name for name in NORMS if name != norm]
    for counts in counts_of(order if not math.isnan(order) else METHODS[method].declared.order_smooth):
        counts = counts[:3] if math.isinf(order) or failure else counts
        table, judged_here = observed(counts, [norm])
        if judged_here["verdict"].item() != "rounding":
            break
    elsewhere, orders_elsewhere = observed(counts[:: max(1, len(counts) // len(COUNTS))], others)
    orders = pd.concat([judged_here, orders_elsewhere], ignore_index=True)
    if title in UNJUDGED:
        orders["declared"] = math.nan
        orders["verdict"] = ["failed" if verdict == "failed" else "" for verdict in orders["verdict"]]
    costs = work_precision(
        problem, {method: METHODS[method]()}, [end / n for n in COARSE_TO_FINE], rtols=RTOLS, repeats=REPEATS,
        norms=[norm], reference=truth,
    )  # fmt: skip
    scales = {**table.scales, **elsewhere.scales}
    orders["scale"] = [scales.get(name, math.nan) for name in orders["norm"]]
    read = [_read(costs.table, norm, float(orders["scale"].iloc[0]))] + [{}] * len(others)
    found = pd.concat([orders.drop(columns=["law", "k"]), pd.DataFrame(read)], axis=1)
    found.insert(0, "problem", title)
    found["limited_by"] = "" if table.limited_by is None else table.limited_by.name
    found["declared_norm"] = "" if table.limited_by is None else table.limited_by.norm
    found["reference"] = table["reference"].iloc[0]
    reasons = dict.fromkeys(reason for reason in (*table["failure"], *costs["failure"]) if reason)
    found["failure"] = next(iter(reasons), "")
    return found


def _read(costs: pd.DataFrame, norm: str, scale: float) -> dict[str, float]:
    """Return the error at the fixed costs, and the costs at the fixed error; nan where a method does not reach it."""
    solved = costs[(costs["failure"] == "") & (costs[norm] > 0.0)]
    row: dict[str, float] = {}
    for cost, fixed in (("evaluations", RIGHT_SIDES), ("seconds", SECONDS)):
        points = solved[solved[cost] > 0].sort_values(cost)
        x, y = (np.log(points[name].to_numpy(dtype=float)) for name in (cost, norm))
        y = np.minimum.accumulate(y) if len(y) else y
        reached = len(x) > 0 and x[0] <= math.log(fixed)
        row[f"error_at_{cost}"] = math.exp(np.interp(math.log(fixed), x, y)) if reached else math.nan
        goal = math.log(RELATIVE * scale) if scale > 0.0 else -math.inf
        within = len(y) > 0 and y[-1] <= goal
        row[f"{cost}_at_error"] = math.exp(np.interp(-goal, -y, x)) if within else math.nan
    return row


def measure(titles: list[str], methods: list[str], workers: int) -> pd.DataFrame:
    """Return all rows, in the order of problems and methods."""
    jobs = [(title, method) for title in titles for method in methods]
    found: dict[tuple[str, str], pd.DataFrame] = {}
    with ProcessPoolExecutor(workers) as pool:
        futures = {pool.submit(judged, *job): job for job in jobs}
        for done in as_completed(futures):
            found[futures[done]] = done.result()
            print(f"\r{len(found)}/{len(jobs)} {' on '.join(reversed(futures[done])):<50}", end="", file=sys.stderr)
    print(file=sys.stderr)
    return pd.concat([found[job] for job in jobs], ignore_index=True)


def conditions(seconds: float, workers: int, versions: dict[str, str] | None = None) -> str:
    """Return with what, where and when a table was made; without versions, with those of what every table needs."""
    from importlib.metadata import version

    versions = versions or {name: version(name) for name in ("lcpimpact", "numpy", "scipy", "llvmlite")}
    packages = ", ".join(f"{name} {number}" for name, number in versions.items())
    processes = "1 process" if workers == 1 else f"{workers} processes"
    return (
        f"# {date.today().isoformat()}: {packages}, Python {platform.python_version()}, {processor()}, "
        f"{processes}, {seconds:.0f} s"
    )


def page(text: str) -> str:
    """Return the page of the documentation for the text of the CSV."""
    first, _, rest = text.partition("\n")
    table = pd.read_csv(StringIO(rest), keep_default_na=False, na_values={name: [""] for name in NUMBERS})
    titles, methods = list(dict.fromkeys(table["problem"])), list(dict.fromkeys(table["method"]))
    lines = [
        "# The table of methods and problems",
        "",
        f"Made by `python benchmarks/table.py` on {first.removeprefix('# ').replace(': ', ' with ', 1)}.",
        "[table.csv](../../benchmarks/table.csv) has every number, in all norms. A test compares this page with it.",
        "",
        "An order is the slope of log error against log dt by least squares over six step counts or more, which are primes",
        "and keep clear of the events; ± is the standard deviation of $\\log_{10}$ of the errors about the line.",
        f"It is *off* if it is further from what a method declares than {SMOOTH_BAND} in smooth motion, or {EVENT_BAND}",
        "with events. Methods declare their orders in $\\sup q$, and across impacts in the $L^1$ norm of $v$.",
        "*exact*: the errors are rounding, or what the reference leaves; *refused*: the method does not handle the problem,",
        "and says so before the first step; *unstable*: errors with the larger steps are beyond all bounds. The reference",
        "is `exact`, or an independent method for `exact` itself. [norms.md](../guide/norms.md) says what converges in",
        "which norm.",
        "",
        "## Observed orders, in the norm in which they are declared",
        "",
        "| method | " + " | ".join(titles) + " |",
        "|---|" + "---|" * len(titles),
    ]
    for method in methods:
        cells = []
        for title in titles:
            row = _row(table, title, method)
            told = row["verdict"] != "failed" and 0.0 < row["declared"] < math.inf
            cells.append(_order(row) + (f" ({row['declared']:g})" if told else ""))
        lines.append(f"| {method} | " + " | ".join(cells) + " |")
    off = table[table["verdict"] == "off"]
    lines += ["", "In brackets: the declared order.", ""]
    lines += [f"Off: {row.method} on {row.problem}, {row.order:.2f} for {row.declared:g}." for row in off.itertuples()]
    lines += [""] * bool(len(off))
    for title in titles:
        lines += _section(table[table["problem"] == title], title)
    return "\n".join(lines)


NUMBERS = (
    *("order", "scatter", "standard_error", "points", "rounding", "failed", "declared", "scale"),
    *("error_at_evaluations", "evaluations_at_error", "error_at_seconds", "seconds_at_error"),
)


def _row(table: pd.DataFrame, title: str, method: str) -> pd.Series:
    here = table[(table["problem"] == title) & (table["method"] == method)]
    declared = here[here["norm"] == here["declared_norm"]]
    return (declared if len(declared) else here).iloc[0]


def _order(row: pd.Series, without: str = "") -> str:
    """Return an order as the page shows it; a norm that has nothing to measure ``without`` events shows none."""
    if row["verdict"] == "failed":
        return "refused" if "handle" in row["failure"] or "knows only" in row["failure"] else "failed"
    if row["order"] != row["order"]:
        return "exact" if row["rounding"] and row["scale"] > 0.0 and row["limited_by"] != without else "-"
    if row["declared"] == math.inf:
        return "exact" if row["verdict"] == "as declared" else "off"
    if row["scatter"] > 1.0:
        return "unstable"
    said = f"{row['order']:.2f} ± {row['scatter']:.2f}"
    return f"**{said} off**" if row["verdict"] == "off" else said


def _section(table: pd.DataFrame, title: str) -> list[str]:
    _, what = PROBLEMS[title]
    norm = table["declared_norm"].iloc[0] or "sup_q"
    unit = NORMS[norm].unit
    scale = float(table.loc[table["norm"] == norm, "scale"].max())
    lines = [
        f"## {title}",
        "",
        f"{what[0].upper()}{what[1:]}. Orders in each norm; then, in {norm}, the error with {RIGHT_SIDES:g} right sides and",
        f"with {1e3 * SECONDS:g} ms, and what an error of {RELATIVE * scale:.1e} {unit} costs, {RELATIVE:g} of the scale.",
        "",
        "| method | declared | " + " | ".join(SHOWN) + f" | {norm} with {RIGHT_SIDES:g} | with {1e3 * SECONDS:g} ms "
        "| right sides | ms |",
        "|---|" + "---|" * (len(SHOWN) + 5),
    ]
    for method in dict.fromkeys(table["method"]):
        rows = table[table["method"] == method].set_index("norm")
        row = rows.loc[norm]
        if row["verdict"] == "failed":
            continue
        declared = "-" if row["declared"] != row["declared"] else f"{row['declared']:g}".replace("inf", "exact")
        cells = [
            method,
            declared,
            *(_order(rows.loc[name], "smooth" if name == "event_times" else "") for name in SHOWN),
        ]
        cells += [_number(row[name]) for name in ("error_at_evaluations", "error_at_seconds")]
        cells += [_number(row["evaluations_at_error"], ".0f"), _number(1e3 * row["seconds_at_error"], ".2g")]
        lines.append("| " + " | ".join(cells) + " |")
    lines.append("")
    if title in UNJUDGED:
        lines.append(f"- All: {UNJUDGED[title]}.")
    reasons = table.drop_duplicates("method").groupby("failure", sort=False)["method"]
    for reason, methods in reasons:
        if reason:
            lines += [f"- {', '.join(methods)}: {str(reason).split(': take method')[0]}"]
    return [*lines, ""]


def _number(value: float, form: str = ".1e") -> str:
    return "-" if value != value else format(value, form)


def main() -> int:
    """Measure, write the CSV and the page, and say which orders are off."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0] if __doc__ else "")
    parser.add_argument("--workers", type=int, default=min(2, os.cpu_count() or 1))
    parser.add_argument("--problems", default=",".join(title.replace(",", ";") for title in PROBLEMS))
    parser.add_argument("--methods", default=",".join(METHODS))
    parser.add_argument("--csv", type=Path, default=CSV)
    parser.add_argument("--page", type=Path, default=PAGE)
    add_tiny(parser, problems="bouncing-ball", methods="exact", workers=1, csv=None, page=None)
    chosen = parser.parse_args()
    print_conditions()
    began = time.perf_counter()
    titles = [each.replace(";", ",") for each in chosen.problems.split(",")]
    table = measure(titles, chosen.methods.split(","), chosen.workers)
    text = (
        conditions(time.perf_counter() - began, chosen.workers) + "\n" + table.to_csv(index=False, float_format="%.4g")
    )
    for path, content in ((chosen.csv, text), (chosen.page, page(text))):
        if path is not None:
            with whole_file(path) as part:
                part.write_text(content, encoding="utf-8")
    off = table[table["verdict"] == "off"]
    for row in off.itertuples():
        print(f"off: {row.method} on {row.problem}: {row.order:.2f} ± {row.scatter:.2f}, declared {row.declared:g}")
    seconds = time.perf_counter() - began
    print(f"{len(titles)} problems x {len(table['method'].unique())} methods in {seconds:.0f} s: {len(off)} orders off")
    return 1 if len(off) else 0


if __name__ == "__main__":
    os.environ.setdefault("LCPIMPACT_COMPILE", "first")  # compiled code is measured
    sys.exit(main())
