"""Representations of M: dense, symmetric banded, sparse, or factored as H A⁻¹ Hᵀ."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable
from enum import Enum
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from lcpimpact.arrays import Array, Vector
from lcpimpact.compiled import compiled
from lcpimpact.errors import InputError, UnsupportedError
from lcpimpact.lcp import compressed, storage
from lcpimpact.lcp.lapack import absolute_sum
from lcpimpact.registry import nearest

F8 = np.dtype(np.float64)

DENSE_LIMIT = 20_000
"""Order from which an operator is not converted to dense storage (3 GB) implicitly."""

SMALLEST_SPARSE = 400
"""Order from which a sparse M stays sparse."""

FULLEST_SPARSE = 0.1
"""Fraction of entries above which a sparse M is converted to dense storage."""


class Property(Enum):
    """A property of M that a solver may require; its name in lower case is the tag that declares it."""

    SYMMETRIC = "symmetric"
    PSD = "positive semidefinite"
    P = "a P-matrix"
    POSITIVE_DIAGONAL = "positive diagonal"


UNTAGGED: frozenset[Property] = frozenset()


def real_array(name: str, values: ArrayLike, copy: bool = True) -> Array:
    """Return a C-ordered writable float64 array; raise for anything but real numbers.

    With ``copy=False`` an array that already has this form is returned unchanged.
    """
    try:
        array = (
            np.array(values, order="C") if copy or not isinstance(values, np.ndarray) else np.asarray(values, order="C")
        )
        if array.dtype is F8 and array.flags.writeable:
            return array
        if array.dtype.kind in "fiub":
            return array.astype(np.float64)
    except (TypeError, ValueError, OverflowError):
        pass
    raise InputError(f"{name} must be an array of real numbers, all rows of one length, and it is {values!r}")


@compiled()
def all_finite(x: Vector) -> bool:
    """Return whether no number is NaN or infinite."""
    finite = absolute_sum(x) < np.inf
    if not finite:
        # The sum of finite numbers may be infinite.
        finite = True
        for i in range(len(x)):
            finite = finite and abs(x[i]) < np.inf
    return finite


def finite_array(name: str, values: ArrayLike, copy: bool = True) -> Array:
    """Return `real_array`; raise for NaN and inf."""
    array = real_array(name, values, copy)
    if not all_finite(array if array.ndim == 1 else array.reshape(-1)):
        raise InputError(f"{name} has an entry that is not finite: replace NaN and inf before solving")
    return array


def _tags(tags: Iterable[str]) -> frozenset[Property]:
    if not tags:
        return UNTAGGED
    known = {each.name.lower(): each for each in Property}
    for tag in tags:
        if tag not in known:
            raise InputError(nearest(str(tag), list(known), "tag of M"))
    return frozenset(known[tag] for tag in tags)


class Delassus(ABC):
    """The matrix of an LCP in one of four forms: `Dense`, `Banded`, `Sparse`, `Factored`.

    Attributes
    ----------
    n : int
        Order.
    storage : str
        "dense", "banded", "sparse" or "factored"; a solver declares those that it accepts.
    tags : frozenset of Property
        Declared properties; others are tested numerically where a solver requires them.
    """

    storage: str
    n: int
    tags: frozenset[Property]

    @property
    @abstractmethod
    def W(self) -> Any:
        """The form passed to kernels: a dense or banded array, or the operator itself."""

    @abstractmethod
    def product(self, z: Array, w: Array) -> None:
        """Set w = M z."""

    @abstractmethod
    def column(self, j: int, c: Array) -> None:
        """Set c = M_·j."""

    @abstractmethod
    def diagonal(self, d: Array) -> None:
        """Set d = (M_ii)."""

    def array(self) -> Array:
        """Return the dense M.

        Raises
        ------
        UnsupportedError
            If it would not fit in memory.
        """
        _refuse_large(self.n)
        M, c = np.empty((self.n, self.n)), np.empty(self.n)
        for j in range(self.n):
            self.column(j, c)
            M[:, j] = c
        return M

    def has(self, wanted: Property) -> bool:
        """Return whether M is known to have the property: declared, or verified to rounding error.

        P is recognised from a positive definite symmetric part, strict diagonal dominance, or for n <= 10 all minors.
        """
        if wanted in self.tags:
            return True
        return _FOUND[wanted](self)


class Dense(Delassus):
    """A dense square matrix.

    Parameters
    ----------
    M : (n, n) array_like
        Finite numbers.
    tags : iterable of str
        Declared properties: "symmetric", "psd", "p", "positive_diagonal".
    A, H : arrays, optional
        Factors of M = H A⁻¹ Hᵀ for Gauss's principle: (m, m) symmetric positive definite, (n, m).
    copy : bool
        Whether M is copied; if not, M must not change while the operator is in use.

    Raises
    ------
    InputError
        If M is not square, is empty or has a non-finite entry.

    Examples
    --------
    >>> Dense([[2.0, 1.0], [1.0, 2.0]], tags=["psd"]).has(Property.SYMMETRIC)
    True
    """

    storage = "dense"

    def __init__(
        self,
        M: ArrayLike,
        tags: Iterable[str] = (),
        *,
        A: Array | None = None,
        H: Array | None = None,
        copy: bool = True,
    ) -> None:
        self.M = finite_array("M", M, copy)
        if self.M.ndim != 2 or self.M.shape[0] != self.M.shape[1]:
            raise InputError(f"M must be square, and its shape is {self.M.shape}")
        self.n = len(self.M)
        if self.n == 0:
            raise InputError("the LCP is empty: give at least one row")
        self.tags = _tags(tags)
        self.A, self.H = A, H

    @property
    def W(self) -> Array:
        """M."""
        return self.M

    def product(self, z: Array, w: Array) -> None:
        """Set w = M z."""
        storage.product(self.M, z, w)

    def column(self, j: int, c: Array) -> None:
        """Set c = M_·j."""
        storage.column(self.M, j, c)

    def diagonal(self, d: Array) -> None:
        """Set d = (M_ii)."""
        storage.diagonal(self.M, d)

    def array(self) -> Array:
        """Return M."""
        return self.M


class Banded(Delassus):
    """A symmetric banded matrix given by its lower bands, as for the contacts of a chain or a bar.

    Parameters
    ----------
    bands : (b + 1, n) array_like
        bands[k, j] = M[j + k, j]; the last k entries of row k lie outside M and are not read.
    tags : iterable of str
        Declared properties, as for `Dense`; symmetric is implied.

    Raises
    ------
    InputError
        If the array is not two-dimensional, has more rows than columns, or a non-finite entry.

    Examples
    --------
    >>> Banded([[2.0, 2.0, 2.0], [-1.0, -1.0, 0.0]]).array()
    array([[ 2., -1.,  0.],
           [-1.,  2., -1.],
           [ 0., -1.,  2.]])
    """

    storage = "banded"

    def __init__(self, bands: ArrayLike, tags: Iterable[str] = ()) -> None:
        self.bands = real_array("bands", bands)
        if self.bands.ndim != 2 or not 1 <= len(self.bands) <= self.bands.shape[1]:
            raise InputError(f"bands must have the shape (b + 1, n) with b < n, and it is {self.bands.shape}")
        self.n = self.bands.shape[1]
        for k in range(1, len(self.bands)):
            self.bands[k, self.n - k :] = 0.0
        finite_array("bands", self.bands)
        self.tags = _tags(tags) | {Property.SYMMETRIC}

    @property
    def W(self) -> Array:
        """The bands; M itself if the two storages have the same shape."""
        return self.bands if len(self.bands) < self.n else self.array()

    def product(self, z: Array, w: Array) -> None:
        """Set w = M z."""
        storage.product(self.W, z, w)

    def column(self, j: int, c: Array) -> None:
        """Set c = M_·j."""
        c[:] = 0.0
        for k in range(len(self.bands)):
            if j + k < self.n:
                c[j + k] = self.bands[k, j]
            if j - k >= 0:
                c[j - k] = self.bands[k, j - k]

    def diagonal(self, d: Array) -> None:
        """Set d = (M_ii)."""
        d[:] = self.bands[0]


class Sparse(Delassus):
    """A sparse square matrix, symmetric or not, as for the contacts of many bodies; it is never made dense.

    Parameters
    ----------
    M : (n, n) sparse matrix or array_like
        In any format of SciPy, with its entries in any order; entries of one place are added.
    tags : iterable of str
        Declared properties, as for `Dense`.

    Raises
    ------
    InputError
        If M is not square, is empty or damaged, or has an entry that is not a finite real number.

    Examples
    --------
    >>> from scipy.sparse import coo_array
    >>> Sparse(coo_array(([2.0, 1.5, 0.5, -1.0], ([0, 1, 1, 0], [0, 1, 1, 1])))).array()
    array([[ 2., -1.],
           [ 0.,  2.]])
    """

    storage = "sparse"

    def __init__(self, M: Any, tags: Iterable[str] = ()) -> None:
        self.M = _rows(M)
        self.n = self.M.shape[0]
        if self.n == 0:
            raise InputError("the LCP is empty: give at least one row")
        self.tags = _tags(tags)
        self._entries = _entries(self.M)

    @property
    def W(self) -> compressed.Entries:
        """The entries by rows and by columns."""
        return self._entries

    def product(self, z: Array, w: Array) -> None:
        """Set w = M z."""
        compressed.product(self._entries, z, w)

    def column(self, j: int, c: Array) -> None:
        """Set c = M_·j."""
        compressed.column(self._entries, j, c)

    def diagonal(self, d: Array) -> None:
        """Set d = (M_ii)."""
        d[:] = self.M.diagonal()

    def array(self) -> Array:
        """Return the dense M."""
        _refuse_large(self.n)
        M: Array = self.M.toarray()
        return M


class Factored(Delassus):
    r"""The Delassus operator M = H A⁻¹ Hᵀ in factored form: A is factored once.

    M is formed by solver "auto" alone, where A is diagonal and H sparse, so that M is sparse.

    Parameters
    ----------
    A : (m, m) array_like or sparse matrix
        Symmetric positive definite: the mass matrix, or the iteration matrix of a time step.
    H : (n, m) array_like or sparse matrix
        One row per contact.
    tags : iterable of str
        Declared properties, as for `Dense`; symmetric and positive semidefinite are implied.

    Raises
    ------
    InputError
        If the shapes are inconsistent, or A is not symmetric positive definite.

    Examples
    --------
    >>> Factored([[4.0, 0.0], [0.0, 2.0]], [[1.0, 0.0], [-1.0, 1.0]]).array()
    array([[ 0.25, -0.25],
           [-0.25,  0.75]])
    """

    storage = "factored"

    def __init__(self, A: Any, H: Any, tags: Iterable[str] = ()) -> None:
        self.A: Any = A if _is_sparse(A) else finite_array("A", A)
        self.H: Any = H if _is_sparse(H) else finite_array("H", H)
        if self.A.ndim != 2 or self.A.shape[0] != self.A.shape[1]:
            raise InputError(f"A must be square, and its shape is {self.A.shape}")
        if self.H.ndim != 2 or self.H.shape[1] != self.A.shape[0] or self.H.shape[0] == 0:
            raise InputError(f"H must have {self.A.shape[0]} columns, as A has, and rows; its shape is {self.H.shape}")
        self.n = self.H.shape[0]
        self.tags = _tags(tags) | {Property.SYMMETRIC, Property.PSD}
        self._solve = _sparse_factor(self.A) if _is_sparse(self.A) else _dense_factor(self.A)
        self._diagonal: Array | None = None
        self._H: Any = H.tocsr() if _is_sparse(H) else self.H
        self._absolute_H = abs(self._H) if _is_sparse(H) and _is_sparse(A) and _is_stieltjes(self.A) else None

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle A and H only: SuperLU factors cannot be pickled, so A is factored again in the other process."""
        return type(self), (self.A, self.H, [each.name.lower() for each in self.tags])

    @property
    def W(self) -> Factored:
        """The operator itself."""
        return self

    @property
    def shape(self) -> tuple[int, int]:
        """Shape of M."""
        return self.n, self.n

    def longest_row(self) -> int:
        """Return the largest number of entries of a row of M."""
        return self.n

    @property
    def is_sparse(self) -> bool:
        """Whether both factors are sparse."""
        return _is_sparse(self.A) and _is_sparse(self.H)

    def formed(self) -> Delassus | None:
        """Return M by its entries, banded if it is, where A is diagonal, so that M is as sparse as H; None elsewhere."""
        from scipy.sparse import csr_array, diags_array

        if not self.is_sparse:
            return None
        A = self.A.tocoo()
        if (A.data[A.row != A.col] != 0.0).any():
            return None
        H = csr_array(self._H)
        return as_operator(H @ diags_array(1.0 / self.A.diagonal()) @ H.T, [each.name.lower() for each in self.tags])

    def _roots(self) -> Array:
        """Return sqrt(M_ii), for the bound |M_ij| <= sqrt(M_ii M_jj) of a semidefinite M."""
        d = np.empty(self.n)
        self.diagonal(d)
        return np.sqrt(d)

    def absolute_product(self, v: Array, c: Array) -> None:
        """Set c to an upper bound of |M| |v|: |H| A⁻¹ |H|ᵀ |v| if A⁻¹ has no negative entry, else by the roots of M_ii."""
        if self._absolute_H is not None:
            c[:] = self._absolute_H @ np.abs(self._solve(self._absolute_H.T @ np.abs(v)))
            return
        roots = self._roots()
        c[:] = roots * (roots @ np.abs(v))

    def spread(self, j: int, x: float, c: Array) -> None:
        """Add an upper bound of |M_·j x| to c."""
        c += abs(x) * self._absolute_column(j)

    def weight(self, j: int, size: Array) -> float:
        """Return an upper bound of max_i |M_ij| / size_i."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return float(np.nanmax(np.append(self._absolute_column(j) / size, 0.0)))

    def _absolute_column(self, j: int) -> Array:
        """Return an upper bound of |M_·j|."""
        column: Array
        if self._absolute_H is not None:
            column = self._absolute_H @ np.abs(self._solve(self._absolute_H[[j]].toarray()[0]))
            return column
        roots = self._roots()
        column = roots * roots[j]
        return column

    def product(self, z: Array, w: Array) -> None:
        """Set w = H A⁻¹ Hᵀ z."""
        w[:] = self._H @ self._solve(self._H.T @ z)

    def column(self, j: int, c: Array) -> None:
        """Set c = H A⁻¹ H_j."""
        row = self._H[[j]]
        c[:] = self._H @ self._solve(row.toarray()[0] if _is_sparse(row) else row[0])

    def diagonal(self, d: Array) -> None:
        """Set d = (H_i A⁻¹ H_i); computed on the first call, by one solve per row."""
        if self._diagonal is None:
            self._diagonal, c = np.empty(self.n), np.empty(self.n)
            for j in range(self.n):
                self.column(j, c)
                self._diagonal[j] = c[j]
        d[:] = self._diagonal


def as_operator(M: Any, tags: Iterable[str] = (), copy: bool = True) -> Delassus:
    """Return M as an operator: unchanged if it is one; else `Dense`, or, if sparse, `Banded`, `Sparse` or `Dense`.

    A sparse M becomes `Banded` if it is symmetric and narrow-banded; `Dense` if it is small or full.
    """
    if isinstance(M, np.ndarray):
        return Dense(M, tags, copy=copy)
    if isinstance(M, Delassus):
        if tags:
            raise InputError("tags stand with the operator: give them where it is made")
        return M
    if not _is_sparse(M):
        return Dense(M, tags)
    found = Sparse(M, tags)
    bands = _bands(found)
    if bands is not None:
        return Banded(bands, tags)
    few = found.n < SMALLEST_SPARSE or found.M.nnz > FULLEST_SPARSE * found.n**2
    return Dense(found.M.toarray(), tags) if few and found.n <= DENSE_LIMIT else found


def narrow(M: Array) -> Banded | None:
    """Return a dense symmetric M in banded storage if its bandwidth is small, else None."""
    n = len(M)
    b = storage.bandwidth(M) if n >= 8 else n
    if 4 * (b + 1) > n or not storage.is_symmetric(M):
        return None
    bands = np.zeros((b + 1, n))
    for k in range(b + 1):
        bands[k, : n - k] = np.diag(M, -k)
    return Banded(bands)


def _refuse_large(n: int) -> None:
    if n > DENSE_LIMIT:
        raise UnsupportedError(
            f"a dense M of order {n} takes {8e-9 * n**2:.0f} GB: give M sparse, Banded or Factored, and take solver='auto'"
        )


def _rows(M: Any) -> Any:
    """Return a square M by its rows in SciPy's format, a copy with one entry for each place, none of them zero."""
    from scipy.sparse import csr_array

    if not _is_sparse(M):
        M = csr_array(finite_array("M", M))
    if M.ndim != 2 or M.shape[0] != M.shape[1]:
        raise InputError(f"M must be square, and its shape is {M.shape}")
    if M.dtype.kind not in "fiub":
        raise InputError(f"M must hold real numbers, and its entries are {M.dtype}")
    try:
        # As floats before entries are added, since small integers would overflow.
        rows = M.astype(np.float64).tocsr()
        rows = csr_array((rows.data, rows.indices, rows.indptr), shape=M.shape, copy=True)
        rows.check_format(full_check=True)
    except ValueError as error:
        raise InputError(f"M is no sparse matrix that can be read: {error}") from None
    rows.sum_duplicates()
    finite_array("M", rows.data, copy=False)
    rows.eliminate_zeros()
    return rows


