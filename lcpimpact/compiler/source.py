"""The source of a function, and what its names tell."""

from __future__ import annotations

import ast
import inspect
import textwrap
from collections import Counter
from functools import cache, lru_cache
from types import CodeType
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
    text, then = python.__dict__.get("text"), python.__code__
    if text is None:
        text = textwrap.dedent(inspect.getsource(python))
        now = _codes("".join(inspect.findsource(python)[0])).get((then.co_qualname, then.co_firstlineno))
        if now is None or _said(now) != _said(then):
            raise CompileError(f"{then.co_filename} has changed since {python.__qualname__} was imported")
    tree = ast.parse(text).body[0]
    assert isinstance(tree, ast.FunctionDef)
    return tree


@lru_cache(maxsize=8)
def _codes(text: str) -> dict[tuple[str, int], CodeType]:
    """Return the codes of the functions in the text of a file, by their names and first lines."""
    found = [compile(text, "", "exec", dont_inherit=True)]
    for each in found:
        found += [inner for inner in each.co_consts if isinstance(inner, CodeType)]
    return {(each.co_qualname, each.co_firstlineno): each for each in found}


def _said(code: CodeType) -> str:
    """Return all of a code that its source says."""
    return repr((code.co_code, code.co_varnames, code.co_names, code.co_freevars, code.co_consts))


def stores(tree: ast.AST) -> Counter[str]:
    """Return how many times names are assigned in some statements."""
    return Counter(each.id for each in ast.walk(tree) if isinstance(each, ast.Name) and isinstance(each.ctx, ast.Store))


def never_negative(tree: ast.FunctionDef) -> set[str]:
    """Return the names that only loops over ranges of numbers that are not negative assign."""
    loops, others = dict[str, list[ast.Call]](), {each.arg for each in tree.args.args}
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
        case [start, stop, ast.UnaryOp(op=ast.USub(), operand=ast.Constant())]:
            return ast.unparse(stop) == "-1" or positive(stop)
        case [start, _, step]:
            return positive(start) and positive(step)
    return False
