"""The limits that the package promises to meet, and whether a run met them."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

import pandas as pd

from ca_ros.evaluation.benchmark.contenders import BASELINE
from ca_ros.evaluation.benchmark.results import ratio
from ca_ros.evaluation.benchmark.timing import Key
from ca_ros.evaluation.tables import number

QUICK_TIME = 60.0
"""Longest time of `benchmark --quick` [s]."""


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
    node, rival, plan = found['node'], found['rival'], found['settings']['plan']
    compare = partial(ratio, rows)

    def key(part: str, load: str, name: str = 'exact', rotors: int = 6) -> Key:
        return Key(part, load, name, rotors)

    def against(load: str, other: str) -> float | None:
        return compare(key('calls', load), key('calls', load, other))

    osqp = {
        f'{name}, {load}': against(load, name)
        for load in found['loads']
        for name in ('osqp', 'osqp_polished')
    }
    known = {what: value for what, value in osqp.items() if value is not None}
    worst = max(known, key=known.__getitem__, default='None')
    least, *larger = [key('batches', str(size)) for size in plan['batches']]
    linear = [value for size in larger if (value := compare(size, least)) is not None]
    whole = larger[-1] if larger else least
    flight = f'{plan["duration"]:g} s'
    slow, fast = (node.get('rates', {}).get(rate, {}) for rate in ('250', '1000'))
    kinds = [kind for kind in ('allocator', 'echo') if kind in fast]
    late = {kind: fast[kind]['late'] / fast[kind]['sent'] for kind in kinds}
    beside = f' (of the echo node: {number(late["echo"])})' if 'echo' in late else ''
    unit, over = 'in units of the clipped pseudo-inverse', 'of the node over that of an echo node'
    made: list[tuple[Any, ...]] = [
        (f'`exact` on a flight, {unit}', 2.0, against('flight', BASELINE)),
        ('`exact` on uniform wrenches, in the same units', 5.0, against('uniform', BASELINE)),
        (f'`exact` over raw OSQP, all loads and settings (worst: {worst})', 1.0, known.get(worst)),
        ("`exact` over DAQP's one-shot call, on a flight", 1.0, against('flight', 'daqp')),
        (
            f'throughput of a batch of {whole.load} over that of a loop over the fastest peer '
            f'({rival or "none is installed"})',
            8.0,
            compare(key('batches', 'one by one', str(rival)), whole),
            True,
        ),
        (
            'departure of time from being linear in the size of a batch, greatest share',
            0.1,
            max((abs(value - 1.0) for value in linear), default=None),
        ),
        (
            '32 rotors over 6 rotors, `exact` on a flight',
            4.0,
            compare(key('rotors', 'flight', rotors=32), key('rotors', 'flight')),
        ),
        (
            f'{flight} of closed loop with `exact`, in units of 1000 clipped pseudo-inverses',
            75.0,
            compare(key('closed loop', flight), key('closed loop', flight, BASELINE)),
        ),
        (f'latency p50 {over}, 250 Hz', 1.15, slow.get('ratio', {}).get('p50')),
        (f'latency p99 {over}, 250 Hz', 1.3, slow.get('ratio', {}).get('p99')),
        (f'highest sustained rate {over}', 0.85, node.get('sustained', {}).get('ratio'), True),
        (f'share of commands answered late at 1 kHz{beside}', 1e-3, late.get('allocator')),
    ]
    if found['settings']['quick']:
        what = '`benchmark --quick`, from the vehicle to the tables [s]'
        made.append((what, QUICK_TIME, found['wall_time']))
    return [promise(*each) for each in made]
