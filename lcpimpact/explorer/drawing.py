"""Places at which a page draws the nodes and the elements of a scheme."""

from __future__ import annotations

from collections.abc import Sequence

from lcpimpact.files import Json
from lcpimpact.plotting.layout import CEILING, Layout, label, sums
from lcpimpact.scheme.elements.base import GROUND, Element


def drawing(
    elements: Sequence[Element], coordinates: Sequence[str]
) -> tuple[list[Sequence[Json]], list[Sequence[Json]]]:
    """Return the places at which a page draws the nodes and the links of a scheme, by numbers of three decimals.

    Nodes
        What moves it: indices and coefficients of coordinates, none for the ground; y, left, right; half of its height;
        label; name.
    Links
        Its strokes; edge and what moves it above, and below; x, leads and length of the symbol; split; whether its first
        end is above; side of the label; label; name of the reaction.
    """
    layout, combined = Layout(tuple(elements)), sums(elements)
    index = {node: i for i, node in enumerate(coordinates)}

    def moved_by(node: str) -> list[list[float]]:
        return [[index[each], c] for each, c in combined.get(node, {node: 1.0}).items() if each in index]

    y, bars = layout.y, layout.inner_bars
    nodes: list[Sequence[Json]] = []
    for node in y:
        left, right = bars[node] if node in bars else layout.span(node)
        half = layout.edge(y, node, 1) - y[node] if node in layout.nodes and layout.bodies(node) else 0.0
        text = " + ".join(map(label, layout.bodies(node))) if node in layout.nodes else ""
        name = "" if node in (GROUND, CEILING) else node
        nodes.append([moved_by(node), *map(rounded, (y[node], left, right, half)), text, name])
    links: list[Sequence[Json]] = []
    for link in layout.links:
        part = link.part
        strokes = [[[rounded(s), rounded(t)] for s, t in stroke] for stroke in part.strokes]
        upper: Sequence[Json] = [rounded(layout.edge(y, link.top, -1)), moved_by(link.top)]
        lower: Sequence[Json] = [rounded(layout.edge(y, link.bottom, 1)), moved_by(link.bottom)]
        numbers = [rounded(each) for each in (link.x, *link.leads, link.body)]
        reaction = getattr(part, "name", None) or part.reaction
        links.append([strokes, upper, lower, numbers, part.split, link.down, link.side, label(part), reaction])
    return nodes, links


def rounded(value: float) -> float:
    """Return a number of three decimals."""
    return round(float(value), 3)
