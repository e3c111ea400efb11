"""Laws of impact where bodies touch: closed forms, chains of springs, energies, certificates, refusals and files."""

import pickle
from dataclasses import replace
from fractions import Fraction
from functools import partial
from itertools import combinations, pairwise
from operator import add, mul

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

import lcpimpact as li
from lcpimpact.hybrid import multiple_impacts
from lcpimpact.hybrid.multiple_impacts import EndlessImpact, Touching, impulses
from lcpimpact.numerics.double_double import DoubleDouble
from lcpimpact.scheme.impact_laws import IMPACT_LAWS

METHODS = ("exact", "event-driven", "radau-fesd")
OTHERS = ("sequential", "poisson", "lzb")


def row(masses, v0, e=1.0, law="newton", gaps=None):
    """Balls in a row that touch, with bumpers R1, R2, ... between neighbours."""
    names = [f"x{i}" for i in range(1, len(masses) + 1)]
    each = np.broadcast_to(e, len(masses) - 1).tolist()
    bumpers = [
        li.Bumper(a, b, gap=gap, e=e_i, name=f"R{i}")
        for i, ((a, b), e_i, gap) in enumerate(
            zip(pairwise(names), each, gaps or [0.0] * len(each), strict=True), start=1
        )
    ]
    scheme = li.Scheme(*map(li.Mass, names, masses), *bumpers, impact_law=law)
    return li.Problem("row", scheme, v0=dict(zip(names, v0, strict=True)), t_end=0.5)


def after(problem, method="exact"):
    """The velocities at the end of a run of 0.5 s."""
    return li.simulate(problem, method, dt=0.25, error=False).v[-1]


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(
    ("law", "e", "v"),
    [
        ("newton", 1.0, (-1 / 3, 2 / 3, 2 / 3)),
        ("newton", (0.0, 1.0), (1 / 3, 1 / 3, 1 / 3)),
        ("sequential", 1.0, (0.0, 0.0, 1.0)),
        ("sequential", (1.0, 0.0), (0.0, 0.5, 0.5)),
        ("poisson", 1.0, (-1 / 3, 2 / 3, 2 / 3)),
        ("poisson", 0.5, (0.0, 0.5, 0.5)),
        ("poisson", (0.0, 1.0), (1 / 6, 1 / 6, 2 / 3)),
        ("lzb", 0.0, (1 / 3, 1 / 3, 1 / 3)),
    ],
)
def test_three_equal_balls_of_which_one_is_struck(method, law, e, v):
    run = li.simulate(row([1.0] * 3, (1.0, 0.0, 0.0), e, law), method, dt=0.25, error=False)
    assert run.v[-1] == pytest.approx(v, abs=1e-10)
    assert {each.law for each in run.events if each.kind == "impact"} == {law}


def test_poissons_law_returns_what_was_compressed_at_the_other_contact():
    """By hand: P_c = (2/3, 1/3), expansion returns (0, 1/3), and y = 1/6 at the first keeps it from approaching."""
    G, U = DoubleDouble.of([[2.0, -1.0], [-1.0, 2.0]]), DoubleDouble.of([-1.0, 0.0])
    P, stops = impulses("poisson", Touching(G, U, np.array([0.0, 1.0]), ("R", "S")), "auto", 1e-14)
    assert P.hi == pytest.approx([5 / 6, 2 / 3], abs=1e-15)
    assert stops.tolist() == [True, False]


def spring_chain(masses, v0, k, exponent, end=100.0):
    """The velocities after springs k δ^η between balls that move, by DOP853."""
    m, k, n = np.array(masses), np.array(k), len(masses)

    def slope(_, y):
        force = k * np.maximum(y[: n - 1] - y[1:n], 0.0) ** exponent
        return np.concatenate([y[n:], (np.append(0.0, force) - np.append(force, 0.0)) / m])

    y = solve_ivp(slope, (0.0, end), [0.0] * n + list(v0), method="DOP853", rtol=1e-12, atol=1e-14).y[:, -1]
    assert (np.diff(y[n:]) > 0.0).all()
    return y[n:]


