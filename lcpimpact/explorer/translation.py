"""Functions and classes of the package as JavaScript, so that a page computes, checks and refuses as Python does.

What is translated is the language in which the package states its steps, elements and checks: arithmetic on numbers and
arrays, loops, comprehensions, formatted strings and classes with fields. What a translated function calls is translated too,
down to what runtime.js holds: the operations of Python and NumPy. Anything else is refused (`TypeError`), and never
translated by halves.

Two kinds of functions differ in their operators: in compiled functions these act on numbers and the entries of arrays, and
are JavaScript's own; in others they may act on whole arrays, and are calls of runtime.js.
"""

from __future__ import annotations

import ast
import inspect
import json
import math
import re
import textwrap
from collections.abc import Iterable, Sequence
from dataclasses import MISSING, dataclass, field, fields, is_dataclass
from enum import Enum
from functools import cache, cached_property
from importlib.resources import files
from types import FunctionType, ModuleType
from typing import Any

RESERVED = {"default", "delete", "function", "in", "new", "static", "switch", "this", "typeof", "var", "void"}
"""Words of JavaScript that Python takes for names."""

SYMBOLS: dict[type[ast.AST], str] = {
    ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/", ast.Mod: "%", ast.Pow: "**", ast.BitAnd: "&",
    ast.BitOr: "|", ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">=", ast.Eq: "==", ast.NotEq: "!=",
}  # fmt: skip

OPERATIONS: dict[type[ast.AST], str] = {
    ast.Add: "add", ast.Sub: "sub", ast.Mult: "mul", ast.Div: "div", ast.MatMult: "matmul", ast.BitAnd: "both",
    ast.BitOr: "either", ast.Lt: "lt", ast.LtE: "le", ast.Gt: "gt", ast.GtE: "ge", ast.Eq: "eq", ast.NotEq: "ne",
}  # fmt: skip
"""Functions of runtime.js for operators that may act on arrays."""

METHODS = {
    "all", "any", "append", "astype", "copy", "extend", "get", "items", "join", "keys", "max", "removeprefix", "setdefault",
    "startswith", "sum", "tolist", "values",
}  # fmt: skip
"""Methods of Python's and NumPy's own objects, which are functions of runtime.js with the object first."""

EXCEPTIONS = {"TypeError", "ValueError"}
"""Exceptions that only a defect raises here."""

EXTREMES = {"max": "largest", "min": "smallest"}
"""Functions of runtime.js for the extremes of one sequence; those of two numbers are functions of engine.js."""

SPECIAL = {"T": "transpose", "shape": "shape", "size": "size"}
"""Attributes of arrays, which are functions of runtime.js."""


CONSTANTS = {"reaction", "laws", "instants", "remembers", "impact_steps", "name", "split", "strokes"}
"""Constants of classes that are kept."""


@cache
def runtime_names() -> frozenset[str]:
    """Return the names that runtime.js and engine.js define."""
    text = "".join(
        (files("lcpimpact.explorer") / name).read_text(encoding="utf-8") for name in ("engine.js", "runtime.js")
    )
    lines = [line for line in text.split("\n") if line.startswith(("const ", "let "))]
    found = re.findall(r"^(?:function\*?|class) ([^\W\d]\w*)", text, re.MULTILINE)
    found += [name for line in lines for name in re.findall(r"(?:^const |, )([^\W\d]\w*) = ", line)]
    unpacked = re.findall(r"^const \{([^}]*)\} = ", text, re.MULTILINE)
    return frozenset([*found, *(name.strip() for line in unpacked for name in line.split(","))])


@cache
def numpy_names() -> frozenset[str]:
    """Return the functions of NumPy that runtime.js has."""
    text = (files("lcpimpact.explorer") / "runtime.js").read_text(encoding="utf-8")
    return frozenset(re.findall(r"\w+", text.split("const np = {")[1].split("\n};")[0]))


