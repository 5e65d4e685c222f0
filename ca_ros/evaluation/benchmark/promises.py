"""What is promised of the speed, and whether a run has kept it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

from ca_ros.evaluation.benchmark.calls import compare
from ca_ros.evaluation.benchmark.timing import ratios, spread
from ca_ros.evaluation.tables import number

OSQP = ('osqp', 'osqp_polished')
QUICK_TIME = 60.0
"""How long `benchmark --quick` may take [s]."""


@dataclass(frozen=True)
class Promise:
    """A promise and what was measured.

    Attributes
    ----------
    what : str
        With the unit.
    limit : float
    at_least : bool
        Whether the limit is the least value, not the greatest.
    measured : float or None
        None if it was not measured in this run.
    """

    what: str
    limit: float
    measured: float | None
    at_least: bool = False

    @property
    def met(self) -> bool | None:
        """Whether it is kept; None if that was not measured."""
        if self.measured is None:
            return None
        if self.at_least:
            return self.measured >= self.limit
        return self.measured <= self.limit

    def figures(self) -> dict[str, Any]:
        """Return what benchmark.json holds."""
        return {**asdict(self), 'met': self.met}


def promises(figures: Mapping[str, Any]) -> list[Promise]:
    """Return all promises for a run as in benchmark.json."""
    calls, batch, loop = figures['calls'], figures['batch'], figures['closed_loop']
    linear = [abs(each['median'] - 1.0) for each in batch['linearity'].values()]
    found = [
        Promise(
            '`exact` on a flight, in units of the clipped pseudo-inverse',
            2.0,
            _ratio(calls, 'flight'),
        ),
        Promise('`exact` on uniform wrenches, in the same units', 5.0, _ratio(calls, 'uniform')),
        _osqp(calls),
        Promise(
            "`exact` over DAQP's one-shot call, on a flight",
            1.0,
            compare(calls['flight'], 'exact', 'daqp'),
        ),
        Promise(
            f'throughput of a batch of {batch["largest"]} over that of a loop over the fastest '
            f'peer ({figures["rival"] or "none is installed"})',
            8.0,
            batch['speedup']['median'] if 'speedup' in batch else None,
            at_least=True,
        ),
        Promise(
            'departure of time from being linear in the size of a batch, greatest share',
            0.1,
            max(linear, default=None),
        ),
        Promise('32 rotors over 6 rotors, `exact` on a flight', 4.0, _growth(figures['growth'])),
        Promise(
            f'{loop["duration"]:g} s of closed loop with `exact`, in units of 1000 clipped '
            'pseudo-inverses',
            75.0,
            loop['ratio']['median'],
        ),
        *_node(figures['node']),
    ]
    if figures['settings']['quick']:
        found.append(
            Promise(
                '`benchmark --quick`, from the vehicle to the figures [s]',
                QUICK_TIME,
                figures['wall_time'],
            )
        )
    return found


def _ratio(calls: Mapping[str, Any], load: str) -> float | None:
    return calls[load]['exact']['ratio']['median'] if 'exact' in calls[load] else None


def _osqp(calls: Mapping[str, Any]) -> Promise:
    found = {
        f'{name}, {load}': compare(calls[load], 'exact', name) for load in calls for name in OSQP
    }
    known = {case: ratio for case, ratio in found.items() if ratio is not None}
    worst = max(known, key=known.__getitem__, default=None)
    return Promise(
        f'`exact` over raw OSQP, on all loads and with both settings (the worst: {worst})',
        1.0,
        None if worst is None else known[worst],
    )


def _growth(growth: Mapping[str, Any]) -> float | None:
    if not growth:
        return None
    exact = growth['flight']['exact']
    if '32' not in exact or '6' not in exact:
        return None
    many, few = (
        [float('nan') if mean is None else mean for mean in exact[n]['repetitions']]
        for n in ('32', '6')
    )
    return spread(ratios(many, few))['median']


def _node(node: Mapping[str, Any]) -> list[Promise]:
    rates = node.get('rates', {})
    slow, fast = rates.get('250', {}), rates.get('1000', {})
    sustained = node.get('sustained', {}).get('ratio')
    late = {
        name: fast[name]['late'] / fast[name]['sent']
        for name in ('allocator', 'echo')
        if name in fast
    }
    beside = f' (of the echo node: {number(late["echo"])})' if 'echo' in late else ''
    return [
        Promise(
            'latency p50 of the node over that of an echo node, 250 Hz',
            1.15,
            slow.get('ratio_p50'),
        ),
        Promise(
            'latency p99 of the node over that of an echo node, 250 Hz', 1.3, slow.get('ratio_p99')
        ),
        Promise(
            'highest sustained rate of the node over that of an echo node',
            0.85,
            sustained,
            at_least=True,
        ),
        Promise(f'share of commands answered late at 1 kHz{beside}', 1e-3, late.get('allocator')),
    ]
