"""LCP files: text, NumPy arrays and Matrix Market.

Text (``.lcp``, ``.txt``, ``.csv``)::

    # two blocks, the upper one held by a slider
    M:  2 -1
       -1  1
    q: -1  0
    lower: 0 -0.5
    upper: inf 0.5

Numbers are separated by blanks or commas; ``#`` begins a comment and blank lines are ignored. Rows belong to the label
above them, or to M before the first label. Without ``q:`` the right-hand side is the last column of an n by n + 1 array
[M | q], or the last row of an n + 1 by n array. A bound is n numbers or one for all rows; by default 0 <= z ⟂ w >= 0.

NumPy (``.npz``): arrays M, or A and H of M = H A⁻¹ Hᵀ, or ``bands`` as in `Banded`; q; optionally lower and upper.

Matrix Market (``.mtx``) and single arrays (``.npy``): M with q in a separate file, or [M | q].
"""

from __future__ import annotations

import math
import re
import warnings
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from struct import error as StructError
from tokenize import TokenError
from typing import TYPE_CHECKING, Any, TypeAlias
from zipfile import BadZipFile, ZipFile
from zlib import error as ZlibError

import numpy as np
from numpy.typing import ArrayLike

from lcpimpact.arguments import checked
from lcpimpact.arrays import Array
from lcpimpact.errors import InputError, UnsupportedError
from lcpimpact.files import check_output, reading, whole_file
from lcpimpact.lcp.operators import DENSE_LIMIT, Banded, Delassus, Factored, as_operator, finite_array
from lcpimpact.lcp.problem import bounds
from lcpimpact.memory import check_memory
from lcpimpact.registry import nearest

if TYPE_CHECKING:
    from scipy.sparse import csc_matrix

    Matrix: TypeAlias = Array | csc_matrix
    Parts: TypeAlias = dict[str, Matrix]
    """Arrays of a file, by name."""

REMEDY = "give a sparse .mtx, or factors"
"""Remedy for an LCP that does not fit in memory."""

LARGE, PACKED = 1e9, 100.0
"""Size in bytes and compression ratio above which an array is rejected as an error or a decompression bomb."""

LABELS = ["M", "q", "lower", "upper"]
ARRAYS = ["M", "A", "H", "bands", "q", "lower", "upper"]

HEADER = (
    ("%%matrixmarket",),
    ("matrix",),
    ("array", "coordinate"),
    ("real", "double", "integer"),
    ("general", "symmetric", "skew-symmetric"),
)
"""Permitted fields of a Matrix Market header."""

SIGNS = {"general": 0.0, "symmetric": 1.0, "skew-symmetric": -1.0}
"""Factor of M_ij in M_ji by Matrix Market symmetry; zero where both entries are stored."""

LABEL = re.compile(r"([^\W\d]\w*)\s*:(.*)")

FILE_ERRORS = (
    OSError,
    ValueError,
    TypeError,
    KeyError,
    EOFError,
    OverflowError,
    RuntimeError,
    SyntaxError,
    TokenError,
    BadZipFile,
    ZlibError,
    StructError,
)
"""Exceptions of NumPy and zipfile for damaged files or files of another kind."""


@dataclass(frozen=True, eq=False)
class LCPFile:
    """An LCP read from a file.

    Attributes
    ----------
    M : Delassus                            `Dense`, `Banded` or `Factored`
    q : (n,) array
    lower, upper : (n,) array or None       None where the file has no such bound
    name : str                              file name without its folder
    """

    M: Delassus
    q: Array
    lower: Array | None
    upper: Array | None
    name: str


@checked
def read_lcp(path: str | Path, q: str | Path | None = None) -> LCPFile:
    """Read an LCP from a text file, a NumPy file or a Matrix Market file.

    Parameters
    ----------
    path : str or Path
        A file ending in .lcp, .txt, .csv, .npz, .npy or .mtx.
    q : str or Path, optional
        A file of the same kinds with the right-hand side, if the first contains only M.

    Raises
    ------
    InputError
        For a file that cannot be read or does not hold an LCP; the message names the file, and for text the line.

    Examples
    --------
    >>> from tempfile import mkdtemp
    >>> file = Path(mkdtemp(), "two.lcp")
    >>> _ = file.write_text("2 1 -5   # [M | q]" + chr(10) + "1 2 -6")
    >>> read_lcp(file).M.array(), read_lcp(file).q
    (array([[2., 1.],
           [1., 2.]]), array([-5., -6.]))
    """
    path = Path(path)
    with reading(path, REMEDY):
        parts = _split(_parts(path))
        if q is not None and "q" in parts:
            raise InputError("q stands in it already: leave it out there, or give no second file")
    if q is not None:
        with reading(Path(q), REMEDY):
            parts["q"] = _lone_vector(_parts(Path(q)))
    with reading(path, REMEDY):
        if "q" not in parts:
            raise InputError("it holds no q: add a row 'q: ...' to text or an array q, or give q in a file of its own")
        M = _operator(parts)
        right = finite_array("q", _vector("q", parts["q"], M.n))
        lower, upper = (_vector(name, parts[name], M.n) if name in parts else None for name in ("lower", "upper"))
        bounds(M.n, lower, upper)
    return LCPFile(M, right, lower, upper, path.name)


