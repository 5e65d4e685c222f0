"""The design study: ranks vehicles by what they can do in hover, with and without a failure."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from functools import partial

import numpy as np
import pandas as pd

from ca_ros.arguments import finite, split
from ca_ros.evaluation.cases import Case, CaseError
from ca_ros.evaluation.chunk_file import ChunkFile
from ca_ros.evaluation.chunks import add_options, chunk_size, compute
from ca_ros.evaluation.designs import DesignChunks, DesignSpace, spin_orders
from ca_ros.evaluation.environment import machine, versions
from ca_ros.evaluation.options import command, concluded, natural, parser, positive, write
from ca_ros.evaluation.tables import number, render, table
from ca_ros.problem.commandable import unit

CHUNK = 10
"""Least number of designs of a chunk."""

RANDOM = 1000
"""Number of random designs, if it is not given."""

VALUES = 5
"""Number of values of a range in a grid, if it is not given."""

DESIGNS_MAX = 100_000
"""Greatest number of designs: the rows of a hundred thousand take 2 GB."""

RANKS = {
    'Greatest hover margin': ['hover_margin'],
    'Most failures with hover on all axes': ['hovers', 'tilting_after'],
    'Greatest roll and pitch authority after the worst failure': ['tilting_after'],
}
"""What the designs are ranked by, with the titles of the tables."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the study; return its exit code, 130 after Ctrl-C."""
    options = _parse(sys.argv[1:] if argv is None else argv)
    return concluded('design_study', partial(_study, options))