@pytest.mark.parametrize("exponent", [1.0, 1.5])
@pytest.mark.parametrize(
    ("masses", "stiffness"),
    [
        ((1.0, 1.0, 1.0), (1.0, 1.0)),
        ((1.0, 1.0, 1.0, 1.0), (1.0, 1.0, 1.0)),
        ((1.0, 1.0, 1.0, 1.0, 1.0), (1.0, 1.0, 1.0, 1.0)),
        ((1.0,) * 10, (1.0,) * 9),
        ((3.0, 2.0, 1.0), (1.0, 4.0)),
        ((1.0, 0.8, 0.6, 0.4), (2.0, 1.0, 0.5)),
    ],
)
def test_lzb_without_loss_gives_the_speeds_of_chains_of_springs(masses, stiffness, exponent):
    v0 = (1.0,) + (0.0,) * (len(masses) - 1)
    law = li.LZB(exponent=exponent, stiffness={f"R{i}": k for i, k in enumerate(stiffness, start=1)})
    assert after(row(masses, v0, 1.0, law)) == pytest.approx(spring_chain(masses, v0, stiffness, exponent), abs=1e-9)


def test_lzb_begins_by_the_contacts_that_approach_alone():
    """Balls 3 and 4 rest until the impulses of the first two reach them, and a ball that is not reached keeps its rest."""
    v = after(row([1.0] * 5, (0.0, 0.0, 0.0, 0.0, -1.0), 1.0, "lzb"))
    assert v == pytest.approx(-after(row([1.0] * 5, (1.0, 0.0, 0.0, 0.0, 0.0), 1.0, "lzb"))[::-1], abs=1e-11)
    apart = row([1.0] * 4, (1.0, 0.0, 0.0, 0.0), 1.0, "lzb", gaps=[0.0, 0.0, 1.0])
    assert after(apart)[3] == 0.0


def test_a_contact_alone_rebounds_with_e_by_all_laws_and_methods():
    for law in IMPACT_LAWS:
        pair = row([1.0, 3.0], (1.0, 0.0), 0.6, law)
        for method in (*METHODS, "moreau-jean"):
            v = li.simulate(pair, method, dt=0.01, error=False).v[-1]
            assert v[1] - v[0] == pytest.approx(0.6, abs=1e-12)
            assert v @ [1.0, 3.0] == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize("law", OTHERS)
def test_symmetric_impacts_stay_symmetric(law):
    v = after(row([1.0, 2.0, 1.0], (1.0, 0.0, -1.0), 0.7, law))
    assert v == pytest.approx(-v[::-1], abs=1e-11)
    assert abs(v[1]) < 1e-12


@pytest.mark.parametrize("law", OTHERS)
@pytest.mark.parametrize("size", [1e-12, 1.0, 1e12])
def test_units_do_not_count(law, size):
    v = after(row([size, 2.0 * size, 0.5 * size], (size, 0.0, 0.0), (0.3, 0.9), law)) / size
    assert v == pytest.approx(after(row([1.0, 2.0, 0.5], (1.0, 0.0, 0.0), (0.3, 0.9), law)), rel=1e-9)


@st.composite
def touching(draw, most=4):
    """Contacts of a random system of masses, redundant ones among them."""
    k = draw(st.integers(2, most))
    numbers = st.floats(-1.0, 1.0).filter(lambda x: x == 0.0 or abs(x) > 1e-3)
    X = np.array(draw(st.lists(st.lists(numbers, min_size=k, max_size=k), min_size=2, max_size=k)))
    z = np.array(draw(st.lists(numbers, min_size=len(X), max_size=len(X))))
    e = np.array(draw(st.lists(st.sampled_from([0.0, 0.3, 0.8, 1.0]), min_size=k, max_size=k)))
    X = X[:, (np.abs(X) > 0.1).any(axis=0)]
    return X, X.T @ z, e[: X.shape[1]]


@settings(max_examples=40, deadline=None)
@given(touching())
def test_poissons_law_gains_no_energy_and_lets_nothing_approach(system):
    X, U, e = system
    G = X.T @ X
    if not (U < 0.0).any():
        return
    P, _ = impulses("poisson", Touching(DoubleDouble.of(G), DoubleDouble.of(U), e, [""] * len(e)), "auto", 1e-12)
    size = np.abs(U).max() + np.abs(G) @ np.abs(P.hi)
    assert (P.hi >= -1e-12 * np.abs(P.hi).max()).all()
    assert (U + G @ P.hi >= -1e-10 * size).all()
    assert P.hi @ (U + 0.5 * G @ P.hi) <= 1e-10 * np.abs(P.hi) @ size


