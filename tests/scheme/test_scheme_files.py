"""Scheme files: what is written comes back equal, and whatever is wrong in one is answered in one sentence."""

from __future__ import annotations

import dataclasses
import random
import re
from decimal import Decimal
from pathlib import Path
from typing import get_type_hints

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

import lcpimpact as li
from lcpimpact import (
    InputError,
    Problem,
    Run,
    Scheme,
    UnsupportedError,
    read_scheme_file,
    with_values,
    write_scheme_file,
)
from lcpimpact.arguments import is_name
from lcpimpact.cli.main import main
from lcpimpact.problems import PROBLEMS, load_problem
from lcpimpact.scheme.elements import ELEMENTS
from lcpimpact.scheme.signals import SIGNALS
from lcpimpact.schemefile import KEYS, MAX_BYTES, MAX_DEPTH, MAX_STRING_LENGTH

DOCS = Path(__file__).parents[2] / "docs"


def written(folder, text, name="my.toml"):
    path = folder / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode("utf-8"))
    return path


def read(folder, text):
    return read_scheme_file(written(folder, text))


def round_trip(problem, folder, run=None):
    back = read_scheme_file(write_scheme_file(problem, folder / "back.toml", run))
    assert back.problem == problem
    assert back.run == (run or Run())
    return back


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("scheme files")


# ---- what is written comes back equal -------------------------------------------------------------------------------


LAGRANGIAN = [name for name in PROBLEMS if isinstance(load_problem(name).scheme, li.Lagrangian)]

STATED = [name for name in PROBLEMS if not load_problem(name).dynamics.force_laws and name not in LAGRANGIAN]
"""Problems that a file can hold by their elements: not those with functions."""


@pytest.mark.parametrize("name", LAGRANGIAN)
def test_a_lagrangian_system_is_held_by_its_name_alone(name, tmp_path):
    file = tmp_path / "problem.toml"
    with pytest.raises(InputError, match="is a Python function, which a file cannot hold"):
        li.write_scheme_file(load_problem(name), file)
    assert not file.exists()
    parameter, value = next(iter(load_problem(name).parameters.items()))
    file.write_text(f'problem = "{name}"\nparameters.{parameter} = {value}\n', encoding="utf-8")
    assert li.read_scheme_file(file).problem == load_problem(name)


@pytest.mark.parametrize("name", STATED)
def test_every_problem_comes_back_equal(name, tmp_path):
    problem = load_problem(name)
    back = round_trip(problem, tmp_path)
    # Equal in what the equations are made of, and not only by ==.
    ours, theirs = problem.dynamics, back.problem.dynamics
    assert ours.nodes == theirs.nodes
    assert ours.contacts == theirs.contacts
    for matrix in ("M", "C", "K", "H", "u0", "B", "D"):
        assert np.array_equal(getattr(ours, matrix), getattr(theirs, matrix)), matrix
    assert np.array_equal(problem.initial_coordinates, back.problem.initial_coordinates)
    assert np.array_equal(problem.initial_velocities, back.problem.initial_velocities)


@pytest.mark.parametrize("name", STATED)
def test_every_problem_with_other_parameters_comes_back_equal(name, tmp_path):
    usual, changed = load_problem(name), 0
    for key, value in usual.parameters.items():
        for other in (0.9 * value, value + 1.0)[value == 0.0 :]:
            try:
                problem = load_problem(name, **{key: other})
            except InputError:
                continue  # a whole number, or outside what the problem allows
            assert problem != usual
            round_trip(problem, tmp_path)
            changed += 1
            break
    assert changed >= 1


NODES = {"a": "x", "b": "y", "upper": "x", "lower": "y", "node": "x"}
SIGNAL = li.Harmonic(amplitude=0.3, omega=2.5, phase=-0.1)
VALUES = {"e": 0.25, "sigma_y": 2.0, "E_t": 0.1, "alpha": 0.5, "t_min": 0.01, "t_max": 1.0, "elements": 3, "mass": "lumped",
          "massless": ("y",), "normal": "N", "coordinates": ("x", "y"), "k": 0.7, "jacobian": None,
          "n": 2.0, "rtol": 0.01, "f": SIGNAL, "y": SIGNAL, "name": "Ñ 1"}  # fmt: skip

FILED = [name for name in ELEMENTS if name != "Force"]
"""Elements that a file can hold: not those that are functions alone."""


def example(kind):
    """An element with every constant given, so that none is left out of the file."""
    values, hints = {}, get_type_hints(kind)
    for each in dataclasses.fields(kind):
        if each.name == "symbols":
            values["symbols"] = tuple(f"s_{i}" for i in range(len(each.default)))
        elif hints[each.name] == tuple[float, ...]:
            values[each.name] = (0.3, 0.1 + 0.2)
        else:
            values[each.name] = NODES.get(each.name, VALUES.get(each.name, 0.1 + 0.2))
    if "upper" in values and "b" in values:
        values["b"] = 0.25  # Hunt and Crossley's b is no node
    if kind is li.Substructure:
        values |= {"M": ((2.0, 0.5), (0.5, 1.0)), "C": ((0.1, 0.0), (0.0, 0.2)), "K": ((3.0, -1.0), (-1.0, 3.0))}
        values["f"] = (1.5, SIGNAL)
    if kind is li.Chain:
        values["f"] = (1.5, 0.0)
    if kind is li.Tree:
        values |= {"on": (0, 1, 1), "f": (1.5, 0.0, 2.0)}
    if kind is li.Lattice:
        values |= {"rows": 2, "columns": 2, "f": 1.5, "gap": (0.1, 0.2, 0.3, 0.4, 0.5, 0.7)}
    if kind is li.NonlinearDashpot:
        values |= {"law": "power", "rates": (), "forces": ()}
    values |= {name: value for name, value in {"rebound": "undamped", "pulls": True}.items() if name in values}
    if kind is li.SampledForce:
        values |= {"f": None, "reference": SIGNAL}
    if "shape" in values or kind in (li.Touch, li.Pin, li.Guide):
        line = li.Line((0.25, 0.5), (1.0, 1.5))
        values |= {"shape": line, "line": line, "p": line.p, "q": line.p, "phi": 0.0, "x": 0.1, "y": 0.2}
        return kind(**{name: value for name, value in values.items() if name in hints})
    if kind is li.Loads:
        values |= {"at": (1, 4), "a": (0.25, -1.5)}
    return kind(**values)


def hold(*elements, held=True):
    """A scheme in which both nodes have mass or a motion, so that any element between them is in its place."""
    nodes = [] if not held else ["x", "y"]
    moved = {element.node for element in elements if isinstance(element, li.PrescribedMotion)}
    bounds = [
        li.Bumper(each.upper, each.lower, e=0.0, name=each.normal) for each in elements if isinstance(each, li.Friction)
    ]
    nodes += [node for each in elements if isinstance(each, li.Loads) for node in each.nodes]
    if any(isinstance(each, li.Touch | li.Pin | li.Guide) for each in elements):
        shapes = li.Disk(0.1), li.Line((0.0, -1.0), (1.0, -1.0))
        bounds = [li.Body(name, 1.0, 1.0, shape) for name, shape in zip("xy", shapes, strict=True)]
    return Scheme(*elements, *bounds, *(li.Mass(node, 0.1) for node in nodes if node not in moved))


