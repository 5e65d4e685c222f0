"""The look and the titles of the methods in all plots of the studies."""

from collections.abc import Mapping, Sequence
from string import ascii_lowercase
from textwrap import wrap
from typing import Any

from matplotlib.lines import Line2D

from ca_ros.figures import COLORS, inches, letters

STYLES: dict[str, tuple[str, Any, float]] = {
    'exact': (COLORS[5], '-', 5.0),
    'pseudo_inverse': (COLORS[1], (0, (6, 2)), 3.0),
    'conventional': (COLORS[2], '-', 1.6),
    'direct': ('black', '-', 1.0),
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

PANELS_MAX = 6
"""Greatest number of panels that show methods beside each other."""


def styles(methods: Sequence[str], coinciding: bool = False) -> dict[str, dict[str, Any]]:
    """Return the line properties of each method's curve.

    Where curves coincide, those below are wider.
    """
    others = [method for method in methods if method not in STYLES]
    found = {}
    for method in methods:
        known = STYLES.get(method) or OTHERS[others.index(method) % len(OTHERS)]
        color, dashes, width = known
        if not coinciding:
            width = 3.0 if method == 'exact' else 1.4
        found[method] = {'color': color, 'linestyle': dashes, 'linewidth': width}
    return found


PROPER = {'betaflight': 'Betaflight', 'daqp': 'DAQP', 'osqp': 'OSQP'}
"""Names of software among the words of methods."""


def title(method: str, width: int = 100) -> str:
    """Return a method's name in words, in lines of at most `width` letters.

    The name of a user's own method is that of its class.
    """
    words = method.rpartition(':')[2].split('_')
    return '\n'.join(wrap(' '.join(PROPER.get(word, word) for word in words), width))


def entries(looks: Mapping[str, Mapping[str, Any]]) -> list[Line2D]:
    """Return the lines of a legend, from line properties by their labels."""
    return [Line2D([], [], label=label, **look) for label, look in looks.items()]


def entries_of(groups: Sequence[Sequence[str]], coinciding: bool = False) -> list[Line2D]:
    """Return the lines of a legend of groups of methods, each with the style of its first."""
    looks = styles([names[0] for names in groups], coinciding)
    width = letters(inches()) - 8
    return entries({listed(names, width): looks[names[0]] for names in groups})


def listed(names: Sequence[str], width: int) -> str:
    """Return the titles of methods in lines of at most `width` letters."""
    return '\n'.join(wrap(', '.join(map(title, names)), width))


def panel_titles(groups: Sequence[Sequence[str]], width: float) -> tuple[list[str], list[str]]:
    """Return titles of panels of a width [inch] that show groups of methods, and notes.

    Titles of more than two lines become letters, which the notes explain; the notes name the
    groups beyond `PANELS_MAX`.
    """
    shown, notes = groups[:PANELS_MAX], []
    titles = [listed(names, letters(width)) for names in shown]
    if any(words.count('\n') > 1 or len(words) > 2 * letters(width) for words in titles):
        titles = list(ascii_lowercase[: len(shown)])
        words = [listed(names, 10_000) for names in shown]
        notes = [f'{letter}: {group}' for letter, group in zip(titles, words, strict=True)]
    if len(groups) > PANELS_MAX:
        left = [name for names in groups[PANELS_MAX:] for name in names]
        notes.append(f'not drawn: {listed(left, 10_000)}')
    return titles, notes
