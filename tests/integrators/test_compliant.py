"""Compliant contacts, the non-linear springs of a scheme, have a force by a name and events, as rigid contacts have."""

import csv
import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

import lcpimpact as li
from lcpimpact.integrators import METHODS
from lcpimpact.reading import peak
from lcpimpact.study.accuracy.norms import error_norms

M, K, V0, AT = 2.0, 5e4, 3.0, 0.6
"""A mass that flies to a stop at the distance AT, without gravity."""

OMEGA = math.sqrt(K / M)


def thrown(c=0.0, **options):
    scheme = li.Scheme(li.Mass("x", M), li.KelvinVoigtStop("x", "ground", K, c, gap=AT, name="S"))
    return li.Problem("thrown", scheme, v0={"x": V0}, t_end=0.25, **options)


def refused(name, problem):
    try:
        li.simulate(problem, name, dt=1e-3, t_end=1e-3, progress=False)
    except li.UnsupportedError:
        return True
    return False


COMPLIANT = [name for name in METHODS if not refused(name, thrown())]


@pytest.mark.parametrize("name", COMPLIANT)
def test_every_method_has_the_force_and_the_instants_of_an_elastic_contact(name):
    run = li.simulate(thrown(), name, dt=1e-4, t_end=0.25, progress=False)
    assert [(event.contact, event.kind) for event in run.events] == [("S", "close"), ("S", "open")]
    close, opening = (event.t for event in run.events)
    assert_allclose(close, AT / V0, rtol=1e-12)
    assert_allclose(opening - close, math.pi / OMEGA, rtol=5e-4)
    assert run["S"].shape == run.t_reaction.shape
    t = run.t_reaction - AT / V0
    truth = np.where((t > 0.0) & (t < math.pi / OMEGA), V0 * math.sqrt(K * M) * np.sin(OMEGA * t), 0.0)
    assert_allclose(run["S"], truth, atol=0.02 * truth.max())
    weights = run.t[1:] - run.t[:-1] if len(t) < len(run.t) else np.gradient(run.t)
    assert_allclose((weights * run["S"]).sum(), 2.0 * M * V0, rtol=5e-3)


@pytest.mark.parametrize("name", COMPLIANT)
def test_a_stop_with_a_dashpot_opens_where_its_force_ends_and_not_where_bodies_part(name):
    ζ = 0.2
    run = li.simulate(thrown(2.0 * ζ * math.sqrt(K * M)), name, dt=2e-5, t_end=0.25, progress=False)
    assert [event.kind for event in run.events] == ["close", "open"]
    close, opening = (event.t for event in run.events)
    assert_allclose(close, AT / V0, rtol=1e-7)
    assert_allclose(opening - close, 2.0 * math.acos(ζ) / (OMEGA * math.sqrt(1.0 - ζ**2)), rtol=1e-2)
    assert run["S"].min() == 0.0
    assert run.events[1].left.q[0] > AT, "the stop is still pressed"


def test_event_driven_locates_closings_and_openings_to_its_tolerance():
    ζ = 0.2
    run = li.simulate(thrown(2.0 * ζ * math.sqrt(K * M)), "event-driven", dt=0.05, t_end=0.25, rtol=1e-12)
    close, opening = run.events
    assert_allclose(close.t, AT / V0, rtol=1e-14)
    assert_allclose(opening.t - close.t, 2.0 * math.acos(ζ) / (OMEGA * math.sqrt(1.0 - ζ**2)), rtol=1e-10)
    assert_allclose(opening.right.v[0], -V0 * math.exp(-OMEGA * ζ * (opening.t - close.t)), rtol=1e-10)
    assert_allclose(close.left.q, close.right.q, rtol=1e-14)
    smooth = li.simulate(
        thrown(2.0 * ζ * math.sqrt(K * M)), "event-driven", dt=0.05, t_end=0.25, rtol=1e-12, kinks=False
    )
    assert_allclose([each.t for each in smooth.events], [close.t, opening.t], rtol=1e-9)


@pytest.mark.parametrize("law", [("kelvin-voigt", {}), ("hunt-crossley", {"v0": 4.43})])
def test_a_law_has_the_name_and_the_events_of_the_bumper_that_it_replaces(law):
    rigid = li.load_problem("bouncing-ball", e=0.8)
    soft = li.penalized(rigid, law[0], k=1e7, **law[1])
    truth = li.simulate(rigid, "exact", dt=0.01, t_end=2.0)
    run = li.simulate(soft, "event-driven", dt=0.01, t_end=2.0)
    assert run.reaction.shape == (len(run.t_reaction), 0), "the reactions are those of rigid contacts"
    assert run.names == ("x", "v_x", "R")
    assert [event.kind for event in run.events] == ["close", "open"] * 3
    found = error_norms(run, truth, ["event_times", "impulses"])
    assert (
        found["event_times"] == max(abs(a.t - b.t) for a, b in zip(run.events[::2], truth.events, strict=True)) < 0.05
    )
    assert math.isnan(found["impulses"]), "a law that takes time has no impulse to compare"


def test_a_rope_that_is_replaced_keeps_its_tension():
    scheme = li.Scheme(li.Mass("x", 1.0), li.Load("x", 9.81), li.Rope("ground", "x", slack=1.0, e=0.5))
    run = li.simulate(
        li.penalized(li.Problem("rope", scheme), "kelvin-voigt", k=1e5), "event-driven", dt=1e-3, t_end=0.6
    )
    assert_allclose(run.events[0].t, math.sqrt(2.0 / 9.81), rtol=1e-9)
    assert run.events[0].contact == "T"
    assert run["T"].max() > 100.0