@pytest.mark.parametrize("name", FILED)
def test_every_element_comes_back_with_each_of_its_constants(name, folder):
    element = example(ELEMENTS[name])
    scheme = hold(element)
    path = write_scheme_file(Problem("one", scheme), folder / "one.toml")
    back = read_scheme_file(path).problem.scheme.elements[0]
    assert back == element
    text = path.read_text(encoding="utf-8")
    for each in dataclasses.fields(ELEMENTS[name]):
        if getattr(element, each.name) != each.default:
            assert re.search(rf"^{each.name} = ", text, re.MULTILINE), each.name


names = st.text(min_size=1, max_size=12).filter(lambda text: is_name(text) and text not in ("ground", "t", "t_R"))
positives = st.floats(1e-6, 1e6)
reals = st.floats(-1e6, 1e6)
points = st.lists(st.tuples(positives, reals), min_size=1, max_size=4)
signals = st.one_of(
    st.builds(li.Harmonic, reals, positives, reals),
    st.builds(li.Square, reals, positives, reals),
    st.builds(li.Polynomial, st.lists(reals, min_size=1, max_size=4)),
    st.builds(lambda a, b, t, T: li.Ramp(a, b, t, t + T), reals, reals, reals, positives),
    st.builds(lambda each: li.Table(np.cumsum([step for step, _ in each]), [value for _, value in each]), points),
)


@st.composite
def problems(draw):
    """Masses in a row, each held below by something, with whatever else may hang there."""
    count = draw(st.integers(1, 4))
    try:
        nodes = draw(st.lists(names, min_size=count, max_size=count, unique=True))
        elements, below = [], "ground"
        for i, node in enumerate(nodes):
            elements.append(li.Mass(node, draw(positives)))
            link = draw(
                st.sampled_from(["Spring", "Dashpot", "KelvinVoigt", "Slider", "Jenkins", "HertzSpring", "Bumper"])
            )
            value = [draw(positives) for _ in range(3)]
            elements.append(
                {
                    "Spring": lambda n, b, v, i: li.Spring(n, b, v[0]),
                    "Dashpot": lambda n, b, v, i: li.Dashpot(n, b, v[0]),
                    "KelvinVoigt": lambda n, b, v, i: li.KelvinVoigt(n, b, v[0], v[1], symbols=(n, b)),
                    "Slider": lambda n, b, v, i: li.Slider(n, b, v[0], name=f"S{i}"),
                    "Jenkins": lambda n, b, v, i: li.Jenkins(n, b, v[0], v[1], v[2], name=f"J.{i}"),
                    "HertzSpring": lambda n, b, v, i: li.HertzSpring(n, b, v[0], gap=v[1]),
                    "Bumper": lambda n, b, v, i: li.Bumper(n, b, gap=10.0 * v[0], e=0.5, name=f"R{i}"),
                }[link](node, below, value, i)
            )
            if draw(st.booleans()):
                elements.append(li.Load(node, draw(st.one_of(reals, signals, st.integers(-(10**20), 10**20)))))
            below = node
        some = st.dictionaries(st.sampled_from(nodes), st.one_of(st.floats(-1e-7, 1e-7), st.just(0)))
        built_from = draw(st.dictionaries(st.text(max_size=8), st.one_of(reals, st.integers(-9, 9))))
        t_end, source = draw(st.floats(1e-9, 1e9)), draw(st.text(max_size=30))
        return Problem(draw(names), Scheme(*elements), draw(some), draw(some), t_end, built_from, source)
    except InputError:
        assume(False)


@given(problems())
def test_any_scheme_comes_back_equal(folder, problem):
    round_trip(problem, folder)


square = st.integers(1, 4).flatmap(
    lambda n: st.tuples(*[st.lists(st.lists(reals, min_size=n, max_size=n), min_size=n, max_size=n) for _ in range(4)])
)


@given(square, st.data())
def test_any_system_comes_back_equal(folder, matrices, data):
    A, B, C, D = matrices
    n = len(A)
    states = data.draw(st.none() | st.lists(names, min_size=n, max_size=n, unique=True))
    a = data.draw(st.lists(reals | signals, min_size=n, max_size=n))
    try:
        system = li.LinearComplementaritySystem(A, B, C, D, a, data.draw(st.none() | st.just([1.5] * n)), states)
        problem = Problem("circuit", system, {system.states[0]: data.draw(reals)})
    except InputError:
        assume(False)
    round_trip(problem, folder)


@pytest.mark.parametrize(
    "run",
    [Run(), Run("exact", dt=1e-3), Run(dt=0.1, t_end=2, solver="lemke", options={"theta": 1.0}),
     Run("rk4-paper", options={"contact": "project"}), Run("exact", options={"max_events": 7})],
)  # fmt: skip
def test_a_run_comes_back_equal(run, tmp_path):
    round_trip(load_problem("system-2"), tmp_path, run)


def test_the_file_is_written_to_be_read(tmp_path):
    scheme = Scheme(li.Mass("x", 2.0), li.Bumper("x", "ground", gap=0.5, e=0.0), li.Load("x", li.Harmonic(1.0, 3.0)))
    path = write_scheme_file(Problem("a ball", scheme, v0={"x": 1.0}), tmp_path / "ball.toml", Run(dt=1e-3))
    assert path.read_text() == (
        'name = "a ball"\nt_end = 1.0\n\n'
        '[[elements]]\ntype = "Mass"\nnode = "x"\nm = 2.0\n\n'
        '[[elements]]\ntype = "Bumper"\nupper = "x"\nlower = "ground"\ngap = 0.5\ne = 0.0\n\n'
        '[[elements]]\ntype = "Load"\nnode = "x"\nf = {amplitude = 1.0, omega = 3.0}\n\n'
        "[initial.x]\nv = 1.0\n\n[run]\ndt = 0.001\n"
    )


def test_reactions_that_a_scheme_named_have_the_same_names_when_read(tmp_path):
    """The first needs no name in the file, wherever it stands; the others do."""
    bodies = [li.Mass(node, 1.0) for node in "xyz"]
    for names in ((None, None, None), (None, "R", None), ("R_2", None, "A")):
        bumpers = [li.Bumper(node, "ground", e=0.0, name=name) for node, name in zip("xyz", names, strict=True)]
        scheme = Scheme(*bodies, *bumpers)
        path = write_scheme_file(Problem("three", scheme), tmp_path / "three.toml")
        assert read_scheme_file(path).problem.scheme == scheme
        assert '"R"' not in path.read_text()
    (tmp_path / "two.toml").write_text(
        "".join(f'[[elements]]\ntype = "Mass"\nnode = "{node}"\nm = 1.0\n'
                f'[[elements]]\ntype = "Bumper"\nupper = "{node}"\nlower = "ground"\ne = 0.0\n' for node in "xy")
    )  # fmt: skip
    assert [each.name for each in read_scheme_file(tmp_path / "two.toml").problem.dynamics.contacts] == ["R", "R_2"]


