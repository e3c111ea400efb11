"""Straight-line code of steps: the bits of the kernel, and where it is used."""

import signal

import numpy as np
import pytest
from lagrangian_names import LAGRANGIAN

import lcpimpact as li
from lcpimpact.integrators import METHODS
from lcpimpact.integrators.printed import step, straight_line
from lcpimpact.integrators.stepping import kernel, linear_step
from lcpimpact.integrators.stepping.kept_basis import kept_basis
from lcpimpact.integrators.stepping.linear_step import LinearStep
from lcpimpact.problems import PROBLEMS

pytestmark = pytest.mark.compiled

LINEAR = [name for name, kind in METHODS.items() if issubclass(kind, LinearStep)]
QUICK = {
    ("system-2", "moreau-jean"), ("system-3", "moreau-jean"), ("coulomb-oscillator", "moreau-jean"),
    ("vibrating-table", "moreau-jean"),
    ("bouncing-ball", "d1-minus"), ("oscillator-stop", "generalized-alpha"), ("relay-oscillator", "moreau-jean"),
}  # fmt: skip
LARGE = ("bar-impact", "bouncing-bar", "plastic-bar-impact", "ball-in-air")
OF_ALL_METHODS = (
    "bouncing-ball", "system-3", "coulomb-oscillator", "relay-oscillator", "vibrating-table", "shaw-holmes",
)  # fmt: skip
"""A contact, nodes without mass, a slider, a relay, a motion and a load: what a text is printed of.

Each pair compiles a text of its own, which takes seconds, and those of several contacts the most; moreau-jean meets every
problem."""
SEVERAL = ("d1-minus", "schatzman-paoli")
"""Methods that meet several contacts besides: by velocities in two stages, and by positions."""


def of_method(method):
    return (*OF_ALL_METHODS, "newtons-cradle") if method in SEVERAL else OF_ALL_METHODS


@pytest.fixture
def at_once(monkeypatch):
    """Every run takes straight-line code where it can."""
    monkeypatch.setattr(straight_line, "LINES", {})
    monkeypatch.setitem(straight_line.straight_line.__kwdefaults__, "least", 0)
    monkeypatch.setitem(straight_line.straight_line.__kwdefaults__, "least_a_term", 0)


def codes():
    return [*straight_line.LINES.values()]


def both(problem, method, monkeypatch, **arguments):
    """A run by the kernel, and one by straight-line code."""
    with monkeypatch.context() as patched:
        patched.setattr(linear_step.Tabulated, "line", lambda *_: None)
        kernel = li.simulate(problem, method, throw=False, **arguments)
    return kernel, li.simulate(problem, method, throw=False, **arguments)


def assert_same_bits(a, b):
    for name in ("t", "q", "v", "reaction"):
        mine, theirs = getattr(a, name), getattr(b, name)
        assert np.array_equal(mine, theirs, equal_nan=True), name
        assert (np.isnan(mine) | (np.signbit(mine) == np.signbit(theirs))).all(), f"{name}: the sign of a zero"
    assert a.status == b.status
    assert [event.t for event in a.events] == [event.t for event in b.events]
    for name in ("lcp_solves", "lcp_iterations", "evaluations", "residual"):
        assert a.stats[name] == b.stats[name], name


@pytest.mark.parametrize(
    ("name", "method"),
    [
        pytest.param(name, method, marks=pytest.mark.always if (name, method) in QUICK else pytest.mark.slow)
        for method in LINEAR
        for name in PROBLEMS
        if name not in (*LARGE, *LAGRANGIAN)
        and (method == "moreau-jean" or name in of_method(method) or (name, method) in QUICK)
    ],
)
def test_the_bits_are_those_of_the_kernel(name, method, at_once, monkeypatch):
    problem = li.load_problem(name)
    try:
        a, b = both(problem, method, monkeypatch, dt=problem.t_end / 4000, t_end=problem.t_end)
    except li.UnsupportedError:
        return
    assert_same_bits(a, b)
    # Laws without closed form, impulse paths, several nodes that only springs hold, and steps that change their θ at
    # switches are left to the kernel.
    d = problem.dynamics
    closed = len(d.contacts) < 2 or (len(d.contacts) == 2 and d.impenetrable.all())
    held = d.decomposition.static.shape[1] < 2
    if closed and held and not len(d.impulse_lines) and d.stores_energy and not d.springs:
        assert codes()


