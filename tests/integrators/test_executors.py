"""Every executor of a step gives the bits of the loop over tables, and a fault in the nodes that it prints is seen.

The text of lanes runs in the interpreter, and that of the page in node; lanes that are compiled are in test_lanes.
"""

from __future__ import annotations

import json
import math
import shutil
import subprocess
from dataclasses import replace
from importlib.resources import files
from types import SimpleNamespace

import numpy as np
import pytest

import lcpimpact as li
from lcpimpact.compiled import as_it_is
from lcpimpact.explorer.models import REFUSALS, trace
from lcpimpact.expressions import Assign, Name, When, names, operation
from lcpimpact.integrators import METHODS
from lcpimpact.integrators.printed.javascript import run_source
from lcpimpact.integrators.printed.lanes import _source
from lcpimpact.integrators.printed.step import SolveLaw, write_step
from lcpimpact.integrators.printed.straight_line import StraightLine, compiled_steps
from lcpimpact.integrators.stepping.kept_basis import kept_basis
from lcpimpact.integrators.stepping.kernel import (
    SOLVED,
    UNWATCHED,
    Block,
    StepOutput,
    StepState,
    Ways,
    room_for,
)
from lcpimpact.interpreter import throughout
from lcpimpact.problems.parameters import constants_of
from lcpimpact.record import Grid, Record

STEPS = 150
PROBLEMS = ("system-1", "bouncing-ball", "coulomb-oscillator", "relay-oscillator", "shaw-holmes", "two-ball-drop")
"""Nodes without mass, a contact, a slider, a relay, a load, and two contacts."""
LINEAR = ("moreau-jean", "d1-minus", "newmark-ns", "schatzman-paoli")


class Case:
    """A run of a problem by a method: its reference, its table and its statements as formulas."""

    def __init__(self, name: str, method: str, fault=as_it_is):
        self.problem, self.method, self.fault = li.load_problem(name), METHODS[method](), fault
        d = self.problem.dynamics
        self.n, self.nc, self.grid = len(d.nodes), len(d.contacts), Grid(self.problem.t_end, STEPS)
        self.numbers = constants_of(self.problem)
        self.method_name = method

    def record(self) -> Record:
        """A record of the run, without results."""
        q, v = np.zeros((2, STEPS + 1, self.n))
        times = self.method.reaction_times(self.grid)
        return Record(self.grid.times(0, STEPS), q, v, times, np.zeros((STEPS, self.nc)))

    def begin(self):
        """The record with the initial state, and the run that begins there."""
        record = self.record()
        return record, self.method.start(self.problem, self.grid, "auto", record)

    def reference(self):
        """q, v and r of the loop over tables."""
        record, run = self.begin()
        with np.errstate(all="ignore"):
            self.method.advance(run, record, 0, STEPS)
        return record.q, record.v, record.reaction

    def traced(self):
        """The run as formulas, with the fault in its statements, and its parameters."""
        found = trace(self.problem, self.method_name, self.numbers, self.problem.t_end, STEPS)
        run = found.run
        statements = self.fault(run.writer.statements)
        values = [*(self.numbers[name] for name in found.names), self.problem.t_end]
        return found.program, replace(run, writer=replace(run.writer, statements=statements)), values


def straight_line(case: Case):
    record, run = case.begin()
    step = run.steps[0]
    static, closed = step.features[2], step.in_closed_form
    writer = write_step(step.table, static, case.n, case.problem.dynamics.normals.tolist())
    if closed:
        for index in np.ndindex(step.table.W.shape):
            writer.coefficient("W", *index)
    writer.statements = case.fault(writer.statements)
    line = StraightLine(tuple(writer.coefficients.values()), compiled_steps(writer, closed), closed)
    laws, nc, _ = step.table.W.shape
    y = case.method.begin(case.problem.dynamics, record.q[0], record.v[0], case.grid.h)
    state = StepState(y, np.zeros((laws, nc)), kept_basis(nc))
    loads = step.loads(case.grid.times(0, STEPS))
    block = Block(0, STEPS, loads, step.tol, step.max_iter, False, False, UNWATCHED)
    path = StepOutput(record.q, record.v, record.reaction)
    ways = Ways(*map(throughout, (step.solver.kernel, step.featured, step.springs)))
    with np.errstate(all="ignore"):
        status, *_ = line.take(
            block, step.table, step.banded, step.features, state, path, room_for(step.table, 0), ways
        )
    assert status == SOLVED
    return record.q, record.v, record.reaction


