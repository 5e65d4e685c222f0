"""The tables of benchmark.md; its words are in ``templates/benchmark.md``."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import pandas as pd

from ca_ros.evaluation.benchmark.contenders import BASELINE
from ca_ros.evaluation.benchmark.measurements import UNIT
from ca_ros.evaluation.benchmark.setups import ROTORS, SETUPS
from ca_ros.evaluation.environment import STALL
from ca_ros.evaluation.judge import WRONG
from ca_ros.evaluation.tables import number, render, table

MARK = ' ✗'
"""Beside a time for which wrong answers were given."""

ERRORS = {
    'error': 'wrench error',
    'violation': 'violation [N]',
    'norm_excess': 'norm excess [N]',
}
PERCENTILES = {'p50': 'median', 'p99': 'p99', 'p999': 'p99.9', 'worst': 'worst'}
"""Titles of columns of the results."""


def document(found: Mapping[str, Any]) -> str:
    """Return benchmark.md for a run as in benchmark.json."""
    results = pd.DataFrame(found['results'])
    results['mark'] = results['faults'].map(lambda faults: MARK if faults else '')
    parts = dict(iter(results.groupby('part', sort=False)))
    loop = parts['closed loop'].set_index('contender') if 'closed loop' in parts else None
    return render(
        'benchmark.md',
        **found,
        parts=parts,
        flown=None if loop is None else loop.loc['exact'],
        unit=None if loop is None else loop.loc[BASELINE],
        constants={'unit': UNIT, 'rotors': ROTORS, 'stall': STALL, 'wrong': WRONG},
        times=times,
        percentiles=percentiles,
        growth=growth,
        changes=changes,
        batches=batches,
        spread=spread,
    )


def times(calls: pd.DataFrame, unit: str, scale: float) -> str:
    """Return the table of mean times with ratios, and of errors, of results of `summarize`."""

    def cell(own: Any) -> str:
        return f'{number(scale * own.time)} ({number(own.ratio)}x){own.mark}'

    cells, own = wide(calls, cell).add_suffix(f' [{unit}]'), calls.groupby('contender')
    for name in ('p999', 'worst'):
        cells[f'{PERCENTILES[name]} [{unit}]'] = (scale * own[name].max()).map(number)
    for name, title in ERRORS.items():
        cells[title] = own[name].max().map(number, na_action='ignore').fillna('none right')
    faulty = calls[calls['faults'] != '']
    faults = (faulty['load'] + ': ' + faulty['faults']).groupby(faulty['contender']).agg('; '.join)
    return framed('contender', cells.assign(wrong=faults).fillna({'wrong': 'nothing'}))


def percentiles(calls: pd.DataFrame, unit: str, scale: float) -> str:
    """Return a table of the percentiles of single calls for each load."""
    tables = []
    for load, part in calls.groupby('load', sort=False):
        own = part.set_index('contender')
        titles = {**PERCENTILES, 'slowest': 'slowest'}
        cells = {f'{title} [{unit}]': scale * own[name] for name, title in titles.items()}
        cells = {title: values.map(number) for title, values in cells.items()}
        cells['x'] = own.apply(spread, axis=1)
        tables.append(framed(f'contender, {load}', pd.DataFrame(cells)))
    return '\n\n'.join(tables)


def growth(results: pd.DataFrame) -> str:
    """Return a table of the times by number of rotors for each load."""
    return '\n\n'.join(
        framed(
            f'{load} [us], rotors',
            wide(part, lambda own: f'{number(1e6 * own.time)}{own.mark}', 'rotors'),
        )
        for load, part in results.groupby('load', sort=False)
    )


def changes(results: pd.DataFrame) -> str:
    """Return the table of the set-ups of `exact`."""
    cells = wide(results, lambda own: number(1e3 * own.time)).add_suffix(' [ms]')
    rows = zip((SETUPS[name][0] for name in cells.index), *cells.to_numpy().T, strict=True)
    return table(('', *cells), list(rows))


def batches(results: pd.DataFrame) -> str:
    """Return the table of batches."""
    rows = []
    for own in results.itertuples():
        load = f'batches of {own.load}' if own.load[0].isdecimal() else own.load
        words = f'`{own.contender}`, {load}'
        rows.append((words, number(1e6 * own.time), f'{1.0 / own.time:,.0f}'))
    return table(('uniform wrenches', 'us per wrench', 'wrenches per second'), rows)


def spread(own: Any, name: str = 'ratio') -> str:
    """Return the interquartile range of a result."""
    return f'{number(own[f"{name}_low"])} to {number(own[f"{name}_high"])}'


def wide(results: pd.DataFrame, cell: Callable[[Any], str], column: str = 'load') -> pd.DataFrame:
    """Return cells with a row for each contender and a column for each load."""
    cells = results.assign(cell=[cell(own) for own in results.itertuples()])
    made = cells.pivot(index='contender', columns=column, values='cell')
    return made.reindex(index=cells['contender'].unique(), columns=cells[column].unique())


def framed(title: str, cells: pd.DataFrame) -> str:
    """Return a table of cells by contender."""
    rows = ((f'`{name}`', *row) for name, row in zip(cells.index, cells.to_numpy(), strict=True))
    return table((title, *map(str, cells)), list(rows))
