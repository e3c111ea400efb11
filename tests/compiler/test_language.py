"""What compiled code says is what the interpreter says, to the last bit, for each word of the language."""

import copy
import math
import pickle
from collections.abc import Callable
from enum import IntEnum
from typing import NamedTuple

import numpy as np
import pytest

from lcpimpact.arrays import Flags, Indices, Matrix, Places, Stack, Vector
from lcpimpact.compiled import as_declared, compiled, compiled_text, function_at
from lcpimpact.compiler import library, machine
from lcpimpact.compiler.writer import CompileError
from lcpimpact.lcp.solvers.closed_form import closed_form

pytestmark = [pytest.mark.compiled, pytest.mark.always]

FLOOR = 0.25
SIDES = (1.0, -1.0, 0.5)


class Kind(IntEnum):
    OPEN = 1
    CLOSED = 2


class Body(NamedTuple):
    m: float
    q: Vector
    H: Matrix


def arithmetic(x: float, y: float, n: int, m: int) -> tuple[float, float, float, float, int, int, int, int, float]:
    return x + y, x - n, x * y / FLOOR, -x, n + m, n * m - 3, n // m, n % m, n / m


def powers(x: float, n: int) -> tuple[float, float, float, float, float, float]:
    return abs(x) ** 0.7, x**2, 2.0**n, x % 1.0, 2.0 ** min(x, 9.0), 4.0 ** min(x, 9.0)


def comparisons(x: float, y: float, n: int) -> tuple[bool, bool, bool, bool, bool, bool, bool]:
    return x < y, 0.0 <= x < y, x == y, x != y, not x > y, n in (0, 3), bool(n)


def decisions(x: float, n: int) -> float:
    y = 0.0
    if x > 0.5 and (n > 2 or x < 0.75):
        y = 1.0
    elif n == Kind.CLOSED:
        return 7.0
    else:
        y -= x
    z = n if n > 1 else x
    return y + z if n != Kind.OPEN else -y


def loops(n: int, step: int) -> float:
    total = 0.0
    for i in range(n):
        if i == 3:
            continue
        for j in range(i, -1, -1):
            total += i / (j + 1.0)
            if total > 40.0:
                break
    for i in range(0, 11, step):
        total -= i
    while n > 0:
        n -= 2
        total *= 0.5
    for side in SIDES:
        total += side
    return total


def extremes(x: float, y: float, n: int) -> tuple[float, float, float, int, int, float]:
    return max(x, y), min(x, 0.0), max(x, y, 0.5), abs(n), max(n, 2), min(n, 2.5)


def angles(x: float, y: float, n: int) -> tuple[float, float, float]:
    return math.sin(x), math.cos(y * n), math.atan2(x, y)


def functions(x: float, n: int) -> tuple[float, float, float, float, float, float, int, int, bool, bool]:
    part, power = math.frexp(x)
    y = math.sqrt(abs(x)) + np.sqrt(abs(x))
    floor = math.floor(min(x, 1e9))
    return y, math.exp(-abs(x)), math.log(abs(x) + 1.0), part, math.ldexp(1.0, n), math.copysign(2.0, x), power, floor, (
        math.isfinite(x)
    ), np.isnan(x)  # fmt: skip


def elements(a: Matrix, v: Vector, k: Indices, on: Flags) -> float:
    total = a[0, 0] + a[-1, 1] + v[len(v) - 1] + a.shape[0] * 10.0 + a.size + v.ndim
    for i in range(len(v)):
        v[i] += a[i, 0] * k[i]
        v[i] *= 2.0
        if on[i]:
            total += v[k[i]]
            on[i] = False
    for i, row in enumerate(a):
        row[0] = i
        total += row[1]
    return total


def parts(a: Matrix, v: Vector, lo: int, hi: int) -> tuple[Vector, Matrix, Matrix, float]:
    b = a[lo:hi]
    c = a[:, :2].T.copy()
    w = v[lo:hi].copy()
    v[1:3] = 0.25
    v[: len(w)] = w[::] if False else w
    row = a[1]
    row[:] = 3.0
    return v.copy(), b.copy(), c, float(len(v[hi:lo])) + len(v[-2:])