def python_of(function: Any) -> Any:
    """Return the Python function of a compiled one."""
    return getattr(function, "py_func", function)


def is_compiled(function: Any) -> bool:
    """Return whether a function is compiled, or was declared to be where compilation is switched off."""
    source = inspect.getsource(python_of(function))
    return source.lstrip().startswith(("@compiled", "@intrinsic"))


@dataclass
class Translation:
    """The translated definitions, in their order.

    Attributes
    ----------
    names : dict        JavaScript's name of each function and class, by its identity
    sources : dict      name to source
    given : set of str  what the page writes itself: functions and classes by their names, or with their modules before
                        them, and methods as CLASS.NAME or .NAME of any class
    only : dict         the methods and constants that are wanted of a class and what derives from it; its bases are left out
    """

    given: set[str] = field(default_factory=set)
    only: dict[type, set[str]] = field(default_factory=dict)
    names: dict[int, str] = field(default_factory=dict)
    sources: dict[str, str] = field(default_factory=dict)
    kept: list[Any] = field(default_factory=list)

    def add(self, *things: Any) -> None:
        """Translate functions and classes, and all that they use."""
        for each in things:
            self.name(each)

    def name(self, thing: Any) -> str:
        """Return the name of a function or class, which is translated if it has not been."""
        thing = python_of(thing)
        if id(thing) in self.names:
            return self.names[id(thing)]
        name = safe(thing.__name__)
        if not self.given.isdisjoint((name, f"{thing.__module__}.{thing.__name__}")):
            return name
        taken = runtime_names() | {each.rpartition(".")[2] for each in self.given}
        while name in self.sources or name in taken:
            name += "_"
        self.names[id(thing)], self.sources[name] = name, ""
        self.kept.append(thing)  # whose identity must last
        write = self._class if isinstance(thing, type) else self._function
        text = write(thing, name)
        del self.sources[name]
        self.sources[name] = text  # after what it derives from
        return name

    def source(self) -> str:
        """Return all sources, classes after their bases."""
        return "\n".join(self.sources.values())

    def _function(self, function: Any, name: str) -> str:
        (tree,) = ast.parse(textwrap.dedent(inspect.getsource(function))).body
        assert isinstance(tree, ast.FunctionDef)
        return Writer(self, function.__globals__, not is_compiled(function)).function(tree, name)

    def _class(self, kind: Any, name: str) -> str:
        if issubclass(kind, Enum):
            return f"const {name}={json.dumps({each.name: each.value for each in kind}, ensure_ascii=False)};"
        if issubclass(kind, tuple):
            # An array, which is unpacked, with its entries by name.
            names = kind._fields
            named = "".join(f"made.{each}={safe(each)};" for each in names)
            given = ",".join(map(safe, names))
            return f"function {name}({given}){{const made=[{given}];{named}return made}}"
        only = next((names for base, names in self.only.items() if issubclass(kind, base)), None)
        bases = (
            [] if kind in self.only else [each for each in kind.__bases__ if each.__module__.startswith("lcpimpact")]
        )
        head = f"class {name}{f' extends {self.name(bases[0])}' if bases else ''}"
        parts = []
        if is_dataclass(kind) and kind not in self.only:
            parts.append(f"static fields=[{','.join(map(self._field, fields(kind)))}];")
        of_fields = {each.name for each in fields(kind)} if is_dataclass(kind) else set()
        for key in sorted((CONSTANTS & vars(kind).keys()) - of_fields):
            parts.append(f"get {key}(){{return {literal(vars(kind)[key])}}}")
        wanted = {key: value for key, value in vars(kind).items() if only is None or key in only}
        methods = {key: self._method(kind, key, value) for key, value in wanted.items()}
        once = [key for key, text in methods.items() if text and isinstance(wanted[key], cached_property)]
        kept = f"keep({name},{literal(once)});" if once else ""
        return f"{head}{{{''.join([*parts, *methods.values()])}}}{kept}"

    def _field(self, each: Any) -> str:
        """Return the name of a field, and its default if it has one."""
        if each.default_factory is not MISSING:
            empty = {list: "()=>[]", dict: "()=>new Dict()"}.get(each.default_factory)
            return f"[{literal(each.name)},{empty or f'()=>{self.name(each.default_factory)}()'}]"
        if isinstance(each.default, FunctionType):
            return f"[{literal(each.name)},()=>{self.name(each.default)}]"
        return literal([each.name, *([] if each.default is MISSING else [each.default])])

    def _method(self, kind: Any, key: str, value: Any) -> str:
        """Return a method or a property in JavaScript, "" if it is left out."""
        read = isinstance(value, property | cached_property)
        method: Any = value.fget if isinstance(value, property) else value.func if read else value
        left_out = not self.given.isdisjoint((f"{kind.__name__}.{key}", f".{key}"))
        own = isinstance(method, FunctionType) and method.__qualname__ == f"{kind.__qualname__}.{key}"
        special = key.startswith("__") and key not in ("__post_init__", "__str__")
        made = is_dataclass(kind) and key == "__repr__"
        if left_out or not own or special or made or getattr(method, "__isabstractmethod__", False):
            return ""
        (tree,) = ast.parse(textwrap.dedent(inspect.getsource(method))).body
        assert isinstance(tree, ast.FunctionDef)
        writer = Writer(self, method.__globals__, arrays=True)
        return ("get " if read else "") + writer.function(tree, key, method=True)


