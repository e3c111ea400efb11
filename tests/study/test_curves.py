"""CSV files of measurements: separators, decimal marks, encodings, and what is refused since it could mean two things."""

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lcpimpact import InputError, fit, load_problem, read_curves, simulate
from lcpimpact.study.design.curves import CurveTable

POINT = [(0.0, 1.5), (0.001, -2.25e3), (0.5, 1234.5)]


def written(path, text, encoding="utf-8"):
    path.write_bytes(text.encode(encoding))
    return path


def read(path, decimal=None):
    frame = CurveTable.of(path, decimal).curve(["R"])
    return list(zip(frame["t"], frame["R"], strict=True))


@pytest.mark.parametrize(
    "text",
    [
        "t,R\n0,1.5\n0.001,-2.25e3\n0.5,1234.5\n",
        "t;R\n0;1,5\n0,001;-2,25e3\n0,5;1234,5\n",
        "t;R\n0;1.5\n0.001;-2.25e3\n0.5;1234.5\n",
        "t\tR\n0\t1,5\n0,001\t-2,25e3\n0,5\t1234,5\n",
        "t\tR\n0\t1.5\n0.001\t-2.25e3\n0.5\t1234.5\n",
        "\ufefft;R\r\n0;1,5\r\n0,001;-2,25e3\r\n0,5;1234,5\r\n",
        "\ufefft , R\n0, 1.5\n0.001, -2.25e3\n0.5, 1234.5\n\n\n",
        "R ; t; \n1,5;0 ;\n-2,25E+03;0,001;\n1234,5;0,5;\n",
        '"t";"R";"a, b"\n0;1,5;"c, d"\n0,001;-2,25e3;e\n0,5;1234,5;""\n',
        "t;R\n0;1.5\n1D-3;−2.25D+03\n5.0d−1;1234.5\n",
        "t;R;when\n0;1,5;24.11.2026 10:30\n0,001;-2,25e3;24.11.2026\n0,5;1234,5;\n",
    ],
)
def test_files_of_instruments_and_spreadsheets_are_read(text, tmp_path):
    assert read(written(tmp_path / "data.csv", text)) == POINT


def test_quoted_decimal_commas_between_commas_are_read(tmp_path):
    path = written(tmp_path / "data.csv", 't,R\n0,"1,5"\n"0,001","-2,25e3"\n"0,5","1234,5"\n')
    assert read(path) == read(path, ",") == POINT
    with pytest.raises(InputError, match=r"column t: no finite number in lines 3, 4, as '0,001'"):
        read(path, ".")


@pytest.mark.parametrize(
    "text",
    [
        "Zeit [ms];Kraft [kN]\n0;0,0015\n1;-2,25\n500;1,2345\n",
        "Zeit [ms];Kraft [kN];\n0;0,0015;\n1;-2,25;\n500;1,2345;\n",
        "Zeit [ms];Kraft [kN]\n0;0,0015;\n1;-2,25;;\n500;1,2345\n",
        "t (ms),F in kN\n0,0.0015\n1,-2.25\n500,1.2345\n",
        "time / ms\tF/kN\n0\t0.0015\n1\t-2.25\n500\t1.2345\n",
        "Zeit, ms;Kraft, kN\n0;0,0015\n1;-2,25\n500;1,2345\n",
        "Zeit;Kraft\nms;kN\n0;0,0015\n1;-2,25\n500;1,2345\n",
        "Zeit;Kraft;Kanal\n[ms];[kN];\n0;0,0015;1\n1;-2,25;1\n500;1,2345;1\n",
        "Messung;Versuch 5\nDatum;24.11.2026\nRate;1000\n\nKraft [kN];Zeit [ms]\n0,0015;0\n-2,25;1\n1,2345;500\n",
        "# test 5\n# at 10:30\nt [ms];F [kN]\n# calibrated\n0;0.0015\n1;-2.25\n# again\n500;1.2345\n",
        "# t [ms],F [kN]\n0,0.0015\n1,-2.25\n500,1.2345\n",
        "sep=;\r\nt [ms];F [kN]\r\n0;0,0015\r\n1;-2,25\r\n500;1,2345\r\n",
        "Kanal 1 [ms];Kanal 2 [kN]\r0;0,0015\r1;-2,25\r500;1,2345\r",
        "t [µs];F [MN]\n0;1.5e-6\n1000;-2.25e-3\n500000;1.2345e-3\n",
    ],
)
def test_units_and_names_of_headers(text, tmp_path):
    path = written(tmp_path / "data.csv", text)
    force = next(name for name in ("Kraft", "F", "Kanal 2") if name in text)
    found = read_curves(path, {"R": force})
    np.testing.assert_allclose(found[["t", "R"]].to_numpy(), POINT, rtol=2.0**-52, atol=0.0)
    assert found.attrs["units"] == {"t": "s", "R": "N"}


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "cp1252", "latin-1"])
def test_encodings_of_instruments(encoding, tmp_path):
    path = written(tmp_path / "data.csv", "Zeit [µs];Größe [kN]\n0;1,5\n1000;2,5\n", encoding)
    found = read_curves(path)
    assert found.to_dict("list") == {"t": [0.0, 0.001], "Größe": [1500.0, 2500.0]}


