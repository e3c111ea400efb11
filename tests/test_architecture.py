"""The layers of the design, read from the imports; what the registries promise; what the package must not contain."""

from __future__ import annotations

import ast
import dataclasses
import inspect
import re
import shutil
import warnings
from functools import cache
from pathlib import Path

import pytest
import structure

import lcpimpact
from lcpimpact.course import LESSONS, PROJECTS
from lcpimpact.errors import InputError, UnknownNameError
from lcpimpact.integrators import METHODS
from lcpimpact.integrators.base import Declared, Integrator
from lcpimpact.lcp import SOLVERS
from lcpimpact.lcp.operators import Property
from lcpimpact.lcp.solver import LCPSolver
from lcpimpact.problems import PROBLEMS, load_problem
from lcpimpact.problems.base import Problem
from lcpimpact.registry import Registry, load, nearest
from lcpimpact.scheme.elements import ELEMENTS
from lcpimpact.scheme.elements.base import Element
from lcpimpact.stated import stated

PACKAGE = Path(lcpimpact.__file__).parent
FILES = sorted(PACKAGE.rglob("*.py"))

BASE = {
    "errors",
    "exports",
    "expressions",
    "formula",
    "arguments",
    "memory",
    "memo",
    "registry",
    "stated",
    "arrays",
    "numbers",
    "units",
    "files",
    "logs",
    "interpreter",
    "background",
    "compiler",
    "compiled",
    "numerics",
}
MECHANICS = BASE | {"scheme", "reading", "problems"}
METHOD = MECHANICS | {"lcp", "record", "hybrid", "integrators"}
RUN = METHOD | {
    "events", "certificate", "finished", "quantities", "run_error", "run_files", "trajectory", "sparse_run", "simulation",
}  # fmt: skip
STUDY = RUN | {"sweeps", "study"}
MAY_IMPORT = {
    "errors": set(),
    "exports": set(),
    "expressions": set(),
    "formula": {"arrays", "expressions"},
    "arguments": {"errors"},
    "memory": {"errors"},
    "memo": set(),
    "registry": {"errors"},
    "stated": set(),
    "arrays": set(),
    "numbers": {"errors", "arrays", "formula"},
    "units": {"errors", "arrays", "registry"},
    "files": {"errors"},
    "logs": set(),
    "cache": {"logs"},
    "interpreter": {"arrays"},
    "background": set(),
    "compiler": {"arrays", "cache", "logs"},
    "compiled": {
        "errors",
        "arrays",
        "background",
        "cache",
        "interpreter",
        "logs",
        "compiler",
    },
    "numerics": {"arrays", "compiled", "interpreter"},
    "lcp": BASE,
    "scheme": BASE,
    "reading": {"errors", "registry", "arrays", "record", "scheme"},
    "problems": BASE | {"scheme", "reading", "record"},
    "from_sympy": {"errors", "arrays", "scheme", "problems"},
    "record": {"arrays"},
    "hybrid": MECHANICS | {"lcp", "record"},
    "integrators": MECHANICS | {"lcp", "record", "hybrid"},
    "events": METHOD,
    "certificate": METHOD | {"events"},
    "finished": METHOD | {"files"},
    "quantities": METHOD | {"events", "certificate", "finished"},
    "run_error": {"errors", "registry", "files"},
    "run_files": METHOD | {"finished"},
    "trajectory": METHOD | {"events", "certificate", "quantities", "run_error", "run_files"},
    "sparse_run": METHOD | {"events", "certificate", "quantities", "trajectory"},
    "simulation": METHOD | {"events", "certificate", "trajectory", "sparse_run"},
    "schemefile": RUN,
    "saved_runs": RUN | {"schemefile"},
    "study": RUN | {"sweeps"},
    "validation": STUDY | {"bibliography", "schemefile"},
    "plotting": STUDY | {"validation"},
    "sweeps": RUN | {"cache"},
    "explorer": RUN | {"sweeps", "plotting"},
    "bibliography": METHOD,
    "report": STUDY | {"bibliography", "plotting", "validation"},
    "reproduce": STUDY | {"plotting", "report"},
    "course": RUN,
    "truth": BASE | {"bibliography", "scheme", "problems"},
    "cli": STUDY
    | {
        "bibliography",
        "cache",
        "schemefile",
        "plotting",
        "explorer",
        "report",
        "reproduce",
        "course",
        "truth",
        "validation",
    },
    "__main__": {"cli"},
}
"""Layer (module or folder right under the package) to the layers that it may import, besides itself."""

