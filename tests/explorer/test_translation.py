"""Translated functions give in node what they give in Python, and what is not translated is refused."""

from __future__ import annotations

import json
import math
import shutil
import subprocess
from dataclasses import dataclass
from functools import cached_property
from importlib.resources import files

import numpy as np
import pytest

from lcpimpact.errors import InputError
from lcpimpact.explorer import translation
from lcpimpact.explorer.translation import Translation, literal
from lcpimpact.integrators.stepping.law import Solving
from lcpimpact.registry import nearest


def loops(n):
    found = []
    for i in range(n, -1, -2):
        if i == 3 or (i > 6 and i != 9):
            continue
        while i < 0:
            break
        found.append(i)
    return found


def comprehensions(names):
    places = {name: i for i, name in enumerate(names)}
    pairs = [(a, b) for a in names for b in names if a < b]
    first, *middle, last = names
    return [
        places["b"],
        len(pairs),
        [*middle, first, last],
        next((x for x in names if x > "b"), "none"),
        names[-1],
        names[:2],
    ]


def texts(x, n, name):
    default = f"{name!r} = {x!r}, {x:g}, {n:,} of {len(name)}"
    return [
        default,
        f"{-1.5e-7!r} {1e22!r} {123456.0!r} {1e16!r} {x:.1e}",
        "a" in name,
        "; ".join([name, name]) or "none",
    ]


def arrays(a, b):
    A = np.array([a, b])
    flags = A[0] > 0.0
    A[:, None]
    rows = np.where(flags, A, 0.0)
    return [*rows[1], *A[0:1][0], *np.flatnonzero(flags), *(A[0] * A[1] / 3.0 - 0.5), float(rows.sum())]


def chains(x, y=None):
    return [x if y is None else y, 0 <= x < 3, x and "yes", not x or "no", x**2]


def records(x):
    three = Solving(x, 2, 3.0)
    a, b, _ = three
    a, b = b, a
    return [a, b, three.max_iter]


def words(name):
    return [nearest(name, ["moreau-jean", "newmark-ns", "exact", "rk4", "rk4-paper", "Mass", "Spring"], "word")]


def extremes(pairs):
    return [
        *max(pairs, key=lambda pair: pair[0]),
        *min(pairs),
        *sorted(pairs)[1],
        *sorted(pairs, key=lambda pair: (pair[0] < 2, -pair[1]))[0],
        max((x for _, x in pairs), default=0),
        min([x for _, x in pairs if x > 9], default=-1),
        (1, 2) < (1, 2, 3),
    ]


def rounds(numbers):
    return [round(x, 3) for x in numbers]


def sets_and_mappings(a, b):
    found = dict.fromkeys(a, 0)
    found |= {"b": 2, "z": 1}
    found.setdefault("y", [3]).extend([4])
    return [
        *sorted({*a} & {*b}),
        *sorted({*a} - {*b}),
        *sorted({*a} | {*b}),
        {*a} == {*b},
        {*a} == {*reversed(a)},
        *found,
        *found.values(),
    ]


def generators(n):
    def down(k, *, twice=False, step=1):
        if k > 0:
            yield k
            yield from down(k - step, step=step)
        if twice:
            yield 0

    return [*down(n, step=2), *down(n, twice=True)]


@dataclass(frozen=True)
class Powers:
    x: float

    @cached_property
    def all(self):
        return [self.x, self.x**2]


def refuses(x):
    if x < 0.0:
        raise InputError(f"x = {x!r} must not be negative")
    return [x]


CASES = [
    (loops, [9]),
    (loops, [4]),
    (comprehensions, [["a", "b", "c", "d"]]),
    (texts, [0.1, 1234567, "it's"]),
    (texts, [-3.0, 5, 'a"b']),
    (texts, [1e-5, 5, "new\nline"]),
    (arrays, [[1.0, -2.0, 3.0], [0.5, 0.25, -4.0]]),
    (chains, [2.0]),
    (chains, [0.0, 4.0]),
    (records, [3.5]),
    *((words, [name]) for name in ("moreau", "newmak-ns", "rk", "Mas", "sprng", "x", "exakt", "paper-rk4")),
    (extremes, [[[2, 5.0], [1, 7.0], [2, 3.0], [1, 4.0]]]),
    (rounds, [[0.0625, 0.1875, -0.0625, -0.1875, 2.5, 1.0005, -7.12345, 1e-9, 123456.7895]]),
    (sets_and_mappings, [["a", "b", "c"], ["b", "c", "d"]]),
    (generators, [5]),
    (refuses, [2.0]),
]


@pytest.mark.skipif(shutil.which("node") is None, reason="node, which runs the page's code, is not installed")
def test_translated_functions_give_what_they_give_in_python():
    found = Translation({"InputError"})
    found.add(*dict.fromkeys(function for function, _ in CASES), Powers)
    parts = [(files("lcpimpact.explorer") / name).read_text(encoding="utf-8") for name in ("engine.js", "runtime.js")]
    calls = ",".join(f"{f.__name__}(...{json.dumps(given)})" for f, given in CASES)
    script = "\n".join(['"use strict";', *parts, found.source(), f"console.log(JSON.stringify([{calls}]));"])
    script += "const powers = make(Powers, [3], {}); console.log(...powers.all, powers.all === powers.all);"
    script += "try { refuses(-1); } catch (error) { console.log(error.inWords, error.message); }"
    done = subprocess.run(["node", "-"], input=script, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
    answers, once, refusal = done.stdout.splitlines()
    for (function, given), answer in zip(CASES, json.loads(answers), strict=True):
        expected = json.loads(json.dumps(function(*given), default=float))
        assert [*map(plain, answer)] == [*map(plain, expected)], (function.__name__, given)
    assert once == "3 9 true"
    assert refusal == "true x = -1.0 must not be negative"


def plain(value):
    """JavaScript has one kind of numbers, and 1 and 0 for the truth of comparisons."""
    return (
        float(value)
        if isinstance(value, bool | int | float)
        else [*map(plain, value)]
        if isinstance(value, list)
        else value
    )


def tries(x):
    try:
        return x
    except ValueError:
        return 0


def powers(x):
    return x**3


def of_another_library(x):
    return math.erf(x)


def of_numpy(x):
    return np.fft.fft(x)


def with_else(x):
    for _ in range(3):
        pass
    else:
        return x
    return 0


def of_three(x):
    return max(x, 1, 2)


def of_unpacked(x):
    return min(1, *x)


def by_keywords(f):
    return f(x=1)


@pytest.mark.parametrize(
    "function", [tries, powers, of_another_library, of_numpy, with_else, of_three, of_unpacked, by_keywords]
)
def test_what_is_not_translated_is_refused(function):
    with pytest.raises(TypeError, match=r"not translated|not in runtime\.js"):
        Translation().add(function)


def test_a_name_of_javascript_is_another_one():
    assert translation.safe("new") == "new_"
    assert literal([-math.inf, math.nan, True, "ä"]) == '[-Infinity,NaN,true,"ä"]'
    with pytest.raises(TypeError, match="no constant"):
        literal(1j)
