"""Methods side by side: tables that say what separates them, pictures, and the commands."""

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose

import lcpimpact as li
from lcpimpact.cli.main import main
from lcpimpact.integrators.moreau_jean import MoreauJean
from lcpimpact.study.accuracy.norms import NORMS
from lcpimpact.study.accuracy.reference import Reference


@pytest.fixture(scope="module")
def three():
    return li.compare(li.load_problem("system-3"), ["moreau-jean", "rk4-paper", "exact"], dt=1e-2)


@pytest.fixture(scope="module")
def ball():
    return li.compare(li.load_problem("bouncing-ball", e=0.5), ["moreau-jean", "rk4-paper", "rk4"], dt=1e-3, t_end=1.3)


def test_differences_are_those_of_the_norms(three):
    table = three.table
    assert list(table["method"]) == ["moreau-jean", "rk4-paper", "exact"]
    assert (table["against"] == "event-driven (rtol=1e-12)").all()
    assert set(NORMS) <= set(table.columns)
    exact = li.simulate(three.problem, "exact", dt=1e-2, t_end=3.0)
    by_hand = np.abs(three.runs["moreau-jean"]["x"] - exact["x"]).max()
    assert_allclose(table["sup_q"][0], by_hand, rtol=1e-6)
    assert table["sup_q"][2] < 1e-10
    assert list(table["steps"]) == [300] * 3
    assert list(table["events"]) == [2, 2, 2]
    assert (three.problem.name, three.t_end, three.reference.name) == ("system-3", 3.0, table["against"][0])


def test_without_a_reference_each_is_compared_with_each():
    found = li.compare(li.load_problem("system-1"), ["moreau-jean", "rk4", "rk4-paper"], dt=1e-2, reference=None)
    table = found.table
    assert list(zip(table["method"], table["against"], strict=True)) == [
        ("moreau-jean", "rk4"), ("moreau-jean", "rk4-paper"), ("rk4", "rk4-paper")
    ]  # fmt: skip
    by_hand = np.abs(found.runs["moreau-jean"]["x"] - found.runs["rk4"]["x"]).max()
    assert_allclose(table["sup_q"][0], by_hand, rtol=1e-12)
    assert found.forces()["reference"].isna().all()
    assert "reference" not in found.events().columns


def test_events_stand_side_by_side(ball):
    table = ball.events()
    assert list(table.columns) == ["contact", "kind", "k", "reference", "moreau-jean", "rk4", "spread"]
    impacts = table[table["kind"] == "impact"].head(2)
    g, h = 9.81, 1.0
    first = np.sqrt(2.0 * h / g)
    times = [first, first + 2.0 * 0.5 * first]
    assert_allclose(impacts["reference"], times, rtol=1e-12)
    assert_allclose(impacts["moreau-jean"], times, atol=4e-3)
    assert list(impacts["k"]) == [1, 2]
    spread = impacts[["reference", "moreau-jean", "rk4"]].max(axis=1) - impacts[
        ["reference", "moreau-jean", "rk4"]
    ].min(axis=1)
    assert_allclose(impacts["spread"], spread)
    assert table["reference"].dropna().is_monotonic_increasing


def test_the_spread_is_from_the_earliest_to_the_latest(three):
    table = three.events()
    times = [[run.events[k].t for run in (three.reference.trajectory, *three.runs.values())] for k in range(2)]
    assert_allclose(table["spread"], np.ptp(times, axis=1), rtol=1e-9)


def test_an_event_that_a_method_misses_is_missing():
    found = li.compare(
        li.load_problem("bouncing-ball"), {"fine": "moreau-jean", "coarse": "moreau-jean"}, dt={"fine": 1e-3, "coarse": 0.2},
        t_end=5.0,
    )  # fmt: skip
    table = found.events()
    assert table["coarse"].isna().sum() > table["fine"].isna().sum()
    assert (table["spread"] >= 0.0).all()


