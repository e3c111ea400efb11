"""Sections, bifurcation diagrams and basins against closed forms; their pictures and their commands."""

import math
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose

import lcpimpact as li
from lcpimpact.cli.main import main
from lcpimpact.study.dynamics.diagrams import period_of
from lcpimpact.study.dynamics.sections import section_of

ω, ζ, e = 2.6, 0.05, 0.8
T = 2.0 * math.pi / ω
V = 0.5006724925491698
"""The speed at which the impact oscillator strikes its stop once a period."""


def oscillator(omega=ω, **more):
    return li.load_problem("shaw-holmes", omega=omega, **more)


def spring_and_mass(m=1.0, k=4.0, x0=0.7):
    return li.Problem("free", li.Scheme(li.Mass("x", m), li.Spring("x", "ground", k)), q0={"x": x0}, t_end=30.0)


# ---- sections -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("phase", [0.0, 0.3])
def test_the_stroboscope_sees_the_closed_form(phase):
    problem = li.load_problem("impact-oscillator")
    table = li.poincare(problem, li.Stroboscope(phase), skip=3, points=6).table
    t = (np.arange(3, 9) + (phase or 1.0)) * T
    assert_allclose(table["t"], t, rtol=1e-14)
    # A point at the very instant of an impact may show either side of it.
    if phase:
        q, v = problem.motion(t)
        assert_allclose(table[["x", "v_x"]], np.column_stack([q, v]), rtol=0, atol=1e-11)
    assert_allclose(table["speed"], V, rtol=1e-10)
    assert_allclose(table["phase"], phase, rtol=0, atol=1e-9)


@pytest.mark.parametrize(("side", "share"), [("left", 1.0), ("right", -e)])
def test_the_section_at_the_impacts(side, share):
    table = li.poincare(oscillator(), li.Impacts("R", side), skip=80, points=5).table
    assert_allclose(table["v_x"], share * V, rtol=1e-9)
    assert_allclose(table["speed"], V, rtol=1e-9)
    assert_allclose(table["x"], 0.0, rtol=0, atol=1e-12)
    assert_allclose(np.diff(table["t"]), T, rtol=1e-9)
    assert np.ptp(table["phase"]) < 1e-8


def test_the_ball_lands_on_the_table_as_its_closed_form_says():
    table = li.poincare(li.load_problem("vibrating-table"), "impact", points=5).table
    assert_allclose(table["speed"], 9.81 * 0.1 / 1.5, rtol=1e-10)


@pytest.mark.parametrize("direction", [1, -1, 0])
@pytest.mark.parametrize("level", [0.0, 0.3, 0.7 * (1.0 - 1e-9)])
def test_crossings_of_a_level_are_found_to_rounding(direction, level):
    table = li.poincare(spring_and_mass(), li.Crossing("x", level, direction), points=9, t_end=30.0).table
    # x = 0.7 cos 2t passes the level downwards at t = ±acos(level/0.7)/2 + n π.
    first, n = 0.5 * math.acos(level / 0.7), np.arange(10) * math.pi
    known = {-1: first + n, 1: math.pi - first + n, 0: np.sort(np.concatenate([first + n, math.pi - first + n]))}
    known = known[direction][known[direction] < 30.0][:9]
    within = 1e-12 + 1e-15 / math.sqrt(1.0 - (level / 0.7) ** 2)
    assert_allclose(table["t"], known, rtol=0, atol=within)
    assert_allclose(table["x"], level, rtol=0, atol=1e-13)
    assert (np.sign(table["v_x"]) == direction).all() or direction == 0


def test_crossings_of_a_velocity_and_of_a_gap():
    turning = li.poincare(spring_and_mass(), "v_x=0", points=8).table
    assert_allclose(turning["t"], 0.5 * math.pi * np.arange(1, 9), rtol=0, atol=1e-12)
    assert_allclose(np.abs(turning["x"]), 0.7, rtol=1e-14)
    G = 0.3 / math.hypot(1.0 - 0.8**2, 2.0 * ζ * 0.8)
    clear = oscillator(0.8, s=1.0, f=0.3, x0=0.0)
    gaps = li.poincare(clear, "R<0.5", skip=60, points=4).table
    assert_allclose(gaps["x"], 0.5, rtol=0, atol=1e-12)
    assert_allclose(gaps["v_x"], 0.8 * math.sqrt(G**2 - 0.25), rtol=1e-6)


