"""The parts of a benchmark: calls, number of rotors, batches, closed loop."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np
import pandas as pd

from ca_ros.allocation import Allocator
from ca_ros.arrays import Array
from ca_ros.evaluation.benchmark import loads
from ca_ros.evaluation.benchmark.contenders import BASELINE, CONTENDERS, EXACT
from ca_ros.evaluation.benchmark.peers import Call
from ca_ros.evaluation.benchmark.plan import Plan
from ca_ros.evaluation.benchmark.timing import Key, measure, rounds
from ca_ros.evaluation.judge import Judge
from ca_ros.flight.closed_loop import fly
from ca_ros.flight.controller import Controller
from ca_ros.flight.record import Flight
from ca_ros.flight.rigid_body import RigidBody
from ca_ros.problem.problem import AllocationProblem
from ca_ros.problem.vehicle_problem import VehicleProblem
from ca_ros.vehicle.vehicle import Vehicle

UNIT, UNITS = 1000, 20
"""Calls of the baseline in the unit of the closed loop, and units in a repetition."""

TWO_CORES = ', two cores'
"""What the load of a batch on two cores ends with; others are on one."""


def time_calls(
    problem: AllocationProblem,
    calls: Mapping[str, Call],
    wrenches: Mapping[str, Array],
    plan: Plan,
    seed: int,
    part: str = 'calls',
) -> pd.DataFrame:
    """Return rows of `measure` for each load, wrenches (W, m) [N, N m]."""
    parts = []
    for load, demands in wrenches.items():
        tracks = {Key(part, load, name, problem.n): call for name, call in calls.items()}
        judges = dict.fromkeys(tracks, Judge(problem, demands))
        parts.append(measure(tracks, judges, plan, seed))
    return pd.concat(parts)


def time_rotors(plan: Plan, rival: str | None, seed: int) -> pd.DataFrame:
    """Return rows of `measure` of the baseline, `exact` and a peer by number of rotors."""
    contenders = {BASELINE: CONTENDERS[BASELINE], 'exact': EXACT}
    contenders |= {rival: CONTENDERS[rival]} if rival else {}
    calls: dict[Key, Call] = {}
    judges: dict[Key, Judge] = {}
    for n in plan.rotors:
        parameters = loads.ring(n)
        problem = VehicleProblem(Vehicle.from_parameters(parameters))
        for load, wrenches in loads.drawn(parameters, problem, plan, seed).items():
            own = {Key('rotors', load, name, n): each for name, each in contenders.items()}
            calls |= {key: each.call(problem) for key, each in own.items()}
            judges |= dict.fromkeys(own, Judge(problem, wrenches))
    return pd.concat(
        measure({key: calls[key] for key in calls if key.load == load}, judges, plan, seed)
        for load in loads.LOADS
    )


def time_batches(
    wrenches: Array,
    allocators: Mapping[str, Allocator],
    rival: tuple[str, Call] | None,
    plan: Plan,
    seed: int,
) -> pd.DataFrame:
    """Return rows of `rounds`: times per wrench, of `exact` for all sizes of batches.

    The other allocators get the smallest size alone; the rival is called in a loop.  All run on
    one core; if there are two, the greatest size also on two.
    """
    sizes, n = plan.batches, allocators['exact'].problem.n
    jobs: dict[Key, tuple[Callable[[], Any], float]] = {}
    for name, allocator in allocators.items():
        # The first batch fills caches and is not timed.
        allocator.allocate_batch(wrenches[: min(sizes)])
        for size, count in (sizes if name == 'exact' else {min(sizes): 1}).items():
            job = partial(_batches, allocator, wrenches, size, count)
            jobs[Key('batches', str(size), name, n)] = partial(_on, 1, job), size * count
            if name == 'exact' and size == max(sizes) and len(os.sched_getaffinity(0)) > 1:
                key = Key('batches', f'{size}{TWO_CORES}', name, n)
                jobs[key] = partial(_on, 2, job), size * count
    if rival is not None:
        name, call = rival
        job = partial(_loop, call, wrenches[: plan.looped], n)
        jobs[Key('batches', 'one by one', name, n)] = partial(_on, 1, job), plan.looped
    return rounds(jobs, plan.rounds, seed)


def _on(cores: int, job: Callable[[], Any]) -> None:
    """Do a job on some of the cores that the process may use."""
    allowed = os.sched_getaffinity(0)
    os.sched_setaffinity(0, sorted(allowed)[-cores:])
    try:
        job()
    finally:
        os.sched_setaffinity(0, allowed)


def _batches(allocator: Allocator, wrenches: Array, size: int, count: int) -> None:
    for first in range(0, size * count, size):
        allocator.allocate_batch(wrenches[first : first + size])


def _loop(call: Call, wrenches: Array, n: int) -> None:
    thrusts = np.full((len(wrenches), n), np.nan)
    for i, u in enumerate(wrenches):
        answer = call(u)
        if answer is not None:
            thrusts[i] = answer


def time_flights(
    controller: Controller, allocator: Allocator, wrenches: Array, plan: Plan, seed: int
) -> tuple[pd.DataFrame, Flight]:
    """Return rows of `rounds` for an offline flight to the paper's waypoint, and the flight.

    The baseline's time is that of `UNIT` calls on wrenches (W, m) [N, N m].
    """
    problem = allocator.problem
    loop = controller, allocator, RigidBody(controller.vehicle)
    flight = partial(fly, *loop, loads.WAYPOINTS[0], plan.duration, loads.TIME_STEP)
    call = CONTENDERS[BASELINE].call(problem)
    units = [wrenches[i % len(wrenches)] for i in range(UNIT)] * UNITS
    load = f'{plan.duration:g} s'
    jobs: dict[Key, tuple[Callable[[], Any], float]] = {
        Key('closed loop', load, 'exact', problem.n): (flight, 1),
        Key('closed loop', load, BASELINE, problem.n): (lambda: [call(u) for u in units], UNITS),
    }
    # The first flight fills caches and is not timed.
    flown = flight()
    return rounds(jobs, plan.rounds, seed), flown
