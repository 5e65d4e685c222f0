"""The parts of a benchmark: calls, growth with the number of rotors, batches, closed loop."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from time import perf_counter
from typing import Any

import numpy as np
import pandas as pd

from ca_ros.allocation import Allocator, make_allocator
from ca_ros.arrays import Array
from ca_ros.evaluation.benchmark import loads
from ca_ros.evaluation.benchmark.peers import BASELINE, Contender, baseline, method, peer
from ca_ros.evaluation.benchmark.plan import Plan
from ca_ros.evaluation.benchmark.timing import Track, measure, rounds, spread
from ca_ros.evaluation.judge import Judge, verdict
from ca_ros.flight.closed_loop import fly
from ca_ros.flight.controller import Controller, Gains
from ca_ros.flight.record import Flight
from ca_ros.flight.rigid_body import RigidBody
from ca_ros.problem.admissible_set import AdmissibleSet
from ca_ros.problem.problem import AllocationProblem
from ca_ros.vehicle.vehicle import Vehicle

CHECKED = 1000
"""Wrenches of a batch of which the answers are judged."""

ENOUGH = 1.0
"""A method that needs longer for the smallest batch is given a tenth of it [s]."""

UNIT, UNITS = 1000, 20
"""Calls of the clipped pseudo-inverse that are the unit of flights, and units in a repetition."""


def time_calls(
    problem: AllocationProblem,
    contenders: Mapping[str, Contender],
    wrenches: Array,
    plan: Plan,
    seed: int,
) -> dict[str, Any]:
    """Return metrics by contender for one load, wrenches (W, m) [N, N m]."""
    judge = Judge(problem, wrenches)
    tracks = {(name, problem.n): each.track(judge) for name, each in contenders.items()}
    return {name: own[str(problem.n)] for name, own in _compete(tracks, plan, seed, 'calls')}


def time_growth(plan: Plan, rival: str | None, seed: int) -> dict[str, dict[str, dict[str, Any]]]:
    """Return metrics of the baseline, `exact` and a peer by load, contender and rotors."""
    found = {}
    for load in ('uniform', 'flight'):
        tracks: dict[tuple[str, int], Track] = {}
        for n in plan.rotors:
            parameters = loads.ring(n)
            vehicle = Vehicle.from_parameters(parameters)
            admissible = AdmissibleSet(vehicle)
            if load == 'uniform':
                wrenches = admissible.sample(np.random.default_rng(seed), plan.wrenches)
            else:
                wrenches = loads.flight(vehicle, Gains.from_parameters(parameters), plan.flight)
            problem = admissible.problem
            contenders = {
                BASELINE: baseline(problem),
                'exact': method(partial(make_allocator, 'exact', vehicle)),
                **({rival: peer(rival, problem)} if rival else {}),
            }
            judge = Judge(problem, wrenches)
            tracks.update({(name, n): each.track(judge) for name, each in contenders.items()})
        found[load] = dict(_compete(tracks, plan, seed, 'rotors'))
    return found


def _compete(
    tracks: Mapping[tuple[str, int], Track], plan: Plan, seed: int, what: str
) -> list[tuple[str, dict[str, Any]]]:
    """Return what benchmark.json holds of each contender by number of rotors."""
    rows = measure(tracks, plan, seed, what)
    means = rows.pivot(index='repetition', columns=['contender', 'rotors'], values='mean').reindex(
        range(plan.repetitions)
    )
    found: dict[str, dict[str, Any]] = {}
    for (name, n), own in rows.groupby(['contender', 'rotors'], sort=False):
        mean = means[name, n]
        found.setdefault(name, {})[str(n)] = {
            'mean': spread(mean),
            'p99': spread(own['p99']),
            'ratio': spread(mean / means[BASELINE, n]),
            'repetitions': [None if each != each else each for each in mean.tolist()],
            **verdict(
                own[['error', 'violation', 'norm_excess', 'failures']].max(),
                int(tracks[name, n].judge.attainable.sum()),
            ),
        }
    return list(found.items())


def _repeated(times: pd.Series) -> dict[str, Any]:
    return {**spread(times), 'repetitions': times.tolist()}


def fastest_correct_peer(
    contenders: Mapping[str, Contender], calls: Mapping[str, Mapping[str, Any]]
) -> str | None:
    """Return the fastest peer whose answers to uniform wrenches are right; None if none is."""
    found = {
        name: calls['uniform'][name]['mean']['median']
        for name, contender in contenders.items()
        if contender.kind == 'peer' and calls['uniform'][name]['correct']
    }
    return min(found, key=found.__getitem__) if found else None


def time_batches(
    admissible: AdmissibleSet,
    allocators: Mapping[str, Allocator],
    rival: Contender | None,
    plan: Plan,
    seed: int,
) -> dict[str, Any]:
    """Return times per uniform wrench: of `exact` for all sizes of batches.

    The other allocators are given the smallest size alone; the rival is called in a loop.
    """
    sizes, problem = plan.batches, admissible.problem
    wrenches = admissible.sample(np.random.default_rng(seed), max(sizes))
    least, whole = min(sizes), max(sizes)
    jobs: dict[str, Callable[[], Any]] = {}
    amounts: dict[str, int] = {}
    for name, allocator in allocators.items():
        mine = _affordable(allocator, wrenches, least)
        for size, count in sizes.items() if name == 'exact' else ((mine, 1),):
            jobs[f'{name} {size}'] = partial(_batches, allocator, wrenches, size, count)
            amounts[f'{name} {size}'] = size * count
    if rival is not None:
        amounts['loop'] = min(plan.looped, len(wrenches))
        jobs['loop'] = partial(_loop, rival, wrenches[: amounts['loop']], problem.n)
    times = rounds(jobs, plan.rounds, seed, 'batches') / pd.Series(amounts)
    checked = wrenches[:CHECKED]
    answers = list(allocators['exact'].allocate_batch(checked).thrusts)
    found: dict[str, Any] = {
        'wrenches': amounts,
        'time': {name: _repeated(own) for name, own in times.items()},
        'linearity': {
            str(size): spread(times[f'exact {size}'] / times[f'exact {least}'])
            for size in sizes
            if size != least
        },
        'largest': whole,
        'correct': verdict(Judge(problem, checked).worst(answers), len(checked))['correct'],
    }
    if rival is not None:
        found['speedup'] = spread(times['loop'] / times[f'exact {whole}'])
    return found


def _affordable(allocator: Allocator, wrenches: Array, size: int) -> int:
    """Return the size of a method's batch; also runs one, which fills its caches."""
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


