"""The energy ledger closes, and each of its columns is what closed forms and hand-written integrals say."""

import dataclasses

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose
from random_schemes import frictional, random_problem
from scipy.integrate import solve_ivp

import lcpimpact as li
from lcpimpact.certificate.energy import INFLOWS, STORED, Account, Sinks
from lcpimpact.integrators import METHODS
from lcpimpact.scheme.elements.base import Compound


def ledger_of(name, method="exact", points=1000, t_end=None, options=None, **parameters):
    problem = li.load_problem(name, **parameters)
    end = problem.t_end if t_end is None else t_end
    run = li.simulate(problem, method, dt=end / points, t_end=end, progress=False, **(options or {}))
    return li.energy_ledger(run)


def initial_energy(ledger):
    first = ledger.table.iloc[0]
    return first["kinetic"] + first["elastic"]


# ---- it closes ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "parameters"), [("system-1", {}), ("system-2", {}), ("system-3", {}), ("system-3", {"c": 60.0})]
)
def test_systems_1_to_3_close_to_1e_10_of_the_initial_energy(name, parameters):
    ledger = ledger_of(name, **parameters)
    assert ledger.closes
    assert initial_energy(ledger) == pytest.approx(4905.0)
    assert ledger.balance < 1e-10 * initial_energy(ledger)


CLOSED = ("bouncing-ball", "impact-oscillator", "coulomb-oscillator", "jenkins-cycle", "vibrating-table", "newtons-cradle",
          "two-ball-drop", "hereditary-impact", "maxwell-impact", "rocking-block")  # fmt: skip


@pytest.mark.parametrize("name", CLOSED)
@pytest.mark.parametrize("method", ["exact", "moreau-jean"])
def test_it_closes_to_rounding_where_that_is_promised(name, method):
    ledger = ledger_of(name, method)
    promised = method == "exact" or name not in ("jenkins-cycle", "maxwell-impact")
    assert ledger.closes == promised
    if promised:
        assert ledger.balance < 1e-12 * ledger.scale
    assert "θ = 0.5" in ledger.promise or method == "exact"


@pytest.mark.slow
@pytest.mark.parametrize("name", ["bar-impact", "bouncing-bar", "plastic-bar-impact"])
def test_bars_close(name):
    """Bars of ten elements; the exact motion of a hundred takes a minute."""
    ledger = ledger_of(name, elements=10.0)
    assert ledger.balance < 2e-10 * ledger.scale


@pytest.mark.parametrize("name", ["system-1", "system-2", "bouncing-ball", "vibrating-table", "hunt-crossley-impact"])
@pytest.mark.parametrize("theta", [0.5, 0.7, 1.0])
def test_the_balance_of_a_step_is_that_of_the_certificate(name, theta):
    problem = li.load_problem(name)
    run = li.simulate(problem, dt=problem.t_end / 1000, t_end=problem.t_end, theta=theta)
    ledger = li.energy_ledger(run)
    assert_allclose(ledger.balance, run.certificate.energy_balance, rtol=1e-6, atol=1e-12 * ledger.scale)
    if theta > 0.5:
        assert ledger.balance > 1e-6 * ledger.scale
        assert not ledger.closes


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(
    "name", ["system-1", "bouncing-ball", "impact-oscillator", "vibrating-table", "coulomb-oscillator"]
)
def test_the_certificate_is_the_sum_of_the_ledger(name, method):
    problem = li.load_problem(name)
    try:
        run = li.simulate(problem, method, dt=problem.t_end / 300, t_end=problem.t_end, throw=False, progress=False)
    except li.UnsupportedError as refused:
        pytest.skip(str(refused))
    ledger = li.energy_ledger(run)
    # Of a continuous solution the ledger integrates from grid point to grid point, the certificate from cut to cut.
    atol = (1e-13 if run.dense is None else 1e-8) * ledger.scale
    assert_allclose(ledger.balance, run.certificate.energy_balance, rtol=1e-9, atol=atol)


