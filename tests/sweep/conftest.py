"""What the tests of sweeps share."""

from __future__ import annotations

import pytest

from lcpimpact.sweeps import chunks
from lcpimpact.sweeps.sets import run_sets


@pytest.fixture
def counted(monkeypatch):
    """Numbers of sets that were run, chunk by chunk."""
    runs = []

    def counting(job, values, threads=1):
        runs.append(len(next(iter(values.values()))))
        return run_sets(job, values, threads)

    monkeypatch.setattr(chunks, "run_sets", counting)
    return runs
