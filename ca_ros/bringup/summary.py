"""The summary of a flight: whether the waypoint was reached and the rotors kept their bounds."""

from __future__ import annotations

import math
import os

import numpy as np

from ca_ros.arrays import Array, BoolArray
from ca_ros.bringup.session import Flown
from ca_ros.flight.record import Flight
from ca_ros.flight.rotor_failures import RotorFailures
from ca_ros.flight.waypoint import Waypoint
from ca_ros.problem.audit import audit
from ca_ros.vehicle.vehicle import HEALTH_MIN, Vehicle

POSITION_TOLERANCE, HEADING_TOLERANCE = 0.02, math.radians(0.5)
"""How far from the waypoint the flight may end [m, rad]."""


def summarize(flown: Flown, waypoint: Waypoint, failures: RotorFailures) -> tuple[str, bool]:
    """Return the summary of a flight, and whether the waypoint was reached.

    Where yaw is lost, the position alone decides.
    """
    flight, mode = flown.flight, flown.parameters['mode']
    vehicle = Vehicle.from_parameters(flown.parameters)
    error, heading_error = flight.position_error(waypoint), flight.heading_error(waypoint)
    end = round(flight.time[-1] * 1e9)
    last = vehicle.with_health(failures.physical(vehicle.health, end))
    lost = audit(last).lost
    reached = error <= POSITION_TOLERANCE
    if 'yaw' in lost:
        away = f'{1e3 * error:.1f} mm away; the heading is given up'
    else:
        reached = reached and heading_error <= HEADING_TOLERANCE
        away = f'{1e3 * error:.1f} mm and {math.degrees(heading_error):.3f} degrees away'
    speeds = flight.speeds
    inside = _within_bounds(flight, vehicle, failures, mode)
    lines = [
        f'flight of {flight.time[-1]:.2f} s ({mode}, {len(flight.time)} samples, '
        f'in {flown.wall:.1f} s)',
        f'  waypoint      {"reached" if reached else "MISSED"}: {away}',
        f'  rotor speeds  {", ".join(f"{speed:.1f}" for speed in speeds[-1])} rad/s at the end,',
        f'                {speeds.min():.1f} to {speeds.max():.1f} rad/s in flight, '
        f'{"within" if inside else "OUT OF"} bounds',
    ]
    weak = ', '.join(
        f'rotor {i + 1} lost' if health < HEALTH_MIN else f'rotor {i + 1} at {100.0 * health:g} %'
        for i, health in enumerate(last.health)
        if health < 1.0
    )
    if weak:
        axes = f'; lost axes: {", ".join(lost)}' if lost else ''
        lines.append(f'  at the end    {weak}{axes}')
    return '\n'.join(lines + _incidents(flown, reached)), reached


def _incidents(flown: Flown, reached: bool) -> list[str]:
    """Return lines on what disturbed the flight: restarts, timeouts, faults, a slow machine."""
    faults = {kind: count for kind, count in flown.faults.items() if kind != 'received' and count}
    lines = [
        f'  {title:<13} {", ".join(f"{name} {count}" for name, count in counts.items())}'
        for title, counts in (('respawned', flown.respawned), ('timeouts', flown.timeouts))
        if counts
    ]
    if flown.faults:
        said = ', '.join(f'{kind} {count}' for kind, count in faults.items()) or 'none'
        lines.append(f'  faults        {said}, of {flown.faults["received"]} messages')
    load, processors = os.getloadavg()[0], os.cpu_count() or 1
    late = flown.timeouts or load > processors
    if not reached and flown.parameters['mode'] == 'realtime' and late and not flown.faults:
        lines.append(
            f'  hint          the machine may be too slow for real time (load average {load:.1f} '
            f'on {processors} processors): try --mode lockstep'
        )
    return lines


def _within_bounds(flight: Flight, vehicle: Vehicle, failures: RotorFailures, mode: str) -> bool:
    """Return whether each rotor kept its bounds as known at the time: 0 for a lost rotor."""
    times = np.round(flight.time * 1e9)
    inside = np.ones(flight.speeds.shape, dtype=bool)
    for start in [0, *failures.times()]:
        believed = vehicle.with_health(failures.believed(vehicle.health, start))
        later = times >= start
        speeds = flight.speeds[later]
        inside[later] = _inside(speeds, believed)
        if mode == 'realtime':
            # In real time the announcement takes effect with a delay.
            inside[later] |= _inside(speeds, vehicle)
    return bool(inside.all())


def _inside(speeds: Array, vehicle: Vehicle) -> BoolArray:
    low, high = vehicle.speed_limits
    return (speeds >= low) & (speeds <= high)
