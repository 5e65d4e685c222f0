"""Metrics of a flight to a waypoint, and the flights of a dynamic study."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pandas as pd

from ca_ros.allocation import AtRest
from ca_ros.arrays import Array, BoolArray
from ca_ros.control.controller import Controller
from ca_ros.control.trajectory import Trajectory
from ca_ros.control.waypoint import Waypoint
from ca_ros.problem.admissible_set import AdmissibleSet
from ca_ros.problem.audit import audit
from ca_ros.problem.problem import AllocationProblem
from ca_ros.simulation.closed_loop import Change, Pilot
from ca_ros.simulation.record import Flight
from ca_ros.simulation.rotor_failures import RotorFailures
from ca_ros.solver.zonotope import CHOICES_MAX
from ca_ros.studies.wrench_metrics import energy
from ca_ros.vehicle.effectiveness import produced
from ca_ros.vehicle.settings import unit
from ca_ros.vehicle.state import difference
from ca_ros.vehicle.vehicle import Vehicle

STEADY = 1.0  # the last second of a flight counts as the steady state [s]
TURNING = 0.1  # rate of the heading above which it has no steady state [rad/s]
SETTLED = 0.02  # share of the step within which a quantity has settled

RECOVERED = 0.3  # greatest distance from the waypoint at the end of a recovery [m]
AT_BOUND = 1e-3  # share of a rotor's range of speeds within which it is at a bound


def steady(flight: Flight) -> BoolArray:
    """Return which samples (K,) count as the steady state."""
    return flight.time >= flight.time[-1] - STEADY


def heading_rate(flight: Flight) -> float:
    """Return the mean rate of the heading in the steady state [rad/s]."""
    last = steady(flight)
    time, heading = flight.time[last], np.unwrap(flight.heading[last])
    return float((heading[-1] - heading[0]) / max(time[-1] - time[0], 1e-9))


def at_bounds(speeds: Array, vehicle: Vehicle) -> tuple[BoolArray, BoolArray]:
    """Return which rotors are at their minimum, and which at their maximum, (K, n) each."""
    low, high = vehicle.speed_limits
    near = AT_BOUND * (high - low)
    return speeds <= low + near, speeds >= high - near


def sample_errors(
    flight: Flight, controller: Controller, waypoint: Waypoint, changes: Sequence[Change] = (),
    vehicle: Vehicle | None = None, failures: RotorFailures | None = None,
) -> pd.DataFrame:
    """Compare the commanded wrenches of a flight with the delivered ones.

    The controller recomputes the commands from the samples.  The flight begins with the waypoint;
    the changes are later waypoints, and announcements of failures.  The vehicle is the one that
    flies, by default that of the controller, and its rotors fail.

    Returns one row per sample: ``force_error`` [N] and ``torque_error`` [N m], the lengths of
    commanded minus delivered; ``margin`` [N, N m] of the commanded wrench in the admissible set of
    the rotors as they physically are, NaN where that set has no volume, and for rotors that tilt;
    ``thrusts_squared``, |f|^2 [N^2]; ``energy``, the sum of |f|^1.5 [N^1.5]; ``change``, the sum
    of |change of thrust| over the rotors since the previous sample [N]; ``goal_height`` of the
    waypoint [m]; ``movable`` and ``at_bound``: how many rotors can move, and are at a bound; of
    each axis ``demand_*``, ``served_*`` and ``residual_*`` [N, N m], NaN where it is given up.
    """
    parts, given = [], []
    start = vehicle or controller.vehicle
    whole = flight.position, flight.attitude, flight.velocity, flight.angular_velocity
    failed = RotorFailures() if failures is None else failures
    legs = _legs(flight, controller, start, waypoint, changes, failed)
    for part, pilot, vehicle, goal in legs:
        times = np.round(flight.time[part] * 1e9).astype(int).tolist()
        states = zip(*(values[part] for values in whole), times, strict=True)
        commanded = np.array([pilot.wrench(p, q, v, w, goal, t) for p, q, v, w, t in states])
        thrusts, axes = vehicle.thrusts(flight.speeds[part]), pilot.vehicle.axes
        residual = commanded - produced(pilot.vehicle, thrusts, flight.angles[part])
        forces = np.array([unit(axis) == 'N' for axis in axes])
        low, high = at_bounds(flight.speeds[part], pilot.vehicle)
        movable = np.greater(*reversed(pilot.vehicle.speed_limits))
        columns = {
            'force_error': np.linalg.norm(residual[:, forces], axis=1),
            'torque_error': np.linalg.norm(residual[:, ~forces], axis=1),
            'margin': _margin(vehicle, axes, commanded),
            'thrusts_squared': np.square(thrusts).sum(axis=1), 'energy': energy(thrusts),
            'goal_height': float(goal.position[2]), 'movable': movable.sum(),
            'at_bound': (low | high)[:, movable].sum(axis=1),
        }
        for k, axis in enumerate(axes):
            missed = residual[:, k]
            columns[f'demand_{axis}'], columns[f'residual_{axis}'] = commanded[:, k], missed
            columns[f'served_{axis}'] = commanded[:, k] - missed
        parts.append(pd.DataFrame(columns))
        given.append(thrusts)
    return pd.concat(parts, ignore_index=True).assign(change=changes_of(np.concatenate(given)))


def changes_of(thrusts: Array) -> Array:
    """Return the sum (K,) of |change of thrust| since the previous sample, of thrusts (K, n)."""
    return np.abs(np.diff(thrusts, axis=0, prepend=thrusts[:1])).sum(axis=1)


def height_lost(flight: Flight, waypoints: float) -> float:
    """Return how far a flight sinks below its start and the height of its lowest waypoint [m]."""
    lower = min(float(flight.position[0, 2]), waypoints)
    return max(0.0, lower - float(flight.position[:, 2].min()))


def metrics(flight: Flight, samples: pd.DataFrame, waypoint: Waypoint) -> dict[str, Any]:
    """Return the metrics of a flight by name, with samples from `sample_errors`.

    ``steady_state_error`` (mean of waypoint minus value), ``settling_time`` (None if it never
    settles) and ``overshoot`` (share of the step) are by axis; all three are None for a heading
    that turns faster than `TURNING` at the end.  ``heading_rate`` is its rate there [rad/s].
    ``effort`` is the integral of |f|^2 [N^2 s], ``energy`` that of the sum of |f|^1.5 [N^1.5 s],
    ``smoothness`` the sum of |change of thrust| over rotors and samples per second [N/s].
    ``recovered`` says whether the flight ends within `RECOVERED` of the waypoint,
    ``time_at_bound`` is the share of the rotors' time, and ``greatest_tilt`` is in rad.
    """
    ways = dict(zip('xyz', (waypoint.position - flight.position).T, strict=True))
    ways['yaw'] = difference(waypoint.heading, flight.heading)
    # The thrusts of a sample act until the next sample; those of the last one do not count.
    intervals = np.append(np.diff(flight.time), 0.0)
    rate, last = heading_rate(flight), steady(flight)
    of_axes: dict[str, dict[str, float | None]] = {
        'steady_state_error': {
            name: float(np.unwrap(left[last]).mean() if name == 'yaw' else left[last].mean())
            for name, left in ways.items()
        },
        'settling_time': {name: _settling_time(flight.time, left) for name, left in ways.items()},
        'overshoot': {
            name: max(0.0, float((-left / left[0]).max())) if left[0] else 0.0
            for name, left in ways.items()
        },
    }
    if abs(rate) > TURNING:
        # A mean of wrapped errors would say that it is near its goal.
        for values in of_axes.values():
            values['yaw'] = None
    return {
        **of_axes,
        'heading_rate': rate,
        'effort': float((samples['thrusts_squared'].to_numpy() * intervals).sum()),
        'energy': float((samples['energy'].to_numpy() * intervals).sum()),
        'smoothness': float(samples['change'].sum() / max(flight.time[-1], intervals[0])),
        'recovered': flight.position_error(waypoint) <= RECOVERED,
        'height_lost': height_lost(flight, float(samples['goal_height'].min())),
        'time_at_bound': float(samples['at_bound'].sum() / max(1, samples['movable'].sum())),
        'worst_force_residual': float(samples['force_error'].max()),
        'worst_torque_residual': float(samples['torque_error'].max()),
        'greatest_tilt': float(flight.tilt.max()),
    }


def _legs(
    flight: Flight, controller: Controller, vehicle: Vehicle, waypoint: Waypoint,
    changes: Sequence[Change], failures: RotorFailures,
) -> Iterator[tuple[slice, Controller, Vehicle, Waypoint]]:
    """Yield the samples between changes, controller, vehicle as it physically is, and waypoint."""
    start, sound = 0, vehicle
    changes = [*changes, *map(Change, failures.times)]
    times, pilot = np.round(flight.time * 1e9), Pilot(controller, AtRest(controller.problem))
    for change in [*sorted(changes, key=lambda change: change.time), None]:
        end = len(times) if change is None else int(np.searchsorted(times, change.time))
        if end > start:
            yield slice(start, end), pilot.controller, vehicle, waypoint
        start = end
        if change is not None:
            pilot.take(change)
            sound = change.body.vehicle if change.body else sound
            vehicle = audit(failures.after(sound, change.time)).vehicle
            waypoint = change.waypoint or waypoint


def has_margin(problem: AllocationProblem) -> bool:
    """Return whether facets give the margins; a search takes 50 ms for a wrench."""
    return problem.program.facet_choices <= CHOICES_MAX


def _margin(vehicle: Vehicle, axes: Sequence[str], wrenches: Array) -> Any:
    """Return the margin (K,) of wrenches in the set of a vehicle and of the axes in common."""
    common = tuple(axis for axis in vehicle.axes if axis in axes)
    try:
        admissible = AdmissibleSet(replace(vehicle, axes=common))
    except ValueError:
        return np.nan
    if not has_margin(admissible.problem):
        return np.nan
    return admissible.margin(wrenches[:, [axes.index(axis) for axis in common]])


def _settling_time(time: Array, left: Array) -> float | None:
    outside = np.flatnonzero(np.abs(left) > SETTLED * abs(left[0]))
    if len(outside) == 0:
        return 0.0
    return float(time[outside[-1] + 1]) if outside[-1] + 1 < len(time) else None


@dataclass(frozen=True, eq=False)
class Flights:
    """Flights by method, with samples from `sample_errors` and the times of detections [s].

    The vehicle is that of the start.
    """

    flights: Mapping[str, Flight]
    samples: Mapping[str, pd.DataFrame]
    vehicle: Vehicle
    trajectory: Trajectory
    failures: RotorFailures
    detected: Mapping[str, Sequence[float]] = field(default_factory=dict)

    @property
    def end(self) -> float:
        """The end of the longest flight [s]."""
        return max(float(flight.time[-1]) for flight in self.flights.values())

    def marks(self, method: str) -> dict[str, list[float]]:
        """Return the times [s] for `ca_ros.figures.mark`."""
        return self.failures.moments(self.detected.get(method, ()))

    @property
    def moments(self) -> list[float]:
        """The times of the failures and their announcements [s]."""
        return sorted(time for times in self.failures.moments().values() for time in times)
