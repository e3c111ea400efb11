"""The files of truths have the form that their schema states, say what the registry says, and are enough to be solved."""

import json
import re
from itertools import product
from pathlib import Path

import digits
import numpy as np
import pandas as pd
import pytest
from scipy.integrate import solve_ivp

import lcpimpact as li
from lcpimpact.cli.main import main
from lcpimpact.problems import PROBLEMS
from lcpimpact.truth.document import SCHEMA, decimals

PAGE = Path(__file__).parents[2] / "docs" / "howto" / "your-code.md"

FILED = [
    name
    for name in PROBLEMS
    if li.load_problem(name).facts and not isinstance(li.load_problem(name).scheme, li.Lagrangian)
]
"""Problems with facts that have matrices."""

BARS = ("bar-impact", "bouncing-bar", "plastic-bar-impact")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("truths")
    li.write_truths(folder)
    return folder


def read(folder, name):
    return json.loads((folder / f"{name}.json").read_text(encoding="utf-8"))


# ---- the form -------------------------------------------------------------------------------------------------------

TYPES = {
    "object": dict, "array": list, "string": str, "integer": int, "number": (int, float), "null": type(None),
}  # fmt: skip


def faults(value, schema, root, place="$"):
    """Yield what a value has against a schema of draft 2020-12, of the keywords that ours uses."""
    unknown = schema.keys() - {
        "$schema", "$ref", "$defs", "title", "description", "type", "enum", "const", "pattern", "required", "properties",
        "additionalProperties", "items", "minItems", "oneOf", "minimum", "maximum", "exclusiveMinimum",
    }  # fmt: skip
    assert not unknown, f"the test does not know {unknown}"
    if "$ref" in schema:
        yield from faults(value, root["$defs"][schema["$ref"].removeprefix("#/$defs/")], root, place)
    kinds = np.atleast_1d(schema.get("type", [])).tolist()
    if kinds and not any(isinstance(value, TYPES[kind]) and not isinstance(value, bool) for kind in kinds):
        yield f"{place} is no {kinds}"
        return
    if "enum" in schema and value not in schema["enum"]:
        yield f"{place} = {value!r} is none of {schema['enum']}"
    if "const" in schema and value != schema["const"]:
        yield f"{place} = {value!r} is not {schema['const']!r}"
    if "pattern" in schema and not re.search(schema["pattern"], value):
        yield f"{place} = {value!r} has not the form {schema['pattern']}"
    if "oneOf" in schema and sum(not list(faults(value, each, root, place)) for each in schema["oneOf"]) != 1:
        yield f"{place} is not one of the alternatives"
    if isinstance(value, dict):
        known = schema.get("properties", {})
        yield from (f"{place} has no {name}" for name in schema.get("required", []) if name not in value)
        for name, each in value.items():
            others = schema.get("additionalProperties", {})
            if name in known or others is not False:
                yield from faults(each, known.get(name, others or {}), root, f"{place}.{name}")
            else:
                yield f"{place}.{name} is not known"
    elif isinstance(value, list):
        if len(value) < schema.get("minItems", 0):
            yield f"{place} is too short"
        for i, each in enumerate(value):
            yield from faults(each, schema.get("items", {}), root, f"{place}[{i}]")
    elif isinstance(value, int | float):
        if value < schema.get("minimum", value) or value > schema.get("maximum", value):
            yield f"{place} = {value} is out of range"
        if value <= schema.get("exclusiveMinimum", value - 1.0):
            yield f"{place} = {value} is out of range"


def test_a_lagrangian_system_is_refused():
    with pytest.raises(li.InputError, match="rod-on-pin is a Lagrangian system, given by functions"):
        li.truths(["rod-on-pin"])


def test_every_problem_with_facts_has_a_file_of_the_stated_form(folder):
    schema = json.loads((folder / SCHEMA).read_text(encoding="utf-8"))
    assert schema["$schema"] == "https://json-schema.org/draft/2020-12/schema"
    files = {path.stem for path in folder.glob("*.json")} - {"schema"}
    assert files == set(FILED)
    assert len(files) == 57
    for name in sorted(files):
        assert list(faults(read(folder, name), schema, schema)) == []


def test_the_schema_refuses_what_it_should(folder):
    schema = json.loads((folder / SCHEMA).read_text(encoding="utf-8"))
    for change in (
        {"M": [["one"]]}, {"form": "third order"}, {"facts": []}, {"t_end": 0.0}, {"more": 1}, {"rows": [{"name": "R"}]},
    ):  # fmt: skip
        assert list(faults(read(folder, "bouncing-ball") | change, schema, schema)), change
    without = {key: value for key, value in read(folder, "bouncing-ball").items() if key != "M"}
    assert list(faults(without, schema, schema))