def test_a_crossing_at_an_event_counts_once():
    problem = li.load_problem("bilinear-oscillator")
    half = problem.facts[1].value
    period = problem.facts[0].value
    table = li.poincare(problem, "x=0", points=6).table
    known = np.sort(np.concatenate([half + period * np.arange(3), period * np.arange(1, 4)]))
    assert_allclose(table["t"], known, rtol=1e-12)
    assert li.poincare(problem, "x>0", points=3).table["t"].tolist() == pytest.approx(
        (period * np.arange(1, 4)).tolist()
    )


def test_an_impact_is_no_crossing_of_the_velocity():
    # v jumps from V to -e V at the stop; it passes zero only where the mass turns.
    table = li.poincare(oscillator(), "v_x=0", skip=80, points=4).table
    assert (table["x"] < -0.1).all()
    assert_allclose(np.diff(table["t"]), T, rtol=1e-8)


@pytest.mark.parametrize("section", ["force:0.3", "impact", "x>-0.4"])
def test_a_method_that_steps_sees_nearly_the_same(section):
    exact = li.poincare(li.load_problem("impact-oscillator"), section, points=6).table
    steps = li.poincare(
        li.load_problem("impact-oscillator"), section, points=6, method="moreau-jean", dt=T / 4000
    ).table
    assert list(steps.columns) == list(exact.columns)
    assert_allclose(steps["t"], exact["t"], rtol=0, atol=2e-2)
    assert_allclose(steps[["x", "v_x"]], exact[["x", "v_x"]], rtol=0, atol=2e-2)


def test_a_run_that_is_too_short_has_fewer_points():
    assert len(li.poincare(oscillator(), "impact", points=50, t_end=10.0).table) == len(
        [each for each in li.simulate(oscillator(), "exact", dt=1.0, t_end=10.0).events if each.kind == "impact"]
    )
    assert len(li.poincare(oscillator(), "x>5", points=3, t_end=10.0).table) == 0


@pytest.mark.parametrize(
    ("problem", "section", "told", "message"),
    [
        (oscillator(), "fource", {}, "must read force"),
        (oscillator(), "force:x", {}, "must read force"),
        (oscillator(), "force:1.5", {}, "phase = 1.5 must be a fraction"),
        (oscillator(), "impact:S", {}, "unknown contact 'S'"),
        (oscillator(), "y=0", {}, "unknown series 'y'"),
        (oscillator(), "force", {"points": 0}, "points = 0 must be a whole number"),
        (oscillator(), "force", {"skip": 0.5}, "skip = 0.5 must be a whole number"),
        (oscillator(), "force", {"t_end": -1.0}, "t_end = -1.0 must be a positive finite number"),
        (oscillator(), "force", {"method": "moreau-jean", "dt": 0.0}, "dt = 0.0 must be a positive finite number"),
        (oscillator(), "force", {"theta": 1.0}, "unknown option of exact 'theta'"),
        (spring_and_mass(), "force", {}, "no force with a period"),
        (li.load_problem("bilinear-oscillator"), "impact", {}, "has no impacts"),
        (li.load_problem("hertz-impact"), "x=0", {}, "non-linear springs"),
        ("oscillator", "force", {}, "must be a Problem: get one from"),
    ],
)
def test_sections_that_cannot_be_are_refused_in_one_sentence(problem, section, told, message):
    with pytest.raises(li.LcpImpactError, match=message) as refusal:
        li.poincare(problem, section, **told)
    assert "\n" not in str(refusal.value)


