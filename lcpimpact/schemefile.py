"""Schemes and runs in TOML files, written by hand or exported.

A file states a problem in one of three ways: by the elements of a scheme, by the matrices of a system, or by the name of a
registered problem; the table ``[run]`` has the run settings::

    name = "my buffer"
    t_end = 3.0

    [[elements]]
    type = "Mass"
    node = "x"
    m = 100.0

    [[elements]]
    type = "Spring"
    a = "x"
    b = "ground"
    k = 3924.0

    [initial.x]
    v = 9.9

    [run]
    method = "moreau-jean"
    dt = 1e-3

    [run.options]
    theta = 1.0

The keys of an element are its constants, named as in Python. A signal is a table { type, ... } of its constants; without a
type it is a `Harmonic`. So is the shape of a body, with its type. All keys are listed in docs/guide/scheme-files.md.
"""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import MISSING as NO_DEFAULT
from dataclasses import Field, dataclass, field, fields, replace
from numbers import Integral
from pathlib import Path
from types import UnionType
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, TypeVar, Union, cast, get_args, get_origin, get_type_hints

import numpy as np
import tomlkit

from lcpimpact.arguments import Hint, check_fields, checked
from lcpimpact.errors import InputError
from lcpimpact.files import check_output, reading, whole_file
from lcpimpact.numbers import is_real
from lcpimpact.problems import PROBLEMS
from lcpimpact.problems.base import Problem, build
from lcpimpact.registry import nearest
from lcpimpact.scheme.elements import ELEMENTS
from lcpimpact.scheme.elements.base import GROUND, Element
from lcpimpact.scheme.impact_laws import IMPACT_LAWS, LZB, name_of_law
from lcpimpact.scheme.scheme import Format, Scheme
from lcpimpact.scheme.shapes import SHAPES, Shape
from lcpimpact.scheme.signals import SIGNAL_NAMES, SIGNALS, Described, Polynomial, Signal, SignalSum
from lcpimpact.scheme.system import LinearComplementaritySystem

if TYPE_CHECKING:
    from lcpimpact.integrators.base import Option
    from lcpimpact.trajectory import Trajectory

T = TypeVar("T")

ENDING = ".toml"

DT, STEPS = 1e-3, 1000
"""Default step in s, and minimum number of steps of a run without a given step."""

MAX_BYTES = 4_000_000
"""Maximum size of a scheme file in bytes."""

REMEDY = "give a smaller scheme"

MAX_DEPTH = 10
"""Maximum depth of nested tables and brackets; a row of a system matrix has depth 3."""

MAX_STRING_LENGTH = 1_000
"""Maximum number of characters of a string."""

KEYS = {
    "elements": [
        "name",
        "source",
        "t_end",
        "format",
        "impact_law",
        "built_from",
        "elements",
        "initial",
        "units",
        "run",
    ],
    "system": ["name", "source", "t_end", "built_from", "system", "initial", "units", "run"],
    "problem": ["problem", "parameters", "run"],
}
"""Keys of a file, for each of the three ways to state a problem."""

Table: TypeAlias = Mapping[str, "Toml"]
Toml: TypeAlias = bool | int | float | str | Sequence["Toml"] | Table
"""A value of a file."""

NUMBERS = tuple[float, ...]
MATRIX = tuple[NUMBERS, ...]
NAMES = tuple[str, ...]
SYSTEM: dict[str, Hint] = {
    **dict.fromkeys("ABCD", MATRIX),
    **dict.fromkeys("ac", tuple[float | Signal, ...]),
    **dict.fromkeys(("states", "multipliers"), NAMES),
    **dict.fromkeys(("lower", "upper"), NUMBERS),
}
"""Types of the entries of a system."""

FUNCTION = "a Python function, which a file cannot hold: build the scheme in Python"

CONTAINERS = {tuple: "array", Sequence: "array", Mapping: "table", Literal: "word"}

WORDS = {
    float: "a number", int: "a whole number", str: "a string", bool: "true or false", "array": "an array",
    "signal": f"a table {{ type, ... }} of a {' or '.join(SIGNALS)}, or a list of them to be added", "table": "a table",
    "shape": f"a table {{ type, ... }} of a {' or '.join(SHAPES)}",
}  # fmt: skip

DOTTED = re.compile(r"""(?<![\w"'-])(?:[\w"'-]++\s*+\.\s*+){50}""")
"""Long dotted keys, which tomllib parses in hours."""

