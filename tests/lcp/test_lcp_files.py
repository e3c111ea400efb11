"""LCPs in files: every format, what is wrong with a file in one sentence, and the command solve."""

from __future__ import annotations

import doctest
import io
import random
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.io import mmwrite
from scipy.sparse import coo_matrix, diags

import lcpimpact as li
from lcpimpact import Banded, Dense, Factored, InputError
from lcpimpact.bibliography import cited
from lcpimpact.cli.main import main
from lcpimpact.lcp import SOLVERS
from lcpimpact.lcp.files import READERS, WRITERS, read_lcp, write_lcp

ROOT = Path(__file__).parents[2]
INF = np.inf

TWO = [[2.0, 1.0], [1.0, 3.0]], [-5.0, -6.0]
CHAIN = 2.0 * np.eye(9) - np.eye(9, k=1) - np.eye(9, k=-1)


def call(capsys, *arguments):
    """Return the exit code, what was printed, with its folded lines joined, and the error of a command."""
    with pytest.raises(SystemExit) as stop:
        main([str(each) for each in arguments])
    captured = capsys.readouterr()
    return stop.value.code, unfolded(captured.out), captured.err


def unfolded(said):
    return re.sub(r"\n {14}(?=\S)", " ", said)


def test_solve_folds_its_lines(capsys, tmp_path):
    file = put(tmp_path, "a.lcp", "0 1 -1\n-1 0 1\n")
    with pytest.raises(SystemExit):
        main(["solve", str(file)])
    said = capsys.readouterr().out
    assert max(map(len, said.splitlines())) <= 78
    assert said != call(capsys, "solve", file)[1]


def put(folder, name, content):
    file = folder / name
    file.write_bytes(content if isinstance(content, bytes) else content.encode())
    return file


def same_bits(one, other):
    return np.asarray(one).tobytes() == np.asarray(other).tobytes()


# --- formats -----------------------------------------------------------------------------------------------------------

TEXTS = {
    "q as one column more": ("a.txt", "2 1 -5\n1 3 -6\n"),
    "q as one row more": ("a.txt", "2 1\n1 3\n-5 -6\n"),
    "labels": ("a.lcp", "M:\n2 1\n1 3\nq:\n-5 -6\n"),
    "labels in any order, numbers behind them": ("a.lcp", "q: -5 -6\nM: 2 1\n   1 3"),
    "no label for M": ("a.lcp", "2 1\n1 3\n\nq: -5\n   -6\n"),
    "comments and blank lines": ("a.lcp", "# M\n\n 2 1 # first row\n#1 1\n1 3\n\t\nq: -5 -6 # q: 0 0\n"),
    "commas": ("a.csv", "2,1,-5\n1, 3 ,-6\n"),
    "as a spreadsheet pads it": ("a.csv", "M:,2,1,,\n,1,3,,\nq:,-5,-6,,\n,,,,\n"),
    "other line ends, and the mark of UTF-8": ("a.txt", b"\xef\xbb\xbf2 1 -5\r\n1 3 -6\r\n"),
    "exponents": ("a.TXT", "2e0 10E-1 -.5e1\n+1. 3 -6"),
}


@pytest.mark.parametrize("case", TEXTS)
def test_ways_to_write_one_problem(tmp_path, case):
    found = read_lcp(put(tmp_path, *TEXTS[case]))
    assert found.M.array().tolist() == TWO[0]
    assert found.q.tolist() == TWO[1]
    assert found.lower is found.upper is None
    assert found.name == TEXTS[case][0]


@pytest.mark.parametrize(
    ("text", "lower", "upper"),
    [
        ("lower: -1 -inf\nupper: inf 2", [-1.0, -INF], [INF, 2.0]),
        ("lower: -inf", [-INF, -INF], None),
        ("upper: 0.5", None, [0.5, 0.5]),
        ("upper: 1\n2\nlower: 0\n-3", [0.0, -3.0], [1.0, 2.0]),
    ],
)
def test_bounds_in_text(tmp_path, text, lower, upper):
    found = read_lcp(put(tmp_path, "a.lcp", f"2 1 -5\n1 3 -6\n{text}\n"))
    for bound, expected in ((found.lower, lower), (found.upper, upper)):
        assert (None if bound is None else bound.tolist()) == expected


def test_a_problem_of_order_one(tmp_path):
    for text in ("2 -5", "2\n-5", "M: 2\nq: -5"):
        found = read_lcp(put(tmp_path, "a.txt", text))
        assert (found.M.array().tolist(), found.q.tolist()) == ([[2.0]], [-5.0])


def test_arrays_of_numpy(tmp_path):
    file = tmp_path / "a.npz"
    M, q = map(np.array, TWO)
    np.savez(file, M=M.astype(int), q=q.reshape(2, 1), lower=-1, upper=[1.0, INF])
    found = read_lcp(file)
    assert isinstance(found.M, Dense)
    assert found.M.array().tolist() == TWO[0]
    assert found.q.tolist() == TWO[1]
    assert found.lower.tolist() == [-1.0, -1.0]
    assert found.upper.tolist() == [1.0, INF]

    A, H = [[4.0, 1.0], [1.0, 2.0]], [[1.0, 0.0], [-1.0, 1.0], [0.0, 1.0]]
    np.savez(file, A=A, H=H, q=[1.0, 2.0, 3.0])
    found = read_lcp(file)
    assert isinstance(found.M, Factored)
    np.testing.assert_allclose(found.M.array(), H @ np.linalg.inv(A) @ np.transpose(H), rtol=1e-14, atol=1e-16)

    np.savez(file, bands=[[2.0, 2.0, 2.0], [-1.0, -1.0, 0.0]], q=[1.0, 2.0, 3.0])
    found = read_lcp(file)
    assert isinstance(found.M, Banded)
    assert found.M.array().tolist() == [[2, -1, 0], [-1, 2, -1], [0, -1, 2]]

    np.save(tmp_path / "a.npy", np.column_stack([M, q]))
    found = read_lcp(tmp_path / "a.npy")
    assert (found.M.array().tolist(), found.q.tolist()) == TWO