def test_texts_of_sections():
    assert section_of("force") == li.Stroboscope(0.0)
    assert section_of("impact:R1") == li.Impacts("R1")
    assert section_of("x=-0.5") == li.Crossing("x", -0.5, 0)
    assert section_of("v_x<2e-1") == li.Crossing("v_x", 0.2, -1)
    for wrong in ({"side": "both"}, {"side": 1}):
        with pytest.raises(li.InputError, match="side"):
            li.Impacts(**wrong)
    with pytest.raises(li.InputError, match="direction"):
        li.Crossing("x", 0.0, 2)


def test_periods_of_sequences():
    cycle = np.array([[0.0, 1.0], [2.0, -1.0], [0.5, 0.0]])
    assert period_of(np.tile(cycle, (4, 1))) == 3
    assert period_of(np.tile(cycle[:1], (4, 1))) == 1
    assert period_of(np.tile(cycle, (4, 1)) + 1e-8 * np.arange(12)[:, None]) == 3
    assert period_of(np.tile(cycle, (4, 1)) + 1e-4 * np.arange(12)[:, None]) == 0
    assert period_of(cycle) == 0, "it must be seen twice"
    # A column of rounding does not hide the period of the others.
    noise = 1e-15 * np.random.default_rng(0).normal(size=12)
    assert period_of(np.column_stack([noise, np.tile([1.0, 2.0], 6)])) == 2


# ---- bifurcation diagrams -------------------------------------------------------------------------------------------


def test_the_period_doubles_where_the_multiplier_leaves_the_circle():
    values = [2.6, 2.64, 2.7, 2.74]
    table = li.bifurcation(oscillator, values, "impact", skip=250, points=16).table
    assert table.groupby("value")["period"].first().tolist() == [1, 1, 2, 4]
    assert (table["failure"] == "").all()
    stable = [li.periodic_orbit(oscillator(value), transient=20).stable for value in values[:3]]
    assert stable == [True, True, False]
    for value in values[:2]:
        known = li.load_problem("impact-oscillator", omega=value).facts[0].value
        assert_allclose(table.loc[table["value"] == value, "speed"], known, rtol=1e-7)


def test_runs_that_continue_each_other_begin_on_the_attractor():
    together = {"skip": 0, "points": 3, "continue_from": True}
    table = li.bifurcation(lambda f: oscillator(f=f, x0=-0.3), [1.0] * 40, **together).table
    last = table[table.index >= 37 * 3]
    assert_allclose(last["x"], last["x"].iloc[0], rtol=1e-9)
    # Impact sections end anywhere in a period; the next run begins at a whole one.
    struck = li.bifurcation(lambda f: oscillator(f=f, x0=-0.3), [1.0] * 40, "impact", **together).table
    assert_allclose(struck["speed"].iloc[-3:], V, rtol=1e-6)
    alone = li.bifurcation(lambda f: oscillator(f=f, x0=-0.3), [1.0], skip=0, points=3).table
    assert_allclose(table[["x", "v_x"]].iloc[:3], alone[["x", "v_x"]], rtol=1e-14)
    assert np.abs(alone["x"] - last["x"].iloc[0]).max() > 1e-3


def test_a_value_without_result_is_a_row_with_the_reason():
    study = li.bifurcation(lambda s: oscillator(s=s, x0=0.0), [-0.1, 0.1], skip=2, points=3)
    table = study.table
    assert table["value"].tolist() == [-0.1, 0.1, 0.1, 0.1]
    assert "beyond the stop" in table["failure"].iloc[0]
    assert table[["t", "x", "speed"]].iloc[0].isna().all()
    assert (table["failure"].iloc[1:] == "").all()
    none = li.bifurcation(lambda s: oscillator(s=s), [1.0], "impact", skip=2, points=3).table
    assert "does not meet the section" in none["failure"].iloc[0]
    assert len(study.failures) == 1


def test_threads_change_nothing():
    values = np.linspace(2.6, 2.7, 3)
    told = {"skip": 20, "points": 5}
    one, two = (li.bifurcation(oscillator, values, workers=workers, **told).table for workers in (None, 2))
    pd.testing.assert_frame_equal(one, two, check_exact=True)