def _entries(rows: Any) -> compressed.Entries:
    """Return the entries of M in the storage of compiled code; a symmetric M has one copy of them."""
    columns = rows.tocsc()
    of_rows, of_columns = (
        (each.indptr.astype(np.int64), each.indices.astype(np.int64), np.ascontiguousarray(each.data))
        for each in (rows, columns)
    )
    if all(map(np.array_equal, of_rows, of_columns)):
        of_columns = of_rows
    return compressed.Entries(*of_rows, *of_columns)


def _bands(M: Sparse, *, widest_empty_band: int = 16) -> Array | None:
    # widest_empty_band: half bandwidth above which a sparse M of bands that are mostly zero, as for a lattice,
    # stays sparse.
    coo, n = M.M.tocoo(), M.n
    distance = coo.row - coo.col
    b = int(np.abs(distance).max(initial=0))
    lower = distance >= 0
    empty = b > widest_empty_band and (b + 1) * n > 2 * np.count_nonzero(lower)
    if 4 * (b + 1) > n or empty or not compressed.is_symmetric(M.W):
        return None
    bands = np.zeros((b + 1, n))
    bands[distance[lower], coo.col[lower]] = coo.data[lower]
    return bands


def _is_sparse(M: Any) -> bool:
    # Called for every M, so SciPy is not imported here: a sparse M implies that it has been imported.
    return hasattr(M, "tocsr") and not isinstance(M, np.ndarray)