SYMMETRIC = np.array([[2.0, -1.0, 0.0], [-1.0, 3.0, 0.25], [0.0, 0.25, 1e-3]])
SKEW = np.array([[0.0, -1.0, 0.5], [1.0, 0.0, 2.0], [-0.5, -2.0, 0.0]])
GENERAL = np.array([[2.0, 0.0, 1 / 3], [-1.0, 3.0, 0.0], [0.0, 7.0, 1.0]])
WHOLE = np.array([[2, 0, 1], [-1, 3, 0], [0, 7, 1]])


@pytest.mark.parametrize("form", [np.asarray, coo_matrix])
@pytest.mark.parametrize("M", [SYMMETRIC, SKEW, GENERAL, WHOLE])
def test_matrix_market_as_scipy_writes_it(tmp_path, M, form):
    file = tmp_path / "a.mtx"
    mmwrite(file, form(M), comment="a comment", precision=17)
    q = [-1.0, 0.5, 2.0]
    found = read_lcp(file, put(tmp_path, "q.txt", "-1\n0.5\n2\n"))
    assert found.M.array().tolist() == M.tolist()
    assert found.q.tolist() == q
    mmwrite(file, form(np.column_stack([M, q])), precision=17)
    found = read_lcp(file)
    assert found.M.array().tolist() == M.tolist()
    assert found.q.tolist() == q


def test_a_sparse_matrix_of_few_bands_stays_one(tmp_path):
    mmwrite(tmp_path / "a.mtx", diags([-1.0, 2.0, -1.0], [-1, 0, 1], shape=(50, 50)))
    np.save(tmp_path / "q.npy", np.ones(50))
    found = read_lcp(tmp_path / "a.mtx", tmp_path / "q.npy")
    assert isinstance(found.M, Banded)
    assert found.M.bands.shape == (2, 50)


def test_entries_that_stand_twice_are_added(tmp_path):
    text = "%%MatrixMarket matrix coordinate real general\n% two\n\n1 1 3\n1 1 2\n1 1 0.5\n1 1 1\n"
    found = read_lcp(put(tmp_path, "a.mtx", text), put(tmp_path, "q.csv", "-1"))
    assert found.M.array().tolist() == [[3.5]]


@pytest.mark.parametrize("name", ["q.txt", "q.lcp", "q.csv", "q.npy", "q.npz", "q.mtx", "sparse.mtx"])
@pytest.mark.parametrize("q", [[-1.0, 0.5, 2.0], [-1.0, 0.5], [3.0]])
@pytest.mark.parametrize("column", [True, False])
def test_q_in_a_file_of_its_own(tmp_path, name, q, column):
    file, array = tmp_path / name, np.array(q).reshape((-1, 1) if column else (1, -1))
    if name.endswith("npy"):
        np.save(file, array if column else np.array(q))
    elif name.endswith("npz"):
        np.savez(file, q=array)
    elif name.endswith("mtx"):
        mmwrite(file, coo_matrix(array) if name == "sparse.mtx" else array)
    else:
        text = ("\n" if column else ", " if name == "q.csv" else " ").join(map(str, q))
        file.write_text(text if name != "q.lcp" else f"q: {text}")
    matrix = put(tmp_path, "m.lcp", "M:\n" + "\n".join(" ".join("2" for _ in q) for _ in q))
    assert read_lcp(matrix, file).q.tolist() == q


# --- writing -----------------------------------------------------------------------------------------------------------

number = st.floats(allow_nan=False, allow_infinity=False, width=64).filter(lambda x: abs(x) < 1e300)


@st.composite
def problems(draw):
    n = draw(st.integers(1, 4))
    vector = st.lists(number, min_size=n, max_size=n)
    M = np.array(draw(st.lists(vector, min_size=n, max_size=n)))
    low = np.array(draw(vector))
    high = np.maximum(low, np.array(draw(vector)))
    low[draw(st.lists(st.booleans(), min_size=n, max_size=n))] = -INF
    high[draw(st.lists(st.booleans(), min_size=n, max_size=n))] = INF
    low, high = (each if draw(st.booleans()) else None for each in (low, high))
    if high is None and low is not None:
        return M, np.array(draw(vector)), low, None
    if low is None and high is not None:
        high = np.abs(high)
    return M, np.array(draw(vector)), low, high


@given(problems(), st.sampled_from(sorted(WRITERS)))
def test_what_is_written_is_read_back_to_the_bit(tmp_path_factory, problem, ending):
    M, q, lower, upper = problem
    file = tmp_path_factory.getbasetemp() / f"round trip{ending}"
    assert write_lcp(file, M, q, lower, upper) == file
    found = read_lcp(file)
    assert same_bits(found.M.array(), M)
    assert same_bits(found.q, q)
    for read, written in ((found.lower, lower), (found.upper, upper)):
        assert (read is None) == (written is None)
        assert read is None or same_bits(read, written)


