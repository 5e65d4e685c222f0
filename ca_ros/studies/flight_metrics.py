"""What a flight to a waypoint is worth, in numbers."""

from __future__ import annotations

from typing import Any

import numpy as np

from ca_ros.allocation_problem import AllocationProblem
from ca_ros.arrays import Array, BoolArray
from ca_ros.controller import Controller, Waypoint
from ca_ros.flight import Flight
from ca_ros.studies.evaluation import FORCES

STEADY = 1.0
"""The last second of a flight is taken for the steady state [s]."""

SETTLED = 0.02
"""Share of the step within which a quantity has settled."""

AT_BOUND = 1e-3
"""Share of a rotor's range of speeds within which it is at a bound."""


def steady(flight: Flight) -> BoolArray:
    """Return which samples (K,) count as the steady state."""
    return flight.time >= flight.time[-1] - STEADY


def at_bounds(flight: Flight, problem: AllocationProblem) -> tuple[BoolArray, BoolArray]:
    """Return which rotors are at their minimum, and which at their maximum, (K, n) each."""
    low, high = problem.vehicle.speeds(problem.lower), problem.vehicle.speeds(problem.upper)
    near = AT_BOUND * (high - low)
    return flight.speeds <= low + near, flight.speeds >= high - near


def metrics(flight: Flight, controller: Controller, waypoint: Waypoint) -> dict[str, Any]:
    """Return the figures of a flight by name.

    Parameters
    ----------
    flight : Flight
    controller : Controller
        That flew it: the wrenches that it asked for follow from the samples.
    waypoint : Waypoint

    Returns
    -------
    dict
        ``steady_state_error`` (mean of waypoint minus value), ``settling_time`` (None if it never
        settles) and ``overshoot`` (share of the step) by axis; ``effort``, the integral of |f|^2
        [N^2 s]; ``time_at_bound``, the share of the rotors' time; ``worst_force_residual`` [N] and
        ``worst_torque_residual`` [N m].
    """
    problem = controller.admissible.problem
    heading = flight.euler[:, 2]
    values = dict(zip('xyz', flight.position.T, strict=True)) | {'yaw': heading}
    goals = dict(zip('xyz', waypoint.position, strict=True)) | {'yaw': waypoint.heading}
    ways = {name: (goals[name] - values[name], goals[name] - values[name][0]) for name in values}
    thrusts = problem.vehicle.thrusts(flight.speeds)
    # A sample's thrusts act until the next sample; those of the last one no more.
    effort = (np.square(thrusts[:-1]).sum(axis=1) * np.diff(flight.time)).sum()
    residual = demands(flight, controller, waypoint) - thrusts @ problem.gamma.T
    force = np.array([axis in FORCES for axis in problem.axes])
    low, high = at_bounds(flight, problem)
    return {
        'steady_state_error': {
            name: float(left[steady(flight)].mean()) for name, (left, _) in ways.items()
        },
        'settling_time': {
            name: _settling_time(flight.time, left, step) for name, (left, step) in ways.items()
        },
        'overshoot': {
            name: max(float((-left / step).max()), 0.0) if step else 0.0
            for name, (left, step) in ways.items()
        },
        'effort': float(effort),
        'time_at_bound': float((low | high).mean()),
        'worst_force_residual': float(np.linalg.norm(residual[:, force], axis=1).max()),
        'worst_torque_residual': float(np.linalg.norm(residual[:, ~force], axis=1).max()),
    }


def demands(flight: Flight, controller: Controller, waypoint: Waypoint) -> Array:
    """Return the wrenches (K, m) that the controller asked for [N, N m]."""
    samples = zip(
        flight.position, flight.attitude, flight.velocity, flight.angular_velocity, strict=True
    )
    return np.array([controller.wrench(*sample, waypoint) for sample in samples])


def _settling_time(time: Array, left: Array, step: float) -> float | None:
    outside = np.flatnonzero(np.abs(left) > SETTLED * abs(step))
    if len(outside) == 0:
        return 0.0
    return float(time[outside[-1] + 1]) if outside[-1] + 1 < len(time) else None
