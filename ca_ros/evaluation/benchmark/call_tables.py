"""The tables of times per call, in Python and in C."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pandas as pd

from ca_ros.evaluation.benchmark.loads import LOADS
from ca_ros.evaluation.tables import number, table

MARK = ' ✗'
"""Beside a time for which wrong answers were given."""

PYTHON, C = 'us', 'ns'
"""Units of the times of calls from Python and from C."""

SCALES = {PYTHON: 1e6, C: 1e9}


def times(calls: pd.DataFrame, unit: str) -> str:
    """Return the table of mean times with ratios, and of errors, of results of `summarize`."""
    cells = by_contender(calls, lambda own: (time(own, unit, f' ({number(own.ratio)}x)'),))
    faults = by_contender(calls, lambda own: (f'{own.load}: {own.faults}',) if own.faults else ())
    worst = calls.groupby('contender')[
        ['p999', 'worst', 'error', 'violation', 'norm_excess']
    ].max()
    rows = []
    for name in cells:
        slow, slowest, *errors = worst.loc[name]
        ends = [number(SCALES[unit] * value) for value in (slow, slowest)]
        ends += ['none right' if pd.isna(value) else number(value) for value in errors]
        rows.append((f'`{name}`', *cells[name], *ends, '; '.join(faults[name]) or 'nothing'))
    titles = [f'{load} [{unit}]' for load in LOADS]
    titles += [f'p99.9 [{unit}]', f'worst [{unit}]', 'wrench error', 'violation [N]']
    return table(('contender', *titles, 'norm excess [N]', 'wrong'), rows)


def percentiles(calls: pd.DataFrame, unit: str) -> list[str]:
    """Return a table of the percentiles of single calls for each load."""
    titles = [f'{name} [{unit}]' for name in ('median', 'p99', 'p99.9', 'worst', 'slowest')]
    parts = []
    for load, own in calls.groupby('load', sort=False):
        rows = []
        for each in own.itertuples():
            values = each.p50, each.p99, each.p999, each.worst, each.slowest
            ends = (number(SCALES[unit] * value) for value in values)
            rows.append((f'`{each.contender}`', *ends, spread(each, 'ratio')))
        parts.append(table((f'contender, {load}', *titles, 'x'), rows))
    return parts


def by_contender(
    results: pd.DataFrame, cells: Callable[[Any], tuple[str, ...]]
) -> dict[Any, tuple[str, ...]]:
    """Return the cells of all results of each contender."""
    return {
        name: tuple(cell for each in own.itertuples() for cell in cells(each))
        for name, own in results.groupby('contender', sort=False)
    }


def time(own: Any, unit: str, beside: str = '') -> str:
    """Return the mean time of a result, marked if answers were wrong."""
    return f'{number(SCALES[unit] * own.time)}{beside}{MARK if own.faults else ""}'


def spread(own: Any, name: str) -> str:
    """Return the interquartile range of a result."""
    low, high = (getattr(own, f'{name}_{end}') for end in ('low', 'high'))
    return f'{number(low)} to {number(high)}'
