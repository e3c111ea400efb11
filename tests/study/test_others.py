"""What others get: the page is that of its CSV, the truths are right, and cheap rows of lcpimpact are reproduced."""

import math

import numpy as np
import others
import others_lcpimpact
import others_page
import pytest
from others_problems import CASES, Motion, last_millimetre, vertex

import lcpimpact as li


@pytest.fixture(scope="module")
def written():
    return others.CSV.read_text(encoding="utf-8")


def test_the_page_is_that_of_the_csv(written):
    assert others.PAGE.read_text(encoding="utf-8") == others_page.page(written), "run: python benchmarks/others.py"


def test_every_contestant_has_a_row_for_every_problem_or_a_reason(written):
    _, table = others_page.read(written)
    assert set(zip(table["problem"], table["contestant"], strict=True)) == {
        (title, contestant) for title in CASES for contestant in others.CONTESTANTS
    }
    assert len(CASES) == 12
    assert table.loc[table["sup_q"].isna(), "reason"].ne("").all()


@pytest.mark.parametrize("setting", ["default", "accurate"])
@pytest.mark.parametrize("title", ["bouncing-ball", "block-on-incline"])
def test_rows_of_lcpimpact_are_reproduced(written, title, setting):
    _, table = others_page.read(written)
    here = table[
        (table["problem"] == title) & (table["contestant"] == "lcpimpact") & (table["setting"] == setting)
    ].iloc[0]
    how, run = others_lcpimpact.settings(title)[setting]
    assert here["how"] == how
    assert CASES[title].errors(run()) == pytest.approx(
        here[["sup_q", "l1_v", "asked_error"]].tolist(), rel=1e-5, abs=1e-11
    )


@pytest.mark.parametrize("title", [title for title, case in CASES.items() if case.known])
def test_what_is_asked_for_is_that_of_the_closed_form(title):
    case = CASES[title]
    t = np.linspace(0.0, case.t_end, 20001)
    error = case.errors(Motion(t, *case.truth(t)))
    assert error[2] < 1e-6
    assert error[:2] == (0.0, 0.0) if case.rates else error[0] == 0.0


def test_errors_are_those_of_a_motion_that_is_moved():
    """The cradle a millimetre further and 2 m/s faster, without the four instants of its impacts."""
    case = CASES["newtons-cradle"]
    t = np.linspace(0.0, 0.2, 21)
    q, v = case.truth(t)
    sup_q, l1_v, asked = case.errors(Motion(t, q + 1e-3, v + 2.0))
    assert sup_q == pytest.approx(1e-3)
    assert asked == pytest.approx(2.0)
    assert l1_v == pytest.approx(2.0 * (0.2 - 4 * 0.01)), "impacts at 0.10, 0.11, 0.12 and 0.13 s are left out"


def test_the_cradle_is_that_of_exact():
    case = CASES["newtons-cradle"]
    run = li.simulate(case.problem, "exact", dt=1e-3, t_end=case.t_end, progress=False)
    assert run.q == pytest.approx(case.truth(run.t)[0], abs=1e-12)


def test_the_last_millimetre_is_where_the_closed_form_says():
    t = last_millimetre()
    motion = CASES["bouncing-ball to rest"].problem.motion
    assert 1.0 - motion(np.array([t]))[0][0, 0] == pytest.approx(1e-3, rel=1e-9)
    later = np.linspace(t + 1e-9, 5.0, 100_001)
    assert (1.0 - motion(later)[0][:, 0]).max() < 1e-3


def test_the_vertex_of_a_parabola_is_between_its_samples():
    t = np.arange(7.0)
    assert vertex(5.0 - (t - 3.3) ** 2) == pytest.approx(5.0)
    assert vertex(t) == 6.0, "no vertex inside"


def test_who_is_closest_and_fastest():
    import pandas as pd

    table = pd.DataFrame(
        {
            "contestant": ["a", "b", "c", "d"], "sup_q": [2e-15, 1e-16, 1e-4, math.nan], "scale": 1.0,
            "ms": [3.0, 2.0, 1.0, 0.1],
        }
    )  # fmt: skip
    assert others_page.closest(table) == ["a", "b"], "to rounding"
    assert others_page.fast(table)["contestant"] == "c"
    assert others_page.closest(table.iloc[2:]) == ["c"]


def test_who_is_ahead_at_the_default():
    import pandas as pd

    table = pd.DataFrame(
        {
            "contestant": ["lcpimpact", "a", "b", "c", "a"], "setting": ["default"] * 4 + ["tuned"],
            "sup_q": [1e-3, 9e-4, 1e-5, math.nan, 1e-9],
        }
    )  # fmt: skip
    assert others_page.ahead(table) == ["b", "a"]
    assert others_page.ahead(table.iloc[1:]) == []


def test_a_failure_is_a_row_with_its_reason():
    case = CASES["bouncing-ball"]

    def fails():
        raise RuntimeError("no step is small enough")

    assert others.judged(case, "so", fails)["reason"] == "no step is small enough"
    t = np.linspace(0.0, 1.0, 11)
    assert others.judged(case, "so", lambda: Motion(t, *case.truth(t)))["reason"] == "ends at t = 1 s"