def test_bands_and_factors_are_kept_in_npz_and_written_out_in_text(tmp_path):
    rng = np.random.default_rng(3)
    bands, H = rng.normal(size=(3, 20)), rng.normal(size=(4, 3))
    banded, factored = Banded(bands), Factored(np.diag([1.0, 2.0, 1 / 3]), H)
    found = read_lcp(write_lcp(tmp_path / "a.npz", banded, np.ones(20))).M
    assert isinstance(found, Banded)
    assert same_bits(found.bands, banded.bands)
    found = read_lcp(write_lcp(tmp_path / "a.npz", factored, np.ones(4))).M
    assert isinstance(found, Factored)
    assert same_bits(found.H, H)
    found = read_lcp(write_lcp(tmp_path / "a.lcp", banded, np.ones(20))).M
    assert isinstance(found, Dense)
    assert same_bits(found.array(), banded.array())
    sparse = Factored(diags([np.full(50, 2.0)], [0]), coo_matrix(([1.0, -1.0], ([0, 1], [3, 49])), shape=(2, 50)))
    found = read_lcp(write_lcp(tmp_path / "a.npz", sparse, [1.0, 2.0], lower=-1.0, upper=1.0))
    assert same_bits(found.M.A, 2.0 * np.eye(50))
    assert same_bits(found.M.H, sparse.H.toarray())
    assert (found.lower.tolist(), found.upper.tolist()) == ([-1.0, -1.0], [1.0, 1.0])


def test_a_written_file_solves_as_the_problem_did(tmp_path):
    M, q = [[2.0, -1.0], [-1.0, 1.0]], [-1.0, 0.1]
    file = read_lcp(write_lcp(tmp_path / "a.csv", M, q, lower=-1.0, upper=0.5))
    z = li.solve_lcp(file.M, file.q, lower=file.lower, upper=file.upper).z
    assert z.tolist() == li.solve_lcp(M, q, lower=-1.0, upper=0.5).z.tolist()


@pytest.mark.parametrize(
    ("name", "M", "q", "bounds", "said"),
    [
        ("a.mtx", *TWO, {}, ".lcp, .txt, .csv, .npz"),
        ("a", *TWO, {}, "must end in"),
        ("no folder/a.lcp", *TWO, {}, "there is no folder"),
        ("a.lcp", TWO[0], [1.0], {}, "q must have shape"),
        ("a.lcp", [[1.0, 2.0]], [1.0], {}, "square"),
        ("a.lcp", TWO[0], [1.0, np.nan], {}, "not finite"),
        ("a.lcp", *TWO, {"lower": [1.0, 1.0], "upper": [2.0, 0.0]}, "lower[1] = 1 and upper[1] = 0"),
    ],
)
def test_what_cannot_be_written_is_refused_and_leaves_no_file(tmp_path, name, M, q, bounds, said):
    with pytest.raises(InputError, match=re.escape(said)):
        write_lcp(tmp_path / name, M, q, **bounds)
    assert not list(tmp_path.iterdir())


def test_a_file_that_fails_half_way_leaves_the_old_one(tmp_path, monkeypatch):
    import lcpimpact.lcp.files as files

    def full(path, M, vectors):
        path.write_text("half")
        raise OSError(28, "No space left on device")

    monkeypatch.setitem(files.WRITERS, ".lcp", full)
    old = put(tmp_path, "a.lcp", "2 -5")
    with pytest.raises(InputError, match="No space left on device"):
        write_lcp(old, *TWO)
    assert [file.name for file in tmp_path.iterdir()] == ["a.lcp"]
    assert old.read_text() == "2 -5"


# --- what is wrong -----------------------------------------------------------------------------------------------------


def archive(**arrays):
    buffer = io.BytesIO()
    np.savez(buffer, **arrays)
    return buffer.getvalue()