def test_forces_are_read_where_they_live(three):
    table = three.forces()
    for label, run in three.runs.items():
        mine = table[table["method"] == label]
        assert_allclose(mine["t"], run.t_reaction)
        assert_allclose(mine["r"], run.reaction[:, 0])
        assert_allclose(mine["reference"], three.reference.trajectory.sample(run.t_reaction).reaction[:, 0])
        assert_allclose(mine["difference"], mine["r"] - mine["reference"])
    # The θ-step has its force in the middle of the step, and there it is right to second order.
    mine = table[table["method"] == "moreau-jean"].iloc[:90]
    assert_allclose(mine["t"].diff().dropna(), 1e-2)
    assert mine["t"].iloc[0] == pytest.approx(5e-3)
    assert mine["difference"].abs().max() < 3.0


def test_energies_are_those_of_the_ledgers(three):
    ledgers, table = three.ledgers(), three.energies().set_index("item")
    assert list(table.columns) == ["reference", "moreau-jean", "rk4-paper", "exact"] == list(ledgers)
    for label, ledger in ledgers.items():
        assert table[label]["kinetic"] == ledger.table["kinetic"].iloc[-1]
    assert abs(table["exact"]["balance"]) < 1e-9
    given = li.compare(li.load_problem("diode-bridge"), ["moreau-jean"], dt=1e-5, t_end=1e-3, reference=None)
    assert given.ledgers() == {}
    assert len(given.energies()) == 0


def test_a_refusal_is_kept_with_its_sentence(ball):
    assert list(ball.runs) == ["moreau-jean", "rk4"]
    assert "rk4-paper does not handle relative degree 2" in ball.reasons["rk4-paper"]
    row = ball.table.iloc[-1]
    assert row["method"] == "rk4-paper"
    assert np.isnan(row["sup_q"])
    assert row["failure"] == ball.reasons["rk4-paper"]


def test_steps_references_and_labels_can_be_given():
    problem = li.load_problem("system-1")
    exact = li.simulate(problem, "exact", dt=1e-2, t_end=1.0)
    for given in (exact, Reference(exact, exact.method)):
        found = li.compare(problem, {"mid": "moreau-jean", "end": MoreauJean(theta=1.0)}, dt={"mid": 1e-2, "end": 3e-3},
                           t_end=1.0, reference=given)  # fmt: skip
        table = found.table.set_index("method")
        assert table["steps"].to_dict() == {"mid": 100, "end": 334}
        assert (table["against"] == exact.method).all()
        assert table["sup_q"]["mid"] < 1e-2 < table["sup_q"]["end"] < 0.1


def test_a_wrong_run_shows():
    """The table is worth what it says of a method that is wrong: one with another θ has other errors."""
    found = li.compare(li.load_problem("system-1"), ["moreau-jean", MoreauJean(theta=1.0)], dt=1e-3)
    table = found.table
    assert list(table["method"]) == ["moreau-jean", "moreau-jean(theta=1.0)"]
    assert table["sup_q"][1] > 100.0 * table["sup_q"][0]
    assert table["l1_v"][1] > 100.0 * table["l1_v"][0]


@pytest.mark.parametrize(
    ("methods", "options", "match"),
    [
        (["no-such"], {"dt": 1e-2}, "unknown method 'no-such'"),
        (["moreau-jean", "moreau-jean"], {"dt": 1e-2}, "is listed twice"),
        (["moreau-jean"], {"dt": -1.0}, "moreau-jean: dt = -1.0 must be a positive"),
        (["moreau-jean"], {"dt": {"rk4": 1e-2}}, "dt: there is no step for 'moreau-jean'"),
        (["moreau-jean"], {"dt": {"moreau-jean": 1e-2, "rk4": 1e-2}}, "dt: there is no method 'rk4'"),
        (["moreau-jean"], {"dt": 1e-2, "t_end": 0.0}, "t_end = 0.0 must be a positive"),
        (
            ["moreau-jean"],
            {"dt": 1e-2, "reference": "exact"},
            "reference = 'exact' must be a Trajectory or a Reference or 'auto'",
        ),
        ({"reference": "rk4"}, {"dt": 1e-2}, "label 'reference' is that of the reference"),
    ],
)
def test_wrong_input_is_one_sentence(methods, options, match):
    with pytest.raises(li.InputError, match=match):
        li.compare(li.load_problem("system-1"), methods, **options)


def test_a_reference_that_ends_early_is_refused():
    problem = li.load_problem("system-1")
    short = li.simulate(problem, "exact", dt=1e-2, t_end=1.0)
    with pytest.raises(li.InputError, match="reference ends at 1 s, before t_end = 3 s"):
        li.compare(problem, ["moreau-jean"], dt=1e-2, reference=short)