@pytest.mark.parametrize("method", ["rk4", "generalized-alpha", "rattle-ns", "schatzman-paoli", "moreau-midpoint"])
def test_others_close_as_their_steps_shrink(method):
    coarse, fine = (ledger_of("impact-oscillator", method, points) for points in (1009, 8009))
    assert fine.balance < 0.4 * coarse.balance
    assert fine.balance < 2e-3 * fine.scale
    assert not fine.closes


def test_loads_work_along_positions_which_have_no_jumps_in_an_impact():
    assert ledger_of("impact-oscillator", "rk4", 200).balance < 5e-3


def test_an_impact_at_the_start_comes_before_the_ledger():
    ball = li.Scheme(li.Mass("x", 1.0), li.Load("x", -9.81), li.Bumper("ground", "x", e=0.5, name="R"))
    run = li.simulate(li.Problem("thrown down", ball, v0={"x": -2.0}), "rk4", dt=1e-2, t_end=0.15, progress=False)
    ledger = li.energy_ledger(run)
    assert run.events[0].t == 0.0
    assert ledger.table["impact R"].iloc[-1] == 0.0
    assert ledger.balance < 1e-12


def shaken(contact):
    """A ball on a table that shakes, with a compliant contact."""
    scheme = li.Scheme(
        li.Mass("x", 1.0), li.Load("x", -9.81), li.PrescribedMotion("y", li.Harmonic(0.1, 20.0)), contact
    )  # fmt: skip
    return li.Problem("shaken", scheme, q0={"x": 0.4})


def test_a_compliant_contact_takes_work_from_a_prescribed_motion():
    ledger = li.energy_ledger(
        li.simulate(
            shaken(li.HuntCrossley("y", "x", K=2e3, n=1.5, b=0.2)),
            "event-driven",
            dt=1e-2,
            t_end=1.0,
            rtol=1e-11,
            progress=False,
        )
    )
    assert np.ptp(ledger.table["motions"]) > 1.0
    assert ledger.balance < 1e-8 * ledger.scale
    assert ledger.table["gravity"].iloc[0] == 0.0


def test_the_steps_of_a_compliant_contact_that_opens_and_closes_are_those_of_the_certificate():
    run = li.simulate(shaken(li.KelvinVoigtStop("y", "x", k=2e3, c=20.0)), dt=5e-3, t_end=1.0, progress=False)
    ledger = li.energy_ledger(run)
    assert_allclose(ledger.balance, run.certificate.energy_balance, rtol=1e-9)


def test_forces_of_steps_drive_too():
    """Forces that belong to steps and a motion that is given, integrated by trapezoids."""
    coarse, fine = (ledger_of("jenkins-cycle", "radau", points) for points in (1009, 8009))
    assert fine.balance < 0.3 * coarse.balance
    assert fine.balance < 1e-3 * fine.scale


def test_the_tolerance_of_event_driven_is_that_of_its_ledger():
    ledger = ledger_of("hunt-crossley-impact", "event-driven")
    assert ledger.balance < 1e-7 * ledger.scale
    assert ledger.dissipated == ("HuntCrossley x to ground",)


# ---- its columns are right ------------------------------------------------------------------------------------------


def test_each_bounce_of_a_ball_takes_its_share():
    e = 0.8
    table = ledger_of("bouncing-ball", e=e, t_end=3.0).table
    before = table[table["t"].duplicated(keep="last")]
    after = table[table["t"].duplicated(keep="first")]
    assert len(before) == len(after) >= 5
    lost = after["impact R"].to_numpy() - before["impact R"].to_numpy()
    assert_allclose(lost, (1.0 - e**2) * before["kinetic"].to_numpy(), rtol=1e-9)
    assert_allclose(after["kinetic"].to_numpy(), e**2 * before["kinetic"].to_numpy(), rtol=1e-9)
    # By hand: the potential of the load is what the ball fell by.
    m, g, x = 1.0, 9.81, 1.0
    assert_allclose(before["gravity"], -m * g * x, rtol=1e-12)


