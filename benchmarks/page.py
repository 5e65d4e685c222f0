"""The page of a benchmark."""

from collections.abc import Callable, Mapping
from typing import Any

import pandas as pd

from benchmarks.answers import WRONG
from benchmarks.limits import limits, node_ratio
from benchmarks.parts import SETS
from benchmarks.sizes import Sizes
from ca_ros.studies.tables import number, table

PICTURE = '![Times per call, from Python and in C; hollow: wrong answers](results.png)'
PARTS = {
    'rotors': 'Number of rotors: microseconds per call',
    'batches': 'Batches: microseconds per wrench, on one core unless two are named',
    'unattainable': 'Wrenches up to twice as far as the boundary: microseconds per call',
    'set-up': 'Audit and set-up of 16 rotors, each time after another failure: microseconds',
}


def page(rows: pd.DataFrame, results: pd.DataFrame, sizes: Sizes, about: Mapping[str, Any]) -> str:
    """Return the page for the rows of a run, their summary, and facts by title."""
    parts = {part: results.loc[part] for part in results.index.unique('part')}
    chapters = {'': f'How it is measured: benchmarks/README.md\n\n{PICTURE}'}
    if about['paper']:
        chapters['Limits'] = limits(rows, results, sizes)
    chapters['Times per call'] = _calls(parts['calls'], 'us', 1e6)
    if 'C' in parts:
        chapters['In C'] = _calls(parts['C'], 'ns', 1e9)
        chapters['In C: median / 99.9th percentile'] = _singles(parts['C'])
    sets = ''.join(f'- *{name}*: {words}\n' for name, words in SETS.items())
    words = 'In brackets: relative to the clipped pseudo-inverse. ✗: wrong answers, by more'
    missed = f'than {WRONG:g} in wrench, bounds or least norm.'
    chapters['Times per call'] += f'\n\n{words} {missed}\n\n{sets}'.rstrip()
    for part in [part for part in PARTS if part in parts]:
        rotors = part == 'rotors'
        index = ['contender', 'wrenches'] if rotors else ['contender']
        cells = _wide(parts[part], index, 'rotors' if rotors else 'wrenches', _time)
        names = [f'`{name[0]}`, {name[1]}' if rotors else f'`{name}`' for name in cells.index]
        lines = [[name, *row[1:]] for name, row in zip(names, cells.itertuples(), strict=True)]
        titles = [f'{own:g}' if rotors else str(own) for own in cells]
        chapters[PARTS[part]] = table(('', *titles), lines)
    chapters['The node beside an echo node'] = _node(rows) or 'Not measured.'
    facts = [f'- {title}: {words}' for title, words in about['facts'].items()]
    chapters['Made with'] = '\n'.join(facts)
    texts = [f'## {title}\n\n{text}' if title else text for title, text in chapters.items()]
    return '\n\n'.join(['# Benchmark', *texts]) + '\n'


def _calls(results: pd.DataFrame, unit: str, scale: float) -> str:
    """Return the table of mean times with ratios, and of the worst calls and errors."""

    def cell(own: Any) -> str:
        mark = ' ✗' if own.faults else ''
        return f'{number(scale * own.time)} ({number(own.ratio)}x){mark}'

    cells = _wide(results, ['contender'], 'wrenches', cell).add_suffix(f' [{unit}]')
    own = results.groupby('contender', sort=False)
    for name in ('p50', 'p99', 'p999', 'worst'):
        cells[f'{name}, at most [{unit}]'] = (scale * own[name].max()).map(number)
    for name in ('error', 'violation', 'norm_excess'):
        cells[name.replace('_', ' ')] = own[name].max().map(number, na_action='ignore')
    wrong = results[results['faults'] != ''].reset_index('wrenches')
    wrong = wrong['wrenches'] + ': ' + wrong['faults']
    cells['wrong'] = wrong.groupby('contender').agg('; '.join)
    lines = [[f'`{name}`', *row] for name, *row in cells.fillna('').itertuples()]
    return table(('contender', *cells), lines)


def _singles(results: pd.DataFrame) -> str:
    """Return the table of the percentiles of single calls by kind of wrenches."""

    def cell(own: Any) -> str:
        return f'{number(1e9 * own.p50)} / {number(1e9 * own.p999)}'

    cells = _wide(results, ['contender'], 'wrenches', cell).add_suffix(' [ns]')
    return table(('', *cells), [[f'`{name}`', *row] for name, *row in cells.itertuples()])


def _wide(
    results: pd.DataFrame, rows: list[str], column: str, cell: Callable[[Any], str]
) -> pd.DataFrame:
    """Return cells with a row for each contender, and a column for each value of an index."""
    made = pd.Series([cell(own) for own in results.itertuples()], results.index)
    made = made.groupby([*rows, column], sort=False).first().unstack(column, sort=False)
    return made.fillna('')


def _time(own: Any) -> str:
    return number(1e6 * own.time) + (' ✗' if own.faults else '')


def _node(rows: pd.DataFrame) -> str:
    """Return the table of the nodes, '' if they were not measured."""
    nodes = rows[rows['part'] == 'node']
    lines = []
    for (rate, kind), own in nodes.groupby(['wrenches', 'contender'], sort=False):
        times = [number(1e6 * own[name].median()) for name in ('p50', 'p99')]
        ratios = [number(node_ratio(rows, rate, name) or 0.0) for name in ('p50', 'p99')]
        late = f'{own["late"].sum():.0f} of {own["sent"].sum():.0f}'
        over = ' / '.join(ratios) if kind == 'allocator' else ''
        lines.append((f'{rate}, {kind}', *times, late, over))
    titles = ('', 'p50 [us]', 'p99 [us]', 'late', 'p50 / p99 over echo')
    return table(titles, lines) if lines else ''
