r"""What large sparse LCPs cost: lattices of contacts, an obstacle problem and a pile of discs, of 10⁴ to 10⁶ contacts.

    python benchmarks/lcp_sparse.py [--sizes 100,316] [--solvers auto,nncg,psor,qp:osqp,qp:clarabel]

The sizes are the contacts along a side. Times are CPU seconds of this process, of single calls: a cold start, and a warm one
from the answer for a right side that differs by a thousandth of its largest entry. Beside them are one sparse factorisation
and solution of M x = -q. Every answer is judged by `solve_lcp`, and its natural residual is computed here again.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from conditions import print_conditions
from scipy import sparse
from scipy.sparse.linalg import splu
from tiny import add_tiny

from lcpimpact.arrays import Array
from lcpimpact.errors import InputError, UnsupportedError
from lcpimpact.lcp.operators import Sparse
from lcpimpact.lcp.solve import LCPSolution, prepare_lcp
from lcpimpact.lcp.sparse_pivoting import SYMMETRIC
from lcpimpact.problems.balls import pile

LARGEST_PILE = 400


def lattice(k: int) -> Any:
    """Return the five-point matrix of k × k contacts."""
    line = sparse.diags_array([np.full(k - 1, -1.0), np.full(k, 2.0), np.full(k - 1, -1.0)], offsets=[-1, 0, 1])
    return sparse.csr_array(sparse.kron(line, sparse.eye_array(k)) + sparse.kron(sparse.eye_array(k), line))


def obstacle(k: int) -> tuple[Any, Array]:
    """Return a membrane under a load over an obstacle; z is its height above the obstacle."""
    M, x = lattice(k), np.arange(1, k + 1) / (k + 1)
    top = 0.3 - np.minimum(np.abs(x[None, :] - 0.3), 0.3) - (x[:, None] - 0.5) ** 2
    return M, M @ top.ravel() + 1.0 / (k + 1) ** 2


def problems(k: int) -> Iterator[tuple[str, Any, Array]]:
    """Yield the name, M and q of each problem."""
    rng = np.random.default_rng(0)
    yield ("lattice", lattice(k), rng.standard_normal(k * k))
    yield ("obstacle", *obstacle(k))
    if k <= LARGEST_PILE:
        d = pile(k, 0.0).dynamics
        M = sparse.csr_array(d.H @ d.B)
        n = M.shape[0]
        touching = np.where(rng.random(n) < 0.7, rng.random(n), 0.0)
        yield ("pile", M, M @ -touching + 0.1 * rng.standard_normal(n))


def cpu(call: Callable[[], Any]) -> tuple[float, Any]:
    """Return the CPU seconds of a call, and its result."""
    began = time.process_time()
    result = call()
    return time.process_time() - began, result


def residual(M: Any, q: Array, z: Array) -> float:
    """Return ‖min(z, M z + q)‖_inf over max |q|."""
    return float(np.abs(np.minimum(z, M @ z + q)).max() / np.abs(q).max())


def said(M: Any, q: Array, seconds: float, solution: LCPSolution) -> str:
    """Return the cell of a call."""
    return f"{seconds:8.2f} {solution.status.name.lower():>10} {residual(M, q, solution.z):8.1e}"


def main() -> None:
    """Print a row for each problem and solver."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sizes", default="100,316")
    parser.add_argument("--solvers", default="auto,nncg,psor,qp:osqp,qp:clarabel")
    add_tiny(parser, sizes="5")
    options = parser.parse_args()
    print_conditions()
    small = Sparse(lattice(4), ["psd"])
    solvers = []
    for name in options.solvers.split(","):
        try:
            prepare_lcp(small, name).solve(-np.ones(16), throw=False)  # loads the compiled code
        except InputError as missing:
            print(f"{name} skipped: {missing}")
        else:
            solvers.append(name)
    prepare_lcp(lattice(21)).solve(-np.ones(441))
    print("problem  contacts  solver        prepared   cold s     status residual   warm s     status residual  route")
    for k in map(int, options.sizes.split(",")):
        for what, M, q in problems(k):
            n = len(q)
            floor, _ = cpu(lambda M=M, q=q: splu(M.tocsc(), **SYMMETRIC).solve(-q))
            print(f"{what:8} {n:9,}  splu                  {floor:8.2f}", flush=True)
            for name in solvers:
                # What `auto` needs it finds; the others are told that M is semidefinite.
                operator, again = (M if name == "auto" else Sparse(M, ["psd"])), q.copy()
                again += 1e-3 * np.abs(q).max() * np.random.default_rng(1).standard_normal(n)
                try:
                    once, prepared = cpu(lambda operator=operator, name=name: prepare_lcp(operator, name))
                except UnsupportedError as refusal:
                    print(f"{what:8} {n:9,}  {name:13} {refusal}")
                    continue
                cold, first = cpu(lambda p=prepared, q=q: p.solve(q, throw=False))
                warm, second = cpu(lambda p=prepared, q=again, z=first.z: p.solve(q, z0=z, throw=False))
                print(
                    f"{what:8} {n:9,}  {name:13} {once:8.2f} {said(M, q, cold, first)} {said(M, again, warm, second)}  "
                    f"{', '.join(first.route)} ({first.iterations}, {second.iterations})",
                    flush=True,
                )


if __name__ == "__main__":
    os.environ.setdefault("LCPIMPACT_COMPILE", "first")  # compiled code is measured
    main()
