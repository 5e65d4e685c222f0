"""How the methods look in all plots of the studies."""

from __future__ import annotations

from collections.abc import Sequence
from math import ceil
from typing import Any

from matplotlib.figure import Figure, SubFigure

from ca_ros.flight.plots import COLORS

STYLES: dict[str, dict[str, Any]] = {
    'exact': {'color': COLORS[5], 'linestyle': '-'},
    'pseudo_inverse': {'color': COLORS[1], 'linestyle': (0, (6, 2))},
    'conventional': {'color': COLORS[2], 'linestyle': '-'},
    'direct': {'color': 'black', 'linestyle': (0, (1, 1.5))},
}
OTHERS = [
    {'color': color, 'linestyle': dashes}
    for dashes in ((0, (6, 1, 1, 1)), (0, (3, 1, 1, 1, 1, 1)), (0, (1, 3)))
    for color in (COLORS[3], COLORS[4], COLORS[0])
]
WIDTHS = {'exact': 5.0, 'pseudo_inverse': 3.0, 'conventional': 1.6, 'direct': 1.0}


def styles(methods: Sequence[str]) -> dict[str, dict[str, Any]]:
    """Return how to draw the curve of each method."""
    others = [method for method in methods if method not in STYLES]
    found = {}
    for method in methods:
        look = STYLES.get(method) or OTHERS[others.index(method) % len(OTHERS)]
        found[method] = {**look, 'linewidth': 3.0 if method == 'exact' else 1.4}
    return found


def coinciding(methods: Sequence[str]) -> dict[str, dict[str, Any]]:
    """Return the same for curves that lie on each other: each narrower than those below it."""
    looks = styles(methods)
    for method, width in WIDTHS.items():
        if method in looks:
            looks[method]['linewidth'] = width
    if 'pseudo_inverse' in looks:
        looks['pseudo_inverse']['linestyle'] = '-'
    return looks


def title(method: str) -> str:
    """Return a method's name in words; a user's own goes by its class."""
    return method.rpartition(':')[2].replace('_', ' ')


def sheet(
    width: float, height: float, entries: int, columns: int | None = None
) -> tuple[Figure, SubFigure, SubFigure]:
    """Return a figure, its strip for a legend above everything, and what is below [inch]."""
    strip = 0.25 * ceil(entries / (columns or _columns(entries)))
    figure = Figure(figsize=(width, height + strip), layout='constrained')
    parts: Any = figure.subfigures(2, 1, height_ratios=(strip, height))
    return figure, *parts


def legend(head: SubFigure, handles: Sequence[Any], columns: int | None = None) -> None:
    """Put a legend into its strip."""
    head.legend(handles=handles, loc='center', ncols=columns or _columns(len(handles)))


def _columns(entries: int) -> int:
    return entries if entries <= 4 else 3