HEADER = "%%MatrixMarket matrix array real general\n"
ENTRIES = "%%MatrixMarket matrix coordinate real symmetric\n"
WRONG = {
    "no such file": ("a.txt", None, "No such file"),
    "unknown ending": ("a.xls", "1 2", "known are .lcp, .txt, .csv, .npz, .npy, .mtx"),
    "no ending": ("a", "1 2", "known are .lcp"),
    "empty": ("a.txt", "", "holds no numbers"),
    "nothing but comments": ("a.txt", "# M\n\n#q", "holds no numbers"),
    "a label alone": ("a.txt", "M: 2\nq:\n", "q: is followed by no numbers"),
    "rubbish": ("a.txt", bytes(range(256)), "UTF-8"),
    "rubbish that is text": ("a.txt", b"\0\1\2", r"line 1: '\x00\x01\x02' is no number"),
    "UTF-16": ("a.txt", "1 2".encode("utf-16"), "UTF-8"),
    "a word": ("a.txt", "1 2\n# q\n3 x\n", "line 3: 'x' is no number"),
    "a header": ("a.csv", "m,q\n1,2\n", "line 1: 'm' is no number"),
    "decimal commas": ("a.txt", "1,5 2,5\n", "line 1: '5 2' is no number"),
    "semicolons": ("a.csv", "1;2\n", "decimals with a point"),
    "an empty cell": ("a.csv", "1,,2\n", "line 1: '' is no number"),
    "an underscore": ("a.txt", "1_000 2", "line 1: '1?000'"),
    "ragged rows": ("a.txt", "1 2 3\n\n4 5\n", "line 3 has 2 numbers and line 1 has 3"),
    "nan": ("a.txt", "1 2\nnan 3\n1 1", "line 2: a number of M is NaN"),
    "infinite M": ("a.txt", "1 2\ninf 3\n1 1", "line 2: a number of M"),
    "overflow": ("a.txt", "M: 1\nq: 1e999", "line 2: a number of q"),
    "nan as a bound": ("a.txt", "1 2\nlower: nan", "line 2: a number of lower"),
    "no q": ("a.txt", "1 2\n3 4\n", "holds no q"),
    "q twice": ("a.txt", "M: 1 2 3\n3 4 5\nq: 1 2\n", "q stands in it twice"),
    "a label twice": ("a.txt", "M: 1\nq: 1\nq: 1\n", "line 3: q stands in it twice"),
    "M after rows without a label": ("a.txt", "1\nM: 1\nq: 1\n", "line 2: M stands in it twice"),
    "an unknown label": ("a.txt", "M: 1\nq: 1\nlowr: 0\n", "line 3: unknown label 'lowr': did you mean 'lower'"),
    "no M": ("a.txt", "q: 1 2\n", "must hold M"),
    "a shape that is none": ("a.txt", "1 2 3 4\n5 6 7 8\n", "2 rows of 4 numbers are no LCP"),
    "one row": ("a.txt", "M: 1 2 3 4\nq: 1\n", "1 rows of 4 numbers are no LCP"),
    "q too long": ("a.txt", "M: 1\nq: 1 2\n", "q must have n = 1 numbers to fit M, and it has 2"),
    "q too short": ("a.txt", "M: 1 2\n3 4\nq: 1\n", "q must have n = 2 numbers to fit M, and it has 1"),
    "bounds too long": ("a.txt", "M: 1 2\n3 4\nq: 1 2\nupper: 1 2 3", "upper must have n = 2"),
    "bounds that cross": ("a.txt", "M: 1\nq: 1\nlower: 2\nupper: 1", "lower[0] = 2 and upper[0] = 1"),
    "a lower bound of inf": ("a.txt", "M: 1\nq: 1\nlower: inf", "lower[0] = inf"),
    "text as npz": ("a.npz", "1 2 3", "no whole NumPy file"),
    "half an npz": ("a.npz", archive(M=np.eye(9), q=np.ones(9))[:-200], "no whole NumPy file"),
    "objects": ("a.npz", archive(M=np.eye(1), q=np.array([None], dtype=object)), "no whole NumPy file"),
    "npz without q": ("a.npz", archive(M=np.eye(2)), "holds no q"),
    "npz without M": ("a.npz", archive(q=np.ones(2)), "none of them"),
    "npz with A alone": ("a.npz", archive(A=np.eye(2), q=np.ones(2)), "it holds A"),
    "npz with too much": ("a.npz", archive(M=np.eye(2), bands=np.ones((1, 2)), q=np.ones(2)), "it holds M and bands"),
    "an unknown array": ("a.npz", archive(M=np.eye(1), q=[1.0], uper=[1.0]), "did you mean 'upper'"),
    "complex numbers": ("a.npz", archive(M=1j * np.eye(1), q=[1.0]), "M must hold real numbers"),
    "words": ("a.npz", archive(M=np.eye(1), q=["one"]), "q must hold real numbers"),
    "nan in npz": ("a.npz", archive(M=np.eye(1), q=[np.nan]), "q has an entry that is not finite"),
    "nan in M of npz": ("a.npz", archive(M=[[np.inf]], q=[1.0]), "M has an entry that is not finite"),
    "three dimensions": ("a.npz", archive(M=np.ones((1, 1, 1)), q=[1.0]), "shape is (1, 1, 1)"),
    "q with two": ("a.npz", archive(M=np.eye(4), q=np.ones((2, 2))), "q must have n = 4 numbers"),
    "no rows": ("a.npz", archive(M=np.ones((0, 0)), q=[]), "its shape is (0, 0)"),
    "A not definite": ("a.npz", archive(A=-np.eye(1), H=np.eye(1), q=[1.0]), "positive definite"),
    "H of the wrong width": ("a.npz", archive(A=np.eye(2), H=np.eye(1), q=[1.0]), "H must have 2 columns"),
    "bands of the wrong shape": ("a.npz", archive(bands=np.ones((3, 1)), q=[1.0]), "(b + 1, n)"),
    "a broken npy": ("a.npy", b"\x93NUMPY\x01\x00v\x00{'desc\nr': 1 (", "no whole NumPy file"),
    "no matrix market": ("a.mtx", "1 2 3", "line 1 must read"),
    "complex matrix market": ("a.mtx", HEADER.replace("real", "complex") + "1 1\n1 1\n", "line 1 must read"),
    "matrix market without sizes": ("a.mtx", HEADER + "% nothing\n", "line 2 must hold the numbers of rows"),
    "sizes that are none": ("a.mtx", HEADER + "1.5 2\n1\n", "line 2 must hold"),
    "a negative size": ("a.mtx", HEADER + "-1 2\n1\n", "line 2 must hold"),
    "no rows in matrix market": ("a.mtx", HEADER + "0 0\n", "its shape is (0, 0)"),
    "an absurd size": ("a.mtx", HEADER + "999999999 999999999\n1\n", "line 2: 999999999 rows"),
    "an absurd order": ("a.mtx", ENTRIES + "999999999 999999999 1\n1 1 1\n", "line 2: 999999999 rows"),
    "too few entries": ("a.mtx", HEADER + "2 3\n1\n2\n", "promises 6 entries and holds 2"),
    "too many entries": ("a.mtx", ENTRIES + "2 2 1\n1 1 1\n2 2 1\n", "promises 1 entries and holds 2"),
    "symmetric and not square": ("a.mtx", ENTRIES + "2 3 1\n1 1 1\n", "2 rows and 3 columns cannot be right"),
    "an entry outside": ("a.mtx", ENTRIES + "2 2 1\n3 1 1\n", "outside the 2 rows"),
    "an entry of row zero": ("a.mtx", ENTRIES + "2 2 1\n0 1 1\n", "counted from 1"),
    "half a row": ("a.mtx", ENTRIES + "2 2 1\n1.5 1 1\n", "counted from 1"),
    "half an entry": ("a.mtx", ENTRIES + "2 2 1\n1 1\n", "line 3 must hold row, column and number"),
    "an infinite entry": ("a.mtx", HEADER + "1 2\n1\ninf\n", "line 4 must hold one number, finite"),
    "a cut number": ("a.mtx", HEADER + "1 2\n1\n5E-", "line 4: '5E-' is no number"),
}


