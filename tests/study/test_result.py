"""Every study returns one shape of result, and a CSV file loses nothing of it that a picture needs."""

from __future__ import annotations

import dataclasses
from functools import cache
from io import StringIO

import numpy as np
import pandas as pd
import pytest
from exact_csv import CSV_OPTIONS
from numpy.testing import assert_array_equal

import lcpimpact as li
from lcpimpact.plotting.style import save


def driven(omega=2.7, **values):
    return li.load_problem("shaw-holmes", omega=omega, **values)


STUDIES = {
    "convergence": lambda: li.convergence(li.load_problem("system-1"), ["moreau-jean", "schatzman-paoli"], [0.03, 0.01]),
    "work-precision": lambda: li.work_precision(
        li.load_problem("bouncing-ball"), ["moreau-jean"], [0.03, 0.01], t_end=1.0, repeats=1
    ),
    "comparison": lambda: li.compare(li.load_problem("system-1"), ["moreau-jean", "schatzman-paoli"], dt=1e-2),
    "cross-validation": lambda: li.cross_validate(li.load_problem("system-1"), ["exact", "moreau-jean"]),
    "ledger": lambda: li.energy_ledger(li.simulate(li.load_problem("system-1"), dt=1e-2, progress=False)),
    "section": lambda: li.poincare(driven(), "impact", skip=5, points=4),
    "diagram": lambda: li.bifurcation(lambda s: driven(s=s, x0=0.0), [-0.1, 0.1], skip=2, points=3),
    "basins": lambda: li.basins(lambda x0, v0: driven(2.3, x0=x0, v0=v0), [-0.5, 0.5], [0.0], longest=24),
    "orbit": lambda: li.periodic_orbit(driven(2.8), transient=20),
    "branch": lambda: li.continue_orbit(driven, [2.8, 2.81], transient=20),
    "grazing": lambda: li.grazing(lambda f: driven(0.8, s=1.0, f=f), (0.1, 1.0)),
    "lyapunov": lambda: li.lyapunov(driven(2.8), t_end=110.0, t_start=10.0),
    "sensitivity": lambda: li.sensitivity(li.load_problem("system-1"), ["c_o", "k_o"], ["R.max", "x@0.4"], t_end=1.0),
    "design": lambda: li.design("kelvin-voigt", m=1.0, v0=2.0, e=0.5, contact_time=0.01),
    "fit": lambda: li.fit(
        li.load_problem("kelvin-voigt-impact"), ["k"],
        pd.DataFrame({"t": [0.1, 0.2, 0.3], "x": [0.02, 0.03, 0.02]}),
    ),
}  # fmt: skip


@cache
def made(name):
    return STUDIES[name]()


@pytest.fixture(
    scope="module",
    params=[
        pytest.param(name, marks=pytest.mark.slow) if name in ("work-precision", "comparison") else name
        for name in STUDIES
    ],
)
def study(request):
    return made(request.param)


def test_a_result_has_one_shape(study, tmp_path):
    assert isinstance(study, li.Study)
    with pytest.raises(dataclasses.FrozenInstanceError):
        study.t_end = 1.0
    assert isinstance(study.table, pd.DataFrame)
    assert study.table.attrs == {}
    assert study.summary().startswith("\n".join(study.head()))
    assert repr(study) == study.summary()
    assert set(study.failures.columns) >= {"failure"} or len(study.failures) == 0
    figure = study.plot(tmp_path / "picture.svg")
    assert figure.axes
    assert (tmp_path / "picture.svg").stat().st_size > 1000
    page = study.report(tmp_path / "page.html").read_text(encoding="utf-8")
    assert study.title.format(study) in page
    assert "data:image/svg+xml" in page
    with pytest.raises(li.InputError, match="must end in one of"):
        study.plot(tmp_path / "picture.txt")


@pytest.mark.parametrize(
    "name", ["convergence", "work-precision", "cross-validation", "ledger", "section", "diagram", "lyapunov"]
)
def test_a_table_read_from_a_csv_file_draws_the_same_picture(name, tmp_path):
    study = made(name)
    text = study.table.to_csv(index=False)
    table = pd.read_csv(StringIO(text), keep_default_na=False, na_values=["nan", ""], **CSV_OPTIONS)
    words = [column for column in table if study.table[column].dtype.kind not in "fiub"]
    table[words] = table[words].astype(object).fillna("")
    again = dataclasses.replace(study, table=table)
    pictures = [save(each.plot(), tmp_path / f"{i}.svg").read_bytes() for i, each in enumerate((study, again))]
    assert pictures[0] == pictures[1]
    assert again.summary() == study.summary()


def test_failures_are_the_rows_without_a_result():
    study = made("convergence")
    assert list(study.failures["method"].unique()) == ["schatzman-paoli"]
    assert study.failures["failure"].str.len().min() > 0
    compared = made("comparison")
    assert list(compared.failures["method"]) == ["schatzman-paoli"]
    diagram = made("diagram")
    assert "beyond the stop" in diagram.failures["failure"].item()


def test_a_study_of_convergence_reads_as_its_table():
    study = made("convergence")
    assert_array_equal(study["sup_q"], study.table["sup_q"])
    assert len(study) == len(study.table)
    assert list(study.columns) == list(study.table.columns)
    assert np.isfinite(study[study["failure"] == ""]["sup_q"]).all()
    with pytest.raises(AttributeError):
        study.no_such_thing  # noqa: B018
