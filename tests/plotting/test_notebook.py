"""What notebooks show: pictures and tables of problems, runs, solutions and studies."""

import base64
import json
import pickle
import re
import xml.etree.ElementTree as ElementTree
from html.parser import HTMLParser

import numpy as np
import pandas as pd
import pytest

import lcpimpact as li
from lcpimpact.problems import PROBLEMS


class Cell(HTMLParser):
    """The parts of a fragment: texts of table cells, pictures, and the tags that are open at the end."""

    def __init__(self, html):
        super().__init__()
        self.cells, self.pictures, self.open, self.words = [], [], [], []
        self.feed(html)

    def handle_starttag(self, tag, attributes):
        if tag == "img":
            self.pictures.append(dict(attributes)["src"])
        else:
            self.open.append(tag)
        if tag in ("td", "th"):
            self.cells.append("")

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open and self.open[-1] in ("td", "th"):
            self.cells[-1] += data
        self.words.append(data)


def shown(thing):
    cell = Cell(thing._repr_html_())
    assert not cell.open
    for source in cell.pictures:
        kind, data = source.split(",", 1)
        assert kind == "data:image/svg+xml;base64"
        assert ElementTree.fromstring(base64.b64decode(data)).tag.endswith("svg")
    return cell


@pytest.mark.parametrize("name", sorted(PROBLEMS))
def test_every_problem_is_drawn_with_its_parameters(name):
    problem = li.load_problem(name)
    cell = shown(problem)
    assert len(cell.pictures) == (not isinstance(problem.scheme, li.Lagrangian))
    for parameter, value in problem.parameters.items():
        assert cell.cells[cell.cells.index(parameter) + 1] == format(value, "g")


def test_a_problem_shows_its_matrices():
    cell = shown(li.load_problem("system-1"))
    assert {"M [kg]", "C [N s/m]", "K [N/m]", "H", "u at q = 0 [m]"} <= set(cell.words)
    assert "3924" in cell.cells, "k_o in K"


def test_a_run_shows_its_curves_and_the_quantities_of_its_summary():
    run = li.simulate(li.load_problem("bouncing-ball", e=0.5), "exact", dt=0.1, t_end=1.0)
    cell = shown(run)
    assert len(cell.pictures) == 1
    for name, value in run.summary().items():
        i = cell.cells.index(name.replace("_", " "))
        assert cell.cells[i + 1] == ("-" if np.isnan(value) else format(value, ".6g"))
    assert cell.cells[cell.cells.index("restitution") + 1] == "0.5"


def test_a_summary_is_a_table_and_numbers():
    found = li.simulate(li.load_problem("bouncing-ball", e=0.5), "exact", dt=0.1, t_end=1.0).summary()
    assert shown(found).cells[:7] == ["quantity", "value", "unit", "error", "peak force", "0", "N"]
    lines = str(found).split("\n")
    assert [line.split()[:2] for line in lines[3:5]] == [["restitution", "0.5"], ["rebound", "speed"]]
    assert len(lines) == len(found)
    assert found == dict(found)
    assert pd.Series(found)["restitution"] == found["restitution"] == pytest.approx(0.5)
    assert pickle.loads(pickle.dumps(found)) == pytest.approx(found, nan_ok=True)
    assert json.loads(json.dumps(found))["impacts"] == 2.0


@pytest.mark.parametrize(("m", "verdict"), [(-1.0, "fails"), (1.0, "holds")])
def test_a_verdict_has_its_colour(m, verdict):
    assert f'class="verdict {verdict}"' in li.solve_lcp([[m]], [-1.0], throw=False)._repr_html_()


def test_a_solution_shows_z_and_w_and_a_trace_its_tableaus():
    solution = li.solve_lcp([[2.0, 1.0], [1.0, 2.0]], [-5.0, -6.0], "lemke", trace=True)
    cell = shown(solution)
    assert cell.cells[:9] == ["i", "z", "w", "1", "1.33333", "0", "2", "2.33333", "0"]
    assert len(cell.pictures) == 2, "the path and the cones"
    assert [word for word in cell.words if word.startswith("Tableau")] == ["Tableau 1", "Tableau 2", "Tableau 3"]
    large = shown(li.solve_lcp(np.eye(100), -np.ones(100)))
    assert "The first 30 of 100 rows." in large.words
    assert len(large.cells) == 3 * 31


def test_a_study_shows_its_summary_its_picture_and_its_table():
    problem = li.load_problem("shaw-holmes")
    study = li.poincare(problem, skip=1, points=3)
    cell = shown(study)
    assert len(cell.pictures) == 1
    assert study.summary().split("\n")[0] in "".join(cell.words)
    assert len(cell.cells) == len(study.table.columns) * 4


def test_what_cannot_be_drawn_shows_its_text_and_the_reason():
    text = "".join(shown(li.Scheme()).words)
    assert "Scheme(" in text
    assert "no element yet" in text


def test_large_and_sparse_schemes_show_their_size_only():
    beads = li.Problem("beads", li.SparseScheme(li.Chain(2_000, m=1.0, gap=0.1, e=0.0, f=9.81, b="ground")))
    cell = shown(beads)
    assert "2,000 nodes and 2,000 contacts in sparse matrices." in cell.words
    assert len(cell.cells) == 3 * 31
    assert "SparseTrajectory" in "".join(shown(li.simulate(beads, dt=1e-3, t_end=2e-3)).words)
    many = li.Scheme(*(li.Mass(f"x{i}", 1.0) for i in range(300)))
    assert "The scheme is too large to be drawn." in shown(many).words


def test_names_are_no_html():
    problem = li.Problem("<b>&", li.Scheme(li.Mass("<i>", 1.0)), parameters={"<u>": 1.0})
    html = problem._repr_html_()
    assert not re.search("<i>|<u>|<b><b>&", html)


def test_figures_show_themselves():
    figure = li.simulate(li.load_problem("system-1"), dt=1e-2).plot()
    assert ElementTree.fromstring(figure._repr_svg_()).tag.endswith("svg")