@pytest.mark.parametrize("case", WRONG)
def test_what_is_wrong_with_a_file_is_one_sentence(tmp_path, capsys, case):
    name, content, said = WRONG[case]
    file = tmp_path / name if content is None else put(tmp_path, name, content)
    with pytest.raises(InputError) as stop:
        read_lcp(file)
    message = str(stop.value)
    assert message.startswith(f"cannot read {str(file)!r}: ")
    assert said.replace("1?000", "1_000") in message
    code, out, error = call(capsys, "solve", file)
    assert code == 2
    assert out == ""
    assert error.strip().splitlines() == [f"lcpimpact: {' '.join(message.split())}"]


def test_a_folder_and_a_file_that_may_not_be_read(tmp_path, monkeypatch):
    (tmp_path / "a.txt").mkdir()
    with pytest.raises(InputError, match="it is no file"):
        read_lcp(tmp_path / "a.txt")
    file = put(tmp_path, "b.txt", "2 -5")

    def refuse(*arguments, **options):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "open", refuse)
    with pytest.raises(InputError, match=r"b\.txt': Permission denied; check"):
        read_lcp(file)


@pytest.mark.parametrize(
    ("matrix", "q", "culprit", "said"),
    [
        ("1 2\n3 4", None, "q.txt", "No such file"),
        ("1 2\n3 4", "1 2 3", "m.txt", "q must have n = 2 numbers to fit M, and it has 3"),
        ("1 2\n3 4", "1 2\n3 4", "q.txt", "it must hold q alone"),
        ("1 2\n3 4", "M: 1\nq: 1", "q.txt", "it must hold q alone"),
        ("1 2\n3 4", "1 nan", "q.txt", "NaN"),
        ("1 2 3\n3 4 5", "1 2", "m.txt", "q stands in it already"),
    ],
)
def test_what_is_wrong_with_two_files_names_the_one(tmp_path, matrix, q, culprit, said):
    matrix = put(tmp_path, "m.txt", matrix)
    other = tmp_path / "q.txt"
    if q is not None:
        put(tmp_path, "q.txt", q)
    with pytest.raises(InputError, match=rf"{culprit}'.*{re.escape(said)}"):
        read_lcp(matrix, other)


def whole_files():
    """Return good files of every format, to be broken."""
    buffer = io.BytesIO()
    np.save(buffer, np.column_stack(TWO))
    text = "# one\nM: 2 1\n1 3\nq: -5 -6\nlower: 0 -inf\nupper: inf\n"
    market = io.BytesIO()
    mmwrite(market, np.column_stack(TWO))
    return {
        ".lcp": text.encode(),
        ".txt": b"2 1 -5\n1 3 -6\n",
        ".csv": b"2,1,-5\n1,3,-6\n",
        ".npz": archive(M=TWO[0], q=TWO[1], lower=[0.0, -1.0]),
        ".npy": buffer.getvalue(),
        ".mtx": market.getvalue(),
    }


@pytest.mark.parametrize("ending", READERS)
def test_a_broken_file_is_read_or_refused_and_nothing_else(tmp_path, ending):
    rng = random.Random(ending)
    whole = whole_files()[ending]
    read_lcp(put(tmp_path, f"a{ending}", whole))
    pieces = [
        b"9",
        b"99999999",
        b"-",
        b"nan",
        b" ",
        b"\n",
        b",",
        b"inf",
        b"\0",
        b"e9",
        b"q:",
        b"#",
        b"%",
        b"(",
        b"\xff",
    ]
    said = []
    for _ in range(250):
        data = bytearray(whole)
        for _ in range(rng.randint(1, 4)):
            at = rng.randrange(len(data) + 1)
            way = rng.randrange(5)
            if way == 0 and at < len(data):
                data[at] = rng.randrange(256)
            elif way == 1:
                data[at:at] = rng.choice(pieces)
            elif way == 2:
                del data[at : at + rng.randint(1, 8)]
            elif way == 3 and rng.random() < 0.3:
                del data[at:]
            else:
                data[at:at] = data[rng.randrange(len(data) + 1) :][:20]
        file = put(tmp_path, f"b{ending}", bytes(data))
        try:
            found = read_lcp(file)
        except InputError as error:
            said.append(str(error))
        else:
            assert found.M.array().shape == (len(found.q),) * 2
            assert np.isfinite(found.q).all()
    assert len(said) > 50
    assert all(each.startswith(f"cannot read {str(file)!r}: ") for each in said)


