"""The elements that rheological schemes are built from, by name: the lines of ``registry.pyi``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from lcpimpact.exports import exports
from lcpimpact.registry import Registry

if TYPE_CHECKING:
    from lcpimpact.scheme.elements.base import Element

ELEMENTS: Registry[type[Element]] = Registry("element", exports(Path(__file__).with_name("registry.pyi")))