ELEMENT_HEADER = re.compile(r"\s*\[\[\s*(elements|'elements'|\"elements\")\s*\]\]")


@dataclass(frozen=True)
class Run:
    """The run settings of a problem, as in the table ``[run]`` of a file.

    Parameters
    ----------
    method : str
        A name of ``lcpimpact list methods``.
    dt : float, optional
        Step in s.
    t_end : float, optional
        End in s; by default that of the problem.
    solver : str
        A name of ``lcpimpact list solvers``.
    options : mapping of str to value
        Options of the method.

    Raises
    ------
    InputError
        For an unknown name or option (the message suggests the nearest), or an invalid value.

    Examples
    --------
    >>> Run("moreau-jean", dt=1e-3, options={"theta": 1.0}).changed(method="exact")
    Run(method='exact', dt=0.001, t_end=None, solver='auto', options={})
    """

    method: str = "moreau-jean"
    dt: float | None = None
    t_end: float | None = None
    solver: str = "auto"
    options: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        from lcpimpact.lcp import SOLVERS
        from lcpimpact.simulation import make_integrator

        check_fields(self)
        make_integrator(self.method, dict(self.options))
        SOLVERS[self.solver]
        for name in ("dt", "t_end"):
            if (value := getattr(self, name)) is not None:
                _check_time(name, value)

    def changed(
        self,
        *,
        method: str | None = None,
        dt: float | None = None,
        t_end: float | None = None,
        solver: str | None = None,
        **options: Option,
    ) -> Run:
        """Return the run with the given changes; another method resets the options and the solver."""
        old = self if method in (None, self.method) else Run(dt=self.dt, t_end=self.t_end)
        given = {"method": method, "dt": dt, "t_end": t_end, "solver": solver}
        changes: dict[str, Any] = {key: value for key, value in given.items() if value is not None}
        return replace(old, **changes, options={**old.options, **options})


@dataclass(frozen=True)
class SchemeFile:
    """The contents of a scheme file.

    Attributes
    ----------
    problem : Problem
    run : Run                       the run settings
    registered : str or None        the name of the registered problem, None if the file states a scheme or a system
    parameters : mapping            the parameters of the registered problem in the file

    Examples
    --------
    >>> from lcpimpact import load_problem
    >>> SchemeFile(load_problem("system-1"), Run(dt=1e-2)).simulate(method="exact").success
    True
    """

    problem: Problem
    run: Run = field(default_factory=Run)
    registered: str | None = None
    parameters: Mapping[str, float] = field(default_factory=dict)

    def with_parameters(self, **parameters: float) -> SchemeFile:
        """Return the contents with changed parameters of the registered problem.

        Raises
        ------
        InputError
            If the file states a scheme or a system, which have no parameters; for an unknown parameter or an invalid
            value.
        """
        if not parameters:
            return self
        if self.registered is None:
            raise InputError(
                f"{', '.join(parameters)}: {self.problem.name!r} has its constants in its elements or matrices; change "
                "them there, since only registered problems have parameters"
            )
        return registered_problem(self.registered, {**self.parameters, **parameters}, self.run)

    def simulate(self, *, error: bool = True, **changes: Any) -> Trajectory:
        """Run the problem with the settings of the file; arguments override method, dt, t_end, solver and method options.

        With ``error=False`` the run has no estimated error, as of `lcpimpact.simulate`.

        Errors are those of `lcpimpact.simulate`.
        """
        from lcpimpact.simulation import simulate

        run = self.run.changed(**changes)
        dt, t_end = self.step_and_end(run)
        return simulate(self.problem, run.method, dt=dt, t_end=t_end, lcp_solver=run.solver, error=error, **run.options)

    def step_and_end(self, run: Run, *, near_end: float = 0.01) -> tuple[float, float]:
        """Return dt and t_end of a run in s.

        A dt that is not given is 1 ms, or a thousandth of t_end if smaller; a t_end that is not given is that of the
        problem, for a dt of at most `near_end` of it rounded up to a whole step.

        ``near_end``: largest part of the problem's own end by which a run may be longer, to the end of its last
        step.
        """
        if run.dt is None:
            t_end = run.t_end or self.problem.t_end
            return t_end / _steps(max(STEPS, t_end / DT)), t_end
        if run.t_end is not None:
            return run.dt, run.t_end
        end = self.problem.t_end
        return run.dt, run.dt * _steps(end / run.dt) if run.dt <= near_end * end else end