def safe(name: str) -> str:
    """Return a name that is no word of JavaScript."""
    return f"{name}_" if name in RESERVED else name


def literal(value: Any) -> str:
    """Return a constant in JavaScript; TypeError if it is none.

    Examples
    --------
    >>> literal((1.0, math.inf, None, {"a": "b"}))
    '[1,Infinity,null,new Dict([["a","b"]])]'
    """
    if isinstance(value, bool) or value is None:
        return {True: "true", False: "false", None: "null"}[value]
    if isinstance(value, str):
        return json.dumps(str(value), ensure_ascii=False)
    if isinstance(value, int | float):
        if not math.isfinite(value):
            return "NaN" if math.isnan(value) else "Infinity" if value > 0 else "-Infinity"
        return re.sub(r"\.0$", "", repr(value))
    if isinstance(value, tuple | list):
        return f"[{','.join(map(literal, value))}]"
    if isinstance(value, dict):
        return f"new Dict([{','.join(f'[{literal(k)},{literal(v)}]' for k, v in value.items())}])"
    raise TypeError(f"{value!r} is no constant")


@dataclass
class Writer:
    """Writes one function; ``arrays`` says whether its operators may act on arrays.

    It knows the names that are ``local``, and of the ``functions`` in the function their parameters.
    """

    translation: Translation
    globals: dict[str, Any]
    arrays: bool
    local: set[str] = field(default_factory=set)
    functions: dict[str, list[str]] = field(default_factory=dict)

    def function(self, tree: ast.FunctionDef, name: str, method: bool = False) -> str:
        """Return the function, or a method, under a name."""
        outer, arguments = (self.local, self.functions), tree.args
        given = _parameters(tree)
        defaults = dict(zip(given[::-1], [*arguments.kw_defaults[::-1], *arguments.defaults[::-1]], strict=False))
        names = given[1:] if method else given
        written = [safe(each) + (f"={self.of(defaults[each])}" if defaults.get(each) else "") for each in names]
        if arguments.vararg:
            written.append(f"...{arguments.vararg.arg}")
        inner = {each for part in tree.body for each in _bound(part)} - {*given}
        functions = {each.name: _parameters(each) for each in tree.body if isinstance(each, ast.FunctionDef)}
        rest = {arguments.vararg.arg} if arguments.vararg else set()
        self.functions = self.functions | functions
        self.local = self.local | inner | functions.keys() | {*given} | rest
        yields = any(map(_yields, tree.body))
        declared = f"let {','.join(map(safe, sorted(inner)))};" if inner else ""
        own = "const self=this;" if method else ""
        head = f"{'*' if yields else ''}{name}" if method else f"function{'*' if yields else ''} {name}"
        text = f"{head}({','.join(written)}){{{own}{declared}{self.body(tree.body)}}}"
        self.local, self.functions = outer
        return text

    def body(self, statements: Iterable[ast.stmt]) -> str:
        """Return statements."""
        return "".join(self.statement(each) for each in statements)

    def statement(self, node: ast.stmt) -> str:
        """Return one statement."""
        write = getattr(self, f"_{type(node).__name__}", None)
        if write is None:
            raise TypeError(f"{ast.unparse(node)} is not translated")
        return str(write(node))

    def of(self, node: ast.expr | None) -> str:
        """Return one expression."""
        if node is None:
            return "null"
        write = getattr(self, f"_{type(node).__name__}", None)
        if write is None:
            raise TypeError(f"{ast.unparse(node)} is not translated")
        return str(write(node))

    def test(self, node: ast.expr) -> str:
        """Return a condition."""
        if isinstance(node, ast.BoolOp):
            sign = "&&" if isinstance(node.op, ast.And) else "||"
            return f"({sign.join(map(self.test, node.values))})"
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
            return f"!{self.test(node.operand)}"
        return f"truth({self.of(node)})" if self.arrays else f"({self.of(node)})"

    # Statements.

    def _Expr(self, node: ast.Expr) -> str:
        return "" if isinstance(node.value, ast.Constant) else f"{self.of(node.value)};"

    def _Return(self, node: ast.Return) -> str:
        return f"return {self.of(node.value)};" if node.value else "return;"

    def _Pass(self, node: ast.Pass) -> str:
        return ""

    def _Break(self, node: ast.Break) -> str:
        return "break;"

    def _Continue(self, node: ast.Continue) -> str:
        return "continue;"

    def _Raise(self, node: ast.Raise) -> str:
        return f"throw {self.of(node.exc)};"

    def _FunctionDef(self, node: ast.FunctionDef) -> str:
        return self.function(node, safe(node.name))

    def _If(self, node: ast.If) -> str:
        other = f"else{{{self.body(node.orelse)}}}" if node.orelse else ""
        return f"if({self.test(node.test)}){{{self.body(node.body)}}}{other}"

    def _While(self, node: ast.While) -> str:
        return f"while({self.test(node.test)}){{{self.body(node.body)}}}"

    def _For(self, node: ast.For) -> str:
        if node.orelse:
            raise TypeError(f"{ast.unparse(node)} is not translated")
        if self._is_range(node.iter) and isinstance(node.target, ast.Name):
            assert isinstance(node.iter, ast.Call)
            first, last, step = self._range(node.iter)
            i, down = safe(node.target.id), step.startswith("(-")
            return f"for({i}={first};{i}{'>' if down else '<'}{last};{i}+={step}){{{self.body(node.body)}}}"
        return f"for({self._target(node.target)} of iter({self.of(node.iter)})){{{self.body(node.body)}}}"

    def _is_range(self, node: ast.expr) -> bool:
        called = isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "range"
        return called and not _unpacks(node)  # type: ignore[arg-type]

    def _range(self, node: ast.Call) -> tuple[str, str, str]:
        given = list(map(self.of, node.args))
        return ("0", given[0], "1") if len(given) == 1 else (given[0], given[1], given[2] if len(given) > 2 else "1")

    def _Assign(self, node: ast.Assign) -> str:
        value = self.of(node.value)
        if len(node.targets) > 1:
            names = [self._target(each) for each in node.targets]
            return f"{'='.join(names)}={value};"
        target = node.targets[0]
        if self.arrays and isinstance(target, ast.Subscript):
            return f"{self._put(target, value)};"
        if self.arrays and isinstance(target, ast.Tuple) and any(isinstance(e, ast.Subscript) for e in target.elts):
            puts = [
                self._put(each, f"found[{i}]") if isinstance(each, ast.Subscript) else f"{self.of(each)}=found[{i}]"
                for i, each in enumerate(target.elts)
            ]
            return f"{{const found={value};{';'.join(puts)}}}"
        if isinstance(target, ast.Tuple):
            stars = [i for i, each in enumerate(target.elts) if isinstance(each, ast.Starred)]
            if stars and stars[0] < len(target.elts) - 1:
                plain = [each.value if isinstance(each, ast.Starred) else each for each in target.elts]
                parts = f"parted({value},{stars[0]},{len(plain) - 1 - stars[0]})"
                return f"[{','.join(map(self._target, plain))}]={parts};"
            return f"{self._target(target)}=[...iter({value})];" if self.arrays else f"{self._target(target)}={value};"
        return f"{self._target(target)}={value};"

    def _AnnAssign(self, node: ast.AnnAssign) -> str:
        return f"{self._target(node.target)}={self.of(node.value)};" if node.value else ""

    def _AugAssign(self, node: ast.AugAssign) -> str:
        if not self.arrays:
            return f"{self.of(node.target)}{SYMBOLS[type(node.op)]}={self.of(node.value)};"
        # A list that others hold must grow by `extend`: here += makes a new one.
        value = f"{OPERATIONS[type(node.op)]}({self.of(node.target)},{self.of(node.value)})"
        if isinstance(node.target, ast.Subscript):
            return f"{self._put(node.target, value)};"
        return f"{self.of(node.target)}={value};"

    def _put(self, target: ast.Subscript, value: str) -> str:
        return f"put({self.of(target.value)},{value},{','.join(self._keys(target))})"

    def _target(self, node: ast.expr) -> str:
        if isinstance(node, ast.Tuple | ast.List):
            return f"[{','.join(map(self._target, node.elts))}]"
        if isinstance(node, ast.Starred):
            return f"...{self._target(node.value)}"
        return self.of(node)

    # Expressions.

    def _Constant(self, node: ast.Constant) -> str:
        return literal(node.value)

    def _Name(self, node: ast.Name) -> str:
        if node.id in self.local:
            return safe(node.id)
        if node.id in self.translation.given:
            return node.id
        if node.id in self.globals:
            return self._global(self.globals[node.id], node.id)
        if node.id == "abs" and self.arrays:
            return "np.abs"
        if node.id in runtime_names():
            return node.id
        if node.id in EXCEPTIONS:
            return "Error"
        raise TypeError(f"{node.id} is not in runtime.js")

    def _global(self, value: Any, name: str) -> str:
        value = python_of(value)
        own = getattr(value, "__module__", "").startswith("lcpimpact")
        if isinstance(value, FunctionType | type) and own and name in self.translation.given:
            return name
        if isinstance(value, FunctionType | type) and own:
            return self.translation.name(value)
        if name in runtime_names():
            return name
        try:
            return literal(value)
        except TypeError:
            raise TypeError(f"{name} is not in runtime.js") from None

    def _Attribute(self, node: ast.Attribute) -> str:
        if isinstance(node.value, ast.Name) and isinstance(self.globals.get(node.value.id), ModuleType):
            value = getattr(self.globals[node.value.id], node.attr)
            if isinstance(value, float):
                return literal(value)
            if node.value.id == "np" and node.attr in numpy_names():
                return f"np.{node.attr}"
            if node.attr in runtime_names():
                return node.attr
            if getattr(value, "__module__", "").startswith("lcpimpact"):
                return self._global(value, node.attr)
            raise TypeError(f"{ast.unparse(node)} is not in runtime.js")
        if node.attr == "__name__":
            return f"name_of_type({self.of(node.value)})"
        if self.arrays and node.attr in SPECIAL:
            return f"{SPECIAL[node.attr]}({self.of(node.value)})"
        return f"{self.of(node.value)}.{node.attr}"

    def _Subscript(self, node: ast.Subscript) -> str:
        keys = self._keys(node)
        if self.arrays:
            return f"get({self.of(node.value)},{','.join(keys)})"
        if any(each.startswith("slice(") for each in keys):
            (part,) = keys
            return f"subarray({self.of(node.value)},{part[6:-1]})"
        index = node.slice
        if isinstance(index, ast.Name) and index.id in ("active", "free") and not isinstance(node.ctx, ast.Store):
            return f"take({self.of(node.value)},{index.id})"  # the rows of a vector of indices
        return self.of(node.value) + "".join(f"[{each}]" for each in keys)

    def _keys(self, node: ast.Subscript) -> list[str]:
        keys = node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]
        return list(map(self.of, keys))

    def _Slice(self, node: ast.Slice) -> str:
        ends = [self.of(each) if each else "null" for each in (node.lower, node.upper, node.step)]
        return f"slice({','.join(ends if node.step else ends[:2])})"

    def _Tuple(self, node: ast.Tuple) -> str:
        return f"[{','.join(map(self.of, node.elts))}]"

    def _List(self, node: ast.List) -> str:
        return f"[{','.join(map(self.of, node.elts))}]"

    def _Set(self, node: ast.Set) -> str:
        return f"new Set([{','.join(map(self.of, node.elts))}])"

    def _Dict(self, node: ast.Dict) -> str:
        pairs = [
            f"[{self.of(key)},{self.of(value)}]" if key else f"...{self.of(value)}"
            for key, value in zip(node.keys, node.values, strict=True)
        ]
        return f"new Dict([{','.join(pairs)}])"

    def _Starred(self, node: ast.Starred) -> str:
        return f"...iter({self.of(node.value)})"

    def _JoinedStr(self, node: ast.JoinedStr) -> str:
        return f"[{','.join(map(self.of, node.values))}].join('')"

    def _FormattedValue(self, node: ast.FormattedValue) -> str:
        if node.conversion == ord("r"):
            return f"repr({self.of(node.value)})"
        if node.format_spec:
            return f"format({self.of(node.value)},{self.of(node.format_spec)})"
        return f"str({self.of(node.value)})"

    def _NamedExpr(self, node: ast.NamedExpr) -> str:
        return f"({self.of(node.target)}={self.of(node.value)})"

    def _IfExp(self, node: ast.IfExp) -> str:
        return f"({self.test(node.test)}?{self.of(node.body)}:{self.of(node.orelse)})"

    def _UnaryOp(self, node: ast.UnaryOp) -> str:
        if isinstance(node.op, ast.Not):
            return f"!{self.test(node.operand)}"
        if isinstance(node.op, ast.Invert):
            return f"invert({self.of(node.operand)})"
        if isinstance(node.operand, ast.Constant) or not self.arrays:
            return f"(-{self.of(node.operand)})"
        return f"negative({self.of(node.operand)})"

    def _BinOp(self, node: ast.BinOp) -> str:
        a, b = self.of(node.left), self.of(node.right)
        if isinstance(node.op, ast.Pow):
            if not (isinstance(node.right, ast.Constant) and node.right.value == 2):
                raise TypeError(f"{ast.unparse(node)} is not translated")
            return f"square({a})"
        return f"{OPERATIONS[type(node.op)]}({a},{b})" if self.arrays else f"({a}{SYMBOLS[type(node.op)]}{b})"

    def _BoolOp(self, node: ast.BoolOp) -> str:
        if not self.arrays:
            return self.test(node)
        name = "and" if isinstance(node.op, ast.And) else "or"
        text = self.of(node.values[-1])
        for each in reversed(node.values[:-1]):
            text = f"{name}({self.of(each)},()=>{text})"
        return text

    def _Compare(self, node: ast.Compare) -> str:
        terms = [node.left, *node.comparators]
        pairs = [self._pair(a, op, b) for a, op, b in zip(terms, node.ops, terms[1:], strict=False)]
        return pairs[0] if len(pairs) == 1 else f"({'&&'.join(pairs)})"

    def _pair(self, left: ast.expr, op: ast.cmpop, right: ast.expr) -> str:
        a, b = self.of(left), self.of(right)
        if isinstance(op, ast.Is | ast.IsNot):
            return f"({a}{'==' if isinstance(op, ast.Is) else '!='}{b})"
        if isinstance(op, ast.In | ast.NotIn):
            return f"{'!' if isinstance(op, ast.NotIn) else ''}has({b},{a})"
        if self.arrays:
            return f"{OPERATIONS[type(op)]}({a},{b})"
        sign = {"==": "===", "!=": "!=="}.get(SYMBOLS[type(op)], SYMBOLS[type(op)])
        return f"({a}{sign}{b})"

    def _Lambda(self, node: ast.Lambda) -> str:
        names = [each.arg for each in node.args.args]
        return self._within(names, lambda: f"(({','.join(names)})=>{self.of(node.body)})")

    def _within(self, names: Sequence[str], write: Any) -> str:
        outer, self.local = self.local, self.local | {*names}
        text = str(write())
        self.local = outer
        return text

    def _ListComp(self, node: ast.ListComp) -> str:
        return self._comprehension(node.generators, lambda: self.of(node.elt))

    def _SetComp(self, node: ast.SetComp) -> str:
        return f"new Set({self._comprehension(node.generators, lambda: self.of(node.elt))})"

    def _GeneratorExp(self, node: ast.GeneratorExp) -> str:
        return f"(function*(){{{self._loops(node.generators, lambda: f'yield {self.of(node.elt)};')}}})()"

    def _loops(self, generators: list[ast.comprehension], write: Any) -> str:
        if not generators:
            return str(write())
        first, *others = generators
        source = self.of(first.iter)

        def inner() -> str:
            conditions = "&&".join(map(self.test, first.ifs))
            head = f"for(const {self._target(first.target)} of iter({source}))"
            return f"{head}{f'if({conditions})' if conditions else ''}{{{self._loops(others, write)}}}"

        return self._within(sorted(_stored(first.target)), inner)

    def _DictComp(self, node: ast.DictComp) -> str:
        pairs = self._comprehension(node.generators, lambda: f"[{self.of(node.key)},{self.of(node.value)}]")
        return f"new Dict({pairs})"

    def _comprehension(self, generators: list[ast.comprehension], write: Any) -> str:
        first, *others = generators
        source = self.of(first.iter)

        def inner() -> str:
            value = self._comprehension(others, write) if others else f"[{write()}]"
            conditions = "&&".join(map(self.test, first.ifs))
            return f"({self._target(first.target)})=>{f'{conditions}?{value}:[]' if conditions else value}"

        return f"[...iter({source})].flatMap({self._within(sorted(_stored(first.target)), inner)})"

    def _Yield(self, node: ast.Yield) -> str:
        return f"yield {self.of(node.value)}"

    def _YieldFrom(self, node: ast.YieldFrom) -> str:
        return f"yield* iter({self.of(node.value)})"

    # Calls.

    def _Call(self, node: ast.Call) -> str:
        called, given = node.func, list(map(self.of, node.args))
        named = {each.arg: self.of(each.value) for each in node.keywords if each.arg}
        options = f"{{{','.join(f'{key}:{value}' for key, value in named.items())}}}"
        if isinstance(called, ast.Attribute):
            return self._method(called, given, named, options)
        if isinstance(called, ast.Name) and called.id in self.local:
            if named and called.id not in self.functions:
                raise TypeError(f"{ast.unparse(node)} is not translated")
            ordered = _in_order(self.functions[called.id], given, named) if named else given
            return f"{safe(called.id)}({','.join(ordered)})"
        if isinstance(called, ast.Name):
            if called.id in EXTREMES and (len(given) != 2 or named or _unpacks(node)):
                return self._extreme(node, called.id, given, options)
            if called.id == "len" and not self.arrays:
                return f"{given[0]}.length"
            if called.id == "iter":
                return f"iterator({','.join(given)})"
            value = python_of(self.globals.get(called.id))
            if is_dataclass(value):
                return f"make({self.of(called)},[{','.join(given)}],{options})"
            if isinstance(value, FunctionType) and named and value.__module__.startswith("lcpimpact"):
                return f"{self.of(called)}({','.join(_in_order([*inspect.signature(value).parameters], given, named))})"
            own = isinstance(value, type) and value.__module__.startswith("lcpimpact") and not issubclass(value, tuple)
            if called.id in EXCEPTIONS or own:
                return f"new {self.of(called)}({','.join(given)})"
        return f"{self.of(called)}({','.join([*given, *([options] if named else [])])})"

    def _extreme(self, node: ast.Call, name: str, given: list[str], options: str) -> str:
        """Return the extreme of one sequence."""
        if len(given) != 1 or _unpacks(node):
            raise TypeError(f"{ast.unparse(node)} is not translated: give max and min two numbers, or one sequence")
        return f"{EXTREMES[name]}({given[0]},{options})"

    def _method(self, called: ast.Attribute, given: list[str], named: dict[str, str], options: str) -> str:
        inner = called.value
        last = [options] if named else []
        if isinstance(inner, ast.Call) and isinstance(inner.func, ast.Name) and inner.func.id == "super":
            return f"super.{called.attr}({','.join([*given, *last])})"
        if isinstance(inner, ast.Name) and inner.id == "object" and called.attr == "__setattr__":
            return f"{given[0]}[{given[1]}]={given[2]}"
        module = isinstance(inner, ast.Name) and isinstance(self.globals.get(inner.id), ModuleType)
        if called.attr in METHODS and not module and not (isinstance(inner, ast.Name) and inner.id == "dict"):
            return f"{called.attr}_of({','.join([self.of(inner), *given, *last])})"
        if named and not module:
            given, last = [*given, *named.values()], []  # after all others, in the order of the method
        return f"{self.of(called)}({','.join([*given, *last])})"