@pytest.mark.slow
def test_other_parameters_share_the_code(at_once, monkeypatch):
    for k_o in (1000.0, 2000.0, 4000.0):
        assert_same_bits(*both(li.load_problem("system-3", k_o=k_o), "moreau-jean", monkeypatch, dt=1e-3, t_end=1.0))
    assert len(codes()) == 1
    assert_same_bits(*both(li.load_problem("system-1"), "moreau-jean", monkeypatch, dt=1e-3, t_end=1.0))
    assert len(codes()) == 2


def test_a_step_out_of_the_ordinary_is_left_to_the_kernel(at_once, monkeypatch):
    """A motion that overflows, and a row whose residual is above a tolerance that nothing meets."""
    growing = li.Scheme(
        li.Mass("x", 1.0), li.NegativeSpring("x", "ground", 1e9), li.Bumper("x", "ground", e=0.5, gap=1e300)
    )
    a, b = both(li.Problem("growing", growing, v0={"x": 1.0}), "moreau-jean", monkeypatch, dt=1e-3, t_end=100.0)
    assert a.status is li.Status.INFEASIBLE
    assert_same_bits(a, b)
    assert a.message == b.message
    options = {"dt": 1e-3, "t_end": 0.5, "tol": 1e-17}
    a, b = both(li.load_problem("system-1"), "moreau-jean", monkeypatch, **options)
    assert_same_bits(a, b)


def table_of(name, method="moreau-jean"):
    d = li.load_problem(name).dynamics
    prepared = METHODS[method]().prepare(d, 1e-3, "auto")
    return prepared.table, prepared.features[2], len(d.nodes)


def source(table, static, n):
    return straight_line.text_of(step.write_step(table, static, n), False)


def test_tables_of_one_pattern_have_one_source():
    """Also of tables that no method writes: an activation that is constant, and a row that holds a static coordinate."""
    table, static, n = table_of("coulomb-oscillator")
    states, sources = step.StepWriter(table, static, n).sizes[0], {}
    for constant in (-1.0, -0.3, -0.2, 0.3, 1.0):
        known = table.known.copy()
        known[:, 0], known[states, 0] = 0.0, constant
        changed = table._replace(known=known)
        sources.setdefault(step.pattern(changed, static), set()).add(source(changed, static, n))
    table, static, n = table_of("system-2")
    for high in (np.inf, 5.0, 7.0):
        changed = static._replace(r_max=np.array([high]))
        sources.setdefault(step.pattern(table, changed), set()).add(source(table, changed, n))
    for name in ("system-1", "system-3", "maxwell-impact", "vibrating-table", "newtons-cradle", "three-balls"):
        table, static, n = table_of(name)
        sources.setdefault((n, step.pattern(table, static)), set()).add(source(table, static, n))
    for method in ("newmark-ns", "d1-minus", "generalized-alpha"):
        table, static, n = table_of("newtons-cradle", method)
        sources.setdefault((n, step.pattern(table, static)), set()).add(source(table, static, n))
    assert len(sources) > 10
    assert all(len(each) == 1 for each in sources.values())


def test_a_solver_by_name_solves_its_lcps(at_once):
    for solver in ("lemke", "pgs"):
        run = li.simulate(li.load_problem("system-1"), dt=1e-3, t_end=0.5, lcp_solver=solver)
        assert run.stats.lcp_iterations > 0
    assert not codes()


@pytest.mark.parametrize(("steps", "terms", "found"), [(800, 8, 0), (1200, 8, 1), (1200, 80, 0), (1600, 80, 1)])
def test_code_is_made_where_a_run_is_worth_it(monkeypatch, steps, terms, found):
    """Before the first step, as its compilation takes as long as 1,000 steps in the interpreter; System 1 has 18 terms."""
    monkeypatch.setattr(straight_line, "LINES", {})
    monkeypatch.setitem(straight_line.straight_line.__kwdefaults__, "least_a_term", terms)
    li.simulate(li.load_problem("system-1"), dt=1.0 / steps, t_end=1.0)
    assert len(codes()) == found