@pytest.fixture
def side_by_side(monkeypatch):
    """The number of the runs that are alone, where 64 and more may be side by side."""
    from lcpimpact.study.dynamics import strobes
    from lcpimpact.sweeps import side_by_side

    alone, find = [], strobes.find_points
    monkeypatch.setattr(side_by_side, "WORTH_COMPILING", 64)
    monkeypatch.setattr(strobes, "find_points", lambda *args: alone.append(args[0]) or find(*args))
    return alone


@pytest.mark.parametrize(
    ("family", "values", "section", "skip", "every"),
    [
        pytest.param(oscillator, np.linspace(2.4, 2.75, 66), "force", 20, 13, id="frequency"),
        pytest.param(
            lambda e: oscillator(2.6, e=e), np.linspace(0.5, 0.9, 66), "force:0.253", 20, 13, id="restitution"
        ),
        pytest.param(
            lambda s: oscillator(2.6, s=s), np.linspace(-0.02, 0.02, 66), "force:0.532261", 1, 3, id="impacts-there"
        ),
    ],
)
def test_runs_side_by_side_have_the_points_of_runs_alone(family, values, section, skip, every, side_by_side):
    told = {"skip": skip, "points": 5, "method": "moreau-jean", "progress": False}
    table = li.bifurcation(family, values, section, **told).table
    assert len(side_by_side) < 20
    for value in values[::every]:
        known = li.poincare(family(value), section, **told).table
        found = table[table["value"] == value].reset_index(drop=True)
        pd.testing.assert_frame_equal(found[known.columns], known, check_exact=True)
    assert table["speed"].notna().any()


def test_a_value_that_is_refused_is_a_row_beside_runs_side_by_side(side_by_side):
    values = np.linspace(-0.05, 0.2, 100)
    study = li.bifurcation(
        lambda s: oscillator(s=s, x0=0.0), values, skip=2, points=3, method="moreau-jean", progress=False
    )
    refused = values < 0.0
    assert study.table.groupby("value").size().tolist() == [1 if each else 3 for each in refused]
    assert len(study.failures) == refused.sum()
    assert len(side_by_side) < 20


@pytest.mark.parametrize(
    ("values", "told", "message"),
    [([], {}, "values is empty"), ([2.6], {"points": 0}, "points = 0"), ([2.6], {"workers": 1.5}, "workers = 1.5")],
)
def test_diagrams_that_cannot_be_are_refused(values, told, message):
    with pytest.raises(li.InputError, match=message):
        li.bifurcation(oscillator, values, **told)


# ---- basins ---------------------------------------------------------------------------------------------------------


def between(x0, v0):
    """An oscillator that may strike its stop once in three periods, or stay clear of it."""
    return oscillator(2.3, s=0.3, f=1.16, e=0.6, x0=x0, v0=v0)


@pytest.fixture(scope="module")
def basins():
    return li.basins(between, [-1.5, -0.9, -0.268, 0.1], [0.01, 1.0], parameters=("x0", "v0"), longest=240)


def test_starts_are_told_by_where_they_lead(basins):
    G = 1.16 / math.hypot(1.0 - 2.3**2, 2.0 * ζ * 2.3)
    ψ = math.atan2(2.0 * ζ * 2.3, 1.0 - 2.3**2)
    clear = basins.attractors[basins.attractors["speed"].isna()]
    # The forced motion, in closed form, at the phase 0.
    assert_allclose(clear[["x", "v_x"]], [[G * math.cos(ψ), 2.3 * G * math.sin(ψ)]], rtol=0, atol=1e-3)
    label = int(clear["attractor"].iloc[0])
    near = basins.table[(basins.table["x0"] == -0.268) & (basins.table["v0"] == 0.01)]
    assert near["attractor"].tolist() == [label]
    # Each label is what a long run from that start shows.
    for start in basins.table.itertuples():
        long = li.poincare(between(start.x0, start.v0), skip=500, points=32).table
        period = period_of(long[["x", "v_x"]].to_numpy(), 1e-5)
        assert period == start.period or start.attractor == 0
        if start.attractor:
            points = basins.attractors.loc[basins.attractors["attractor"] == start.attractor, "x"]
            assert_allclose(np.sort(long["x"].iloc[:period]), np.sort(points), rtol=0, atol=1e-3)
    assert len(set(basins.table["attractor"]) - {0}) >= 2


