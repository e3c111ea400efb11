"""Scheme files that are given to the page, in node: runs with the bits of `simulate`, and refusals in Python's words."""

from __future__ import annotations

import json
import shutil
import subprocess
from contextlib import suppress
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest
from test_kernel import numbers

import lcpimpact as li
from lcpimpact.explorer.own_schemes import source
from lcpimpact.schemefile import read_scheme_file, write_scheme_file

pytestmark = pytest.mark.skipif(
    shutil.which("node") is None, reason="node, which runs the page's code, is not installed"
)

NODE = """
const hex = (a) => Buffer.from(new Float64Array(a).buffer).toString("hex");
console.log(JSON.stringify(given.map(({text, steps, changes}) => {
  let problem;
  try { problem = ownProblem(text, "my"); } catch (error) {
    return error.unsupported ? {unsupported: error.message} : error.inWords ? {error: error.message} : {defect: error.stack};
  }
  const values = {theta: 0.5, ...problem.numbers, ...changes};
  const runs = Object.keys(problem.methods).map((method) => {
    const o = simulate(problem, method, values, problem.tEnd, steps);
    return {method, taken: o.taken, q: hex(o.q), v: hex(o.v), r: hex(o.r)};
  });
  const refusal = problem.refusal(problem.names.map((each) => values[each]), problem.tEnd);
  return {runs, numbers: problem.numbers, tEnd: problem.tEnd, refusal, drawing: problem.drawing};
})));
"""


