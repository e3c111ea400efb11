"""What the explorer costs: its size, its requests, and the answer to a slider with 10,000 steps, in headless Chromium.

    python benchmarks/explorer.py [--moves 30]
    python benchmarks/explorer.py --exact 6

For each problem and method the first slider is moved and the time of the event
taken: the run, the exact motion where it takes less than 4 ms and otherwise after the answer, the energy, and all drawing.
The exit code is 1 if the page has more than 145 kB or requests anything, and 0 otherwise, whatever the speed.

With ``--exact`` it compares the page's exact motion with the method `exact`, for so many sets of random values of all
sliders. An error is the largest of all coordinates and instants, relative to the largest coordinate. Beside it is how far
the page's motion moves if one number changes by one unit in its last place: no method knows it better than that.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
from chromium import Page, chromium, opened
from conditions import print_conditions
from rich.console import Console
from rich.table import Table
from tiny import add_tiny

from lcpimpact import LcpImpactError, explore, simulate, with_values
from lcpimpact.explorer.models import Model, why_not_exact
from lcpimpact.explorer.page import all_models, page

MOST_BYTES = 145_000

TIMED = """
const every = () => Object.entries(problems).flatMap(([name, {methods}]) => Object.keys(methods).map((method) => {
  choose(name);
  state.method = method;
  state.steps = 10000;
  show();
  const slider = document.querySelector("#sliders input[type=range]:enabled"), spent = [];
  for (let i = 0; i < MOVES; i++) {
    slider.value = 300 + 400 * i / MOVES;
    const since = performance.now();
    slider.dispatchEvent(new Event("input"));
    spent.push(performance.now() - since);
  }
  const since = performance.now();
  for (let i = 0; i < 5; i++) simulate(problem, method, run.values, state.tEnd, 10000);
  const alone = (performance.now() - since) / 5;
  spent.sort((a, b) => a - b);
  return [name, method, spent[MOVES >> 1], spent[MOVES - 1], alone];
}));
ready.then(every)
"""


def exactness(count: int) -> None:
    """Print how far the page's exact motion is from that of the method `exact`, and how well it is known at all."""
    found, refused = all_models()
    table, worst = Table("problem", "runs", "error", "by one unit in the last place"), 0.0
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "explorer.html")
        path.write_text(page(found, refused), encoding="utf-8")
        with opened(path.as_uri()) as browser:
            for each in found:
                if not why_not_exact(each.problem.dynamics):
                    runs = [
                        errors for values in random_values(each, count) if (errors := compare(browser, each, values))
                    ]
                    error, moved = map(max, zip(*runs, strict=True))
                    worst = max(worst, error)
                    table.add_row(each.problem.name, str(len(runs)), f"{error:.1e}", f"{moved:.1e}")
    Console().print(table, f"largest error: {worst:.1e}")


def random_values(found: Model, count: int) -> list[dict[str, float]]:
    """Return the values of a problem, and random ones of all sliders."""
    rng, first = np.random.default_rng(1), {"theta": 0.5, **found.numbers}
    others = [{each.name: rng.uniform(each.low, each.high) for each in found.sliders} for _ in range(count - 1)]
    return [first, *(first | each for each in others)]


def compare(browser: Page, found: Model, values: dict[str, float]) -> tuple[float, float] | None:
    """Return the error of the page's motion, and by how much it moves; None where Python refuses the values."""
    problem = with_values(found.problem, {name: values[name] for name in found.numbers})
    try:
        run = simulate(problem, "exact", dt=found.t_end / 200, t_end=found.t_end, progress=False)
    except LcpImpactError:
        return None
    changed = [{**values, name: float(np.nextafter(values[name], s))} for name in found.numbers for s in (-9e99, 9e99)]
    source = "ready.then(() => JOBS.map((values) => exactMotion(problems[NAME], values, TIMES).q))"
    jobs: dict[str, Any] = {"JOBS": [values, *changed], "NAME": found.problem.name, "TIMES": run.t.tolist()}
    for name, value in jobs.items():
        source = source.replace(name, json.dumps(value))
    motions = [np.array(each).reshape(-1, run.q.shape[1]) for each in browser.value(source)]
    known, size = min(map(len, motions)), np.abs(run.q).max() or 1.0
    first, *others = (each[:known] for each in motions)
    moved = max(np.abs(each - first).max(initial=0.0) for each in others)
    return float(np.abs(first - run.q[:known]).max(initial=0.0) / size), float(moved / size)


def main() -> int:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--moves", type=int, default=30, help="moves of the slider for each method")
    parser.add_argument("--exact", type=int, metavar="SETS", help="compare the exact motion instead")
    add_tiny(parser, moves=1)
    given = parser.parse_args()
    if chromium() is None:
        print("skipped: Chromium is not installed (apt-get install chromium)")
        return 0
    print_conditions()
    if given.exact:
        exactness(given.exact)
        return 0
    moves = given.moves
    with tempfile.TemporaryDirectory() as folder:
        path = explore(path=Path(folder, "explorer.html"))
        size = path.stat().st_size
        with opened(path.as_uri()) as browser:
            rows = browser.value(TIMED.replace("MOVES", str(moves)))
            requests = len(browser.requests) - 1
    table = Table("problem", "method", "median ms", "worst ms", "the run alone, ms")
    for name, method, *times in rows:
        table.add_row(name, method, *(f"{each:.1f}" for each in times))
    console = Console()
    console.print(table)
    middle = [each[2] for each in rows]
    console.print(
        f"{size} bytes, {requests} requests; medians of {median(middle):.1f} ms, at most {max(middle):.1f} ms"
    )
    return int(size > MOST_BYTES or requests > 0)


if __name__ == "__main__":
    sys.exit(main())