def lanes(case: Case):
    _, run, values = case.traced()
    source = _source(run, (), True, False)
    space = {"sqrt": math.sqrt, "floor": np.floor, "INFINITY": math.inf, "LANES": 2}
    exec(source.text, space)
    results = np.empty((1 + STEPS * source.state, 1))
    stops = np.arange(1, STEPS + 1)
    with np.errstate(all="ignore"):
        parameters, constants = np.array([values]).T, np.array([run.tol, *source.constants])
        space["run"](run.loads, stops, parameters, constants, np.empty(source.rows * 2), results)
    assert results[0, 0] == 0.0
    states = results[1:, 0].reshape(STEPS, source.state)
    record, _ = case.begin()
    q, v = record.q, record.v
    q[1:], v[1:] = states[:, : case.n], states[:, case.n : 2 * case.n]
    return q, v, states[:, source.state - case.nc :]


def page(case: Case):
    if shutil.which("node") is None:
        pytest.skip("node is not installed")
    program, run, values = case.traced()
    engine = (files("lcpimpact.explorer") / "engine.js").read_text(encoding="utf-8")
    sizes = {"q": (STEPS + 1) * case.n, "v": (STEPS + 1) * case.n, "r": STEPS * case.nc}
    laws = run.writer.sizes[3]
    sizes |= {"L": STEPS * case.nc * laws, "z": STEPS * case.nc * laws, "W": laws * case.nc**2}
    script = f"""{engine}
    const out = {{}}, sizes = {json.dumps(sizes)};
    for (const name in sizes) out[name] = new Float64Array(sizes[name]);
    const taken = ({run_source(program, run)})({json.dumps(values)}, {STEPS}, out);
    const hex = (a) => Buffer.from(a.buffer).toString("hex");
    console.log(JSON.stringify({{taken, q: hex(out.q), v: hex(out.v), r: hex(out.r)}}));
    """
    done = subprocess.run(["node", "-e", script], capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr
    found = SimpleNamespace(**json.loads(done.stdout))
    assert found.taken == STEPS
    shapes = {"q": (STEPS + 1, case.n), "v": (STEPS + 1, case.n), "r": (STEPS, case.nc)}
    return [np.frombuffer(bytes.fromhex(getattr(found, name))).reshape(shape) for name, shape in shapes.items()]


EXECUTORS = {"straight line": straight_line, "lanes": lanes, "page": page}


def same(found, expected) -> bool:
    return all(np.array_equal(a, b, equal_nan=True) for a, b in zip(found, expected, strict=True))


@pytest.mark.parametrize("executor", EXECUTORS)
@pytest.mark.parametrize("method", LINEAR)
@pytest.mark.parametrize("name", PROBLEMS)
def test_every_executor_gives_the_bits_of_the_loop_over_tables(name, method, executor):
    try:
        expected = Case(name, method).reference()
        Case(name, method).traced()
    except REFUSALS:
        pytest.skip("the method does not take the problem, or not as formulas")
    assert same(EXECUTORS[executor](Case(name, method)), expected)


@pytest.mark.parametrize("name", ["newtons-cradle", "diode-bridge", "twisting", "stick-slip-belt", "woodpecker"])
def test_straight_line_code_has_laws_solved_by_the_functions_of_the_kernel(name):
    """Contacts and sliders whose law has no closed form, and friction."""
    case = Case(name, "moreau-jean")
    expected = case.reference()
    assert (expected[2] != 0.0).any()
    assert same(straight_line(Case(name, "moreau-jean")), expected)


def sign_changed(statements):
    """A sum of the first velocity with a difference in its place."""

    def changed(statement):
        if isinstance(statement, Assign) and statement.name.startswith("new") and "z0" in names(statement.value):
            first, second = statement.value.operands
            return Assign(statement.name, operation("-" if statement.value.operation == "+" else "+", first, second))
        return statement

    return [*map(changed, statements)]


def row_dropped(statements):
    """The state after a step without what its row says of the first velocity."""

    def changed(statement):
        dropped = isinstance(statement, Assign) and statement.name.startswith("new") and "z0" in names(statement.value)
        return Assign(statement.name, Name(f"y{statement.name[3:]}")) if dropped else statement

    return [*map(changed, statements)]


def branch_swapped(statements):
    """Rows that take part where they would not."""

    def changed(statement):
        match statement:
            case When(condition, then):
                return When(~condition, then)
            case SolveLaw(touching=touching):
                return replace(statement, touching=tuple(~each for each in touching))
        return statement

    return [*map(changed, statements)]


FAULTS = (sign_changed, row_dropped, branch_swapped)


@pytest.mark.parametrize("executor", EXECUTORS)
@pytest.mark.parametrize("fault", FAULTS, ids=lambda each: each.__name__)
@pytest.mark.parametrize("name", ["bouncing-ball", "two-ball-drop"])
def test_a_fault_in_the_statements_is_seen(name, fault, executor):
    expected = Case(name, "moreau-jean").reference()
    try:
        found = EXECUTORS[executor](Case(name, "moreau-jean", fault))
    except (AssertionError, NameError, ArithmeticError):
        return
    assert not same(found, expected)