# ---- pictures -------------------------------------------------------------------------------------------------------


def test_the_picture_of_a_comparison(three, ball, tmp_path):
    figure = three.plot(tmp_path / "three.svg")
    assert (tmp_path / "three.svg").stat().st_size > 10_000
    motion, force, difference = figure.axes
    assert difference.get_yscale() == "log"
    widths = [line.get_linewidth() for line in motion.get_lines()]
    assert max(widths) == widths[0] == 5.0
    # Forces of the methods are points where they live.
    drawn = next(line for line in force.get_lines() if line.get_marker() != "None")
    assert_allclose(drawn.get_xdata(), three.runs["moreau-jean"].t_reaction)
    assert drawn.get_linestyle() == "None"
    legend = [text.get_text() for text in figure.legends[0].get_texts()]
    assert legend == ["event-driven (reference)", "moreau-jean, $h=0.01$ s", "rk4-paper, $h=0.01$ s", "exact"]
    assert [ax.get_ylabel() for ax in ball.plot().axes] == [
        "$x$ [m], downwards", "impulse [N s]", "largest difference [m]"
    ]  # fmt: skip


def test_the_picture_of_nothing_says_so():
    found = li.compare(li.load_problem("bouncing-ball"), ["rk4-paper"], dt=1e-2, reference=None)
    assert found.plot().texts[0].get_text() == "no method reached the end"


def test_the_layers_of_a_ledger_reach_the_line(tmp_path):
    run = li.simulate(li.load_problem("system-3"), "exact", dt=1e-2, t_end=3.0)
    figure = li.energy_ledger(run).plot(tmp_path / "ledger.png")
    upper, lower = figure.axes
    top = upper.collections[-1].get_paths()[0].vertices[:, 1].max()
    assert_allclose(top, upper.get_lines()[0].get_ydata().max(), rtol=1e-9)
    assert lower.get_yscale() == "log"
    names = [text.get_text() for text in figure.legends[0].get_texts()]
    assert names == ["constant loads", "springs", "kinetic", "dashpot z to ground", "dashpot x to y", "at the start"]


# ---- the commands ---------------------------------------------------------------------------------------------------


def run(*arguments):
    with pytest.raises(SystemExit) as ended:
        main([str(each) for each in arguments])
    return ended.value.code


def test_the_command_compare_writes_everything(tmp_path, capsys):
    files = {name: tmp_path / f"{name}.csv" for name in ("out", "events", "forces", "energies")}
    options = [part for name, path in files.items() for part in (f"--{name}", path)]
    code = run(
        "compare", "system-1", "--methods", "moreau-jean,moreau-jean:theta=1",
        "--dt", "1e-2", *options, "--plot", tmp_path / "c.svg", "--report", tmp_path / "c.html",
    )  # fmt: skip
    said = capsys.readouterr().out
    assert code == 0
    assert "system-1, 2 methods against exact" in said
    assert list(pd.read_csv(files["out"])["method"]) == ["moreau-jean", "moreau-jean:theta=1"]
    assert len(pd.read_csv(files["forces"])) == 600
    assert "dashpot z to ground" in files["energies"].read_text(encoding="utf-8")
    page = (tmp_path / "c.html").read_text(encoding="utf-8")
    assert page.count("data:image/svg+xml") == 3
    assert "Energy: moreau-jean" in page
    assert "http" not in page.replace("http://www.w3.org", "")