def _steps(number: float) -> int:
    # Longer runs are rejected later, and infinity has no ceiling.
    return math.ceil(min(number * (1.0 - 1e-12), 1e10))


def registered_problem(name: str, parameters: Mapping[str, float], run: Run | None = None) -> SchemeFile:
    """Return the contents of a file with ``problem = name`` and these parameters."""
    return SchemeFile(build(name, PROBLEMS[name], parameters), run or Run(), name, dict(parameters))


@checked
def read_scheme_file(path: str | Path) -> SchemeFile:
    """Read a problem and its run settings from a TOML file.

    Parameters
    ----------
    path : str or Path
        The file.

    Returns
    -------
    SchemeFile
        ``problem`` and ``run``; its method `simulate` runs it.

    Raises
    ------
    InputError
        For a file that cannot be read or is invalid; the message names the file, the key, and the known keys. Elements are
        counted from 0.

    Examples
    --------
    >>> from tempfile import mkdtemp
    >>> file = Path(mkdtemp(), "ball.toml")
    >>> _ = file.write_text('problem = "bouncing-ball"' + chr(10) + "parameters.e = 0.5")
    >>> read_scheme_file(file).problem.parameters["e"]
    0.5

    References
    ----------
    TOML 1.0.0, toml.io.
    """
    path = Path(path)
    with reading(path, REMEDY):
        return _parse(_read_text(path), path.stem)


@checked
def write_scheme_file(problem: Problem, path: str | Path, run: Run | None = None) -> Path:
    """Write a problem to a TOML file that `read_scheme_file` reads back as an equal problem; the write is atomic.

    Parameters
    ----------
    problem : Problem
        Any problem whose scheme consists of registered elements. Its facts and closed form are not written.
    path : str or Path
        A file ending in .toml.
    run : Run, optional
        Run settings to write.

    Raises
    ------
    InputError
        For another ending, a folder that cannot be written, or a problem with a Python function or an element that is not
        registered.

    Examples
    --------
    >>> from tempfile import mkdtemp
    >>> from lcpimpact import load_problem
    >>> file = write_scheme_file(load_problem("system-1"), Path(mkdtemp(), "system-1.toml"))
    >>> read_scheme_file(file).problem == load_problem("system-1")
    True
    """
    path = Path(path)
    check_output(path, (ENDING,))
    run = run or Run()
    try:
        text = _format(problem, run)
        data = text.encode("utf-8")
        if _parse(text, path.stem) != SchemeFile(problem, run):
            raise InputError(
                f"problem {problem.name!r} has values that a file cannot represent; replace them by plain numbers"
            )
    except UnicodeEncodeError:
        raise InputError(f"cannot write {str(path)!r}: a name contains half a character; rewrite it") from None
    except InputError as error:
        raise InputError(f"cannot write {str(path)!r}: {error}") from None
    with whole_file(path) as part:
        part.write_bytes(data)
    return path


def text_of_run(run: Trajectory) -> str:
    """Return the text of a scheme file with the problem of a run, "" where a file cannot hold it."""
    problem = run.problem
    try:
        text = _format(problem, Run())
        whole = len(text.encode("utf-8")) <= MAX_BYTES and _parse(text, problem.name) == SchemeFile(problem)
    except (InputError, UnicodeEncodeError):
        return ""
    return text if whole else ""


def problem_of_text(text: str) -> SchemeFile:
    """Return the contents of a scheme file of a text.

    Raises
    ------
    InputError
        If it is none.
    """
    return _parse(text, "saved run")


# --- reading -----------------------------------------------------------------------------------------------------------


def _read_text(path: Path) -> str:
    if path.exists() and not path.is_file():
        raise InputError("it is not a file; name a scheme file")
    if (size := path.stat().st_size) > MAX_BYTES:
        raise InputError(f"it has {size:,} bytes, and a scheme file at most {MAX_BYTES:,}; check the name")
    data = path.read_bytes()
    try:
        # Some editors write a byte order mark.
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise InputError(f"line {line}: it is not UTF-8 text; save it in UTF-8") from None


