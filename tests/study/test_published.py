"""Judged from outside: problems whose truth others published, and what the page says of them."""

import others
import pytest
from others_published import REFERENCE_FMU_BOUNCES, gearbox, gearbox_by_its_automaton, gradient

import lcpimpact as li


@pytest.fixture(scope="module")
def page():
    return others.PAGE.read_text(encoding="utf-8").split("## Judged from outside")[1].split("\n## ")[0]


def struck(run):
    return [event for event in run.events if event.kind == "impact"]


def test_the_gearbox_is_that_of_its_published_automaton(page):
    impacts, meshed, impulse = gearbox_by_its_automaton()
    run = li.simulate(gearbox(), "exact", dt=1e-3, t_end=0.15, progress=False)
    assert [(event.t, event.impulse) for event in struck(run)[:3]] == pytest.approx(
        [pytest.approx(each, rel=1e-10) for each in impacts]
    )
    tooth = struck(run)[3]
    assert tooth.contact == "tooth"
    assert tooth.t == pytest.approx(meshed, rel=1e-12)
    accumulated = sum(event.impulse for event in struck(run)[:3]) + 3.2 * sum(abs(tooth.left.v))
    assert accumulated == pytest.approx(impulse, rel=1e-11)
    assert meshed < 0.2, "a specification of the competition"
    assert impulse < 20.0, "a specification of the competition"
    for figure in [meshed, impulse, *(t for t, _ in impacts)]:
        assert f"{figure:.10f}" in page


@pytest.mark.parametrize(("dt", "right"), [(1e-3, False), (1e-4, True)])
def test_a_time_step_may_miss_the_meshing(dt, right):
    run = li.simulate(gearbox(), "rattle-ns", dt=dt, t_end=0.15, progress=False)
    assert (run["px"][-1] == pytest.approx(-0.003, abs=1e-6)) == right


def test_the_ball_of_the_reference_fmus(page):
    ball = li.load_problem("bouncing-ball", e=0.7)
    run = li.simulate(ball, "exact", dt=1e-2, t_end=2.4, progress=False)
    times = [event.t for event in struck(run)]
    flight = (2.0 / 9.81) ** 0.5
    assert times == pytest.approx(
        [flight * (1.0 + 2.0 * sum(0.7**i for i in range(1, n + 1))) for n in range(8)], rel=1e-12
    )
    off = [abs(theirs - ours) for theirs, ours in zip(REFERENCE_FMU_BOUNCES, times, strict=True)]
    assert off == sorted(off), "their file drifts"
    assert f"{off[0]:.0e}" in page
    assert f"{off[-1]:.1e}" in page


def test_the_gradient_across_an_elastic_impact(page):
    assert gradient("exact", 1e-2) == pytest.approx((1.0, 0.0, 1.0, 0.0), abs=1e-8)
    wrong = gradient("moreau-jean", 1e-2)
    assert wrong == pytest.approx((0.0, 1.0, 0.675, 0.325), abs=1e-6)
    assert f"({', '.join(f'{each:.3g}' for each in wrong)})" in page.replace("-0,", "0,")
