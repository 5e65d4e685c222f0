"""The part of a benchmark that times set-ups, and what a node does when the health changes."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pandas as pd

from ca_ros.allocation.options import allocator_from_parameters
from ca_ros.evaluation.benchmark import loads
from ca_ros.evaluation.benchmark.plan import Plan
from ca_ros.evaluation.benchmark.timing import Key, rounds
from ca_ros.problem.audit import accept
from ca_ros.problem.vehicle_problem import VehicleProblem
from ca_ros.schema import complete
from ca_ros.vehicle.parameters import VEHICLE
from ca_ros.vehicle.values import per_rotor
from ca_ros.vehicle.vehicle import Vehicle

ROTORS = 16
"""Number of rotors of the vehicles."""

HEALTH = 'rotors.health'

_Cases = list[tuple[dict[str, Any], Vehicle]]
"""Parameters, and their vehicle."""


def _set_up(cases: _Cases) -> None:
    for parameters, vehicle in cases:
        allocator_from_parameters(parameters, VehicleProblem(vehicle))


def _audited(cases: _Cases) -> None:
    for parameters, vehicle in cases:
        allocator_from_parameters(parameters, accept(vehicle, 'drop').problem)


def _change(cases: _Cases) -> None:
    for parameters, vehicle in cases:
        changed = complete(parameters, {HEALTH: VEHICLE[HEALTH]})
        health = per_rotor(changed, HEALTH, vehicle.n)
        report = accept(vehicle.with_health(health), 'drop')
        allocator_from_parameters(parameters, report.problem)


SETUPS: dict[str, tuple[str, Callable[[_Cases], None]]] = {
    'set-up': ('set-up of `exact` for a vehicle', _set_up),
    'audit and set-up': ('audit of the vehicle and set-up of `exact`', _audited),
    'change of health': ('change of health in a node, from its parameters on', _change),
}
"""What is timed by name, in words and as a function."""


def time_setups(plan: Plan, seed: int) -> pd.DataFrame:
    """Return rows of `rounds`: times of `SETUPS` for vehicles of four and of six axes.

    Each time another rotor has failed.
    """
    jobs: dict[Key, tuple[Callable[[], Any], float]] = {}
    for axes, parameters in ((4, loads.ring(ROTORS)), (6, loads.tilted_ring(ROTORS))):
        health = 1.0 - np.eye(ROTORS)
        changed = [{**parameters, 'rotors.health': each} for each in health.tolist()]
        cases = [(each, Vehicle.from_parameters(each)) for each in changed]
        for name, (_, work) in SETUPS.items():
            # The first time fills caches and is not timed.
            work(cases)
            key = Key('set-up', f'{axes} axes', name, ROTORS)
            jobs[key] = partial(work, cases), len(cases)
    return rounds(jobs, plan.rounds, seed)