@pytest.mark.parametrize(("masses", "k"), [((1.0, 1.0, 1.0), (1.0, 1.0)), ((0.5, 2.0, 1.5), (1.0, 0.3))])
@pytest.mark.parametrize("e", [(0.6, 0.8), (1.0, 0.7), (1.0, 1.0)])
@pytest.mark.parametrize("exponent", [1.0, 1.5, 2.0])
def test_the_law_of_liu_zhao_and_brogliato_gains_no_energy(masses, k, e, exponent):
    m, H = np.array(masses), np.array([[-1.0, 1.0, 0.0], [0.0, -1.0, 1.0]])
    G, U = DoubleDouble.of(H / m @ H.T), DoubleDouble.of([-1.0, 0.0])
    law = li.LZB(exponent, {"R": k[0], "S": k[1]})
    P, _ = impulses(law, Touching(G, U, np.array(e), ("R", "S")), "auto", 1e-14)
    v = np.array([1.0, 0.0, 0.0]) + H.T @ P.hi / m
    assert (np.diff(v) >= -1e-12).all()
    lost = m[0] - m @ v**2
    assert lost == pytest.approx(0.0, abs=1e-9) if min(e) == 1.0 else lost > 0.0


@pytest.mark.parametrize("law", [*OTHERS, "newton"])
@pytest.mark.parametrize("other", [*OTHERS, "newton"])
def test_the_certificate_refuses_the_impulses_of_another_law(law, other):
    """Poisson's and Newton's impacts are one where all contacts that close have one e: here they have not."""
    run = li.simulate(row([1.0, 2.0, 1.5], (1.0, 0.0, 0.0), (0.4, 0.9), law), "exact", dt=0.1, error=False)
    found = run.certify(row([1.0, 2.0, 1.5], (1.0, 0.0, 0.0), (0.4, 0.9), other))
    assert found.holds == (law == other)
    assert (found.impact_law > 1e-3) == (law != other)


def test_the_certificate_refuses_springs_of_another_stiffness_or_exponent():
    run = li.simulate(row([1.0] * 3, (1.0, 0.0, 0.0), 0.9, "lzb"), "event-driven", dt=0.1, error=False)
    for law in (li.LZB(1.0), li.LZB(1.5, {"R2": 1.1})):
        assert not run.certify(row([1.0] * 3, (1.0, 0.0, 0.0), 0.9, law)).holds


@pytest.mark.parametrize("law", OTHERS)
def test_redundant_contacts(law):
    """A plate on three supports in a line, struck in the middle: two coordinates, three contacts."""
    supports = [{"y": 1.0, "φ": -1.0}, {"y": 1.0}, {"y": 1.0, "φ": 1.0}]
    for e in ((0.5, 0.5, 0.5), (0.2, 0.9, 0.5)):
        bumpers = [
            li.Bumper("ground", at, e=e_i, name=f"R{i}") for i, (at, e_i) in enumerate(zip(supports, e, strict=True))
        ]
        plate = li.Scheme(li.Mass("y", 2.0), li.Mass("φ", 1.0), *bumpers, impact_law=law)
        run = li.simulate(li.Problem("plate", plate, v0={"y": -1.0}), "exact", dt=0.1, t_end=0.2, error=False)
        assert run.success
        y, φ = run.v[-1]
        assert y >= abs(φ) - 1e-12
        assert 2.0 * y**2 + φ**2 < 2.0
        if len(set(e)) == 1:
            assert (y, φ) == pytest.approx((0.5, 0.0), abs=1e-9)


@pytest.mark.parametrize("law", OTHERS)
def test_a_stack_on_the_floor_that_is_hit_comes_to_rest(law):
    """Under gravity, with e = 0 at the floor: the certificate judges every impact, and two methods have one motion."""
    balls = ("a", "b", "c")
    stack = li.Scheme(
        *(li.Mass(x, m=1.0) for x in balls), *(li.Load(x, f=9.81) for x in balls),
        li.Bumper("a", "b", gap=0.2, e=0.3, name="ab"), li.Bumper("b", "c", e=0.2, name="bc"),
        li.Bumper("c", "ground", e=0.0, name="floor"), impact_law=law,
    )  # fmt: skip
    problem = li.Problem("stack", stack)
    runs = [li.simulate(problem, method, dt=0.05, t_end=1.0, error=False) for method in ("exact", "event-driven")]
    assert all(run.success for run in runs)
    assert runs[0].q[-1] == pytest.approx(runs[1].q[-1], abs=1e-7)
    assert runs[0].v[-1] == pytest.approx([0.0] * 3, abs=1e-9)
    assert runs[0]["floor"][-1] == pytest.approx(3 * 9.81, rel=1e-9)