def fields(body: Body, x: float) -> tuple[float, Body]:
    m, q, H = body
    new = body._replace(m=m + x)
    other = Body(x, q=q + 1.0, H=H.copy())
    return new.m + other.q[0] + H[0, 1], other


def by_element(
    a: Matrix, v: Vector, w: Vector, on: Flags
) -> tuple[Vector, Matrix, Flags, float, float, bool, int, int]:
    u = v + 2.0 * w - abs(v) / 3.0
    u *= 0.5
    b = a * v
    flags = (v < w) & ~on
    return u, b, flags, np.abs(v - w).max(), w.min(), (v > 2.0).any(), int(np.argmax(np.abs(w))), int(np.sum(flags))


def chosen(v: Vector, on: Flags, k: Indices) -> tuple[Vector, Vector, Indices, Vector]:
    places = np.flatnonzero(on)
    out = np.zeros(len(v))
    out[k] = v
    return v[on], v[places] * 2.0, places, out


def made(n: int, v: Vector, a: Matrix) -> tuple[Matrix, Indices, Flags, Vector, Vector, Indices, Stack, Vector, float]:
    one = np.empty((2, n))
    one[0] = 1.5
    one[1] = v
    whole = np.zeros(n, np.int64)
    whole[1] = 4
    flags = np.empty(n, np.bool_)
    for i in range(n):
        flags[i] = v[i] > 0.0
    like = np.empty_like(v)
    like[:] = np.sign(v)
    stack = a.reshape(1, len(a), -1)
    out = np.ones(n)
    np.multiply(v, 2.0, out)
    np.add(out, v, out)
    return one, whole, flags, np.full(n, -2.5), like, np.arange(n), stack.copy(), out, np.full_like(v, 1.0)[0]


def products(a: Matrix, v: Vector) -> tuple[Matrix, Vector]:
    return a @ np.ascontiguousarray(a.T), a @ np.asarray(v)


def unsigned(places: Places, v: Vector) -> float:
    total = 0.0
    for i in range(len(places)):
        total += v[places[i]]
    return total


def views(a: Stack) -> float:
    total = 0.0
    b = a[1, :, :2]
    for i in range(b.shape[0]):
        for j in range(b.shape[1]):
            total += b[i, j] * (i + 2 * j)
    return total + a[:, 1, 0].max()


def overlapping(a: Matrix, b: Matrix, c: Matrix, w: Vector) -> None:
    a[1:] = a[:-1]
    b[:] = b.T
    c[1:, 0] = c[:-1, 0]
    w[1:] = w[:-1]


def scattered(v: Vector, k: Indices) -> None:
    v[k] = v if len(k) > 3 else v.copy()
    k[k] = k


def from_the_end(v: Vector, k: Indices, i: int, j: int, step: int) -> float:
    total = v[i] + v[j] + v[np.sum(k)]
    for i in range(2):
        total += v[i]
    for j, x in enumerate(v):
        total += v[j] * x
    for n in range(-2, 0, -step):
        total += v[n]
    return total


def at_flags(v: Vector, on: Flags, w: Vector) -> float:
    total = 0.0
    for i in range(-3, 3):
        total += SIDES[i] * (i + 5.0)
    v[on] = w[:3] * total
    return total


def quotients(k: Indices) -> tuple[int, int, int, int]:
    return k[0] // k[1], k[0] % k[1], k[0] // -1, k[0] % 3


RNG = np.random.default_rng(4)
A = RNG.normal(size=(4, 4))
V = RNG.normal(size=4)
W = RNG.normal(size=4)
ON = np.array([True, False, True, True])
K = np.array([2, 0, 3, 1])
POWERS = [1.9495510185041254, 1.6569885380896017, 6.915610673845385]
"""Numbers of which the library and LLVM have other squares, powers of two, or powers of four."""
NUMBERS = [0.0, -0.0, 0.6, -1.75, 3.0, 1e300, 5e-324, math.inf, -math.inf, math.nan]

