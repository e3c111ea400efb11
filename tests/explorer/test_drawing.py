"""A scheme file that is given to the page is drawn as the page draws a problem: `Layout` in node gives its numbers."""

from __future__ import annotations

import json
from contextlib import suppress
from pathlib import Path

from test_own_schemes import HEAD, SPRING, element, in_node, pytestmark, random_files  # noqa: F401

import lcpimpact as li
from lcpimpact.errors import InputError
from lcpimpact.explorer.drawing import drawing
from lcpimpact.explorer.own_schemes import TAKEN
from lcpimpact.explorer.page import EXAMPLE
from lcpimpact.problems import PROBLEMS
from lcpimpact.scheme.scheme import Scheme
from lcpimpact.schemefile import read_scheme_file, write_scheme_file

BODY = HEAD.replace('"x"', '"y"')

SCHEMES = {
    "the example of the page": EXAMPLE,
    "a mass on nothing": HEAD,
    "two masses side by side": HEAD + SPRING + BODY + SPRING.replace('"x"', '"y"'),
    "a rope and a Maxwell element": HEAD + BODY + SPRING
    + element(type="'Maxwell'", a="'y'", b="'x'", k="3.0", c="2.0")
    + element(type="'Rope'", a="'x'", b="'y'", slack="0.5", e="0.5"),
    "a mass that hangs from a rope": HEAD + element(type="'Rope'", a="'ground'", b="'x'", slack="0", e="1"),
    "a load beside a bumper": HEAD + element(type="'Load'", node="'x'", f="9.81")
    + element(type="'Bumper'", upper="'x'", lower="'ground'", e="0.5", gap="1", name="'Stop'"),
    "a bumper under the corner of a rocking block": HEAD + BODY.replace('"y"', '"φ"') + SPRING
    + element(type="'Bumper'", upper="{ x = 1.0, \"φ\" = -0.25 }", lower="'ground'", gap="1.0", e="0.5"),
    "a slider between two sums": HEAD + BODY + HEAD.replace('"x"', '"z"') + SPRING
    + element(type="'Slider'", a="{ x = 1.0, y = 2.0 }", b="{ z = -1.0 }", r0="3.0"),
    "four arms, and their symbol": HEAD
    + element(type="'GeneralizedMaxwell'", a="'x'", b="'ground'", k_inf="1", k="[1, 2, 3, 4]", tau="[1, 1, 1, 1]"),
    "three arms that flow": HEAD
    + element(type="'GeneralizedMaxwell'", a="'ground'", b="'x'", k_inf="0", k="[1, 2, 3]", tau="[1, 1, 1]"),
    "hardening": HEAD + element(type="'Jenkins'", a="'x'", b="'ground'", k="2.0", f_y="1.0", k_h="1.0"),
    "a Zener element beside a spring": HEAD + SPRING
    + element(type="'Zener'", a="'ground'", b="'x'", k="1.0", k_1="2.0", c_1="3.0", symbols="['E_12', 'E3', 'a b']"),
    "a stop that moves": HEAD + SPRING
    + element(type="'PrescribedMotion'", node="'table'", y="{ amplitude = 0.1, omega = 2.0 }")
    + element(type="'Bumper'", upper="'x'", lower="'table'", e="0.5", gap="1.0"),
    "names of any letters": (HEAD + SPRING).replace('"x"', '"ψ2"').replace("k = 3.0", "k = 3.0\nsymbols = ['k$_2 {x}']")
    + element(type="'Slider'", a="'ψ2'", b="'ground'", r0="3.0", name="'µ_gleit 12'"),
}  # fmt: skip
"""Schemes for what a drawing may hold."""


def of_python(path: Path) -> dict[str, list]:
    """Return the drawing of a scheme file by Python, as it comes from JSON."""
    problem = read_scheme_file(path).problem
    nodes, links = drawing(problem.scheme.elements, problem.dynamics.nodes)
    return json.loads(json.dumps({"nodes": nodes, "links": links}))


def test_drawings_of_schemes_for_all_that_they_may_hold(tmp_path):
    pages = in_node([{"text": text, "steps": 1} for text in SCHEMES.values()])
    for (name, text), page in zip(SCHEMES.items(), pages, strict=True):
        (path := tmp_path / "my.toml").write_text(text, encoding="utf-8")
        assert page.get("drawing") == of_python(path), name


def test_drawings_of_registered_problems_as_files(tmp_path):
    paths = []
    for name in PROBLEMS:
        problem = li.load_problem(name)
        if isinstance(problem.scheme, Scheme) and all(type(each).__name__ in TAKEN for each in problem.scheme.elements):
            with suppress(InputError):  # a load that is a function of Python
                paths.append(write_scheme_file(problem, tmp_path / f"{name}.toml"))
    pages = in_node([{"text": path.read_text(encoding="utf-8"), "steps": 1} for path in paths])
    drawn = [(path, page["drawing"]) for path, page in zip(paths, pages, strict=True) if "drawing" in page]
    assert len(drawn) >= 23
    assert all("unsupported" in page or "drawing" in page for page in pages)
    for path, page in drawn:
        assert page == of_python(path), path.stem


def test_drawings_of_random_files(tmp_path):
    paths = random_files(tmp_path)
    pages = in_node([{"text": path.read_text(encoding="utf-8"), "steps": 1} for path in paths])
    drawn = [(path, page["drawing"]) for path, page in zip(paths, pages, strict=True) if "drawing" in page]
    assert len(drawn) >= 40
    for path, page in drawn:
        assert page == of_python(path), path.read_text(encoding="utf-8")
