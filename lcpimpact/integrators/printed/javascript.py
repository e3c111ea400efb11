"""The run of a problem as JavaScript: formulas and statements of a step, with the same operations in the same order.

JavaScript's numbers are IEEE doubles, and its + - * / and square root round as Python's, without fused operations. So a
printed run has the bits of the compiled one.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from lcpimpact.arrays import Array
from lcpimpact.expressions import (
    RANKS,
    ZERO,
    Assign,
    Constant,
    Expression,
    Name,
    Operation,
    Unless,
    When,
    assigned,
    expression,
    names,
    rank,
    replaced,
)
from lcpimpact.formula import Formula, Number, Program, node
from lcpimpact.integrators.printed.step import SolveLaw, StepStatement, StepWriter, StoreStatement, two_row_law
from lcpimpact.integrators.printed.traced_run import TracedRun
from lcpimpact.scheme.dynamics import Dynamics
from lcpimpact.scheme.signals import Harmonic

SPELT = {"==": "===", "!=": "!==", "and": "&&", "or": "||", "not": "!", "True": "true"}
"""Operations and constants that JavaScript writes in another way than Python."""

Known = Mapping[Expression, Expression]
"""Name to what is printed in its place."""


def javascript(node: Expression) -> str:
    """Return an expression in JavaScript.

    Examples
    --------
    >>> from lcpimpact.expressions import largest, select
    >>> q, W, a, b = map(Name, "qWab")
    >>> javascript(select((q < 0.0) & (W > 0.0), largest(-q / W, 0.0), a - (b - 1.5)))
    '(q<0&&W>0?max(-q/W,0):a-(b-1.5))'
    """
    match node:
        case Name(name):
            return name
        case Constant(text):
            return SPELT.get(text) or re.sub(r"\.0$|\.0(?=e)", "", text).replace("inf", "Infinity")
        case Operation(name, operands) if name not in RANKS:
            return f"{name}({','.join(map(javascript, operands))})"
        case Operation("if", operands):
            condition, a, b = map(javascript, operands)
            return f"({condition}?{a}:{b})"
        case Operation("-", (operand,)):
            inner = javascript(operand)
            return f"-({inner})" if rank(operand) <= RANKS["*"] or inner[0] == "-" else f"-{inner}"
        case Operation("not", (operand,)):
            return f"!({javascript(operand)})"
        case Operation("and" | "or" as name, operands):
            return SPELT[name].join(_operand(each, RANKS["not"]) for each in operands)
        case Operation(name, (a, b)):
            own = RANKS[name]
            left, right = _operand(a, own), _operand(b, own + 1)
            gap = " " * (name == right[0] == "-")
            return f"{left}{SPELT.get(name, name)}{gap}{right}"
    raise TypeError(f"{node!r} is no name, number or operation")


def _operand(operand: Expression, least: float) -> str:
    """Return an operand, in parentheses where its own operation would come later than the one of the ``least`` rank."""
    text = javascript(operand)
    selects = isinstance(operand, Operation) and operand.operation == "if"
    return f"({text})" if rank(operand) < least and not selects else text


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
    y: dict[Expression, Expression] = {Name(name): node(value) for name, value in run.y.items()}
    known: dict[Expression, Expression] = {Name(name): node(value) for name, value in run.coefficients.items()}
    known[Name("tol")] = expression(run.tol)
    given = known | y
    first = program.assignments(run.y | run.coefficients | inputs)
    formulas = [f"{each.name}={javascript(each.value)}" for each in first if Name(each.name) not in given]
    assumed = [*program.assumptions(), *(Name(name) > 0.0 for name in run.positive())]
    checks = dict.fromkeys(_printed(each, given) for each in assumed)
    numbers = dict.fromkeys(value.name for value in (run.y | run.coefficients).values() if isinstance(value, Formula))
    checks[f"finite({','.join(numbers)})"] = None
    now = [Assign("now", Name("k") + 1.0)] if in_time else []
    step = [_assignment(each, {}) for each in (*now, *in_time)]
    step += [_statement(each, known, run) for each in writer.statements]
    start = {str(name): javascript(value) for name, value in y.items()}
    start |= dict.fromkeys([*(f"P{i}" for i in range(laws * nc)), *(f"r{i}" for i in range(nc)), "bad"], "0")
    set_in_step = assigned((*now, *in_time)).union(*(_targets(each, run) for each in writer.statements))
    W = [_printed(Name(f"W_{law}_{i}_{j}"), known) for law, i, j in np.ndindex(laws, nc, nc)]
    rows = [f"rows{law}={_rows(run, law, known)}" for law in range(laws if nc > 1 else 0)]
    return "".join(
        [
            f"(p,{steps},out)=>{{",
            "const {q:Q,v:V,r:R,L,z:Z,W:X}=out,",
            ",".join([*(f"p{i}=p[{i}]" for i in range(traced.sets)), *formulas]),
            f";if(!({'&&'.join(checks)}))return -1;X.set([{','.join(W)}]);",
            *(f"const {each};" for each in rows),
            f"let {','.join([*(f'{name}={value}' for name, value in start.items()), *sorted(set_in_step - {*start})])};",
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
    constant = [(i, load) for i, load in d.loads if not callable(load)]
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
    formulas = program.assignments(used, assumed=False)
    read = used.keys() | set[str]().union(*(names(each.value) for each in formulas))
    known = [f"{each.name}=p[{i}]" for i, each in enumerate(program.parameters) if each.name in read]
    parts = [f"{name}:[{','.join(map(_list, part))}]" for name, part in rows.items()]
    parts += [f"{name}:{_list(each)}" for name, each in lists.items()]
    defined = ",".join([*known, *(f"{each.name}={javascript(each.value)}" for each in formulas)])
    return f"p=>{{{f'const {defined};' if defined else ''}return {{{','.join(parts)}}}}}"


def _list(numbers: Iterable[Number]) -> str:
    return f"[{','.join(javascript(node(each)) for each in numbers)}]"


def _printed(node: Expression, known: Known) -> str:
    return javascript(replaced(node, known))


def _assignment(statement: Assign, known: Known) -> str:
    return f"{statement.name}={_printed(statement.value, known)};"


def _rows(run: TracedRun, law: int, known: Known) -> str:
    """Return the rows of a law as an object: W, their bounds, friction and its normal rows.

    Where there is static friction, its coefficients follow, the length of a step, and the rates of the rows by velocities.
    """
    writer = run.writer
    nc = writer.sizes[2]

    def listed(*coefficients: str) -> str:
        return f"[{','.join(_printed(Name(each), known) for each in coefficients)}]"

    def rubbing(coefficient: str) -> str:
        each = [Name(f"{coefficient}_{i}") if normal >= 0 else ZERO for i, normal in enumerate(writer.normals)]
        return f"[{','.join(_printed(name, known) for name in each)}]"

    W = ",".join(listed(*(f"W_{law}_{i}_{j}" for j in range(nc))) for i in range(nc))
    low, high = (listed(*(f"{bound}_{law}_{i}" for i in range(nc))) for bound in ("lower", "upper"))
    rows = f"W:[{W}],low:{low},high:{high},mu:{rubbing('mu')},normals:{[*writer.normals]}"
    if _holds(writer):
        H = [
            listed(*(f"H_{i}_{j}" for j in range(writer.n))) if normal >= 0 else "[]"
            for i, normal in enumerate(writer.normals)
        ]
        clock = run.traced.clock
        rows += f",mus:{rubbing('mu_s')},h:{clock.end.name}/{clock.steps.name},H:[{','.join(H)}]"
    return f"{{{rows}}}"


def _holds(writer: StepWriter) -> bool:
    """Return whether some friction is static at first."""
    return any(array == "mu_s" for array, _ in writer.coefficients.values())


def _solved(solve: SolveLaw, writer: StepWriter) -> str:
    """Return the statements that solve a law by its cases: ``solveRows`` or ``solveHolding`` of the page."""
    first = solve.law * solve.nc
    lists = [",".join(f"{name}{start + i}" for i in range(solve.nc)) for name, start in (("on", 0), ("P", first))]
    z = "".join(f"z{first + i}=z[{i}];" for i in range(solve.nc))
    given = f"rows{solve.law},[{','.join(map(str, solve.q))}],[{lists[0]}],[{lists[1]}]"
    if _holds(writer):
        state = ",".join(f"y{i}" for i in range(2 * writer.n))
        found = f"solveHolding({given},[{state}])"
    else:
        found = f"solveRows({given})"
    return f"z={found};if(!z)return k;{z}"


def _statement(statement: StepStatement, known: Known, run: TracedRun) -> str:
    """Return a statement of a step in JavaScript, without what only measures the residual."""
    n = run.writer.n
    _, _, nc, laws = run.writer.sizes
    match statement:
        case Assign("worst", _) | When(_, (Assign("worst", _),)):
            return ""
        case Assign("z", value):  # of a law of one row: 0, and another value if its contact takes part
            return _assignment(statement, known) + f"on0={str(value != ZERO).lower()};"
        case Assign(name, Name("z")):
            return f"{name}=z;" + _kept(int(name[1:]), 1, laws)
        case Assign():
            return _assignment(statement, known)
        case When(condition, then):
            inner = "".join(_statement(each, known, run) for each in then)
            return f"if({_printed(condition, known)}){{{inner}}}"
        case Unless(condition):
            return f"if(!({_printed(condition, known)}))return k;"
        case SolveLaw(law) if run.closed:
            lines = "".join(_assignment(each, known) for each in two_row_law(statement))
            return f"{lines}if(bad){{{_solved(statement, run.writer)}bad=0;}}{_kept(law, nc, laws * nc)}"
        case SolveLaw(law):
            active = [f"{each.name}={_printed(each.value, known)};" for each in _active(statement)]
            return "".join(active) + _solved(statement, run.writer) + _kept(law, nc, laws * nc)
        case StoreStatement(array, column, value):
            place = _place(nc, column) if array == "r" else _place(n, n + column)
            return f"{array.upper()}{place}={value};"


def _active(solve: SolveLaw) -> list[Assign]:
    """Return the statements that say which rows of a law are active."""
    return [Assign(f"on{i}", condition) for i, condition in enumerate(solve.touching)]


def _targets(statement: StepStatement, run: TracedRun) -> set[str]:
    """Return the variables that a printed statement sets."""
    match statement:
        case StoreStatement():
            return set()
        case SolveLaw(law, nc):
            found = {"z", *(f"z{law * nc + i}" for i in range(nc))}
            return found | assigned(two_row_law(statement) if run.closed else _active(statement))
        case Assign("z", _):
            return {"z", "on0"}
        case When(_, then):
            return set[str]().union(*(_targets(each, run) for each in then))
        case Assign("worst", _):
            return set()
        case _:
            return assigned([statement])


def _kept(law: int, nc: int, width: int) -> str:
    """Return the assignments that keep the LCP of a law and its solution."""
    places = [_place(width, law * nc + i) for i in range(nc)]
    return "".join(f"L{at}=on{i}?free{i}:NaN;Z{at}=z{law * nc + i};" for i, at in enumerate(places))


def _place(width: int, column: int) -> str:
    """Return the index of a column in row k of an array."""
    return f"[{'k' if width == 1 else f'k*{width}'}{f'+{column}' if column else ''}]"