# ---- what cannot be written -----------------------------------------------------------------------------------------


@dataclasses.dataclass(frozen=True)
class Own(li.Spring):
    """A spring of one's own."""


MASS = li.Mass("x", 1.0)
UNWRITABLE = {
    "function as a load": (Scheme(MASS, li.Load("x", lambda t: t)), {}, "f of Load at 'x' is a Python function.*Harmonic"),
    "function as a motion": (
        Scheme(MASS, li.PrescribedMotion("y", li.Motion(lambda t: t, lambda t: 1.0))),
        {},
        "y of PrescribedMotion at 'y' is a Python function",
    ),
    "function in a system": (
        li.LinearComplementaritySystem([[0.0]], [[1.0]], [[1.0]], a=[lambda t: t]), {}, "a of system is a Python function"
    ),
    "element of one's own": (Scheme(MASS, Own("x", "ground", 1.0)), {}, "Own between.*not a registered.*Mass, Spring"),
    "number that is no float": (Scheme(MASS), {"parameters": {"m": Decimal("0.1")}}, "cannot be written to a file"),
    "parameter that is no number": (Scheme(MASS), {"parameters": {"m": None}}, "m of parameters = None"),
    "half a character": (Scheme(MASS), {"source": "\ud800"}, "half a character"),
    "endless name": (Scheme(MASS), {"name": "n" * 2000}, "2,000 characters"),
    "no time": (Scheme(MASS), {"t_end": -1.0}, "t_end = -1"),
}  # fmt: skip


@pytest.mark.parametrize("case", UNWRITABLE)
def test_what_a_file_cannot_hold_is_refused_and_nothing_is_written(case, tmp_path):
    scheme, more, said = UNWRITABLE[case]
    path = written(tmp_path, "older")
    with pytest.raises(InputError, match=f"cannot write .*my.toml.*{said}"):
        write_scheme_file(Problem(**{"name": "own", "scheme": scheme, **more}), path)
    assert path.read_text() == "older"
    assert list(tmp_path.iterdir()) == [path]


def test_a_file_is_written_whole_or_not_at_all(tmp_path, monkeypatch):
    path = written(tmp_path, "older")
    monkeypatch.setattr(Path, "replace", lambda *_: (_ for _ in ()).throw(OSError(28, "No space left on device")))
    with pytest.raises(InputError, match="No space left"):
        write_scheme_file(load_problem("system-1"), path)
    assert path.read_text() == "older"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize(("name", "said"), [("my.tml", "must end in one of .toml"), ("no/my.toml", "no folder")])
def test_a_name_that_cannot_be_written(name, said, tmp_path):
    with pytest.raises(InputError, match=said):
        write_scheme_file(load_problem("system-1"), tmp_path / name)


# ---- what a file does -----------------------------------------------------------------------------------------------

NAMED = """
problem = "system-1"

[parameters]
c_o = 300
h_o = 2.0

[run]
method = "moreau-jean"
dt = 1e-2
t_end = 1.0

[run.options]
theta = 1.0
"""


def test_a_named_problem_takes_its_parameters(tmp_path):
    file = read(tmp_path, NAMED)
    assert file.problem == load_problem("system-1", c_o=300.0, h_o=2.0)
    assert file.registered == "system-1"
    # A changed height counts, though the speed that follows from it was a parameter of the problem already.
    assert file.with_parameters(h_o=1.0).problem == load_problem("system-1", c_o=300.0, h_o=1.0)
    assert file.with_parameters(h_o=1.0).run == file.run
    assert file.with_parameters() is file
    with pytest.raises(InputError, match="did you mean 'k_o'"):
        file.with_parameters(ko=3.0)


def test_a_file_runs_as_it_says(tmp_path):
    file = read(tmp_path, NAMED)
    expected = li.simulate(file.problem, "moreau-jean", dt=1e-2, t_end=1.0, theta=1.0)
    found = file.simulate()
    assert found.method == expected.method
    assert found["x"].tolist() == expected["x"].tolist()
    assert file.simulate(theta=0.5, dt=1e-3)["x"].tolist() == (
        li.simulate(file.problem, dt=1e-3, t_end=1.0)["x"].tolist()
    )
    assert file.simulate(method="exact").method.startswith("exact(")


def test_the_step_and_the_end_have_a_sensible_default(tmp_path):
    ball = li.SchemeFile(load_problem("system-1"))
    assert len(ball.simulate().t) == 3001
    assert len(ball.simulate(t_end=0.5).t) == 1001
    assert ball.simulate(dt=0.029).t[-1] == pytest.approx(104 * 0.029, rel=1e-12, abs=0.0)
    for dt in (0.7, 0.031):  # the last step would end more than 1 % of the run later
        with pytest.raises(InputError, match=rf"t_end = 3 s is not a whole number of steps dt = {dt} s"):
            ball.simulate(dt=dt)
    assert ball.simulate(dt=0.1).t[-1] == pytest.approx(3.0, rel=1e-12, abs=0.0)
    assert 3.0 / (3.0 / 47.0) > 47.0, "the quotient is rounded up, and no step more for it"
    assert len(ball.simulate(dt=3.0 / 47.0).t) == 48
    for_ever = li.SchemeFile(dataclasses.replace(ball.problem, t_end=1e308))
    for changes in ({}, {"dt": 1e-3}):
        with pytest.raises(InputError, match="more than 1e9 steps"):
            for_ever.simulate(**changes)
    with pytest.raises(InputError, match="not a whole number of steps"):
        ball.simulate(dt=0.7, t_end=3.0)
    with pytest.raises(InputError, match="larger dt"):
        ball.simulate(dt=1e-300)


def test_another_method_keeps_the_times_and_nothing_else():
    run = Run("moreau-jean", dt=0.1, t_end=2.0, solver="lemke", options={"theta": 1.0})
    assert run.changed() == run
    assert run.changed(method="moreau-jean", tol=1e-9).options == {"theta": 1.0, "tol": 1e-9}
    assert run.changed(method="exact") == Run("exact", dt=0.1, t_end=2.0)
    assert run.changed(theta=0.5, dt=0.2) == dataclasses.replace(run, dt=0.2, options={"theta": 0.5})


def test_a_scheme_has_no_parameters_to_change(tmp_path):
    file = read_scheme_file(write_scheme_file(load_problem("system-1"), tmp_path / "a.toml"))
    with pytest.raises(InputError, match="m: 'system-1' has its constants in its elements"):
        file.with_parameters(m=3.0)


