"""Designs: against closed forms, hand-written integration, and the impact that is simulated with what was found."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp
from scipy.special import beta

from lcpimpact import InputError, design, load_problem, read_scheme_file, sensitivity
from lcpimpact.problems.penalty import damping_ratio, loss_number
from lcpimpact.study.design.linear import extremum_times
from lcpimpact.study.design.search import solve
from lcpimpact.study.design.sizing import LAWS, OUTPUTS

LOSSY = [name for name, law in LAWS.items() if law.loss]
INTEGRATED = ["hunt-crossley", "tsuji", "kuwabara-kono"]
TWO = [name for name in LOSSY if LAWS[name].method == "exact"]


def by_hand(law, m, v0, g, k, loss, n=1.5):
    """e, contact time, peak force and deflection by DOP853, with the law and its end written out."""

    def force(x, v, R):
        if law.startswith("kelvin"):
            return k * x + loss * v
        if law == "hard-stop":
            return k * x + loss * max(v, 0.0)
        if law == "tsuji":
            return k * x * abs(x) ** (n - 1.0) + loss * abs(x) ** (0.5 * (n - 1.0)) * v
        if law == "kuwabara-kono":
            return k * abs(x) ** (n - 1.0) * (x + n * loss * v)
        return R if law == "maxwell" else k * max(x, 0.0) ** n * (1.0 + loss * v)

    def rate(t, state):
        x, v, R = state
        F = force(x, v, R)
        return [v, g - F / m, k * (v - F / loss) if law == "maxwell" else 0.0]

    def ends(t, state):
        x, v, _ = state
        if law == "tsuji":
            return k * math.copysign(abs(x) ** (0.5 * (n + 1.0)), x) + loss * v
        if law == "kuwabara-kono":
            return x + n * loss * v
        return force(*state) if law in ("kelvin-voigt", "maxwell") else x

    ends.terminal, ends.direction = True, -1.0
    long = 60.0 * math.sqrt(m / k)
    run = solve_ivp(
        rate, (0.0, long), [0.0, v0, 0.0], "DOP853", events=ends, dense_output=True, rtol=1e-12, atol=1e-15,
        max_step=0.02 * math.sqrt(m / k),
    )  # fmt: skip
    if not len(run.t_events[0]):
        return 0.0, math.inf, math.nan, math.nan
    t_c = float(run.t_events[0][-1])

    def greatest(value):
        t = np.linspace(0.0, t_c, 4001)
        j = int(np.clip(np.argmax([value(*run.sol(s)) for s in t]), 1, 3999))
        fine = np.linspace(t[j - 1], t[j + 1], 4001)
        return max(value(*run.sol(s)) for s in fine)

    return -run.sol(t_c)[1] / v0, t_c, greatest(force), greatest(lambda x, v, R: x)


CASES = [
    ("kelvin-voigt", 0.0, 3000.0, 40.0),
    ("kelvin-voigt", 9.81, 3000.0, 40.0),
    ("kelvin-voigt", 9.81, 3000.0, 70.0),  # the force begins at its peak
    ("kelvin-voigt", 0.5, 3000.0, 110.0),  # overdamped, and thrown back
    ("kelvin-voigt-tension", 0.0, 3000.0, 40.0),
    ("kelvin-voigt-tension", 9.81, 3000.0, 20.0),
    ("hard-stop", 0.0, 3000.0, 40.0),
    ("hard-stop", 9.81, 3000.0, 20.0),
    ("hard-stop", 0.5, 3000.0, 300.0),  # overdamped
    ("maxwell", 0.0, 3000.0, 100.0),
    ("maxwell", 9.81, 3000.0, 200.0),
    ("hunt-crossley", 0.0, 3000.0, 0.3),
    ("hunt-crossley", 9.81, 3000.0, 0.3),
    ("hunt-crossley", 1.0, 3000.0, 2.0),
    ("tsuji", 0.0, 3000.0, 30.0),
    ("tsuji", 0.0, 3000.0, 300.0),  # overdamped
    ("tsuji", 9.81, 3000.0, 30.0),
    ("tsuji", 0.1, 3000.0, 300.0),
    ("kuwabara-kono", 0.0, 3000.0, 0.005),
    ("kuwabara-kono", 0.0, 3000.0, 0.2),
    ("kuwabara-kono", 9.81, 3000.0, 0.005),
    ("kuwabara-kono", 0.5, 3000.0, 0.05),
]


@pytest.mark.parametrize(("law", "g", "k", "loss"), CASES)
def test_what_a_block_does_is_what_integration_by_hand_says(law, g, k, loss):
    found = design(law, m=0.8, v0=2.0, g=g, k=k, **{LAWS[law].loss: loss})
    expected = by_hand(law, 0.8, 2.0, g, k, loss)
    assert [getattr(found, name) for name in OUTPUTS] == pytest.approx(expected, rel=1e-7)


def test_a_small_loss_is_no_loss_of_digits():
    """1 - e a cancels where a = b v0 is small, and the contact time must not feel it."""
    found = design("hunt-crossley", m=1.0, v0=2.0, k=1e5, b=5e-4)
    assert found.contact_time == pytest.approx(by_hand("hunt-crossley", 1.0, 2.0, 0.0, 1e5, 5e-4)[1], rel=1e-9)


@pytest.mark.parametrize("law", TWO)
@pytest.mark.parametrize("ζ", [1e-4, 0.1, 0.3, 0.5, 0.7, 1.0, 2.5])
def test_without_gravity_the_laws_agree_with_the_registered_closed_forms(law, ζ):
    m, k, v0 = 2.0, 800.0, 3.0
    c = math.sqrt(k * m) / (2.0 * ζ) if law == "maxwell" else 2.0 * ζ * math.sqrt(k * m)
    found = design(law, m=m, v0=v0, k=k, c=c)
    facts = {fact.symbol: fact.value for fact in found.problem().facts}
    shown = {"e": found.e, "t_c": found.contact_time, "R_max": found.peak_force, "x_max": found.deflection}
    shared = facts.keys() & shown.keys()
    assert shared
    assert [shown[symbol] for symbol in shared] == pytest.approx([facts[symbol] for symbol in shared], rel=1e-10)


@pytest.mark.parametrize("n", [1.0, 1.2, 3.0])
@pytest.mark.parametrize("ζ", [1e-5, 0.3, 0.5, 1.0, 20.0])
def test_tsujis_closed_form_is_the_integration_of_the_law(ζ, n):
    """With n = 1 it is a Kelvin-Voigt block, whose force begins at its peak from ζ = 1/2 on."""
    c = ζ * math.sqrt(2.0 * (n + 1.0) * 800.0 * 2.0)
    found = design("tsuji", m=2.0, v0=3.0, k=800.0, c=c, n=n)
    expected = by_hand("tsuji", 2.0, 3.0, 0.0, 800.0, c, n)
    assert [getattr(found, name) for name in OUTPUTS] == pytest.approx(expected, rel=1e-8)
    if n == 1.0:
        linear = design("kelvin-voigt", m=2.0, v0=3.0, k=800.0, c=c)
        assert [getattr(found, name) for name in OUTPUTS] == pytest.approx(
            [getattr(linear, name) for name in OUTPUTS], rel=1e-11
        )


@pytest.mark.parametrize("a", [1e-4, 1e-3, 1e-2])
def test_kuwabara_and_konos_restitution_begins_with_the_known_term(a):
    m, v0, k = 2.0, 3.0, 800.0
    L = (1.25 * m * v0**2 / k) ** 0.4
    x = 1.2 * 1.25**0.6 * beta(0.6, 1.5) * (a * L / v0) * (k / m) ** 0.4 * v0**0.2
    found = design("kuwabara-kono", m=m, v0=v0, k=k, A=a * L / v0)
    assert 0.5 * x**2 < found.e - 1.0 + x < x**2


def test_a_stop_that_pushes_alone_lets_go_of_a_heavy_mass_with_a_speed_or_not_at_all():
    """At the border of staying its force ends where it touches zero, for a force by hand on both sides."""
    for law, low, high in (("tsuji", 1.0, 3000.0), ("kuwabara-kono", 1e-3, 10.0)):
        loss = LAWS[law].loss
        while high - low > 1e-9 * high:
            middle = 0.5 * (low + high)
            stays = math.isinf(design(law, m=1.0, v0=1.0, g=9.81, k=3000.0, **{loss: middle}).contact_time)
            low, high = (low, middle) if stays else (middle, high)
        assert design(law, m=1.0, v0=1.0, g=9.81, k=3000.0, **{loss: low}).e > 0.01
        for constant, leaves in ((low * (1.0 - 1e-3), True), (high * (1.0 + 1e-3), False)):
            assert math.isfinite(by_hand(law, 1.0, 1.0, 9.81, 3000.0, constant)[1]) == leaves


def test_the_inverses_that_penalties_use_are_found_too():
    block = design("kelvin-voigt", m=2.0, v0=3.0, e=0.4, contact_time=0.01)
    assert block.c == pytest.approx(2.0 * damping_ratio(0.4) * math.sqrt(block.k * 2.0), rel=1e-11)
    ball = design("hunt-crossley", m=2.0, v0=3.0, e=0.4, contact_time=0.01)
    assert ball.b * 3.0 == pytest.approx(loss_number(0.4), rel=1e-9)


@pytest.mark.parametrize("n", [1.0, 1.5, 2.2])
@pytest.mark.parametrize("g", [0.0, 40.0])
def test_hertz_is_its_energy_integral(n, g):
    m, v0, k = 0.5, 1.5, 2e4
    found = design("hertz", m=m, v0=v0, g=g, k=k, n=n)

    def speed(x):
        return math.sqrt(max(v0**2 + 2.0 * g * x - 2.0 * k * x ** (n + 1.0) / ((n + 1.0) * m), 0.0))

    assert found.e == 1.0
    assert speed(found.deflection * (1.0 - 1e-12)) < 1e-4 * v0
    assert found.peak_force == pytest.approx(k * found.deflection**n, rel=1e-12)
    half = quad(lambda u: 2.0 * found.deflection * u / speed(found.deflection * (1.0 - u * u)), 1e-6, 1.0, limit=200)[0]
    assert found.contact_time == pytest.approx(2.0 * half, rel=1e-4)
    if n == 1.0 and g == 0.0:
        assert found.contact_time == pytest.approx(math.pi * math.sqrt(m / k), rel=1e-12)


# ---- the round trip: wanted, found, simulated, wanted ---------------------------------------------------------------


def random_case(random, law, g):
    """A wanted pair that some block of the law has, since it was read off one."""
    m, v0 = 10.0 ** random.uniform(-2.0, 2.0), 10.0 ** random.uniform(-1.0, 1.0)
    length = v0 * 10.0 ** random.uniform(-4.0, -1.5)
    n = float(random.choice([1.5, 2.0])) if LAWS[law].n is None else None
    k = (1.0 + (n or 1.0)) * m * v0**2 / (2.0 * length ** (1.0 + (n or 1.0)))
    block = {"k": k}
    λ = 10.0 ** random.uniform(-2.0, -0.3)
    if law == "tsuji":
        block["c"] = λ * math.sqrt(2.0 * (n + 1.0) * k * m)
    elif LAWS[law].loss == "A":
        block["A"] = λ * length / v0
    elif LAWS[law].loss == "b":
        block["b"] = λ / v0
    elif LAWS[law].loss:
        block["c"] = math.sqrt(k * m) / (2.0 * λ) if law == "maxwell" else 2.0 * λ * math.sqrt(k * m)
    seen = design(law, m=m, v0=v0, g=g, n=n, **block)
    if math.isinf(seen.contact_time):
        return random_case(random, law, g)
    pool = [*(name for name in OUTPUTS if name != "e" or len(block) == 2), *block]
    names = random.choice(pool, size=len(block), replace=False)
    if g == 0.0 and set(names) == {"e", "b"}:
        return random_case(random, law, g)
    return {"m": m, "v0": v0, "g": g, "n": n, **{str(name): getattr(seen, name) for name in names}}


def round_trip(random, law, g):
    """The greatest relative error of a wanted output when the found impact is simulated."""
    case = random_case(random, law, g)
    worst = 0.0
    found = design(law, **case)
    for each in (found, *found.others):
        seen = each.measured()
        for name in OUTPUTS:
            predicted, simulated = getattr(each, name), getattr(seen, name)
            if name == "deflection" and each.e < 1e-9:
                continue  # a mass that stays approaches it for ever
            if name in case:
                worst = max(worst, abs(simulated / case[name] - 1.0))
            elif math.isfinite(predicted) and each.e > 1e-9:
                assert simulated == pytest.approx(predicted, rel=1e-7)
    return worst


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("g", [0.0, 9.81])
def test_what_is_wanted_is_what_is_simulated(law, g):
    random = np.random.default_rng(7)
    number = 1 if g > 0.0 and law in INTEGRATED else 4
    assert max(round_trip(random, law, g) for _ in range(number)) < 1e-8


@pytest.mark.slow
@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("g", [0.0, 9.81])
def test_round_trips_of_random_requirements(law, g):
    random = np.random.default_rng(11)
    number = 3 if g > 0.0 and law in INTEGRATED else 10
    assert max(round_trip(random, law, g) for _ in range(number)) < 1e-8


# ---- several solutions, and none ------------------------------------------------------------------------------------


def test_the_solution_with_least_damping_comes_first_and_the_others_with_it():
    """The peak of a Kelvin-Voigt block falls with c before it rises: two blocks have one peak."""
    found = design("kelvin-voigt", m=1.0, v0=2.0, k=3000.0, peak_force=100.0)
    (other,) = found.others
    assert found.c < other.c
    assert other.c * 2.0 == pytest.approx(100.0, abs=5.0)
    for each in (found, other):
        assert by_hand("kelvin-voigt", 1.0, 2.0, 0.0, 3000.0, each.c)[2] == pytest.approx(100.0, rel=1e-9)
    assert [row.c for row in found.table.itertuples()] == [found.c, other.c]


@pytest.mark.parametrize("g", [0.0, 9.81])
@pytest.mark.parametrize(
    ("law", "name", "k"), [("kelvin-voigt", "peak_force", 3000.0), ("maxwell", "contact_time", 3e4)]
)
def test_the_border_of_what_can_be_reached_is_sharp(law, name, k, g):
    """Just inside there is a block, just outside there is none, and the message says where the border lies."""
    with pytest.raises(InputError, match=f"{name} (lies between|is at least)") as raised:
        design(law, m=1.0, v0=2.0, g=g, k=k, **{name: 1e-3})
    low = float(str(raised.value).split("between ")[-1].split("least ")[-1].split()[0])
    inside = design(law, m=1.0, v0=2.0, g=g, k=k, **{name: low * (1.0 + 1e-6)})
    assert getattr(inside.measured(), name) == pytest.approx(low, rel=2e-6)
    with pytest.raises(InputError, match=f"no {law} block has {name}"):
        design(law, m=1.0, v0=2.0, g=g, k=k, **{name: low * (1.0 - 1e-6)})


def test_gravity_holds_a_mass_and_the_restitution_does_not_fall_to_zero_first():
    """At the border a Kelvin-Voigt block lets go at c g/k: the force by hand on both sides."""
    m, v0, g, k = 1.0, 0.2, 9.81, 1000.0
    low, high = 1.0, 60.0
    while high - low > 1e-9:
        c = 0.5 * (low + high)
        low, high = (
            (c, high) if math.isfinite(design("kelvin-voigt", m=m, v0=v0, g=g, k=k, c=c).contact_time) else (low, c)
        )
    last = design("kelvin-voigt", m=m, v0=v0, g=g, k=k, c=low)
    assert last.e * v0 == pytest.approx(low * g / k, rel=1e-3)
    held = design("kelvin-voigt", m=m, v0=v0, g=g, k=k, c=high)
    assert (held.e, held.contact_time) == (0.0, math.inf)
    for c, sign in ((low * (1.0 - 1e-6), -1.0), (low * (1.0 + 1e-6), 1.0)):
        run = solve_ivp(lambda t, s, c=c: [s[1], g - (c * s[1] + k * s[0]) / m], (0.0, 0.4), [0.0, v0], "DOP853",
                        t_eval=np.linspace(0.0, 0.4, 400_001), rtol=1e-12, atol=1e-15)  # fmt: skip
        assert sign * np.min(c * run.y[1] + k * run.y[0]) > 0.0
    with pytest.raises(InputError, match=r"e (lies between|is at least)"):
        design("kelvin-voigt", m=m, v0=v0, g=g, k=k, e=0.9 * last.e)
    assert design("kelvin-voigt", m=m, v0=v0, g=g, k=k, e=1.001 * last.e).c == pytest.approx(low, rel=1e-2)


def test_what_is_held_comes_to_rest_under_its_weight():
    held = design("kelvin-voigt", m=1.0, v0=0.5, g=9.81, k=100.0, c=200.0)
    assert held.deflection == pytest.approx(9.81 / 100.0, rel=1e-12)
    ball = design("hunt-crossley", m=1.0, v0=0.2, g=9.81, k=100.0, b=20.0)
    assert ball.e == 0.0
    assert ball.deflection >= (9.81 / 100.0) ** (2.0 / 3.0) * (1.0 - 1e-12)
    sinks = design("maxwell", m=1.0, v0=0.5, g=9.81, k=100.0, c=5.0)
    assert (sinks.e, sinks.deflection) == (0.0, math.inf)
    with pytest.raises(InputError, match="lets the mass rebound"):
        design("maxwell", m=1.0, v0=2.0, g=9.81, c=20.0, e=0.6)


def test_all_roots_of_an_equation_are_found_and_its_range():
    found = solve(lambda x: math.sin(x) if x < 8.0 else math.nan, np.linspace(0.0, 10.0, 41), 0.5)
    assert found.solutions == pytest.approx([math.pi / 6, 5 * math.pi / 6, 13 * math.pi / 6], rel=1e-12)
    assert (found.low, found.high) == pytest.approx((-1.0, 1.0), rel=1e-12)
    border = solve(lambda x: x if 1.234 <= x < 8.0 else math.nan, np.linspace(0.0, 10.0, 7), 1.234 + 1e-9)
    assert border.solutions == pytest.approx([1.234], rel=1e-8)
    touched = solve(lambda x: (x - 1.7) ** 2 + 1.0, np.linspace(0.0, 5.0, 11), 1.0)
    assert touched.solutions == pytest.approx([1.7], abs=1e-6)
    assert not solve(lambda x: math.nan, np.linspace(0.0, 1.0, 5), 1.0).solutions


@pytest.mark.parametrize("ζ", [0.0, 0.4, 0.999999, 1.0, 1.000001, 3.0])
@pytest.mark.parametrize(("p", "q"), [(1.0, 0.0), (1.0, 0.7), (-1.0, 2.0), (1.0, -3.0), (0.0, 1.0), (-1.0, -0.2)])
def test_turning_points_are_zeros_and_none_is_missed(ζ, p, q):
    t = np.linspace(1e-9, 6.0, 60_001)
    run = solve_ivp(
        lambda t, s: [s[1], -2.0 * ζ * s[1] - s[0]], (0.0, 6.0), [0.0, 1.0], "DOP853", t_eval=t, rtol=1e-12, atol=1e-14
    )
    value = p * run.y[1] + q * run.y[0]
    seen = t[1:][np.sign(value[1:]) * np.sign(value[:-1]) < 0.0]
    found = [τ for τ in extremum_times(p, q, ζ) if τ < 5.999]
    assert found == pytest.approx(list(seen[: len(found)]), abs=2e-4)
    assert len(found) == min(len(seen), 2)


# ---- refusals -------------------------------------------------------------------------------------------------------

GOOD = {"m": 1.0, "v0": 2.0}


@pytest.mark.parametrize(
    ("law", "given", "says"),
    [
        ("kelvin-voit", {"e": 0.5}, "did you mean 'kelvin-voigt'"),
        ("kelvin-voigt", {"e": 0.5}, "two constants, and e is given: give 1 more of contact_time, peak_force"),
        ("kelvin-voigt", {}, "nothing is given: give 2 more"),
        ("kelvin-voigt", {"e": 0.5, "k": 1.0, "c": 1.0}, "e, k, c are given: leave out"),
        ("hertz", {"k": 1.0, "contact_time": 1.0}, "one constant.*leave out"),
        ("hertz", {"e": 0.5}, "is conservative"),
        ("hunt-crossley", {"c": 0.5, "e": 0.5}, "has no c; its constants are k and b"),
        ("maxwell", {"b": 0.5, "e": 0.5}, "has no b"),
        ("maxwell", {"n": 1.5, "e": 0.5, "k": 1.0}, "has no n"),
        ("hertz", {"n": 0.5, "k": 1.0}, "n = 0.5 must be a finite number, at least 1"),
        ("hunt-crossley", {"e": 0.5, "b": 0.5}, "both determine only b v0"),
        ("kelvin-voigt", {"e": 1.0, "k": 5.0}, "must be below 1"),
        ("kelvin-voigt", {"e": -0.1, "k": 5.0}, "must be a positive"),
        ("kelvin-voigt", {"e": 0.5, "contact_time": math.nan}, "contact_time = nan must be a positive finite"),
        ("kelvin-voigt", {"e": 0.5, "k": 5.0, "m": 0.0}, "m = 0.0 must be a positive"),
        ("kelvin-voigt", {"e": 0.5, "k": 5.0, "v0": "2"}, "v0 = '2' must be"),
        ("kelvin-voigt", {"e": 0.5, "k": 5.0, "g": -9.81}, "g = -9.81 must be"),
        ("hertz", {"peak_force": 5.0, "g": 9.81}, "peak_force is at least"),
    ],
)
def test_what_cannot_be_is_refused_in_one_sentence(law, given, says):
    with pytest.raises(InputError, match=says) as raised:
        design(law, **(GOOD | given))
    assert "\n" not in str(raised.value)


# ---- what a design hands on -----------------------------------------------------------------------------------------


def test_a_design_without_gravity_is_a_registered_problem_with_its_closed_form():
    found = design("maxwell", m=1.0, v0=2.0, e=0.5, contact_time=0.02)
    assert found.problem().scheme == load_problem("maxwell-impact", m=1.0, v0=2.0, k=found.k, c=found.c).scheme
    assert found.problem().facts
    heavy = design("maxwell", m=1.0, v0=2.0, g=9.81, e=0.5, contact_time=0.02)
    assert heavy.problem().facts == ()
    assert heavy.problem().dynamics.force(np.zeros(1))[0, 0] == pytest.approx(9.81)


def test_the_table_names_what_it_holds():
    found = design("hunt-crossley", m=1.0, v0=2.0, e=0.5, contact_time=0.02)
    table = found.table
    assert list(table.columns) == [
        "law", "m", "v0", "g", "k", "c", "b", "A", "n", "e", "contact_time", "peak_force", "deflection", "found"
    ]  # fmt: skip
    assert "wanted: e = 0.5, contact_time = 0.02" in found.summary()
    assert math.isnan(table["c"][0])
    assert table["n"][0] == 1.5


@pytest.mark.parametrize("law", ["kelvin-voigt", "kelvin-voigt-tension", "hunt-crossley"])
def test_the_picture_shows_the_contact_and_what_was_wanted(law):
    found = design(law, m=1.0, v0=2.0, g=9.81, k=3000.0, deflection=0.03)
    over_time, over_way = found.plot().axes
    t, force = over_time.lines[0].get_data()
    scale = 1e3 if over_time.get_xlabel() == "$t$ [ms]" else 1.0
    assert t[-1] == pytest.approx(scale * min(found.contact_time, t[-1] / scale))
    assert np.max(force) == pytest.approx(found.peak_force, rel=1e-3)
    assert over_way.get_xlabel() == "$x$ [mm]"
    assert np.max(over_way.lines[0].get_xdata()) == pytest.approx(30.0, rel=1e-4)
    colors = {text.get_text().split()[0]: text.get_color() for text in over_time.texts + over_way.texts}
    assert colors["$x_\\mathrm{max}$"] != colors["$F_\\mathrm{max}$"]


def run_cli(capsys, *arguments):
    from lcpimpact.cli.main import main

    with pytest.raises(SystemExit) as left:
        main(["design", *arguments])
    return int(left.value.code or 0), capsys.readouterr()


def test_the_command_designs_and_writes(tmp_path, capsys):
    wanted = ["kelvin-voigt", "--m", "1", "--v0", "2", "--e", "0.5", "--contact-time", "0.01"]
    paths = [tmp_path / name for name in ("d.csv", "d.svg", "d.html")]
    code, said = run_cli(capsys, *wanted, "--out", str(paths[0]), "--plot", str(paths[1]), "--report", str(paths[2]))
    assert code == 0
    assert "restitution (wanted)" in said.out
    assert all(path.stat().st_size > 100 for path in paths)
    code, _ = run_cli(capsys, *wanted, "--g", "9.81", "--out", str(tmp_path / "d.toml"))
    assert code == 0
    run = read_scheme_file(tmp_path / "d.toml").simulate()
    assert next(each.t for each in run.events if each.kind == "open") == pytest.approx(0.01, rel=1e-8)


def test_the_command_refuses_before_it_works_and_in_one_line(tmp_path, capsys):
    for arguments in (
        ["kelvin-voigt", "--m", "1", "--v0", "2", "--e", "0.5"],
        ["kelvin-voigt", "--m", "1", "--v0", "2", "--e", "0.5", "--k", "10", "--out", str(tmp_path / "d.xyz")],
        ["maxwell", "--m", "1", "--v0", "2", "--deflection", "0.03", "--k", "3000", "--plot", str(tmp_path / "d.png")],
        ["kelvin-voigt", "--v0", "2", "--e", "0.5", "--k", "10"],
    ):
        code, said = run_cli(capsys, *arguments)
        assert code == 2, arguments
        assert said.err.count("\n") == 1
        assert not said.out
    assert not list(tmp_path.iterdir())


def test_a_peak_force_below_the_weight_is_refused_with_the_weight():
    with pytest.raises(InputError, match=r"whose weight is m g = 1177.2 N: take a larger one"):
        design("kelvin-voigt", m=120.0, v0=2.0, g=9.81, peak_force=900.0, e=0.5)


@pytest.mark.parametrize("law", ["kelvin-voigt", "maxwell"])
def test_its_uncertainty_has_the_derivatives_of_the_exact_motion(law):
    block = design(law, m=1.3, v0=2.0, e=0.5, contact_time=0.01)
    deviations = {"m": 0.02, "v0": 0.03, "k": 500.0, "c": 4.0}
    names = list(deviations)
    outputs = ["restitution", "contact_time", "peak_force", "deformation"]
    exact = sensitivity(block.problem(), names, outputs).table[names].to_numpy() * list(deviations.values())
    unsure = block.uncertainty(deviations)
    assert unsure.table["output"].tolist() == list(OUTPUTS)
    assert unsure.table[names].to_numpy() == pytest.approx(exact, rel=1e-9, abs=1e-14)
    assert unsure.table["deviation"].to_numpy() == pytest.approx(np.sqrt((exact**2).sum(axis=1)), rel=1e-9)


def test_the_uncertainty_of_hertz_has_the_powers_of_its_law():
    ball = design("hertz", m=1.0, v0=2.0, contact_time=0.01)
    found = ball.uncertainty({"m": 1e-3, "k": 1e-3 * ball.k, "v0": 2e-3}).table.set_index("output")
    powers = {  # of m, k and v0
        "e": (0.0, 0.0, 0.0),
        "contact_time": (0.4, -0.4, -0.2),
        "peak_force": (0.6, 0.4, 1.2),
        "deflection": (0.4, -0.4, 0.8),
    }
    for output, each in powers.items():
        relative = found.loc[output, ["m", "k", "v0"]].to_numpy(dtype=float) / found.loc[output, "value"]
        assert relative == pytest.approx(1e-3 * np.array(each), rel=1e-8, abs=1e-13), output


def test_a_mass_that_stays_has_an_uncertainty_of_what_is_finite():
    held = design("kelvin-voigt", m=1.0, v0=0.1, g=9.81, k=3000.0, c=200.0)
    assert math.isinf(held.contact_time)
    table = held.uncertainty({"k": 30.0}).table
    assert table["output"].tolist() == ["e", "peak_force", "deflection"]
    assert np.isfinite(table["deviation"]).all()


def test_uncertain_is_what_the_law_has_and_nothing_else(capsys):
    block = design("kelvin-voigt", m=1.0, v0=2.0, e=0.5, contact_time=0.01)
    with pytest.raises(InputError, match="unknown parameter of the derivatives 'b': known are m, v0, g, k, c"):
        block.uncertainty({"b": 0.1})
    line = "kelvin-voigt --m 1 --v0 2 --e 0.5 --contact-time 0.01 --deviations k=1000,c=5"
    code, said = run_cli(capsys, *line.split())
    assert code == 0
    assert "peak_force    N     440.076     3.04197" in said.out