CASES = {
    arithmetic: [(x, 2.5, n, m) for x in NUMBERS for n in (-7, 0, 5) for m in (-3, 2)],
    powers: [(x, n) for x in (*NUMBERS, *POWERS) if math.isfinite(x) and x < 1e100 for n in (-3, 0, 9)],
    comparisons: [(x, y, n) for x in NUMBERS for y in NUMBERS for n in (0, 1, 3)],
    decisions: [(x, n) for x in (0.2, 0.6, 0.9) for n in range(4)],
    loops: [(n, step) for n in range(12) for step in (1, 3)],
    angles: [(x, y, n) for x in (0.0, 0.6, -1.75, 3.0) for y in (-0.0, 0.6, 3.0) for n in (-3, 4)],
    extremes: [(x, y, n) for x in NUMBERS for y in NUMBERS for n in (-3, 4)],
    functions: [(x, n) for x in (0.6, -1.75, 1e300, 5e-324, -0.0) for n in (-1000, 3)],
    elements: [(A, V, K, ON)],
    parts: [(A, V, lo, hi) for lo in (0, 1, 3) for hi in (2, 4)],
    fields: [(Body(2.0, V, A), 0.5)],
    by_element: [(A, V, W, ON)],
    chosen: [(V, ON, K)],
    made: [(4, V, A)],
    products: [(A[:3].copy(), V)],
    unsigned: [(K.astype(np.uint64), V)],
    views: [(RNG.normal(size=(2, 3, 4)),)],
    overlapping: [(A, A, A, W)],
    from_the_end: [(V, np.array([-1, -1]), -1, -2, -1)],
    at_flags: [(V, ON, W)],
    quotients: [(np.array([x, y]),) for x in (-(2**63), -7, 0, 7) for y in (-3, -1, 0, 1, 2)],
}


def copied(arguments):
    return tuple(
        type(each)(*copied(each)) if isinstance(each, tuple) else each.copy() if isinstance(each, np.ndarray) else each
        for each in arguments
    )


def bits(value):
    """The type and the bytes of a result, and of all in it."""
    if isinstance(value, tuple):
        return tuple(map(bits, value))
    found = np.asarray(value)
    zero = np.where(np.isnan(found), np.nan, found) if found.dtype == float else found  # NaN has many bits
    return found.dtype.name, found.shape, zero.tobytes()


@pytest.mark.parametrize("function", CASES, ids=lambda each: each.__name__)
def test_results_and_arrays_are_those_of_the_interpreter(function):
    code = compiled()(function)
    code.resolve()
    for case in CASES[function]:
        ours, given = copied(case), copied(case)
        with np.errstate(all="ignore"):
            expected = as_declared(function(*given), code.declared.gives)
        found = code(*ours)
        assert bits(found) == bits(expected), case
        assert bits(ours) == bits(given), case
        assert type(found) is type(expected)


def test_an_array_put_at_places_is_that_from_before():
    """NumPy 1.26 reads what it has written."""
    v, k = np.arange(4.0), np.array([1, 2, 3, 0])
    compiled()(scattered)(v, k)
    assert (v.tolist(), k.tolist()) == ([3.0, 0.0, 1.0, 2.0], [0, 1, 2, 3])


def test_every_function_that_compiled_code_knows_is_tried_above():
    called = {name for function in CASES for name in function.__code__.co_names}
    assert {each.__name__ for each in library.BUILTINS} - {"absolute"} <= called


def shifted(x: float) -> float:
    return x + 1.0


def twice(x: float, functions: tuple[int]) -> float:
    return SHIFTED_AT(functions[0])(SHIFTED_AT(functions[0])(x))


def of_given(x: float, f: Callable[[float], float]) -> float:
    return f(x) * 2.0


def with_default(x: float, *, by: float = 3.0) -> float:
    return x * by


def calls(x: float, n: int) -> float:
    return OF_GIVEN(x, SHIFTED) + SHIFTED(x) if n == 0 else calls_again(x, n)


def falls(x: float, n: int) -> float:
    return x if n == 0 else FALLS(0.5 * x, n - 1)


