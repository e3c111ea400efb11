"""The source of a function, and what its names tell."""

from __future__ import annotations

import ast
import inspect
import textwrap
from collections import Counter
from functools import cache
from typing import Any

from lcpimpact.compiler.writer import CompileError


@cache
def source_of(python: Any) -> ast.FunctionDef:
    """Return the statements of a function, from its text if that was generated.

    Raises
    ------
    CompileError
        If the text in its file is not what is imported.
    """
    text = python.__dict__.get("text") or textwrap.dedent(inspect.getsource(python))
    tree = ast.parse(text).body[0]
    assert isinstance(tree, ast.FunctionDef)
    plain = ast.Module([ast.FunctionDef(tree.name, _bare(tree.args), tree.body, [], lineno=1, col_offset=0)], [])
    now, then = compile(ast.fix_missing_locations(plain), "", "exec").co_consts[0], python.__code__
    if repr((now.co_varnames, now.co_consts)) != repr((then.co_varnames, then.co_consts)):
        raise CompileError(f"{python.__code__.co_filename} has changed since {python.__qualname__} was imported")
    return tree


def _bare(arguments: ast.arguments) -> ast.arguments:
    """Return arguments without annotations and default values."""
    return ast.arguments([], [ast.arg(each.arg) for each in arguments.args], None, [], [], None, [])


def stores(tree: ast.AST) -> Counter[str]:
    """Return how many times names are assigned in some statements."""
    return Counter(each.id for each in ast.walk(tree) if isinstance(each, ast.Name) and isinstance(each.ctx, ast.Store))


def never_negative(tree: ast.AST) -> set[str]:
    """Return the names that only loops over ranges of numbers that are not negative assign."""
    loops, others = dict[str, list[ast.Call]](), set[str]()
    for each in ast.walk(tree):
        match each:
            case ast.For(target=ast.Name(id=name), iter=ast.Call(func=ast.Name(id="range")) as call):
                loops.setdefault(name, []).append(call)
            case ast.For(
                target=ast.Tuple(elts=[ast.Name(id=name), item]), iter=ast.Call(func=ast.Name(id="enumerate"))
            ):
                loops.setdefault(name, [])
                others |= set(stores(item))
            case ast.For(target=target):
                others |= set(stores(target))
            case ast.Assign() | ast.AugAssign() | ast.AnnAssign():
                others |= set(stores(each))
    candidates = set(loops) - others
    while True:
        wrong = {
            name for name in candidates for call in loops[name] if not _from_zero(call, candidates)
        }  # fmt: skip
        if not wrong:
            return candidates
        candidates -= wrong


def _from_zero(call: ast.Call, candidates: set[str]) -> bool:
    """Return whether all numbers of a range are known not to be negative."""

    def positive(node: ast.expr) -> bool:
        match node:
            case ast.Constant(value=int(number)):
                return number >= 0
            case ast.Name(id=name):
                return name in candidates
            case ast.BinOp(left=left, op=ast.Add() | ast.Mult(), right=right):
                return positive(left) and positive(right)
            case ast.Call(func=ast.Name(id="len")):
                return True
            case ast.Subscript(value=ast.Attribute(attr="shape")):
                return True
        return False

    match call.args:
        case [_]:
            return True
        case [start, _]:
            return positive(start)
        case [start, stop, ast.UnaryOp(op=ast.USub())]:
            return ast.unparse(stop) == "-1" or positive(stop)
        case [start, _, step]:
            return positive(start) and positive(step)
    return False
