"""The runs and the exact motion of the page, in node: the runs are those of `simulate`."""

from __future__ import annotations

import json
import shutil
import subprocess
from functools import cache
from importlib.resources import files

import numpy as np
import pytest

import lcpimpact as li
from lcpimpact import Bumper, InputError, Load, Mass, Problem, Scheme, load_problem, simulate
from lcpimpact.explorer.models import Model, model, why_not_exact
from lcpimpact.explorer.page import problem_source
from lcpimpact.problems.parameters import with_values
from lcpimpact.simulation import methods_that_handle

STEPS = 400

NODE = """
const given = JSON.parse(require("node:fs").readFileSync(0, "utf8"));
const hex = (a) => Buffer.from(new Float64Array(a).buffer).toString("hex");
const jobs = {
  run: ({method, values, tEnd, steps}) => {
    const o = simulate(PROBLEM, method, values, tEnd, steps);
    return {taken: o.taken, q: hex(o.q), v: hex(o.v), r: hex(o.r), impulses: o.impulses};
  },
  rows: ({law, q, on, guess}) => solveRows(law, q, on, guess),
  exact: ({values, instants}) => {
    const o = exactMotion(PROBLEM, values, instants);
    return {q: hex(o.q.flat()), v: hex(o.v.flat()), events: o.events, until: o.until};
  },
};
console.log(JSON.stringify(given.map((each) => jobs[each.what](each))));
"""

pytestmark = pytest.mark.skipif(
    shutil.which("node") is None, reason="node, which runs the page's code, is not installed"
)