def _parse(text: str, stem: str) -> SchemeFile:
    if DOTTED.search(text):
        raise InputError("a key has more than 50 dots; a scheme needs two")
    try:
        data = tomllib.loads(text)
        _check_size(data)
    except tomllib.TOMLDecodeError as error:
        comma = re.search(r"=\s*[+-]?\d+,\d+\s*$", text, re.MULTILINE)
        if comma is not None:
            line = text.count("\n", 0, comma.start()) + 1
            raise InputError(f"line {line}: a number has a comma: write it with a point") from None
        raise InputError(
            f"it is not TOML: {error}; check the quotes, the brackets, and that no key is repeated"
        ) from None
    except InputError:
        raise
    except ValueError:
        raise InputError("a whole number has too many digits; write it as 1e9") from None
    except RecursionError:
        raise InputError("its brackets are nested too deeply; a scheme needs three levels") from None
    way = _statement_kind(data)
    run = _read_run(data["run"]) if "run" in data else Run()
    if way == "problem":
        name = _convert(data["problem"], str, "problem")
        return registered_problem(name, _read_numbers(data.get("parameters", {}), "parameters"), run)
    scheme: Scheme | LinearComplementaritySystem
    if way == "elements":
        given = cast(Format, _convert(data.get("format", "auto"), str, "format"))
        law = _read_law(data.get("impact_law", "newton"))
        scheme = Scheme(*_read_elements(data["elements"], text), format=given, impact_law=law)
        nodes = [node for element in scheme.elements for node in element.nodes if node != GROUND]
    else:
        scheme = _build(LinearComplementaritySystem, _check_table(data["system"], "system"), "system", SYSTEM)
        nodes = list(scheme.states or ())
    nodes = list(dict.fromkeys(nodes))
    q0, v0 = _read_initial(_check_table(data.get("initial", {}), "initial"), nodes)
    with _locate_elements(scheme, data.get("elements", []), text):
        problem = Problem(
            _convert(data.get("name", stem), str, "name"),
            scheme,
            q0,
            v0,
            t_end=_check_time("t_end", data.get("t_end", 1.0)),
            parameters=_read_numbers(data.get("built_from", {}), "built_from"),
            source=_convert(data.get("source", "-"), str, "source"),
            units=_read_units(_check_table(data.get("units", {}), "units"), nodes),
        )
    return SchemeFile(problem, run)


def _check_size(value: Toml, depth: int = 0) -> None:
    """Check the depth of nesting, the length of strings, and the range of integers."""
    if depth > MAX_DEPTH:
        raise InputError("its tables are nested too deeply; a scheme needs three levels")
    if type(value) is int and not is_real(value):
        raise InputError("a whole number has too many digits; write it as 1e9")
    if isinstance(value, str) and len(value) > MAX_STRING_LENGTH:
        raise InputError(
            f"{value[:20]!r}... has {len(value):,} characters, and a string at most {MAX_STRING_LENGTH:,}; shorten it"
        )
    for key in value if isinstance(value, dict) else ():
        _check_size(key, depth)
    for each in value.values() if isinstance(value, dict) else value if isinstance(value, list) else ():
        _check_size(each, depth + 1)


def _statement_kind(data: Table) -> str:
    """Return the kind of statement of a file, a key of `KEYS`, after a check of its keys."""
    known = list(dict.fromkeys(key for keys in KEYS.values() for key in keys))
    for key in data:
        if key not in known:
            place = _hint_for(key)
            hint = f"; {place}" if place else ""
            raise InputError(nearest(key, known, "key") + hint)
    ways = [way for way in KEYS if way in data]
    if len(ways) != 1:
        found = f"{' and '.join(ways)}: leave all but one out" if ways else "none of them: add one"
        raise InputError(f"it must state a problem by [[elements]], [system] or problem = NAME, and it has {found}")
    for key in data:
        if key not in KEYS[ways[0]]:
            where = {"parameters": "write the constants of a scheme in its elements", "t_end": "write it under [run]"}
            raise InputError(f"{key} is not allowed with {ways[0]}: {where.get(key, 'leave it out')}")
    return ways[0]


def _hint_for(key: str) -> str:
    """Return the correct place of a misplaced top-level key, "" if unknown."""
    if key in ("q", "v"):
        return f"write initial values as {key} under [initial.NODE]"
    if key in (each.name for each in fields(Run)):
        return f"write {key} under [run]"
    return ""