MINIMAL = '[[elements]]\ntype = "Mass"\nnode = "x"\nm = 1.0\n'


def test_a_problem_without_a_name_is_called_as_its_file(tmp_path):
    problem = read_scheme_file(written(tmp_path, MINIMAL, "two balls.toml")).problem
    assert problem == Problem("two balls", Scheme(MASS))


@pytest.mark.parametrize(
    "text",
    [MINIMAL.replace("\n", "\r\n"), b"\xef\xbb\xbf" + MINIMAL.encode(),
     'elements = [{ type = "Mass", node = "x", m = 1 }]', '[["elements"]]\ntype="Mass"\nnode="\\u0078"\nm=1_000e-3'],
    ids=["CRLF", "byte order mark", "one line", "other spellings"],
)  # fmt: skip
def test_other_ways_to_write_the_same(text, tmp_path):
    assert read(tmp_path, text).problem == Problem("my", Scheme(MASS))


# ---- what is wrong in a file ----------------------------------------------------------------------------------------

SPRING = MINIMAL + '\n[[elements]]\ntype = "Spring"\na = "x"\nb = "ground"\nk = 5.0\n'
JENKINS = MINIMAL + '\n[[elements]]\ntype = "Jenkins"\na = "x"\nb = "ground"\nk = 5.0\nf_y = 1.0\n'
LOAD = MINIMAL + '\n[[elements]]\ntype = "Load"\nnode = "x"\n'
SYSTEM = "[system]\nA = [[0.0]]\nB = [[1.0]]\nC = [[1.0]]\n"
RUN = MINIMAL + "\n[run]\n"

