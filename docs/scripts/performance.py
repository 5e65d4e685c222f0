"""Fill docs/performance.md, and figures of other pages, from the last `make benchmark`."""

import argparse
from pathlib import Path

import pandas as pd
from pages import fill, put

from benchmarks.contenders import BASELINE
from benchmarks.limits import limits
from benchmarks.parts import SETS, SIDES
from benchmarks.sizes import FULL
from benchmarks.timing import summarize
from ca_ros.studies.tables import number, table

PEERS = ('clipped_pinv', 'exact', 'daqp_reused', 'quadprog', 'osqp')
PAPER = ('conventional', 'direct')
IN_C = ('clipped_pinv', 'exact', 'daqp_reused', 'daqp_hierarchical', 'osqp')


def between(times: pd.Series, words: str = ' to ') -> str:
    """Return the least and the greatest of some times in words [us]."""
    return f'{times.min():.2g}{words}{times.max():.2g}'


def main() -> None:
    """Fill the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    results = Path(__file__).parents[2] / 'benchmarks' / 'results.csv'
    parser.add_argument('file', nargs='?', type=Path, default=results)
    rows = pd.read_csv(parser.parse_args().file)
    found = summarize(rows[rows['part'] != 'node'], BASELINE)

    def cell(part: str, kind: str, name: str) -> str:
        key = part, kind, name, 6
        if key not in found.index:
            return ''
        own, scale = found.loc[key], 1e9 if part == 'C' else 1e6
        return f'{number(scale * own.time)} ({number(own.ratio)}x){" ✗" if own.faults else ""}'

    def single(kind: str, name: str) -> str:
        own = found.loc['C', kind, name, 6]
        return f'{number(1e9 * own.p50)} / {number(1e9 * own.p999)}'

    calls = found.loc['calls'].groupby('contender')[['worst', 'error']].max()
    python = [
        (f'`{name}`', *(cell('calls', kind, name) for kind in SETS),
         number(1e6 * calls.loc[name, 'worst']), number(calls.loc[name, 'error']))
        for name in PEERS if name in calls.index
    ]  # fmt: skip
    present = [name for name in IN_C if ('C', 'on', name, 6) in found.index]
    in_c = [
        (f'`{name}`', cell('C', 'uniform', name), cell('C', 'flight', name),
         *(single(side, name) for side in SIDES))
        for name in present
    ]  # fmt: skip
    sizes = [4, 8, 16, 32]
    kinds = 'flight', 'boundary'
    rotors = [
        (f'`{name}`', *(' / '.join(
            number(1e6 * found.loc['rotors', kind, name, n].time) for kind in kinds)
            for n in sizes))
        for name in ('exact', 'daqp_reused')
    ]  # fmt: skip
    batches = found.loc['batches'].xs('exact', level='contender')['time'] * 1e6
    others = [(f'a batch of {name.replace(" ", " ")}, a wrench [µs]', number(time))
              for (name, _), time in batches.items() if name.startswith('1000000')]
    for axes in ('4 axes', '6 axes'):
        time = 1e3 * found.loc['set-up', axes, 'exact', 16].time
        others.append((f'audit and set-up, 16 rotors, {axes} [ms]', number(time)))
    nodes = rows[rows['part'] == 'node'].groupby(['wrenches', 'contender'], sort=False)
    for (rate, name), own in nodes[['p50', 'p99']].median().mul(1e6).iterrows():
        words = {'allocator': 'allocator node', 'echo': 'echo in plain rclpy'}[name]
        others.append((f'{words}, {rate}, p50 / p99 [µs]',
                       f'{number(own["p50"])} / {number(own["p99"])}'))
    missed = [
        [part.strip() for part in line.strip('|').split('|')][:3]
        for line in limits(rows, found, FULL).splitlines() if '**missed**' in line
    ]
    far = 1e6 * found.loc['unattainable']['time']
    ours, daqp = (
        between(far.xs(name, level='contender')) for name in ('exact', 'daqp_hierarchical'))
    fast = between(
        1e6 * found.loc['calls'].xs('exact', level='contender')['time'], '\N{EN DASH}')
    ours_in_c, inverse = (
        f'{1e6 * found.loc["C", "uniform", name, 6].time:.2f}' for name in IN_C[1::-1])
    papers = (f'{found.loc["calls", "uniform", name, 6].ratio:.0f}' for name in PAPER)
    for name, before, after, figure in (
        ('../README.md', '**Fast.** ', ' µs from Python', fast),
        ('../README.md', 'from Python, ', ' µs in C', ours_in_c),
        ('../README.md', 'in C takes ', ' µs', inverse),
        ('../README.md', "DAQP's hierarchy (", ' µs a call)', daqp),
        ('../README.md', '`exact` (', ' µs) in', ours),
        ('performance.md', 'unattainable wrenches in ', ' µs each', daqp),
        ('performance.md', 'each, where `exact` takes ', ' µs', ours),
        ('performance.md', 'SciPy, take ', ' times as long', ' and '.join(papers)),
        ('comparison.md', 'unattainable wrenches, in ', ' µs where', daqp),
        ('comparison.md', 'µs where `exact` takes ', '. It', ours),
    ):
        put(name, before, after, figure)
    columns = [f'{side}, p50 / p99.9' for side in SIDES]
    fill(
        'performance.md', python=table(('contender', *SETS, 'worst', 'wrench error'), python),
        in_C=table(('contender', 'uniform', 'flight', *columns), in_c),
        rotors=table(('rotors', *map(str, sizes)), rotors), others=table(('what', 'time'), others),
        limits=table(('limit', 'at most', 'measured'), missed) if missed else 'None.',
    )


if __name__ == '__main__':
    main()
