"""The run of a problem as JavaScript: formulas and statements of a step, with the same operations in the same order.

JavaScript's numbers are IEEE doubles, and its + - * / and square root round as Python's, without fused operations. So a
printed run has the bits of the compiled one.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from lcpimpact.arrays import Array
from lcpimpact.formula import Formula, Number, Program
from lcpimpact.integrators.printed.lanes import TracedRun, two_rows
from lcpimpact.integrators.printed.straight_line import (
    Set,
    SolveLaw,
    Statement,
    StepWriter,
    StoreStatement,
    Unless,
    When,
)
from lcpimpact.scheme.dynamics import Dynamics
from lcpimpact.scheme.signals import Harmonic

PRECEDENCE = {ast.Add: ("+", 1), ast.Sub: ("-", 1), ast.Mult: ("*", 2), ast.Div: ("/", 2)}

COMPARED = {ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">=", ast.Eq: "===", ast.NotEq: "!=="}

TARGET = re.compile(r"(?:^|[;{}])([A-Za-z]\w*)=(?!=)")
"""The target of an assignment in printed code."""

Names = Mapping[str, str]
"""Name to the Python expression that is printed in its place."""


def expression(text: str, names: Names | None = None) -> str:
    """Return a Python expression of arithmetic, comparisons and conditions in JavaScript.

    Examples
    --------
    >>> expression("max(-q / W, 0.0) if q < 0.0 and W > 0.0 else a - (b - c)")
    '(q<0&&W>0?max(-q/W,0):a-(b-c))'
    """
    return _printed(ast.parse(text, mode="eval").body, names or {})


def _printed(node: ast.expr, names: Names) -> str:
    match node:
        case ast.Name(id="INFINITY" | "inf"):
            return "Infinity"
        case ast.Name(id=name):
            return _printed(ast.parse(names[name], mode="eval").body, {}) if name in names else name
        case ast.Constant(value=bool() as value):
            return str(value).lower()
        case ast.Constant(value=value):
            return re.sub(r"\.0$|\.0(?=e)", "", repr(float(value)))  # type: ignore[arg-type]
        case ast.Call(func=ast.Name(id=name), args=args):
            return f"{name}({','.join(_printed(each, names) for each in args)})"
        case ast.UnaryOp(op=ast.Not(), operand=operand):
            return f"!({_printed(operand, names)})"
        case ast.UnaryOp(op=ast.USub(), operand=operand):
            inner = _printed(operand, names)
            return f"-({inner})" if isinstance(operand, ast.BinOp) or inner[0] == "-" else f"-{inner}"
        case ast.BinOp(left=left, op=op, right=right):
            sign, rank = PRECEDENCE[type(op)]
            a = _operand(left, names, rank)
            b = _operand(right, names, rank + 1)
            return f"{a}{sign} {b}" if sign == b[0] == "-" else f"{a}{sign}{b}"
        case ast.Compare(left=left, ops=ops, comparators=others):
            terms = [_printed(each, names) for each in (left, *others)]
            pairs = [f"{a}{COMPARED[type(op)]}{b}" for a, op, b in zip(terms, ops, terms[1:], strict=False)]
            return pairs[0] if len(pairs) == 1 else f"({'&&'.join(pairs)})"
        case ast.BoolOp(op=op, values=values):
            parts = [_printed(each, names) for each in values]
            joined = [f"({p})" if isinstance(each, ast.BoolOp) else p for p, each in zip(parts, values, strict=True)]
            return ("&&" if isinstance(op, ast.And) else "||").join(joined)
        case ast.IfExp(test=test, body=body, orelse=other):
            return f"({'?'.join([_printed(test, names), _printed(body, names)])}:{_printed(other, names)})"
    raise TypeError(f"{ast.unparse(node)} is no arithmetic, comparison or condition")


def _operand(node: ast.expr, names: Names, rank: int) -> str:
    """Return an operand, in parentheses where its own operation would come later than the one of this rank."""
    text = _printed(node, names)
    return f"({text})" if isinstance(node, ast.BinOp) and PRECEDENCE[type(node.op)][1] < rank else text


def assignment(line: str, names: Names) -> str:
    """Return a Python assignment, of one or several targets, in JavaScript.

    Examples
    --------
    >>> assignment("x, y = -f / a, -g / d", {"a": "t3"})
    'x=-f/t3;y=-g/d;'
    """
    (statement,) = ast.parse(line).body
    assert isinstance(statement, ast.Assign)
    target, value = statement.targets[0], statement.value
    if not isinstance(target, ast.Tuple):
        return f"{ast.unparse(target)}={_printed(value, names)};"
    assert isinstance(value, ast.Tuple)
    targets = [ast.unparse(each) for each in target.elts]
    read = {each.id for part in value.elts[1:] for each in ast.walk(part) if isinstance(each, ast.Name)}
    if read & {*targets[:-1]}:
        raise TypeError(f"{line} exchanges values, which one assignment after another would not")
    return "".join(f"{name}={_printed(part, names)};" for name, part in zip(targets, value.elts, strict=True))


def run_source(program: Program, run: TracedRun) -> str:
    """Return a JavaScript function (p, N, out) that takes the N steps of a run.

    Parameters
    ----------
    program : Program
        Its parameters up to the end of the run are the numbers p.
    run : TracedRun

    Returns
    -------
    str
        The function writes to the typed arrays of ``out``: q and v (n at each instant), r (nc for each step), L and z (nc
        for each law of each step: the q of its LCP, NaN where a contact takes no part, and its solution), and W (nc² for
        each law). It returns the number of steps taken: fewer than N if the next one is out of the ordinary, and -1 if the
        formulas do not hold for these parameters.
    """
    writer, traced = run.writer, run.traced
    _, _, nc, laws = writer.sizes
    steps = traced.clock.steps.name
    in_time, inputs = traced.in_time()
    y = {name: _text(value) for name, value in run.y.items()}
    names = {name: _text(value) for name, value in run.coefficients.items()} | {"tol": repr(run.tol)}
    first = _assigned(program.source(run.y | run.coefficients | inputs))
    formulas = [f"{name}={expression(value)}" for name, value in first.items() if name not in names | y]
    assumed = [*program.assumptions(), *(f"{name} > 0.0" for name in run.positive())]
    checks = dict.fromkeys(expression(each, names | y) for each in assumed)
    numbers = dict.fromkeys(value.name for value in (run.y | run.coefficients).values() if isinstance(value, Formula))
    checks[f"finite({','.join(numbers)})"] = None
    step = [
        *([_assignment("now", "k + 1.0", {})] if in_time else []),
        *(_assignment(*each, {}) for each in _assigned(in_time).items()),
    ]
    step += [_statement(each, names, run) for each in writer.statements]
    start = {name: expression(value) for name, value in y.items()}
    start |= dict.fromkeys([*(f"P{i}" for i in range(laws * nc)), *(f"r{i}" for i in range(nc)), "bad"], "0")
    others = sorted(set(TARGET.findall("".join(step))) - {*start})
    W = [expression(f"W_{law}_{i}_{j}", names) for law, i, j in np.ndindex(laws, nc, nc)]
    rows = [f"rows{law}={_rows(run, law, names)}" for law in range(laws if nc > 1 else 0)]
    return "".join(
        [
            f"(p,{steps},out)=>{{",
            "const {q:Q,v:V,r:R,L,z:Z,W:X}=out,",
            ",".join([*(f"p{i}=p[{i}]" for i in range(traced.sets)), *formulas]),
            f";if(!({'&&'.join(checks)}))return -1;X.set([{','.join(W)}]);",
            *(f"const {each};" for each in rows),
            f"let {','.join([*(f'{name}={value}' for name, value in start.items()), *others])};",
            *(f"{'QV'[i // writer.n]}[{i % writer.n}]=y{i};" for i in range(2 * writer.n)),
            f"for(let k=0;k<{steps};k++){{{''.join(step)}}}return {steps}}}",
        ]
    )


def equations_source(program: Program, dynamics: Dynamics, start: tuple[Array, Array]) -> str:
    """Return a JavaScript function of the parameters of a program that gives the equations of motion.

    Parameters
    ----------
    program : Program
    dynamics : Dynamics
        With numbers or formulas of the program. Of its loads and motions, those that are constant or harmonic are given.
    start : pair of (n,) arrays
        q and v at t = 0.

    Returns
    -------
    str
        M, C and K of the object that the function returns are lists of (i, j, value), ``f`` of (i, value), ``waves`` and
        ``motions`` of (i, a, ω, φ), and u0, e, mu, the static mus, the bounds lo and hi, q and v are lists.
    """
    d = dynamics
    constant: list[Any] = [(i, load) for i, load in d.loads if not callable(load)]
    waves = [(i, load) for i, load in d.loads if isinstance(load, Harmonic)]
    motions = [(i, motion) for i, motion in sorted(d.motions.items()) if isinstance(motion, Harmonic)]
    rows: dict[str, list[Any]] = {
        **{
            name: [(i, j, A[i, j]) for i, j in np.ndindex(A.shape) if isinstance(A[i, j], Formula) or A[i, j] != 0.0]
            for name, A in zip("MCK", (d.M, d.C, d.K), strict=True)
        },
        "f": constant,
        "waves": [(i, wave.amplitude, wave.omega, wave.phase) for i, wave in waves],
        "motions": [(i, wave.amplitude, wave.omega, wave.phase) for i, wave in motions],
    }
    lists = {
        "u0": d.u0,
        "e": d.restitution,
        "mu": d.mu,
        "mus": d.mu_s,
        "lo": d.r_min,
        "hi": d.r_max,
        "q": start[0],
        "v": start[1],
    }
    numbers = [x for each in (*(row for part in rows.values() for row in part), *lists.values()) for x in each]
    used = {each.name: each for each in numbers if isinstance(each, Formula)}
    formulas = [f"{name}={expression(value)}" for name, value in _assigned(program.source(used, assumed=False)).items()]
    read = {name for each in formulas for name in re.findall(r"\bp\d+\b", each)} | used.keys()
    known = [f"{each.name}=p[{i}]" for i, each in enumerate(program.parameters) if each.name in read]
    parts = [f"{name}:[{','.join(map(_list, part))}]" for name, part in rows.items()]
    parts += [f"{name}:{_list(each)}" for name, each in lists.items()]
    defined = ",".join([*known, *formulas])
    return f"p=>{{{f'const {defined};' if defined else ''}return {{{','.join(parts)}}}}}"


def _list(numbers: Iterable[Number]) -> str:
    return f"[{','.join(expression(_text(each)) for each in numbers)}]"


def _text(value: Number) -> str:
    """Return a number as Python text."""
    return value.name if isinstance(value, Formula) else repr(float(value))


def _assigned(lines: Iterable[str]) -> dict[str, str]:
    """Return the targets and values of lines with one assignment each."""
    return dict(line.split(" = ", 1) for line in lines)


def _assignment(target: str, value: str, names: Names) -> str:
    return f"{target}={expression(value, names)};"


def _rows(run: TracedRun, law: int, names: Names) -> str:
    """Return the rows of a law as an object: W, their bounds, friction and its normal rows.

    Where there is static friction, its coefficients follow, the length of a step, and the rates of the rows by velocities.
    """
    writer = run.writer
    nc = writer.sizes[2]

    def listed(*texts: str) -> str:
        return f"[{','.join(expression(each, names) for each in texts)}]"

    W = ",".join(listed(*(f"W_{law}_{i}_{j}" for j in range(nc))) for i in range(nc))
    low, high = (listed(*(f"{bound}_{law}_{i}" for i in range(nc))) for bound in ("lower", "upper"))
    mu, mu_s = (
        listed(*(f"{name}_{i}" if normal >= 0 else "0.0" for i, normal in enumerate(writer.normals)))
        for name in ("mu", "mu_s")
    )
    rows = f"W:[{W}],low:{low},high:{high},mu:{mu},normals:{[*writer.normals]}"
    if _holds(writer):
        H = [
            listed(*(f"H_{i}_{j}" for j in range(writer.n))) if normal >= 0 else "[]"
            for i, normal in enumerate(writer.normals)
        ]
        clock = run.traced.clock
        rows += f",mus:{mu_s},h:{clock.end.name}/{clock.steps.name},H:[{','.join(H)}]"
    return f"{{{rows}}}"


def _holds(writer: StepWriter) -> bool:
    """Return whether some friction is static at first."""
    return any(array == "mu_s" for array, _ in writer.coefficients.values())


def _solved(solve: SolveLaw, writer: StepWriter) -> str:
    """Return the statements that solve a law by its cases: ``solveRows`` or ``solveHolding`` of the page."""
    first = solve.law * solve.nc
    lists = [",".join(f"{name}{start + i}" for i in range(solve.nc)) for name, start in (("on", 0), ("P", first))]
    z = "".join(f"z{first + i}=z[{i}];" for i in range(solve.nc))
    given = f"rows{solve.law},[{','.join(solve.q)}],[{lists[0]}],[{lists[1]}]"
    if _holds(writer):
        state = ",".join(f"y{i}" for i in range(2 * writer.n))
        found = f"solveHolding({given},[{state}])"
    else:
        found = f"solveRows({given})"
    return f"z={found};if(!z)return k;{z}"


def _statement(statement: Statement, names: Names, run: TracedRun) -> str:
    """Return a statement of a step in JavaScript, without what only measures the residual."""
    n = run.writer.n
    _, _, nc, laws = run.writer.sizes
    match statement:
        case Set("worst", _) | When(_, (Set("worst", _),)):
            return ""
        case Set("z", value):  # of a law of one row: 0, and another value if its contact takes part
            return _assignment("z", value, names) + f"on0={str(value != '0.0').lower()};"
        case Set(name, "z"):
            return f"{name}=z;" + _kept(int(name[1:]), 1, laws)
        case Set(name, value):
            return _assignment(name, value, names)
        case When(condition, then):
            inner = "".join(_statement(each, names, run) for each in then)
            return f"if({expression(condition, names)}){{{inner}}}"
        case Unless(condition):
            return f"if(!({expression(condition, names)}))return k;"
        case SolveLaw(law) if run.closed:
            lines = "".join(assignment(line, names) for line in two_rows(statement))
            return f"{lines}if(bad){{{_solved(statement, run.writer)}bad=0;}}{_kept(law, nc, laws * nc)}"
        case SolveLaw(law, touching=touching):
            active = [f"on{i}={expression(condition or 'True', names)};" for i, condition in enumerate(touching)]
            return "".join(active) + _solved(statement, run.writer) + _kept(law, nc, laws * nc)
        case StoreStatement(array, column, value):
            place = _place(nc, column) if array == "r" else _place(n, n + column)
            return f"{array.upper()}{place}={value};"


def _kept(law: int, nc: int, width: int) -> str:
    """Return the assignments that keep the LCP of a law and its solution."""
    places = [_place(width, law * nc + i) for i in range(nc)]
    return "".join(f"L{at}=on{i}?free{i}:NaN;Z{at}=z{law * nc + i};" for i, at in enumerate(places))


def _place(width: int, column: int) -> str:
    """Return the index of a column in row k of an array."""
    return f"[{'k' if width == 1 else f'k*{width}'}{f'+{column}' if column else ''}]"