def _read_elements(tables: Toml, text: str) -> Iterator[Element]:
    """Return the elements of an array of tables; ``text`` gives the line numbers in messages."""
    if not isinstance(tables, list) or not all(isinstance(table, dict) for table in tables) or not tables:
        raise InputError("elements must be an array of tables: begin each element with [[elements]]")
    return map(_read_element, tables, _places(tables, text))


def _places(tables: Sequence[Table], text: str) -> list[str]:
    """Return the place in the file of each element."""
    lines = [n for n, line in enumerate(text.split("\n"), 1) if ELEMENT_HEADER.match(line)]
    known = len(lines) == len(tables)
    return [f"elements[{i}]" + (f" (line {lines[i]})" if known else "") for i in range(len(tables))]


def _read_element(table: Table, place: str) -> Element:
    if "type" not in table:
        raise InputError(f"{place}: type is missing: give one of {', '.join(ELEMENTS)}")
    with _locate_errors(place):
        kind = ELEMENTS[_convert(table["type"], str, "type")]
        return _build(kind, {key: value for key, value in table.items() if key != "type"}, kind.__name__)


def _read_initial(tables: Table, nodes: list[str]) -> tuple[dict[str, float], dict[str, float]]:
    """Return q0 and v0."""
    found: dict[str, dict[str, float]] = {"q": {}, "v": {}}
    for node, table in tables.items():
        place = f"initial.{node}"
        inner = [f"{node}.{key}" for key in table] if isinstance(table, dict) else []
        if node not in nodes and (dotted := [name for name in inner if name in nodes]):
            raise InputError(f'{place}: put a node with a dot in its name in quotes, as in [initial."{dotted[0]}"]')
        if node not in nodes:
            raise InputError(f"initial: {nearest(node, nodes, 'node')}")
        for key, value in _check_table(table, place).items():
            if key not in found:
                raise InputError(f"{place}: {nearest(key, list(found), 'key')}")
            found[key][node] = _read_number(value, f"{place}.{key}")
    return found["q"], found["v"]


def _read_units(table: Table, nodes: list[str]) -> dict[str, str]:
    """Return the units of coordinates that are not m."""
    for node in table:
        if node not in nodes:
            raise InputError(f"units: {nearest(node, nodes, 'node')}")
    return {node: _convert(unit, str, f"units.{node}") for node, unit in table.items()}


def _read_run(value: Toml) -> Run:
    table = _check_table(value, "run")
    known = [each.name for each in fields(Run)]
    for key in table:
        if key not in known:
            raise InputError(f"{nearest(key, known, 'key of run')}; write options of the method under [run.options]")
    return _build(Run, table, "run")


def _build(kind: type[T], table: Table, place: str, hints: Mapping[str, Hint] | None = None) -> T:
    """Return an instance of a dataclass from a table with its fields as keys."""
    known: dict[str, Field[Any]] = {each.name: each for each in fields(kind) if each.init}  # type: ignore[arg-type]
    hints = hints or get_type_hints(kind)
    for key in table:
        if key not in known:
            raise InputError(nearest(key, list(known), f"key of {place}"))
    for key, each in known.items():
        if key not in table and each.default is NO_DEFAULT and each.default_factory is NO_DEFAULT:
            raise InputError(f"{place}: {key} is missing: add it")
    values = {key: _convert(value, hints[key], f"{place}.{key}") for key, value in table.items()}
    with _locate_errors("" if issubclass(kind, Element) else place):
        return kind(**values)


def _convert(value: Toml, hint: Hint, place: str) -> Any:
    """Return a value of a file converted to the type of a field."""
    kinds = get_args(hint) if get_origin(hint) in (Union, UnionType) else (hint,)
    held = {_container(kind): kind for kind in kinds}
    if isinstance(value, list) and "array" in held:
        inner = get_args(held["array"])[0]
        return tuple(_convert(each, inner, f"{place}[{i}]") for i, each in enumerate(value))
    if isinstance(value, (dict, list)) and "signal" in held:
        return _read_signal(value, place)
    if isinstance(value, dict) and "shape" in held:
        return _read_shape(value, [name for name, kind in SHAPES.items() if kind in kinds], place)
    if isinstance(value, dict) and "table" in held:
        return value
    # The element itself checks for whole numbers.
    number = type(value) in (int, float) and not {int, float}.isdisjoint(kinds)
    if number or type(value) in kinds or (type(value) is str and "word" in held):
        return value
    what = dict.fromkeys(word for word in map(_describe_type, kinds) if word) or [FUNCTION]
    raise InputError(f"{place} = {_short(value)} must be {' or '.join(what)}")


