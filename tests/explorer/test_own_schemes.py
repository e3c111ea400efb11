"""Scheme files that are given to the page, in node: its runs have the bits of `simulate`, and its refusals Python's words."""

from __future__ import annotations

import json
import shutil
import subprocess
from importlib.resources import files

import numpy as np
import pytest
from test_kernel import numbers

import lcpimpact as li
from lcpimpact.explorer.own_schemes import source
from lcpimpact.schemefile import read_scheme_file, write_scheme_file

pytestmark = pytest.mark.skipif(
    shutil.which("node") is None, reason="node, which runs the page's code, is not installed"
)

NODE = """
const given = JSON.parse(require("node:fs").readFileSync(0, "utf8"));
const hex = (a) => Buffer.from(new Float64Array(a).buffer).toString("hex");
console.log(JSON.stringify(given.map(({text, steps, changes}) => {
  let problem;
  try { problem = ownProblem(text, "my"); } catch (error) {
    if (error.constructor.name === "UnsupportedError") return {unsupported: error.message};
    if (error.constructor.name === "InputError" || error.constructor.name === "UnknownNameError") return {error: error.message};
    return {defect: error.stack};
  }
  const values = {theta: 0.5, ...problem.numbers, ...changes};
  const runs = Object.keys(problem.methods).map((method) => {
    const o = simulate(problem, method, values, problem.tEnd, steps);
    return {method, taken: o.taken, q: hex(o.q), v: hex(o.v), r: hex(o.r)};
  });
  const refusal = problem.refusal(problem.names.map((each) => values[each]), problem.tEnd);
  return {runs, numbers: problem.numbers, tEnd: problem.tEnd, refusal};
})));
"""


def in_node(jobs: list[dict]) -> list[dict]:
    """Return what the page makes of scheme files."""
    engine = (files("lcpimpact.explorer") / "engine.js").read_text(encoding="utf-8")
    script = f'"use strict";\nconst LIMITS = {{most: 10000}};\n{engine}\nconst {{ownProblem}} = {source()};\n{NODE}'
    done = subprocess.run(
        ["node", "-"], input=script.replace('require("node:fs").readFileSync(0, "utf8")', json.dumps(json.dumps(jobs))),
        capture_output=True, text=True, timeout=120, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-3000:]
    found = json.loads(done.stdout)
    defects = [each["defect"] for each in found if "defect" in each]
    assert not defects, defects[0]
    return found


def a_scheme(rng: np.random.Generator) -> li.Problem:
    """Return a random scheme of the elements that the page takes: bodies in a column, with what joins them."""
    count, elements, v0 = int(rng.integers(1, 4)), [], {}
    nodes = [f"x{i}" for i in range(count)]
    number = lambda: float(np.round(10.0 ** rng.uniform(-1.0, 2.5), int(rng.integers(1, 6))) or 0.5)  # noqa: E731
    for i, node in enumerate(nodes):
        elements.append(li.Mass(node, m=number()))
        below = nodes[i + 1] if i + 1 < count else "ground"
        elements.append(a_link(rng, node, below, number, i))
        if rng.random() < 0.5:
            v0[node] = float(rng.normal())
        if rng.random() < 0.4:
            wave = li.Harmonic(number(), number(), float(rng.normal()))
            elements.append(li.Load(node, f=wave if rng.random() < 0.5 else float(rng.normal() * 20.0)))
    for i in range(int(rng.integers(0, 3))):
        node = nodes[int(rng.integers(count))]
        kind = rng.random()
        if kind < 0.5:
            elements.append(li.Bumper(node, "ground", gap=float(rng.random()), e=float(rng.random())))
        elif kind < 0.75:
            elements += [li.Bumper(node, f"z{i}"), li.KelvinVoigt(f"z{i}", "ground", k=number(), c=number())]
        elif kind < 0.9:
            elements.append(li.Rope(node, "ground", slack=float(rng.random()), e=float(rng.random())))
        else:
            elements.append(li.Slider(node, "ground", r0=number()))
    return li.Problem("mine", li.Scheme(*elements), v0=v0, t_end=2.0)


def a_link(rng, a, b, number, i):
    kinds = [
        lambda: li.Spring(a, b, k=number()),
        lambda: li.Dashpot(a, b, c=number()),
        lambda: li.KelvinVoigt(a, b, k=number(), c=number()),
        lambda: li.Maxwell(a, b, k=number(), c=number(), name=f"m{i}"),
        lambda: li.Zener(a, b, k=number(), k_1=number(), c_1=number()),
        lambda: li.GeneralizedMaxwell(a, b, k_inf=number(), k=(number(), number()), tau=(number(), number())),
        lambda: li.Jenkins(a, b, k=number(), f_y=number(), name=f"F{i}"),
    ]
    return kinds[int(rng.choice(len(kinds), p=[0.2, 0.1, 0.3, 0.1, 0.1, 0.1, 0.1]))]()


def test_runs_of_random_files_have_the_bits_of_simulate(tmp_path):
    rng, texts = np.random.default_rng(3), []
    while len(texts) < 40:
        try:
            write_scheme_file(a_scheme(rng), tmp_path / f"{len(texts)}.toml")
        except li.InputError:
            continue
        texts.append((tmp_path / f"{len(texts)}.toml").read_text(encoding="utf-8"))
    equal = ended = taken = 0
    for i, (text, page) in enumerate(zip(texts, in_node([{"text": t, "steps": 200} for t in texts]), strict=True)):
        problem = read_scheme_file(tmp_path / f"{i}.toml").problem
        assert "error" not in page, page
        for run in page.get("runs", ()):
            ours = li.simulate(problem, run["method"], dt=2.0 / 200, t_end=2.0, throw=False, progress=False)
            kept = min(run["taken"] + 1, len(ours.t))
            ended += run["taken"] < 200
            taken += 1
            for name, theirs in (("q", ours.q), ("v", ours.v)):
                found = numbers(run[name], theirs.shape[1])[:kept]
                assert np.array_equal(found, theirs[:kept], equal_nan=True), f"{name} by {run['method']} of\n{text}"
                equal += found.size
    assert taken > 60
    assert ended < 0.1 * taken
    assert equal > 50_000