def doubled(v: Vector) -> float:
    for i in range(len(v)):
        v[i] *= 2.0
    return v[0]


def in_turn(v: Vector) -> tuple[Vector, Flags]:
    return (v + 1.0) * DOUBLED(v), v - 4.0 < DOUBLED(v)


DOUBLED = compiled()(doubled)
SHIFTED = compiled()(shifted)
SHIFTED_AT = function_at(Callable[[float], float])
OF_GIVEN = compiled()(of_given)
FALLS = compiled()(falls)


def calls_again(x: float, n: int) -> float:
    return x * n


calls_again = compiled(inline="always")(calls_again)


def test_what_stands_left_is_computed_before_a_call_that_changes_it():
    v = np.array([1.0, 2.0])
    found, below = compiled()(in_turn)(v)
    assert found.tolist() == [4.0, 6.0]  # (v + 1) 2
    assert below.tolist() == [True, True]  # (2, 4) - 4 < 4
    assert v.tolist() == [4.0, 8.0]


def test_functions_call_each_other_by_name_by_address_and_themselves():
    code = compiled()(calls)
    code.resolve()
    assert [code(1.5, n) for n in (0, 3)] == [7.5, 4.5]
    assert compiled()(twice)(1.0, (SHIFTED.address,)) == 3.0
    assert OF_GIVEN(2.0, SHIFTED) == 6.0
    assert FALLS(8.0, 3) == 1.0


def test_a_function_is_copied_and_sent_by_its_name():
    assert copy.deepcopy({"f": closed_form})["f"] is closed_form
    assert pickle.loads(pickle.dumps(closed_form)) is closed_form


def grows(n: int, kept: int) -> float:
    total = 0.0
    last = np.zeros(kept)
    for _ in range(n):
        fresh = last + 1.0
        pair = (fresh, fresh[1:])
        _, last = pair[1].copy(), pair[0]
        total += np.full(kept, 2.0)[0]
        for each in np.ones(3):
            total += each
        if len(np.flatnonzero(fresh > 0.0)) < 3:
            break
    return total + last[0]


MEMORY = """
import json, resource
import test_language
from lcpimpact.compiled import compiled
code = compiled()(test_language.grows)
found = [code(10, 100_000)]
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
found.append(code(3_000, 100_000))
print(json.dumps([found, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before]))
"""


def test_memory_is_returned_when_nothing_refers_to_it(python):
    """Each turn of the loop makes some 4 MB."""
    from pathlib import Path

    here = str(Path(__file__).parent)
    found, kilobytes = python(MEMORY, PYTHONPATH=here)
    assert found == [60.0, 18000.0]
    assert kilobytes < 50_000


NO_MEMORY = """
import test_language
from lcpimpact.compiled import compiled
compiled()(test_language.grows)(1, {})
"""


@pytest.mark.parametrize("length", [-100, 1 << 58])
def test_where_there_is_no_memory_the_process_ends_with_words(length):
    import subprocess
    import sys
    from pathlib import Path

    run = [sys.executable, "-c", NO_MEMORY.format(length)]
    done = subprocess.run(run, capture_output=True, text=True, cwd=Path(__file__).parent)
    assert done.returncode != 0
    assert "compiled code has no memory for an array" in done.stderr


WRONG = {
    "count": ((1.0,), "takes 2 arguments"),
    "no number": (("a", np.zeros(2)), "must be real number"),
    "no array": ((1.0, [1.0]), "argument 2 of total is no writeable C-ordered array of float64 with 1 axes"),
    "dtype": ((1.0, np.zeros(2, int)), "of float64"),
    "axes": ((1.0, np.zeros((2, 2))), "with 1 axes"),
    "order": ((1.0, np.zeros(4)[::2]), "C-ordered"),
}


def total(x: float, v: Vector) -> float:
    for i in range(len(v)):
        x += v[i]
    return x


