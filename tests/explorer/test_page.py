"""The page in headless Chromium, and what its command says."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from chromium import chromium, opened
from test_kernel import cases, compare, numbers, python_run

import lcpimpact as li
from lcpimpact.cli.main import main
from lcpimpact.explorer.models import Model
from lcpimpact.explorer.page import all_models, axes, page
from lcpimpact.plotting.layout import Layout
from lcpimpact.problems import PROBLEMS

STEPS = 300

in_chromium = pytest.mark.skipif(chromium() is None, reason="Chromium, which shows the page, is not installed")

RUN = """
ready.then(() => JSON.stringify(JOBS.map(({problem, method, values, tEnd, steps}) => {
  const o = simulate(problems[problem], method, values, tEnd, steps);
  const hex = (a) => Array.from(new Uint8Array(a.buffer), (x) => x.toString(16).padStart(2, "0")).join("");
  return {taken: o.taken, q: hex(o.q), v: hex(o.v), r: hex(o.r)};
})))
"""


@pytest.fixture(scope="module")
def whole(tmp_path_factory) -> tuple[Path, list[Model], dict[str, str]]:
    """The page of all problems."""
    found, refused = all_models()
    path = tmp_path_factory.mktemp("explorer") / "explorer.html"
    path.write_text(page(found, refused), encoding="utf-8")
    return path, found, refused


def test_the_page_is_small_and_complete(whole):
    path, found, refused = whole
    assert path.stat().st_size <= 143_000
    assert {each.problem.name for each in found} | refused.keys() == set(PROBLEMS)
    assert len(found) >= 41
    text = path.read_text(encoding="utf-8")
    assert not any(each in text for each in ('<link rel="stylesheet', "src=", "@import", "fetch("))


@in_chromium
def test_every_number_of_the_page_is_that_of_simulate(whole):
    path, found, _ = whole
    sets = [(each, method, values) for each in found for method in each.traces for values in cases(each, 1)]
    jobs = [
        {"problem": each.problem.name, "method": method, "values": values, "tEnd": each.t_end, "steps": STEPS}
        for each, method, values in sets
    ]
    equal = 0
    with opened(path.as_uri()) as browser:
        results = json.loads(browser.value(RUN.replace("JOBS", json.dumps(jobs))))
        assert browser.requests == [path.as_uri()]
        assert browser.errors == []
    for (each, method, values), result in zip(sets, results, strict=True):
        run, taken = python_run(each, method, values, STEPS), result["taken"]
        assert taken == STEPS
        for name, ours, rows in (
            ("q", run.q, taken + 1),
            ("v", run.v, taken + 1),
            ("r", run.reaction, max(taken - 2, 0)),
        ):
            if not ours.size:
                continue
            theirs = numbers(result[name], ours.shape[1])[:rows]
            compare(each, method, name, theirs, ours[:rows])
            equal += theirs.size
    assert equal > 140_000


@in_chromium
def test_keys_sliders_and_permalinks(tmp_path):
    path = li.explore("system-1", tmp_path / "page.html")
    with opened(path.as_uri() + "#system-1&moreau-jean&c_o=300&steps=500&t_end=2&at=40", 390, 844) as browser:
        assert browser.value("[state.values.c_o, state.steps, state.tEnd, state.k]") == [300.0, 500, 2.0, 40]
        browser.press("ArrowRight", 39)
        browser.press("ArrowRight", 39)
        browser.press("ArrowLeft", 37)
        assert browser.value("state.k") == 41
        browser.press("End", 35)
        assert browser.value("state.k") == 500
        # The Tab key alone reaches every control.
        reached = set()
        for _ in range(60):
            browser.press("Tab", 9)
            reached.add(browser.value("[...document.querySelectorAll('*')].indexOf(document.activeElement)"))
        kinds = "select, button, input, summary"
        controls = f"[...document.querySelectorAll('{kinds}')].filter((each) => !each.disabled)"
        assert (
            set(browser.value(f"{controls}.map((each) => [...document.querySelectorAll('*')].indexOf(each))"))
            <= reached
        )
        before = browser.value("run.q[200]")
        browser.value("document.querySelector('#sliders input[type=range]').focus()")
        browser.press("ArrowRight", 39)
        assert browser.value("run.q[200]") != before
        assert browser.value("document.documentElement.scrollWidth") <= 390
        # What cannot be run is said in the words of Python, and nothing is drawn.
        for name, value in {"m": -3, "c_o": 0, "theta": 0.4}.items():
            browser.value(f"choose('system-1'); state.values.{name} = {value}; compute()")
            said = browser.value("document.getElementById('status').textContent")
            options = {name: float(value)}
            with pytest.raises(li.InputError) as error:
                li.load_problem("system-1", **options) if name != "theta" else li.simulate(
                    li.load_problem("system-1"), dt=0.1, **options
                )
            assert said == str(error.value)
        assert browser.errors == []


@in_chromium
def test_the_page_of_a_scheme_file(tmp_path):
    scheme = li.Scheme(
        li.Mass("x", m=2.0), li.Load("x", f=20.0), li.KelvinVoigt("x", "ground", k=300.0, c=4.0),
        li.Bumper("x", "ground", gap=0.02, e=0.5),
    )  # fmt: skip
    file = li.write_scheme_file(li.Problem("mine", scheme, v0={"x": 1.0}, t_end=2.0), tmp_path / "my.toml")
    with pytest.raises(SystemExit) as stop:
        main(["explore", str(file), "--no-open", "--out", str(tmp_path / "my.html")])
    assert stop.value.code == 0
    ours = li.read_scheme_file(file).problem
    run = li.simulate(ours, dt=ours.t_end / 1000, t_end=ours.t_end, progress=False)
    with opened((tmp_path / "my.html").as_uri(), 390, 844) as browser:
        assert browser.value("[by('problem').value, state.method, run.taken]") == ["mine", "moreau-jean", 1000]
        assert browser.value("[...by('method').options].map((each) => each.value).length") == 9
        strokes = sum(len(link.part.strokes) for link in Layout(ours.scheme.elements).links)
        assert browser.value("by('scheme').querySelectorAll('polyline').length") == strokes > 0
        assert browser.value("Array.from(run.q)") == run.q.ravel().tolist()
        before = browser.value("run.q[900]")
        browser.value("document.querySelector('#sliders input[type=range]').focus()")
        browser.press("ArrowRight", 39)
        assert browser.value("run.q[900]") != before
        assert browser.value("document.documentElement.scrollWidth") <= 390
        assert browser.errors == []


@in_chromium
def test_a_sum_of_coordinates_moves_in_the_drawing(tmp_path):
    corner = li.Bumper({"x": 1.0, "φ": -0.25}, "ground", gap=5.0, e=0.5)
    scheme = li.Scheme(li.Mass("x", m=1.0), li.Mass("φ", m=1.0), li.Spring("x", "ground", k=2.0), corner)
    problem = li.Problem("corner", scheme, {}, {"x": 1.0, "φ": -2.0}, t_end=1.0)
    with opened(li.explore(problem, tmp_path / "page.html").as_uri()) as browser:
        browser.value("moveTo(700)")
        groups = "[...by('scheme').querySelectorAll('g')].filter((each) => each.hasAttribute('transform'))"
        moved = f"{groups}.map((each) => [each.textContent, each.transform.baseVal[0].matrix.f])"
        found = {name.removesuffix("m"): y for name, y in browser.value(moved)}
        q = dict(zip(problem.dynamics.nodes, browser.value("Array.from(run.q.slice(1400, 1402))"), strict=True))
    scale = found["x"] / q["x"]
    assert found[""] == 0.0  # the ground
    assert found["φ"] == pytest.approx(scale * q["φ"], rel=1e-5)
    assert found["x - 0.25 φ"] == pytest.approx(scale * (q["x"] - 0.25 * q["φ"]), rel=1e-5)


@in_chromium
def test_the_call_that_the_page_shows_gives_its_run(tmp_path):
    path = li.explore("impact-oscillator", tmp_path / "page.html")
    with opened(path.as_uri() + "#impact-oscillator&moreau-jean&Mass.m=1.25&theta=0.75&steps=200") as browser:
        call, last = browser.value("[document.getElementById('command').textContent, run.q[200]]")
    assert "Mass.m" in call
    assert "theta=0.75" in call
    run = eval(call, {"li": li})
    assert run.q[-1, 0] == last


def test_the_command_writes_and_opens_the_page(capsys, tmp_path, monkeypatch):
    seen = []
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("webbrowser.open", seen.append)
    li.write_scheme_file(li.load_problem("system-1"), Path("my.toml"))
    for words in (["my.toml", "--t-end", "2"], ["bouncing-ball", "--no-open", "--out", "ball.html"]):
        with pytest.raises(SystemExit) as stop:
            main(["explore", *words])
        assert stop.value.code == 0
    assert seen == [(tmp_path / "my.html").as_uri()]
    assert "wrote ball.html" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["ball-in-air"], "forces by a function of the motion"),
        (["buck-converter"], "no sums, products and square roots"),
        (["hertz-impact"], "non-linear springs"),
        (["bar-impact"], "more than 8 nodes"),
        (["system-9"], "did you mean"),
        (["system-1", "--t-end", "-1"], "must be a positive finite number"),
        (["system-1", "--out", "page.txt"], "must end in one of .html"),
        (["--set", "k_o=1"], "go with a problem"),
    ],
)
def test_what_is_not_taken_is_refused_in_one_line(capsys, tmp_path, monkeypatch, words, said):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as stop:
        main(["explore", "--no-open", *words])
    assert stop.value.code == 2
    error = capsys.readouterr().err
    assert said in error
    assert error.count("\n") == 1
    assert [*tmp_path.iterdir()] == []


@in_chromium
@pytest.mark.parametrize(
    "name", ["a  // b", "__proto__", "constructor", "50% & more", 'a"b\\', "</script>", "<b>&amp;", "`${1}"]
)
def test_a_problem_of_any_name_is_shown(name, tmp_path):
    problem = li.Problem(
        name, li.Scheme(li.Mass("x", m=1.0), li.Load("x", f=9.81), li.Bumper("x", "ground", 1.0, 0.5)), t_end=1.0
    )
    path = li.explore(problem, tmp_path / "page.html")
    with opened(path.as_uri()) as browser:
        assert browser.value("[state.problem, run.taken, by('wrong').textContent]") == [name, 1000, ""]
        browser.value("new Promise((done) => setTimeout(done, 400))")
        link = browser.value("location.href")
    with opened(link.replace("steps=1000", "steps=500")) as browser:
        assert browser.value("[state.problem, run.taken, by('wrong').textContent]") == [name, 500, ""]
        assert browser.errors == []


@in_chromium
@pytest.mark.parametrize(
    ("address", "said"),
    [
        ("#%", "cannot be read after its #"),
        ("#constructor", "has no problem 'constructor'"),
        ("#toString", "has no problem 'toString'"),
        ("#__proto__", "has no problem '__proto__'"),
        ("#system-1&moreau-jean&text=%%%", "cannot be read after its #"),
        ("#system-1&constructor", "does not run system-1 by 'constructor'"),
        ("#system-1&moreau-jean&constructor=1&steps=1e400&at=nan", ""),
        ("", ""),
    ],
)
def test_an_address_that_cannot_be_shown_says_so_beside_what_is_shown(address, said, tmp_path):
    path = li.explore("system-1", tmp_path / "page.html")
    with opened(path.as_uri() + address) as browser:
        shown, taken, told = browser.value("[state.problem, run.taken, by('wrong').textContent]")
        assert (shown, taken) == ("system-1", 1000)
        assert said in told
        assert bool(said) == bool(told)
        assert browser.errors == []


@in_chromium
def test_what_fails_in_the_page_is_said_in_it(tmp_path):
    path = li.explore("system-1", tmp_path / "page.html")
    fail = {"throw Error('one')": "one", "Promise.reject(Error('two'))": "two"}
    with opened(path.as_uri()) as browser:
        for code, text in fail.items():
            browser.value(f"void setTimeout(() => {{ {code}; }})")
            said = browser.value("new Promise((done) => setTimeout(() => done(by('wrong').textContent), 200))")
            assert said.endswith(text)
            assert said.startswith("This page failed: ")


def test_the_axes_of_a_page_point_as_those_of_a_plot():
    assert axes(li.load_problem("bouncing-ball")) == [[[0], "m", "m/s", True, [[0, 0]]]]
    directions = [(each[0], each[1], each[3]) for each in axes(li.load_problem("rolling-sphere"))]
    assert directions == [([0], "m", False), ([1], "m", True), ([2], "rad", False)]
    assert axes(li.load_problem("shaw-holmes"))[0][1:3] == ["1", "1"]
