"""The look of the methods, titles and legends in all plots of the studies."""

from __future__ import annotations

from collections.abc import Sequence
from math import ceil
from textwrap import wrap
from typing import Any

from matplotlib.figure import Figure, SubFigure

from ca_ros.evaluation.cases import PAPER
from ca_ros.flight.plots import COLORS

STYLES: dict[str, tuple[str, Any, float]] = {
    'exact': (COLORS[5], '-', 5.0),
    'pseudo_inverse': (COLORS[1], (0, (6, 2)), 3.0),
    'conventional': (COLORS[2], '-', 1.6),
    'direct': ('black', (0, (1, 1.5)), 1.0),
    'weighted_pseudo_inverse': ('#777777', (0, (2, 4)), 1.4),
    'redistributed_pseudo_inverse': ('#7b3294', '-', 1.4),
    'weighted_least_squares': (COLORS[0], '-', 1.4),
    'sequential_desaturation': (COLORS[3], '-', 1.4),
    'betaflight_mixer': (COLORS[4], '-', 1.4),
}
"""Colour, dashes, and the width where curves coincide: each narrower than those below it."""

OTHERS = [
    (color, dashes, 1.4)
    for dashes in ((0, (6, 1, 1, 1)), (0, (3, 1, 1, 1, 1, 1)), (0, (1, 3)))
    for color in (COLORS[3], COLORS[4], COLORS[0])
]

DASH = 1.8
"""Length of the dashes that take turns, in widths of the line."""


def styles(methods: Sequence[str], coinciding: bool = False) -> dict[str, dict[str, Any]]:
    """Return the line properties of each method's curve.

    Where curves coincide, those of the paper's methods become narrower one after the other, and
    the dashes of the others take turns.
    """
    others = [method for method in methods if method not in STYLES]
    turns = [method for method in methods if method not in PAPER]
    found = {}
    for method in methods:
        known = STYLES.get(method) or OTHERS[others.index(method) % len(OTHERS)]
        color, dashes, width = known
        if not coinciding:
            width = 3.0 if method == 'exact' else 1.4
        elif method == 'pseudo_inverse':
            dashes = '-'
        elif method in turns and len(turns) > 1:
            dashes = (DASH * turns.index(method), (DASH, DASH * (len(turns) - 1)))
        found[method] = {'color': color, 'linestyle': dashes, 'linewidth': width}
    return found


def title(method: str, width: int = 100) -> str:
    """Return a method's name in words, in lines of at most `width` letters.

    The name of a user's own method is that of its class.
    """
    return '\n'.join(wrap(method.rpartition(':')[2].replace('_', ' '), width))


def sheet(
    width: float, height: float, entries: int, columns: int | None = None
) -> tuple[Figure, SubFigure, SubFigure]:
    """Return a figure, the strip for its legend at the top, and the part below it [inch]."""
    strip = 0.25 * ceil(entries / (columns or _columns(entries)))
    figure = Figure(figsize=(width, height + strip), layout='constrained')
    parts: Any = figure.subfigures(2, 1, height_ratios=(strip, height))
    return figure, *parts


def legend(head: SubFigure, handles: Sequence[Any], columns: int | None = None) -> None:
    """Put a legend into its strip."""
    head.legend(handles=handles, loc='center', ncols=columns or _columns(len(handles)))


def _columns(entries: int) -> int:
    return entries if entries <= 4 else 3
