"""The table of durations: against a report that is added up by hand."""

import durations
import pytest

REPORT = """<testsuites><testsuite name="pytest">
<testcase classname="tests.run.test_files" name="test_a[1]" time="1.5" />
<testcase classname="tests.run.test_files.TestClass" name="test_b" time="0.25" />
<testcase classname="tests.test_formula" name="test_c" time="4.0"><failure message="no">E</failure></testcase>
<testcase classname="lcpimpact.hybrid.exact" name="lcpimpact.hybrid.exact.Exact" time="0.5" />
<testcase classname="tests.run.test_files" name="test_d" time="0.001"><skipped type="pytest.skip"
 message="needs Octave">file:1: needs Octave</skipped></testcase>
<testcase classname="tests.run.test_files" name="test_e" time="0.001"><skipped type="pytest.skip"
 message="rk4 does not handle friction" /></testcase>
<testcase classname="tests.run.test_files" name="test_f" time="2.0"><skipped type="pytest.xfail"
 message="known" /></testcase>
</testsuite></testsuites>"""


@pytest.fixture
def report(tmp_path):
    path = tmp_path / "report.xml"
    path.write_text(REPORT, encoding="utf-8")
    return path


def test_seconds_are_added_up_by_folder(report, monkeypatch, capsys):
    monkeypatch.setattr("sys.argv", ["durations.py", str(report), str(report), "--longest", "1"])
    assert durations.main() == 0
    lines = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert lines[1:5] == [
        ["8.0", "2", "tests"],
        ["7.5", "6", "tests/run"],
        ["1.0", "2", "lcpimpact/hybrid"],
        ["16.5", "10", "all"],
    ]
    assert lines[6:9] == [["seconds", "the", "longest", "tests"], ["4.0", "tests.test_formula::test_c"], []]


def test_the_seconds_of_each_report_are_written(report, monkeypatch, tmp_path):
    out = tmp_path / "durations.csv"
    monkeypatch.setattr("sys.argv", ["durations.py", str(report), str(report), "--out", str(out)])
    durations.main()
    rows = ["report,tests,1,4.0", "report,tests/run,3,3.8", "report,lcpimpact/hybrid,1,0.5"]
    assert out.read_text(encoding="utf-8").splitlines() == ["report,folder,tests,seconds", *rows, *rows]


def test_what_is_missing_here_is_said_and_a_refusal_is_not(report, monkeypatch, capsys):
    monkeypatch.setattr("sys.argv", ["durations.py", str(report)])
    durations.main()
    assert capsys.readouterr().out.splitlines()[-2:] == [
        "2 tests skipped, 1 of them for what is missing here",
        "not tested: 1 tests: needs Octave",
    ]


def test_every_reason_of_a_missing_thing_in_the_tests_is_taken_for_one():
    """The reasons that skips of the tests state, as far as they are about the machine."""
    told = [
        "needs Octave",
        "node, which runs the page's code, is not installed",
        "could not import 'zarr': No module named 'zarr'",
        "Siconos is not installed: apt-get install python3-siconos",
    ]
    assert all(map(durations.MISSING.search, told))
    assert not durations.MISSING.search("rk4 does not handle sliders (slider 'F') of 'coulomb-oscillator'")


def test_without_a_report_it_says_what_it_needs(monkeypatch, capsys):
    monkeypatch.setattr("sys.argv", ["durations.py"])
    with pytest.raises(SystemExit):
        durations.main()
    assert "name the reports that pytest --junitxml wrote" in capsys.readouterr().err