def _read_signal(table: Toml, place: str) -> Described:
    """Return the signal of a table, without a type a Harmonic, or the sum of a list of them and of numbers."""
    if isinstance(table, list):
        if not table:
            raise InputError(f"{place} is an empty list; give the signals to be added")
        return SignalSum(
            tuple(
                Polynomial((each,)) if is_real(each) else _read_signal(each, f"{place}[{i}]")
                for i, each in enumerate(table)
            )
        )
    if not isinstance(table, dict):
        raise InputError(f"{place} = {_short(table)} must be a number or {WORDS['signal']}")
    name = _convert(table.get("type", "Harmonic"), str, f"{place}.type")
    if name not in SIGNALS:
        raise InputError(f"{place}: {nearest(name, list(SIGNALS), 'signal')}")
    return _build(SIGNALS[name], {key: value for key, value in table.items() if key != "type"}, place)


def _read_shape(table: Table, known: list[str], place: str) -> Shape:
    """Return the shape of a table, of one of the known types; where there is one alone it needs none."""
    if "type" not in table and len(known) > 1:
        raise InputError(f"{place}: type is missing: give one of {', '.join(known)}")
    name = _convert(table.get("type", known[0]), str, f"{place}.type")
    if name not in known:
        raise InputError(f"{place}: {nearest(name, known, 'shape')}")
    return _build(SHAPES[name], {key: value for key, value in table.items() if key != "type"}, place)


def _read_law(value: Toml) -> str | LZB:
    """Return the law of impact of its name, or of a table { exponent, stiffness }, which is that of an LZB."""
    if isinstance(value, str):
        return value
    if not isinstance(value, dict):
        names = ", ".join(map(repr, IMPACT_LAWS))
        raise InputError(
            f"impact_law = {_short(value)} must be one of {names}, or a table {{ exponent, stiffness }} of lzb"
        )
    return _build(LZB, value, "impact_law")


def _container(kind: Hint) -> str:
    """Return the TOML container that a type accepts: "array", "table", "word", "signal", "shape", or "" for none."""
    if kind is Signal or kind in SHAPES.values():
        return "signal" if kind is Signal else "shape"
    return CONTAINERS.get(get_origin(kind), "")


def _describe_type(kind: Hint) -> str:
    """Return the description of a type for messages, "" if it cannot occur in a file."""
    if get_origin(kind) is Literal:
        return " or ".join(map(repr, get_args(kind)))
    return WORDS.get(_container(kind) or kind, "")


def _check_table(value: Toml, place: str) -> Table:
    if not isinstance(value, dict):
        raise InputError(f"{place} = {_short(value)} must be a table: write [{place}] and its keys below")
    return value


def _read_number(value: Toml, place: str) -> float:
    number = _convert(value, float, place)
    if not is_real(number):
        raise InputError(f"{place} = {_short(value)} must be a finite number")
    return number


def _read_numbers(value: Toml, place: str) -> dict[str, float]:
    return {key: _read_number(each, f"{place}.{key}") for key, each in _check_table(value, place).items()}


def _check_time(name: str, value: float) -> float:
    if not is_real(value) or not value > 0.0:
        raise InputError(f"{name} = {_short(value)} must be a positive finite number in s")
    return value


def _short(value: Toml) -> str:
    text = repr(value)
    return text if len(text) <= 40 else f"{text[:37]}..."


