"""Time of a flight in the offline closed loop, in units of the clipped pseudo-inverse."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from ca_ros.allocation import Allocator
from ca_ros.arrays import Array
from ca_ros.evaluation.benchmark.contenders import baseline
from ca_ros.evaluation.benchmark.loads import TIME_STEP, WAYPOINTS
from ca_ros.evaluation.benchmark.plan import Plan
from ca_ros.evaluation.benchmark.timing import ratios, rounds, spread
from ca_ros.flight.closed_loop import fly
from ca_ros.flight.controller import Controller, Gains
from ca_ros.flight.record import Flight
from ca_ros.flight.rigid_body import RigidBody

UNIT = 1000
"""Calls of the clipped pseudo-inverse that are the unit."""

UNITS = 20
"""How many of them are timed at a time."""


def time_flights(
    allocator: Allocator,
    gains: Gains,
    wrenches: Array,
    plan: Plan,
    seed: int,
    progress: Callable[[], Any],
) -> dict[str, Any]:
    """Return the time of a flight to the paper's waypoint, `plan.duration` long.

    Parameters
    ----------
    allocator : Allocator
    gains : Gains
    wrenches : (W, m) array
        For the clipped pseudo-inverse [N, N m].
    plan : Plan
    seed : int
    progress : callable
        Called after each repetition.
    """
    vehicle = allocator.problem.vehicle
    controller, body = Controller(vehicle, gains), RigidBody(vehicle)
    clip = baseline(allocator.problem).call
    rows = [wrenches[i % len(wrenches)] for i in range(UNIT)]
    flights: list[Flight] = []

    def flight() -> None:
        flights[:] = [fly(controller, allocator, body, WAYPOINTS[0], plan.duration, TIME_STEP)]

    def clips() -> None:
        for _ in range(UNITS):
            for u in rows:
                clip(u)

    flight()
    times = rounds({'flight': flight, 'clips': clips}, plan.rounds, seed, progress)
    units = [time / UNITS for time in times['clips']]
    return {
        'duration': plan.duration,
        'steps': len(flights[0].time),
        'final_error': flights[0].position_error(WAYPOINTS[0]),
        'time': {**spread(times['flight']), 'repetitions': times['flight']},
        'unit': {**spread(units), 'repetitions': units},
        'ratio': spread(ratios(times['flight'], units)),
    }
