"""The structure of the package in numbers: how many mechanisms one idea has, counted from the syntax trees.

    python benchmarks/structure.py [--places KEY] [--json FILE] [--record LABEL]

It prints a table of what is counted, now and as wanted. ``--places`` lists where a count comes from, ``--json`` writes all
counts with their places, and ``--record`` keeps the counts as a column of benchmarks/structure.csv, from which
docs/benchmarks/structure.md is made. The bounds that tests/test_architecture.py keeps are of these counts.

What is counted:

row laws
    Files that know one law of a row from another: by a flag (an attribute of a name in ``FLAGS``, read or defined), by a
    code (``RowLaw`` outside annotations, or a comparison with the name of a law in capitals), or by ``isinstance`` or a
    ``case`` of a class that ``LAWS`` defines. An element that only says which law its row has, ``law=...`` in a call, does
    not count, and neither does an annotation.
    Questions that may be asked of any law do not count: whether it is of the rate,
    or its reaction one-sided or limited.
judges, assemblies, executors, representations, numerics
    Functions and classes in ``MECHANISMS``, by name. One that is no longer in the tree ends the script: it is struck from
    the list where it is gone, and named anew where it has moved.
frames
    Calls of the package from `simulate`, which counts, to the kernel of the LCP, which does not, in a run of System 1 by
    moreau-jean in the interpreter; the most frequent path.
numeric constants
    Names in capitals at the top of a module that are given a number: a literal, arithmetic of literals and other
    constants, numpy's `finfo`. Those of assignments like ``A, B = 1, 2`` and ``A, B = range(2)`` are counted apart.
shared constants
    Definitions of the names in ``SHARED``, which shall have one place and one value each.
tuple assignments
    Assignments ``a, b, c = ...`` to three names or more; the results of one call do not count.
names a code line
    Names in expressions over lines that are neither blank, comments nor docstrings.
class names
    Names of classes at the top of two modules or more.
Any
    ``Any`` outside imports, and ``object`` in annotations.
signatures
    Decorators that compile a function for a signature which they are given.
lines
    Lines of all .py files; two statements that a ``;`` joins are two lines.
docstrings
    Docstrings, of attributes too, that begin with "What", "That of", "Those of", "The same" or "As of", after "Return" too.
kept state
    `cached_property`, and writes into frozen objects: ``object.__setattr__(...)``, ``vars(...)[...] =``,
    ``vars(...).update(...)`` and the like.
import circles
    Sets of modules that import one another, under ``TYPE_CHECKING`` too.
"""

from __future__ import annotations

import argparse
import ast
import gc
import json
import os
import re
import subprocess
import sys
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Set
from functools import cache, partial
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import pandas as pd
from rich.console import Console
from rich.table import Table
from tiny import add_tiny

ROOT = Path(__file__).parent.parent

PACKAGE = ROOT / "lcpimpact"

CSV = Path(__file__).parent / "structure.csv"

PAGE = ROOT / "docs" / "benchmarks" / "structure.md"

FLAGS = {"unilateral", "slides", "frictional", "relays", "joints"}

CODES = {"CONTACT", "SLIDER", "FRICTION", "JOINT", "RELAY"}

LAWS = "scheme/laws.py"
"""Module of the laws of rows."""

SHARED = {"ROUNDING", "ZERO_RTOL", "SCALE_FLOOR", "ACCUMULATION_RTOL"}

VAGUE = re.compile(r"((Return|Yield) )?([Ww]hat|[Tt]hat of|[Tt]hose of|[Tt]he same|[Aa]s of)\b")
"""Beginnings of docstrings that have no noun."""