WRONG = {
    "empty": ("", r"must state a problem by \[\[elements\]\].* none of them: add one"),
    "no TOML": ("m = \n", r"not TOML: .*line 1, column 5.*check the quotes"),
    "duplicate key": (MINIMAL + "m = 2.0\n", r"not TOML: .*line 5.*no key is repeated"),
    "cut off": (SPRING[:-12], r"not TOML: Unterminated string \(at end of document\)"),
    "unknown key": (MINIMAL + "[paramters]\n", r"unknown key 'paramters': did you mean 'parameters'"),
    "run key at the top": ("dt = 1e-3\n" + MINIMAL, r"unknown key 'dt'.*write dt under \[run\]"),
    "initial key at the top": ("v = 1e-3\n" + MINIMAL, r"v under \[initial.NODE\]"),
    "two ways": ('problem = "system-1"\n' + MINIMAL, r"elements and problem: leave all but one out"),
    "parameters of a scheme": (MINIMAL + "[parameters]\n", r"parameters is not allowed with elements: .*in its elements"),
    "end of a named problem": ('problem = "system-1"\nt_end = 3.0', r"t_end is not allowed with problem: .*\[run\]"),
    "initial of a named problem": ('problem = "system-1"\n[initial.x]\nq = 1', r"initial is not allowed with problem"),
    "unknown problem": ('problem = "sytem-1"', r"unknown problem 'sytem-1': did you mean 'system-1'"),
    "problem that is no name": ("problem = 1", r"problem = 1 must be a string"),
    "unknown parameter": ('problem = "system-1"\nparameters.co = 1', r"unknown parameter of system-1 'co'.*'c_o'"),
    "parameter called name": ('problem = "system-1"\nparameters.name = 1', r"unknown parameter of system-1 'name'"),
    "word as a parameter": ('problem = "system-1"\nparameters.m = "a"', r"parameters.m = 'a' must be a number"),
    "parameters no table": ('problem = "system-1"\nparameters = 3', r"parameters = 3 must be a table: write \[parameters\]"),
    "bad parameter": ('problem = "system-1"\nparameters.m = -1', r"Mass at 'x': m = -1.0 must be a positive"),
    "elements one table": ('[elements]\ntype = "Mass"', r"begin each element with \[\[elements\]\]"),
    "elements no tables": ("elements = [1]", r"begin each element with \[\[elements\]\]"),
    "no elements": ("elements = []", r"begin each element with \[\[elements\]\]"),
    "unknown type": (SPRING.replace('"Spring"', '"Sprng"'),
                     r"elements\[1\] \(line 6\): unknown element 'Sprng': did you mean 'Spring'"),
    "type in small letters": (SPRING.replace('"Mass"', '"mass"'), r"unknown element 'mass': did you mean 'Mass'"),
    "no type": (SPRING.replace('type = "Spring"', ""), r"elements\[1\] \(line 6\): type is missing: give one of Mass"),
    "type that is no name": (SPRING.replace('"Spring"', "3"), r"elements\[1\] \(line 6\): type = 3 must be a string"),
    "unknown constant": (SPRING.replace("k = 5", "kk = 5"),
                         r"\(line 6\): unknown key of Spring 'kk': did you mean 'k'\? known are a, b, k, symbols"),
    "missing constant": (SPRING.replace("k = 5.0", ""),
                         r"elements\[1\] \(line 6\): Spring between 'x' and 'ground': k is missing; give .* N/m"),
    "missing node": (SPRING.replace('a = "x"', ""), r"elements\[1\] \(line 6\): Spring: a is missing: add it"),
    "word for a number": (SPRING.replace("5.0", '"stiff"'), r"Spring.k = 'stiff' must be a number$"),
    "truth for a number": (SPRING.replace("5.0", "true"), r"Spring.k = True must be a number$"),
    "table for a number": (SPRING.replace("5.0", "{ amplitude = 1 }"), r"Spring.k = \{'amplitude': 1\} must be a number$"),
    "array for a number": (SPRING.replace("5.0", "[5.0]"), r"Spring.k = \[5.0\] must be a number$"),
    "date for a number": (SPRING.replace("5.0", "1979-05-27"), r"Spring.k = datetime.date.* must be a number$"),
    "number for a node": (SPRING.replace('"ground"', "3"), r"Spring.b = 3 must be a string$"),
    "one node": (SPRING.replace('"ground"', '"x"'), r"elements\[1\] \(line 6\): Spring.*both ends are one node"),
    "empty node": (SPRING.replace('"ground"', '""'), r"elements\[1\] .* the node name '' must be a string, not empty"),
    "NaN": (SPRING.replace("5.0", "nan"), r"k = nan must be a positive finite number in N/m"),
    "too large": (SPRING.replace("5.0", "9" * 400), r"a whole number has too many digits; write it as 1e9"),
    "far too large": (SPRING.replace("5.0", "9" * 5000), r"a whole number has too many digits"),
    "far too large in base 16": (SPRING.replace("5.0", "0x" + "f" * 5000), r"a whole number has too many digits"),
    "symbols": (SPRING + 'symbols = ["k", "l"]', r"of a Spring must be a tuple of 1 strings"),
    "symbols that are none": (SPRING + "symbols = [1]", r"Spring.symbols\[0\] = 1 must be a string"),
    "no load": (LOAD, r"Load at 'x': f is missing"),
    "word as a load": (
        LOAD + 'f = "g"',
        r"Load.f = 'g' must be a number or a table \{ type, ... \} of a .*Square, or a list of them to be added$",
    ),
    "unknown signal": (LOAD + 'f = { type = "Rmp", start = 0 }', r"Load.f: unknown signal 'Rmp': did you mean 'Ramp'"),
    "missing key of a signal": (LOAD + 'f = { type = "Square", amplitude = 1 }', r"Load.f: omega is missing: add it"),
    "number for a table": (LOAD + 'f = { type = "Table", times = 3, values = [1] }', r"Load.f.times = 3 must be an array"),
    "word in a table": (LOAD + 'f = { type = "Table", times = ["a"], values = [1] }',
                        r"Load.f.times\[0\] = 'a' must be a number"),
    "points out of order": (LOAD + 'f = { type = "Table", times = [1, 0], values = [1, 2] }',
                            r"Load.f: Table: the time 0 s follows 1 s"),
    "unknown key of a load": (LOAD + "f = { amplitude = 1, omga = 2 }", r"key of Load.f 'omga': did you mean 'omega'"),
    "missing key of a load": (LOAD + "f = { amplitude = 1 }", r"Load.f: omega is missing: add it"),
    "word in a load": (LOAD + 'f = { amplitude = 1, omega = "a" }', r"Load.f.omega = 'a' must be a number"),
    "bad load": (LOAD + "f = { amplitude = 1, omega = -2 }", r"Load.f: Harmonic.* omega above zero"),
    "loose node": (SPRING.replace('"ground"', '"y"').replace('"Spring"', '"Bumper"').replace("a =", "upper =")
                   .replace("b =", "lower =").replace("k = 5.0", ""), r"nothing holds node 'y'"),
    "initial of an unknown node": (SPRING + "[initial.y]\nq = 1", r"initial: unknown node 'y': known are x"),
    "initial of a misspelt node": (SPRING.replace('"x"', '"body"') + "[initial.bdy]\nq = 1", r"did you mean 'body'"),
    "unknown initial key": (SPRING + "[initial.x]\nx = 1", r"initial.x: unknown key 'x': known are q, v"),
    "initial no table": (SPRING + "[initial]\nx = 1", r"initial.x = 1 must be a table: write \[initial.x\]"),
    "initial word": (SPRING + '[initial.x]\nq = "a"', r"initial.x.q = 'a' must be a number"),
    "initial NaN": (SPRING + "[initial.x]\nq = nan", r"initial.x.q = nan must be a finite number"),
    "inner node without quotes": (JENKINS + "[initial.F.1]\nq = 1", r'a dot in its name in quotes, as in \[initial."F.1"\]'),
    "penetrated": (MINIMAL + '[[elements]]\ntype="Bumper"\nupper="x"\nlower="ground"\ne=1\n[initial.x]\nq=1', r"penetrated"),
    "t_end": ("t_end = 0\n" + MINIMAL, r"t_end = 0 must be a positive finite number in s"),
    "name": ("name = 3\n" + MINIMAL, r"name = 3 must be a string"),
    "source": ("source = []\n" + MINIMAL, r"source = \[\] must be a string"),
    "built_from": (MINIMAL + "[built_from]\nm = 'a'", r"built_from.m = 'a' must be a number"),
    "system no table": ("system = 3", r"system = 3 must be a table"),
    "system without C": (SYSTEM.replace("C = [[1.0]]", ""), r"system: C is missing: add it"),
    "unknown matrix": (SYSTEM + "E = [[0.0]]", r"unknown key of system 'E'.*known are A, B, C, D, a, c, states"),
    "ragged matrix": (SYSTEM.replace("[[0.0]]", "[[0.0], [1.0, 2.0]]"), r"system: A of the system must be a matrix"),
    "matrix without rows": (SYSTEM.replace("[[0.0]]", "[0.0]"), r"system.A\[0\] = 0.0 must be an array"),
    "word in a matrix": (SYSTEM.replace("[[0.0]]", '[["1"]]'), r"system.A\[0\]\[0\] = '1' must be a number"),
    "matrix that does not fit": (SYSTEM.replace("[[0.0]]", "[[0.0, 1.0], [1.0, 0.0]]"),
                                 r"system: B of the system has the shape"),
    "wrong states": (SYSTEM + 'states = ["a", "b"]', r"states of the system must hold 1 names"),
    "initial of an unknown state": (SYSTEM + 'states = ["volt"]\n[initial.vol]\nq = 1',
                                    r"unknown node 'vol': did you mean 'volt'"),
    "run no table": ("run = 3\n" + MINIMAL, r"run = 3 must be a table"),
    "unknown run key": (RUN + "methd = 'exact'", r"unknown key of run 'methd': did you mean 'method'"),
    "option outside options": (RUN + "theta = 1.0",
                               r"unknown key of run 'theta'.*write options of the method under \[run.options\]"),
    "unknown method": (RUN + "method = 'moreau'", r"run: unknown method 'moreau': did you mean 'moreau-jean'"),
    "unknown solver": (RUN + "solver = 'lemk'", r"run: unknown solver 'lemk': did you mean 'lemke'"),
    "unknown option": (RUN + "options.thta = 1", r"run: unknown option of moreau-jean 'thta': did you mean 'theta'"),
    "bad option": (RUN + "options.theta = 2", r"run: .*theta = 2"),
    "word as an option": (RUN + "options.theta = 'a'", r"run: .*theta = 'a'"),
    "options no table": (RUN + "options = 3", r"run.options = 3 must be a table"),
    "step that is none": (RUN + "dt = 0", r"run: dt = 0 must be a positive finite number in s"),
    "step in words": (RUN + "dt = 'fine'", r"run.dt = 'fine' must be a number"),
    "nested without end": (MINIMAL + "x = " + "[" * 5000, r"nested too deeply"),
    "nested deeply": (MINIMAL + "a." * (MAX_DEPTH + 1) + "a = 1", r"nested too deeply"),
    "dots without end": ("a." * 1_000_000 + "a = 1", r"a key has more than 50 dots"),
    "quoted dots without end": ("'a' . " * 500_000 + "a = 1", r"a key has more than 50 dots"),
    "dots in a header": ("[" + '"a". ' * 500_000 + "a]", r"a key has more than 50 dots"),
    "a word without end": ("a" * 3_000_000, r"not TOML"),
    "endless string": (f"name = '{'n' * (MAX_STRING_LENGTH + 1)}'\n" + MINIMAL, r"'nnnnnn.*'... has 1,001 characters"),
    "endless key": ("n" * (MAX_STRING_LENGTH + 1) + " = 1\n" + MINIMAL, r"'nnnnnn.*'... has 1,001 characters"),
    "not UTF-8": (MINIMAL.encode() + b"# caf\xe9\n", r"line 5: it is not UTF-8 text; save it in UTF-8"),
    "UTF-16": (MINIMAL.encode("utf-16"), r"line 1: it is not UTF-8 text"),
    "too many elements of a bar": (
        '[[elements]]\ntype="Bar"\na="x"\nb="ground"\nE=1\nA=1\nrho=1\nL=1\nelements=1_000_000_000',
        r"elements = 1000000000 must be a whole number from 1 to"),
}  # fmt: skip


