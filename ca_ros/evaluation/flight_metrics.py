"""What a flight to a waypoint is worth, in numbers."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ca_ros.arrays import Array, BoolArray
from ca_ros.evaluation.judge import FORCES
from ca_ros.flight.closed_loop import Change
from ca_ros.flight.controller import Controller
from ca_ros.flight.record import Flight
from ca_ros.flight.rigid_body import difference
from ca_ros.flight.waypoint import Waypoint
from ca_ros.problem.admissible_set import AdmissibleSet
from ca_ros.problem.problem import AllocationProblem
from ca_ros.vehicle.effectiveness import control_allocation_matrix
from ca_ros.vehicle.vehicle import Vehicle

STEADY = 1.0
"""The last second of a flight is taken for the steady state [s]."""

SETTLED = 0.02
"""Share of the step within which a quantity has settled."""

WHOLE = slice(None)
"""All samples of a flight."""

AT_BOUND = 1e-3
"""Share of a rotor's range of speeds within which it is at a bound."""


def steady(flight: Flight) -> BoolArray:
    """Return which samples (K,) count as the steady state."""
    return flight.time >= flight.time[-1] - STEADY


def at_bounds(
    flight: Flight, problem: AllocationProblem, part: slice = WHOLE
) -> tuple[BoolArray, BoolArray]:
    """Return which rotors are at their minimum, and which at their maximum, (K, n) each."""
    low, high = problem.vehicle.speeds(problem.lower), problem.vehicle.speeds(problem.upper)
    near = AT_BOUND * (high - low)
    speeds = flight.speeds[part]
    return speeds <= low + near, speeds >= high - near


def metrics(
    flight: Flight, controller: Controller, waypoint: Waypoint, changes: Sequence[Change] = ()
) -> dict[str, Any]:
    """Return the metrics of a flight by name.

    Parameters
    ----------
    flight : Flight
    controller : Controller
        That flew it: the wrenches that it asked for follow from the samples.
    waypoint : Waypoint
    changes : sequence of Change
        What changed in flight: rotors that failed, and what became known of that.

    Returns
    -------
    dict
        ``steady_state_error`` (mean of waypoint minus value), ``settling_time`` (None if it never
        settles) and ``overshoot`` (share of the step) by axis; ``effort``, the integral of |f|^2
        [N^2 s]; ``time_at_bound``, the share of the rotors' time; ``worst_force_residual`` [N] and
        ``worst_torque_residual`` [N m]; and ``greatest_tilt`` [rad].
    """
    left = waypoint.position - flight.position
    ways = {name: (left[:, i], float(left[0, i])) for i, name in enumerate('xyz')}
    turn = difference(waypoint.heading, flight.heading)
    ways['yaw'] = turn, float(turn[0])
    # Of no rotors that can move, none is at a bound.
    effort, force, torque, bound = 0.0, 0.0, 0.0, [np.zeros(0, bool)]
    intervals = np.append(np.diff(flight.time), 0.0)
    for part, pilot, vehicle in legs(flight, controller, changes):
        thrusts = vehicle.thrusts(flight.speeds[part])
        # A sample's thrusts act until the next sample; those of the last one no more.
        effort += float((np.square(thrusts).sum(axis=1) * intervals[part]).sum())
        given = thrusts @ control_allocation_matrix(pilot.vehicle).T
        residual = demands(flight, pilot, waypoint, part) - given
        forces = np.array([axis in FORCES for axis in pilot.vehicle.axes])
        force = max(force, _longest(residual[:, forces]))
        torque = max(torque, _longest(residual[:, ~forces]))
        low, high = at_bounds(flight, pilot.problem, part)
        bound.append((low | high)[:, pilot.problem.upper > pilot.problem.lower].ravel())
    return {
        'steady_state_error': {
            name: float(left[steady(flight)].mean()) for name, (left, _) in ways.items()
        },
        'settling_time': {
            name: _settling_time(flight.time, left, step) for name, (left, step) in ways.items()
        },
        'overshoot': {
            name: max(0.0, float((-left / step).max())) if step else 0.0
            for name, (left, step) in ways.items()
        },
        'effort': effort,
        'time_at_bound': float(np.concatenate(bound).sum()) / max(1, sum(map(len, bound))),
        'worst_force_residual': force,
        'worst_torque_residual': torque,
        'greatest_tilt': float(flight.tilt.max()),
    }


def legs(
    flight: Flight, controller: Controller, changes: Sequence[Change] = ()
) -> Iterator[tuple[slice, Controller, Vehicle]]:
    """Return the parts of a flight between its changes.

    Yields
    ------
    (slice, Controller, Vehicle)
        Samples, the controller in charge, and the vehicle as it physically is.
    """
    vehicle, start = controller.vehicle, 0
    times = np.round(flight.time * 1e9)
    for change in [*sorted(changes, key=lambda change: change.time), None]:
        end = len(times) if change is None else int(np.searchsorted(times, change.time))
        if end > start:
            yield slice(start, end), controller, vehicle
        start = end
        if change is not None:
            controller = change.controller or controller
            vehicle = change.body.vehicle if change.body else vehicle


def demands(
    flight: Flight, controller: Controller, waypoint: Waypoint, part: slice = WHOLE
) -> Array:
    """Return the wrenches (K, m) that the controller asked for [N, N m]."""
    samples = zip(
        flight.position[part],
        flight.attitude[part],
        flight.velocity[part],
        flight.angular_velocity[part],
        strict=True,
    )
    return np.array([controller.wrench(*sample, waypoint) for sample in samples])


def margins(
    flight: Flight, controller: Controller, waypoint: Waypoint, changes: Sequence[Change] = ()
) -> Array:
    """Return the margin (K,) of the commanded wrenches in the admissible set [N, N m].

    The set is that of the rotors as they physically are, and of the axes that these command;
    NaN where it has no volume.
    """
    found = np.full(len(flight.time), np.nan)
    for part, pilot, vehicle in legs(flight, controller, changes):
        axes = tuple(axis for axis in vehicle.axes if axis in pilot.vehicle.axes)
        rows = [pilot.vehicle.axes.index(axis) for axis in axes]
        try:
            admissible = AdmissibleSet(replace(vehicle, axes=axes))
        except ValueError:
            continue
        found[part] = admissible.margin(demands(flight, pilot, waypoint, part)[:, rows])
    return found


def torque_errors(
    flight: Flight, controller: Controller, waypoint: Waypoint, changes: Sequence[Change] = ()
) -> Array:
    """Return the length (K,) of the difference of commanded and delivered torque [N m]."""
    found = []
    for part, pilot, vehicle in legs(flight, controller, changes):
        given = vehicle.thrusts(flight.speeds[part]) @ control_allocation_matrix(pilot.vehicle).T
        torques = [axis not in FORCES for axis in pilot.vehicle.axes]
        missed = (demands(flight, pilot, waypoint, part) - given)[:, torques]
        found.append(np.linalg.norm(missed, axis=1))
    return np.concatenate(found)


def _longest(vectors: Array) -> float:
    return float(np.linalg.norm(vectors, axis=1).max(initial=0.0))


def _settling_time(time: Array, left: Array, step: float) -> float | None:
    outside = np.flatnonzero(np.abs(left) > SETTLED * abs(step))
    if len(outside) == 0:
        return 0.0
    return float(time[outside[-1] + 1]) if outside[-1] + 1 < len(time) else None
