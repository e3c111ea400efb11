"""The chunks of a sweep: their size, and their runs by any executor."""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from functools import partial
from typing import TypeVar

import numpy as np

from lcpimpact.arrays import Array, Indices
from lcpimpact.errors import FailureError, LcpImpactError
from lcpimpact.sweeps.job import Job
from lcpimpact.sweeps.samples import Plan
from lcpimpact.sweeps.sets import Sets, run_sets, runs_side_by_side
from lcpimpact.sweeps.side_by_side import MIN_SETS
from lcpimpact.sweeps.store import Block

K = TypeVar("K")
T = TypeVar("T")
R = TypeVar("R")

SHORTEST = 0.2
LONGEST = 5.0
MAX_BYTES = 64e6
"""Largest size of a chunk, which is kept whole in memory."""


def try_sets(
    job: Job, plan: Plan, threads: int = 1, *, trial_seconds: float = 0.05, trial_sets: int = 32_768
) -> tuple[float, Sets]:
    """Run the first sets here, in doubling numbers, until their time can be told.

    Returns the time of one set in s, and the results. The first set is not timed, since it may compile.

    ``trial_seconds``: shortest duration of a trial run in s from which the time of a set is judged.
    ``trial_sets``: number of sets of a trial side by side.
    """
    parts: list[Sets] = []
    done = 0
    took = 0.0
    sets = 1

    def run(count: int) -> float:
        nonlocal done, sets
        numbers = np.arange(done, min(done + count, plan.size))
        began = time.perf_counter()
        parts.append(run_sets(job, plan.values(numbers), threads))
        done, sets = done + len(numbers), max(len(numbers), 1)
        return time.perf_counter() - began

    run(1)
    if plan.size > MIN_SETS and runs_side_by_side(job, plan):
        took = run(trial_sets)
    while done < plan.size and took < trial_seconds and done < MIN_SETS:
        took = run(done)
    return max(took, 1e-9) / sets, Sets.joined(parts)


def sets_per_chunk(job: Job, plan: Plan, seconds: float, *, chunks: int = 64, max_chunks: int = 10_000) -> int:
    """Return the number of sets of a chunk of a moderate time, from the time of one set in s.

    ``chunks``: bounds of the time of a chunk in s, and the number of chunks between them.
    ``max_chunks``: largest number of chunks, each of which is a file for each output.
    """
    total = plan.size * seconds
    wanted = min(max(total / chunks, SHORTEST), LONGEST) / seconds
    of_set = 8.0 * sum(len(job.times(each.series)) if each.series else 1 for each in job.quantities())
    return max(1, math.ceil(plan.size / max_chunks), min(round(wanted), int(MAX_BYTES / of_set)))


def chunk_shape(shape: Sequence[int], count: int) -> tuple[int, ...]:
    """Return the size along each dimension of a chunk of about ``count`` sets, whole along the last dimensions.

    Examples
    --------
    >>> chunk_shape((50, 40, 10), 100), chunk_shape((50, 40, 10), 7), chunk_shape((1000,), 300)
    ((1, 10, 10), (1, 1, 7), (300,))
    """
    sizes = []
    for n in reversed(shape):
        sizes.append(max(1, min(n, count)))
        count //= sizes[-1]
    return tuple(reversed(sizes))


def blocks_of(shape: Sequence[int], chunk: Sequence[int]) -> Iterator[Block]:
    """Yield the blocks of all chunks."""
    starts = [range(0, n, size) for n, size in zip(shape, chunk, strict=True)]
    for first in itertools.product(*starts):
        yield tuple(slice(a, min(a + size, n)) for a, size, n in zip(first, chunk, shape, strict=True))


def sets_of(block: Block, shape: Sequence[int]) -> Indices:
    """Return the numbers of the sets of a block, in the order of the sets (m,)."""
    at = np.ix_(*(np.arange(each.start, each.stop) for each in block))
    return np.ravel_multi_index(at, tuple(shape)).ravel()


def run_blocks(
    job: Job, plan: Plan, blocks: Sequence[Block], executor: Executor | None, known: Sets | None, threads: int = 1
) -> Iterator[tuple[Block, Sets]]:
    """Run blocks and yield them with their results as they finish; ``known`` are the results of the first sets.

    Raises
    ------
    FailureError
        If the executor fails, as where its processes have been killed.
    """
    first = 0 if known is None else len(known.status)

    def missing() -> Iterator[tuple[Block, dict[str, Array]]]:
        for block in blocks:
            sets = sets_of(block, plan.shape)
            if sets[-1] >= first:
                yield block, plan.values(sets[sets >= first])

    if known is not None:
        sets = map(partial(sets_of, shape=plan.shape), blocks)
        yield from ((block, known[each]) for block, each in zip(blocks, sets, strict=True) if each[-1] < first)
    try:
        for block, found in run_each(partial(run_sets, job, threads=threads), missing(), executor):
            at = sets_of(block, plan.shape)
            yield block, Sets.joined([known[at[at < first]], found]) if known is not None and at[0] < first else found
    except LcpImpactError:
        raise
    except Exception as error:
        if executor is None:
            raise
        raise FailureError(
            f"the executor failed ({type(error).__name__}: {error}): with out='sweep.zarr' finished chunks are kept, and "
            "the same call resumes",
            None,
        ) from error


def run_each(
    function: Callable[[T], R], items: Iterable[tuple[K, T]], executor: Executor | None, *, max_waiting: int = 1024
) -> Iterator[tuple[K, R]]:
    """Run a function of each item, and yield the keys with the results: by an executor as they finish, else in order.

    An item is begun here when its result is asked for, and by an executor long before.

    ``max_waiting``: largest number of chunks that an executor is given at once.
    """
    if executor is None:
        yield from ((key, function(item)) for key, item in items)
        return
    waiting: dict[Future[R], K] = {}
    try:
        for key, item in items:
            waiting[executor.submit(function, item)] = key
            if len(waiting) >= max_waiting:
                yield from _finished(waiting)
        while waiting:
            yield from _finished(waiting)
    finally:
        for future in waiting:
            future.cancel()


def _finished(waiting: dict[Future[R], K]) -> list[tuple[K, R]]:
    """Wait for some futures, take them out, and return their keys and results."""
    done, _ = wait(waiting, return_when=FIRST_COMPLETED)
    return [(waiting.pop(future), future.result()) for future in done]