def test_two_writings_have_the_same_bytes(folder, tmp_path):
    assert [path.name for path in li.write_truths(tmp_path / "new")][-1] == SCHEMA
    for path in (tmp_path / "new").iterdir():
        assert path.read_bytes() == (folder / path.name).read_bytes()


# ---- what it says ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", FILED)
def test_a_file_says_what_the_registry_says(folder, name):
    truth, problem = read(folder, name), li.load_problem(name)
    d = problem.dynamics
    n = len(truth["coordinates"])
    nodes = [each["name"] for each in truth["coordinates"]]
    assert nodes == list(d.nodes[:n])
    assert [each["unit"] for each in truth["coordinates"]] == [problem.unit(node) for node in nodes]
    if truth["form"] == "second order":
        for key in ("M", "C", "K", "H"):
            assert np.array_equal(np.reshape(truth[key], getattr(d, key).shape), getattr(d, key))
        assert truth["u0"] == d.u0.tolist()
        forces = np.zeros(n)
        for force in truth["forces"]:
            forces[nodes.index(force["coordinate"])] += signal_value(force, 0.3, 0.0)
        assert forces == pytest.approx(d.applied(0.3, np.zeros(n), np.zeros(n)), rel=1e-15)
        assert truth["initial"]["v"] == problem.initial_velocities.tolist()
    else:
        for key in "ABCD":
            assert np.array_equal(truth[key], getattr(problem.scheme, key))
    assert truth["initial"]["q"] == problem.initial_coordinates[:n].tolist()
    assert [each["restitution"] for each in truth["rows"]] == d.restitution.tolist()
    for each, low, high in zip(truth["rows"], d.r_min, d.r_max, strict=True):
        assert (each["lower"] is None) == np.isinf(low)
        assert each["upper"] == (None if np.isinf(high) else high)
    assert truth["t_end"] == problem.t_end
    for each, fact in zip(truth["facts"], problem.facts, strict=True):
        assert (each["name"], each["unit"], each["accuracy"]) == (fact.symbol, fact.unit, fact.accuracy)
        assert float(each["value"]) == pytest.approx(fact.value, rel=10.0 ** (1 - fact.digits), abs=1e-300)
        digits = each["value"].lstrip("-").partition("e")[0].replace(".", "").lstrip("0")
        assert len(digits) == each["digits"] or fact.value == 0.0
        assert each["measured"]
        assert "  " not in each["measured"]
        assert "None" not in each["measured"]
    if truth["motion"] is not None:
        q, v = problem.motion(np.array(truth["motion"]["t"]))
        assert np.array_equal(truth["motion"]["q"], q[:, :n])
        assert np.array_equal(truth["motion"]["v"], v[:, :n])


def test_thirty_digits_are_those_of_mpmath_and_the_values_those_of_the_registry():
    """The registry computes in doubles, by other code: both agree to rounding, of R_max to the digits that it states."""
    found = {(name, symbol): value for name, symbol, value in digits.decimals()}
    assert found == decimals()
    assert len(found) >= 80
    known = {(name, fact.symbol): fact for name in FILED for fact in li.load_problem(name).facts}
    for key, value in found.items():
        rel = max(1e-14, 10.0 ** (1 - known[key].digits))
        assert float(value) == pytest.approx(known[key].value, rel=rel), key
    assert li.truths(["bouncing-ball"], g=9.8)["bouncing-ball"]["facts"][0]["digits"] == 14


def test_the_words_say_how_a_fact_is_measured(folder):
    words = {each["name"]: each["measured"] for each in read(folder, "bouncing-ball")["facts"]}
    assert words["t_3"] == "instant of event 3 of kind impact"
    assert words["v_1"] == "v_x just before event 1 of kind impact"
    words = {each["name"]: each["measured"] for each in read(folder, "system-1")["facts"]}
    assert words["R_max"] == "greatest value of R"
    assert words["x(3)"] == "x at t = 3 s"
    (relay,) = (each for each in read(folder, "relay-oscillator")["facts"] if each["name"] == "t_1")
    assert relay["measured"] == "instant at which x crosses 0 downwards, number 1"
    assert relay["reading"] == {"by": "crossing", "series": "x", "level": 0.0, "direction": -1.0, "number": 1}