def test_dry_friction_takes_4_F_X_a_cycle():
    problem = li.load_problem("coulomb-oscillator")
    p = problem.parameters
    ω = np.sqrt(p["k"] / p["m"])
    run = li.simulate(problem, "exact", dt=problem.t_end / 1000, t_end=problem.t_end)
    slips = li.energy_ledger(run).table
    force = problem.dynamics.contacts[0].bounds[1]
    # Half a cycle after another the turning points come nearer by 2 F/k; friction is force times way.
    half = np.pi / ω
    turns = [np.interp(n * half, run.t, run.q[:, 0]) for n in range(3)]
    way = np.abs(np.diff(turns)).sum()
    assert_allclose(np.interp(2 * half, slips["t"], slips["slider F"]), force * way, rtol=1e-4)
    assert_allclose(turns[0] + turns[1], np.sign(turns[0]) * 2.0 * force / p["k"], rtol=1e-3)


def test_a_jenkins_cycle_encloses_4_f_y_times_the_plastic_way():
    problem = li.load_problem("jenkins-cycle")
    table = ledger_of("jenkins-cycle").table
    p = problem.parameters
    T = 2.0 * np.pi / problem.dynamics.motions[0].omega if 0 in problem.dynamics.motions else None
    T = T or 2.0 * np.pi / next(iter(problem.dynamics.motions.values())).omega
    lost = np.interp([T, 2.0 * T], table["t"], table["slider F"])
    assert_allclose(lost[1] - lost[0], 4.0 * p["f_y"] * (p["X"] - p["f_y"] / p["k"]), rtol=1e-6)
    came = np.interp([T, 2.0 * T], table["t"], table["motions"])
    assert_allclose(came[1] - came[0], lost[1] - lost[0], rtol=1e-6)


def test_a_kelvin_voigt_impact_takes_what_its_restitution_says():
    problem = li.load_problem("kelvin-voigt-impact")
    run = li.simulate(problem, "exact", dt=problem.t_end / 1000, t_end=problem.t_end)
    opened = next(event for event in run.events if event.kind == "open")
    table = li.energy_ledger(run).table
    e = -opened.left.v[0] / run.v[0, 0]
    assert 0.1 < e < 0.9
    p = problem.parameters
    # What the plate still holds when the mass leaves is lost to its dashpot later.
    assert_allclose(table["kinetic"].iloc[-1], e**2 * 0.5 * p["m"] * run.v[0, 0] ** 2, rtol=1e-12)
    left = table.iloc[-1]
    assert_allclose(left["dashpot z to ground"] + left["elastic"], (1.0 - e**2) * table["kinetic"].iloc[0], rtol=1e-10)


def test_columns_against_an_integration_by_hand():
    """An oscillator between two dashpots under a varying and a constant load, integrated by SciPy with its powers."""
    m, k, c1, c2, F, a, ω = 2.0, 50.0, 0.7, 1.9, 3.0, 4.0, 5.0
    scheme = li.Scheme(
        li.Mass("x", m), li.KelvinVoigt("x", "ground", k, c1), li.Dashpot("x", "ground", c2), li.Load("x", 0.25 * F),
        li.Load("x", 0.75 * F),
        li.Load("x", li.Harmonic(a, ω)),
    )  # fmt: skip

    def right(t, y):
        v = y[1]
        f = a * np.cos(ω * t)
        return [v, (F + f - k * y[0] - (c1 + c2) * v) / m, c1 * v**2, c2 * v**2, f * v]

    by_hand = solve_ivp(right, (0.0, 3.0), [0.0, 1.0, 0.0, 0.0, 0.0], rtol=1e-12, atol=1e-13).y[:, -1]
    problem = li.Problem("two dashpots", scheme, v0={"x": 1.0})
    for method, rtol in (("exact", 1e-9), ("moreau-jean", 1e-5), ("rk4", 1e-5)):
        ledger = li.energy_ledger(li.simulate(problem, method, dt=1e-3, t_end=3.0))
        assert ledger.dissipated == ("dashpot x to ground", "dashpot x to ground 2")
        last = ledger.table.iloc[-1]
        found = [last["dashpot x to ground"], last["dashpot x to ground 2"], last["loads"], last["gravity"]]
        assert_allclose(found, [*by_hand[2:], -F * by_hand[0]], rtol=rtol)
        assert last["motions"] == 0.0