@checked
def write_lcp(
    path: str | Path, M: Any, q: ArrayLike, lower: ArrayLike | None = None, upper: ArrayLike | None = None
) -> Path:
    """Write an LCP to a file that `read_lcp` reads back exactly; the write is atomic.

    Parameters
    ----------
    path : str or Path
        A file ending in .lcp, .txt or .csv (text, with a dense M), or in .npz, which keeps bands and factors.
    M, q, lower, upper
        As for `solve_lcp`. Declared tags are not kept.

    Raises
    ------
    InputError
        For another ending, a folder that cannot be written, or data of the wrong shape or kind.
    UnsupportedError
        If M would have to be written as a dense matrix and is too large.
    """
    path = Path(path)
    check_output(path, WRITERS)
    operator = as_operator(M)
    right = finite_array("q", q)
    if right.shape != (operator.n,):
        raise InputError(f"q must have shape ({operator.n},) to fit M, and its shape is {right.shape}")
    low, high, _ = bounds(operator.n, lower, upper)
    vectors = {"q": right}
    vectors |= {
        name: array for name, given, array in (("lower", lower, low), ("upper", upper, high)) if given is not None
    }
    with whole_file(path) as part:
        WRITERS[path.suffix](part, operator, vectors)
    return path


def _parts(path: Path) -> Parts:
    """Return the arrays of a file by name; [M | q], or a single q, is called M."""
    ending = path.suffix.lower()
    if ending not in READERS:
        raise InputError(f"the ending {path.suffix!r} tells no format: known are {', '.join(READERS)}")
    if path.exists() and not path.is_file():
        raise InputError("it is no file; name one that holds an LCP")
    return dict(READERS[ending](path))


def _split(parts: Parts) -> Parts:
    """Return the parts with [M | q], or M with q below it, split into M and q."""
    if "M" not in parts:
        return parts
    M = parts["M"]
    if M.ndim != 2 or 0 in M.shape:
        raise InputError(f"M must have rows and columns, and its shape is {M.shape}")
    rows, columns = M.shape
    if rows == columns:
        return parts
    if abs(rows - columns) != 1:
        raise InputError(
            f"{rows} rows of {columns} numbers are no LCP: M has n rows of n, and q is one row or column more"
        )
    where = "column" if rows < columns else "row"
    if "q" in parts:
        raise InputError(f"q stands in it twice, by its name and as the last {where} of M")
    full = M if isinstance(M, np.ndarray) else M.tocsc()
    M, q = (full[:, :-1], full[:, [-1]]) if where == "column" else (full[:-1], full[[-1]])
    return parts | {"M": M, "q": _plain(q).reshape(-1)}


def _lone_vector(parts: Parts) -> Matrix:
    """Return q from a separate file: the array named q, or a single row or column."""
    if set(parts) == {"q"}:
        return parts["q"]
    if set(parts) == {"M"} and 1 in parts["M"].shape:
        return _plain(parts["M"]).reshape(-1)
    raise InputError("it must hold q alone: one row or one column of numbers")


def _operator(parts: Parts) -> Delassus:
    given = [name for name in ("M", "A", "H", "bands") if name in parts]
    if given == ["bands"]:
        return Banded(parts["bands"])
    if given == ["A", "H"]:
        return Factored(parts["A"], parts["H"])
    if given != ["M"]:
        raise InputError(f"it must hold M, or A and H, or bands, and it holds {' and '.join(given) or 'none of them'}")
    # The length of q is checked first, before a matrix of an absurd order is built.
    _vector("q", parts["q"], parts["M"].shape[0])
    return as_operator(parts["M"])


def _vector(name: str, values: Matrix, n: int) -> Array:
    """Return n numbers from a row, a column or a flat array; a single number is a bound of all rows."""
    array = np.atleast_1d(_plain(values))
    if name != "q" and array.size == 1:
        array = np.full(n, array.reshape(-1)[0])
    if array.size != n or array.ndim > 2 or max(array.shape) != n:
        found = array.size if array.ndim == 1 or 1 in array.shape else f"the shape {array.shape}"
        raise InputError(f"{name} must have n = {n} numbers to fit M, and it has {found}")
    return array.reshape(-1)