def time_flights(
    allocator: Allocator, gains: Gains, wrenches: Array, plan: Plan, seed: int
) -> dict[str, Any]:
    """Return the time of an offline flight to the paper's waypoint, `plan.duration` long.

    The unit is `UNIT` calls of the clipped pseudo-inverse on wrenches (W, m) [N, N m].
    """
    vehicle = allocator.problem.vehicle
    controller, body = Controller(vehicle, gains), RigidBody(vehicle)
    waypoint, step = loads.WAYPOINTS[0], loads.TIME_STEP
    clip = baseline(allocator.problem).call
    rows = [wrenches[i % len(wrenches)] for i in range(UNIT)]
    flights: list[Flight] = []

    def flight() -> None:
        flights[:] = [fly(controller, allocator, body, waypoint, plan.duration, step)]

    def clips() -> None:
        for _ in range(UNITS):
            for u in rows:
                clip(u)

    flight()
    times = rounds({'flight': flight, 'clips': clips}, plan.rounds, seed, 'closed loop')
    units = times['clips'] / UNITS
    return {
        'duration': plan.duration,
        'steps': len(flights[0].time),
        'final_error': flights[0].position_error(waypoint),
        'time': _repeated(times['flight']),
        'unit': _repeated(units),
        'ratio': spread(times['flight'] / units),
    }
