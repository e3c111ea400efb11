"""The registry of suites."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lcpimpact.registry import Registry

if TYPE_CHECKING:
    from lcpimpact.validation.case import Suite

SUITES: Registry[Suite] = Registry(
    "suite",
    {
        "code-aster": "lcpimpact.validation.code_aster:SUITE",
        "arch": "lcpimpact.validation.arch:SUITE",
        "modelica": "lcpimpact.validation.modelica:SUITE",
        "engines": "lcpimpact.validation.engines:SUITE",
        "papers": "lcpimpact.validation.papers:SUITE",
    },
)
"""The suites by name, in the order of their tables."""