def test_parameters_change_the_file_of_one_problem():
    truth = li.truths(["bouncing-ball"], e=0.5)["bouncing-ball"]
    assert truth["rows"][0]["restitution"] == truth["parameters"]["e"]["value"] == 0.5
    with pytest.raises(li.InputError, match="those of one problem"):
        li.truths(["bouncing-ball", "system-1"], g=9.8)
    with pytest.raises(li.InputError, match="did you mean 'bouncing-ball'"):
        li.truths(["bouncing-bal"])


# ---- enough to be solved --------------------------------------------------------------------------------------------


def signal_value(signal, t, v):
    """Return a signal of a file at t, or a formula at the rate v."""
    kind = signal["signal"]
    if kind == "Harmonic":
        return signal["amplitude"] * np.cos(signal["omega"] * t + signal["phase"])
    if kind == "Polynomial":
        return np.polynomial.polynomial.polyval(t, signal["coefficients"])
    if kind == "Table":
        times, values = signal["times"], signal["values"]
        k = min(max(int(np.searchsorted(times, t, side="right")), 1), len(times) - 1)
        return values[k - 1] + (values[k] - values[k - 1]) * (t - times[k - 1]) / (times[k] - times[k - 1])
    if kind == "Formula":
        assert signal["formula"] == "-c v |v|"
        return -signal["constants"]["c"] * v * abs(v)
    return signal["value"]


