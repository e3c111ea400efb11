"""Schemes that several test files run."""

import lcpimpact as li


def column(masses, gaps, speeds, e):
    """Force-free bodies on a line, with a bumper between neighbours."""
    names = "abcd"[: len(masses)]
    elements = [li.Mass(name, m) for name, m in zip(names, masses, strict=True)]
    for i, gap in enumerate(gaps):
        elements.append(li.Bumper(names[i], names[i + 1], gap=gap, e=e, name="RST"[i]))
    return li.Problem("column", li.Scheme(*elements), v0=dict(zip(names, speeds, strict=True)))


def plate_beside_an_impact():
    scheme = li.Scheme(
        li.KelvinVoigt("p", "ground", k=310.3, c=14.5), li.Load("p", f=4.9),
        li.Mass("b", m=2.1), li.Load("b", f=3.0), li.KelvinVoigt("b", "p", k=170.3, c=3.1),
        li.Bumper("p", "ground", gap=0, name="F"), li.Bumper("ground", "b", gap=0.01, e=1, name="S"),
    )  # fmt: skip
    return li.Problem("plate", scheme, v0={"b": 0.37})