@pytest.mark.parametrize("case", WRONG)
def test_what_is_wrong_is_said_in_one_sentence(case, tmp_path):
    text, said = WRONG[case]
    path = written(tmp_path, text)
    with pytest.raises(InputError, match=said) as error:
        read_scheme_file(path)
    message = str(error.value)
    assert message.startswith(f"cannot read {str(path)!r}: ")
    assert "\n" not in message
    assert len(message) < len(str(path)) + 600


def test_the_line_of_an_element_is_told_only_where_it_is_known(tmp_path):
    with pytest.raises(InputError, match=r": elements\[0\]: Mass at"):
        read(tmp_path, 'elements = [{type = "Mass", node = "x"}]')
    with pytest.raises(InputError, match=r": elements\[1\]: Mass at"):
        read(tmp_path, 'name = """\n[[elements]]\n"""\n' + MINIMAL + '[[elements]]\ntype = "Mass"\nnode = "y"')


def test_files_that_are_none(tmp_path):
    for path, said in (
        (tmp_path / "my.toml", "No such file or directory; check the name"),
        (tmp_path, "it is not a file; name a scheme file"),
        (Path("/dev/zero"), "it is not a file"),
        (tmp_path / ("n" * 300 + ".toml"), "name too long"),
    ):
        with pytest.raises(InputError, match=f"(?i)cannot read .*{said}"):
            read_scheme_file(path)
    with (tmp_path / "huge.toml").open("wb") as file:
        file.truncate(MAX_BYTES + 1)
    with pytest.raises(InputError, match=r"4,000,001 bytes.*check the name"):
        read_scheme_file(tmp_path / "huge.toml")


@pytest.mark.parametrize("name", FILED)
def test_a_constant_of_the_wrong_kind_is_answered_by_the_right_one(name, tmp_path):
    """Also for an element that nobody has thought of yet."""
    element = example(ELEMENTS[name])
    lines = (
        write_scheme_file(Problem("one", hold(element)), tmp_path / "one.toml").read_text(encoding="utf-8").split("\n")
    )
    for each in dataclasses.fields(element):
        # The first behind the header: the problem has a name too, and the masses that hold the nodes stand last.
        starts = (i for i, line in enumerate(lines) if line.startswith(f"{each.name} = "))
        at = next((i for i in starts if i > lines.index("[[elements]]")), None)
        if at is None:
            continue
        end = lines.index("]", at) if lines[at].endswith("[") else at  # a matrix takes a line a row
        broken = "\n".join([*lines[:at], f"{each.name} = 1979-05-27", *lines[end + 1 :]])
        with pytest.raises(
            InputError, match=rf"elements\[0\] .*{name}.{each.name} = .* must be (a|an|true|'\w+') ?\w*"
        ):
            read(tmp_path, broken)


def test_functions_of_the_motion_are_no_matter_of_files(tmp_path):
    for element, says in (
        (li.Load("x", lambda t, q, v: -v), "f of Load at 'x' is a Python function"),
        (li.Force(("x", "y"), lambda t, q, v: -v), "f of Force between 'x' and 'y' is a Python function"),
    ):
        with pytest.raises(InputError, match=rf"cannot write .*{says}, which a file cannot hold"):
            write_scheme_file(Problem("one", hold(element)), tmp_path / "one.toml")
    force = MINIMAL + '\n[[elements]]\ntype = "Force"\nnodes = ["x"]\n'
    with pytest.raises(
        InputError, match=r"elements\[\d\].*Force.f = 'v' must be a Python function, which a file cannot hold"
    ):
        read(tmp_path, force + 'f = "v"')
    with pytest.raises(InputError, match=r"Force at 'x': f is missing; give a function of t, q and v"):
        read(tmp_path, force)


# ---- a thousand broken files ----------------------------------------------------------------------------------------

EVERYTHING = """
name = "all of them"   # a comment
[[elements]]
type = "Mass"
node = "x"
m = 2.0
[[elements]]
type = "Load"
node = "x"
f = { amplitude = 1.0, omega = 2.0, phase = 0.5 }
[[elements]]
type = "Jenkins"
a = "x"
b = "y"
k = 5.0
f_y = 1.0
k_h = 2.0
symbols = ["k", "f", "h"]
[[elements]]
type = "PrescribedMotion"
node = "y"
y = {amplitude=0.1, omega=3}
[[elements]]
type = "GeneralizedMaxwell"
a = "x"
b = "ground"
k_inf = 1.0
k = [1.0, 2.0]
tau = [0.1, 1.0]
[[elements]]
type = "Bar"
a = "p"
b = "r"
E = 900.0
A = 1.0
rho = 1.0
L = 10.0
elements = 4
massless = ["r"]
[[elements]]
type = "Bumper"
upper = "r"
lower = "ground"
gap = 5.0
[initial.x]
q = 0.1
v = 1
[initial."F.1"]
q = 0.0
[run]
method = "moreau-jean"
dt = 0.01
t_end = 1.0
solver = "lemke"
[run.options]
theta = 0.7
"""

CIRCUIT = """
t_end = 1.0
[system]
A = [[0.0, 1.0], [-1.0, 0.0]]
B = [[1.0], [0.0]]
C = [[1.0, 0.0]]
D = [[0.5]]
a = [-1.0, { amplitude = 1.0, omega = 2.0 }]
c = [0.0]
states = ["u", "i"]
multipliers = ["λ"]
[initial]
u = {q = 1.0}
"""

ODD_VALUES = [
    '"x"', '"ground"', "0", "-1.0", "1e400", "nan", "-inf", "true", "[]", "[1.0]", '[[1.0,"a"],[]]', "{}", "{a=1}",
    "{amplitude=1,omega=2}", "1979-05-27", "07:32:00", "1979-05-27T07:32:00Z", '""', '"\\u0000"', "9" * 400,
    "0x" + "f" * 400, "1e308", "1e-320", "[[[[[1]]]]]", '"Mass"', '["x","y"]', "3", "1_000", "0.5", '"é\U0001f600"',
    "'''a\nb'''", "[true]", "[nan]", '"moreau-jean"', '"exact"', '"rk4-paper"', '["k"]', "[1e400]",
]  # fmt: skip
PIECES = [*"[]{}=\"'#.,\n", "[[elements]]", "[run]", '\ntype="Mass"\n', "[" * 2000, "a." * 3000 + "a=1", "\n[elements]\n",
          '\nproblem="system-1"\n', "\n[system]\n"]  # fmt: skip
