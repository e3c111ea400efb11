"""The theory: its statements are numbered by chapter, each link to one finds it, and each exercise has an answer."""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[2] / "docs"
CHAPTERS = sorted((DOCS / "theory").glob("[0-9]*.md"))
STATEMENT = re.compile(
    r"^:::\{admonition\} (Definition|Statement) (\d+)\.(\d+): .+\n:name: (.+)\n:class: statement\n\n", re.MULTILINE
)


def text_of(chapter: Path) -> str:
    return chapter.read_text(encoding="utf-8")


def test_there_are_twelve_chapters_with_statements():
    assert [int(chapter.name[:2]) for chapter in CHAPTERS] == list(range(1, 13))
    kinds = Counter(found[1] for chapter in CHAPTERS for found in STATEMENT.finditer(text_of(chapter)))
    assert kinds["Definition"] >= 9
    assert kinds["Statement"] >= 20


@pytest.mark.parametrize("chapter", CHAPTERS, ids=lambda chapter: chapter.stem)
def test_statements_are_numbered_by_chapter(chapter):
    text = text_of(chapter)
    found = list(STATEMENT.finditer(text))
    assert len(found) == text.count("{admonition}")
    assert [int(each[2]) for each in found] == [int(chapter.name[:2])] * len(found)
    assert [int(each[3]) for each in found] == list(range(1, len(found) + 1))
    assert [each[4] for each in found] == [f"{each[1].lower()}-{each[2]}-{each[3]}" for each in found]


def test_each_link_to_a_statement_finds_it():
    names = {found[4] for chapter in CHAPTERS for found in STATEMENT.finditer(text_of(chapter))}
    links = [
        (page.name, *found)
        for page in DOCS.rglob("*.md")
        for found in re.findall(r"\[((?:Definition|Statement) [\d.]+)\]\(#([\w-]+)\)", page.read_text(encoding="utf-8"))
    ]
    assert len(links) >= 8
    for page, words, name in links:
        assert name in names, page
        assert name == words.lower().replace(" ", "-").replace(".", "-"), page


@pytest.mark.parametrize("chapter", CHAPTERS, ids=lambda chapter: chapter.stem)
def test_each_exercise_has_its_answer(chapter):
    exercises, answers = re.split(
        r"^:::\{dropdown\} Answer to 1$", text_of(chapter).split("\n## Exercises\n")[1], flags=re.MULTILINE
    )
    numbers = re.findall(r"^(\d+)\. ", exercises, re.MULTILINE)
    assert len(numbers) >= 2
    assert ["1", *re.findall(r"^:::\{dropdown\} Answer to (\d+)$", answers, re.MULTILINE)] == numbers