def plate_on_three_supports(e):
    """Struck to one side; two coordinates leave the shares of three supports open."""
    supports = ({"y": 1.0, "φ": -1.0}, {"y": 1.0}, {"y": 1.0, "φ": 1.0})
    bumpers = [
        li.Bumper("ground", at, e=e_i, name=f"R{i}") for i, (at, e_i) in enumerate(zip(supports, e, strict=True))
    ]
    plate = li.Scheme(li.Mass("y", 2.0), li.Mass("φ", 1.0), *bumpers, impact_law="poisson")
    return li.Problem("plate", plate, v0={"y": -1.0, "φ": 0.1}, t_end=0.2)


@pytest.mark.parametrize("e", [(0.2, 0.9, 0.5), (0.9, 0.1, 0.3), (1.0, 0.0, 0.6)])
def test_the_certificate_knows_the_shares_of_redundant_contacts(e):
    """By hand with P_c = (0.1, 1.9, 0): P = (1 + e) P_c, and U⁺ = 0 at the third support where it would approach."""
    run = li.simulate(plate_on_three_supports(e), "exact", dt=0.1, error=False)
    P = np.array([(1.0 + e[0]) * 0.1, (1.0 + e[1]) * 1.9])
    y, φ = -1.0 + P.sum() / 2.0, 0.1 - P[0]
    third = max(0.0, -(y + φ)) / 1.5
    assert run.v[-1] == pytest.approx([y + third / 2.0, φ + third], abs=1e-12)
    for other in ((0.3, 0.9, 0.5), (0.9, 0.2, 0.3), (0.9, 0.0, 0.6)):
        assert not run.certify(plate_on_three_supports(other)).holds


def complementary_by_cases(G, q):
    """P >= 0 with G P + q >= 0 and one of them zero in each row, in rational numbers, by trying which rows push."""
    for size in range(len(q) + 1):
        for rows in combinations(range(len(q)), size):
            A = [[*(G[i][j] for j in rows), -q[i]] for i in rows]
            for i in range(size):
                A[i] = [x / A[i][i] for x in A[i]]
                for k in set(range(size)) - {i}:
                    A[k] = [x - A[k][i] * y for x, y in zip(A[k], A[i], strict=True)]
            P = [A[rows.index(i)][-1] if i in rows else Fraction(0) for i in range(len(q))]
            w = [q[i] + sum(map(mul, G[i], P)) for i in range(len(q))]
            if min(P) >= 0 and min(w) >= 0:
                return P
    raise AssertionError


def poisson_in_fractions(m, v, e):
    """The velocities of a row of balls after compression and expansion."""
    m, v, e = ([Fraction(x) for x in each] for each in (m, v, e))
    n = len(e)
    G = [[Fraction(0)] * n for _ in range(n)]
    for i in range(n):
        G[i][i] = 1 / m[i] + 1 / m[i + 1]
        if i + 1 < n:
            G[i][i + 1] = G[i + 1][i] = -1 / m[i + 1]
    U = [b - a for a, b in pairwise(v)]
    returned = [(1 + e_i) * P for e_i, P in zip(e, complementary_by_cases(G, U), strict=True)]
    more = complementary_by_cases(G, [U[i] + sum(map(mul, G[i], returned)) for i in range(n)])
    P = [0, *map(add, returned, more), 0]
    return [float(v[i] + (P[i] - P[i + 1]) / m[i]) for i in range(n + 1)]


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(
    ("m", "v", "e"),
    [
        ([1.0, 2.0, 0.5, 3.0], [2.0, 1.0, 0.0, -1.0], [0.3, 0.9, 0.0]),
        ([1e4, 5e6, 1e-4, 5e6], [1.0, 0.0, 0.0, -2.0], [0.25, 0.25, 0.0]),
        ([3.0, 5e5, 1e5, 5e-9, 1.0, 2e-7], [3.0, 1.0, 1.0, 0.0, 0.0, -2.0], [0.0, 1.0, 0.1, 0.25, 1.0]),
    ],
)
def test_poissons_law_of_masses_that_differ_by_orders_of_magnitude(method, m, v, e):
    run = li.simulate(row(m, v, e, "poisson"), method, dt=1e-6, t_end=1e-6, error=False)
    after_impact = next(each for each in reversed(run.events) if each.t == 0.0).right.v
    assert after_impact == pytest.approx(poisson_in_fractions(m, v, e), rel=1e-12, abs=1e-12)


