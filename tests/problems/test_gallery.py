"""The page of the problems is what docs/problems_page.py writes, and its pictures are there, and small."""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path
from types import ModuleType

import pytest
from PIL import Image
from tex import with_tex

from lcpimpact import load_problem
from lcpimpact.bibliography import cited
from lcpimpact.problems import PROBLEMS
from lcpimpact.scheme.lagrangian import Lagrangian

DOCS = Path(__file__).parents[2] / "docs"


@pytest.fixture(scope="module")
def gallery() -> ModuleType:
    spec = importlib.util.spec_from_file_location("problems_page", DOCS / "problems_page.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def written() -> str:
    return (DOCS / "problems.md").read_text(encoding="utf-8")


def test_the_page_is_up_to_date(gallery: ModuleType, written: str) -> None:
    assert written == gallery.page(), "run: python docs/problems_page.py"


@pytest.mark.parametrize("name", list(PROBLEMS))
def test_a_problem_has_its_section_and_its_pictures(name: str, written: str) -> None:
    problem = load_problem(name)
    (section,) = re.findall(rf"^## {name}\n(.*?)(?=^## |\Z)", written, flags=re.DOTALL | re.MULTILINE)
    assert f"Source: {cited(problem.source, '{{cite:t}}`{}`'.format)}." in section
    for parameter in problem.parameters:
        assert re.search(rf"^\| ([\w, ]+, )?{parameter}(, [\w, ]+)? \|", section, flags=re.MULTILINE), parameter
    for fact in problem.facts:
        assert f"| {with_tex(fact.what)} | {fact.value:.10g}" in section
    pictures = re.findall(r"!\[[^\]]+\]\(([^)]+)\)", section)
    assert len(pictures) == (1 if isinstance(problem.scheme, Lagrangian) else 2)
    for picture in pictures:
        assert (DOCS / picture).stat().st_size < 40_000
        with Image.open(DOCS / picture) as image:
            assert image.format == "PNG"
            assert 100 < image.width < 1200


def test_no_picture_is_left_of_a_problem_that_is_gone(written: str) -> None:
    for picture in (DOCS / "images" / "problems").iterdir():
        assert f"(images/problems/{picture.name})" in written


def test_the_text_of_a_docstring_reads_as_markdown(gallery: ModuleType) -> None:
    assert gallery._plain("``2 a b`` by ``run.t`` as in `kelvin_voigt_tension`, by `Bar`") == (
        "$2 a b$ by `run.t` as in [kelvin-voigt-tension](#kelvin-voigt-tension), by `Bar`"
    )
    assert gallery.parameters("system-1")[1] == ("k_o", "3924 N/m", "Stiffness of the ground structure.")
