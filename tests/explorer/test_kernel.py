"""The runs and the exact motion of the page, in node: the runs have the bits of `simulate`."""

from __future__ import annotations

import json
import shutil
import subprocess
from functools import cache
from importlib.resources import files

import numpy as np
import pytest

from lcpimpact import Harmonic, InputError, LcpImpactError, UnsupportedError, load_problem, simulate
from lcpimpact.explorer.javascript import assignment, expression
from lcpimpact.explorer.models import Model, model
from lcpimpact.explorer.page import problem_source
from lcpimpact.problems.parameters import with_values

STEPS = 400

NODE = """
const given = JSON.parse(require("node:fs").readFileSync(0, "utf8"));
const hex = (a) => Buffer.from(new Float64Array(a).buffer).toString("hex");
const jobs = {
  run: ({method, values, tEnd, steps}) => {
    const o = simulate(PROBLEM, method, values, tEnd, steps);
    return {taken: o.taken, q: hex(o.q), v: hex(o.v), r: hex(o.r), impulses: o.impulses};
  },
  exact: ({values, instants}) => {
    const o = exactMotion(PROBLEM, values, instants);
    return {q: hex(o.q.flat()), v: hex(o.v.flat()), events: o.events, until: o.until};
  },
};
console.log(JSON.stringify(given.map((each) => jobs[each.what](each))));
"""

pytestmark = pytest.mark.skipif(shutil.which("node") is None, reason="node, which runs the page's code, is not installed")


def in_node(found: Model, jobs: list[dict]) -> list[dict]:
    """Return what the page's code gives for jobs on a problem."""
    engine = (files("lcpimpact.explorer") / "engine.js").read_text(encoding="utf-8")
    script = f'"use strict";\n{engine}\nconst PROBLEM = {problem_source(found, {})};\n{NODE}'
    done = subprocess.run(
        ["node", "-e", script], input=json.dumps(jobs), capture_output=True, text=True, timeout=60, check=False
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def numbers(text: str, columns: int) -> np.ndarray:
    return np.frombuffer(bytes.fromhex(text)).reshape(-1, max(columns, 1))


@cache
def model_of(name: str) -> Model:
    problem = load_problem(name)
    assert problem.t_end is not None
    return model(problem, problem.t_end)


def cases(found: Model, count: int) -> list[dict[str, float]]:
    """Return values of all sliders: those of the problem, and others at random."""
    rng = np.random.default_rng(1)
    first = {"theta": 0.5, **found.numbers}
    return [first] + [
        first | {each.name: rng.uniform(each.low, each.high) for each in found.sliders} for _ in range(count - 1)
    ]


def python_run(found: Model, method: str, values: dict[str, float], steps: int):
    """Return the run of `simulate` with what a method of the page takes of the values of the sliders."""
    used = {name: values[name] for name in found.traces[method][0].names}
    options = {name: used.pop(name) for name in [*used] if name not in found.numbers}
    problem = with_values(found.problem, used) if used else found.problem
    dt = found.t_end / steps
    return simulate(problem, method, dt=dt, t_end=found.t_end, throw=False, progress=False, **options)


def equal_numbers(found: Model, count: int = 3, steps: int = STEPS) -> int:
    """Compare the runs of a problem by all its methods with `simulate`; return how many numbers are equal."""
    n, nc, equal = len(found.problem.dynamics.nodes), len(found.problem.dynamics.contacts), 0
    sets = [(method, values) for method in found.traces for values in cases(found, count)]
    jobs = [{"what": "run", "method": m, "values": v, "tEnd": found.t_end, "steps": steps} for m, v in sets]
    for k, ((method, values), page) in enumerate(zip(sets, in_node(found, jobs), strict=True)):
        taken, where = page["taken"], f"{found.problem.name}, {method}, {values}"
        if taken < 0:  # the page says so, and draws nothing; with the problem's own values it must not happen
            assert k % count > 0, where
            continue
        try:
            run = python_run(found, method, values, steps)
        except InputError as error:
            raise AssertionError(f"the page runs what Python refuses: {where}: {error}") from error
        kept = taken if taken == steps else max(taken - 2, 0)  # impulses over two steps may be cut at the end
        for name, ours, columns, rows in (("q", run.q, n, taken + 1), ("v", run.v, n, taken + 1), ("r", run.reaction, nc, kept)):
            if ours.size:
                theirs = numbers(page[name], columns)[:rows]
                assert theirs.tobytes() == ours[:rows].tobytes() or np.array_equal(theirs, ours[:rows]), f"{name} of {where}"
                equal += theirs.size
        if taken == steps:
            impacts = [each for each in run.events if each.kind == "impact"]
            np.testing.assert_array_equal(sorted(i["p"] for i in page["impulses"]), sorted(i.impulse for i in impacts))
    return equal


@pytest.mark.parametrize("name", ["system-1", "bouncing-ball", "shaw-holmes", "two-ball-drop", "coulomb-oscillator"])
def test_runs_have_the_bits_of_simulate(name):
    assert equal_numbers(model_of(name)) > 2 * STEPS
