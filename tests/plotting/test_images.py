"""The pictures of the documentation are small, and SVG files hold no more digits than a page shows."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from lcpimpact.plotting.style import Drawing, svg_text

IMAGES = Path(__file__).parents[2] / "docs" / "images"
MAX_SIZE = 150_000
MAX_MOVING = 450_000


@pytest.mark.parametrize("picture", sorted(IMAGES.glob("*.*")), ids=lambda path: path.name)
def test_a_picture_of_the_documentation_is_small(picture: Path) -> None:
    assert picture.stat().st_size <= (MAX_MOVING if picture.suffix == ".gif" else MAX_SIZE)


def test_coordinates_in_an_svg_file_are_rounded_to_a_hundredth_of_a_point() -> None:
    figure = Drawing(figsize=(2.0, 1.0))
    ax = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    x = np.linspace(0.0, 1.0, 7)
    ax.plot(x, x, gid="line")
    ax.set(xlim=(0.0, 1.0), ylim=(0.0, 1.0))
    (path,) = re.findall(r'<g id="line">\s*<path d="([^"]*)"', svg_text(figure))
    found = np.array([pair.split() for pair in re.findall(r"[ML]([-\d. ]+)", path)], dtype=float)
    # Matplotlib leaves out points on a straight line, so its ends are compared.
    np.testing.assert_allclose(found[[0, -1]], [[0.0, 72.0], [144.0, 0.0]], rtol=0.0, atol=1e-2)
    assert not re.search(r"\.\d{3}", path)