def test_a_process_keeps_so_many_patterns(at_once, monkeypatch):
    monkeypatch.setitem(straight_line.straight_line.__kwdefaults__, "most", 1)
    for name in ("system-1", "bouncing-ball", "system-1"):
        assert li.simulate(li.load_problem(name), dt=1e-3, t_end=0.1).success
        assert len(codes()) == 1


@pytest.mark.parametrize("name", ["system-1", "two-ball-drop"])
def test_steps_that_are_left_to_the_kernel_end_straight_line_code(name, at_once, monkeypatch):
    """Each of them costs its call, too; no residual is below the second tolerance."""
    blocks, take = [], straight_line.StraightLine.take

    def counted(self, block, *arguments):
        blocks.append(block.first)
        return take(self, block, *arguments)

    monkeypatch.setattr(straight_line.StraightLine, "take", counted)
    for tol, least, most in ((1e-12, 1, 1), (1e-17, 2, linear_step.FEW_LEFT)):
        blocks.clear()
        li.simulate(li.load_problem(name), dt=1e-3, t_end=1.0, tol=tol, throw=False)
        assert least <= len(blocks) <= most


def line_of(name, steps):
    """Straight-line code of a problem whose laws the functions of the kernel solve, and the arguments of a block."""
    d = li.load_problem(name).dynamics
    prepared = METHODS["moreau-jean"]().prepare(d, 1e-3, "lemke")
    n, nc = len(d.nodes), len(d.contacts)
    assert not prepared.in_closed_form
    line = straight_line.straight_line(b"", prepared.table, prepared.features[2], n, [-1] * nc, False, steps)
    state = kernel.StepState(np.tile(-np.arange(float(n)), 2), np.ones((1, nc)), kept_basis(nc))
    path = kernel.StepOutput(*np.zeros((2, steps + 1, n)), np.zeros((steps, nc)))
    block = kernel.Block(0, steps, np.zeros((steps, 0)), 1e-12, 9, False, False, kernel.UNWATCHED)
    ways = kernel.Ways(prepared.solver.kernel.py_func, None, None)
    room = kernel.room_for(prepared.table, 0)
    return line, (block, prepared.table, prepared.banded, prepared.features, state, path, room, ways)


def test_an_interrupt_in_a_law_is_raised(at_once, monkeypatch):
    """An error does not pass through compiled code."""

    def interrupted(*arguments):
        raise KeyboardInterrupt

    monkeypatch.setattr(straight_line, "throughout", lambda function: interrupted)
    line, arguments = line_of("newtons-cradle", 10)
    with pytest.raises(KeyboardInterrupt):
        line.take(*arguments)


@pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="there is no timer that sends a signal")
def test_a_signal_in_compiled_code_is_raised_in_the_law_that_follows(at_once):
    """Two balls that fly for most of the steps, and then meet."""
    steps = 400_000
    line, arguments = line_of("pi-billiard", steps)
    arguments[4].y[:] = 0.0, 0.0, 1.1e3 / steps, 0.0
    arguments[4].P[:] = 0.0

    def interrupted(*_):
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGALRM, interrupted)
    signal.setitimer(signal.ITIMER_REAL, 1e-3)
    try:
        with pytest.raises(KeyboardInterrupt):
            line.take(*arguments)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


PROCESSOR = """
import hashlib, json
import lcpimpact as li
run = li.simulate(li.load_problem("system-3"), dt=1e-3, t_end=2.0)
print(json.dumps(hashlib.sha256(run.q.tobytes() + run.reaction.tobytes()).hexdigest()))
"""


def test_the_processor_that_is_asked_for_has_the_same_bits(python, tmp_path):
    """One without vector registers and fused multiply-add among them."""
    found = {python(PROCESSOR, LCPIMPACT_COMPILE="later", **given) for given in ({}, {"LCPIMPACT_CPU": "generic"})}
    assert len(found) == 1
