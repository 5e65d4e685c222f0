"""What is promised of the speed, and whether a run has kept it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ca_ros.evaluation.benchmark.timing import spread
from ca_ros.evaluation.tables import number

OSQP = ('osqp', 'osqp_polished')

QUICK_TIME = 60.0
"""How long `benchmark --quick` may take [s]."""


def promise(
    what: str, limit: float, measured: float | None, at_least: bool = False
) -> dict[str, Any]:
    """Return a promise as in benchmark.json: ``met`` is None if it was not measured."""
    met = None
    if measured is not None:
        met = measured >= limit if at_least else measured <= limit
    return {'what': what, 'limit': limit, 'measured': measured, 'at_least': at_least, 'met': met}


def promises(found: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return all promises for a run as in benchmark.json."""
    calls, batch, loop = found['calls'], found['batch'], found['closed_loop']
    linear = [abs(each['median'] - 1.0) for each in batch['linearity'].values()]
    ratio = {
        load: own['exact']['ratio']['median'] if 'exact' in own else None
        for load, own in calls.items()
    }
    osqp = {
        f'{name}, {load}': compare(own, 'exact', name)
        for load, own in calls.items()
        for name in OSQP
    }
    known = {case: value for case, value in osqp.items() if value is not None}
    worst = max(known, key=known.__getitem__, default='')
    made = [
        promise(
            '`exact` on a flight, in units of the clipped pseudo-inverse', 2.0, ratio['flight']
        ),
        promise('`exact` on uniform wrenches, in the same units', 5.0, ratio['uniform']),
        promise(
            '`exact` over raw OSQP, on all loads and with both settings '
            f'(the worst: {worst or None})',
            1.0,
            known.get(worst),
        ),
        promise(
            "`exact` over DAQP's one-shot call, on a flight",
            1.0,
            compare(calls['flight'], 'exact', 'daqp'),
        ),
        promise(
            f'throughput of a batch of {batch["largest"]} over that of a loop over the fastest '
            f'peer ({found["rival"] or "none is installed"})',
            8.0,
            batch['speedup']['median'] if 'speedup' in batch else None,
            at_least=True,
        ),
        promise(
            'departure of time from being linear in the size of a batch, greatest share',
            0.1,
            max(linear, default=None),
        ),
        promise(
            '32 rotors over 6 rotors, `exact` on a flight',
            4.0,
            compare(found['growth']['flight']['exact'], '32', '6') if found['growth'] else None,
        ),
        promise(
            f'{loop["duration"]:g} s of closed loop with `exact`, in units of 1000 clipped '
            'pseudo-inverses',
            75.0,
            loop['ratio']['median'],
        ),
        *_node(found['node']),
    ]
    if found['settings']['quick']:
        what = '`benchmark --quick`, from the vehicle to the tables [s]'
        made.append(promise(what, QUICK_TIME, found['wall_time']))
    return made


def compare(calls: Mapping[str, Any], one: str, other: str) -> float | None:
    """Return the median ratio of the times of two entries; None if one was not measured."""
    if one not in calls or other not in calls:
        return None
    times = (np.array(calls[name]['repetitions'], dtype=float) for name in (one, other))
    ratios = np.divide(*times)
    return None if np.isnan(ratios).all() else spread(ratios)['median']


def _node(node: Mapping[str, Any]) -> list[dict[str, Any]]:
    rates = node.get('rates', {})
    slow, fast = rates.get('250', {}), rates.get('1000', {})
    late = {
        name: fast[name]['late'] / fast[name]['sent']
        for name in ('allocator', 'echo')
        if name in fast
    }
    beside = f' (of the echo node: {number(late["echo"])})' if 'echo' in late else ''
    return [
        promise(
            'latency p50 of the node over that of an echo node, 250 Hz',
            1.15,
            slow.get('ratio_p50'),
        ),
        promise(
            'latency p99 of the node over that of an echo node, 250 Hz', 1.3, slow.get('ratio_p99')
        ),
        promise(
            'highest sustained rate of the node over that of an echo node',
            0.85,
            node.get('sustained', {}).get('ratio'),
            at_least=True,
        ),
        promise(f'share of commands answered late at 1 kHz{beside}', 1e-3, late.get('allocator')),
    ]
