"""The runs of the page, in node: every number has the bits of `simulate`."""

from __future__ import annotations

import json
import shutil
import subprocess

import numpy as np
import pytest

from lcpimpact import load_problem, simulate
from lcpimpact.errors import UnsupportedError
from lcpimpact.explorer.javascript import PRELUDE, run_source
from lcpimpact.explorer.models import Model, model
from lcpimpact.problems import PROBLEMS
from lcpimpact.problems.parameters import with_values

STEPS = 400

NODE = """
const fs = require("node:fs");
const {jobs, sizes} = JSON.parse(fs.readFileSync(0, "utf8"));
const [n, nc, laws] = sizes, out = (N) => ({
  q: new Float64Array((N + 1) * n), v: new Float64Array((N + 1) * n), r: new Float64Array(N * nc),
  L: new Float64Array(N * nc * laws), z: new Float64Array(N * nc * laws), W: new Float64Array(laws * nc * nc),
});
const hex = (a) => Buffer.from(a.buffer).toString("hex");
console.log(JSON.stringify(jobs.map(({run, p, steps}) => {
  const o = out(steps), taken = RUNS[run](p, steps, o);
  return {taken, q: hex(o.q), v: hex(o.v), r: hex(o.r)};
})));
"""

needs_node = pytest.mark.skipif(shutil.which("node") is None, reason="node, which runs the page's code, is not installed")


def in_node(runs: list[str], jobs: list[dict], sizes: tuple[int, int, int]) -> list[dict]:
    """Return what runs give for the parameters of jobs."""
    script = f'"use strict";\n{PRELUDE}const RUNS = [{",".join(runs)}];\n{NODE}'
    given = json.dumps({"jobs": jobs, "sizes": sizes})
    found = subprocess.run(["node", "-e", script], input=given, capture_output=True, text=True, check=True, timeout=60)
    return json.loads(found.stdout)


def moved(found: Model, method: str, seed: int) -> dict[str, float]:
    """Return values of the sliders: the given ones for seed 0, and others at random."""
    rng = np.random.default_rng(seed)
    names = found.traces[method][0].names
    values = {"theta": 0.5, **found.numbers}
    if seed:
        values |= {each.name: rng.uniform(each.low, each.high) for each in found.sliders if each.name in names}
    return {name: values[name] for name in names}


def check(found: Model, seeds: range, steps: int = STEPS) -> int:
    """Compare the runs of all methods with `simulate`; return how many numbers were equal."""
    d = found.problem.dynamics
    equal = 0
    for method, traces in found.traces.items():
        laws = traces[0].run.writer.sizes[3]
        runs = [run_source(each.program, each.run) for each in traces]
        cases = [moved(found, method, seed) for seed in seeds]
        jobs = [
            {"run": i, "p": [*values.values(), found.t_end], "steps": steps} for values in cases for i in range(len(runs))
        ]
        results = in_node(runs, jobs, (len(d.nodes), len(d.contacts), laws))
        for k, values in enumerate(cases):
            here = results[k * len(runs) : (k + 1) * len(runs)]
            held = [each for each in here if each["taken"] >= 0]
            assert len(held) == (1 if held else 0) or len({each["q"] for each in held}) == 1
            if not held:
                assert k > 0, f"{method} does not hold its own values"
                continue
            options = {"theta": values["theta"]} if "theta" in values and "theta" not in found.numbers else {}
            numbers = {name: value for name, value in values.items() if name in found.numbers}
            run = simulate(
                with_values(found.problem, numbers), method, dt=found.t_end / steps, t_end=found.t_end,
                throw=False, progress=False, **options,
            )  # fmt: skip
            taken = held[0]["taken"]
            for name, ours, rows in (("q", run.q, taken + 1), ("v", run.v, taken + 1), ("r", run.reaction, taken)):
                theirs = np.frombuffer(bytes.fromhex(held[0][name])).reshape(-1, ours.shape[1] or 1)
                if not ours.size:
                    continue
                np.testing.assert_array_equal(theirs[:rows], ours[:rows], f"{found.problem.name} {method} {name} {values}")
                equal += ours[:rows].size
            assert taken == steps or not run.success, f"{found.problem.name} {method} {values}: {taken} of {steps} steps"
    return equal


def models() -> dict[str, Model]:
    found = {}
    for name in PROBLEMS:
        problem = load_problem(name)
        try:
            found[name] = model(problem, problem.t_end)
        except UnsupportedError:
            continue
    return found


@needs_node
@pytest.mark.parametrize("name", ["system-1", "bouncing-ball", "shaw-holmes", "two-ball-drop", "coulomb-oscillator"])
def test_runs_have_the_bits_of_simulate(name):
    problem = load_problem(name)
    assert check(model(problem, problem.t_end), range(3)) > 3 * STEPS