def in_node(jobs: list[dict]) -> list[dict]:
    """Return what the page makes of scheme files."""
    engine = (files("lcpimpact.explorer") / "engine.js").read_text(encoding="utf-8")
    given = json.dumps(json.dumps(jobs).replace("Infinity", "1e999"))
    script = f'"use strict";\nconst LIMITS = {{most: 10000}};\n{engine}\nconst ownProblem = ({source()})();\n'
    script += f"const given = JSON.parse({given});\n{NODE}"
    done = subprocess.run(["node", "-"], input=script, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr[-3000:]
    found = json.loads(done.stdout)
    defects = [each["defect"] for each in found if "defect" in each]
    assert not defects, defects[0]
    return found


def a_scheme(rng: np.random.Generator) -> li.Problem:
    """Return a random scheme of the elements that the page takes: bodies in a column, with what joins them."""
    count, elements, v0 = int(rng.integers(1, 4)), [], {}
    q0 = {}
    nodes = [f"x{i}" for i in range(count)]
    number = lambda: float(np.round(10.0 ** rng.uniform(-1.0, 2.5), int(rng.integers(1, 6))) or 0.5)  # noqa: E731
    for i, node in enumerate(nodes):
        elements.append(li.Mass(node, m=number()))
        below = nodes[i + 1] if i + 1 < count else "ground"
        elements.append(a_link(rng, node, below, number, i))
        if rng.random() < 0.5:
            v0[node] = float(rng.normal())
        if rng.random() < 0.5:
            q0[node] = -float(rng.random())
        if rng.random() < 0.4:
            wave = li.Harmonic(number(), number(), float(rng.normal()))
            elements.append(li.Load(node, f=wave if rng.random() < 0.5 else float(rng.normal() * 20.0)))
    for i in range(int(rng.integers(0, 3))):
        node = nodes[int(rng.integers(count))]
        kind = rng.random()
        if kind < 0.5:
            elements.append(li.Bumper(node, "ground", gap=float(rng.random()), e=float(rng.random())))
        elif kind < 0.75:
            elements += [li.Bumper(node, f"z{i}"), li.KelvinVoigt(f"z{i}", "ground", k=number(), c=number())]
        elif kind < 0.9:
            elements.append(li.Rope(node, "ground", slack=float(rng.random()), e=float(rng.random())))
        else:
            elements.append(li.Slider(node, "ground", r0=number()))
    if rng.random() < 0.25:
        elements += [li.KelvinVoigt("x0", "shaker", k=number(), c=number())]
        if rng.random() < 0.6:
            elements.append(li.Bumper("x0", "shaker", gap=1.2, e=float(rng.random())))
        elements += [li.PrescribedMotion("shaker", li.Harmonic(float(rng.random()), number(), float(rng.normal())))]
    return li.Problem("mine", li.Scheme(*elements), q0, v0, t_end=2.0)


def a_link(rng, a, b, number, i):
    kinds = [
        lambda: li.Spring(a, b, k=number()),
        lambda: li.Dashpot(a, b, c=number()),
        lambda: li.KelvinVoigt(a, b, k=number(), c=number()),
        lambda: li.Maxwell(a, b, k=number(), c=number(), name=f"m{i}"),
        lambda: li.Zener(a, b, k=number(), k_1=number(), c_1=number()),
        lambda: li.GeneralizedMaxwell(a, b, k_inf=number(), k=(number(), number()), tau=(number(), number())),
        lambda: li.Jenkins(a, b, k=number(), f_y=number(), name=f"F{i}"),
    ]
    return kinds[int(rng.choice(len(kinds), p=[0.2, 0.1, 0.3, 0.1, 0.1, 0.1, 0.1]))]()


def random_files(folder: Path) -> list[Path]:
    """Write 48 random schemes to files 0.toml, 1.toml, ... of a folder."""
    rng, paths = np.random.default_rng(3), []
    while len(paths) < 48:
        with suppress(li.InputError):
            paths.append(write_scheme_file(a_scheme(rng), folder / f"{len(paths)}.toml"))
    return paths


def test_runs_of_random_files_have_the_bits_of_simulate(tmp_path):
    texts = [path.read_text(encoding="utf-8") for path in random_files(tmp_path)]
    for name in ("vibrating-table", "impact-pair", "bouncing-ball", "maxwell-impact"):
        path = write_scheme_file(li.load_problem(name), tmp_path / f"{len(texts)}.toml")
        texts.append(path.read_text(encoding="utf-8"))
    equal = ended = taken = shaken = 0
    for i, (text, page) in enumerate(zip(texts, in_node([{"text": t, "steps": 200} for t in texts]), strict=True)):
        problem = read_scheme_file(tmp_path / f"{i}.toml").problem
        assert "error" not in page, page
        for run in page.get("runs", ()):
            ours = li.simulate(
                problem, run["method"], dt=problem.t_end / 200, t_end=problem.t_end, throw=False, progress=False
            )
            kept = min(run["taken"] + 1, len(ours.t))
            ended += run["taken"] < 200
            taken += 1
            shaken += "PrescribedMotion" in text
            for name, theirs in (("q", ours.q), ("v", ours.v)):
                found = numbers(run[name], theirs.shape[1])[:kept]
                assert np.array_equal(found, theirs[:kept], equal_nan=True), f"{name} by {run['method']} of\n{text}"
                equal += found.size
    assert taken > 60
    assert shaken > 5
    assert ended < 0.12 * taken
    assert equal > 50_000


HEAD = '[[elements]]\ntype = "Mass"\nnode = "x"\nm = 2.0\n'
SPRING = '[[elements]]\ntype = "Spring"\na = "x"\nb = "ground"\nk = 3.0\n'


def element(**keys: object) -> str:
    return "[[elements]]\n" + "".join(f"{key} = {value}\n" for key, value in keys.items())


WRONG = [
    "",
    "name = 1",
    "nam = 'x'\n" + HEAD,
    "q = 1.0\n" + HEAD,
    "dt = 1.0\n" + HEAD,
    HEAD + "[system]\nA = [[0.0]]\n",
    HEAD.replace("Mass", "Mas"),
    HEAD.replace("Mass", "Quartz"),
    HEAD.replace('type = "Mass"\n', ""),
    HEAD.replace('"Mass"', "3"),
    HEAD.replace("m = 2.0", "m = -2.0"),
    HEAD.replace("m = 2.0", "m = -2"),
    HEAD.replace("m = 2.0", "m = 0"),
    HEAD.replace("m = 2.0", "m = nan"),
    HEAD.replace("m = 2.0", "m = inf"),
    HEAD.replace("m = 2.0", 'm = "2"'),
    HEAD.replace("m = 2.0", "m = true"),
    HEAD.replace("m = 2.0", "m = [2.0]"),
    HEAD.replace("m = 2.0", "m = 2.0\nn = 1"),
    HEAD.replace("m = 2.0\n", ""),
    HEAD.replace("m = 2.0", "mm = 2.0"),
    HEAD.replace('node = "x"\n', ""),
    HEAD.replace('"x"', '"ground"'),
    HEAD.replace('"x"', '""'),
    HEAD.replace('"x"', '"a\\u0007b"'),
    HEAD + SPRING.replace('"ground"', '"x"'),
    HEAD + SPRING.replace("k = 3.0", "k = -1e-7"),
    HEAD + SPRING.replace("k = 3.0", "k = -123456789012345678.0"),
    HEAD + SPRING + "[initial.y]\nq = 1.0\n",
    HEAD + SPRING + "[initial.x]\nw = 1.0\n",
    HEAD + SPRING + "[initial.x]\nv = 'fast'\n",
    HEAD + SPRING + "[initial.x]\nv = inf\n",
    HEAD + SPRING + "[initial]\nx = 1.0\n",
    HEAD + SPRING + "initial = 3\n",
    HEAD + SPRING + "[units]\ny = 'rad'\n",
    HEAD + SPRING + "[units]\nx = 3\n",
    HEAD + SPRING + "units = 3\n",
    "t_end = -1.0\n" + HEAD + SPRING,
    "t_end = 'soon'\n" + HEAD + SPRING,
    "t_end = 0\n" + HEAD + SPRING,
    'name = ""\n' + HEAD + SPRING,
    "elements = 3\n",
    "elements = []\n",
    HEAD + "[run]\nmethod = 'moreau-jaen'\n",
    HEAD + "[run]\nmethood = 'moreau-jean'\n",
    HEAD + "[run]\nsolver = 'lemk'\n",
    HEAD + "[run]\ndt = -1.0\n",
    HEAD + "[run]\ndt = 'x'\n",
    HEAD + "[run.options]\nthetta = 0.6\n",
    HEAD + "[run.options]\ntheta = 0.25\n",
    "[built_from]\nk = 'x'\n" + HEAD + SPRING,
    HEAD + element(type="'Bumper'", upper="'x'", lower="'ground'"),
    HEAD + element(type="'Bumper'", upper="'x'", lower="'ground'", e="1.5"),
    HEAD + element(type="'Bumper'", upper="'x'", lower="'ground'", e="0.5", gap="-0.25"),
    HEAD + element(type="'Bumper'", upper="'x'", lower="'ground'", e="0.5", gap="nan"),
    HEAD + element(type="'Bumper'", upper="'x'", lower="'z'"),
    HEAD + element(type="'Bumper'", upper="'x'", lower="'z'", e="0.5") + SPRING.replace('"x"', '"z"'),
    HEAD + 2 * element(type="'Bumper'", upper="'x'", lower="'ground'", e="0.5"),
    HEAD + element(type="'Bumper'", upper="{ x = 0.0 }", lower="'ground'", e="0.5"),
    HEAD + element(type="'Bumper'", upper="'x'", lower="{ z = 2.0 }") + SPRING.replace('"x"', '"z"'),
    HEAD + element(type="'Rope'", a="'x'", b="'ground'", e="0.5"),
    HEAD + element(type="'Slider'", a="'x'", b="'ground'", r0="0.0"),
    HEAD + element(type="'Slider'", a="'x'", b="'ground'", r0="1.0", name="'x'"),
    HEAD + element(type="'Slider'", a="'x'", b="'z'", r0="1.0"),
    HEAD + element(type="'Load'", node="'x'"),
    HEAD + element(type="'Load'", node="'ground'", f="1.0"),
    HEAD + element(type="'Load'", node="'x'", f="inf"),
    HEAD + element(type="'Load'", node="'x'", f="{ amplitude = 1.0, omega = -2.0 }"),
    HEAD + element(type="'Load'", node="'x'", f="{ amplitude = 1.0 }"),
    HEAD + element(type="'Load'", node="'x'", f="{ amplitud = 1.0, omega = 2.0 }"),
    HEAD + element(type="'Load'", node="'x'", f="{ type = 'Harmonics', omega = 2.0 }"),
    HEAD + element(type="'Load'", node="'x'", f="'x'"),
    HEAD + element(type="'Maxwell'", a="'x'", b="'ground'", k="1.0", c="0.0"),
    HEAD + 2 * element(type="'Maxwell'", a="'x'", b="'ground'", k="1.0", c="1.0"),
    HEAD + element(type="'GeneralizedMaxwell'", a="'x'", b="'ground'", k_inf="1.0", k="[1.0]", tau="[1.0, 2.0]"),
    HEAD + element(type="'GeneralizedMaxwell'", a="'x'", b="'ground'", k_inf="-1.0", k="[1.0]", tau="[1.0]"),
    HEAD + element(type="'GeneralizedMaxwell'", a="'x'", b="'ground'", k_inf="1.0", k="[]", tau="[]"),
    HEAD + element(type="'KelvinVoigt'", a="'x'", b="'ground'", k="1.0", c="1.0", symbols="['k']"),
    element(type="'Spring'", a="'x'", b="'y'", k="1.0"),
    HEAD + element(type="'PrescribedMotion'", node="'x'", y="{ amplitude = 1.0, omega = 2.0 }"),
    HEAD + element(type="'PrescribedMotion'", node="'ground'", y="{ amplitude = 1.0, omega = 2.0 }"),
    HEAD + element(type="'PrescribedMotion'", node="'y'"),
    HEAD + element(type="'PrescribedMotion'", node="'y'", y="1.0"),
    HEAD + 2 * element(type="'PrescribedMotion'", node="'y'", y="{ amplitude = 1.0, omega = 2.0 }"),
    HEAD
    + element(type="'PrescribedMotion'", node="'y'", y="{ amplitude = 1.0, omega = 2.0 }")
    + "[initial.y]\nq = 1.0\n",
    # What is no TOML.
    HEAD + "m = 3.0\n",
    HEAD + "k 3\n",
    HEAD + "k = \n",
    HEAD + "k = 3 4\n",
    HEAD + "k = 'x\n",
    HEAD + 'k = "x\\q"\n',
    HEAD + 'k = "x\n"\n',
    HEAD + "k = [1, 2\n",
    HEAD + "k = { a = 1, a = 2 }\n",
    HEAD + "k = { a = 1\n",
    HEAD + "[[elements]\n",
    HEAD + "[x\n",
    HEAD + "[initial.x]\nq = 1.0\n[initial.x]\n",
    HEAD + "[elements]\n",
    HEAD + "= 1\n",
    HEAD + "# \x01\n",
    HEAD + "ä = 1\n",
    "initial = { x = { q = 1.0 } }\n" + HEAD + "[initial.x]\nv = 1.0\n",
    "a.b = 1\n[a]\n" + HEAD,
    "name = 012\n" + HEAD,
    "name = 1__2\n" + HEAD,
    "a" + ".a" * 60 + " = 1\n",
    'name = "' + "a" * 1001 + '"\n' + HEAD,
]


def test_what_is_wrong_in_a_file_is_said_in_the_words_of_the_command_line(tmp_path):
    path = tmp_path / "my.toml"
    for text, page in zip(WRONG, in_node([{"text": text, "steps": 5} for text in WRONG]), strict=True):
        path.write_text(text, encoding="utf-8")
        with pytest.raises(li.InputError) as error:
            read_scheme_file(path)
        assert page.get("error") == str(error.value).removeprefix(f"cannot read {str(path)!r}: "), text


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('problem = "system-1"\n', "name a file with problem = NAME in lcpimpact explore"),
        ("[system]\nA = [[0.0]]\nB = [[1.0]]\nC = [[1.0]]\n", "name a file with [system] in lcpimpact explore"),
        (HEAD + element(type="'HertzSpring'", upper="'x'", lower="'ground'", K="1.0"), "does not take a HertzSpring"),
        (HEAD + element(type="'Load'", node="'x'", f="{ type = 'Polynomial', coefficients = [1.0] }"), "takes a Polynomial"),
        (HEAD + "[run]\nmethod = 'exact'\n[run.options]\nmax_events = 3\n", "has no option max_events"),
        ("name = 2026-11-25\n" + HEAD, "reads no dates and times"),
        (HEAD + "".join(element(type="'Bumper'", upper="'x'", lower="'ground'", e="0.5", gap=f"{i}.5") for i in range(3)),
         "3 rows with a law"),
    ],
)  # fmt: skip
def test_what_the_page_does_not_take_names_the_command(text, said):
    (page,) = in_node([{"text": text, "steps": 5}])
    assert said in page["unsupported"]


def test_a_number_of_a_file_is_refused_in_the_words_of_python(tmp_path):
    path = tmp_path / "my.toml"
    path.write_text(HEAD + element(type="'KelvinVoigt'", a="'x'", b="'ground'", k="3.0", c="1.0"), encoding="utf-8")
    problem, changes = (
        read_scheme_file(path).problem,
        [{"Mass.m": -1.0}, {"KelvinVoigt.c": 0.0}, {"KelvinVoigt.k": 1e400}],
    )
    jobs = [{"text": path.read_text(encoding="utf-8"), "steps": 5, "changes": each} for each in changes]
    for each, page in zip(changes, in_node(jobs), strict=True):
        assert all(run["taken"] == -1 for run in page["runs"])
        with pytest.raises(li.InputError) as error:
            li.with_values(problem, each)
        assert page["refusal"] == str(error.value)
