"""The sources of methods, LCP solvers and problems, as entries of references.bib.

A source names the keys of its entries, each with the place in it where there is one, as
``"Jean1999; HairerWanner1996, section IV.5"``. What begins with no key, as the source of a method of one's own, stays as it
is.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import cache
from importlib.resources import files

from lcpimpact import __version__
from lcpimpact.errors import InputError, UnknownNameError
from lcpimpact.integrators import METHODS
from lcpimpact.lcp import SOLVERS
from lcpimpact.problems import PROBLEMS, load_problem
from lcpimpact.registry import nearest


def cite(*names: str) -> str:
    """Return the BibTeX entries of the sources of methods, LCP solvers or problems.

    Parameters
    ----------
    names : str
        Registered names, as ``"moreau-jean"``, ``"lemke"`` or ``"bouncing-ball"``, or keys of the bibliography; without a
        name, the entry of lcpimpact itself.

    Returns
    -------
    str
        The entries, each once, in the order in which the names give them.

    Raises
    ------
    UnknownNameError
        Where a name is not registered.
    InputError
        Where a name has no source in the bibliography.

    Examples
    --------
    >>> from lcpimpact import cite
    >>> print(cite("schatzman-paoli"))
    @article{PaoliSchatzman2002,
      author    = {Paoli, Laetitia and Schatzman, Michelle},
      title     = {A numerical scheme for impact problems {I}: the one-dimensional case},
      journal   = {SIAM Journal on Numerical Analysis},
      volume    = {40},
      number    = {2},
      pages     = {702--733},
      year      = {2002},
      doi       = {10.1137/S0036142900378728},
    }
    """
    if not names:
        return (
            "@software{lcpimpact,\n"
            "  author    = {{The lcpimpact developers}},\n"
            "  title     = {lcpimpact: a laboratory for impact mechanics},\n"
            f"  version   = {{{__version__}}},\n"
            "  year      = {2026},\n"
            "  month     = {11},\n"
            "}"
        )
    return "\n\n".join(entries()[key] for key in dict.fromkeys(key for name in names for key in _keys_of(name)))


def cited(source: str, spell: Callable[[str], str] | None = None) -> str:
    """Return a source in words: each key as ``spell`` has it, by default the authors and the year.

    Examples
    --------
    >>> cited("Jean1999; HairerWanner1996, section IV.5; folklore")
    'Jean (1999); Hairer and Wanner (1996), section IV.5; folklore'
    """
    spell = spell or _authors_and_year
    parts = [part.partition(",") for part in source.split("; ")]
    return "; ".join((spell(key) if key in entries() else key) + comma + place for key, comma, place in parts)


def keys(source: str) -> list[str]:
    """Return the keys of the bibliography that a source names."""
    return [key for key in (part.partition(",")[0] for part in source.split("; ")) if key in entries()]


@cache
def entries() -> dict[str, str]:
    """Return the entries of references.bib by their keys, as they stand there."""
    text = files("lcpimpact").joinpath("references.bib").read_text(encoding="utf-8")
    return {
        found[1]: found[0].rstrip() for found in re.finditer(r"^@\w+\{(\w+),\n.*?^\}$", text, re.MULTILINE | re.DOTALL)
    }


def fields(entry: str) -> dict[str, str]:
    """Return the fields of an entry, which has one in each line."""
    return dict(re.findall(r"^  (\w+) += \{(.*)\},$", entry, re.MULTILINE))


def _keys_of(name: str) -> list[str]:
    """Return the keys of the source of a registered name, or of a key itself."""
    if name in entries():
        return [name]
    if name in METHODS:
        source = METHODS[name].declared.source
    elif name in PROBLEMS:
        source = load_problem(name).source
    elif name in SOLVERS:
        source = SOLVERS[name].source
    else:
        known = [*METHODS, *SOLVERS, *PROBLEMS]
        raise UnknownNameError(nearest(name, known, "method, solver or problem", list(entries())))
    if not keys(source):
        raise InputError(f"{name} names no source in the bibliography: there is nothing to cite but lcpimpact itself")
    return keys(source)


def _authors_and_year(key: str, *, max_names: int = 4) -> str:
    """Return the family names and the year of an entry; of more than ``max_names`` authors the first."""
    known = fields(entries()[key])
    names = [author.split(", ")[0] for author in known["author"].split(" and ")]
    if len(names) > max_names or "others" in names:
        authors = f"{names[0]} et al."
    else:
        authors = " and ".join(filter(None, (", ".join(names[:-1]), names[-1])))
    return f"{authors} ({known['year']})" if "year" in known else authors
