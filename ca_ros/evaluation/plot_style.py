"""The look and the titles of the methods in all plots of the studies."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from textwrap import wrap
from typing import Any

from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from ca_ros.arrays import Array
from ca_ros.evaluation.cases import PAPER
from ca_ros.figures import COLORS, DASHED

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
    (color, dashes, 1.4) for dashes in ((0, (6, 1, 1, 1)), (0, (3, 1, 1, 1, 1, 1)), (0, (1, 3)))
    for color in (COLORS[3], COLORS[4], COLORS[0])
]

FAILED: dict[str, Any] = {'color': 'black', 'linestyle': ':', 'linewidth': 0.8}
"""The style of the moments of failures."""

DASH = 1.8  # length of the dashes that take turns, in widths of the line


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


def entries(looks: Mapping[str, Mapping[str, Any]]) -> list[Line2D]:
    """Return the lines of a legend, from line properties by their labels."""
    return [Line2D([], [], label=label, **look) for label, look in looks.items()]


def entries_of(methods: Sequence[str], coinciding: bool = False) -> list[Line2D]:
    """Return the lines of a legend of methods, see `styles`."""
    looks = styles(methods, coinciding)
    return entries({title(method): look for method, look in looks.items()})


def failing(
    axes: Axes, time: Array, values: Array, moments: Sequence[float], **look: Any
) -> None:
    """Draw values over time [s]; zero is dashed, and the moments of failures are dotted."""
    axes.plot(time, values, color='black')
    axes.axhline(0.0, **DASHED)
    for moment in moments:
        axes.axvline(moment, **{**FAILED, **look})