def test_a_stack_of_four_comes_to_rest_by_sequences():
    """Two contacts open by less than their rounding, and only gravity lets them land again."""
    balls = ("a", "b", "c", "d")
    contacts = [
        li.Bumper(x, y, gap=gap, e=e, name=x + y)
        for (x, y), gap, e in zip(
            pairwise((*balls, "ground")), (0.2, 0.0, 0.0, 0.0), (0.99, 0.1, 0.99, 0.1), strict=True
        )
    ]
    falls = [each for x in balls for each in (li.Mass(x, m=1.0), li.Load(x, f=9.81))]
    problem = li.Problem("stack", li.Scheme(*falls, *contacts, impact_law="sequential"))
    run = li.simulate(problem, "exact", dt=0.05, t_end=1.0, error=False)
    assert run.q[-1] == pytest.approx([0.2, 0.0, 0.0, 0.0], abs=1e-12)
    assert run["dground"][-1] == pytest.approx(4 * 9.81, rel=1e-12)


@pytest.mark.parametrize("law", OTHERS)
def test_bodies_at_rest_stay_at_rest(law):
    run = li.simulate(row([1.0] * 3, (0.0, 0.0, 0.0), 1.0, law), "exact", dt=0.1, error=False)
    assert not run.events
    assert not run.v.any()


def test_a_sequence_that_is_too_long_has_a_status(monkeypatch):
    """A light ball between a heavy one and a wall: 314 impacts at a mass ratio of ten thousand."""
    heavy = li.Scheme(
        li.Mass("M", 1e4), li.Mass("m", 1.0), li.Bumper("M", "m", e=1.0), li.Bumper("m", "ground", e=1.0),
        impact_law="sequential",
    )  # fmt: skip
    problem = li.Problem("pi", heavy, v0={"M": 1.0})
    run = li.simulate(problem, "exact", dt=0.1, t_end=0.1, error=False)
    assert run.v[-1, 0] == pytest.approx(-1.0, abs=1e-3)
    assert run.v[-1] ** 2 @ [1e4, 1.0] == pytest.approx(1e4, rel=1e-11)
    monkeypatch.setattr(multiple_impacts, "_sequence", partial(multiple_impacts._sequence, max_sequence=300))
    with pytest.raises(li.UnsupportedError, match="does not end within the steps of its law"):
        li.simulate(problem, "exact", dt=0.1, t_end=0.1)
    later = replace(problem, scheme=li.Scheme(*problem.scheme.elements, li.Mass("s", 1.0), impact_law="sequential"))
    late = replace(later, q0={"M": -0.05})
    run = li.simulate(late, "event-driven", dt=0.1, t_end=0.1, throw=False, error=False)
    assert run.status is li.Status.ENDLESS_IMPACT
    row_ = Touching(DoubleDouble.of([[1.0001, -1.0], [-1.0, 1.0]]), DoubleDouble.of([-1.0, 0.0]), np.ones(2), "ab")
    with pytest.raises(EndlessImpact):
        impulses("sequential", row_, "auto", 1e-12)


def test_methods_that_do_not_take_a_law_refuse_it_by_name():
    for law in OTHERS:
        with pytest.raises(li.UnsupportedError, match=f"impact_law='{law}'.*take method='event-driven' or 'exact'"):
            li.simulate(row([1.0] * 3, (1.0, 0.0, 0.0), 1.0, law), "moreau-jean", dt=0.1)


def test_cross_validation_leaves_out_the_methods_that_do_not_take_the_law():
    verdict = li.cross_validate(
        row([1.0] * 3, (1.0, 0.0, 0.0), 0.5, "poisson"), ["exact", "event-driven", "moreau-jean"]
    )
    assert any("'moreau-jean' was not run" in reason and "impact_law='poisson'" in reason for reason in verdict.reasons)
    table = verdict.table.set_index("route")
    assert table.loc["exact", "agrees"]
    assert table.loc["event-driven", "agrees"]