def test_systems_with_a_massless_plate_have_the_events_of_the_rigid_motion():
    rigid = li.load_problem("system-1")
    truth = li.simulate(rigid, "exact", dt=1e-3, t_end=3.0)
    run = li.simulate(
        li.penalized(rigid, "kelvin-voigt", k=1e7), "event-driven", dt=1e-3, t_end=3.0, ode_solver="Radau"
    )
    assert [(e.contact, e.kind) for e in run.events] == [(e.contact, e.kind) for e in truth.events]
    assert error_norms(run, truth, ["event_times"])["event_times"] < 5e-3
    assert abs(run["R"].max() / truth["R"].max() - 1.0) < 1e-2


def test_what_is_touched_at_the_start_is_closed_there_as_of_any_contact():
    problem = li.load_problem("hertz-impact")
    for name in ("event-driven", "moreau-jean", "rk4"):
        run = li.simulate(problem, name, dt=problem.t_end / 400, t_end=problem.t_end)
        assert [event.kind for event in run.events] == ["open"]
        assert_allclose(run.events[0].t, problem.facts[1].value, rtol=1e-3 if name != "event-driven" else 1e-8)
        assert_allclose(peak(run, "F"), problem.facts[2].value, rtol=1e-2 if name != "event-driven" else 1e-7)


def test_a_body_that_rests_on_a_stop_or_hangs_at_it_makes_no_events():
    rest = li.Scheme(li.Mass("x", 1.0), li.Load("x", 9.81), li.HertzSpring("x", "ground", K=1e6))
    held = (9.81 / 1e6) ** (2.0 / 3.0)
    just = li.Scheme(
        li.Mass("x", 1.0), li.Load("x", 0.3), li.Spring("x", "ground", k=3.0),
        li.KelvinVoigtStop("x", "ground", 1e5, 30.0, gap=0.1),
    )  # fmt: skip
    for scheme, q0 in ((rest, held), (just, 0.3 / 3.0)):
        problem = li.Problem("rest", scheme, q0={"x": q0})
        for name in ("event-driven", "moreau-jean", "dopri5"):
            assert li.simulate(problem, name, dt=1e-3, t_end=5.0).events == ()


def test_springs_without_a_name_are_numbered_and_two_of_one_name_are_refused():
    a, b = li.HertzSpring("x", "ground", K=1e5), li.HertzSpring("ground", "x", K=1e5, gap=1.0)
    several = li.Scheme(li.Mass("x", 1.0), a, b, li.HuntCrossley("x", "ground", K=1.0, b=1.0, name="H"))
    assert [each.name for each in several.assemble().forces] == ["F", "F_2", "H"]
    slips = li.Scheme(li.Mass("x", 1.0), li.Slider("x", "ground", 1.0), a).assemble()
    assert [each.name for each in slips.forces] == ["F", "F_2"]
    twice = [li.HertzSpring("x", "ground", K=1e5, name="R"), li.Bumper("x", "ground", gap=1.0, e=0.0, name="R")]
    with pytest.raises(
        li.InputError, match=r"the force of HertzSpring .* and the reaction of Bumper .* have the same name 'R'"
    ):
        li.Scheme(li.Mass("x", 1.0), *twice).assemble()
    with pytest.raises(li.InputError, match="name = 3 must be a string"):
        li.HertzSpring("x", "ground", K=1e5, name=3)


def test_saved_files_tables_and_pictures_show_the_force(tmp_path):
    soft = li.penalized(li.load_problem("bouncing-ball", e=0.8), "kelvin-voigt", k=1e5)
    run = li.simulate(soft, "moreau-jean", dt=1e-3, t_end=0.6)
    with run.save(tmp_path / "run.csv").open(encoding="utf-8") as file:
        header, *rows = csv.reader(file)
    column = [float(row[header.index("R")]) for row in rows if row[header.index("t_R")]]
    assert_allclose(column, run["R"])
    assert header[-2:] == ["t_R", "R"]
    with np.load(run.save(tmp_path / "run.npz")) as stored:
        assert_allclose(stored["push"][:, 0], run["R"])
        assert stored["event_kind"].tolist() == ["close", "open"]
    assert "R           at most" in repr(run)
    assert [ax.get_ylabel() for ax in run.plot().axes] == ["$x$ [m], downwards", "mean force of a step [N]"]
    both = li.compare(soft, ["moreau-jean", "event-driven"], dt=1e-4, t_end=0.6)
    table = both.forces()
    assert set(table["contact"]) == {"R"}
    assert table[table["method"] == "moreau-jean"]["r"].max() > 1000.0
    assert list(both.events()["kind"]) == ["close", "open"]


def test_an_infinite_speed_ends_a_run_and_not_the_search_for_events():
    scheme = li.Scheme(li.Mass("x", 1.0), li.HertzSpring("x", "ground", K=1e30, n=2.0))
    problem = li.Problem("blow", scheme, q0={"x": 1.0}, v0={"x": 1e9})
    for name in COMPLIANT:
        run = li.simulate(problem, name, dt=0.1, t_end=1.0, throw=False, progress=False)
        assert all(run.t[0] <= event.t <= run.t[-1] for event in run.events)
