"""Functions without compiled code: what runs in the interpreter, when it is compiled, and that both have the same bits."""

import json
import threading
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import lcpimpact as li
from lcpimpact import cache, compiled
from lcpimpact.compiler.kinds import FLAG, REAL, WHOLE, ArrayKind, FunctionKind, TupleKind
from lcpimpact.interpreter import throughout
from lcpimpact.lcp import SOLVERS
from lcpimpact.problems import PROBLEMS

pytestmark = pytest.mark.compiled

VECTOR = ArrayKind(REAL, 1)
HALVES = FunctionKind((REAL,), REAL)

CALLS: list[int] = []


def half(x):
    CALLS.append(1)  # a list of Python, which compiled code refuses
    return 0.5 * x


def count_half(x):
    return HALF(x) + HALF(x)


HALF = compiled.compiled(HALVES)(half)


def add_one(x, divisor):
    for i in range(len(x)):
        x[i] += 1.0
    return 1.0 / divisor


def square(x):
    return x * x


def of_two(x, functions):
    return x


def type_of(x):
    return len(x)


@pytest.fixture
def later(monkeypatch, tmp_path):
    """Functions run in the interpreter at first, and no code of an earlier process is found."""
    monkeypatch.setenv(compiled.WHEN_TO_COMPILE, "later")
    monkeypatch.setattr(cache, "folder", lambda: tmp_path)
    monkeypatch.setattr(compiled, "BESIDE", compiled.Beside())
    yield tmp_path
    compiled.BESIDE.end()


def test_all_functions_below_one_are_interpreted(later):
    CALLS.clear()
    function = compiled.compiled(HALVES)(count_half)
    assert function(3.0) == 3.0
    assert len(CALLS) == 2
    assert (function.ready, HALF.ready) == (False, False)
    assert throughout(function).__globals__["HALF"] is half


def test_results_have_the_declared_types(later):
    pair = compiled.compiled(FunctionKind((VECTOR,), TupleKind((REAL, WHOLE, FLAG))))(
        lambda x: (x[0], x.argmax(), x[0] > 0.0)
    )
    found = pair(np.array([1.0, 2.0]))
    assert found == (1.0, 1, True)
    assert [type(each) for each in found] == [float, int, bool]
    assert not pair.ready


@pytest.mark.parametrize(("divisor", "fails"), [(2.0, False), (0.0, True)])
def test_where_the_interpreter_fails_compiled_code_begins_with_the_same_arrays(later, divisor, fails):
    """1.0/0.0 is infinite in compiled code, and an error of Python."""
    function, x = compiled.compiled(FunctionKind((VECTOR, REAL), REAL))(add_one), np.zeros(2)
    assert function(x, divisor) == (np.inf if fails else 0.5)
    assert x.tolist() == [1.0, 1.0]
    assert function.ready == fails


@pytest.mark.parametrize(("most", "size", "waits"), [(0, 1, False), (4, 4, True), (4, 5, False)])
def test_large_calls_and_iterations_are_compiled_first(later, most, size, waits):
    function = compiled.compiled(FunctionKind((VECTOR,), WHOLE), most=most)(type_of)
    assert compiled.waits(function, (np.zeros(size),)) == waits
    assert function(np.zeros(size)) == size
    assert function.ready != waits


def test_iterative_solvers_are_compiled_first():
    """Their time is not bounded by the size of the LCP, nor is that of steps with one of them."""
    iterative = {"pgs", "psor", "apgd", "nncg", "newton-fb", "interior-point", "enumeration"}
    kernels = {name: SOLVERS[name].kernel for name in SOLVERS if hasattr(SOLVERS[name], "kernel")}
    assert iterative <= set(kernels)
    assert {name for name, each in kernels.items() if each.most == 0} == iterative
    assert all(0 < kernels[name].most <= compiled.LONGEST for name in set(kernels) - iterative)


def test_compilation_first_is_a_choice(later, monkeypatch):
    monkeypatch.setenv(compiled.WHEN_TO_COMPILE, "first")
    function = compiled.compiled(FunctionKind((VECTOR,), WHOLE))(type_of)
    assert function(np.zeros(3)) == 3
    assert function.ready


def test_another_choice_is_refused(later, monkeypatch):
    function = compiled.compiled(FunctionKind((VECTOR,), WHOLE))(type_of)
    for value in ("frist", "First", "1", "never"):
        monkeypatch.setenv(compiled.WHEN_TO_COMPILE, value)
        with pytest.raises(li.InputError, match=f"LCPIMPACT_COMPILE = '{value}' must be 'later' or 'first'"):
            function(np.zeros(3))
    monkeypatch.setenv(compiled.WHEN_TO_COMPILE, "")
    assert function(np.zeros(3)) == 3


