"""The limits that the package promises to meet, and whether a run met them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import partial
from typing import Any

import pandas as pd

from ca_ros.evaluation.benchmark.contenders import BASELINE, POLICIES
from ca_ros.evaluation.benchmark.measurements import TWO_CORES
from ca_ros.evaluation.benchmark.results import ratio
from ca_ros.evaluation.benchmark.setups import ROTORS, SETUPS
from ca_ros.evaluation.benchmark.timing import Key
from ca_ros.evaluation.tables import number

UNIT = 'in units of the clipped pseudo-inverse'
OVER = 'of the node over that of an echo node'

_Measured = float | None | Mapping[str, float | None]
"""A value, or the values of some cases, of which the greatest counts; None if not measured."""


def promises(found: Mapping[str, Any], rows: pd.DataFrame) -> list[dict[str, Any]]:
    """Return all promises for a run of the paper's vehicle, as in benchmark.json and .csv.

    ``met`` is None if it was not measured.
    """
    return [promise(*each) for each in _limits(found, rows)]


def promise(
    what: str, limit: float, measured: _Measured, at_least: bool = False
) -> dict[str, Any]:
    """Return a promise as in benchmark.json; of several cases the worst is named."""
    if isinstance(measured, Mapping):
        known = {case: value for case, value in measured.items() if value is not None}
        worst = max(known, key=known.__getitem__, default='none')
        what, measured = f'{what} (worst: {worst})', known.get(worst)
    met = None
    if measured is not None:
        met = measured >= limit if at_least else measured <= limit
    return {'what': what, 'limit': limit, 'measured': measured, 'at_least': at_least, 'met': met}


def _limits(found: Mapping[str, Any], rows: pd.DataFrame) -> Iterator[tuple[Any, ...]]:
    """Yield the arguments of `promise`."""
    plan, node, loads = found['settings']['plan'], found['node'], list(found['loads'])
    compare = partial(ratio, rows)

    def over(other: str, load: str, name: str = 'exact', part: str = 'calls', n: int = 6) -> Any:
        """Return the time of a contender over that of another one."""
        return compare(Key(part, load, name, n), Key(part, load, other, n))

    yield f'`exact` on a flight, {UNIT}', 1.0, over(BASELINE, 'flight')
    yield '`exact` on uniform wrenches, in the same units', 1.2, over(BASELINE, 'uniform')
    policies = {'prioritize': 'exact', **{name.partition('_')[2]: name for name in POLICIES}}
    boundary = {policy: over(BASELINE, 'boundary', name) for policy, name in policies.items()}
    yield '`exact` on the boundary, all policies, in the same units', 1.5, boundary
    tails = {
        each['load']: each['p99'] / each['p50']
        for each in found['results']
        if (each['part'], each['contender']) == ('calls', 'exact')
    }
    yield '99th percentile of `exact` over its median, all loads', 3.0, tails
    reused = {load: over('daqp_reused', load) for load in loads}
    yield '`exact` over reused DAQP, all loads', 0.5, reused
    raw = ('osqp', 'osqp_polished')
    osqp = {f'{name}, {load}': over(name, load) for load in loads for name in raw}
    yield '`exact` over raw OSQP, all loads and settings', 1.0, osqp
    yield "`exact` over DAQP's one-shot call, on a flight", 1.0, over('daqp', 'flight')

    growth = {
        f'{n}, {load}': over('daqp_reused', load, part='rotors', n=n)
        for load in loads
        for n in plan['rotors']
    }
    yield '`exact` over reused DAQP, all loads and numbers of rotors', 0.5, growth
    pair = (Key('rotors', 'flight', 'exact', n) for n in (32, 6))
    yield '32 rotors over 6 rotors, `exact` on a flight', 4.0, compare(*pair)

    sizes, rival = list(map(str, plan['batches'])), str(found['rival'])
    least, *larger = (Key('batches', size, 'exact', 6) for size in sizes)
    loop = Key('batches', 'one by one', rival, 6)
    what = f'throughput of a batch of {sizes[-1]} over that of a loop over the fastest peer'
    for cores, limit in (('', 15.0), (TWO_CORES, 27.0)):
        batch = Key('batches', f'{sizes[-1]}{cores}', 'exact', 6)
        yield f'{what} ({rival}){cores or ", one core"}', limit, compare(loop, batch), True
    linear = [abs(each - 1.0) for size in larger if (each := compare(size, least)) is not None]
    what = 'departure of time from being linear in the size of a batch, greatest share'
    yield what, 0.1, max(linear, default=None)

    setups = {
        (each['load'], each['contender']): 1e3 * each['time']
        for each in found['results']
        if each['part'] == 'set-up'
    }
    for axes, limit in (('4 axes', 0.2), ('6 axes', 5.0)):
        for name, (what, _) in SETUPS.items():
            yield f'{what}, {ROTORS} rotors, {axes} [ms]', limit, setups.get((axes, name))

    flight = f'{plan["duration"]:g} s'
    what = f'{flight} of closed loop with `exact`, in units of 1000 clipped pseudo-inverses'
    yield what, 75.0, over(BASELINE, flight, part='closed loop')

    slow, fast = (node.get('rates', {}).get(rate, {}) for rate in ('250', '1000'))
    for percentile, limit in (('p50', 1.05), ('p99', 1.15)):
        measured = slow.get('ratio', {}).get(percentile)
        yield f'latency {percentile} {OVER}, 250 Hz', limit, measured
    what, sustained = f'highest sustained rate {OVER}', node.get('sustained', {}).get('ratio')
    yield what, 0.85, sustained, True
    what, late = f'share of commands late at 1 kHz {OVER}', None
    if fast.keys() >= {'allocator', 'echo'}:
        own, echo = (fast[kind]['late'] / fast[kind]['sent'] for kind in ('allocator', 'echo'))
        # An echo node that is never late has a share of at most one command.
        late = own / max(echo, 1.0 / fast['echo']['sent'])
        what += f' ({number(own)} over {number(echo)})'
    yield what, 1.15, late

    if found['settings']['quick']:
        yield '`benchmark --quick`, from the vehicle to the tables [s]', 60.0, found['wall_time']