def _parameters(tree: ast.FunctionDef) -> list[str]:
    """Return the names of the parameters of a function, in the order in which JavaScript takes them."""
    return [each.arg for each in (*tree.args.posonlyargs, *tree.args.args, *tree.args.kwonlyargs)]


def _in_order(parameters: Sequence[str], given: list[str], named: dict[str, str]) -> list[str]:
    """Return the arguments of a call by their positions."""
    parameters = parameters[len(given) :]
    last = max(parameters.index(name) for name in named) + 1
    return [*given, *(named.get(name, "undefined") for name in parameters[:last])]


def _stored(node: ast.AST) -> set[str]:
    """Return the names that a target binds."""
    return {each.id for each in ast.walk(node) if isinstance(each, ast.Name) and isinstance(each.ctx, ast.Store)}


def _unpacks(node: ast.Call) -> bool:
    """Return whether a call unpacks a sequence into arguments."""
    return any(isinstance(each, ast.Starred) for each in node.args)


def _yields(node: ast.AST) -> bool:
    """Return whether a statement yields, outside of functions in it."""
    if isinstance(node, ast.FunctionDef):
        return False
    return isinstance(node, ast.Yield | ast.YieldFrom) or any(map(_yields, ast.iter_child_nodes(node)))


def _bound(node: ast.AST) -> set[str]:
    """Return the names that a statement binds, outside of comprehensions and functions in it."""
    if isinstance(node, ast.FunctionDef):
        return set()
    if isinstance(node, ast.ListComp | ast.GeneratorExp | ast.DictComp | ast.SetComp | ast.Lambda):
        return {each.target.id for each in ast.walk(node) if isinstance(each, ast.NamedExpr)}
    own = {node.id} if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store) else set()
    return own.union(*map(_bound, ast.iter_child_nodes(node)))