def test_threads_that_call_a_function_first_compile_it_once(later, monkeypatch):
    """All but the first were answered that compilation is disabled."""
    monkeypatch.setenv(compiled.WHEN_TO_COMPILE, "first")
    function, begin = compiled.compiled(HALVES)(square), threading.Barrier(4)

    def call(x):
        begin.wait()
        return function(x)

    with ThreadPoolExecutor(4) as pool:
        assert list(pool.map(call, [1.0, 2.0, 3.0, 4.0])) == [1.0, 4.0, 9.0, 16.0]
    assert function.ready


BESIDE = """
import json, time
import numpy as np
from lcpimpact import compiled
compiled.PATIENCE = 0.0
from lcpimpact.numerics.double_double import over
one, three, found, end = np.array([[1.0], [0.0]]), np.array([[3.0], [0.0]]), set(), time.monotonic() + 200.0
while not over.ready and time.monotonic() < end:
    found.add(over(one, three).tobytes())
    time.sleep(0.02)
found.add(over(one, three).tobytes())
print(json.dumps([over.ready, int(over.from_disk), over.seconds > 0.0, len(found)]))
"""


def test_what_takes_long_is_compiled_beside_and_taken_from_the_cache(python, tmp_path):
    assert python(BESIDE, LCPIMPACT_CACHE=str(tmp_path), LCPIMPACT_COMPILE="later") == [True, 1, True, 1]


def test_a_function_waits_for_those_that_it_is_given(later, monkeypatch):
    """What takes some seconds more would else be compiled in the run, once the function itself is there."""
    asked = []
    monkeypatch.setattr(compiled.BESIDE, "compiles", lambda *functions: not asked.append(functions))
    given = compiled.compiled(HALVES)(square)
    function = compiled.compiled(FunctionKind((REAL, TupleKind((WHOLE,))), REAL))(of_two)
    function.resolve()
    function.seconds = 2.0 * compiled.PATIENCE
    called, arguments = compiled.call_with(function, (3.0,), Given([given]))
    assert asked == [(given,)]
    assert (called(*arguments), given.ready) == (3.0, False)
    called, arguments = compiled.call_with(function, (3.0,), Given([given]), lambda x, functions: -x)
    assert called(*arguments) == -3.0
    given.resolve()
    assert compiled.call_with(function, (3.0,), Given([given]))[0] is function


class Given(tuple):
    """Functions as a named tuple has them."""

    _make = classmethod(lambda cls, items: cls(items))


FIRST = """
import hashlib, json
import numpy as np
import lcpimpact as li
from lcpimpact import compiled
from lcpimpact.problems import PROBLEMS
compiled.BESIDE.compiles = lambda *functions: True  # interpreted for as long as it takes
SMALLER = {name: {"elements": 4.0} for name in PROBLEMS if "bar" in name} | {"hereditary-impact": {"rtol": 0.1}}


def bits(names, methods, steps):
    found = {}
    for name in names:
        for method in methods:
            problem = li.load_problem(name, **SMALLER.get(name, {}))
            try:
                run = li.simulate(problem, method, dt=problem.t_end / steps, throw=False)
            except li.UnsupportedError:
                continue
            events = [(e.t, *map(float, np.atleast_1d(e.impulse))) for e in run.events]
            c = run.certificate
            judged = [c.residual, c.complementarity, c.penetration, c.energy_balance, c.energy_scale]
            arrays = [run.q, run.v, run.t_reaction, run.reaction, *events, judged]
            digest = hashlib.sha256(b"".join(np.ascontiguousarray(each, dtype=float).tobytes() for each in arrays))
            found[f"{name} {method}"] = [digest.hexdigest(), run.status.name, len(run.events)]
    return found


def begun():
    return [each.py_func.__qualname__ for each in compiled.DEFERRED if each.ready]
"""


def compare(python, tmp_path, names, methods, steps):
    """Compare the bits of a process without compiled code; return the functions that it compiles nevertheless."""
    namespace: dict = {}
    exec(FIRST, namespace)
    code = f"{FIRST}\nprint(json.dumps([bits({names!r}, {methods!r}, {steps}), begun()]))"
    found, ready = python(code, LCPIMPACT_CACHE=str(tmp_path), LCPIMPACT_COMPILE="later")
    assert len(found) >= 10
    assert found == json.loads(json.dumps(namespace["bits"](names, methods, steps)))
    return ready


def test_a_first_run_compiles_nothing_and_has_the_same_bits(python, tmp_path):
    names, methods = ["system-1", "bouncing-ball", "coulomb-oscillator"], ["moreau-jean", "exact", "rattle-ns", "heun"]
    assert compare(python, tmp_path, names, methods, 500) == []


@pytest.mark.slow
@pytest.mark.parametrize("method", ["moreau-jean", "exact", "rk4"])
def test_the_first_run_of_every_problem_has_the_same_bits(python, tmp_path, method):
    """In 40 steps from start to end, bars and the hereditary force with few terms: the interpreter takes its time."""
    compare(python, tmp_path, list(PROBLEMS), [method], 40)