def test_a_table_in_memory_has_units_in_its_header_too():
    table = pd.DataFrame({"Zeit [ms]": [0.0, 5.0], "Weg [mm]": [1.0, 2.0]})
    assert read_curves(table, {"x": "Weg"}).to_dict("list") == {"t": [0.0, 0.005], "x": [0.001, 0.002]}


@pytest.mark.parametrize(
    ("unit", "value", "coherent"),
    [("kp", 9.80665, "N"), ("inch", 0.0254, "m"), ("rpm", 2.0 * np.pi / 60.0, "rad/s"), ("%", 0.01, "1")],
)
def test_units_of_workshops(unit, value, coherent):
    found = read_curves(pd.DataFrame({"t": [0.0, 1.0], f"a [{unit}]": [1.0, 2.0]}))
    assert found["a"].tolist() == pytest.approx([value, 2.0 * value], rel=1e-15)
    assert found.attrs["units"]["a"] == coherent


def test_stated_units_and_times_count_before_those_of_the_header(tmp_path):
    path = written(tmp_path / "data.csv", "Zeit;Uhr [ms];Kraft [N]\n0;7;1\n1;9;2\n")
    found = read_curves(path, ["Kraft"], time="Uhr", units={"Kraft": "kN"})
    assert found.to_dict("list") == {"t": [0.007, 0.009], "Kraft": [1000.0, 2000.0]}
    assert read_curves(path, ["Kraft"])["t"].tolist() == [0.0, 1.0]
    assert read_curves(path, ["Kraft"], units={"Zeit": "min"})["t"].tolist() == [0.0, 60.0]


@pytest.mark.parametrize(
    ("text", "options", "says"),
    [
        ("a;b\n0;1\n1;2\n", {}, "no column t: say which of 'a', 'b' has the times, as time='a' (--time)"),
        ("a [s];b [ms]\n0;1\n1;2\n", {}, "no column t: say which of 'a [s]', 'b [ms]' has the times"),
        ("Zeit;b\n0;1\n1;2\n", {"time": "Zeitt"}, "unknown column 'Zeitt': did you mean 'Zeit'?"),
        ("t;F [kNn]\n0;1\n1;2\n", {}, "column 'F [kNn]': unknown unit 'kNn': did you mean 'kN'?"),
        ("t;F [kNn]\n0;1\n1;2\n", {}, "and 239 more, all listed in the guide 'Design and fit'; state another"),
        ("t;F\n0;1\n1;2\n", {"units": {"F": "KN"}}, "column 'F': unknown unit 'KN': did you mean 'kN'?"),
        ("t [kN];F\n0;1\n1;2\n", {}, "column 't [kN]': 'kN' is no unit for what is in s, as ms, ks or Ms"),
        ("t;F\n0;1\n1;2\n", {"units": {"G": "kN"}}, "unknown column 'G'"),
        (
            "t;F [N];F [kN]\n0;1;1\n1;2;2\n",
            {"columns": ["F"]},
            "'F' names several columns: say one of 'F [N]', 'F [kN]'",
        ),
        ("t;F\n0;1\n1;\n2;3\n", {}, "column F: no finite number in line 3; fill or delete them"),
        ("Datum;heute\nt;F\ns;kN\n0;1\n1;?\n2;3\n", {}, "column F: no finite number in line 5, as '?'; fill"),
        ("# a\nt;F\n0;1\n# b\n1;2\n1;3\n", {}, "t does not rise in line 6"),
        ("0;1\n1;2\n", {}, "no column t: say which of"),
        ("\n\n", {}, "it holds no table; write a header and numbers"),
    ],
)
def test_what_a_file_does_not_say_is_asked_for(text, options, says, tmp_path):
    path = written(tmp_path / "data.csv", text)
    with pytest.raises(InputError) as raised:
        read_curves(path, **options)
    assert says in str(raised.value)
    assert str(raised.value).startswith(f"cannot read {str(path)!r}: ")
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize(
    ("text", "decimal", "value"),
    [("t;R\n1;1,234\n2;12,345\n", ",", 1.234), ("t;R\n1;1.234\n2;12.345\n", ".", 1.234)],
)
def test_what_may_be_thousands_is_refused_until_the_mark_is_stated(text, decimal, value, tmp_path):
    path = written(tmp_path / "data.csv", text)
    with pytest.raises(
        InputError,
        match=r"data\.csv': the mark in '1.234' may separate decimals or thousands; state decimal=.* \(--decimal\)",
    ):
        read(path)
    assert read(path, decimal)[0] == (1.0, value)