@pytest.mark.parametrize("case", WRONG)
def test_wrong_arguments_are_refused_in_words(case):
    code = compiled()(total)
    code.resolve()
    arguments, words = WRONG[case]
    with pytest.raises(TypeError, match=words):
        code(*arguments)
    with pytest.raises(TypeError, match="of float64"):
        code(1.0, np.ones(2, np.dtype(float).newbyteorder()))
    frozen = np.zeros(2)
    frozen.flags.writeable = False
    with pytest.raises(TypeError, match="writeable"):
        code(1.0, frozen)
    assert code(1, np.ones(3)) == 4.0


def slip(body: Body, n: int) -> float:
    return body.m * n


def test_tuples_are_taken_by_their_length():
    code = compiled()(slip)
    assert code(Body(2.0, V, A), 3) == 6.0
    with pytest.raises(TypeError, match="is no tuple of 3"):
        code((1.0, V), 3)
    with pytest.raises(TypeError, match="is no tuple of 3"):
        code(1.0, 3)


REFUSED = {
    "a set": "def f(x):\n    return len({x})\n",
    "a name without a value": "def f(x):\n    return x + y\n    y = 1.0\n",
    "an unknown function": "def f(x):\n    return sorted(x)\n",
    "two types": "def f(x):\n    y = x\n    y = (x, x)\n    return y[0]\n",
    "a sum of numbers": "def f(x):\n    return np.sum(np.full(3, x))\n",
    "one of two types": "def f(x):\n    t = (1, x)\n    return t[int(x)]\n",
    "one of two arrays": "def f(x):\n    t = (np.ones(2), np.zeros(2))\n    return t[int(x)][0]\n",
    "a number of and": "def f(x):\n    return x and 2.0\n",
    "a sum of truth values": "def f(x):\n    return (x > 1.0) + (x > 2.0)\n",
    "the bits of a truth value": "def f(x):\n    return 1.0 if ~(x > 1.0) else 2.0\n",
    "a loop with else": "def f(x):\n    for i in range(3):\n        x += i\n    else:\n        x = 0.0\n    return x\n",
    "another loop with else": "def f(x):\n    while x > 0.0:\n        x -= 1.0\n    else:\n        x = 2.0\n    return x\n",
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_compiled_code_cannot_say_is_refused_with_its_place(case):
    code = compiled_text(REFUSED[case], Callable[[float], float], {"np": np})
    with pytest.raises(CompileError, match="f: "):
        code.resolve()


def test_code_of_one_text_is_known_by_what_its_names_stand_for():
    text, kind = "def f(x):\n    return g(x) + C\n", Callable[[float], float]
    twice_, half = (compiled_text(f"def g(x):\n    return x * {by}\n", kind, {}) for by in (2.0, 0.5))
    found = [compiled_text(text, kind, {"g": g, "C": C}) for g in (twice_, half) for C in (1.0, 3.0)]
    assert [each(4.0) for each in found] == [9.0, 11.0, 3.0, 5.0]


def test_a_function_of_another_type_is_refused():
    with pytest.raises(TypeError, match="argument 2 of of_given is no function of the type"):
        OF_GIVEN(2.0, FALLS)


MALFORMED = """define double @f(i1 %a) {
entry:
  br i1 %a, label %on, label %off
on:
  %x = fadd double 1.0, 1.0
  br label %off
off:
  ret double %x
}"""


def test_what_is_not_well_formed_does_not_end_the_process():
    for text in ("define double @f() { ret nothing }", MALFORMED):
        with pytest.raises(RuntimeError):
            machine.machine_code(text)


@pytest.mark.parametrize("now", ["x + 2.0", "x - 1.0", "x + A", "1.0 + x"])
def test_a_file_that_has_changed_is_not_compiled(now, tmp_path, monkeypatch):
    import importlib
    import linecache
    import sys

    file = tmp_path / "changing.py"
    file.write_text("A = 2.0\n\n\ndef f(x: float) -> float:\n    return x + 1.0\n")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "changing", raising=False)
    function = importlib.import_module("changing").f
    file.write_text(f"A = 2.0\n\n\ndef f(x: float) -> float:\n    return {now}\n")
    linecache.clearcache()
    with pytest.raises(CompileError, match=r"changing\.py has changed since f was imported"):
        compiled()(function).resolve()
