"""Products of matrices and vectors in compiled code, by the BLAS that SciPy offers."""

from __future__ import annotations

from lcpimpact.compiler.code import Code, Value
from lcpimpact.compiler.kinds import REAL, ArrayKind
from lcpimpact.compiler.routines import routine
from lcpimpact.compiler.writer import Writer


def product(writer: Writer, A: Value, B: Value) -> Value:
    """Return A B of a matrix and a matrix or vector, in C order."""
    code = writer.code
    A, B = code.loaded(writer.contiguous(A)), code.loaded(writer.contiguous(B))
    assert isinstance(A.kind, ArrayKind)
    assert isinstance(B.kind, ArrayKind)
    if A.kind.axes != 2:
        raise TypeError("a vector times another is written as a loop")
    m, k = A.registers[1:3]
    matrix = B.kind.axes == 2
    n = B.registers[2] if matrix else "1"
    found = code.allocate(ArrayKind(REAL, B.kind.axes), [m, n] if matrix else [m], zero=True)
    one, zero = _real(code, "1.0"), _real(code, "0.0")
    with code.where(code.get(f"icmp sgt i64 {code.whole('mul', m, code.whole('mul', k, n))}, 0")):
        rows, columns = _short(code, m), _short(code, n)
        inner, unit = _short(code, k), _short(code, "1")
        x, y = A.registers[0], B.registers[0]
        z = found.registers[0]
        # An array in C order is transposed for Fortran.
        if matrix:
            called, same = routine("scipy.linalg.cython_blas.dgemm", 13), _letter(code, "N")
            given = [same, same, columns, rows, inner, one, y, columns, x, inner, zero, z, columns]
        else:
            called = routine("scipy.linalg.cython_blas.dgemv", 11)
            given = [_letter(code, "T"), inner, rows, one, x, inner, y, unit, zero, z, unit]
        writer.routines[called] = None
        code.do(f"call void @{called.symbol}({', '.join(f'ptr {each}' for each in given)})")
    return writer.made(found)


def _short(code: Code, number: str) -> str:
    """Return the address of an integer of Fortran."""
    place = code.place("i32")
    code.do(f"store i32 {code.get(f'trunc i64 {number} to i32')}, ptr {place}")
    return place


def _real(code: Code, number: str) -> str:
    """Return the address of a number."""
    place = code.place("double")
    code.do(f"store double {number}, ptr {place}")
    return place


def _letter(code: Code, letter: str) -> str:
    """Return the address of a letter."""
    place = code.place("i8")
    code.do(f"store i8 {ord(letter)}, ptr {place}")
    return place
