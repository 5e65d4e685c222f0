"""Latencies and rates of the nodes, beside each other."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from statistics import median
from typing import Any

import numpy as np

from ca_ros.arrays import Array
from ca_ros.bringup.deadline import Deadline
from ca_ros.evaluation.latency.side import START_TIMEOUT, Block, LatencyError, Side

KINDS = ('allocator', 'echo')

RATE_MIN, RATE_MAX = 1.0, 1e5
"""What commands can be sent at [Hz]: a block is over in seconds, and a stamp is a number."""

ANSWERED_MIN = 0.99
"""Share of the commands that is answered at a rate that is sustained.

Not all: with a queue of one, each stall of the machine loses some, at any rate.
"""

CHANCES = 3
"""How often a rate is tried before it counts as too high, for the same reason."""

OFFERED_MIN = 0.98
"""Share of a rate at which commands must have gone out: of a slower one, nothing is known."""

LADDER_START, LADDER = 500.0, 2.0
"""The first rate that is tried [Hz], and the ratio of those that follow."""


def summary(latencies: Array, delays: Array, period: float) -> dict[str, float]:
    """Return percentiles [s] and counts of latencies (N,); late is what was due a period ago."""
    answered = latencies[np.isfinite(latencies)]
    if not len(answered):
        raise LatencyError('no command was answered')
    p50, p99, p999 = np.percentile(answered, (50.0, 99.0, 99.9)).tolist()
    return {
        'p50': p50,
        'p99': p99,
        'p99.9': p999,
        'late': int(len(latencies) - (delays + latencies <= period).sum()),
        'sent': len(latencies),
        'answered': len(answered),
        'delay_p99': float(np.percentile(delays, 99.0)),
    }


def measure(
    sides: Sequence[Side],
    rates: Sequence[float],
    blocks: int,
    seconds: float,
    watch: Callable[[], None],
) -> dict[str, Any]:
    """Return the figures of each rate."""
    found = {}
    for rate in rates:
        made: dict[str, list[Block]] = {side.kind: [] for side in sides}
        for block in range(blocks):
            # Now the one and now the other comes first.
            for side in sides if block % 2 else sides[::-1]:
                made[side.kind].append(_ask(side, rate, seconds, watch))
        figures: dict[str, Any] = {
            kind: summary(
                np.concatenate([block.latencies for block in parts]),
                np.concatenate([block.delays for block in parts]),
                1.0 / rate,
            )
            for kind, parts in made.items()
        }
        for name in ('p50', 'p99'):
            figures[f'ratio_{name}'] = median(
                ours[name] / echo[name]
                for ours, echo in zip(
                    *(
                        [
                            summary(block.latencies, block.delays, 1.0 / rate)
                            for block in made[kind]
                        ]
                        for kind in KINDS
                    ),
                    strict=True,
                )
            )
        found[f'{rate:g}'] = figures
    return found


def _ask(side: Side, rate: float, seconds: float, watch: Callable[[], None]) -> Block:
    """Return a block with at least one answer; a block without one, from a stall, is repeated."""
    deadline = Deadline(START_TIMEOUT)
    while True:
        block = side.ask(rate, max(int(rate * seconds), 10))
        watch()
        if block.answered or deadline.passed():
            return block


def compare(found: dict[str, list[float]]) -> dict[str, float]:
    """Return medians over the rounds of the rates found [Hz], and of their ratio in a round."""
    pairs = zip(*(found[kind] for kind in KINDS), strict=True)
    return {
        **{kind: median(rates) for kind, rates in found.items()},
        'ratio': median(ours / echo for ours, echo in pairs),
    }


def sustained(
    sides: Sequence[Side], seconds: float, rounds: int, precision: float, watch: Callable[[], None]
) -> dict[str, float]:
    """Return the highest rates [Hz] at which `ANSWERED_MIN` of the commands are answered."""

    def holds(side: Side, rate: float) -> bool:
        for _ in range(CHANCES):
            block = side.ask(rate, max(int(rate * seconds), 10))
            watch()
            if block.answered >= ANSWERED_MIN and block.offered >= OFFERED_MIN * rate:
                return True
        return False

    def highest(side: Side) -> float:
        low = LADDER_START
        while not holds(side, low):
            low /= LADDER
            if low < RATE_MIN:
                raise LatencyError(f'the {side.kind} sustains no rate')
        high = low * LADDER
        while high < RATE_MAX and holds(side, high):
            low, high = high, high * LADDER
        while high / low > precision:
            middle = math.sqrt(low * high)
            low, high = (middle, high) if holds(side, middle) else (low, middle)
        return low

    found: dict[str, list[float]] = {side.kind: [] for side in sides}
    for _ in range(rounds):
        for side in sides:
            found[side.kind].append(highest(side))
    return compare(found)


def in_turn(
    sides: Sequence[Side], count: int, rounds: int, watch: Callable[[], None]
) -> dict[str, float]:
    """Return the rates [Hz] at which each command follows on the answer to the one before."""
    found: dict[str, list[float]] = {side.kind: [] for side in sides}
    for _ in range(rounds):
        for side in sides:
            found[side.kind].append(side.ask_in_turn(count, watch))
            watch()
    return compare(found)
