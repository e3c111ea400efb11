"""Loads and motions of time, nodes without mass, lattices and trees in sparse steps, against the dense ones and `exact`."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from test_sparse_steps import both, mean_forces

from lcpimpact import (
    Bumper,
    Chain,
    Dashpot,
    Harmonic,
    KelvinVoigt,
    Lattice,
    Load,
    Loads,
    Mass,
    Maxwell,
    Motion,
    Polynomial,
    PrescribedMotion,
    Problem,
    Ramp,
    Scheme,
    SparseScheme,
    Spring,
    Square,
    Status,
    Table,
    Tree,
    simulate,
)
from lcpimpact.errors import InputError, LcpImpactError
from lcpimpact.hybrid.state_jump import into_balance
from lcpimpact.sparse_run import SparseRun


def signal(rng, moves=False):
    """A random load, or motion."""
    a = rng.uniform(-1.0, 1.0) * (0.02 if moves else 5.0)
    start = rng.uniform(0.0, 0.1)
    kinds = [
        Harmonic(a, float(rng.uniform(1.0, 60.0)), float(rng.uniform(0.0, 6.0))),
        Ramp(0.0, a, start, start + rng.uniform(0.01, 0.1)),
        Table(np.sort(rng.uniform(0.0, 0.2, 4)).tolist(), (a * rng.standard_normal(4)).tolist()),
        Polynomial([a, float(rng.uniform(-0.1, 0.1)), a]),
        Square(a, float(rng.uniform(10.0, 60.0))),
        np.cos,
    ]
    return kinds[rng.integers(4 if moves else 6)]


def random_scheme(rng):
    """Masses, massless nodes on springs and dashpots or on springs alone, driven nodes, and bumpers between any of them."""
    n, elements = int(rng.integers(2, 13)), []
    nodes = [f"n{i}" for i in range(n)]
    kinds = dict.fromkeys(nodes, "mass")
    for node in nodes[1:]:
        kinds[node] = str(rng.choice(["mass", "mass", "mass", "damped", "static", "driven"]))

    def stiffness():
        return float(10.0 ** rng.uniform(1.0, 3.0))

    for node, kind in kinds.items():
        others = [*(other for other in nodes if other != node), "ground"]
        if kind == "mass":
            elements.append(Mass(node, float(10.0 ** rng.uniform(-1.0, 1.0))))
        elif kind == "driven":
            elements.append(PrescribedMotion(node, signal(rng, moves=True)))
        else:
            elements += [Spring(node, str(rng.choice(others)), stiffness()), Spring(node, "ground", stiffness())]
        if kind == "damped":
            elements.append(Dashpot(node, "n0", float(10.0 ** rng.uniform(-1.0, 1.0))))
        if kind != "driven" and rng.random() < 0.5:
            elements.append(Load(node, 9.81 if rng.random() < 0.5 else signal(rng)))
        if rng.random() < 0.3:
            elements.append(Spring(node, str(rng.choice(others)), stiffness()))
        if rng.random() < 0.2 and kind != "static":
            elements.append(Dashpot(node, str(rng.choice(others)), float(10.0 ** rng.uniform(-1.0, 1.0))))
    for j in range(int(rng.integers(0, n + 1))):
        a, b = map(str, rng.choice([*nodes, "ground"], 2, replace=False))
        impacts = {kinds.get(a, "mass"), kinds.get(b, "mass")} <= {"mass", "driven"}
        gap = float(rng.choice([0.0, 0.01 * rng.random(), 0.01]))
        elements.append(Bumper(a, b, gap, float(rng.random()) if impacts else None, f"R{j}"))
    v0 = {node: float(rng.standard_normal()) for node in nodes if kinds[node] == "mass" and rng.random() < 0.5}
    return elements, v0


def assembled(kind, elements, v0):
    try:
        return Problem("p", kind(*elements), v0=v0)
    except LcpImpactError as error:
        return error


@pytest.mark.parametrize("block", range(12))
def test_random_schemes_move_as_the_dense_ones(block):
    """Bumpers at rest, in ties and in the air; what dense steps take and sparse ones do not is refused by name."""
    ran = 0
    for seed in range(12 * block, 12 * block + 12):
        rng = np.random.default_rng(seed)
        elements, v0 = random_scheme(rng)
        dense, found = (assembled(kind, elements, v0) for kind in (Scheme, SparseScheme))
        if isinstance(dense, Exception):
            assert isinstance(found, LcpImpactError), seed
            continue
        if isinstance(found, Exception):
            assert "impulses pass through" in str(found) or "both sides" in str(found), seed
            continue
        theta, dt = float(rng.choice([0.5, 0.5, 0.75, 1.0])), float(rng.choice([1e-3, 2e-4]))
        balanced, _ = into_balance(dense)  # sparse nodes that only springs hold begin where q0 says
        dense, found = (replace(each, q0=balanced.q0) for each in (dense, found))
        dense, found = (simulate(each, dt=dt, t_end=0.2, theta=theta, throw=False) for each in (dense, found))
        assert found.status is dense.status, (seed, found.message)
        for name in ("q", "v"):
            wanted = getattr(dense, name)
            assert np.abs(getattr(found, name) - wanted).max() <= 1e-9 * np.abs(wanted).max() + 1e-300, (seed, name)
        forces = mean_forces(dense)
        assert np.abs(found.reaction - forces).max(initial=0.0) <= 1e-9 * np.abs(forces).max(initial=0.0), seed
        ran += 1
    assert ran >= 3


FLOOR = PrescribedMotion("floor", Harmonic(2e-3, 60.0, -0.5 * np.pi))


@pytest.mark.parametrize(
    "elements",
    [
        [
            Chain(20, m=0.1, gap=1e-3, e=0.3, f=0.981, b="floor"),
            FLOOR,
            Loads([3, 7], f=Harmonic(0.3, 20.0), a=[1.0, -2.0]),
        ],
        [
            Lattice(4, 5, m=0.2, k=300.0, gap=0.001, e=0.2, k_side=50.0, c_side=0.1, f=1.0, b="floor", name="p"),
            FLOOR,
            Loads([(1, 1), (2, 3)], f=Ramp(0.0, 2.0, 0.05, 0.1), a=[1.0, -3.0], name="p"),
        ],
        [Lattice(3, 4, m=0.1, k=90.0, c=0.1, k_side=50.0, a="ground"), Loads([(3, 2)], f=Square(1.0, 20.0))],
        [
            Tree([0, 1, 1, 2, 2, 4], m=0.1, gap=0.002, e=0.1, f=0.981, b="floor"),
            FLOOR,
            Loads([2, 6], f=np.cos, a=[0.1, 0.2]),
            Loads([2, 5], f=3.0, a=0.1),
        ],
        [Tree([2, 0, 2, 0], m=[1.0, 2.0, 3.0, 4.0], k=[50.0, 60.0]), Loads([1], f=Polynomial([0.0, 1.0]), a=3.0)],
        [
            Chain(4, m=1.0, k=100.0, c=0.5, a="wall"),
            PrescribedMotion("wall", Table([0.0, 0.0333, 0.2], [0.0, 0.1, 0.0])),
        ],
    ],
)
def test_arrays_of_masses_and_loads_move_as_the_dense_ones(elements):
    dense, found = both(elements, 1e-3, 0.4)
    assert found.success, found.message
    np.testing.assert_allclose(found.q, dense.q, rtol=0.0, atol=1e-12 * np.abs(dense.q).max())
    np.testing.assert_allclose(found.v, dense.v, rtol=0.0, atol=1e-11 * np.abs(dense.v).max())
    assert found.certificate.energy_balance < 1e-12 * found.certificate.energy_scale


def error_of(elements, dt, t_end, node, v0):
    """The error at the end of a sparse run, against the exact motion of the dense scheme."""
    exact = simulate(Problem("p", Scheme(*elements), v0=v0), "exact", dt=t_end, t_end=t_end)
    found = simulate(Problem("p", SparseScheme(*elements), v0=v0), dt=dt, t_end=t_end, record=[node])
    return abs(found[node][-1] - exact[node][-1])


def test_smooth_motion_is_of_the_second_order():
    elements = [
        Chain(5, m=0.5, k=200.0, c=0.3, a="base"), PrescribedMotion("base", Harmonic(0.01, 12.0)),
        Maxwell("x.5", "ground", k=80.0, c=4.0), Loads([2, 3], f=Harmonic(1.0, 7.0), a=[1.0, 2.0]),
    ]  # fmt: skip
    errors = [error_of(elements, 0.5 / steps, 0.5, "x.5", {"x.1": 0.3}) for steps in (100, 200, 400)]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert (orders > 1.9).all(), orders


def test_a_body_on_a_massless_plate_is_of_the_second_order_and_impacts_are_of_the_first():
    plate = [
        Mass("x", 1.0),
        Load("x", Harmonic(5.0, 9.0)),
        Bumper("x", "z", 0.0),
        KelvinVoigt("z", "ground", 300.0, 20.0),
    ]
    errors = [error_of(plate, 0.3 / steps, 0.3, "x", {"x": 1.0}) for steps in (150, 300, 600, 1200)]
    assert np.log2(errors[0] / errors[-1]) / 3.0 > 1.5, errors  # the opening lies anywhere in its step
    column = [Chain(2, m=0.5, gap=0.01, e=0.5, f=4.9, b="floor"), FLOOR]
    errors = [error_of(column, 0.1 / steps, 0.1, "x.1", {}) for steps in (200, 800, 3200, 12800)]
    assert np.log2(errors[0] / errors[-1]) / 6.0 > 0.8, errors


def test_the_work_of_a_driven_floor_and_of_loads_is_in_the_balance():
    """A floor that raises a column does the work of its weight; the balance holds to rounding."""
    column = [Chain(20, m=0.1, gap=0.0, e=0.0, f=0.981, b="floor"), PrescribedMotion("floor", Polynomial([0.0, -0.5]))]
    run = simulate(Problem("p", SparseScheme(*column), v0=dict.fromkeys(column[0].masses, -0.5)), dt=1e-3, t_end=2.0)
    np.testing.assert_allclose(run["x.1"][-1], -1.0, rtol=1e-12)
    np.testing.assert_allclose(run["x.R20"], 20 * 0.981, rtol=1e-9)
    assert run.certificate.energy_balance < 1e-13 * 20 * 0.981 * 1.0


SHAKEN = [Chain(10, m=0.1, gap=1e-3, e=0.3, f=0.981, k=50.0, b="floor"), FLOOR, Loads([2, 5], f=Harmonic(0.3, 20.0))]


@pytest.mark.parametrize(
    ("columns", "laws"),
    [
        (slice(0, 1), {"momentum", "energy_balance"}),  # loads at t
        (slice(1, 2), {"momentum", "energy_balance"}),  # loads at t + h
        (slice(2, 3), {"motion"}),  # places
        (slice(3, 4), {"motion"}),  # rates
        (slice(4, 5), {"motion"}),  # mean rates
    ],
)
def test_steps_with_other_loads_and_motions_than_those_given_are_found_out(monkeypatch, columns, laws):
    given = SparseRun._given

    def off(self, t):
        found = given(self, t)
        found.inputs[:, columns] *= 1.0 + 1e-4
        return found

    monkeypatch.setattr(SparseRun, "_given", off)
    run = simulate(Problem("p", SparseScheme(*SHAKEN)), dt=1e-3, t_end=0.1, throw=False)
    limits = run.certificate.limits
    assert run.status is Status.VIOLATED
    assert laws <= {name for name in limits if getattr(run.certificate, name) > limits[name]}


def test_a_massless_node_off_its_balance_is_found_out(monkeypatch):
    from dataclasses import replace

    from lcpimpact.integrators.stepping import sparse_table

    tabulate = sparse_table.tabulate_sparse

    def off(*arguments):
        found = tabulate(*arguments)
        end = found.table.end
        return replace(found, table=found.table._replace(end=end._replace(c=end.c + 1e-9)))

    monkeypatch.setattr("lcpimpact.sparse_run.tabulate_sparse", off)
    scheme = SparseScheme(Mass("x", 1.0), Maxwell("x", "ground", k=50.0, c=1.0))
    run = simulate(Problem("p", scheme, v0={"x": 1.0}), dt=1e-3, t_end=0.1, throw=False)
    limits = run.certificate.limits
    assert run.status is Status.VIOLATED
    assert run.certificate.equilibrium > limits["equilibrium"]


@pytest.mark.parametrize(
    "extra",
    [
        [],
        [Dashpot("x", "floor", 0.5)],
        [Spring("x", "floor", 100.0)],
        [Spring("plate", "ground", 200.0), Bumper("plate", "floor")],
        [KelvinVoigt("plate", "ground", k=200.0, c=1.0), Bumper("plate", "floor")],
    ],
)
def test_a_kink_of_a_motion_within_a_step_holds_the_laws(extra):
    """Springs, dashpots and plates without mass follow the places of the floor, impacts its rates: dense and sparse."""
    floor = PrescribedMotion("floor", Ramp(0.0, -0.05, 0.0303, 0.1507))
    elements = [Mass("x", 0.1), Load("x", 1.0), Bumper("x", "floor", 0.001, 0.5), floor, *extra]
    dense, found = both(elements, 1e-3, 0.5)
    assert dense.success, dense.message
    assert found.success, found.message
    np.testing.assert_allclose(found.v, dense.v, rtol=0.0, atol=1e-12)


@pytest.mark.parametrize(
    "elements",
    [
        [Chain(20, m=0.1, gap=0.0, e=0.0, f=0.981, b="floor"), PrescribedMotion("floor", Polynomial([0.0]))],
        [Mass("x", 1.0), Load("x", 0.981), Bumper("x", "ground", 0.0, 0.0), Load("x", Ramp(0.0, -0.981, 0.1, 0.2))],
        [
            Mass("x", 1.0), Spring("x", "l", 0.1), Spring("x", "r", 0.3),
            PrescribedMotion("l", Polynomial([-3.0])), PrescribedMotion("r", Polynomial([1.0])),
        ],
        [Mass("x", 1.0), Load("x", Harmonic(1.0, 30.0, -0.5 * np.pi)), Bumper("x", "ground", 0.0, 0.5)],
    ],
)  # fmt: skip
def test_forces_that_cancel_at_rest_break_no_law(elements):
    """A weight that a load just carries, springs that balance: all that is left is rounding."""
    run = simulate(Problem("p", SparseScheme(*elements)), dt=1e-3, t_end=0.5, throw=False)
    assert run.success, run.message


@pytest.mark.parametrize("unit", [2.0**-80, 2.0**80])
def test_units_of_mass_that_are_powers_of_two_change_no_digit(unit):
    runs = []
    for u in (1.0, unit):
        chain = Chain(20, m=0.1 * u, k=100.0 * u, gap=1e-3, e=0.3, f=0.981 * u, b="floor")
        others = [Loads([2], f=Harmonic(3.0 * u, 30.0)), Maxwell("x.1", "ground", k=50.0 * u, c=1.0 * u)]
        runs.append(simulate(Problem("p", SparseScheme(chain, FLOOR, *others)), dt=1e-3, t_end=0.3))
    np.testing.assert_allclose(runs[1].q, runs[0].q, rtol=0.0, atol=1e-14)


def test_numbers_of_a_motion_that_are_not_finite_end_the_run_there():
    chain = Chain(3, m=0.1, gap=0.0, e=0.0, f=0.981, b="floor")
    floor = PrescribedMotion("floor", Motion(lambda t: 0.0 if t < 0.1 else np.nan, lambda t: 0.0))
    run = simulate(Problem("p", SparseScheme(chain, floor)), dt=1e-3, t_end=0.5, throw=False)
    assert run.status is Status.NON_FINITE
    assert run.t[-1] == pytest.approx(0.099)


def test_many_signals_are_computed_in_parts(monkeypatch):
    """Each node with a wave of its own, and less room than a block of steps needs."""
    elements = [Chain(30, m=0.1, k=50.0, a="ground"), *(Load(f"x.{i}", Harmonic(1.0, 10.0 + i)) for i in range(1, 31))]
    dense, _ = both(elements, 1e-3, 0.2)
    monkeypatch.setattr("lcpimpact.sparse_run.MOST_INPUTS", 200)
    found = simulate(Problem("p", SparseScheme(*elements)), dt=1e-3, t_end=0.2)
    np.testing.assert_allclose(found.q, dense.q, rtol=0.0, atol=1e-12 * np.abs(dense.q).max())


def test_waves_of_one_frequency_and_phase_are_one_signal():
    loads = Loads(range(1, 1001), f=Harmonic(2.0, 30.0), a=np.arange(1000.0))
    d = SparseScheme(Chain(1000, m=1.0, k=1.0), loads, Load("x.5", Harmonic(7.0, 30.0)), Load("x.6", Ramp(0, 1, 0, 1)))
    d = d.assemble()
    assert len(d.signals) == 2
    assert d.F.nnz == 1000
    np.testing.assert_allclose((d.F @ d.signals(0.3))[9], 18.0 * np.cos(9.0), rtol=1e-14)


@pytest.mark.parametrize(
    ("make", "match"),
    [
        (lambda: Tree([2, 1], m=1.0), "run into a loop"),
        (lambda: Tree([0, 5], m=1.0), "numbers of its 2 masses"),
        (lambda: Tree([0.5], m=1.0), "whole numbers"),
        (lambda: Tree([0, 1], m=1.0, gap=0.0), "both gap and e"),
        (lambda: Lattice(2, 0, m=1.0), "columns = 0"),
        (lambda: Lattice(2, 2), "m is missing"),
        (lambda: Lattice(2, 1, m=1.0, k_side=1.0), "no links for k_side"),
        (lambda: Lattice(2, 2, m=1.0, k=[1.0] * 3), "2 of them"),
        (lambda: Loads([1, 1], f=1.0), "listed twice"),
        (lambda: Loads([0], f=1.0), "above zero"),
        (lambda: Loads([1, (1, 2)], f=1.0), "above zero, or pairs"),
        (lambda: Loads([1]), "f = None"),
        (lambda: Loads([1, 2], f=1.0, a=[1.0]), "2 of them"),
        (lambda: Loads([1], f=lambda t, q, v: -v), "of the time alone"),
    ],
)
def test_trees_lattices_and_loads_that_are_refused(make, match):
    with pytest.raises(InputError, match=match):
        make()


def test_waves_too_fast_to_follow_are_refused():
    with pytest.raises(InputError, match="are followed"):
        simulate(Problem("p", SparseScheme(Mass("x", 1.0), Load("x", Harmonic(1.0, 1e12)))), dt=0.1, t_end=1.0)
