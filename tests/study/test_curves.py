"""CSV files of measurements: separators, decimal marks, encodings, and what is refused since it could mean two things."""

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lcpimpact import InputError, fit, load_problem, simulate
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
        "t;R;when\n0;1,5;24.11.2026 10:30\n0,001;-2,25e3;24.11.2026\n0,5;1234,5;\n",
    ],
)
def test_files_of_instruments_and_spreadsheets_are_read(text, tmp_path):
    assert read(written(tmp_path / "data.csv", text)) == POINT


def test_quoted_decimal_commas_between_commas_need_the_mark(tmp_path):
    path = written(tmp_path / "data.csv", 't,R\n0,"1,5"\n"0,001","-2,25e3"\n"0,5","1234,5"\n')
    with pytest.raises(InputError, match="no finite number in lines 3, 4"):
        read(path)
    assert read(path, ",") == POINT


@pytest.mark.parametrize(
    ("text", "decimal", "value"),
    [("t;R\n1;1,234\n2;12,345\n", ",", 1.234), ("t;R\n1;1.234\n2;12.345\n", ".", 1.234)],
)
def test_what_may_be_thousands_is_refused_until_the_mark_is_stated(text, decimal, value, tmp_path):
    path = written(tmp_path / "data.csv", text)
    with pytest.raises(
        InputError, match=r"data\.csv': the mark in '1.234' may separate decimals or thousands; state the"
    ):
        read(path)
    assert read(path, decimal)[0] == (1.0, value)


@pytest.mark.parametrize(
    ("text", "decimal", "says"),
    [
        ("t,R\n1,5,2,5\n", None, "line 2 has more cells than the header, which has 2; where commas are decimal marks"),
        ("t,R\n0,1\n1,5,2,5\n", None, "Expected 2 fields in line 3, saw 4"),
        ("t,R\n0,1,\n", None, "line 2 has more cells than the header"),
        ("t;R\n0,5;1.234,5\n", None, "'1.234,5' and '0,5' have points and commas: remove thousands separators"),
        ("t;R\n0,5;1.234\n", None, "'1.234' and '0,5' have points and commas"),
        ("t;R\n0,5;1.234\n1,5;2\n", ",", "column R: no finite number in line 2"),
        ("t;R\n0.5;1\n", ",", "column t: no finite number in line 2"),
        ('t,R\n0.5,"1,234.5"\n', None, "column R: no finite number in line 2"),
        ("t;R\n0;1'234,5\n", None, "column R: no finite number in line 2"),
        ("t;R\n0;1,5\n0,1;NaN\n", None, "column R: no finite number in line 3"),
        ("t;R\n0;1,5\n0,1;\n0,2;1,5\n", None, "column R: no finite number in line 3"),
        ("t;R\n[s];[N]\n0,1;1,5\n", None, "column t: no finite number in line 2"),
        ("t;R;R\n0;1;2\n", None, "two of its columns have one name"),
        ("sep=;\nt;R\n0;1\n", None, "unknown column 't'"),
        ("t|R\n0|1\n", None, "unknown column 't'"),
        ("t;R\n0,5;1\n0,4;2\n", None, "t does not rise in line 3"),
        ("t;R\n0,5;1\n", ";", "decimal = ';' must be '.' or ','"),
        ("", None, "no CSV file with one header and commas, semicolons or tabs"),
    ],
)
def test_other_files_are_refused_by_name(text, decimal, says, tmp_path):
    path = written(tmp_path / "data.csv", text)
    with pytest.raises(InputError, match=says) as raised:
        read(path, decimal)
    assert "\n" not in str(raised.value)
    assert "data.csv" in str(raised.value)


@pytest.mark.parametrize("encoding", ["latin-1", "utf-16"])
def test_text_that_is_not_utf_8_is_refused(encoding, tmp_path):
    path = written(tmp_path / "data.csv", "t;R;Größe\n0;1;2\n", encoding)
    with pytest.raises(
        InputError, match=r"cannot read .*data\.csv': its text is not in UTF-8; save it as CSV in UTF-8"
    ):
        read(path)


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
        assert "state the decimal mark" in str(refused)  # noqa: PT017 (nothing need be refused)
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