def test_a_table_that_is_driven_pays_for_what_the_ball_loses():
    """One impact of a ball on a table that moves: the driver's impulse does work."""
    g, e, table = 9.81, 0.4, li.Harmonic(0.1, 8.0)
    scheme = li.Scheme(
        li.Mass("x", 1.0), li.Load("x", g), li.PrescribedMotion("y", table), li.Bumper("x", "y", gap=0.8, e=e)
    )
    run = li.simulate(li.Problem("lift", scheme), "exact", dt=1e-2, t_end=0.5)
    (event,) = run.events
    w = table.rate(event.t)
    assert abs(w) > 0.05
    last = li.energy_ledger(run).table.iloc[-1]
    assert_allclose(last["impact R"], 0.5 * (1.0 - e**2) * (g * event.t - w) ** 2, rtol=1e-9)
    assert_allclose(last["motions"], -(1.0 + e) * (g * event.t - w) * w, rtol=1e-9)


@pytest.mark.parametrize("make", [random_problem, frictional])
def test_what_each_element_takes_adds_up_to_what_the_system_dissipates(make):
    rng, tried, dashpots = np.random.default_rng(7), 0, 0
    for seed in range(60):
        try:
            problem = make(seed)
            d = problem.dynamics
        except li.InputError:
            continue
        q, v = rng.normal(size=(2, 20, len(d.nodes)))
        r = rng.normal(size=(20, len(d.contacts)))
        sinks, t = Sinks.by_element(problem), np.linspace(0.0, 1.0, 20)
        account, whole = Account(d, sinks), Account(d, Sinks.all_as_one(d))
        lost, contacts = account.powers(t, q, v, 0.0 * r)[:, 2:], account.of_contacts(t, q, v, r)[:, 2:]
        assert_allclose(
            lost.sum(axis=1),
            np.einsum("ki,ki->k", v @ d.C, v) + d.spring_losses(q, v).sum(axis=1),
            rtol=1e-12,
            atol=1e-12,
        )
        assert_allclose(contacts.sum(axis=1), -(r * (v @ d.H.T)).sum(axis=1), rtol=1e-12, atol=1e-12)
        powers, total = account.powers(t, q, v, r), whole.powers(t, q, v, r)
        assert_allclose(np.column_stack([powers[:, :2], powers[:, 2:].sum(axis=1)]), total, rtol=1e-12, atol=1e-9)
        drives = q @ d.K.T + v @ d.C.T - r @ d.B.T - d.force(t) - d.spring_force(q, v)
        assert_allclose(powers[:, 1], (drives * v)[:, d.driven].sum(axis=1), rtol=1e-12, atol=1e-9)
        assert len(set(sinks.names)) == len(sinks.names)
        tried += 1
        dashpots += len(sinks.dashpots) + len(d.springs)
    assert tried > 20
    assert dashpots > 40


@pytest.mark.parametrize("make", [random_problem, frictional])
def test_random_schemes_close(make):
    closed = 0
    for seed in range(12):
        try:
            problem = make(seed)
            run = li.simulate(problem, "exact", dt=1e-2, t_end=1.0)
        except (li.InputError, li.UnsupportedError):
            continue
        ledger = li.energy_ledger(run)
        assert ledger.balance < 1e-10 * ledger.scale
        lost = ledger.table[list(ledger.dissipated)]
        assert (lost.diff().fillna(0.0) > -1e-9 * ledger.scale).all(axis=None)
        closed += 1
    assert closed >= 5