def in_node(found: Model, jobs: list[dict]) -> list[dict]:
    """Return what the page's code gives for jobs on a problem."""
    engine = (files("lcpimpact.explorer") / "engine.js").read_text(encoding="utf-8")
    script = f'"use strict";\n{engine}\nconst PROBLEM = {problem_source(found, {})};\n{NODE}'
    done = subprocess.run(
        ["node", "-e", script],
        input=json.dumps(jobs).replace("Infinity", "1e999"),
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def numbers(text: str, columns: int) -> np.ndarray:
    return np.frombuffer(bytes.fromhex(text)).reshape(-1, max(columns, 1))


@cache
def model_of(name: str) -> Model:
    problem = load_problem(name)
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


def has_bits(found: Model, method: str) -> bool:
    """Return whether the page solves all laws of a method in closed form, by the operations of `simulate`."""
    return all(each.run.closed for each in found.traces[method])


def compare(found: Model, method: str, name: str, theirs: np.ndarray, ours: np.ndarray) -> None:
    """Compare numbers of a run: bit for bit where laws are solved in closed form, and else to 1e-11 of the largest."""
    where = f"{name} of {found.problem.name} by {method}"
    if has_bits(found, method):
        assert theirs.tobytes() == ours.tobytes() or np.array_equal(theirs, ours), where
        return
    if name == "r" and found.problem.name == "twisting":  # at rest its relays are known up to what they do not move
        theirs, ours = (each @ found.problem.dynamics.B.T for each in (theirs, ours))
    np.testing.assert_allclose(theirs, ours, rtol=0.0, atol=1e-11 * np.abs(ours).max(initial=0.0), err_msg=where)


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
        for name, ours, columns, rows in (
            ("q", run.q, n, taken + 1),
            ("v", run.v, n, taken + 1),
            ("r", run.reaction, nc, kept),
        ):
            if ours.size:
                theirs = numbers(page[name], columns)[:rows]
                compare(found, method, name, theirs, ours[:rows])
                equal += theirs.size
        if taken == steps:
            of_page, of_python = (
                [each["p"] for each in page["impulses"]],
                [e.impulse for e in run.events if e.kind == "impact"],
            )
            if has_bits(found, method):
                np.testing.assert_array_equal(sorted(of_page), sorted(of_python))
            else:  # impulses of friction that sticks may be rounding
                least = 1e-11 * np.abs(of_python).max(initial=0.0)
                kept = [sorted(p for p in each if abs(p) > least) for each in (of_page, of_python)]
                np.testing.assert_allclose(*kept, rtol=0.0, atol=least, err_msg=where)
    return equal


def test_a_struck_block_has_the_force_of_its_floor_on_the_page():
    scheme = Scheme(
        Mass("x", m=2.0), Mass("y", m=1.0), Load("x", f=20.0),
        Bumper("x", "ground", e=0.5, name="R1"), Bumper("y", "x", e=0.5, name="R2"),
    )  # fmt: skip
    problem = Problem("struck block", scheme, q0={"y": -0.3}, v0={"y": 1.0}, t_end=1.0)
    assert equal_numbers(model(problem, 1.0), count=1) > 2 * STEPS


@pytest.mark.parametrize("name", ["system-1", "bouncing-ball", "shaw-holmes", "two-ball-drop", "coulomb-oscillator"])
def test_runs_have_the_bits_of_simulate(name):
    assert equal_numbers(model_of(name)) > 2 * STEPS


LAWS_BY_CASES = [
    "newtons-cradle",
    "block-on-incline",
    "block-on-belt",
    "stick-slip-belt",
    "thrown-block",
    "rolling-sphere",
    "draw-shot",
    "spinning-ball",
    "super-ball",
    "super-ball-table",
    "woodpecker",
    "diode-bridge",
    "twisting",
]


@pytest.mark.parametrize("name", LAWS_BY_CASES)
def test_runs_with_friction_and_more_rows_are_those_of_simulate(name):
    found = model_of(name)
    assert not any(has_bits(found, method) for method in found.traces)
    assert equal_numbers(found) > 2 * STEPS


@pytest.mark.parametrize("name", ["filippov", "three-balls"])
def test_polynomial_loads_and_impacts_of_touching_bodies_have_the_bits_of_simulate(name):
    """Three balls, two of them touching: the impact at both contacts at once has no basis with clear signs."""
    assert equal_numbers(model_of(name)) > 2 * STEPS


def test_loads_and_motions_that_are_polynomials():
    scheme = Scheme(
        Mass("x", m=2.0), Load("x", f=li.Polynomial([1.0, 2.0, 3.0])), li.Spring("x", "ground", k=5.0),
        Bumper("x", "ground", gap=0.1, e=0.5),
    )  # fmt: skip
    found = model(Problem("pushed", scheme, t_end=1.0), 1.0, most=9)
    assert len(found.traces) == 9
    assert equal_numbers(found, count=2) > 9 * 2 * STEPS


def test_static_friction_holds_until_it_slips():
    """A block between a wall and a ram that pushes it ever harder, by all methods."""
    scheme = Scheme(
        Mass("x", m=1.0), Mass("y", m=1.0), Load("y", f=10.0), Bumper("y", "ground", e=0.5, name="N"),
        Load("x", f=li.Polynomial([0.0, 40.0])), li.Spring("x", "ground", k=30.0),
        li.Friction("x", "ground", 0.2, normal="N", mu_s=0.4),
    )  # fmt: skip
    found = model(Problem("stuck", scheme, t_end=4.0), 4.0, most=9)
    assert "Friction.mu_s" in [each.name for each in found.sliders]
    assert equal_numbers(found) > 2 * STEPS


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_blocks_that_fall_on_blocks_that_slide(seed):
    """Impacts through contacts that were closed before, with friction under them: forces and impulses are told apart."""
    rng = np.random.default_rng(seed)
    scheme = Scheme(
        *(Mass(node, m=rng.uniform(0.5, 2.0)) for node in ("y1", "x1", "y2")),
        *(Load(node, f=rng.uniform(5.0, 15.0)) for node in ("y1", "y2")), li.Spring("x1", "ground", k=20.0),
        Bumper("y1", "ground", e=rng.uniform(0.0, 0.8), name="N1"), Bumper("y2", "y1", e=rng.uniform(0.0, 0.8)),
        li.Friction("x1", "ground", rng.uniform(0.1, 0.5), normal="N1", mu_s=rng.uniform(0.5, 0.9)),
        li.Slider("x1", "ground", r0=rng.uniform(0.1, 2.0)),
    )  # fmt: skip
    problem = Problem("stack", scheme, {"y2": -0.3}, {"x1": rng.uniform(-2.0, 2.0), "y2": 1.0}, t_end=1.0)
    assert equal_numbers(model(problem, 1.0, most=5), count=2) > 5 * 2 * STEPS


def random_laws(rng: np.random.Generator, count: int) -> list[dict]:
    """Return laws of up to three contacts, sliders and joints, with friction of the contacts, as in steps."""
    found = []
    for _ in range(count):
        kinds = [*rng.choice(["contact", "slider", "joint"], rng.integers(1, 4)), *["friction"] * rng.integers(0, 3)]
        contacts = [i for i, kind in enumerate(kinds) if kind == "contact"]
        kinds = [kind for kind in kinds if kind != "friction" or contacts]
        n = len(kinds)
        G = rng.standard_normal((n, n + 2))
        bound = rng.uniform(0.1, 1.0, n)
        held = np.array([{"slider": x, "joint": np.inf}.get(kind, 0.0) for kind, x in zip(kinds, bound, strict=True)])
        high = np.where([kind == "contact" for kind in kinds], np.inf, held)
        on = rng.random(n) < 0.8
        normals = [int(rng.choice(contacts)) if kind == "friction" else -1 for kind in kinds]
        on = [bool(on[i] if normal < 0 else on[normal]) for i, normal in enumerate(normals)]
        mu = [float(rng.uniform(0.0, 0.3)) if normal >= 0 else 0.0 for normal in normals]
        law = {"W": (G @ G.T).tolist(), "low": (-held).tolist(), "high": high.tolist(), "mu": mu, "normals": normals}
        found.append({"what": "rows", "law": law, "q": rng.standard_normal(n).tolist(), "on": on})
    return found


def test_laws_are_solved_by_their_cases():
    """z is within its bounds, and w = W z + q complementary to it, with any guess."""
    rng = np.random.default_rng(5)
    jobs = [each | {"guess": guess} for each in random_laws(rng, 300) for guess in (None, [1.0] * len(each["q"]))]
    solved = 0
    for job, z in zip(jobs, in_node(model_of("system-1"), jobs), strict=True):
        law, on = job["law"], np.array(job["on"])
        if z is None:  # of friction alone a law may have no solution
            assert max(law["normals"]) >= 0
            continue
        z, solved = np.array(z), solved + 1
        w, rubs = np.array(law["W"]) @ z + job["q"], np.array(law["normals"]) >= 0
        reach = np.array(law["mu"]) * z[law["normals"]]
        low, high = np.where(rubs, -reach, law["low"]), np.where(rubs, reach, law["high"])
        assert (z[~on] == 0.0).all()
        assert (z[on] >= low[on] - 1e-12).all()
        assert (z[on] <= high[on] + 1e-12).all()
        assert (w[on & (z < high - 1e-9)] >= -1e-10).all()
        assert (w[on & (z > low + 1e-9)] <= 1e-10).all()
    assert solved >= 0.95 * len(jobs)


def test_a_run_ends_before_a_step_out_of_the_ordinary():
    """Steps that are far too long for a spring: q grows beyond all numbers."""
    problem = load_problem("oscillator-stop")
    found = model(problem, problem.t_end, ["rattle-ns"])
    values = cases(found, 1)[0] | {"k": 1e8}
    job = {"what": "run", "method": "rattle-ns", "values": values, "tEnd": found.t_end, "steps": STEPS}
    (page,) = in_node(found, [job])
    run = python_run(found, "rattle-ns", values, STEPS)
    assert 0 < len(run.t) - 1 <= page["taken"] < STEPS
    assert np.array_equal(numbers(page["q"], 1)[: len(run.t)], run.q)


@pytest.mark.parametrize("values", [{"c_o": -1.0}, {"m": 0.0}, {"theta": 0.4}, {"k_o": float("inf")}])
def test_values_that_python_refuses_are_not_run(values):
    found = model_of("system-1")
    job = {"what": "run", "method": "moreau-jean", "values": cases(found, 1)[0] | values, "tEnd": 3.0, "steps": 10}
    (page,) = in_node(found, [job])
    assert page["taken"] == -1
    with pytest.raises(InputError):
        python_run(found, "moreau-jean", job["values"], 10)


def test_signals_that_steps_cannot_follow_are_not_run():
    found = model_of("shaw-holmes")
    for omega, taken in ((2.0, 10), (2.0**30, -1)):
        values = cases(found, 1)[0] | {"omega": omega}
        job = {"what": "run", "method": "moreau-jean", "values": values, "tEnd": 1.5, "steps": 10}
        assert in_node(found, [job])[0]["taken"] == taken
    with pytest.raises(InputError, match="are followed"):
        simulate(load_problem("shaw-holmes", omega=2.0**30), dt=0.15, t_end=1.5)


def test_a_case_of_the_formulas_is_found_for_every_value():
    """A slider reaches other pivots of an elimination than the given values: the page holds their formulas too."""
    found = model_of("jenkins-cycle")
    assert len(found.traces["moreau-jean"]) == 2
    jobs = [
        {"what": "run", "method": "moreau-jean", "values": each, "tEnd": found.t_end, "steps": 50}
        for each in cases(found, 12)
    ]
    assert all(page["taken"] == 50 for page in in_node(found, jobs))


EXACT = [
    "system-1",
    "system-2",
    "system-3",
    "bouncing-ball",
    "maxwell-impact",
    "impact-oscillator",
    "coulomb-oscillator",
]


@pytest.mark.parametrize("name", EXACT)
def test_the_exact_motion_is_that_of_the_method_exact(name):
    found, count = model_of(name), 200
    assert why_not_exact(found.problem.dynamics) == ""
    sets = cases(found, 3)
    runs = [
        simulate(
            with_values(found.problem, {name: values[name] for name in found.numbers}),
            "exact",
            dt=found.t_end / count,
            t_end=found.t_end,
            progress=False,
        )
        for values in sets
    ]
    jobs = [
        {"what": "exact", "values": values, "instants": run.t.tolist()} for values, run in zip(sets, runs, strict=True)
    ]
    for run, page in zip(runs, in_node(found, jobs), strict=True):
        assert page["until"] == run.t[-1]
        q = numbers(page["q"], run.q.shape[1])
        np.testing.assert_allclose(q, run.q, rtol=0.0, atol=1e-13 * np.abs(run.q).max())


def test_the_exact_motion_ends_where_it_is_not_followed():
    """Two contacts at one instant are left to Python: nothing is drawn after them."""
    found = model_of("three-balls")
    instants = np.linspace(0.0, found.t_end, 101).tolist()
    (page,) = in_node(found, [{"what": "exact", "values": cases(found, 1)[0], "instants": instants}])
    assert 0.0 < page["until"] <= 0.5
    assert len(numbers(page["q"], 3)) == len([t for t in instants if t <= page["until"]])


@pytest.mark.parametrize("name", ["coulomb-oscillator", "system-3", "rocking-block"])
def test_the_page_of_one_problem_has_all_methods_that_python_runs(name):
    problem = load_problem(name)
    found = model(problem, problem.t_end, most=9)
    assert set(found.traces) <= set(methods_that_handle(problem.dynamics))
    assert len(found.traces) >= (1 if name == "system-3" else 6)
    assert equal_numbers(found, 2, 100) > 100


def test_a_scheme_of_ones_own():
    scheme = li.Scheme(
        li.Mass("x", m=2.0), li.Load("x", f=20.0), li.Bumper("x", "z"), li.KelvinVoigt("z", "ground", k=300.0, c=4.0)
    )
    found = model(li.Problem("mine", scheme, v0={"x": 1.0}), 2.0)
    assert set(found.numbers) == {"Mass.m", "Load.f", "KelvinVoigt.k", "KelvinVoigt.c", "v0.x"}
    assert equal_numbers(found) == 3 * (2 * 2 * (STEPS + 1) + STEPS)
