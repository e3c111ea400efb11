"""Reports: one page that holds all it shows."""

from __future__ import annotations

import re
from html.parser import HTMLParser

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure

from lcpimpact import InputError
from lcpimpact.report.report import Picture, Section, write_report


class Page(HTMLParser):
    """Collects what a page refers to, its rows, its text, and the tags that are still open."""

    def __init__(self):
        super().__init__()
        self.sources, self.links, self.rows, self.text, self.open = [], [], [], "", []

    def handle_starttag(self, tag, attributes):
        given = dict(attributes)
        self.sources += [given["src"]] if "src" in given else []
        self.links += [given["href"]] if "href" in given else []
        # A paragraph ends where another block begins, whatever was meant.
        assert not (tag in ("p", "div", "ul", "table") and "p" in self.open), f"{tag} within a paragraph"
        if tag == "tr":
            self.rows.append([])
        if tag not in ("meta", "img"):
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag, f"{tag} closes another"

    def handle_data(self, data):
        self.text += data
        if self.open and self.open[-1] in ("td", "th"):
            self.rows[-1].append(data)


def read(path):
    page = Page()
    page.feed(path.read_text(encoding="utf-8"))
    page.close()
    assert page.open == []
    return page


def figure():
    drawn = Figure(figsize=(2, 1))
    drawn.subplots().plot([0, 1], [0, 1])
    return drawn


def test_a_report_holds_all_it_shows(tmp_path):
    table = pd.DataFrame({"method": ["a<b", "c"], "error": [1.23456e-7, np.nan], "steps": [12345, 7]})
    sections = [
        Section("", "<p>Both agree.</p><p>All do.</p>", verdict=True),
        Section("Motion", "<em>Seen</em> twice.", [figure(), Picture(figure(), "<b>Below</b>", "a line", "fig-2")]),
        Section("Numbers", table=table, formats={"error": ".1e"}),
    ]
    path = write_report(tmp_path / "study.html", "A study", "Of two methods.", sections)
    page = read(path)
    assert len(page.sources) == 2
    assert all(source.startswith("data:image/svg+xml;base64,") for source in page.sources)
    assert page.links == []
    assert page.rows == [["method", "error", "steps"], ["a<b", "1.2e-07", "12345"], ["c", "-", "7"]]
    for words in ("A study", "Of two methods.", "Both agree.", "Seen", "Below", "Made by lcpimpact"):
        assert words in page.text
    assert "http" not in path.read_text(encoding="utf-8").split("<body>")[1].split("<img")[0]


def test_the_head_of_a_column_stands_as_its_cells_and_indices_are_set(tmp_path):
    table = pd.DataFrame({"method": ["a"], "t_1 <s>": [0.5], "lcp_solver": ["lemke"]})
    path = write_report(tmp_path / "study.html", "t", "l", [Section("Numbers", table=table)])
    (head,) = re.findall(r"<thead>(.*?)</thead>", path.read_text(encoding="utf-8"))
    words = '<th class="word">method</th><th><i>t</i><sub>1</sub> &lt;s&gt;</th><th class="word">lcp_solver</th>'
    assert head == f"<tr>{words}</tr>"


def test_the_same_study_gives_the_same_page(tmp_path):
    pages = [write_report(tmp_path / f"{i}.html", "t", "l", [Section("s", figures=[figure()])]) for i in range(2)]
    assert pages[0].read_bytes() == pages[1].read_bytes()


def test_a_report_that_cannot_be_written_is_refused_and_leaves_nothing(tmp_path):
    with pytest.raises(InputError, match=r"must end in one of \.html"):
        write_report(tmp_path / "study.pdf", "t", "l", [])
    with pytest.raises(InputError, match="there is no folder"):
        write_report(tmp_path / "none" / "study.html", "t", "l", [])
    assert list(tmp_path.iterdir()) == []