def _plain(values: Matrix) -> Array:
    """Return a real float64 array; a sparse one is made dense."""
    array = values if isinstance(values, np.ndarray) else values.toarray()
    return array.astype(np.float64)


def _real(name: str, array: Matrix) -> Matrix:
    if array.dtype.kind not in "fiub":
        raise InputError(f"{name} must hold real numbers, and it holds {array.dtype}")
    return array


# --- text --------------------------------------------------------------------------------------------------------------


def _read_text(path: Path) -> dict[str, Array]:
    found: dict[str, list[tuple[int, list[float]]]] = {}
    label = "M"
    for number, line in _lines(path):
        text = line.split("#", 1)[0].strip()
        if match := LABEL.fullmatch(text):
            label, text = match.groups()
            if label not in LABELS:
                raise InputError(f"line {number}: {nearest(label, LABELS, 'label')}")
            if label in found:
                raise InputError(f"line {number}: {label} stands in it twice; leave one")
            found[label] = []
        if row := _row(text, number):
            found.setdefault(label, []).append((number, row))
    if not any(found.values()):
        raise InputError("it holds no numbers; write the rows of M, then q")
    for label, rows in found.items():
        if not rows:
            raise InputError(f"{label}: is followed by no numbers")
        _check_rows(label, rows)
    return {
        label: np.array([row for _, row in rows]) if label == "M" else np.array([x for _, row in rows for x in row])
        for label, rows in found.items()
    }


def _lines(path: Path) -> Iterator[tuple[int, str]]:
    try:
        with path.open(encoding="utf-8-sig") as file:
            yield from enumerate(file, 1)
    except UnicodeDecodeError:
        raise InputError("it is no text in UTF-8; save it as such, or give it the ending of what it is") from None


def _row(text: str, number: int) -> list[float]:
    """Return the numbers of a line, separated by commas if it has any, else by blanks."""
    # Spreadsheets write empty cells before and after.
    text = text.strip(", \t")
    row = []
    # Python would read 1_000 as a thousand.
    for cell in text.split(",") if "," in text else text.split():
        try:
            row.append(float(cell.replace("_", "?")))
        except ValueError:
            raise InputError(
                f"line {number}: {cell.strip()[:30]!r} is no number; separate numbers by blanks or by commas, write "
                "decimals with a point, and words after #"
            ) from None
    return row


def _check_rows(label: str, rows: list[tuple[int, list[float]]]) -> None:
    first, width = rows[0][0], len(rows[0][1])
    for number, row in rows:
        if label == "M" and len(row) != width:
            raise InputError(
                f"line {number} has {len(row)} numbers and line {first} has {width}; all rows of M must have the same number"
            )
        if any(math.isnan(x) or (math.isinf(x) and label in ("M", "q")) for x in row):
            raise InputError(
                f"line {number}: a number of {label} is NaN, infinite or too large; only bounds may be infinite"
            )


def _write_text(path: Path, M: Delassus, vectors: Mapping[str, Array]) -> None:
    between = ", " if path.suffix == ".csv" else " "
    with path.open("w", encoding="utf-8") as file:
        file.write(f"# LCP of order {M.n}: w = M z + q\nM:\n")
        file.writelines(between.join(map(repr, row)) + "\n" for row in M.array().tolist())
        file.writelines(f"{name}: {between.join(map(repr, array.tolist()))}\n" for name, array in vectors.items())


# --- NumPy -------------------------------------------------------------------------------------------------------------


def _read_numpy(path: Path) -> dict[str, Array]:
    """Return the arrays of a .npz file by name, or the array of a .npy file as M."""
    data = BytesIO(path.read_bytes())
    _check_unpacked(data)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            loaded = np.load(data, allow_pickle=False)
            found = {"M": loaded} if isinstance(loaded, np.ndarray) else {name: loaded[name] for name in loaded.files}
    except FILE_ERRORS:
        raise InputError("it is no whole NumPy file of plain numbers: write it anew with np.savez or np.save") from None
    for name, array in found.items():
        if name not in ARRAYS:
            raise InputError(f"{nearest(name, ARRAYS, 'array')}; leave out what is no part of the problem")
        _real(name, array)
    if path.suffix.lower() == ".npy":
        found["M"] = np.atleast_2d(found["M"])
    return found


def _check_unpacked(data: BytesIO, *, copies: float = 2.0) -> None:
    """Reject a .npz file that unpacks to more than the free memory, or is a decompression bomb.

    ``copies``: number of copies of a matrix held while it is read and checked.
    """
    try:
        with ZipFile(data) as archive:
            unpacked = float(sum(each.file_size for each in archive.infolist()))
    except FILE_ERRORS:
        return  # a single array, or an error that NumPy reports in more detail
    finally:
        data.seek(0)
    packed = len(data.getbuffer())
    if unpacked > LARGE and unpacked > PACKED * packed:
        raise InputError(
            f"it unpacks to {unpacked / 1e9:.3g} GB from {packed / 1e9:.3g} GB, nearly all of it the same: {REMEDY}"
        )
    check_memory(copies * unpacked, "its arrays do", REMEDY)