HEADERS = ["[elements]", "[[initial]]", "[initial.y]", "[run]", "[[run]]", "[system]", "[parameters]", "[run.options]",
           "[built_from]", ""]  # fmt: skip
WORDS = ["Mass", "Load", "Bumper", "Jenkins", "Bar", "Spring", "x", "y", "ground", "1.0", "k", "q"]
KINDS = ["delete a line", "double a line", "swap lines", "another value", "swap keys", "truncate", "strange characters",
         "delete a character", "insert a piece", "another header", "misspell a key", "another word"]  # fmt: skip


def broken(text, rng, kind):
    """The text with one thing wrong (or, by luck, nothing)."""
    lines, place = text.split("\n"), rng.randrange(len(text) + 1)
    i, j = rng.randrange(len(lines)), rng.randrange(len(lines))
    keyed = [n for n, line in enumerate(lines) if "=" in line] or [i]
    headed = [n for n, line in enumerate(lines) if line.lstrip().startswith("[")] or [i]
    match kind:
        case "delete a line":
            del lines[i]
        case "double a line":
            lines.insert(j, lines[i])
        case "swap lines":
            lines[i], lines[j] = lines[j], lines[i]
        case "another value":
            n = rng.choice(keyed)
            lines[n] = f"{lines[n].split('=', 1)[0]}= {rng.choice(ODD_VALUES)}"
        case "swap keys":
            m, n = rng.choice(keyed), rng.choice(keyed)
            (one, _, first), (other, _, second) = lines[m].partition("="), lines[n].partition("=")
            lines[m], lines[n] = f"{other}={first}", f"{one}={second}"
        case "another header":
            n = rng.choice(headed)
            lines[n] = rng.choice([*HEADERS, lines[n].replace("[[", "[").replace("]]", "]")])
        case "misspell a key":
            n = rng.choice(keyed)
            key, _, value = lines[n].partition("=")
            at = rng.randrange(len(key) + 1)
            lines[n] = f"{key[:at]}{rng.choice('abk_x1')}{key[at + rng.randrange(2) :]}={value}"
        case "truncate":
            return text[:place]
        case "strange characters":
            ranges = [(1, 128), (0xA0, 0xD7FF), (0x10000, 0x10FFFF)]
            return text[:place] + "".join(chr(rng.randrange(*rng.choice(ranges))) for _ in range(3)) + text[place:]
        case "delete a character":
            return text[:place] + text[place + 1 :]
        case "insert a piece":
            return text[:place] + rng.choice(PIECES) + text[place:]
        case "another word":
            return text.replace(rng.choice(WORDS), rng.choice(WORDS), rng.choice([1, -1]))
    return "\n".join(lines)


@pytest.fixture(scope="module")
def sound(folder):
    """Texts of files in which nothing is wrong."""
    texts = [EVERYTHING, CIRCUIT, NAMED]
    for name in STATED:
        text = write_scheme_file(load_problem(name), folder / "sound.toml").read_text(encoding="utf-8")
        if len(text) < 10_000:
            texts.append(text)
    for text in texts:
        read(folder, text)
    return texts


def cases(sound, count):
    for seed in range(count):
        rng = random.Random(seed)
        text = rng.choice(sound)
        kinds = [KINDS[seed % len(KINDS)], *rng.choices(KINDS, k=rng.choice([0, 0, 1, 2]))]
        for kind in kinds:
            text = broken(text, rng, kind)
        data = text.encode("utf-8")
        if rng.random() < 0.05:
            place = rng.randrange(len(data) + 1)
            data = data[:place] + bytes([rng.randrange(256)]) + data[place:]
        yield seed, kinds, data


def refusal(path):
    """The message by which a file is refused, or None if it is read; what else is raised is for the test to fail by."""
    try:
        read_scheme_file(path)
    except (InputError, UnsupportedError) as error:
        return str(error)
    return None


def test_a_thousand_broken_files(sound, folder):
    """Each is read, or refused by one sentence; no other exception, and never a warning."""
    refused = dict.fromkeys(KINDS, 0)
    for seed, kinds, data in cases(sound, 1000):
        message = refusal(written(folder, data, "case.toml"))
        if message is not None:
            refused[kinds[0]] += 1
            assert "case.toml" in message, seed
            assert "\n" not in message, seed
            assert len(message) < 3000, seed
    # The breaking breaks, each way of it, and not always.
    assert all(count >= 10 for count in refused.values()), refused
    assert 500 <= sum(refused.values()) <= 990


# ---- the command line -----------------------------------------------------------------------------------------------


def call(capsys, *arguments):
    with pytest.raises(SystemExit) as stop:
        main([str(each) for each in arguments])
    captured = capsys.readouterr()
    return stop.value.code, captured.out, captured.err


def refused(capsys, *arguments):
    code, out, error = call(capsys, *arguments)
    assert code == 2, error
    assert out == ""
    assert len(error.strip().splitlines()) == 1
    assert error.startswith("lcpimpact: ")
    return error