# --- the command -------------------------------------------------------------------------------------------------------


def test_solve_says_what_the_problem_is_and_what_the_answer(capsys, tmp_path):
    code, said, error = call(capsys, "solve", put(tmp_path, "two.lcp", "2 1 -5\n1 2 -6\n"))
    assert (code, error) == (0, "")
    solution = li.solve_lcp([[2.0, 1.0], [1.0, 2.0]], [-5.0, -6.0])
    lines = said.splitlines()
    assert lines[0] == "LCP two.lcp of order 2 by auto: solved"
    assert "dense; symmetric, positive semidefinite, a P-matrix, positive diagonal" in lines[1]
    assert "z >= 0" in lines[2]
    assert solution.explanation in lines[3]
    assert solution.message in lines[4]
    assert [line.split() for line in lines[6:9]] == [
        ["row", "z", "w", "side"],
        ["1", "1.33333", "0", "between"],
        ["2", "2.33333", "0", "between"],
    ]


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("0 1 -1\n-1 0 1\n", "dense; positive semidefinite; not symmetric, not a P-matrix, not positive diagonal"),
        ("1 2 1\n2 1 1\n", "dense; symmetric, positive diagonal; not positive semidefinite, not a P-matrix"),
        ("1 -4 1\n1 1 1\n", "dense; a P-matrix, positive diagonal; not symmetric, not positive semidefinite"),
    ],
)
def test_solve_names_what_is_found_of_M(capsys, tmp_path, text, found):
    assert f"  M           {found}\n" in call(capsys, "solve", put(tmp_path, "a.lcp", text))[1]


def test_solve_says_that_a_P_matrix_of_many_rows_is_not_recognised(capsys, tmp_path):
    rng = np.random.default_rng(0)
    M = np.eye(12) + np.triu(rng.normal(size=(12, 12)), 1) * 5.0
    said = call(capsys, "solve", write_lcp(tmp_path / "a.lcp", M, np.ones(12)))[1]
    assert "whether a P-matrix is not known" in said


def test_a_large_matrix_is_not_searched_for_properties(capsys, tmp_path):
    bands = np.array([np.full(2_500, 2.0), np.full(2_500, -1.0)])
    said = call(capsys, "solve", write_lcp(tmp_path / "a.npz", Banded(bands), -np.ones(2_500)))[1]
    assert "  M           banded; symmetric (n > 2000: others were not checked)\n" in said


def test_the_sides_of_a_problem_with_bounds(capsys, tmp_path):
    text = "M: 1 0 0 0 0\n0 1 0 0 0\n0 0 1 0 0\n0 0 0 1 0\n0 0 0 0 1\nq: -2 2 -0.5 7 0\n"
    file = put(tmp_path, "a.lcp", f"{text}lower: -1 -1 -1 -inf 0\nupper: 1 1 1 inf inf\n")
    code, said, _ = call(capsys, "solve", file)
    assert code == 0
    assert "  bounds      1 row with z >= 0, 1 row free, 3 rows between bounds" in said
    rows = [line.split(maxsplit=3) for line in said.splitlines()[7:]]
    assert rows == [
        ["1", "1", "-1", "upper"],
        ["2", "-1", "1", "lower"],
        ["3", "0.5", "0", "between"],
        ["4", "-7", "0", "free"],
        ["5", "0", "0", "lower, w = 0"],
    ]


def test_bounds_on_the_command_line_stand_before_those_of_the_file(capsys, tmp_path):
    file = put(tmp_path, "a.lcp", "M: 2 0\n0 2\nq: -8 -8\nupper: 1\n")
    for options, z in (
        ([], "1 1"),
        (["--upper", "2,inf"], "2 4"),
        (["--lower", "3", "--upper", "inf"], "4 4"),
        (["--lower", "-inf,5", "--upper", "inf"], "4 5"),
    ):
        code, said, _ = call(capsys, "solve", file, *options)
        assert code == 0
        assert " ".join(line.split()[1] for line in said.splitlines()[7:9]) == z


def test_solver_tolerance_and_limit_are_handed_on(capsys, tmp_path):
    file = put(tmp_path, "a.lcp", "2 1 -5\n1 2 -6\n")
    code, said, error = call(capsys, "solve", file, "--solver", "pgs", "--max-iter", "2", "--out", tmp_path / "a.csv")
    assert code == 1
    assert "by pgs: max-iter" in said
    assert "(2 iterations" in said
    assert len(error.strip().splitlines()) == 1
    assert "iteration limit" in error
    assert "'" + str(tmp_path / "a.csv") + "' was not written" in error
    assert not (tmp_path / "a.csv").exists()
    assert call(capsys, "solve", file, "--solver", "pgs", "--max-iter", "2", "--tol", "0.5")[0] == 0


def test_a_ray_is_printed_with_what_it_proves(capsys, tmp_path):
    code, said, error = call(capsys, "solve", put(tmp_path, "a.lcp", "0 1 -1\n-1 0 -2\n"))
    assert code == 1
    assert "no solution" in error
    assert [line.split() for line in said.splitlines()[6:9]] == [
        ["row", "v", "Mᵀ", "v", "q"],
        ["1", "0", "-1", "-1"],
        ["2", "1", "0", "-2"],
    ]
    assert said.splitlines()[9].endswith("v·w = (Mᵀ v)·z + q·v <= -2 for all z.")


