"""What is promised of the speed, and whether a run has kept it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ca_ros.evaluation.benchmark.timing import spread
from ca_ros.evaluation.tables import number

NODES = ('allocator', 'echo')
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
    calls, batch, loop, node = (found[key] for key in ('calls', 'batch', 'closed_loop', 'node'))
    made: list[dict[str, Any]] = []

    def add(what: str, limit: float, measured: float | None, at_least: bool = False) -> None:
        made.append(promise(what, limit, measured, at_least))

    ratio = {load: own['exact']['ratio'] for load, own in calls.items() if 'exact' in own}
    median = {load: own['median'] for load, own in ratio.items()}
    add('`exact` on a flight, in units of the clipped pseudo-inverse', 2.0, median.get('flight'))
    add('`exact` on uniform wrenches, in the same units', 5.0, median.get('uniform'))
    osqp = {
        f'{name}, {load}': times
        for load, own in calls.items()
        for name in OSQP
        if (times := compare(own, 'exact', name)) is not None
    }
    worst = max(osqp, key=osqp.__getitem__, default='None')
    what = f'`exact` over raw OSQP, on all loads and with both settings (the worst: {worst})'
    add(what, 1.0, osqp.get(worst))
    what = "`exact` over DAQP's one-shot call, on a flight"
    add(what, 1.0, compare(calls['flight'], 'exact', 'daqp'))
    what = (
        f'throughput of a batch of {batch["largest"]} over that of a loop over the fastest peer '
        f'({found["rival"] or "none is installed"})'
    )
    add(what, 8.0, batch['speedup']['median'] if 'speedup' in batch else None, at_least=True)
    what = 'departure of time from being linear in the size of a batch, greatest share'
    linear = [abs(each['median'] - 1.0) for each in batch['linearity'].values()]
    add(what, 0.1, max(linear, default=None))
    rotors = found['growth']['flight']['exact'] if found['growth'] else {}
    add('32 rotors over 6 rotors, `exact` on a flight', 4.0, compare(rotors, '32', '6'))
    what = f'{loop["duration"]:g} s of closed loop with `exact`, in units of 1000 clipped '
    add(f'{what}pseudo-inverses', 75.0, loop['ratio']['median'])
    slow, fast = (node.get('rates', {}).get(rate, {}) for rate in ('250', '1000'))
    late = {name: own['late'] / own['sent'] for name, own in fast.items() if name in NODES}
    over = 'of the node over that of an echo node'
    add(f'latency p50 {over}, 250 Hz', 1.15, slow.get('ratio_p50'))
    add(f'latency p99 {over}, 250 Hz', 1.3, slow.get('ratio_p99'))
    sustained = node.get('sustained', {}).get('ratio')
    add(f'highest sustained rate {over}', 0.85, sustained, at_least=True)
    beside = f' (of the echo node: {number(late["echo"])})' if 'echo' in late else ''
    add(f'share of commands answered late at 1 kHz{beside}', 1e-3, late.get('allocator'))
    if found['settings']['quick']:
        what = '`benchmark --quick`, from the vehicle to the tables [s]'
        add(what, QUICK_TIME, found['wall_time'])
    return made


def compare(calls: Mapping[str, Any], one: str, other: str) -> float | None:
    """Return the median ratio of the times of two entries; None if one was not measured."""
    if one not in calls or other not in calls:
        return None
    times = (np.array(calls[name]['repetitions'], dtype=float) for name in (one, other))
    ratios = np.divide(*times)
    return None if np.isnan(ratios).all() else spread(ratios)['median']