def test_broken_files_on_the_command_line(sound, folder, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    tried = 0
    for seed, _, data in cases(sound, 1000):
        path = written(folder, data, "case.toml")
        if refusal(path) is not None:
            command = ["simulate", "draw", "export", "animate"][tried % 4]
            out = {"simulate": ["--out", "a.csv"], "export": ["--out", "a.toml"], "animate": ["--out", "a.gif"]}
            assert "case.toml" in refused(capsys, command, path, *out.get(command, [])), seed
            tried += 1
        if tried == 40:
            break
    assert tried == 40
    assert list(tmp_path.iterdir()) == []


def test_simulate_takes_a_file_and_the_command_line_wins(capsys, tmp_path):
    path = written(tmp_path, NAMED)
    code, said, _ = call(capsys, "simulate", path)
    assert code == 0
    assert "system-1 by moreau-jean: solved\n  options     theta=1" in said
    assert "t = 0 ... 1 s in 100 steps" in said
    _, said, _ = call(
        capsys, "simulate", path, "--set", "theta=0.75", "--set", "m=50", "--dt", "1e-3", "--t-end", "0.5"
    )
    assert "options     theta=0.75" in said
    assert "t = 0 ... 0.5 s in 500 steps" in said
    changed = read_scheme_file(path).with_parameters(m=50.0).simulate(theta=0.75, dt=1e-3, t_end=0.5)
    assert f"at the end {changed['x'][-1]:.6g} m" in said
    _, said, _ = call(capsys, "simulate", path, "--method", "exact")
    assert "system-1 by exact: solved" in said
    assert "t = 0 ... 1 s in 100 steps" in said
    _, said, _ = call(capsys, "simulate", path, "--solver", "lemke")
    assert "theta=1, " in said.replace("theta=1.0", "theta=1")
    assert "lcp_solver=lemke" in said


def test_constants_of_a_scheme_file_are_set_by_their_addresses(capsys, tmp_path):
    path = written(tmp_path, SPRING)
    assert call(capsys, "simulate", path, "--set", "theta=1", "--dt", "0.1")[0] == 0
    out = tmp_path / "changed.toml"
    assert call(capsys, "export", path, "--set", "k=3", "--set", "v0.x=0.5", "--out", out)[0] == 0
    changed = read_scheme_file(out).problem
    expected = with_values(read_scheme_file(path).problem, {"Spring.k": 3.0, "v0.x": 0.5})
    assert (changed.scheme, changed.v0) == (expected.scheme, expected.v0)
    error = refused(capsys, "simulate", path, "--set", "thetta=3")
    assert "unknown option of moreau-jean 'thetta': did you mean 'theta'?" in error
    assert "did you mean '1.k'" in refused(capsys, "simulate", path, "--set", "1.kk=3")
    assert "must be" in refused(capsys, "simulate", path, "--set", "Spring.k=stiff")
    assert "did you mean 'c_o'" in refused(capsys, "simulate", written(tmp_path, NAMED), "--set", "co=3")


def test_export_writes_what_is_asked(capsys, tmp_path):
    out = tmp_path / "my.toml"
    code, said, _ = call(
        capsys, "export", "system-3", "--set", "c=60", "--set", "theta=1", "--dt", "0.01", "--out", out
    )
    assert (code, said.strip()) == (0, f"wrote {out}")
    file = read_scheme_file(out)
    assert file.problem == load_problem("system-3", c=60.0)
    assert file.run == Run(dt=0.01, options={"theta": 1})
    again = tmp_path / "again.toml"
    assert call(capsys, "export", out, "--out", again)[0] == 0
    assert again.read_bytes() == out.read_bytes()
    assert ".toml" in refused(capsys, "export", "system-3", "--out", tmp_path / "my.json")


def test_draw_draws_a_name_and_a_file(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert call(capsys, "draw", "system-1")[:2] == (0, "drew system-1.svg\n")
    call(capsys, "export", "system-1", "--out", "my.toml")
    assert call(capsys, "draw", "my.toml")[:2] == (0, "drew my.svg\n")
    assert (tmp_path / "my.svg").read_bytes() == (tmp_path / "system-1.svg").read_bytes()
    assert call(capsys, "draw", "my.toml", "--out", "my.png")[0] == 0
    assert (tmp_path / "my.png").read_bytes().startswith(b"\x89PNG")
    assert "must end in" in refused(capsys, "draw", "my.toml", "--out", "my.xls")


def test_animate_runs_and_draws(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    written(tmp_path, NAMED)
    code, said, _ = call(capsys, "animate", "my.toml", "--out", "my.gif", "--seconds", "0.2", "--fps", "10")
    assert code == 0
    assert "by moreau-jean: solved\n  options     theta=1" in said
    assert (tmp_path / "my.gif").read_bytes().startswith(b"GIF")
    assert "must end in" in refused(capsys, "animate", "my.toml", "--out", "my.png")
    assert "seconds = -1" in refused(capsys, "animate", "my.toml", "--out", "a.gif", "--seconds", "-1")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["my.gif", "my.toml"]


def test_simulate_shows_the_closed_forms(capsys):
    code, said, _ = call(capsys, "simulate", "bouncing-ball", "--method", "exact", "--t-end", "1")
    assert code == 0
    problem = load_problem("bouncing-ball")
    table = said.split("closed form")[1].splitlines()
    assert len(table) == 1 + len(problem.facts)
    for fact, line in zip(problem.facts, table[1:], strict=True):
        assert line.split()[0] == fact.symbol
        assert f"{fact.value:.8g}" in line
        assert fact.what in line
    # One impact within a second; what comes later is not measured.
    assert "0.45152364 s" in table[1]
    assert float(table[1].split()[4]) < 1e-12
    assert table[-1].split()[3:5] == ["-", "-"]


# ---- the page about it ----------------------------------------------------------------------------------------------


SHOWN = [
    (page.name, text)
    for page in (DOCS / "guide" / "scheme-files.md",)
    for text in re.findall(r"```toml\n(.*?)```", page.read_text("utf-8"), re.DOTALL)
]


def test_the_page_shows_files():
    assert [name for name, _ in SHOWN] == ["scheme-files.md"] * 3


@pytest.mark.parametrize(("page", "text"), SHOWN)
def test_what_the_pages_show_can_be_run(page, text, tmp_path):
    assert read(tmp_path, text).simulate(dt=1e-2, t_end=0.1).success


def test_the_page_shows_every_signal(folder):
    lines = re.findall(r"^    (f = \{.*)$", (DOCS / "guide" / "scheme-files.md").read_text("utf-8"), re.MULTILINE)
    shown = {type(read(folder, LOAD + line).problem.scheme.elements[1].f).__name__ for line in lines}
    assert shown == set(SIGNALS)


def test_the_page_names_every_key():
    page = (DOCS / "guide" / "scheme-files.md").read_text("utf-8")
    keys = {key for keys in KEYS.values() for key in keys} | {each.name for each in dataclasses.fields(Run)}
    for key in keys:
        assert re.search(rf"`[^`]*\b{key}\b[^`]*`", page), key


def test_a_scheme_in_full_matrices_is_read_as_such(tmp_path):
    """Above 1,000 nodes, where other schemes are read in sparse ones; and so is its run by a method that takes no others."""
    many = [each for i in range(1001) for each in (li.Mass(f"n{i}", 1.0), li.Spring(f"n{i}", "ground", 1.0))]
    problem = li.Problem("many", li.Scheme(*many, format="full"))
    li.write_scheme_file(problem, tmp_path / "many.toml")
    text = (tmp_path / "many.toml").read_text(encoding="utf-8")
    assert li.read_scheme_file(tmp_path / "many.toml").problem.scheme.format == "full"
    (tmp_path / "auto.toml").write_text(text.replace('format = "full"\n', ""), encoding="utf-8")
    assert li.read_scheme_file(tmp_path / "auto.toml").problem.scheme.format == "auto"
    (tmp_path / "other.toml").write_text(text.replace('"full"', '"dense"'), encoding="utf-8")
    with pytest.raises(li.InputError, match="format of matrices"):
        li.read_scheme_file(tmp_path / "other.toml")


def test_a_number_with_a_comma_is_told_of_the_point(tmp_path):
    with pytest.raises(InputError, match=r"line 4: a number has a comma: write it with a point"):
        read(tmp_path, '[[elements]]\ntype = "Mass"\nnode = "x"\nm = 1,0\n')


def test_an_error_of_the_whole_scheme_has_the_place_of_its_element(folder):
    text = (
        '[[elements]]\ntype = "Mass"\nnode = "x"\nm = 1.0\n'
        '[[elements]]\ntype = "Bumper"\nupper = "x"\nlower = "ground"\n'
    )
    with pytest.raises(InputError, match=r"elements\[1\] \(line 5\): Bumper between 'x' and 'ground': both sides have"):
        read(folder, text)
