"""The parts of a benchmark: calls, number of rotors, batches, set-ups."""

import os
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np
import pandas as pd

from benchmarks.answers import Answers
from benchmarks.contenders import BASELINE, CONTENDERS, EXACT, set_up
from benchmarks.peers import Call
from benchmarks.sizes import Sizes
from benchmarks.timing import Jobs, Key, measure, rounds
from benchmarks.wrenches import flown, ring
from ca_ros.allocation.exact import Exact
from ca_ros.arrays import Array
from ca_ros.control.controller_settings import ControllerSettings
from ca_ros.problem.admissible_set import AdmissibleSet
from ca_ros.problem.audit import accept
from ca_ros.problem.problem import AllocationProblem
from ca_ros.problem.vehicle_problem import VehicleProblem
from ca_ros.settings import read
from ca_ros.studies.cases import Case
from ca_ros.studies.wrench_sets import near_boundary, samples
from ca_ros.vehicle.vehicle import Vehicle

ROTORS, TILT = 16, float(np.radians(25.0))  # of set-ups; their tilt for six axes [rad]

SETS = {
    'uniform': 'uniform by volume in the admissible set',
    'boundary': 'near the boundary of the admissible set: a third on it, to rounding, a third '
    'inside and a third outside, by 1e-3, 1e-6 or 1e-9 of the distance from the centre',
    'flight': 'the successive commands of the controller in a flight to four waypoints in turn, '
    'three of which are so far away that rotors saturate',
}


FAR = 'hexarotor', 'hexarotor_tilted', 'octorotor', 'x8', 'y6'
"""Vehicles that get wrenches far outside of their sets."""

SIDES = 'inside', 'on', 'outside'
"""The thirds of the wrenches near the boundary."""


def drawn(
    parameters: Mapping[str, Any], problem: AllocationProblem, sizes: Sizes, seed: int
) -> dict[str, Array]:
    """Return the wrenches (W, m) of each of `SETS` [N, N m]; a problem has no flight."""
    admissible, rng = AdmissibleSet(problem), np.random.default_rng
    found = {
        'uniform': admissible.sample(rng(seed), sizes.wrenches),
        'boundary': near_boundary(admissible, rng(seed), sizes.wrenches),
    }
    if isinstance(problem, VehicleProblem):
        gains = read(ControllerSettings, parameters, 'controller.')
        found['flight'] = flown(problem.vehicle, gains, sizes.flight)
    return found


def by_side(
    problem: AllocationProblem, sets: Mapping[str, Array], sizes: Sizes, seed: int
) -> dict[str, Array]:
    """Return the sets, with as many wrenches on each side of the boundary in place of one."""
    found = {kind: wrenches for kind, wrenches in sets.items() if kind != 'boundary'}
    size, rng = len(SIDES) * sizes.wrenches, np.random.default_rng(seed)
    near = near_boundary(AdmissibleSet(problem), rng, size)
    return found | {side: near[i :: len(SIDES)] for i, side in enumerate(SIDES)}


def time_calls(
    problem: AllocationProblem, calls: Mapping[str, Call], sets: Mapping[str, Array], sizes: Sizes,
    seed: int, part: str = 'calls',
) -> pd.DataFrame:
    """Return rows of `measure` for each set of wrenches."""
    parts = []
    for kind, wrenches in sets.items():
        keyed = {Key(part, kind, name, problem.n): call for name, call in calls.items()}
        checks = dict.fromkeys(keyed, Answers(problem, wrenches))
        parts.append(measure(keyed, checks, sizes, seed))
    return pd.concat(parts)


def time_rotors(rival: str | None, sizes: Sizes, seed: int) -> pd.DataFrame:
    """Return rows of `measure` of the baseline, `exact` and a peer by number of rotors."""
    contenders = {BASELINE: CONTENDERS[BASELINE], 'exact': EXACT}
    contenders |= {rival: CONTENDERS[rival]} if rival else {}
    calls: dict[str, dict[Key, Call]] = {kind: {} for kind in SETS}
    checks: dict[Key, Answers] = {}
    for n in sizes.rotors:
        parameters = ring(n)
        problem = VehicleProblem(Vehicle.from_parameters(parameters))
        for kind, wrenches in drawn(parameters, problem, sizes, seed).items():
            own = {Key('rotors', kind, name, n): each for name, each in contenders.items()}
            calls[kind] |= {key: each.call(problem) for key, each in own.items()}
            checks |= dict.fromkeys(own, Answers(problem, wrenches))
    return pd.concat(measure(own, checks, sizes, seed) for own in calls.values())