def _study(options: argparse.Namespace) -> None:
    """Do the study, write its files and print the tables; after Ctrl-C with what is done."""
    # The designs have no methods; the vehicle needs one, to be checked.
    vehicle = argparse.Namespace(**vars(options), methods='exact')
    case, _ = Case.of(vehicle, flying=True)
    designs = _designs(options, case.vehicle.n)
    count = designs.combinations if options.grid else options.random
    if count > DESIGNS_MAX:
        raise CaseError(f'{count} designs: expected at most {DESIGNS_MAX}')
    size = chunk_size(count, CHUNK)
    task = DesignChunks(case.parameters, designs, count, size)
    inputs = {'command': command('design_study', options), 'parameters': case.parameters}
    file = ChunkFile(options.out, inputs)
    chunks = -(-count // size)
    parts = compute(task, chunks, file, options, unit=' designs', unit_scale=size)
    rows = pd.DataFrame([row for part in parts for row in part])
    done = rows['design'].nunique() if parts else 0
    if done:
        print(_write(case, rows, count, options))
        print(f'written: design.csv, .json and .md in {options.out}')
    file.conclude(done, count, 'designs')


def _parse(argv: Sequence[str]) -> argparse.Namespace:
    made = parser(
        'design_study',
        'Rank vehicles with rotors on a circle by their hover margin and by their authority '
        'after the failure of a rotor: design.csv, design.json and design.md.',
        methods=False,
    )
    add = made.add_argument
    which = made.add_mutually_exclusive_group()
    which.add_argument(
        '--random', type=positive(int), metavar='N', help=f'number of designs (default: {RANDOM})'
    )
    which.add_argument('--grid', action='store_true', help='all combinations of values')
    form = f'; or one value; for --grid also LOW:HIGH:COUNT, COUNT is {VALUES} otherwise'
    arm, tilt = 'distance of the rotors from the centre [m]', 'angle about their arms [deg]'
    add('--arm', default='0.2:0.6', metavar='LOW:HIGH', help=arm + form)
    add('--tilt', default='0:30', metavar='LOW:HIGH', help=f'{tilt}{form}; --tilt=-20:20')
    orders = 'for each rotor P (clockwise) or N; all: each order of as many P as N'
    add('--spin', default='all', metavar='ORDER,...', help=orders)
    add('--seed', type=natural, default=0, help='of the random designs')
    add('--best', type=positive(int), default=10, metavar='N', help='length of the tables')
    add_options(made)
    options = made.parse_args(split(argv)[0])
    if not (options.grid or options.random):
        options.random = RANDOM
    return options


def _designs(options: argparse.Namespace, n: int) -> DesignSpace:
    """Return the designs of a command line for n rotors; raise a CaseError if it is wrong."""
    arm, tilt = (_values(name, getattr(options, name), options.grid) for name in ('arm', 'tilt'))
    if arm[0] <= 0.0:
        raise CaseError(f'--arm {options.arm}: expected positive lengths')
    if max(map(abs, tilt)) >= 90.0:
        raise CaseError(f'--tilt {options.tilt}: expected angles below 90 degrees')
    try:
        spin = spin_orders(n) if options.spin == 'all' else options.spin.split(',')
    except ValueError as error:
        raise CaseError(str(error)) from None
    for order in spin:
        if len(order) != n or set(order) - set('PN'):
            raise CaseError(f'--spin {order}: expected a letter P or N for each of {n} rotors')
    return DesignSpace(arm, tilt, tuple(spin), None if options.grid else options.seed)


def _values(name: str, text: str, grid: bool) -> tuple[float, ...]:
    """Return the values of a grid at equal distances, or the ends of a range."""
    ends, steps = text.split(':'), 2
    try:
        if grid:
            steps = natural(ends.pop()) if len(ends) == 3 else VALUES if len(ends) == 2 else 1
        low, high = finite(ends[0]), finite(ends[-1])
        if len(ends) > 2 or low > high or not 1 <= steps <= DESIGNS_MAX:
            raise ValueError
    except (ValueError, argparse.ArgumentTypeError):
        form = 'LOW:HIGH, LOW:HIGH:COUNT' if grid else 'LOW:HIGH'
        raise CaseError(f'--{name} {text}: expected {form} or one value') from None
    return tuple(np.linspace(low, high, steps).tolist())


def summary(rows: pd.DataFrame) -> pd.DataFrame:
    """Return a row for each design, from its rows without a failure and after each.

    Returns
    -------
    DataFrame
        Hover margin, and for each axis its authority: what it can do about hover in the weaker
        direction, 0 if it is lost.  Then the same ``_after`` the failure that is the worst for it,
        and the number of failures after which the vehicle hovers: with all axes, and without lost
        axes.
    """
    axes = [name.removesuffix('_low') for name in rows if name.endswith('_low')]
    for axis in axes:
        weaker = np.minimum(-rows[f'{axis}_low'], rows[f'{axis}_high'])
        rows = rows.assign(**{axis: np.maximum(weaker, 0.0)})
    tilting = [axis for axis in axes if axis in ('roll', 'pitch')] or axes
    rows = rows.assign(tilting=rows[tilting].min(axis=1))
    measured = ['hover_margin', *axes, 'tilting']
    before = rows[rows['failed'] == 0].set_index('design')
    failures = rows[rows['failed'] > 0].groupby('design')
    return before[['arm', 'tilt', 'spin', *measured]].join(
        [
            failures[measured].min().add_suffix('_after'),
            failures[['hovers', 'keeps_hovering']].sum(),
        ]
    )


def _write(
    case: Case, rows: pd.DataFrame, count: int, options: argparse.Namespace
) -> str:
    """Write all files; return design.md."""
    designs = summary(rows)
    best = {
        title: designs.sort_values(keys, ascending=False, kind='stable')[: options.best]
        for title, keys in RANKS.items()
    }
    found = {
        'designs': len(designs),
        'requested': count,
        'seed': options.seed,
        'command': command('design_study', options),
        'vehicle': case.name,
        'changes': case.changes,
        'parameters': case.parameters,
        'best': {title: own.reset_index().to_dict('records') for title, own in best.items()},
        'versions': versions(),
        'machine': machine(),
    }
    axes = case.parameters['allocation.axes']
    tables = {title: _table(own, axes, case.vehicle.n) for title, own in best.items()}
    text = render('design.md', **found, tables=tables, options=options)
    write(options.out / 'design', rows, found, text)
    return text


def _table(designs: pd.DataFrame, axes: Sequence[str], n: int) -> str:
    shown = {'hover_margin': 'hover margin [N, N m]'}
    shown |= {axis: f'{axis} [{unit(axis)}]' for axis in axes}
    rows = [
        [
            own['spin'],
            str(k),
            number(own['arm']),
            f'{own["tilt"]:.1f}',
            *(f'{number(own[key])} / {number(own[f"{key}_after"])}' for key in shown),
            f'{own["hovers"]} / {own["keeps_hovering"]} of {n}',
        ]
        for k, own in designs.iterrows()
    ]
    return table(
        ['spin', 'design', 'arm [m]', 'tilt [°]', *shown.values(), 'hovers after failures'], rows
    )


if __name__ == '__main__':
    raise SystemExit(main())