def scheme_of(*more, law):
    return li.Scheme(li.Mass("a", 1.0), li.Mass("b", 1.0), li.Bumper("a", "b", e=0.5), *more, impact_law=law)


@pytest.mark.parametrize(
    ("more", "told"),
    [
        ((li.Bumper("b", "ground", e=0.5), li.Friction("a", "b", 0.3, normal="R")), "friction"),
        ((li.Bumper("b", "ground", e=0.5), li.Mass("c", 1.0), li.RigidLink("b", "c")), "joints"),
        (
            (li.KelvinVoigt("p", "ground", k=1.0, c=1.0), li.Bumper("b", "p", e=0.5), li.Bumper("p", "ground", e=0.5)),
            "impulses through massless nodes",
        ),
        (
            (li.PrescribedMotion("w", li.Table([0.0, 1.0, 2.0], [0.0, 1.0, 0.0])), li.Bumper("b", "w", e=0.5)),
            "velocities that jump",
        ),
    ],
)
def test_systems_to_which_the_laws_do_not_extend(more, told):
    scheme_of(*more, law="newton").assemble()
    with pytest.raises(li.UnsupportedError, match=f"impact_law='poisson' does not extend to .*{told}"):
        scheme_of(*more, law="poisson").assemble()


def test_bad_laws_are_refused_in_one_sentence():
    with pytest.raises(li.InputError, match="unknown law of impact 'poison': did you mean 'poisson'"):
        scheme_of(law="poison")
    with pytest.raises(li.InputError, match="impact_law = 3 must be one of 'newton', 'sequential'"):
        scheme_of(law=3)
    with pytest.raises(li.InputError, match=r"exponent = 0.5 must lie between 1 \(linear\) and 10"):
        li.LZB(exponent=0.5)
    with pytest.raises(li.InputError, match=r"stiffness of 'R' = -1.0 must be a positive"):
        li.LZB(stiffness={"R": -1.0})
    with pytest.raises(li.InputError, match="unknown contact between masses 'S'"):
        scheme_of(law=li.LZB(stiffness={"S": 1.0})).assemble()
    with pytest.raises(li.UnsupportedError, match="sparse matrices"):
        li.Scheme(li.Mass("a", 1.0), li.Bumper("a", "ground", e=0.5), format="sparse", impact_law="lzb").assemble()


@pytest.mark.parametrize("law", ["poisson", "lzb", li.LZB(1.0), li.LZB(1.5, {"R1": 2.0})])
def test_a_law_survives_files_pickles_and_changes(law, tmp_path):
    problem = row([1.0] * 3, (1.0, 0.0, 0.0), 0.5, law)
    assert pickle.loads(pickle.dumps(problem)) == problem
    file = li.write_scheme_file(problem, tmp_path / "row.toml")
    assert li.read_scheme_file(file).problem == problem
    assert eval(repr(problem.scheme), vars(li) | {name: getattr(li, name) for name in li.__all__}) == problem.scheme
    assert row([1.0] * 3, (1.0, 0.0, 0.0), 0.5).scheme != problem.scheme
    changed = li.with_values(problem, {"0.m": 2.0})
    assert changed.scheme.impact_law == problem.scheme.impact_law
    run = li.simulate(problem, "exact", dt=0.1, error=False)
    assert f"by impact_law={'lzb' if law != 'poisson' else law!r}".replace("=lzb", "='lzb'") in str(run)


def test_bad_laws_in_files(tmp_path):
    def error(law):
        text = f'impact_law = {law}\n[[elements]]\ntype = "Mass"\nnode = "x"\nm = 1.0\n'
        (tmp_path / "a.toml").write_text(text)
        with pytest.raises(li.InputError) as found:
            li.read_scheme_file(tmp_path / "a.toml")
        return str(found.value)

    assert "did you mean 'poisson'" in error('"poison"')
    assert "must be one of 'newton'" in error("3")
    assert "key of impact_law 'exponents'" in error("{ exponents = 1.5 }")
    assert "stiffness of 'R' = True must be a positive" in error("{ stiffness = { R = true } }")


def test_studies_of_derivatives_refuse_other_laws():
    problem = row([1.0] * 3, (1.0, 0.0, 0.0), 0.5, "poisson")
    with pytest.raises(li.UnsupportedError, match="impact_law='poisson'"):
        li.sensitivity(problem, wrt=["0.m"], outputs=["x1@0.5"])