@contextmanager
def _locate_errors(place: str) -> Iterator[None]:
    """Prefix errors with their place in the file."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{place}: {error}" if place else str(error)) from None


@contextmanager
def _locate_elements(
    scheme: Scheme | LinearComplementaritySystem, tables: Sequence[Table], text: str
) -> Iterator[None]:
    """Prefix the place in the file to errors of the whole scheme that begin with one of its elements."""
    try:
        yield
    except InputError as error:
        elements = scheme.elements if isinstance(scheme, Scheme) else ()
        named = zip(elements, _places(tables, text), strict=False)
        places = [place for element, place in named if str(error).startswith(f"{element}: ")]
        raise InputError(f"{places[0]}: {error}" if len(places) == 1 else str(error)) from None


# --- writing -----------------------------------------------------------------------------------------------------------


def _format(problem: Problem, run: Run) -> str:
    """Return the text of a file, table by table."""
    scheme, nodes = problem.scheme, problem.dynamics.nodes
    head = {"name": problem.name, "source": problem.source, "t_end": problem.t_end}
    if problem.source == "-":
        del head["source"]
    if isinstance(scheme, Scheme) and scheme.format == "full":
        head["format"] = scheme.format
    if isinstance(scheme, Scheme) and scheme.impact_law != "newton":
        law = scheme.impact_law
        head["impact_law"] = name_of_law(law) if law in IMPACT_LAWS.values() else _entries(law)
    document = tomlkit.document()
    document.update(_table_of(head, "problem"))
    if problem.parameters:
        document["built_from"] = _table_of(problem.parameters, "parameters")
    if isinstance(scheme, Scheme) and scheme.format == "sparse":
        raise InputError(
            f"cannot write {problem.name!r}: files hold no Scheme(..., format='sparse'): leave the format out"
        )
    if isinstance(scheme, Scheme):
        document.add(tomlkit.nl())
        document["elements"] = tomlkit.aot()
        for element in scheme.elements:
            document["elements"].append(_table_of(_element_entries(element), str(element)))
    else:
        document["system"] = _table_of(_entries(scheme), "system")
    starts = {
        node: {key: values[node] for key, values in (("q", problem.q0), ("v", problem.v0)) if node in values}
        for node in nodes
    }
    if any(starts.values()):
        document["initial"] = tomlkit.table(is_super_table=True)
        for node, given in starts.items():
            if given:
                document["initial"][node] = _table_of(given, f"initial.{node}")
    if problem.units:
        document["units"] = _table_of(problem.units, "units")
    settings = _entries(run)
    options = settings.pop("options", {})
    if settings or options:
        document["run"] = _table_of(settings, "run")
        if options:
            document["run"]["options"] = _table_of(options, "run.options")
    return tomlkit.dumps(document)


def _element_entries(element: Element) -> dict[str, Any]:
    kind = type(element).__name__
    if ELEMENTS.get(kind) is not type(element):
        raise InputError(f"{element} is not a registered element: a file can name only {', '.join(ELEMENTS)}")
    entries = {"type": kind, **_entries(element)}
    if element.reaction and entries["name"] == element.reaction:
        # The scheme assigns the same name again, since all others have names.
        del entries["name"]
    return entries


def _entries(described: Any) -> dict[str, Any]:
    """Return the fields of a dataclass that differ from their defaults."""
    values = {each.name: (getattr(described, each.name), _default(each)) for each in fields(described) if each.init}
    return {name: value for name, (value, default) in values.items() if value is not default and value is not None}


def _default(each: Field[Any]) -> Any:
    return each.default if each.default_factory is NO_DEFAULT else each.default_factory()


def _table_of(entries: Mapping[str, Any], place: str) -> tomlkit.items.Table:
    table = tomlkit.table()
    for key, value in entries.items():
        table[key] = _item(value, f"{key} of {place}")
    return table


def _item(value: Any, place: str) -> Any:
    """Return a value as a TOML item; a matrix has one line per row."""
    if isinstance(value, (bool, str)):
        return value
    if type(value) in (*SIGNALS.values(), *SHAPES.values()):
        kind = type(value).__name__
        inline = tomlkit.inline_table()
        entries = _entries(value) if kind == "Harmonic" else {"type": kind, **_entries(value)}
        inline.update({key: _item(each, place) for key, each in entries.items()})
        return inline
    if isinstance(value, SignalSum):
        return _item(value.terms, place)
    if isinstance(value, Mapping):
        inline = tomlkit.inline_table()
        inline.update({key: _item(each, place) for key, each in value.items()})
        return inline
    if isinstance(value, (tuple, list, np.ndarray)):
        array = tomlkit.array()
        array.extend(_item(each, place) for each in value)
        return array.multiline(any(isinstance(each, (tuple, list, np.ndarray)) for each in value))
    if is_real(value) or value in (math.inf, -math.inf):
        return int(value) if isinstance(value, Integral) else float(value)
    if callable(value):
        raise InputError(
            f"{place} is a Python function, which a file cannot hold: give a number, {SIGNAL_NAMES}, or keep it in Python"
        )
    raise InputError(f"{place} = {value!r} cannot be written to a file; give a number, a string or a signal")