def _not_definite() -> InputError:
    return InputError(
        "A must be symmetric positive definite: every coordinate needs a mass, spring or dashpot of its own"
    )


def _dense_factor(A: Array) -> Callable[[Array], Array]:
    from scipy.linalg import cho_factor, cho_solve

    if not storage.is_symmetric(A):
        raise _not_definite()
    try:
        factor = cho_factor(A)
    except np.linalg.LinAlgError:
        raise _not_definite() from None

    def solve(b: Array) -> Array:
        x: Array = cho_solve(factor, b)
        return x

    return solve


def _sparse_factor(A: Any) -> Callable[[Array], Array]:
    A = A.tocsc()
    finite_array("A", A.data)
    if abs(A - A.T).max() > 1e-12 * abs(A).max():
        raise _not_definite()
    factor = _definite_factor(A)
    if factor is None:
        raise _not_definite()

    def solve(b: Array) -> Array:
        x: Array = factor.solve(np.ascontiguousarray(b))
        return x

    return solve


def _is_stieltjes(A: Any) -> bool:
    """Return whether a symmetric positive definite A has no positive entry off its diagonal: then A⁻¹ >= 0."""
    entries = A.tocoo()
    return bool((entries.data[entries.row != entries.col] <= 0.0).all())


def _definite_factor(A: Any) -> Any:
    """Return the factors of a symmetric sparse matrix, or None if it is not positive definite."""
    from scipy.sparse.linalg import splu

    if not (A.diagonal() > 0.0).all():
        return None
    try:
        # Without pivoting this is L D Lᵀ, whose signs are those of the eigenvalues.
        factor = splu(A, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    except RuntimeError:
        return None
    without_pivoting = np.array_equal(factor.perm_r, factor.perm_c)
    return factor if without_pivoting and (factor.U.diagonal() > 0.0).all() else None


def _is_definite(M: Delassus, shift: float) -> bool:
    """Return whether the symmetric part plus ``shift`` max |M| I has a Cholesky factor."""
    S = 0.5 * M.array() + 0.5 * M.array().T  # the sum of two large numbers may overflow
    scale = np.abs(S).max() or 1.0
    try:
        np.linalg.cholesky(S / scale + shift * np.eye(M.n))
    except np.linalg.LinAlgError:
        return False
    return True


def _is_banded_definite(M: Banded, shift: float) -> bool:
    from scipy.linalg import cholesky_banded

    bands = M.bands / (np.abs(M.bands).max() or 1.0)
    bands[0] += shift
    try:
        cholesky_banded(bands, lower=True)
    except np.linalg.LinAlgError:
        return False
    return True


def _is_sparse_definite(M: Sparse, shift: float) -> bool:
    from scipy.sparse import identity

    S = 0.5 * M.M + 0.5 * M.M.T
    S = S / (abs(S).max() or 1.0) + shift * identity(M.n)
    d = S.diagonal()
    if (2.0 * d > abs(S).sum(axis=1)).all():  # diagonally dominant
        return True
    return _definite_factor(S.tocsc()) is not None


def _definite(M: Delassus, shift: float) -> bool:
    if isinstance(M, Banded):
        return _is_banded_definite(M, shift)
    return _is_sparse_definite(M, shift) if isinstance(M, Sparse) else _is_definite(M, shift)


def _psd(M: Delassus) -> bool:
    return _definite(M, 1e-12 * M.n)


def _symmetric(M: Delassus) -> bool:
    if isinstance(M, Sparse):
        return compressed.is_symmetric(M.W)
    return not isinstance(M, Dense) or storage.is_symmetric(M.M)


def _positive_diagonal(M: Delassus) -> bool:
    if isinstance(M, Factored):  # A is positive definite
        return bool((abs(M._H).sum(axis=1) > 0.0).all())
    d = np.empty(M.n)
    M.diagonal(d)
    return bool((d > 0.0).all())


def _p(M: Delassus) -> bool:
    if not _positive_diagonal(M):
        return False
    if isinstance(M, Banded):
        return _definite(M, 0.0)
    full: Any = M.M if isinstance(M, Sparse) else M.array()
    size, d = abs(full), full.diagonal()
    if any((2.0 * d > size.sum(axis=axis)).all() for axis in (0, 1)) or _definite(M, 0.0):
        return True
    if M.n > 10:
        return False
    full = M.array()
    subsets = (list(rows) for k in range(1, M.n + 1) for rows in combinations(range(M.n), k))
    return all(np.linalg.det(full[np.ix_(rows, rows)]) > 0.0 for rows in subsets)


_FOUND: dict[Property, Callable[[Delassus], bool]] = {
    Property.SYMMETRIC: _symmetric,
    Property.PSD: _psd,
    Property.P: _p,
    Property.POSITIVE_DIAGONAL: _positive_diagonal,
}
