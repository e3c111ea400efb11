"""The bibliography is whole, methods, solvers and problems name its keys, and it is printed as BibTeX."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

import lcpimpact
from lcpimpact import InputError, UnknownNameError, cite
from lcpimpact.bibliography import cited, entries, fields, keys
from lcpimpact.cli.main import main
from lcpimpact.integrators import METHODS
from lcpimpact.lcp import SOLVERS
from lcpimpact.problems import PROBLEMS, load_problem

ROOT = Path(lcpimpact.__file__).parents[1]

SOURCES = {
    **{name: METHODS[name].declared.source for name in METHODS},
    **{name: SOLVERS[name].source for name in SOLVERS},
    **{name: load_problem(name).source for name in PROBLEMS},
}

WITHOUT_SOURCE = {"auto", "closed-form"}
"""Solvers that choose among others, or write out what the definition says."""

WITHOUT_LINK = {
    "BapatPopplewellMcLachlan1983", "BruelsAcaryCardona2014", "ChenAcaryVirlezBruels2013", "CottleChang1992",
    "CottleDantzig1968", "Coulomb1785", "DenHartog1931", "Fischer1992", "FossasOlivar1996", "GrzesikiewiczZbiciak",
    "HerrmannSchmaelzle1981", "HerrmannSeitz1982", "Holmes1982", "Jenkins1962", "Keller1973", "Kolsky1963",
    "LehtihetMiller1986", "MasriCaughey1966", "MehtaLuck1990", "Mellen1968", "Murty1974", "Painleve1895",
    "Pohl1987", "SamelsonThrallWesler1958", "Skorokhod1961", "Tsypkin1984",
}  # fmt: skip
"""Entries whose DOI, ISBN or address nobody has looked up: one that is found is added there, and its key struck here."""


def printed(capsys, *arguments):
    with pytest.raises(SystemExit) as end:
        main(arguments)
    out, err = capsys.readouterr()
    return end.value.code, out, err


def test_every_entry_says_what_a_reader_needs_to_find_it():
    text = (ROOT / "lcpimpact" / "references.bib").read_text(encoding="utf-8")
    assert list(entries()) == re.findall(r"^@\w+\{(.*),$", text, re.MULTILINE)
    assert list(entries()) == sorted(entries(), key=str.lower)
    assert len(entries()) > 100
    without_link = set()
    for key, entry in entries().items():
        known = fields(entry)
        assert len(known) == entry.count("\n") - 1, f"{key}: one field a line"
        assert entry.count("{") == entry.count("}"), key
        assert {"author", "title"} <= set(known), key
        assert ("year" in known) == (key != "GrzesikiewiczZbiciak"), "the manuscript has no date"
        assert re.fullmatch(r"\d{4}", known.get("year", "1900")), key
        assert known.get("year", "") in key or key == "GrzesikiewiczZbiciak"
        assert re.fullmatch(r"10\.\d{4,5}/\S+", known.get("doi", "10.1000/182")), key
        assert known.get("url", "https://").startswith("http"), key
        if entry.startswith("@article"):
            assert "journal" in known, key
        if not {"doi", "isbn", "url"} & set(known):
            without_link.add(key)
    assert without_link == WITHOUT_LINK


def test_no_work_stands_there_twice():
    for name in ("title", "doi"):
        values = [fields(entry)[name].lower() for entry in entries().values() if name in fields(entry)]
        assert len(values) == len(set(values))


@pytest.mark.parametrize("name", list(SOURCES))
def test_a_declared_source_names_keys_of_the_bibliography(name):
    source = SOURCES[name]
    if name in WITHOUT_SOURCE:
        assert keys(source) == []
        with pytest.raises(InputError, match=f"{name} names no source in the bibliography"):
            cite(name)
        return
    assert len(keys(source)) == source.count("; ") + 1
    found = cite(name)
    assert re.findall(r"^@\w+\{(\w+),$", found, re.MULTILINE) == keys(source)


def test_one_name_means_one_thing():
    names = [*METHODS, *SOLVERS, *PROBLEMS]
    assert len(names) == len({*names, *entries()}) - len(entries())


def test_the_pages_cite_what_is_there():
    cites = re.compile(r"\{cite:[pt]\}`([\w, ]+)`")
    named = {
        key.strip(): page.name
        for page in (ROOT / "docs").rglob("*.md")
        for found in cites.findall(page.read_text(encoding="utf-8"))
        for key in found.split(",")
    }
    assert len(named) > 80
    assert {key: page for key, page in named.items() if key not in entries()} == {}


def test_a_source_in_words():
    assert cited("Moreau1988; Jean1999; AcaryBrogliato2008, chapter 10") == (
        "Moreau (1988); Jean (1999); Acary and Brogliato (2008), chapter 10"
    )
    assert cited("BruelsAcaryCardona2014, with impulses") == "Brüls, Acary and Cardona (2014), with impulses"
    assert cited("DiStasioEtAl2019") == "Di Stasio et al. (2019)"
    assert cited("Stellato2020") == "Stellato et al. (2020)"
    assert cited("GrzesikiewiczZbiciak, Eqs (3), (6), (8)") == "Grzesikiewicz and Zbiciak, Eqs (3), (6), (8)"
    assert cited("folklore") == "folklore"
    assert cited("-") == "-"
    assert cited("Jean1999, page 3; my own", "<{}>".format) == "<Jean1999>, page 3; my own"


def test_several_names_give_each_entry_once():
    both = cite("radau", "radau-fesd")
    assert re.findall(r"^@\w+\{(\w+),$", both, re.MULTILINE) == [
        "HairerWanner1996", "AcaryBrogliato2008", "NurkanovicSperlAlbrechtDiehl2024",
    ]  # fmt: skip
    assert cite("Jean1999") == entries()["Jean1999"]


def test_lcpimpact_is_cited_as_its_citation_file_says():
    known = fields(cite())
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert f'title: "{known["title"]}"' in citation
    assert f'- name: "{known["author"].strip("{}")}"' in citation
    assert known["version"] == lcpimpact.__version__
    assert f"\nversion: {known['version']}\ndate-released: {known['year']}-{known['month']}-" in citation


def test_cite_prints_bibtex(capsys):
    assert printed(capsys, "cite", "moreau-jean") == (0, cite("moreau-jean") + "\n", "")
    assert printed(capsys, "cite") == (0, cite() + "\n", "")
    code, out, _ = printed(capsys, "cite", "moreau-jean", "--json")
    assert code == 0
    assert json.loads(out) == {"bibtex": cite("moreau-jean")}


@pytest.mark.parametrize(
    ("name", "near"),
    [("moreau-jan", "moreau-jean"), ("lemk", "lemke"), ("bouncing-bal", "bouncing-ball"), ("Jean1998", "Jean1999")],
)
def test_a_name_that_nobody_has_is_refused_with_the_nearest(capsys, name, near):
    with pytest.raises(UnknownNameError, match=f"unknown method, solver or problem '{name}': did you mean '{near}'"):
        cite(name)
    code, out, err = printed(capsys, "cite", name)
    assert (code, out) == (2, "")
    assert err.count("\n") == 1
    assert f"did you mean '{near}'" in err


def test_a_name_without_a_source_is_refused(capsys):
    code, out, err = printed(capsys, "cite", "closed-form")
    assert (code, out) == (2, "")
    assert (
        err
        == "lcpimpact: closed-form names no source in the bibliography: there is nothing to cite but lcpimpact itself\n"
    )
