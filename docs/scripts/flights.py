"""Flights that saturate the rotors, behind a controller that does not limit its wrench."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from ca_ros.allocation import Allocation, Allocator
from ca_ros.arrays import Array
from ca_ros.evaluation.cases import Case
from ca_ros.evaluation.dynamic.manoeuvres import Counter, Manoeuvre, flown, goal, upset
from ca_ros.flight.rigid_body import NULL_STATE

HEAVY = 1.35  # ratio of greatest thrust to weight of the heavy vehicles

ROUNDING = 1e-9


def to(x: float, y: float, z: float, heading: float, state: Array = NULL_STATE) -> Manoeuvre:
    """Return the flight from a state to a waypoint [m, degrees]."""
    return Manoeuvre(state, ((0.0, goal(x, y, z, heading)),))


MANOEUVRES = {
    'upset, 150° forward': to(0, 0, 0, 60, upset(150, 0)),
    'upset, 150° to 45°': to(0, 0, 0, 60, upset(150, 45)),
    'upset, 150° to the left': to(0, 0, 0, 60, upset(150, 90)),
    'upset, 120°, and a turn': to(0, 0, 0, -120, upset(120, -45)),
    'spin about x': to(0, 0, 0, 0, upset(turn=(12, 0, 0))),
    'spin about y and z': to(0, 0, 0, 0, upset(turn=(0, 10, -8))),
    'spin about all axes': to(0, 0, 0, 0, upset(60, 45, (-9, 7, 10))),
    'gust from the side': to(0, 0, 0, 0, upset(30, 0, (4, 4, 0), (12, -6, 0))),
    'gust from above': to(0, 0, 0, 0, upset(40, 90, (6, -3, 4), (4, 4, -10))),
    'dive with a turn': to(20, 0, -6, 143, NULL_STATE),
    'climb with a turn': to(8, -6, 4, 170, NULL_STATE),
    'turning back in a climb': to(5, 5, -3, -170, upset(turn=(0, 0, 8), velocity=(0, 0, 6))),
    'fast attitude commands': to(3, 0, 3, 90, upset(turn=(8, -8, 0))),
}

class Recorder(Counter):
    """An allocator that counts inexact answers, and those with a wrong yaw."""

    def __init__(self, allocator: Allocator) -> None:
        super().__init__(allocator)
        self.counts['off'] = 0

    def allocate(self, u: Array, *last: Any) -> Allocation:
        """Allocate one wrench."""
        answer, axes = super().allocate(u, *last), self.problem.axes
        if answer.status and 'yaw' in axes:
            yaw = axes.index('yaw')
            self.counts['off'] += bool(wrong(answer.wrench[yaw], u[yaw]))
        return answer


def wrong(served: Array | float, demand: Array | float) -> Array:
    """Tell which values are reversed, exceed their demand, or are not zero without a demand."""
    low, high = np.minimum(demand, 0.0), np.maximum(demand, 0.0)
    return np.asarray((served < low - ROUNDING) | (served > high + ROUNDING))


class Outcome(NamedTuple):
    """A flight, see `ca_ros.evaluation.dynamic.manoeuvres.flown`."""

    recovered: float
    height_lost: float
    energy: float
    change: float
    heading_error: float
    inexact: float
    off: float


def outcome(case: Case, method: str, manoeuvre: Manoeuvre) -> Outcome:
    """Fly a manoeuvre."""
    return Outcome(**flown(case, method, manoeuvre, Recorder))


def both_masses(
    name: str, changes: Sequence[str] = (), methods: Sequence[str] = ()
) -> Iterator[tuple[str, Case]]:
    """Yield a vehicle as its file says and as a heavy one, with their titles."""
    case = Case.load(name, changes, methods)
    yield f'`{name}`', case
    mass = float(case.vehicle.thrust_max.sum()) / case.vehicle.gravity / HEAVY
    yield f'`{name}`, heavy', Case.load(name, (*changes, f'vehicle.mass:={mass}'), methods)
