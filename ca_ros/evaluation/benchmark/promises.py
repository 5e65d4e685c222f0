"""The limits that the package promises to meet, and whether a run met them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from functools import partial
from typing import Any

import pandas as pd

from ca_ros.evaluation.benchmark.contenders import BASELINE, POLICIES
from ca_ros.evaluation.benchmark.measurements import TWO_CORES
from ca_ros.evaluation.benchmark.results import ratio
from ca_ros.evaluation.benchmark.setups import ROTORS, SETUPS
from ca_ros.evaluation.benchmark.timing import Key
from ca_ros.evaluation.tables import number

QUICK_TIME = 60.0
"""Longest time of `benchmark --quick` [s]."""

UNIT = 'in units of the clipped pseudo-inverse'
OVER = 'of the node over that of an echo node'

Rows = Iterator[tuple[Any, ...]]
"""Arguments of `promise`."""


def promise(
    what: str, limit: float, measured: float | None, at_least: bool = False
) -> dict[str, Any]:
    """Return a promise as in benchmark.json: ``met`` is None if it was not measured."""
    met = None
    if measured is not None:
        met = measured >= limit if at_least else measured <= limit
    return {'what': what, 'limit': limit, 'measured': measured, 'at_least': at_least, 'met': met}


def promises(found: Mapping[str, Any], rows: pd.DataFrame) -> list[dict[str, Any]]:
    """Return all promises for a run of the paper's vehicle, as in benchmark.json and .csv."""
    plan, settings = found['settings']['plan'], found['settings']
    made = [
        *_calls(found, rows),
        *_rotors(plan, rows),
        *_batches(plan, found['rival'], rows),
        *_setups(found['results']),
        *_closed_loop(plan, rows),
        *_node(found['node']),
    ]
    if settings['quick']:
        what = '`benchmark --quick`, from the vehicle to the tables [s]'
        made.append((what, QUICK_TIME, found['wall_time']))
    return [promise(*each) for each in made]


def _key(part: str, load: str, name: str = 'exact', rotors: int = 6) -> Key:
    return Key(part, load, name, rotors)


def _worst(
    what: str, limit: float, cases: Iterable[tuple[str, float | None]]
) -> tuple[str, float, float | None]:
    """Return a promise about the greatest of some values, which is named."""
    known = {case: value for case, value in cases if value is not None}
    worst = max(known, key=known.__getitem__, default='none')
    return f'{what} (worst: {worst})', limit, known.get(worst)


def _calls(found: Mapping[str, Any], rows: pd.DataFrame) -> Rows:
    loads = list(found['loads'])

    def against(load: str, other: str, name: str = 'exact') -> float | None:
        return ratio(rows, _key('calls', load, name), _key('calls', load, other))

    yield f'`exact` on a flight, {UNIT}', 1.0, against('flight', BASELINE)
    yield '`exact` on uniform wrenches, in the same units', 1.2, against('uniform', BASELINE)
    policies = {'prioritize': 'exact', **{name.partition('_')[2]: name for name in POLICIES}}
    yield _worst(
        '`exact` on the boundary, all policies, in the same units',
        1.5,
        ((policy, against('boundary', BASELINE, name)) for policy, name in policies.items()),
    )
    own = [
        each
        for each in found['results']
        if (each['part'], each['contender']) == ('calls', 'exact')
    ]
    yield _worst(
        '99th percentile of `exact` over its median, all loads',
        3.0,
        ((each['load'], each['p99'] / each['p50']) for each in own),
    )
    yield _worst(
        '`exact` over reused DAQP, all loads',
        0.5,
        ((load, against(load, 'daqp_reused')) for load in loads),
    )
    yield _worst(
        '`exact` over raw OSQP, all loads and settings',
        1.0,
        (
            (f'{name}, {load}', against(load, name))
            for load in loads
            for name in ('osqp', 'osqp_polished')
        ),
    )
    yield "`exact` over DAQP's one-shot call, on a flight", 1.0, against('flight', 'daqp')


def _rotors(plan: Mapping[str, Any], rows: pd.DataFrame) -> Rows:
    own = rows[rows['part'] == 'rotors']

    def against(load: str, n: int) -> float | None:
        return ratio(own, _key('rotors', load, rotors=n), _key('rotors', load, 'daqp_reused', n))

    yield _worst(
        '`exact` over reused DAQP, all loads and numbers of rotors',
        0.5,
        (
            (f'{n}, {load}', against(load, n))
            for load in own['load'].unique()
            for n in plan['rotors']
        ),
    )
    pair = _key('rotors', 'flight', rotors=32), _key('rotors', 'flight')
    yield '32 rotors over 6 rotors, `exact` on a flight', 4.0, ratio(own, *pair)


def _batches(plan: Mapping[str, Any], rival: str | None, rows: pd.DataFrame) -> Rows:
    compare = partial(ratio, rows)
    least, *larger = [_key('batches', str(size)) for size in plan['batches']]
    whole, loop = larger[-1] if larger else least, _key('batches', 'one by one', str(rival))
    what = (
        f'throughput of a batch of {whole.load} over that of a loop over the fastest peer '
        f'({rival or "none is installed"})'
    )
    yield f'{what}, both on one core', 15.0, compare(loop, whole), True
    both = compare(loop, whole._replace(load=f'{whole.load}{TWO_CORES}'))
    yield 'the same, the batch on two cores', 27.0, both, True
    linear = [value for size in larger if (value := compare(size, least)) is not None]
    departure = max((abs(value - 1.0) for value in linear), default=None)
    what = 'departure of time from being linear in the size of a batch, greatest share'
    yield what, 0.1, departure


def _setups(results: Iterable[Mapping[str, Any]]) -> Rows:
    times = {
        (each['load'], each['contender']): 1e3 * each['time']
        for each in results
        if each['part'] == 'set-up'
    }
    for axes, limit in (('4 axes', 0.2), ('6 axes', 5.0)):
        for name, (what, _) in SETUPS.items():
            yield f'{what}, {ROTORS} rotors, {axes} [ms]', limit, times.get((axes, name))


def _closed_loop(plan: Mapping[str, Any], rows: pd.DataFrame) -> Rows:
    flight = f'{plan["duration"]:g} s'
    yield (
        f'{flight} of closed loop with `exact`, in units of 1000 clipped pseudo-inverses',
        75.0,
        ratio(rows, _key('closed loop', flight), _key('closed loop', flight, BASELINE)),
    )


def _node(node: Mapping[str, Any]) -> Rows:
    slow, fast = (node.get('rates', {}).get(rate, {}) for rate in ('250', '1000'))
    yield f'latency p50 {OVER}, 250 Hz', 1.05, slow.get('ratio', {}).get('p50')
    yield f'latency p99 {OVER}, 250 Hz', 1.15, slow.get('ratio', {}).get('p99')
    yield f'highest sustained rate {OVER}', 0.85, node.get('sustained', {}).get('ratio'), True
    kinds = [kind for kind in ('allocator', 'echo') if kind in fast]
    late = {kind: fast[kind]['late'] / fast[kind]['sent'] for kind in kinds}
    compared, beside = None, ''
    if len(late) == 2:
        # An echo node that is never late has a share of at most one command.
        compared = late['allocator'] / max(late['echo'], 1.0 / fast['echo']['sent'])
        beside = f' ({number(late["allocator"])} over {number(late["echo"])})'
    yield f'share of commands late at 1 kHz {OVER}{beside}', 1.15, compared