MECHANISMS = {
    "judges of momentum": (
        "certificate/balances.py:momentum_imbalances",
        "integrators/stepping/sparse_kernel.py:judge_all_nodes",
    ),
    "judges of contact laws": (
        "certificate/laws.py:judge_rows",
        "certificate/theta_balance.py:_judge_impacts",
        "integrators/stepping/sparse_kernel.py:judge_contacts",
    ),
    "judges of energy": (
        "certificate/energy.py:Account",
        "certificate/theta_balance.py:_energy_terms",
        "integrators/stepping/sparse_kernel.py:judge_all_nodes",
    ),
    "assemblies": ("scheme/assembly.py:assemble",),
    "symbol sets": ("integrators/stepping/linear_step.py:Symbols",),
    "executors of a step": (
        "integrators/stepping/kernel.py:steps",
        "integrators/printed/straight_line.py:text_of",
        "integrators/printed/lanes.py:_source",
        "integrators/printed/javascript.py:run_source",
        "integrators/stepping/sparse_kernel.py:sparse_steps",
        "integrators/radau.py:steps",
        "integrators/stepping/runge_kutta/loop.py:steps",
        "integrators/rk4_paper.py:steps",
    ),
    "representations of a step": ("expressions.py:Operation",),
    "banded factorisation": ("numerics/banded.py:factor",),
    "root isolation by Bernstein": ("numerics/polynomials.py:first_fall",),
    "elimination": ("numerics/elimination.py:eliminate", "explorer/engine.js:eliminated"),
    "LCP of two rows": ("lcp/solvers/closed_form.py:two_rows",),
    "Newton of springs": (
        "integrators/stepping/newton.py:solve_with_springs",
        "integrators/stepping/force_newton.py:solve_with_forces",
    ),
}
"""Functions and classes that do the same work for one idea: each of them is to be found in the tree."""


class Count(NamedTuple):
    """A number, and the places that make it up."""

    value: float
    places: list[str]


class Module:
    """A module with its nodes by kind."""

    def __init__(self, package: Path, file: Path) -> None:
        self.name = file.relative_to(package).as_posix()
        self.lines = file.read_text(encoding="utf-8").splitlines()
        self.tree = ast.parse("\n".join(self.lines))
        self.nodes: dict[type[ast.AST], list[ast.AST]] = defaultdict(list)
        for node in ast.walk(self.tree):
            self.nodes[type(node)].append(node)

    def at(self, node: ast.AST) -> str:
        """Return the place of a node."""
        return f"{self.name}:{getattr(node, 'lineno', 1)}"

    @property
    def docstrings(self) -> list[ast.Expr]:
        """Statements that are a text."""
        return [each for each in self.nodes[ast.Expr] if isinstance(getattr(each.value, "value", None), str)]

    @property
    def annotations(self) -> Iterator[ast.AST]:
        """Nodes within annotations."""
        owners = [node for kind in (ast.arg, ast.AnnAssign, ast.FunctionDef) for node in self.nodes[kind]]
        for owner in owners:
            for note in (getattr(owner, "annotation", None), getattr(owner, "returns", None)):
                yield from ast.walk(note) if note is not None else ()


@cache
def modules(package: Path) -> tuple[Module, ...]:
    """Return the modules of a package."""
    gc.disable()  # trees are no garbage, and to look for it takes three quarters of the time
    try:
        return tuple(Module(package, file) for file in sorted(package.rglob("*.py")))
    finally:
        gc.enable()


def counted(find: Callable[[Module], list[ast.AST]], package: Path) -> Count:
    """Return how many nodes are found in the modules of a package."""
    places = [module.at(node) for module in modules(package) for node in find(module)]
    return Count(len(places), places)


# ---- row laws ---------------------------------------------------------------------------------------------------------


def knowing_files(package: Path) -> Count:
    """Return the files that know one law of a row from another."""
    home = next((module for module in modules(package) if module.name == LAWS), None)
    classes = {node.name for node in home.nodes[ast.ClassDef]} if home else set()
    places = [f"{module.name}: {', '.join(ways)}" for module in modules(package) if (ways := ways_of(module, classes))]
    return Count(len(places), places)


def ways_of(module: Module, classes: set[str]) -> list[str]:
    """Return the ways by which a module knows a law: "flag", "code", "class"."""
    ours = {"flag": flags_of(module), "code": codes_of(module), "class": classes_of(module, classes)}
    return [way for way, known in ours.items() if known]


def flags_of(module: Module) -> bool:
    """Return whether a flag of a law is read, or defined in a class."""
    fields = [each for kind in module.nodes[ast.ClassDef] for each in kind.body]
    defined = {getattr(each, "name", getattr(getattr(each, "target", None), "id", "")) for each in fields}
    return bool(FLAGS & ({each.attr for each in module.nodes[ast.Attribute]} | defined))


