"""Throughput of batches, beside a loop over the fastest peer."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from time import perf_counter
from typing import Any

import numpy as np

from ca_ros.allocation import Allocator
from ca_ros.arrays import Array
from ca_ros.evaluation.benchmark import loads
from ca_ros.evaluation.benchmark.accuracy import Accuracy, Judge
from ca_ros.evaluation.benchmark.contenders import Contender
from ca_ros.evaluation.benchmark.plan import Plan
from ca_ros.evaluation.benchmark.timing import ratios, rounds, spread
from ca_ros.problem.admissible_set import AdmissibleSet

CHECKED = 1000
"""Wrenches of which the answers are judged."""

ENOUGH = 1.0
"""A method that needs longer for the smallest batch is given a tenth of it [s]."""


def time_batches(
    admissible: AdmissibleSet,
    allocators: Mapping[str, Allocator],
    rival: Contender | None,
    plan: Plan,
    seed: int,
    progress: Callable[[], Any],
) -> dict[str, Any]:
    """Return times per wrench, on uniform wrenches: of `exact` for all sizes of batches.

    Parameters
    ----------
    admissible : AdmissibleSet
    allocators : mapping of str to Allocator
        With 'exact'; the others are given the smallest size alone.
    rival : Contender or None
        Its calls, one after the other, fill an array.
    plan : Plan
    seed : int
    progress : callable
        Called after each repetition.
    """
    sizes = plan.batches
    wrenches = loads.uniform(admissible, np.random.default_rng(seed), max(sizes))
    least = min(sizes)
    jobs: dict[str, Callable[[], Any]] = {}
    amounts: dict[str, int] = {}
    for name, allocator in allocators.items():
        mine = _affordable(allocator, wrenches, least)
        for size, count in sizes.items() if name == 'exact' else ((mine, 1),):
            jobs[f'{name} {size}'] = partial(_batches, allocator, wrenches, size, count)
            amounts[f'{name} {size}'] = size * count
    if rival is not None:
        looped = min(plan.looped, len(wrenches))
        jobs['loop'] = partial(_loop, rival, wrenches[:looped], admissible.problem.vehicle.n)
        amounts['loop'] = looped
    times = {
        name: [each / amounts[name] for each in own]
        for name, own in rounds(jobs, plan.rounds, seed, progress).items()
    }
    whole = max(sizes)
    found: dict[str, Any] = {
        'wrenches': amounts,
        'time': {name: {**spread(own), 'repetitions': own} for name, own in times.items()},
        'linearity': {
            str(size): spread(ratios(times[f'exact {size}'], times[f'exact {least}']))
            for size in sizes
            if size != least
        },
        'largest': whole,
        'correct': _correct(admissible, allocators['exact'], wrenches[:CHECKED]),
    }
    if rival is not None:
        found['speedup'] = spread(ratios(times['loop'], times[f'exact {whole}']))
    return found


def _affordable(allocator: Allocator, wrenches: Array, size: int) -> int:
    """Return what a method is given; it has seen some wrenches then."""
    start = perf_counter()
    allocator.allocate_batch(wrenches[: size // 10])
    small = 10.0 * (perf_counter() - start) > ENOUGH
    if not small:
        allocator.allocate_batch(wrenches[:size])
    return size // 10 if small else size


def _batches(allocator: Allocator, wrenches: Array, size: int, count: int) -> None:
    for first in range(0, size * count, size):
        allocator.allocate_batch(wrenches[first : first + size])


def _loop(rival: Contender, wrenches: Array, n: int) -> Array:
    thrusts = np.full((len(wrenches), n), np.nan)
    for i, u in enumerate(wrenches):
        answer = rival.call(u)
        if answer is not None:
            thrusts[i] = answer
    return thrusts


def _correct(admissible: AdmissibleSet, exact: Allocator, wrenches: Array) -> bool:
    worst = Accuracy()
    answers = exact.allocate_batch(wrenches).thrusts
    Judge(admissible.problem, wrenches).judge(worst, list(answers))
    return not worst.faults