@pytest.mark.parametrize(
    ("text", "decimal", "says"),
    [
        ("t,R\n1,5,2,5\n", None, "line 2 has more cells than the header, which has 2; where commas are decimal marks"),
        ("t,R\n0,1\n1,5,2,5\n", None, "line 3 has more cells than the header, which has 2"),
        ("t,R\n0,1,\n", None, "line 2 has more cells than the header"),
        ("t;R\n0,5;1.234,5\n", None, "'1.234,5' and '0,5' have points and commas: remove thousands separators"),
        ("t;R\n0,5;1.234\n", None, "'1.234' and '0,5' have points and commas"),
        ("t;R\n0,5;1.234\n1,5;2\n", ",", "column R: no finite number in line 2"),
        ("t;R\n0.5;1\n", ",", "column t: no finite number in line 2"),
        ('t,R\n0.5,"1,234.5"\n', None, "'1,234.5' have points and commas: remove thousands separators"),
        (
            "t;R\n0;1'234,5\n",
            None,
            'column R: no finite number in line 2, as "1\'234,5"; write it without thousands separators, as 1234,5',
        ),
        (
            "t;R\n0;1 234,5\n",
            None,
            "column R: no finite number in line 2, as '1 234,5'; write it without thousands separators, as 1234,5",
        ),
        ("t;R\n0;1\u202f234,5\n", None, "write it without thousands separators, as 1234,5"),
        ("t;R\n0;1’234.5\n", None, "write it without thousands separators, as 1234.5"),
        ("t;R\n0;1 23,5\n", None, "as '1 23,5'; fill or delete them"),
        ("t R\n0 1\n", None, "blanks separate its columns; separate them by tabs or semicolons"),
        ("t;R\n0;1,5\n0,1;NaN\n", None, "column R: no finite number in line 3, as 'NaN'"),
        ("t;R\n0;1,5\n0,1;\n0,2;1,5\n", None, "column R: no finite number in line 3"),
        ("t;R\n[s];[Newton]\n0,1;1,5\n", None, "column 'R': unknown unit 'Newton'"),
        ("t;R;R\n0;1;2\n", None, "two of its columns have one name"),
        ("t|R\n0|1\n", None, "unknown column 't'"),
        ("t;R\n0,5;1\n0,4;2\n", None, "t does not rise in line 3"),
        ("t;R\n0,5;1\n", ";", "decimal = ';' must be '.' or ','"),
        ("", None, "it holds no table"),
    ],
)
def test_other_files_are_refused_by_name(text, decimal, says, tmp_path):
    path = written(tmp_path / "data.csv", text)
    with pytest.raises(InputError, match=says) as raised:
        read(path, decimal)
    assert "\n" not in str(raised.value)
    assert "data.csv" in str(raised.value)


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"t;R\x81\n0;1\n\xff", "its text is in none of UTF-8, UTF-16 and Windows-1252; save it as CSV in UTF-8"),
        (b"PK\0\0t;R\n", "it is no text; export it as CSV, or as .xlsx"),
    ],
)
def test_what_is_no_text_is_refused(content, says, tmp_path):
    (tmp_path / "data.csv").write_bytes(content)
    with pytest.raises(InputError, match=rf"cannot read .*data\.csv': {says}"):
        read(tmp_path / "data.csv")