def test_all_elements_with_a_dashpot_within_are_seen():
    scheme = li.Scheme(
        li.Mass("x", 1.0), li.Maxwell("x", "ground", 10.0, 1.0), li.Zener("x", "ground", 5.0, 3.0, 0.5, name="Z"),
        li.GeneralizedMaxwell("x", "ground", 0.0, (1.0, 2.0), (0.1, 1.0), name="G"),
        li.HuntCrossley("x", "ground", K=100.0, n=1.5, b=0.2), li.HertzSpring("x", "ground", K=10.0, n=1.5),
    )  # fmt: skip
    names = Sinks.by_element(li.Problem("all", scheme)).names
    assert names[1:] == (
        "dashpot Z.1 to ground",
        "dashpot G.1 to ground",
        "dashpot G.2 to ground",
        "HuntCrossley x to ground",
    )
    assert names[0].startswith("dashpot")


@dataclasses.dataclass(frozen=True)
class Twin(Compound):
    """Two Kelvin-Voigt blocks in series, an element of elements of elements."""

    def parts(self):
        return (li.KelvinVoigt("x", "m", 3.0, 0.5), li.KelvinVoigt("m", "ground", 5.0, 0.7))

    @property
    def nodes(self):
        return ("x", "m", "ground")


def test_elements_within_elements_within_elements_are_seen():
    problem = li.Problem("twin", li.Scheme(li.Mass("x", 1.0), Twin()))
    assert Sinks.by_element(problem).names == ("dashpot x to m", "dashpot m to ground")


# ---- the table ------------------------------------------------------------------------------------------------------


def test_the_table_adds_up_and_can_be_written():
    ledger = ledger_of("system-3")
    table = ledger.table
    assert list(table.columns) == ["t", *STORED, *INFLOWS, *ledger.dissipated, "balance"]
    stored = table[list(STORED)].sum(axis=1)
    left = stored - stored[0] - table[list(INFLOWS)].sum(axis=1) + table[list(ledger.dissipated)].sum(axis=1)
    assert_allclose(left, table["balance"], atol=1e-9)
    assert ledger.problem.name == "system-3"
    assert "kinetic" in table.to_csv()
    assert "kinetic" in table.head().to_latex()
    totals = ledger.totals
    assert_allclose(totals["end"] - totals["start"], totals["change"], atol=1e-9)
    assert isinstance(totals, pd.DataFrame)


def test_a_run_that_ended_early_and_one_of_no_length_have_a_ledger():
    ball = li.load_problem("bouncing-ball")
    early = li.simulate(ball, "exact", dt=1e-2, t_end=5.0, max_events=4, throw=False)
    assert not early.success
    ledger = li.energy_ledger(early)
    assert ledger.balance < 1e-12
    assert ledger.table["t"].iloc[-1] == early.t[-1]


def test_a_record_that_is_wrong_does_not_close():
    run = li.simulate(li.load_problem("system-1"), dt=1e-3, t_end=3.0)
    for wrong in ({"reaction": 1.01 * run.reaction}, {"q": 1.001 * run.q}, {"v": 1.001 * run.v}):
        assert li.energy_ledger(dataclasses.replace(run, **wrong)).balance > 1e-3
    ball = li.simulate(li.load_problem("bouncing-ball"), "exact", dt=1e-2, t_end=3.0)
    events = (dataclasses.replace(ball.events[0], impulse=1.01 * ball.events[0].impulse), *ball.events[1:])
    assert li.energy_ledger(dataclasses.replace(ball, events=events)).balance > 1e-3


def test_a_system_given_directly_has_no_energy():
    run = li.simulate(li.load_problem("diode-bridge"), dt=1e-5, t_end=1e-4)
    with pytest.raises(li.UnsupportedError, match=r"'diode-bridge' is a system given by its matrices.*needs a Scheme"):
        li.energy_ledger(run)
