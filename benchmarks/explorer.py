"""What the explorer costs: its size, its requests, and the answer to a slider with 10,000 steps, in headless Chromium.

    python benchmarks/explorer.py [--moves 30]

For each problem and method, the first slider is moved and the time of the event taken: the run, the exact motion where it
takes less than 4 ms and otherwise after the answer, the energy, and all drawing. The exit code is 1 if the page has more
than 150 kB or requests anything, and 0 otherwise, whatever the speed.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path
from statistics import median

from chromium import opened
from rich.console import Console
from rich.table import Table

from lcpimpact import explore

MOST_BYTES = 150_000

TIMED = """
ready.then(() => Object.entries(problems).flatMap(([name, {methods}]) => Object.keys(methods).map((method) => {
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
})))
"""


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--moves", type=int, default=30, help="moves of the slider for each method")
    moves = parser.parse_args().moves
    with tempfile.TemporaryDirectory() as folder:
        path = explore(path=Path(folder, "explorer.html"))
        size = path.stat().st_size
        with opened(path.as_uri()) as page:
            rows = page.value(TIMED.replace("MOVES", str(moves)))
            requests = len(page.requests) - 1
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