def codes_of(module: Module) -> bool:
    """Return whether laws are told from one another by their codes."""
    said = [key.value for call in module.nodes[ast.Call] for key in call.keywords if key.arg == "law"]
    harmless = {id(node) for each in said for node in ast.walk(each)} | {id(node) for node in module.annotations}
    named = any(each.id == "RowLaw" and id(each) not in harmless for each in module.nodes[ast.Name])
    compared = [node for each in module.nodes[ast.Compare] for node in ast.walk(each)]
    return named or any(isinstance(node, ast.Name) and node.id in CODES for node in compared)


def classes_of(module: Module, classes: set[str]) -> bool:
    """Return whether laws are told from one another by the classes of the module of laws."""
    origin = LAWS.removesuffix(".py").replace("/", ".")
    taken = {
        alias.asname or alias.name
        for each in module.nodes[ast.ImportFrom]
        if (each.module or "").endswith(origin)
        for alias in each.names
    }
    asked = [each.args[1] for each in module.nodes[ast.Call] if ast.unparse(each.func) == "isinstance"]
    asked += [each.cls for each in module.nodes[ast.MatchClass]]
    names = {
        ast.unparse(node) for each in asked for node in ast.walk(each) if isinstance(node, (ast.Name, ast.Attribute))
    }
    return bool(names & (taken & classes | {f"laws.{name}" for name in classes}))


# ---- mechanisms by name ------------------------------------------------------------------------------------------------


def listed(what: str, package: Path) -> Count:
    """Return the mechanisms of a list, each of which is in the tree."""
    missing = [place for place in MECHANISMS[what] if not defines(package, place)]
    if missing:
        raise LookupError(
            f"{what}: {', '.join(missing)} not found: strike what is gone from MECHANISMS, and name what has moved anew"
        )
    return Count(len(MECHANISMS[what]), list(MECHANISMS[what]))


def defines(package: Path, place: str) -> bool:
    """Return whether a file defines a function or a class, in Python or JavaScript."""
    file, name = place.split(":")
    if not (package / file).is_file():
        return False
    if not file.endswith(".py"):
        text = (package / file).read_text(encoding="utf-8")
        return re.search(rf"^(function\*? {name}\b|const {name} =)", text, re.MULTILINE) is not None
    (module,) = (each for each in modules(package) if each.name == file)
    return any(getattr(node, "name", "") == name for node in module.tree.body)


# ---- frames -------------------------------------------------------------------------------------------------------------