def test_the_bound_that_a_ray_proves_counts_the_box(capsys, tmp_path):
    # w2 = -z2 - 6, and z2 is 1 at least.
    file = put(tmp_path, "a.lcp", "M: 0 0\n0 -1\nq: 5 -6\nlower: 0 1\n")
    code, said, _ = call(capsys, "solve", file, "--solver", "lemke")
    assert code == 1
    assert "q·v <= -7 for all z." in said


def test_trace_and_tableau_are_those_of_the_solution(capsys, tmp_path):
    file = put(tmp_path, "a.lcp", "2 1 -5\n1 2 -6\n")
    trace = li.solve_lcp([[2.0, 1.0], [1.0, 2.0]], [-5.0, -6.0], "lemke", trace=True).trace
    said = call(capsys, "solve", file, "--solver", "lemke", "--trace", "--tableau", "2")[1]
    assert f"\n{trace}\n" in said
    assert f"\ntableau of step 2\n{trace.tableau(1)}\n" in said
    assert str(trace) not in call(capsys, "solve", file, "--solver", "lemke", "--tableau", "3")[1]


def test_all_solutions_are_listed(capsys):
    code, said, _ = call(capsys, "solve", ROOT / "docs" / "three.lcp", "--all")
    assert code == 0
    assert "3 solutions" in said
    assert re.findall(r"z = \((.*)\)", said) == ["4, 0", "0, 5", "2, 1"]


def test_of_many_rows_the_first_and_the_last_are_shown(capsys, tmp_path):
    q = np.where(np.arange(60) % 7, 0.3, -1.0)
    M = diags([-1.0, 2.0, -1.0], [-1, 0, 1], shape=(60, 60))
    out = tmp_path / "a.csv"
    said = call(capsys, "solve", write_lcp(tmp_path / "a.npz", M, q), "--out", out)[1]
    assert "M           banded; " in said
    rows = [line.split() for line in said.splitlines()[7:28]]
    assert [row[0] for row in rows] == [*map(str, range(1, 11)), "...", *map(str, range(51, 61))]
    solution = li.solve_lcp(M, q)
    assert [float(row[1]) for row in rows if row[0] != "..."] == pytest.approx(
        [*solution.z[:10], *solution.z[50:]], rel=1e-5, abs=1e-12
    )
    # The file has all of them.
    written = np.genfromtxt(out, delimiter=",", names=True, dtype=None, encoding="utf-8")
    assert written["z"].tolist() == solution.z.tolist()
    assert written["w"].tolist() == solution.w.tolist()
    assert written["row"].tolist() == list(range(1, 61))
    assert set(written["side"]) == {"lower", "between"}


def test_the_answer_as_npz(capsys, tmp_path):
    out = tmp_path / "a.npz"
    code, said, _ = call(capsys, "solve", ROOT / "docs" / "three.lcp", "--out", out, "--solver", "lemke")
    assert code == 0
    assert f"wrote       {out}" in said
    with np.load(out) as found:
        assert found["z"].tolist() == [0.0, 5.0]
        assert found["w"].tolist() == [6.0, 0.0]
        assert found["status"] == "SOLVED"
        assert found["route"].tolist() == ["lemke"]


def test_the_cones_are_drawn(capsys, tmp_path):
    plot = tmp_path / "a.svg"
    code, said, _ = call(capsys, "solve", ROOT / "docs" / "three.lcp", "--plot", plot)
    assert code == 0
    assert f"drew        {plot}" in said
    assert plot.read_bytes().startswith(b"<?xml")


def test_the_path_of_the_trace_is_drawn(capsys, tmp_path):
    plot = tmp_path / "a.svg"
    code, said, _ = call(capsys, "solve", ROOT / "docs" / "three.lcp", "--solver", "lemke", "--plot-trace", plot)
    assert code == 0
    assert f"drew        {plot}" in said
    assert plot.read_bytes().startswith(b"<?xml")
    assert "step  enters" not in said
    large = tmp_path / "large.lcp"
    write_lcp(large, np.eye(4), -np.ones(4))
    code, _, error = call(capsys, "solve", large, "--plot-trace", tmp_path / "b.svg")
    assert (code, "--plot-trace needs an LCP with n = 2 or 3" in error) == (2, True)


