"""What a command says on standard error is its own: no line of progress falls due on a machine that is slow."""

import math

import pytest


@pytest.fixture(autouse=True)
def no_lines_of_progress(monkeypatch):
    monkeypatch.setattr("lcpimpact.logs.SECONDS_A_LINE", math.inf)