def _write_numpy(path: Path, M: Delassus, vectors: Mapping[str, Array]) -> None:
    arrays: dict[str, Any] = dict(vectors)
    if isinstance(M, Banded):
        arrays["bands"] = M.bands
    elif isinstance(M, Factored):
        if M.A.shape[0] > DENSE_LIMIT:
            raise UnsupportedError(f"the factors of {M.A.shape[0]} coordinates are too large to be written out")
        arrays |= {name: _plain(each) for name, each in (("A", M.A), ("H", M.H))}
    else:
        arrays["M"] = M.array()
    with path.open("wb") as file:
        np.savez_compressed(file, **arrays)


# --- Matrix Market -----------------------------------------------------------------------------------------------------


def _read_matrix_market(path: Path) -> Parts:
    """Return the matrix as M. SciPy's reader is not used: some damaged files make it abort the process."""
    lines = _lines(path)
    _, text = next(lines, (1, ""))
    header = text.lower().split()
    if len(header) != 5 or any(word not in known for word, known in zip(header, HEADER, strict=True)):
        raise InputError(f"line 1 must read '{' '.join(map('|'.join, HEADER))}', and it reads {text.strip()[:60]!r}")
    dense, sign = header[2] == "array", SIGNS[header[4]]
    found = [(number, row) for number, text in lines if not text.startswith("%") and (row := _row(text, number))]
    number, sizes = found[0] if found else (2, [])
    if len(sizes) != (2 if dense else 3) or not all(x >= 0.0 and x.is_integer() for x in sizes):
        raise InputError(f"line {number} must hold the numbers of rows and columns{'' if dense else ' and entries'}")
    rows, columns = int(sizes[0]), int(sizes[1])
    # A huge order in a short file is an error, and would not fit in memory.
    if max(rows, columns) > max(1_000_000, path.stat().st_size) or (sign and rows != columns):
        raise InputError(f"line {number}: {rows} rows and {columns} columns cannot be right for this file")
    for number, row in found[1:]:
        if len(row) != (1 if dense else 3) or not all(map(math.isfinite, row)):
            raise InputError(f"line {number} must hold {'one number' if dense else 'row, column and number'}, finite")
    entries = np.array([row for _, row in found[1:]]).reshape(-1, 1 if dense else 3)
    diagonal = int(sign >= 0.0)
    triangle = rows * (rows - 1) // 2 + diagonal * rows
    wanted = int(sizes[-1]) if not dense else triangle if sign else rows * columns
    if len(entries) != wanted:
        raise InputError(f"it promises {wanted} entries and holds {len(entries)}; write it anew, whole")
    if not dense:
        return {"M": _from_entries(entries, sign, (rows, columns))}
    if not sign:
        return {"M": entries.reshape(columns, rows).T.copy()}
    # The lower triangle, column by column.
    M = np.zeros((rows, rows))
    j, i = np.triu_indices(rows, 1 - diagonal)
    M[j, i], M[i, j] = sign * entries[:, 0], entries[:, 0]
    return {"M": M}


def _from_entries(entries: Array, sign: float, shape: tuple[int, int]) -> Matrix:
    """Return the sparse matrix of the entries (i, j, M_ij), with M_ji = sign M_ij where sign is not zero."""
    from scipy.sparse import coo_matrix

    place, x = entries[:, :2].T - 1.0, entries[:, 2]
    if not ((place >= 0.0) & (place < np.array([shape]).T) & (place % 1.0 == 0.0)).all():
        raise InputError(f"an entry lies outside the {shape[0]} rows and {shape[1]} columns; they are counted from 1")
    i, j = place.astype(np.int64)
    off = (i != j) & (sign != 0.0)
    both = np.append(i, j[off]), np.append(j, i[off])
    return coo_matrix((np.append(x, sign * x[off]), both), shape=shape)


TEXT = (".lcp", ".txt", ".csv")

READERS: dict[str, Callable[[Path], Parts]] = {
    **dict.fromkeys(TEXT, _read_text),
    ".npz": _read_numpy,
    ".npy": _read_numpy,
    ".mtx": _read_matrix_market,
}

WRITERS: dict[str, Callable[[Path, Delassus, Mapping[str, Array]], None]] = {
    **dict.fromkeys(TEXT, _write_text),
    ".npz": _write_numpy,
}
