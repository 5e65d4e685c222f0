"""Observations on flights: the paper's, checked by numbers, and findings for any vehicle."""

from collections.abc import Collection, Iterator, Mapping
from math import degrees
from typing import NamedTuple

import numpy as np

from ca_ros.allocation.exact import Exact
from ca_ros.control.waypoint import Waypoint
from ca_ros.problem.vehicle_problem import VehicleProblem
from ca_ros.simulation.record import Flight
from ca_ros.studies.cases import PAPER
from ca_ros.studies.dynamic.metrics import TURNING, at_bounds, heading_rate, steady
from ca_ros.studies.tables import number

HEIGHT_ERROR = 1e-3
"""A smaller height error in steady state counts as zero [m].

With the gains of the parameter file, 0.04 mm of the step itself are left in the last second.
"""

SPEED_ERROR = 0.05  # a smaller deviation does not change the first decimal of a speed [rad/s]


class Observation(NamedTuple):
    """A sentence of the paper, whether it holds, and the numbers."""

    sentence: str
    holds: bool
    numbers: str


def findings(
    flights: Mapping[str, Flight], waypoint: Waypoint, lost: Collection[str] = ()
) -> Iterator[str]:
    """Yield a sentence per flight, for flights that are not the paper's and lose some axes."""
    for name, flight in flights.items():
        error, rate = flight.position_error(waypoint), heading_rate(flight)
        words = [f'With `{name}` the flight ends {number(error)} m from the waypoint']
        if 'yaw' in lost:
            words.append('the heading is given up')
        if abs(rate) > TURNING:
            words.append(f'the vehicle turns at {rate:.2f} rad/s')
        elif 'yaw' not in lost:
            angle = degrees(flight.heading_error(waypoint))
            words.append(f'with a heading error of {number(angle)}°')
        yield f'{", ".join(words)}.'


def observe(
    flights: Mapping[str, Flight], problem: VehicleProblem, waypoint: Waypoint
) -> Iterator[Observation]:
    """Yield those of the paper's three observations whose methods were flown."""
    flown = {name: flight for name, flight in flights.items() if name in PAPER}
    if 'conventional' in flown:
        errors = {
            name: abs(float((waypoint.position[2] - flight.position[steady(flight), 2]).mean()))
            for name, flight in flown.items()
        }
        others = [error for name, error in errors.items() if name != 'conventional']
        yield Observation(
            'In steady state the conventional allocator has a nonzero height error'
            + (', and no other method has one.' if others else '.'),
            errors['conventional'] > HEIGHT_ERROR and max(others, default=0.0) < HEIGHT_ERROR,
            ', '.join(f'{name} {1e3 * error:.3f} mm' for name, error in errors.items()),
        )
    if 'direct' in flown:
        flight = flown.pop('direct')
        counts = at_bounds(flight.speeds[steady(flight)], problem.vehicle)[1].sum(axis=1)
        speeds = ', '.join(f'{speed:.1f}' for speed in flight.speeds[-1])
        yield Observation(
            'In steady state direct allocation has two rotors at their maximum.',
            bool((counts == 2).all()),
            f'{counts.min()} to {counts.max()} rotors; {speeds} rad/s at the end',
        )
    if flown:
        hover = Exact(problem.vehicle).allocate(problem.hover).speeds
        worst = {
            name: float(np.abs(flight.speeds[steady(flight)] - hover).max())
            for name, flight in flown.items()
        }
        deviations = ', '.join(f'{name} {error:.4f} rad/s' for name, error in worst.items())
        yield Observation(
            'In steady state all methods but direct allocation have each rotor at '
            f'{hover.mean():.1f} rad/s.',
            max(worst.values()) <= SPEED_ERROR,
            f'greatest deviation {deviations}',
        )