def frames(steps: int, package: Path) -> Count:
    """Return the calls from `simulate` to the kernel of the LCP, traced in an interpreter without compiled code."""
    found = subprocess.run(
        [sys.executable, __file__, "--trace", str(steps)],
        env=os.environ | {"LCPIMPACT_COMPILE": "never", "PYTHONPATH": str(package.parent)},
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    if found.returncode:
        raise RuntimeError(f"the run that is traced has failed:\n{found.stderr}")
    path = json.loads(found.stdout)
    return Count(len(path), path)


def trace(steps: int) -> list[str]:
    """Return the most frequent path of calls from `simulate` to a solver of LCPs, without its kernel."""
    import lcpimpact as li

    package = str(Path(li.__file__).parent) + os.sep
    paths: Counter[tuple[str, ...]] = Counter()

    def note(frame: object, event: str, _: object) -> None:
        if event != "call" or f"lcp{os.sep}solvers{os.sep}" not in frame.f_code.co_filename:  # type: ignore[attr-defined]
            return
        path, caller = [], frame.f_back  # type: ignore[attr-defined]
        while caller is not None and caller.f_code.co_name != "trace":
            file, code = caller.f_code.co_filename, caller.f_code
            if file.startswith(package):
                path.append(f"{Path(file).relative_to(package).as_posix()}:{code.co_firstlineno} {code.co_name}")
            caller = caller.f_back
        paths[tuple(reversed(path))] += 1

    problem = li.load_problem("system-1")
    sys.setprofile(note)
    li.simulate(problem, "moreau-jean", dt=problem.t_end / steps, progress=False, error=False)
    sys.setprofile(None)
    return list(paths.most_common(1)[0][0])


# ---- constants, names and types -----------------------------------------------------------------------------------------


def constants(module: Module) -> Iterator[tuple[ast.Name, ast.expr, bool]]:
    """Yield the names in capitals that a module assigns at its top, with their values, and whether they stand alone."""
    for node in module.tree.body:
        if not isinstance(node, (ast.Assign, ast.AnnAssign)) or node.value is None:
            continue
        for target in node.targets if isinstance(node, ast.Assign) else [node.target]:
            names = target.elts if isinstance(target, ast.Tuple) else [target]
            apart = isinstance(target, ast.Tuple) and len(getattr(node.value, "elts", ())) == len(names)
            for name, value in zip(names, node.value.elts if apart else [node.value] * len(names), strict=True):
                if isinstance(name, ast.Name) and re.fullmatch(r"_?[A-Z][A-Z0-9_]*", name.id):
                    yield name, value, name is target


def is_number(value: ast.expr) -> bool:
    """Return whether a constant is a number, and not another name of one."""
    return not isinstance(value, ast.Name) and is_operand(value)


def is_operand(value: ast.expr) -> bool:
    """Return whether an expression is a number: a literal, a constant, numpy's, or arithmetic of them."""
    match value:
        case ast.Constant(number):
            return type(number) in (int, float)
        case ast.UnaryOp(ast.USub() | ast.UAdd(), operand):
            return is_operand(operand)
        case ast.BinOp(left, _, right):
            return is_operand(left) and is_operand(right)
        case ast.Name(name):
            return name.isupper()
        case ast.Attribute():
            return bool(re.fullmatch(r"(np|math)\.(pi|inf|e)|np\.finfo\(.*\)\.\w+", ast.unparse(value)))
        case ast.Call(function, arguments):
            known = re.fullmatch(
                r"float|int|len|(math|np)\.(sqrt|log|log2|log10|exp|cos|sin|float64)", ast.unparse(function)
            )
            return known is not None and all(map(is_operand, arguments))
    return False


def numeric_constants(module: Module) -> list[ast.AST]:
    """Return the constants of a module that are numbers."""
    return [name for name, value, alone in constants(module) if alone and is_number(value)]


def constants_at_once(module: Module) -> list[ast.AST]:
    """Return the numbers that a module assigns to several constants at once."""
    several = [(name, value) for name, value, alone in constants(module) if not alone]
    return [name for name, value in several if is_number(value) or ast.unparse(value).startswith("range(")]


def shared_constants(module: Module) -> list[ast.AST]:
    """Return where a module defines constants that shall have one value."""
    return [name for name, _, _ in constants(module) if name.id.lstrip("_") in SHARED]


def long_assignments(module: Module) -> list[ast.AST]:
    """Return assignments to three names or more, but for those of the results of a call."""
    return [
        node
        for node in module.nodes[ast.Assign]
        if not isinstance(node.value, ast.Call)
        and any(isinstance(target, ast.Tuple) and len(target.elts) >= 3 for target in node.targets)
    ]


def names_a_line(package: Path) -> Count:
    """Return the names a code line."""
    names = sum(len(module.nodes[ast.Name]) for module in modules(package))
    return Count(names / sum(map(code_lines, modules(package))), [])


def code_lines(module: Module) -> int:
    """Return the number of lines that are neither blank, comments nor docstrings."""
    texts = {k for each in module.docstrings for k in range(each.lineno, (each.end_lineno or each.lineno) + 1)}
    lines = enumerate(map(str.strip, module.lines), 1)
    return sum(bool(line) and not line.startswith("#") and k not in texts for k, line in lines)


def class_names(package: Path) -> Count:
    """Return the names of classes that several modules define."""
    homes = defaultdict(list)
    for module in modules(package):
        for node in module.tree.body:
            if isinstance(node, ast.ClassDef):
                homes[node.name].append(module.at(node))
    places = [f"{name}: {', '.join(places)}" for name, places in sorted(homes.items()) if len(places) > 1]
    return Count(len(places), places)


def untyped(module: Module) -> list[ast.AST]:
    """Return where a module says ``Any``, or ``object`` in an annotation."""
    anything = [node for node in module.nodes[ast.Name] if node.id == "Any"]
    anything += [node for node in module.nodes[ast.Attribute] if node.attr == "Any"]
    return anything + [node for node in module.annotations if isinstance(node, ast.Name) and node.id == "object"]


def signatures(module: Module) -> list[ast.AST]:
    """Return the decorators that compile a function for a signature which they are given."""
    decorators = [each for node in module.nodes[ast.FunctionDef] for each in node.decorator_list]
    kinds = {"compiled", "njit", "jit", "vectorize", "guvectorize", "cfunc"}
    return [
        each
        for each in decorators
        if isinstance(each, ast.Call) and each.args and ast.unparse(each.func).split(".")[-1] in kinds
    ]


def lines(package: Path) -> Count:
    """Return the number of lines; statements that a ``;`` joins have a line each."""
    joined = sum(map(joins, modules(package)))
    return Count(sum(len(module.lines) for module in modules(package)) + joined, [])


def joins(module: Module) -> int:
    """Return the number of statements that begin where the one before them ends."""
    found = 0
    for kind in module.nodes:
        for node in (
            module.nodes[kind] if issubclass(kind, (ast.mod, ast.stmt, ast.excepthandler, ast.match_case)) else ()
        ):
            for field in ("body", "orelse", "finalbody"):
                body = getattr(node, field, [])
                found += sum(a.end_lineno == b.lineno for a, b in pairwise(body))
    return found


def vague_docstrings(module: Module) -> list[ast.AST]:
    """Return the docstrings that begin without a noun."""
    return [each for each in module.docstrings if VAGUE.match(each.value.value.strip())]  # type: ignore[attr-defined]


def cached_properties(module: Module) -> list[ast.AST]:
    """Return the properties that are kept in their object."""
    functions = module.nodes[ast.FunctionDef]
    return [node for node in functions if "cached_property" in map(ast.unparse, node.decorator_list)]


def writes(module: Module) -> list[ast.AST]:
    """Return the writes into objects that are frozen."""
    calls = r"object\.__setattr__|(vars\(.*\)|.*\.__dict__)\.(update|setdefault|pop|clear)"
    found = [node for node in module.nodes[ast.Call] if re.fullmatch(calls, ast.unparse(node.func))]
    targets = [(node, target) for node in module.nodes[ast.Assign] for target in node.targets]
    return found + [node for node, target in targets if re.match(r"(vars\(.*\)|.*\.__dict__)\[", ast.unparse(target))]


# ---- imports --------------------------------------------------------------------------------------------------------------


def circles(package: Path) -> Count:
    """Return the sets of modules that import one another, under ``TYPE_CHECKING`` too."""
    names = {dotted(package, module): module for module in modules(package)}
    reached = {name: imports(module, names.keys()) - {name} for name, module in names.items()}
    changed = True
    while changed:
        changed = False
        for name, others in reached.items():
            more = others.union(*(reached[other] for other in others))
            changed |= len(more) > len(others)
            reached[name] = more
    sets = {
        frozenset(other for other in reached[name] if name in reached[other]) for name in names if name in reached[name]
    }
    return Count(len(sets), [", ".join(sorted(each)) for each in sorted(sets, key=sorted)])


def dotted(package: Path, module: Module) -> str:
    """Return the name of a module."""
    return f"{package.name}.{module.name.removesuffix('.py').replace('/', '.')}".removesuffix(".__init__")


def imports(module: Module, known: Set[str]) -> set[str]:
    """Return the known modules that a module imports, or takes a name from."""
    whole = {alias.name for node in module.nodes[ast.Import] for alias in node.names}
    parts = [(node.module, alias.name) for node in module.nodes[ast.ImportFrom] if node.module for alias in node.names]
    return known & (whole | {each if (each := f"{of}.{name}") in known else of for of, name in parts})


# ---- the table ------------------------------------------------------------------------------------------------------------


class Row(NamedTuple):
    """What is counted: its key, its words, what is wanted, and how it is counted in a package."""

    key: str
    what: str
    wanted: str
    count: Callable[[Path], Count]


def rows(steps: int = 300) -> list[Row]:
    """Return the rows of the table; the run that is traced has so many steps."""
    wanted = dict.fromkeys(MECHANISMS, "1") | {"executors of a step": "7"}
    places = {"judges of momentum": ", under three rules", "assemblies": ", with formats of a matrix"}
    by_name = [Row(what, what, wanted[what] + places.get(what, ""), partial(listed, what)) for what in MECHANISMS]
    each = [
        ("numeric constants", "numeric module constants", "at most 250", numeric_constants),
        ("constants at once", "numeric module constants, assigned several at once", "no more", constants_at_once),
        ("shared constants", f"definitions of {', '.join(sorted(SHARED))}", "4, one value each", shared_constants),
        ("tuple assignments", "tuple assignments of three or more values", "at most 100", long_assignments),
        ("Any", "Any, with object in annotations", "at most 400", untyped),
        ("signatures", "signatures of compiled functions beside annotations", "0, derived", signatures),
        ("docstrings", 'docstrings that begin "What", "That of", ...', "0", vague_docstrings),
        ("cached properties", "cached properties", "one Memo", cached_properties),
        ("writes", "writes into frozen objects", "one Memo", writes),
    ]
    return [
        Row("row laws", "files that know a row law by a flag, a code or a class", "at most 10", knowing_files),
        *by_name,
        Row("frames", "frames from simulate to the LCP kernel", "at most 6", partial(frames, steps)),
        *(Row(key, what, goal, partial(counted, find)) for key, what, goal, find in each),
        Row("names a line", "names a code line", "at most 2.6", names_a_line),
        Row("class names", "class names with several meanings", "at most 4", class_names),
        Row("lines", "lines of the package", "at most 62,000", lines),
        Row("circles", "import circles, of types too", "0", circles),
    ]


def shown(value: float) -> str:
    """Return a count as it is shown."""
    return f"{value:,.2f}" if isinstance(value, float) else f"{value:,}"


def page(table: pd.DataFrame) -> str:
    """Return the page of the documentation for the columns that are kept."""
    columns = [name for name in table if name not in ("mechanism", "wanted")]
    text = [
        "# The structure of the package",
        "",
        "One idea of the mathematics shall be one mechanism of the code. `python benchmarks/structure.py` counts them from",
        "the syntax trees; its head says what each count is. The columns here are those that it was told to keep, with",
        "`--record`. The tests of the architecture hold the counts of today, so that none grows.",
        "",
        "| mechanism | " + " | ".join(columns) + " | wanted |",
        "|---|" + "---|" * (len(columns) + 1),
    ]
    for row in table.to_dict("records"):
        text.append(f"| {row['mechanism']} | " + " | ".join(row[name] for name in columns) + f" | {row['wanted']} |")
    return "\n".join(text) + "\n"


def record(label: str, table: list[Row], counts: dict[str, Count]) -> None:
    """Keep the counts as a column, and write the page."""
    kept = pd.DataFrame({"mechanism": [row.what for row in table], "wanted": [row.wanted for row in table]})
    if CSV.exists():
        before = read_kept().drop(columns="wanted")
        kept = kept.merge(before, on="mechanism", how="left").fillna("-")
    kept[label] = [shown(counts[row.key].value) for row in table]
    kept.to_csv(CSV, index=False)
    PAGE.write_text(page(kept), encoding="utf-8")


def read_kept() -> pd.DataFrame:
    """Return the columns that are kept."""
    return pd.read_csv(CSV, dtype=str, keep_default_na=False)


def main() -> int:
    """Count, print, and write what was asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--places", metavar="KEY", help="list the places of one count, by its key in the JSON file")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write all counts with their places")
    parser.add_argument("--record", metavar="LABEL", help="keep the counts as a column of the page")
    parser.add_argument("--steps", type=int, default=300, help="steps of the run that is traced")
    parser.add_argument("--trace", type=int, help=argparse.SUPPRESS)
    add_tiny(parser, steps=30)
    given = parser.parse_args()
    if given.trace:
        print(json.dumps(trace(given.trace)))
        return 0
    table = rows(given.steps)
    if given.places:
        by_key = {row.key: row for row in table}
        if given.places not in by_key:
            parser.error(f"no count {given.places!r}: there are {', '.join(by_key)}")
        print(*by_key[given.places].count(PACKAGE).places, sep="\n")
        return 0
    counts = {row.key: row.count(PACKAGE) for row in table}
    drawn = Table("mechanism", "now", "wanted")
    for row in table:
        drawn.add_row(row.what, shown(counts[row.key].value), row.wanted)
    Console(width=None if sys.stdout.isatty() else 130).print(drawn)
    if given.json:
        told = {
            row.key: {
                "mechanism": row.what,
                "wanted": row.wanted,
                "now": counts[row.key].value,
                "places": counts[row.key].places,
            }
            for row in table
        }
        given.json.write_text(json.dumps(told, indent=1), encoding="utf-8")
    if given.record:
        record(given.record, table, counts)
    return 0


if __name__ == "__main__":
    sys.exit(main())