def time_unattainable(sizes: Sizes, seed: int) -> pd.DataFrame:
    """Return rows of `measure` of `exact` and of hierarchical DAQP, by vehicle.

    The wrenches are up to twice as far from the centre as the boundary.
    """
    calls: dict[Key, Call] = {}
    checks: dict[Key, Answers] = {}
    contenders = {'exact': EXACT, 'daqp_hierarchical': CONTENDERS['daqp_hierarchical']}
    for name in FAR:
        problem = VehicleProblem(Vehicle.load(name))
        wrenches = samples(AdmissibleSet(problem), 'outside', seed, 0, min(1000, sizes.wrenches))
        found, _ = set_up(contenders, problem)
        own = {Key('unattainable', name, each, problem.n): call for each, call in found.items()}
        calls |= own
        checks |= dict.fromkeys(own, Answers(problem, wrenches))
    return measure(calls, checks, sizes, seed)


def time_batches(
    case: Case, rival: str | None, call: Call | None, sizes: Sizes, seed: int
) -> pd.DataFrame:
    """Return rows of `rounds`: times per wrench of batches of `exact`, and of a peer in a loop.

    All run on one core; if there are more, the greatest size also on two.
    """
    admissible, exact = AdmissibleSet(case.problem), case.allocator('exact')
    n, largest = case.problem.n, max(sizes.batches)
    wrenches = admissible.sample(np.random.default_rng(seed), largest)
    # The first batch fills caches and is not timed.
    exact.allocate_batch(wrenches[: min(sizes.batches)])

    def batches(size: int, count: int) -> None:
        for first in range(0, size * count, size):
            exact.allocate_batch(wrenches[first : first + size])

    jobs: Jobs = {}
    for size, count in sizes.batches.items():
        two = size == largest and len(os.sched_getaffinity(0)) > 1
        for cores, words in enumerate(('', ', two cores')[: 1 + two], 1):
            job = partial(_on, cores, partial(batches, size, count))
            jobs[Key('batches', f'{size}{words}', 'exact', n)] = job, size * count
    if rival is not None and call is not None:
        part = wrenches[: sizes.looped]
        thrusts = np.empty((len(part), n))

        def loop() -> None:
            for row, u in zip(thrusts, part, strict=True):
                row[:] = call(u)

        jobs[Key('batches', 'one by one', rival, n)] = partial(_on, 1, loop), len(part)
    return rounds(jobs, sizes.rounds, seed)


def _on(cores: int, job: Callable[[], Any]) -> None:
    """Do a job on some of the cores that the process may use."""
    allowed = os.sched_getaffinity(0)
    os.sched_setaffinity(0, sorted(allowed)[-cores:])
    try:
        job()
    finally:
        os.sched_setaffinity(0, allowed)


def time_setups(sizes: Sizes, seed: int) -> pd.DataFrame:
    """Return rows of `rounds`: times of audit and set-up of `exact` after each rotor's failure."""
    jobs: Jobs = {}
    for axes, parameters in ((4, ring(ROTORS)), (6, ring(ROTORS, TILT))):
        vehicle = Vehicle.from_parameters(parameters)
        vehicles = [vehicle.with_health(health) for health in 1.0 - np.eye(ROTORS)]
        job = partial(_set_up, vehicles)
        # The first time fills caches and is not timed.
        job()
        jobs[Key('set-up', f'{axes} axes', 'exact', ROTORS)] = job, len(vehicles)
    return rounds(jobs, sizes.rounds, seed)


def _set_up(vehicles: list[Vehicle]) -> None:
    for vehicle in vehicles:
        Exact(accept(vehicle, 'drop').independent)