def page_solver():
    """Return the functions of the page "your code here", which know NumPy and nothing of this package."""
    cells = re.findall(r"```\{code-cell\} python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    (cell,) = (each for each in cells if "def solve" in each)
    assert "li." not in cell
    said = re.search(r"A solver in (\d+) lines", PAGE.read_text(encoding="utf-8"))
    assert int(said[1]) == len([line for line in cell.splitlines() if line.strip()])
    (writer,) = (each for each in cells if "def header" in each)
    names = {}
    exec(compile(cell + writer.partition("with open")[0], str(PAGE), "exec"), names)
    return names["solve"], names["header"]


def scored(name, rows, header, **limits):
    """Return the score of rows, after a check that every fact is told within its limit."""
    found = li.score(pd.DataFrame(rows, columns=header), name)
    told = found.facts.set_index("quantity")
    assert list(told.index[told["failure"] != ""]) == []
    for symbol, row in told.iterrows():
        assert row["relative"] <= limits.get(symbol, limits["others"]), (name, symbol, row["relative"])
    return found


SECOND_ORDER = [
    name
    for name, each in {name: li.load_problem(name) for name in FILED if name not in BARS}.items()
    if each.dynamics.stores_energy and not each.dynamics.springs and not each.dynamics.force_laws
]


@pytest.mark.parametrize("name", [each for each in SECOND_ORDER if each not in ("stick-slip-belt", "inertia-drive")])
def test_a_foreign_solver_meets_the_facts_of_second_order(folder, name):
    solve, header = page_solver()
    truth = read(folder, name)
    # Of order 1: most of it is due to the instants of impacts; the error of a model comes with its accuracy.
    limits = {"hereditary-impact": 0.02, "woodpecker": 0.03, "two-balls-spring": 0.05, "system-1": 0.04}
    scored(name, solve(truth, 4000), header(truth), others=limits.get(name, 0.025))


def test_the_file_of_a_bar_is_enough_too(folder):
    solve, header = page_solver()
    truth = read(folder, "bar-impact")
    found = scored("bar-impact", solve(truth, 1500), header(truth), others=0.08)
    assert "no reference is computed" in found.against


@pytest.mark.parametrize("name", ["hertz-impact", "hunt-crossley-impact", "ball-in-air"])
def test_scipy_meets_the_facts_of_springs_and_drag(folder, name):
    truth = read(folder, name)
    (m,), (start,), (speed,) = truth["M"][0], truth["initial"]["q"], truth["initial"]["v"]

    def rate(t, x):
        f = sum(signal_value(each, t, x[1]) for each in truth["forces"])
        for each in truth["springs"]:
            a, rate = (-each["direction"][0] * x[k] - (k == 0) * each["gap"] for k in (0, 1))
            f += each["direction"][0] * (max(a, 0.0) ** each["n"] * each["K"] * (1.0 + each["b"] * rate)) * (a > 0.0)
        return [x[1], f / m]

    def gap(t, x):
        return truth["H"][0][0] * x[0] + truth["u0"][0] if truth["rows"] else 1.0

    gap.terminal, gap.direction = True, -1.0
    t, x, rows = 0.0, [start, speed], []
    while t < truth["t_end"]:
        run = solve_ivp(
            rate, (t, truth["t_end"]), x, events=gap, rtol=1e-10, atol=1e-14, max_step=truth["t_end"] / 2000
        )
        rows += [[each, *state] for each, state in zip(run.t[:-1], run.y.T[:-1], strict=True)]
        t, x = run.t[-1], run.y[:, -1]
        if t < truth["t_end"]:
            x = np.array([x[0], -truth["rows"][0]["restitution"] * x[1]])
            t = np.nextafter(t, np.inf)
    rows.append([t, *x])
    scored(name, rows, ["t", "x", "v_x"], others=1e-5)


def first_order(truth, steps):
    """Yield t, x, x' and λ of Euler's implicit step; the law is solved by trying the bounds of every row."""
    A, B, C, D = (np.array(truth[key]) for key in "ABCD")
    low = np.array([-np.inf if each["lower"] is None else each["lower"] for each in truth["rows"]])
    high = np.array([np.inf if each["upper"] is None else each["upper"] for each in truth["rows"]])
    x, h = np.array(truth["initial"]["q"]), truth["t_end"] / steps
    E = np.linalg.inv(np.eye(len(x)) - h * A)
    W = D + h * C @ E @ B
    found = [[0.0, *x]]
    for k in range(1, steps + 1):
        a, c = ([signal_value(each, k * h, 0.0) for each in truth[key]] for key in "ac")
        q = C @ E @ (x + h * np.array(a)) + c
        for modes in product((0, -1, 1), repeat=len(q)):
            inside = np.array([mode == 0 for mode in modes])
            λ = np.where(np.array(modes) < 0, low, high)
            if not np.isfinite(λ[~inside]).all():
                continue
            λ[inside] = 0.0
            block = W[np.ix_(inside, inside)]
            if inside.any() and np.linalg.matrix_rank(block) < inside.sum():
                continue
            λ[inside] = np.linalg.solve(block, -(q + W @ λ)[inside])
            y = q + W @ λ
            if (
                (λ >= low - 1e-9).all() and (λ <= high + 1e-9).all()
                and all(mode == 0 or mode * each <= 1e-9 for mode, each in zip(modes, y, strict=True))
            ):  # fmt: skip
                break
        else:
            raise AssertionError("no mode obeys the law")
        new = E @ (x + h * (B @ λ + a))
        found.append([k * h, *new, *((new - x) / h), *λ])
        x = new
    found[0] += found[1][1 + len(x) :]
    return found


@pytest.mark.parametrize("name", [each for each in PROBLEMS if not li.load_problem(each).dynamics.stores_energy])
def test_a_foreign_solver_meets_the_facts_of_first_order(folder, name):
    truth = read(folder, name)
    names = [each["name"] for each in truth["coordinates"]]
    header = ["t", *names, *(f"v_{each}" for each in names), *(each["name"] for each in truth["rows"])]
    scored(name, first_order(truth, 4000), header, others=0.025)


# ---- the command ----------------------------------------------------------------------------------------------------


def call(capsys, *arguments):
    with pytest.raises(SystemExit) as stop:
        main([str(each) for each in arguments])
    captured = capsys.readouterr()
    return stop.value.code, captured.out, captured.err


def test_the_command_writes_the_folder(capsys, tmp_path, folder):
    out = tmp_path / "a" / "truths"
    code, said, _ = call(capsys, "truths", "bouncing-ball", "--out", out)
    assert (code, said) == (0, f"wrote 1 problems and schema.json to {out}\n")
    assert sorted(each.name for each in out.iterdir()) == ["bouncing-ball.json", SCHEMA]
    assert (out / "bouncing-ball.json").read_bytes() == (folder / "bouncing-ball.json").read_bytes()
    assert call(capsys, "truths", "bouncing-ball", "--out", out, "--set", "e=0.5")[0] == 0
    assert (out / "bouncing-ball.json").read_bytes() != (folder / "bouncing-ball.json").read_bytes()


def test_the_command_writes_nothing_where_it_cannot(capsys, tmp_path):
    taken = tmp_path / "taken"
    taken.write_text("a file")
    code, _, error = call(capsys, "truths", "--out", taken)
    assert code == 2
    assert "cannot make the folder" in error
    out = tmp_path / "half"
    (out / "system-1.json").mkdir(parents=True)
    code, _, error = call(capsys, "truths", "--out", out)
    assert code == 2
    assert "a folder has that name" in error
    assert [each.name for each in out.iterdir()] == ["system-1.json"]
    code, _, error = call(capsys, "truths", "sistem-1", "--out", tmp_path / "none")
    assert code == 2
    assert "did you mean 'system-1'" in error
    assert not (tmp_path / "none").exists()
    assert call(capsys, "truths", "bouncing-ball", "--out", tmp_path / "none", "--set", "e=high")[0] == 2
