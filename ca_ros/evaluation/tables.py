"""Tables and numbers in Markdown."""

from __future__ import annotations

from collections.abc import Sequence


def table(titles: Sequence[str], rows: Sequence[Sequence[str]], words: int = 1) -> str:
    """Return a table; all but the first columns, which hold words, are aligned to the right."""
    rule = ['---'] * words + ['---:'] * (len(titles) - words)
    return '\n'.join('| ' + ' | '.join(row) + ' |' for row in (titles, rule, *rows))


def number(value: float) -> str:
    """Return a number with three digits."""
    if value == 0.0 or abs(value) >= 1000.0:
        return f'{value:.0f}'
    if abs(value) < 1e-2:
        return f'{value:.0e}'
    return f'{value:.3g}'


def microseconds(seconds: float) -> str:
    """Return a time in microseconds."""
    return number(1e6 * seconds)
