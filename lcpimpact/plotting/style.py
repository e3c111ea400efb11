"""The common style of the plots, and their output."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from io import StringIO
from pathlib import Path
from typing import Any, TypedDict

import matplotlib
from cycler import cycler
from matplotlib.figure import Figure
from matplotlib.typing import ColorType, LineStyleType

from lcpimpact.arguments import checked
from lcpimpact.files import check_output, whole_file

INK = "#1c2430"
GREY = "#6b7685"
LIGHT_GREY = "#eef1f5"

CURVE_POINTS = 2000
"""Number of points of a smooth curve, above the resolution of a page."""

PALETTE = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000")
"""Okabe and Ito's colour-blind-safe colours, without yellow, which is too pale for lines."""

EXACT, LCP, RK4 = "#b9c6d6", PALETTE[0], PALETTE[1]
"""Colours of the three solutions of a system: exact (wide and light), LCP (markers), RK4 (thin and dotted)."""

METADATA: dict[str, dict[str, str | None]] = {
    ".png": {"Software": None},
    ".svg": {"Date": None, "Creator": None},
    ".pdf": {"CreationDate": None, "Creator": None, "Producer": None},
}
"""File metadata by format, cleared so that files do not depend on date and machine."""

PLACES = re.compile(r'(\b[dxy]="|translate\()([^")]*)(["\)])')
LONG_NUMBER = re.compile(r"-?\d+\.\d{3,}")
INDENT = re.compile(r"\n\s+")
COMMAND = re.compile(r"\s*([A-Za-z])\s*")
"""In the text of an SVG file: coordinates, numbers of three digits and more behind the point, indents, letters of a path."""

RC = {
    "axes.axisbelow": True,
    "axes.edgecolor": INK,
    "axes.grid": True,
    "axes.labelcolor": INK,
    "axes.linewidth": 0.8,
    "axes.prop_cycle": cycler(linestyle=["-", "--", ":"]) * cycler(color=PALETTE),
    "axes.spines.right": False,
    "axes.spines.top": False,
    "axes.titlelocation": "left",
    "axes.titlesize": 10.0,
    "figure.dpi": 100.0,
    "figure.facecolor": "white",
    "font.family": ["STIXGeneral", "serif"],
    "font.serif": ["Times New Roman", "Times", "DejaVu Serif"],
    "font.size": 10.0,
    "grid.color": "#dfe4ea",
    "grid.linewidth": 0.7,
    "legend.fontsize": 9.0,
    "legend.edgecolor": "none",
    "legend.framealpha": 1.0,
    "lines.linewidth": 1.4,
    "mathtext.fontset": "stix",
    "savefig.bbox": "standard",
    "savefig.dpi": 200.0,
    # Letters as outlines, so that a report looks the same where the font is missing.
    "svg.fonttype": "path",
    "svg.hashsalt": "lcpimpact",
    "text.color": INK,
    "xtick.color": INK,
    "xtick.direction": "in",
    "ytick.color": INK,
    "ytick.direction": "in",
    "ytick.major.pad": 6.5,
}


@contextmanager
def style() -> Iterator[tuple[str, ...]]:
    """Draw in lcpimpact's style, whatever the user's matplotlibrc says, and restore the settings at the end.

    Yields
    ------
    tuple of str
        The colours of the lines, safe for colour-blind readers (Okabe and Ito).

    Examples
    --------
    >>> with style() as palette:
    ...     figure = Drawing(figsize=(7.0, 3.0), layout="constrained")
    ...     lines = figure.subplots().plot([0.0, 1.0], [1.0, 0.0], color=palette[0])
    >>> palette[0]
    '#0072b2'
    """
    # The keys are literals to a type checker in some versions of matplotlib, and strings in others.
    ours: dict[Any, Any] = {
        key: value for key, value in matplotlib.rcParamsDefault.items() if not key.startswith("backend")
    }
    with matplotlib.rc_context(ours | RC):
        yield PALETTE


class Look(TypedDict, total=False):
    """Properties of lines, markers, areas and texts, by their names in Matplotlib."""

    alpha: float
    color: ColorType
    edgecolor: str
    facecolor: str
    fontsize: float
    hatch: str
    label: str
    linestyle: LineStyleType
    linewidth: float
    marker: str
    markerfacecolor: str
    markersize: float
    textcoords: str
    zorder: float


class Drawing(Figure):
    """A figure of Matplotlib that notebooks show without any magic command; the same drawing always gives the same file.

    Examples
    --------
    >>> drawing = Drawing(figsize=(7.0, 3.0), layout="constrained")
    >>> lines = drawing.subplots().plot([0.0, 1.0], [1.0, 0.0])
    """

    def _repr_svg_(self) -> str:
        return svg_text(self)

    def save(self, path: str | Path) -> Path:
        """Write to a file ending in .png, .svg or .pdf, whole or not at all.

        Raises
        ------
        InputError
            For another ending, or a folder that cannot be written.
        """
        return save(self, path)


def svg_text(figure: Figure) -> str:
    """Return a figure as the text of an SVG file; the same figure always gives the same text.

    Coordinates are rounded to a hundredth of a point, and indents and the spaces around the letters of a path are left out,
    so that files are smaller.
    """
    with style(), StringIO() as text:
        figure.savefig(text, format="svg", metadata=METADATA[".svg"])
        return INDENT.sub("\n", PLACES.sub(_shortened, text.getvalue()))


def _shortened(places: re.Match[str]) -> str:
    name, value, end = places.groups()
    value = LONG_NUMBER.sub(_rounded, value)
    return name + (COMMAND.sub(r"\1", value) if name == 'd="' else value) + end


def _rounded(number: re.Match[str]) -> str:
    return f"{float(number[0]):.2f}".rstrip("0").rstrip(".")


@checked
def save(figure: Figure, path: str | Path) -> Path:
    """Write a figure to a file ending in .png, .svg or .pdf.

    The write is atomic, and the same figure always gives the same bytes.

    Raises
    ------
    InputError
        For another ending, or a folder that cannot be written.
    """
    path = Path(path)
    check_output(path, METADATA)
    with style(), whole_file(path) as part:
        if path.suffix == ".svg":
            part.write_text(svg_text(figure), encoding="utf-8")
        else:
            figure.savefig(part, metadata=METADATA[path.suffix])
    return path