def test_the_command_cross_validate_has_the_verdict_as_its_exit_code(tmp_path, capsys):
    report = tmp_path / "v.html"
    assert (
        run(
            "cross-validate",
            "system-1",
            "--routes",
            "exact,moreau-jean",
            "--out",
            tmp_path / "v.tex",
            "--report",
            report,
        )
        == 0
    )
    assert "system-1: 2 routes of 2 families agree" in capsys.readouterr().out
    assert "The routes agree." in report.read_text(encoding="utf-8")
    assert "toprule" in (tmp_path / "v.tex").read_text(encoding="utf-8")
    assert run("cross-validate", "system-1", "--routes", "exact") == 1
    assert "system-1: nothing to judge by" in capsys.readouterr().out
    assert run("cross-validate", "system-1", "--routes", "exact,event-driven", "--report", report) == 1
    assert "Nothing to judge by." in report.read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("arguments", "match"),
    [
        (["compare", "system-1", "--methods", "no-such"], "unknown method 'no-such'"),
        (["compare", "system-1", "--out", "x.doc"], "must end in one of .csv, .tex"),
        (["compare", "system-1", "--report", "x.pdf"], "must end in one of .html"),
        (["cross-validate", "system-1", "--routes", "no-such"], "unknown method 'no-such'"),
        (["cross-validate", "system-1", "--plot", "x.csv"], "must end in one of .png"),
        (["cross-validate", "system-1", "--tol", "3"], "tol = 3.0 must be a number between 0 and 1"),
    ],
)
def test_wrong_input_is_one_line_and_writes_nothing(arguments, match, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert run(*arguments) == 2
    assert match in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_three_views_of_one_impact_are_in_one_picture():
    problem = li.load_problem("bouncing-ball", e=0.8)
    views = li.compare(
        problem, ["moreau-jean", "event-driven"], dt=1e-3, t_end=0.7, penalties=[("kelvin-voigt", 1e6)], progress=False
    )
    soft = views.runs["kelvin-voigt, k=1e+06"]
    assert soft.method.startswith("event-driven")
    # The time between zeros of the force k x + c x' of a free mass, which the weight hardly changes.
    close, opened = (next(e.t for e in soft.events if e.kind == kind) for kind in ("close", "open"))
    zeta = soft.problem.scheme.elements[2].c / (2.0 * np.sqrt(1e6))
    assert_allclose(close, np.sqrt(2.0 / 9.81), rtol=1e-9)
    time = 1e-3 * 2.0 * np.arccos(zeta) / np.sqrt(1.0 - zeta**2)
    assert_allclose(opened - close, time, rtol=5e-3)
    coordinates, force, impulse, _ = views.plot().axes
    assert np.nanmax(force.get_lines()[-1].get_ydata()) == pytest.approx(soft["R"].max(), rel=1e-2)
    assert "impulse" in impulse.get_ylabel()
    assert len(coordinates.get_lines()) == 4
    by = views.forces()
    assert set(by["method"]) == set(views.runs)
    assert by.loc[by["method"] == "kelvin-voigt, k=1e+06", "r"].max() > 1000.0


def test_a_variant_is_run_by_the_method_beside_it():
    problem = li.load_problem("bouncing-ball", e=0.8)
    soft = li.penalized(problem, "hertz", k=1e7, e=1.0)
    views = li.compare(problem, {"rigid": "moreau-jean", "soft": (soft, "rk4")}, dt=1e-4, t_end=0.5, progress=False)
    assert [run.problem.name for run in views.runs.values()] == ["bouncing-ball", "bouncing-ball (hertz)"]
    assert "error of soft" in views.summary()


@pytest.mark.parametrize(
    ("methods", "said"),
    [
        ({"soft": ("bouncing-ball", "rk4")}, "a pair of a Problem and a method"),
        ({"two": (li.load_problem("system-3"), "rk4")}, "compare problems with the same coordinates"),
    ],
)
def test_a_variant_of_another_kind_is_refused(methods, said):
    with pytest.raises(li.InputError, match=said):
        li.compare(li.load_problem("bouncing-ball"), methods, dt=1e-3)


def test_a_method_below_the_axis_of_differences_is_named():
    ball = li.load_problem("bouncing-ball", e=0.5)
    figure = li.compare(ball, ["moreau-jean", "exact"], dt=1e-3, t_end=1.0, progress=False).plot()
    assert "exact below" in figure.axes[-1].texts[0].get_text()


def test_compliant_variants_are_compared_on_the_command_line(tmp_path, capsys):
    out = tmp_path / "views.csv"
    words = ["compare", "bouncing-ball", "--methods", "moreau-jean", "--penalty", "kelvin-voigt:1e6:e=0.8"]
    assert run(*words, "--t-end", 0.6, "--out", out, "--plot", tmp_path / "views.png", "--up") == 0
    assert list(pd.read_csv(out)["method"]) == ["moreau-jean", "kelvin-voigt, k=1e+06"]
    assert run(*words, "--penalty", "kelvin-voigt") == 2
    assert "LAW:K" in capsys.readouterr().err