def test_basins_by_steps_side_by_side_are_those_of_runs_alone(side_by_side, monkeypatch):
    from lcpimpact.sweeps import side_by_side as lanes

    grid = np.linspace(-1.5, 0.2, 9), np.linspace(-1.0, 1.0, 9)
    told = {"longest": 120, "tol": 1e-3, "method": "moreau-jean", "progress": False}
    found = li.basins(between, *grid, **told)
    assert len(side_by_side) < 20
    assert {1, 2} <= set(found.table["attractor"])
    monkeypatch.setattr(lanes, "MIN_SETS", 1000)
    alone = li.basins(between, *grid, **told)
    pd.testing.assert_frame_equal(found.table, alone.table, check_exact=True)
    pd.testing.assert_frame_equal(found.attractors, alone.attractors, check_exact=True)


def test_impacts_of_the_approach_are_none_of_the_attractor():
    found = li.basins(lambda x0, v0: oscillator(0.8, s=1.0, f=0.3, x0=x0, v0=v0), [0.9], [1.0])
    assert li.poincare(oscillator(0.8, s=1.0, f=0.3, x0=0.9, v0=1.0), "impact", points=1).table["speed"].iloc[0] > 0.5
    assert found.attractors["period"].tolist() == [1]
    assert found.attractors["speed"].isna().all()


def test_attractors_are_numbered_by_how_many_starts_they_draw(basins):
    shares = basins.attractors.drop_duplicates("attractor")["share"].tolist()
    assert shares == sorted(shares, reverse=True)
    counted = basins.table.loc[basins.table["attractor"] > 0, "attractor"].value_counts() / len(basins.table)
    assert_allclose(shares, counted.sort_index())


def test_a_start_without_result_is_a_row_with_the_reason():
    found = li.basins(between, [0.0, 0.5], [0.0], longest=8)
    assert found.table["attractor"].tolist() == [0, 0]
    assert "beyond the stop" in found.table["failure"].iloc[1]
    assert len(found.attractors) == 0
    with pytest.raises(li.InputError, match="must both hold values"):
        li.basins(between, [], [0.0])
    free = li.basins(lambda a, b: spring_and_mass(x0=a), [0.1], [0.0])
    assert "no force with a period" in free.table["failure"].iloc[0]


# ---- pictures -------------------------------------------------------------------------------------------------------


def test_pictures_show_the_points(basins, tmp_path):
    section = li.poincare(oscillator(2.8), "impact", skip=50, points=40)
    (ax,) = section.plot(tmp_path / "section.png").axes
    table = section.table
    assert_allclose(ax.lines[0].get_xdata(), table["phase"])
    assert_allclose(ax.lines[0].get_ydata(), table["v_x"])
    diagram = li.bifurcation(lambda s: oscillator(s=s, x0=0.0), [-0.1, 0.0, 0.1], "impact", skip=5, points=4)
    branch = li.continue_orbit(oscillator, [2.6, 2.7], transient=20)
    (ax,) = replace(diagram, branches=(branch,), parameter="s").plot(tmp_path / "diagram.svg").axes
    assert_allclose(ax.lines[0].get_ydata(), diagram.table["speed"])
    assert ax.get_xlabel() == "$s$ (dimensionless)"
    assert ax.get_title(loc="left") == "shaw-holmes by exact"
    shown = [np.isfinite(line.get_ydata()).sum() for line in ax.lines[1:3]]
    assert shown == [2, 1], "the full line reaches the first orbit that is not stable"
    (ax,) = basins.plot(tmp_path / "basins.pdf").axes
    grid = basins.table.pivot(index="v0", columns="x0", values="attractor").to_numpy()
    assert_allclose(np.asarray(ax.collections[0].get_array()).reshape(grid.shape), grid)
    assert [text.get_text() for text in ax.figure.legends[0].get_texts()][-1] == "attractor at phase 0"
    phase, circle = branch.orbits[0].plot(tmp_path / "orbit.png").axes
    μ = branch.orbits[0].floquet
    assert_allclose(circle.lines[1].get_xdata(), μ.real)
    assert "1 impact" in phase.get_title(loc="left")
    (impact,) = branch.orbits[0].impacts
    jump = phase.lines[1]
    assert_allclose(jump.get_xdata(), [impact.left.q[0], impact.right.q[0]], atol=1e-12)
    assert_allclose(sorted(jump.get_ydata()), sorted([impact.left.v[0], impact.right.v[0]]))
    assert {path.name for path in tmp_path.iterdir()} == {"section.png", "diagram.svg", "basins.pdf", "orbit.png"}