ONLY = {
    "matplotlib": {"plotting", "report"},
    "click": {"cli"},
    "rich": {"cli"},
    "dask": {"sweeps"},
    "zarr": {"sweeps"},
    "xarray": {"sweeps", "run_files"},
    "pandas": {"run_files", "study", "sweeps", "validation", "plotting", "report", "reproduce", "cli"},
    "qpsolvers": {"lcp"},
    "llvmlite": {"compiler", "compiled"},
}
"""Third-party packages to the layers that may import them."""

IMPORTERS = ("import_module", "import_extra", "__import__")
"""Functions that import the module of a name."""

BY_NAME = {
    ("trajectory", "plotting"),
    ("trajectory", "study"),
    ("run_files", "schemefile"),
    ("study", "plotting"),
    ("validation", "plotting"),
    ("study", "report"),
    ("registry", "report"),
}
"""References upwards by a string that the registry loads when asked, as for ``traj.plot()`` and ``traj.error``."""


def module_name(file: Path) -> str:
    parts = file.relative_to(PACKAGE.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def layer(name: str) -> str:
    """``lcpimpact.lcp.solvers.auto`` lies in ``lcp``; the package's own __init__ in the layer ''."""
    parts = name.split(".")
    return parts[1] if len(parts) > 1 else ""


@cache
def parsed(file: Path) -> ast.Module:
    return ast.parse(file.read_text(encoding="utf-8"))


@cache
def imports(file: Path) -> list[str]:
    """Every module that a file imports anywhere, in functions and under TYPE_CHECKING too, as absolute names."""
    tree = parsed(file)
    here = module_name(file).split(".")
    package = here if file.name == "__init__.py" else here[:-1]
    found = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            origin = (
                ".".join([*package[: len(package) - node.level + 1], node.module or ""]) if node.level else node.module
            )
            if origin != "lcpimpact":
                found.append(origin.rstrip("."))
                continue
            # `from lcpimpact import x` means what x is; the version is nobody's.
            names = [alias.name for alias in node.names if alias.name != "__version__"]
            found += [lcpimpact._LOCATIONS.get(name, f"lcpimpact.{name}").split(":")[0] for name in names]
        elif isinstance(node, ast.Call) and ast.unparse(node.func).split(".")[-1] in (
            "import_module",
            "import_extra",
            "__import__",
        ):
            found += [a.value for a in node.args if isinstance(a, ast.Constant) and isinstance(a.value, str)]
    return found


def locations(file: Path) -> list[str]:
    """The strings "package.module:attribute" of a file: imports that the registry does later."""
    tree = parsed(file)
    strings = (n.value for n in ast.walk(tree) if isinstance(n, ast.Constant) and isinstance(n.value, str))
    return [text.split(":")[0] for text in strings if re.fullmatch(r"lcpimpact(\.\w+)+:\w+", text)]


def ids(file: Path) -> str:
    return file.relative_to(PACKAGE).as_posix()


def test_the_reader_of_imports_sees_them_all(tmp_path):
    """The other tests here are worth what this function is worth."""
    assert "lcpimpact.lcp.solve" in imports(PACKAGE / "hybrid" / "mode_choice.py")
    assert "qpsolvers" in imports(PACKAGE / "lcp" / "solvers" / "qp.py"), "an import inside a function"
    assert "lcpimpact.lcp.solver" in imports(PACKAGE / "lcp" / "__init__.py"), "under TYPE_CHECKING"
    assert "lcpimpact.integrators.exact" in locations(PACKAGE / "integrators" / "__init__.py")
    assert len(FILES) > 40
    assert {"lcp", "scheme", "integrators", "problems"} <= {layer(module_name(file)) for file in FILES}


@pytest.mark.parametrize("file", FILES, ids=ids)
def test_every_module_has_a_place_among_the_layers(file):
    name = layer(module_name(file))
    assert name in MAY_IMPORT or name == "", f"say where {name!r} stands: add it to MAY_IMPORT (and to the design)"


@pytest.mark.parametrize("file", FILES, ids=ids)
def test_imports_go_one_way(file):
    here = layer(module_name(file))
    if here == "":
        return  # the package's __init__ offers names of every layer
    wrong = []
    for name in imports(file) + locations(file):
        if name.split(".")[0] != "lcpimpact":
            continue
        there = layer(name)
        if there not in MAY_IMPORT[here] | {here} and (here, there) not in BY_NAME:
            wrong.append(name)
    assert not wrong, f"{here} may import only {sorted(MAY_IMPORT[here])}"


def test_the_layers_have_no_circle():
    """Each layer can be put below all that import it."""
    placed: list[str] = []
    while len(placed) < len(MAY_IMPORT):
        ready = [name for name in MAY_IMPORT if name not in placed and MAY_IMPORT[name] - {name} <= set(placed)]
        assert ready, f"a circle among {sorted(set(MAY_IMPORT) - set(placed))}"
        placed += ready
    assert "scheme" not in MAY_IMPORT["lcp"]
    assert not MAY_IMPORT["scheme"] & {"lcp", "integrators"}
    assert not MAY_IMPORT["problems"] & {"lcp", "integrators"}


def test_no_module_imports_itself_in_a_circle():
    """Within a layer too, imports form no circle, be they at the top of a module or inside its functions."""
    graph: dict[str, set[str]] = {}
    known = {module_name(file) for file in FILES}
    for file in FILES:
        tree = parsed(file)
        guarded = [n for n in tree.body if isinstance(n, ast.If) and ast.unparse(n.test) == "TYPE_CHECKING"]
        for_types = {id(node) for branch in guarded for node in ast.walk(branch)}
        names: set[str] = set()
        for node in ast.walk(tree):
            if id(node) in for_types:
                continue
            if isinstance(node, ast.Import):
                names |= {alias.name for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module:
                names |= {node.module} | {f"{node.module}.{alias.name}" for alias in node.names}
        graph[module_name(file)] = (names & known) - {module_name(file)}
    assert graph["lcpimpact.lcp.solve"] >= {"lcpimpact.lcp.problem", "lcpimpact.errors"}
    done: set[str] = set()

    def visit(name: str, path: tuple[str, ...]) -> None:
        assert name not in path, " -> ".join((*path[path.index(name) :], name))
        if name not in done:
            for other in graph[name]:
                visit(other, (*path, name))
            done.add(name)

    for name in graph:
        visit(name, ())


@pytest.mark.parametrize("file", FILES, ids=ids)
def test_third_party_packages_stay_where_they_belong(file):
    here = layer(module_name(file))
    for name in {each.split(".")[0] for each in imports(file)} & ONLY.keys():
        assert here in ONLY[name], f"only {ONLY[name]} may import {name}"


@pytest.mark.parametrize("file", FILES, ids=ids)
def test_what_a_file_must_not_contain(file):
    text = file.read_text(encoding="utf-8")
    assert file.stem not in ("utils", "util", "helpers", "misc", "common")
    assert not re.search(r"\b(TODO|FIXME|XXX)\b", text)
    tree = parsed(file)
    assert ast.get_docstring(tree), "every module says what it is"
    for node in ast.walk(tree):
        if isinstance(node, ast.Call):
            name = ast.unparse(node.func)
            assert name not in ("print", "breakpoint", "pdb.set_trace", "exec", "eval"), f"line {node.lineno}: {name}"
            # A float range has an extra point in 3 % of ordinary cases.
            if name.endswith("arange") and layer(module_name(file)) != "plotting":
                floats = [n for n in ast.walk(node) if isinstance(n, ast.Constant) and isinstance(n.value, float)]
                assert not floats, f"line {node.lineno}: a float range"
        if isinstance(node, ast.ExceptHandler):
            assert node.type is not None, f"line {node.lineno}: bare except"
        if isinstance(node, (ast.FunctionDef, ast.Lambda)):
            defaults = [*node.args.defaults, *(d for d in node.args.kw_defaults if d is not None)]
            assert not any(isinstance(d, (ast.List, ast.Dict, ast.Set)) for d in defaults), (
                f"line {node.lineno}: mutable"
            )


def test_a_rounding_has_one_value():
    """A name of a rounding error or of zero says which one is meant: no two modules give it two values."""
    stated: dict[str, dict[str, Path]] = {}
    for file in FILES:
        for node in parsed(file).body:
            target = node.targets[0] if isinstance(node, ast.Assign) else None
            if isinstance(target, ast.Name) and re.search("ROUNDING|ZERO_RTOL|FLOOR|ACCUMULATION|NEWTON", target.id):
                stated.setdefault(target.id, {})[ast.unparse(node.value)] = file
    assert "SCALE_FLOOR" in stated
    assert {name: values for name, values in stated.items() if len(values) > 1} == {}


def test_fast_math_is_nowhere():
    for file in FILES:
        assert "fastmath" not in file.read_text(encoding="utf-8"), ids(file)


# ---- the structure in numbers ---------------------------------------------------------------------------------------

BOUNDS = {
    "row laws": 5,
    "judges of momentum": 2,
    "judges of contact laws": 3,
    "judges of energy": 3,
    "assemblies": 1,
    "symbol sets": 1,
    "executors of a step": 8,
    "representations of a step": 1,
    "banded factorisation": 1,
    "root isolation by Bernstein": 1,
    "elimination": 2,
    "LCP of two rows": 1,
    "Newton of springs": 2,
    "frames": 6,
    "numeric constants": 277,
    "constants at once": 65,
    "shared constants": 3,
    "tuple assignments": 133,
    "Any": 415,
    "signatures": 0,
    "docstrings": 0,
    "cached properties": 116,
    "writes": 34,
    "names a line": 2.95,
    "class names": 0,
    "lines": 100_752,
    "circles": 0,
}
"""Counts of benchmarks/structure.py that must not grow: lower a bound with each change that allows it."""


@pytest.mark.parametrize("row", structure.rows(), ids=lambda row: row.key)
def test_what_is_counted_does_not_grow(row):
    found = row.count(structure.PACKAGE)
    assert round(found.value, 2) <= BOUNDS[row.key], f"{row.what}: python benchmarks/structure.py --places {row.key!r}"


def test_every_bound_is_of_a_count():
    assert {row.key for row in structure.rows()} == BOUNDS.keys()
    assert structure.PACKAGE == PACKAGE, "what is counted is what is tested"


def test_the_page_of_the_structure_is_that_of_its_counts():
    assert structure.PAGE.read_text(encoding="utf-8") == structure.page(structure.read_kept())


COUNTED = {
    "numeric constants": {
        "A = 1\nB: float = -2.0 * A\n_C = float(np.finfo(float).eps)": 3,
        "D = A\nE = 'x'\nf = 1\nG = (1, 2)\nH, J = 1, 2\ndef k():\n    L = 1": 0,
    },
    "constants at once": {"A, B = 1, 2.0": 2, "A, B, C = range(3)": 3, "A, B = f()\nC = 1": 0},
    "shared constants": {"ROUNDING = 1\n_ZERO_RTOL = f(2)": 2, "ROUNDINGS = 1": 0},
    "tuple assignments": {
        "a, b, c = 1, 2, 3": 1,
        "def f(x):\n    a, *b, c = x": 1,
        "a, b = 1, 2\na, b, c = f()": 0,
    },
    "Any": {"from typing import Any\nx: Any = cast(Any, 1)": 2, "def f(x: list[object]) -> object: object()": 2},
    "signatures": {"@compiled(f8(f8))\ndef f(x): pass": 1, "@compiled(inline='always')\ndef f(x): pass": 0},
    "docstrings": {
        '"""What is kept."""\nA = 1\n"""That of b."""\ndef f():\n    """Return what is there."""': 3,
        '"""Whatever has a noun."""\ndef f():\n    """Return the sum of what is there."""': 0,
    },
    "cached properties": {
        "class A:\n    @cached_property\n    def b(self): pass\n    @property\n    def c(self): pass": 1
    },
    "writes": {"object.__setattr__(a, 'b', 1)\nvars(a)['b'] = 2\nvars(a).update(b=3)": 3, "vars(a)['b']\na.b = 1": 0},
    "names a line": {'"""A b c."""\n\n# d\nx = y + z\nprint(1)\n': 2.0},
    "class names": {"class A: pass\nclass B: pass": 0},
    "lines": {"x = 1; y = 2\nif x: y = 1\n": 3, "if x:\n    a = 1; b = 2; c = 3\nelse:\n    pass": 6, "x = ';;'": 1},
    "row laws": {
        "if d.slides: pass": 1,
        "class D:\n    relays: Flags": 1,
        "if row.law is RowLaw.JOINT: pass": 1,
        "if law == SLIDER: pass": 1,
        "row = Row(a, b, law=RowLaw.JOINT)\ndef f(law: RowLaw): pass": 0,
        "law = other\n'slides'": 0,
    },
}
"""Sources, and what is counted in each."""


@pytest.mark.parametrize(
    ("key", "source", "expected"),
    [(key, source, expected) for key, sources in COUNTED.items() for source, expected in sources.items()],
)
def test_the_structure_is_counted_as_defined(key, source, expected, tmp_path):
    (tmp_path / "module.py").write_text(source, encoding="utf-8")
    (count,) = (row.count for row in structure.rows() if row.key == key)
    assert count(tmp_path).value == expected


def test_laws_that_are_classes_are_counted_as_flags_are(tmp_path):
    (tmp_path / "scheme").mkdir()
    (tmp_path / "scheme" / "laws.py").write_text("class Joint: pass\n", encoding="utf-8")
    users = {
        "asks": "from lcpimpact.scheme.laws import Joint\nisinstance(x, (int, Joint))",
        "asks_module": "from lcpimpact.scheme import laws\nisinstance(x, laws.Joint)",
        "matches": "from lcpimpact.scheme.laws import Joint\nmatch x:\n    case Joint(): pass",
        "takes": "from lcpimpact.scheme.laws import Joint\nJoint()",
        "another": "from lcpimpact.scheme.elements import Joint\nisinstance(x, Joint)",
    }
    for name, source in users.items():
        (tmp_path / f"{name}.py").write_text(source, encoding="utf-8")
    found = structure.knowing_files(tmp_path).places
    assert found == ["asks.py: class", "asks_module.py: class", "matches.py: class"]


def test_several_modules_are_counted_together(tmp_path):
    (tmp_path / "one.py").write_text("class A: pass\nclass B: pass\n", encoding="utf-8")
    (tmp_path / "two.py").write_text("class A: pass\nclass C: pass\n", encoding="utf-8")
    assert structure.class_names(tmp_path).value == 1
    name = tmp_path.name
    (tmp_path / "one.py").write_text(f"if TYPE_CHECKING:\n    from {name}.two import A\n", encoding="utf-8")
    (tmp_path / "two.py").write_text(f"from {name} import one\n", encoding="utf-8")
    structure.modules.cache_clear()
    assert structure.circles(tmp_path).places == [f"{name}.one, {name}.two"]


def test_a_mechanism_that_is_gone_is_struck_from_the_list(tmp_path):
    with pytest.raises(LookupError, match=r"assembly\.py:assemble.*strike what is gone"):
        structure.listed("assemblies", tmp_path)


# ---- what an import costs -------------------------------------------------------------------------------------------


def test_importing_the_package_loads_nothing_heavy(python):
    heavy = ["llvmlite", "scipy", "matplotlib", "qpsolvers", "osqp", "pandas", "xarray", "click", "rich", "tqdm"]
    loaded = python(f"import sys, json, lcpimpact; print(json.dumps([m for m in {heavy} if m in sys.modules]))")
    assert loaded == []


def test_names_are_imported_on_first_use(python):
    before, after, shadowed = python(
        "import sys, json, lcpimpact\n"
        "before = 'lcpimpact.trajectory' in sys.modules\n"
        "lcpimpact.Trajectory, lcpimpact.simulate, lcpimpact.solve_lcp\n"
        "import lcpimpact.lcp.solve\n"
        "print(json.dumps([before, 'lcpimpact.trajectory' in sys.modules, "
        "not (callable(lcpimpact.simulate) and callable(lcpimpact.solve_lcp))]))"
    )
    assert (before, after, shadowed) == (False, True, False)


LOADED = """
import importlib.metadata, json, sys
of = importlib.metadata.packages_distributions()
def loaded():
    tops = {name.partition('.')[0] for name in sys.modules}
    return {name.lower() for top in tops for name in of.get(top, ())}
before = loaded()
import lcpimpact as li
imported = loaded() - before
for method in ('moreau-jean', 'exact', 'rk4-paper'):
    li.simulate(li.load_problem('system-1'), method, dt=1e-2, t_end=1e-1, progress=False)
parts = [each for each in ('scipy.optimize', 'scipy.interpolate') if each in sys.modules]
print(json.dumps([sorted(imported), sorted(loaded() - before), parts]))
"""
"""What `import lcpimpact`, and then a first run, load of the packages that are installed."""


def test_simulation_loads_nothing_that_it_does_not_need(python):
    """What only ``qp:*``, tables, pictures or the command line need is not loaded."""
    python(LOADED)  # where the cache is empty, functions are compiled first, under a bar of tqdm
    imported, run, parts = python(LOADED)
    assert set(imported) <= {"lcpimpact"}
    assert {"numpy", "scipy"} <= set(run) <= {"lcpimpact", "numpy", "platformdirs", "scipy", "llvmlite"}
    assert parts == []


@pytest.mark.parametrize("name", sorted(lcpimpact._LOCATIONS))
def test_what_the_package_offers_exists_and_is_documented(name):
    value = getattr(lcpimpact, name)
    assert value is load(lcpimpact._LOCATIONS[name])
    assert value.__name__ == name
    assert inspect.getdoc(value)


# ---- registries -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", list(SOLVERS))
def test_solvers_declare_what_they_are(name):
    solver = SOLVERS[name]
    assert isinstance(solver, LCPSolver)
    assert solver.name == name
    assert solver.summary
    assert solver.source
    assert 0.0 < solver.tol <= 1e-6
    assert solver.max_iter >= 1
    assert all(isinstance(each, Property) for each in solver.requires)
    assert set(solver.storages) <= {"dense", "banded", "sparse", "factored"}
    assert "dense" in solver.storages
    assert SOLVERS[name] == solver
    with pytest.raises(dataclasses.FrozenInstanceError):
        solver.tol = 1.0


@pytest.mark.parametrize("name", list(METHODS))
def test_methods_declare_what_they_are(name):
    method = METHODS[name]
    assert issubclass(method, Integrator)
    assert method.name == name
    declared = method.declared
    assert isinstance(declared, Declared)
    assert declared.summary
    assert declared.reaction_time
    assert declared.energy
    assert declared.source
    assert set(declared.relative_degrees) <= {0, 1, 2}
    assert declared.order_smooth >= 1
    assert (declared.order_impact > 0) == (2 in declared.relative_degrees)
    assert (declared.order_force_jump > 0) == (1 in declared.relative_degrees)
    assert (declared.order_force_kink > 0) == (0 in declared.relative_degrees)
    assert declared.level
    assert isinstance(method.solves_lcp, bool)
    object_ = method()  # every option has a default
    assert object_ == method()
    taken = {"problem", "method", "dt", "t_end", "solver", "lcp_solver", "throw", "progress", "out", "plot"}
    assert not taken & {option.name for option in dataclasses.fields(method)}, "what a run is told already"
    for option in dataclasses.fields(method):
        with pytest.raises(dataclasses.FrozenInstanceError):
            setattr(object_, option.name, 1)
        documented = any(re.search(rf"\b{option.name} : ", each.__doc__ or "") for each in method.__mro__)
        assert documented, f"the option {option.name} is documented"


def assert_is_described(parameter, thing):
    """Check the unit of a stated parameter, and that the docstring has its meaning."""
    assert re.fullmatch(r"((rad|kg|Pa|[msNJWVAFHΩ1])[²³ⁿ]?(\^[αq])?([ /]|$))*", parameter.unit), parameter
    assert len(parameter.meaning) > 2
    assert parameter.sentence in " ".join(inspect.getdoc(thing).split())


@pytest.mark.parametrize("name", list(PROBLEMS))
def test_problems_declare_what_they_are(name):
    problem = load_problem(name)
    assert isinstance(problem, Problem)
    assert problem.name == name
    assert problem.source != "-"
    assert problem.t_end > 0.0
    assert set(problem.parameters) == set(inspect.signature(PROBLEMS[name]).parameters)
    assert inspect.getdoc(PROBLEMS[name])
    # Each parameter is stated once, with its unit and meaning.
    known = stated(PROBLEMS[name])
    assert list(known) == list(problem.parameters)
    for each in known.values():
        assert_is_described(each, PROBLEMS[name])
    # The parameters that a problem reports build the same problem again.
    again = load_problem(name, **problem.parameters)
    assert again.scheme == problem.scheme
    assert (again.q0, again.v0) == (problem.q0, problem.v0)
    # Every parameter is heard: a change of one changes the problem.
    for key, value in problem.parameters.items():
        if key == "h_o":
            continue
        for changed in (0.9 * value or 0.1, value + 1.0):
            try:
                other = load_problem(name, **{key: changed})
            except InputError:
                continue  # heard too: a count that is no whole number, a value that the problem cannot have
            assert (other.scheme, other.q0, other.v0) != (problem.scheme, problem.q0, problem.v0), key
            assert other.parameters[key] == changed


@pytest.mark.parametrize("name", list(ELEMENTS))
def test_elements_declare_what_they_are(name):
    element = ELEMENTS[name]
    assert issubclass(element, Element)
    assert element.__name__ == name
    assert getattr(lcpimpact, name) is element
    assert dataclasses.is_dataclass(element)
    assert element.__dataclass_params__.frozen
    assert inspect.isabstract(element) is False
    assert "::" in element.__doc__, "drawn in its docstring"
    others = (element.parts is not Element.parts, element.drawn is not Element.drawn)
    assert element.strokes or any(others), "can be drawn"
    constants = stated(element)
    for each in constants.values():
        assert_is_described(each, element)
    assert bool(constants) == (name not in ("RigidLink", "Substructure", "Force")), "all others have constants"
    assert "Annotated" not in str(inspect.signature(element))


REGISTRIES = [SOLVERS, METHODS, PROBLEMS, ELEMENTS, LESSONS, PROJECTS]


@pytest.mark.parametrize("registry", REGISTRIES, ids=lambda r: r.kind)
def test_a_registry_is_a_mapping(registry):
    assert len(registry) == len(list(registry)) == len(dict(registry.items()))
    for name in registry:
        assert name in registry
        assert registry.get(name) == registry[name]
    assert "no-such-name" not in registry
    assert registry.get("no-such-name") is None
    assert registry.get("no-such-name", 3) == 3
    with pytest.raises(
        UnknownNameError, match=rf"unknown {registry.kind} 'no-such-name'.*known are {next(iter(registry))}"
    ):
        registry["no-such-name"]


def test_every_file_of_a_method_problem_or_element_is_registered():
    """A file that is in no registry is a method that nobody can call."""
    for folder, registry, others in (
        ("scheme/elements", ELEMENTS, {"base", "compliant", "linked_masses"}),
        ("lcp/solvers", SOLVERS, set()),
        ("integrators", METHODS, {"base"}),
        ("course", LESSONS, {"lesson", "check", "process", "projects"}),
        (
            "problems",
            PROBLEMS,
            {"base", "facts", "free_vibration", "parameters", "penalty", "reading", "reference", "registered"},
        ),
    ):
        files = {file.stem for file in (PACKAGE / folder).glob("*.py")} - {"__init__"} - others
        registered = {location.split(":")[0].rsplit(".", 1)[1] for location in registry._own.values()}
        assert files == registered, folder


INERTER = '''
"""An inerter: a force in proportion to the relative acceleration of its ends."""

from dataclasses import dataclass

from lcpimpact.scheme.elements.base import MISSING, Element, positive


@dataclass(frozen=True)
class Inerter(Element):
    """An inerter."""

    a: str
    b: str
    B: float = MISSING
    symbols: tuple[str, ...] = ("B",)

    def __post_init__(self):
        positive(self, "B", self.B, "kg")

    @property
    def nodes(self):
        return self.a, self.b

    def contribute(self, terms):
        terms.link(terms.M, self.a, self.b, self.B)
'''


FREEWHEEL = '''
"""A freewheel: it turns one way only."""

from dataclasses import dataclass
from typing import ClassVar

from lcpimpact.scheme.elements.base import Link
from lcpimpact.scheme.laws import RowLaw
from lcpimpact.scheme.terms import Row

FREEWHEEL = RowLaw("freewheel", of_rate=True, at_bound="overrun", between="engage")


@dataclass(frozen=True)
class Freewheel(Link):
    """0 <= T, complementary to v_b - v_a >= 0."""

    a: str
    b: str
    name: str | None = None
    symbols: tuple[str, ...] = ()

    reaction: ClassVar[str] = "T"

    @property
    def ends(self):
        return self.a, self.b

    def contribute(self, terms):
        terms.rows.append(Row(str(self), self.name or "T", self.a, self.b, 0.0, law=FREEWHEEL))
'''


def with_one_more(name, source, tmp_path):
    """Copy the package, with one more element in a file and a line of the registry."""
    copy = shutil.copytree(PACKAGE, tmp_path / "lcpimpact", ignore=shutil.ignore_patterns("__pycache__"))
    elements = copy / "scheme" / "elements"
    (elements / f"{name.lower()}.py").write_text(source, encoding="utf-8")
    with (elements / "registry.pyi").open("a", encoding="utf-8") as registry:
        registry.write(f"from lcpimpact.scheme.elements.{name.lower()} import {name} as {name}\n")


def test_one_more_element_is_a_file_and_a_line(python, tmp_path):
    with_one_more("Inerter", INERTER, tmp_path)
    scheme = tmp_path / "inerter.toml"
    scheme.write_text(
        'name = "one"\nt_end = 1.0\n[[elements]]\ntype = "Mass"\nnode = "x"\nm = 1.0\n'
        '[[elements]]\ntype = "Inerter"\na = "x"\nb = "ground"\nB = 2.0\n',
        encoding="utf-8",
    )
    offered, printed, read = python(
        f"import sys\nsys.path.insert(0, {str(tmp_path)!r})\n"
        "import contextlib, io, json, lcpimpact as li\n"
        "from lcpimpact.cli.main import main\n"
        "shown = io.StringIO()\n"
        "with contextlib.redirect_stdout(shown), contextlib.suppress(SystemExit):\n"
        "    main(['list', 'elements'])\n"
        f"scheme = li.read_scheme_file({str(scheme)!r}).problem.scheme\n"
        "print(json.dumps(['Inerter' in li.__all__ and li.Inerter.__module__, shown.getvalue(), str(scheme.elements)]))",
        PYTHONPATH=str(tmp_path),
        LCPIMPACT_COMPILE="never",
    )
    assert offered == "lcpimpact.scheme.elements.inerter"
    assert "Inerter" in printed
    assert "Inerter(a='x', b='ground', B=2.0" in read


def test_one_more_row_law_is_a_file_and_a_line(python, tmp_path):
    """What all methods make of it stands in tests/scheme/test_row_laws.py."""
    with_one_more("Freewheel", FREEWHEEL, tmp_path)
    scheme = tmp_path / "freewheel.toml"
    scheme.write_text(
        'name = "one way"\nt_end = 1.0\n[initial.x]\nq = -1.0\n[[elements]]\ntype = "Mass"\nnode = "x"\nm = 1.0\n'
        '[[elements]]\ntype = "Spring"\na = "x"\nb = "ground"\nk = 100.0\n'
        '[[elements]]\ntype = "Freewheel"\na = "ground"\nb = "x"\n',
        encoding="utf-8",
    )
    found = python(
        f"import sys\nsys.path.insert(0, {str(tmp_path)!r})\n"
        "import json, lcpimpact as li\n"
        f"problem = li.read_scheme_file({str(scheme)!r}).problem\n"
        "runs = [li.simulate(problem, method, dt=1e-2, error=False) for method in ('moreau-jean', 'radau', 'exact')]\n"
        "print(json.dumps([[run.status.name, run.events[0].kind, run.reaction[-1, 0]] for run in runs]))",
        PYTHONPATH=str(tmp_path),
        LCPIMPACT_COMPILE="never",
    )
    for status, kind, T in found:
        assert (status, kind) == ("SOLVED", "engage")
        assert abs(T - 100.0) < 1.0


def test_nearest_offers_only_what_is_near():
    assert (
        nearest("mas", ["Mass", "Spring"], "element")
        == "unknown element 'mas': did you mean 'Mass'? known are Mass, Spring"
    )
    assert nearest("zzz", ["Mass"], "element") == "unknown element 'zzz': known are Mass"
    assert nearest("a", [], "series") == "unknown series 'a': known are none"


def test_a_family_makes_its_entries_from_their_names():
    registry = Registry("thing", {"a": "math:pi"}, families={"f:": "builtins:len"})
    assert registry["a"] == pytest.approx(3.141592653589793, rel=0.0, abs=0.0)
    assert registry["f:xyz"] == 5
    assert list(registry) == ["a"]
    with pytest.raises(InputError, match="unknown thing 'g:x'"):
        registry["g:x"]


@pytest.mark.parametrize("module", ["lcpimpact.lcp.solve", "test_lcp"])
def test_a_warning_from_here_fails_a_test(module):
    with pytest.raises(RuntimeWarning):
        warnings.warn_explicit("overflow", RuntimeWarning, "file.py", 1, module)


@pytest.mark.parametrize(
    ("kind", "module"),
    [
        (DeprecationWarning, "lcpimpact.lcp.solvers.qp"),
        (FutureWarning, "lcpimpact.study.design.fit"),
        (UserWarning, "scipy.sparse"),
    ],
)
def test_a_warning_of_a_dependency_fails_none(kind, module):
    with warnings.catch_warnings(record=True) as caught:
        warnings.warn_explicit("another interface", kind, "file.py", 1, module)
    assert [each.category for each in caught] == [kind]