REFUSED = {
    "unknown solver": (["--solver", "lemk"], "did you mean 'lemke'"),
    "a property is lacking": (["--solver", "pgs"], "positive semidefinite"),
    "a negative tolerance": (["--tol", "-1"], "tol = -1"),
    "no iterations": (["--max-iter", "0"], "max_iter = 0"),
    "a word as a bound": (["--lower", "low"], "--lower 'low' must be one number, or 2"),
    "three bounds": (["--upper", "1,2,3"], "--upper '1,2,3' must be one number, or 2"),
    "bounds that cross": (["--upper", "-1"], "lower[0] = 0 and upper[0] = -1"),
    "a bound that is no number": (["--upper", "nan"], "upper must be"),
    "step zero": (["--tableau", "0", "--solver", "lemke"], "the trace has the steps 1 to 2"),
    "a step too far": (["--tableau", "3", "--solver", "lemke"], "the trace has the steps 1 to 2"),
    "an ending of an answer": (["--out", "z.lcp"], "must end in one of .csv, .npz"),
    "an ending of a picture": (["--plot", "z.jpg"], ".png, .svg, .pdf"),
    "cones of a box": (["--plot", "z.png", "--upper", "1"], "--plot needs an LCP with n = 2 or 3"),
    "no folder": (["--out", "nowhere/z.csv"], "there is no folder 'nowhere'"),
    "q twice": (["--q", ROOT / "docs" / "three.lcp"], "q stands in it already"),
    "an unknown option": (["--tabloo", "3"], "--tabloo"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_a_wrong_option_exits_2_with_one_line_and_writes_nothing(capsys, tmp_path, monkeypatch, case):
    monkeypatch.chdir(tmp_path)
    options, said = REFUSED[case]
    code, out, error = call(capsys, "solve", ROOT / "docs" / "three.lcp", *options)
    assert code == 2
    assert out == ""
    assert len(error.strip().splitlines()) == 1
    assert said in error
    assert not list(tmp_path.iterdir())


def test_a_wrong_name_is_found_before_the_run(capsys, monkeypatch):
    import lcpimpact.lcp.solve

    monkeypatch.setattr(lcpimpact.lcp.solve, "solve_lcp", lambda *a, **k: pytest.fail("the run was started"))
    for option, name in (("--out", "z.xls"), ("--out", "/nowhere/z.csv"), ("--plot", "z.xls")):
        assert call(capsys, "solve", ROOT / "docs" / "three.lcp", option, name)[0] == 2


def test_what_only_small_problems_can_show_is_refused_for_others(capsys, tmp_path):
    large = write_lcp(tmp_path / "a.lcp", np.eye(16), -np.ones(16))
    for option, said in (("--all", "--all enumerates every basis"), ("--plot", "n = 2")):
        code, _, error = call(capsys, "solve", large, option, *["a.png"] * (option == "--plot"))
        assert code == 2
        assert said in error
    boxed = write_lcp(tmp_path / "b.lcp", np.eye(11), -np.ones(11), lower=-1.0, upper=1.0)
    assert call(capsys, "solve", boxed, "--all")[0] == 2
    assert call(capsys, "solve", write_lcp(tmp_path / "c.lcp", np.eye(15), -np.ones(15)), "--all")[0] == 0


def test_q_from_a_second_file(capsys, tmp_path):
    mmwrite(tmp_path / "m.mtx", coo_matrix(TWO[0]))
    np.save(tmp_path / "q.npy", TWO[1])
    code, said, _ = call(capsys, "solve", tmp_path / "m.mtx", "--q", tmp_path / "q.npy")
    assert code == 0
    assert said.startswith("LCP m.mtx of order 2 by auto: solved")
    code, _, error = call(capsys, "solve", tmp_path / "m.mtx")
    assert code == 2
    assert "holds no q" in error


# --- what is said elsewhere --------------------------------------------------------------------------------------------


def test_the_list_of_solvers_says_what_each_declares(capsys):
    from importlib.metadata import metadata

    said = " ".join(call(capsys, "list", "solvers")[1].split())
    for name in SOLVERS:
        solver = SOLVERS[name]
        needs = f"M: {', '.join(each.value for each in solver.requires)}" if solver.requires else "any M"
        largest = "any n" if solver.largest is None else f"n <= {solver.largest}"
        declared = (
            f"{needs}; reads {', '.join(solver.storages)}; bounds: {'yes' if solver.boxed else 'no'}; "
            f"{largest}; residual {solver.tol:g}"
        )
        assert f"{name} {' '.join(solver.summary.split())} {declared}" in said
        assert cited(solver.source) in said
    backends = said[said.index("qp:NAME") :]
    here, elsewhere = re.search(
        r"; installed: (.*) not installed: (.*); pip install 'qpsolvers\[NAME\]'", backends
    ).groups()
    known = {name for name in metadata("qpsolvers").get_all("Provides-Extra") if "-" not in name}
    listed = {name.removeprefix("qp:") for name in SOLVERS if name.startswith("qp:")}
    assert set(here.split(", ")) | set(elsewhere.split(", ")) | listed >= known
    assert all(f"qp:{name}" in SOLVERS for name in here.split(", "))
    assert not any(f"qp:{name}" in SOLVERS for name in elsewhere.split(", "))


PAGE = (ROOT / "docs" / "guide" / "lcp.md").read_text(encoding="utf-8")


def test_the_examples_of_the_page_print_what_it_says():
    outcome = doctest.testfile(str(ROOT / "docs" / "guide" / "lcp.md"), module_relative=False, encoding="utf-8")
    assert outcome.attempted >= 8
    assert outcome.failed == 0


def test_the_commands_of_the_page_print_what_it_says(capsys, monkeypatch):
    monkeypatch.chdir(ROOT)
    blocks = re.findall(r"```console\n\$ lcpimpact (.*?)\n(.*?)```", PAGE, re.DOTALL)
    assert blocks
    for command, printed in blocks:
        code, said, _ = call(capsys, *command.split())
        assert code == 0
        assert said.strip() == unfolded(printed.strip())
        assert max(map(len, printed.splitlines())) <= 78


def test_the_solvers_and_statuses_of_the_page_exist():
    table = PAGE.split("## Which solver for what")[1].split("\n\n")[2]
    named = [name for row in table.splitlines()[2:] for name in re.findall(r"`([a-z:-]+)`", row.split("|")[2])]
    assert len(named) >= 9
    for name in named:
        assert name in SOLVERS or name in (":primal",), name
    statuses = PAGE.split("## What a status proves")[1].split("\n\n")[1]
    assert set(re.findall(r"`([A-Z_]+)`", statuses)) <= {each.name for each in li.Status}