def test_a_workbook_is_read(tmp_path):
    pytest.importorskip("openpyxl")
    table = pd.DataFrame(
        {"Zeit [ms]": [0.0, 1.0, 500.0], "Kraft [kN]": [0.0015, -2.25, "1,2345"], "when": "24.11.2026"}
    )
    table.to_excel(tmp_path / "a.xlsx", index=False, startrow=2)
    found = read_curves(tmp_path / "a.xlsx", {"R": "Kraft"})
    assert list(zip(found["t"], found["R"], strict=True)) == POINT
    table.loc[1, "Kraft [kN]"] = None
    table.to_excel(tmp_path / "b.xlsx", index=False)
    with pytest.raises(InputError, match=r"b\.xlsx': column R: no finite number in line 3; fill"):
        read_curves(tmp_path / "b.xlsx", {"R": "Kraft"})
    (tmp_path / "c.xlsx").write_text("t;R\n0;1\n")
    with pytest.raises(InputError, match=r"c\.xlsx': it is no Excel workbook"):
        read_curves(tmp_path / "c.xlsx")


def test_a_saved_workbook_is_data(tmp_path):
    pytest.importorskip("openpyxl")
    truth = simulate(load_problem("kelvin-voigt-impact", k=3000.0), "exact", dt=0.01, t_end=0.4)
    found = fit(load_problem("kelvin-voigt-impact"), ["k"], truth.save(tmp_path / "run.xlsx"), column="R")
    assert found.values["k"] == pytest.approx(3000.0)


def test_a_mark_is_for_files():
    with pytest.raises(InputError, match="decimal = ',' is for a file, and the data are a table"):
        CurveTable.of(pd.DataFrame({"t": [0.0]}), ",")


@given(
    st.lists(st.floats(-1e300, 1e300).map(abs), min_size=2, max_size=20, unique=True).map(sorted),
    st.sampled_from([",", ";", "\t"]),
    st.sampled_from([".", ","]),
    st.data(),
)
def test_numbers_are_read_to_the_last_bit(tmp_path_factory, times, separator, decimal, data):
    if separator == "," and decimal == ",":
        separator = ";"
    forces = data.draw(st.lists(st.floats(-1e300, 1e300), min_size=len(times), max_size=len(times)))
    frame = pd.DataFrame({"t": times, "R": forces})
    path = tmp_path_factory.mktemp("csv") / "data.csv"
    frame.to_csv(path, sep=separator, decimal=decimal, index=False)
    found = CurveTable.of(path, decimal).curve(["R"])
    assert found["t"].tolist() == times
    assert found["R"].tolist() == forces
    try:
        guessed = CurveTable.of(path).curve(["R"])
    except InputError as refused:
        assert "(--decimal)" in str(refused)  # noqa: PT017 (nothing need be refused)
    else:
        np.testing.assert_array_equal(guessed, found)


def test_a_fit_takes_decimal_commas(tmp_path):
    truth = simulate(load_problem("kelvin-voigt-impact", k=3000.0), "exact", dt=0.01, t_end=0.4)
    pd.DataFrame({"t": truth.t, "R": truth["R"]}).to_csv(tmp_path / "R.csv", sep=";", decimal=",", index=False)
    found = fit(load_problem("kelvin-voigt-impact"), ["k"], tmp_path / "R.csv")
    assert found.values["k"] == pytest.approx(3000.0)


def test_the_command_takes_the_decimal_mark(tmp_path, capsys):
    from lcpimpact.cli.main import main

    path = written(tmp_path / "R.csv", "t;R\n1;1,234\n2;2,345\n")
    arguments = ["fit", "kelvin-voigt-impact", "--free", "k", "--to", str(path), "--decimal"]
    for mark, says in ((",", ""), (";", "decimal = ';' must be '.' or ','")):
        with pytest.raises(SystemExit) as left:
            main([*arguments, mark])
        assert (left.value.code == 2) == bool(says)
        assert says in " ".join(capsys.readouterr().err.split())