def test_pictures_that_cannot_be_are_refused():
    section = li.poincare(oscillator(), points=3)
    with pytest.raises(li.InputError, match="did you mean 'speed'"):
        section.plot(y="sped")
    with pytest.raises(li.InputError, match="has no points"):
        replace(section, table=section.table.iloc[:0]).plot()
    with pytest.raises(li.InputError, match="has no points"):
        li.bifurcation(lambda s: oscillator(s=s, x0=0.0), [-0.1]).plot()
    with pytest.raises(li.InputError, match="unknown coordinate"):
        li.periodic_orbit(oscillator(), transient=20).plot(node="y")


# ---- the command line -----------------------------------------------------------------------------------------------


def call(capsys, *arguments):
    with pytest.raises(SystemExit) as stop:
        main([str(each) for each in arguments])
    captured = capsys.readouterr()
    return stop.value.code, captured.out, captured.err


def test_the_commands_say_draw_and_write(capsys, tmp_path):
    def asked(name):
        return (
            "--out",
            tmp_path / f"{name}.csv",
            "--plot",
            tmp_path / f"{name}.svg",
            "--report",
            tmp_path / f"{name}.html",
        )

    code, said, _ = call(capsys, "poincare", "shaw-holmes", "--section", "impact", "--points", 4, *asked("section"))
    assert code == 0
    assert "4 points at impact; they repeat after 1" in said
    assert_allclose(pd.read_csv(tmp_path / "section.csv")["speed"], V, rtol=1e-9)

    told = ("--over", "omega=2.6:2.7:2", "--skip", 150, "--points", 8, "--orbit")
    code, said, _ = call(capsys, "bifurcation", "shaw-holmes", *told, *asked("diagram"))
    assert code == 0
    assert "1 values: points repeat after 2" in said
    assert len(pd.read_csv(tmp_path / "diagram.csv")) == 16

    code, said, _ = call(
        capsys, "basins", "shaw-holmes", "--over", "x0=-0.6:-0.2:2", "--over", "v0=0:0.5:2", *asked("basins")
    )
    assert code == 0
    assert "attractor 2: period 1, of 50.0% of the starts" in said, "beside one of period 3"
    assert sorted(pd.read_csv(tmp_path / "basins.csv")["period"]) == [1, 1, 3, 3]
    starts = ("--over", "x0=-0.6:-0.2:2", "--over", "v0=0:0.5:2")
    table = tmp_path / "steps.csv"
    code, _, _ = call(capsys, "basins", "shaw-holmes", *starts, "--method", "moreau-jean", "--dt", 0.01, "--out", table)
    assert code == 0
    by_steps = li.basins(
        lambda x0, v0: oscillator(x0=x0, v0=v0), [-0.6, -0.2], [0.0, 0.5], method="moreau-jean", dt=0.01
    )
    assert pd.read_csv(table)["period"].tolist() == by_steps.table["period"].tolist()

    code, said, _ = call(capsys, "orbit", "shaw-holmes", "--transient", 10, *asked("orbit"))
    assert code == 0
    assert "speed 0.50067249254" in said
    assert_allclose(pd.read_csv(tmp_path / "orbit.csv")["modulus"].prod(), e**2 * math.exp(-2 * ζ * T), rtol=1e-9)
    for name in ("section", "diagram", "basins", "orbit"):
        page = (tmp_path / f"{name}.html").read_text(encoding="utf-8")
        assert "data:image/svg+xml" in page
        assert (tmp_path / f"{name}.svg").read_text(encoding="utf-8").startswith("<?xml")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("poincare", "shaw-holmes", "--section", "fource"), "must read force"),
        (("poincare", "shaw-holmes", "--solver", "lemk"), "did you mean 'lemke'"),
        (("poincare", "system-1", "--section", "x>0", "--method", "rk4-paper", "--solver", "lemke"), "solves no LCP"),
        (
            ("bifurcation", "system-1", "--over", "k_o=1:2:2", "--method", "rk4-paper", "--solver", "lemke"),
            "solves no LCP",
        ),
        (("bifurcation", "shaw-holmes", "--over", "omega=1:2"), "must read NAME=LOW:HIGH:COUNT"),
        (("bifurcation", "shaw-holmes", "--set", "omega=1:2"), "must read NAME=LOW:HIGH:COUNT"),
        (("bifurcation", "shaw-holmes"), "a diagram needs one"),
        (("bifurcation", "shaw-holmes", "--over", "omga=1:2:3"), "did you mean 'omega'"),
        (("basins", "shaw-holmes", "--over", "x0=-1:0:2"), "a plane needs two"),
        (("basins", "shaw-holmes", "--over", "x0=-1:0:2", "--over", "x0=-1:0:2"), "given twice"),
        (("basins", "shaw-holmes", "--over", "x0=-1:0:2000", "--over", "v0=-1:0:2000"), "take fewer"),
        (("orbit", "hertz-impact"), "non-linear springs"),
        (("orbit", "bouncing-ball"), "the impacts of R accumulate, so the run shows no period"),
        (("orbit", "bouncing-ball", "--over", "e=0.5:0.8:3"), "the impacts of R accumulate"),
        (("orbit", "shaw-holmes", "--over", "zeta=0.1:0.1:0"), "must read NAME=LOW:HIGH:COUNT"),
    ],
)
def test_wrong_input_is_one_line_and_nothing_is_written(capsys, tmp_path, arguments, message):
    code, _, said = call(capsys, *arguments, "--out", tmp_path / "table.csv")
    assert code == 2
    assert message in said
    assert said.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_a_diagram_without_a_single_result_is_one_line_and_writes_nothing(capsys, tmp_path):
    code, _, said = call(
        capsys,
        "bifurcation",
        "system-1",
        "--over",
        "k_o=1:2:3",
        "--out",
        tmp_path / "a.csv",
        "--plot",
        tmp_path / "a.svg",
    )
    assert code == 1
    assert "no value of k_o has a result: system-1 has no force with a period" in said
    assert "Traceback" not in said
    assert list(tmp_path.iterdir()) == []
    table = li.bifurcation(lambda k: li.load_problem("system-1", k_o=k), [1.0, 2.0]).table
    assert table["period"].isna().all()
    assert table["failure"].str.startswith("system-1 has no force").all()


def test_no_orbit_is_found_in_impacts_that_accumulate():
    with pytest.raises(li.InputError, match="impacts of R accumulate"):
        li.periodic_orbit(li.load_problem("bouncing-ball"))
    with np.errstate(all="raise"), pytest.raises(li.FailureError, match="no periodic orbit found"):
        li.periodic_orbit(li.load_problem("bouncing-ball"), T=0.9)
    assert li.periodic_orbit(li.load_problem("bouncing-ball", e=1.0)).residual < 1e-12


def test_names_of_outputs_are_looked_at_before_the_work(capsys, tmp_path):
    for option, name in (("--out", "a.xls"), ("--plot", "a.bmp"), ("--report", "a.pdf")):
        code, _, said = call(
            capsys, "bifurcation", "shaw-holmes", "--over", "omega=1:2:100000", option, tmp_path / name
        )
        assert code == 2
        assert "must end in" in said


def test_another_start_of_the_same_orbit(capsys):
    started = replace(oscillator(), q0={"x": -0.6}, v0={"x": 0.1})
    assert_allclose(li.periodic_orbit(started).speeds, V, rtol=1e-12)
