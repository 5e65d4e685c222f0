"""Flights that saturate the rotors, behind a controller that does not limit its wrench."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from math import inf, pi
from typing import Any, NamedTuple

import numpy as np

from ca_ros.allocation import Allocation
from ca_ros.arrays import Array
from ca_ros.evaluation.cases import Case
from ca_ros.evaluation.dynamic.manoeuvres import goal, unlimited, upset
from ca_ros.evaluation.dynamic.metrics import RECOVERED, changes_of, height_lost
from ca_ros.evaluation.wrench_metrics import energy
from ca_ros.flight.closed_loop import Change, fly
from ca_ros.flight.rigid_body import NULL_STATE
from ca_ros.flight.rotor_failures import RotorFailure, RotorFailures
from ca_ros.flight.waypoint import Waypoint

HEAVY = 1.35
"""Ratio of greatest thrust to weight of the heavy vehicles."""

FAIL, ANNOUNCE, DURATION, SLALOM_DURATION = 0.5, 0.1, 8.0, 12.0
"""Time of the loss, delay of its announcement, and durations of the flights [s]."""

ROUNDING = 1e-9


MANOEUVRES = {
    'upset, 150° forward': (upset(150, 0), goal(0, 0, 0, 60)),
    'upset, 150° to 45°': (upset(150, 45), goal(0, 0, 0, 60)),
    'upset, 150° to the left': (upset(150, 90), goal(0, 0, 0, 60)),
    'upset, 120°, and a turn': (upset(120, -45), goal(0, 0, 0, -120)),
    'spin about x': (upset(turn=(12, 0, 0)), goal(0, 0, 0, 0)),
    'spin about y and z': (upset(turn=(0, 10, -8)), goal(0, 0, 0, 0)),
    'spin about all axes': (upset(60, 45, (-9, 7, 10)), goal(0, 0, 0, 0)),
    'gust from the side': (upset(30, 0, (4, 4, 0), (12, -6, 0)), goal(0, 0, 0, 0)),
    'gust from above': (upset(40, 90, (6, -3, 4), (4, 4, -10)), goal(0, 0, 0, 0)),
    'dive with a turn': (NULL_STATE, goal(20, 0, -6, 143)),
    'climb with a turn': (NULL_STATE, goal(8, -6, 4, 170)),
    'turning back in a climb': (upset(turn=(0, 0, 8), velocity=(0, 0, 6)), goal(5, 5, -3, -170)),
    'fast attitude commands': (upset(turn=(8, -8, 0)), goal(3, 0, 3, 90)),
}

SLALOM = [
    (0.0, goal(1.5, 1.5, 0, 90)),
    (1.2, goal(3.0, -1.5, 1, -90)),
    (2.4, goal(4.5, 1.5, 0, 90)),
    (3.6, goal(6.0, -1.5, 1, -90)),
    (4.8, goal(7.5, 0, 0, 0)),
]
"""Times [s] and waypoints of a slalom; each waypoint is left before it is reached."""


class Recorder:
    """An allocator that counts inexact answers, and those with a wrong yaw."""

    def __init__(self, allocator: Any) -> None:
        self._allocator, axes = allocator, allocator.problem.axes
        self._yaw = axes.index('yaw') if 'yaw' in axes else None
        self.inexact = self.off = 0

    def allocate(self, u: Array) -> Allocation:
        """Allocate one wrench."""
        answer: Allocation = self._allocator.allocate(u)
        if answer.status:
            self.inexact += 1
            yaw = self._yaw
            self.off += yaw is not None and bool(wrong(answer.wrench[yaw], u[yaw]))
        return answer


def wrong(served: Array | float, demand: Array | float) -> Array:
    """Tell which values are reversed, exceed their demand, or are not zero without a demand."""
    low, high = np.minimum(demand, 0.0), np.maximum(demand, 0.0)
    return np.asarray((served < low - ROUNDING) | (served > high + ROUNDING))


class Outcome(NamedTuple):
    """A flight: height lost [m], energy [N^1.5 s], change of thrust [N/s], integrals [rad s].

    Energy and change of thrust are those of the commands, and so are wrong after a loss.
    """

    recovered: bool = False
    drop: float = inf
    energy: float = inf
    change: float = inf
    heading: float = inf
    inexact: int = 0
    off: int = 0


def flown(
    case: Case, method: str, state: Array, to: Waypoint, changes: Sequence[Change] = (),
    duration: float = DURATION,
) -> Outcome:
    """Fly one manoeuvre."""
    recorder = Recorder(case.allocator(method))
    loop: Any = unlimited(case.controller()), recorder, case.body()
    try:
        flight = fly(*loop, to, duration, state=state, changes=changes)
    except FloatingPointError:
        return Outcome()
    thrusts, step = case.vehicle.thrusts(flight.speeds), flight.time[1]
    goals = [to, *(each.waypoint for each in changes if each.waypoint)]
    off = (flight.heading - to.heading + pi) % (2.0 * pi) - pi
    return Outcome(
        flight.position_error(to) <= RECOVERED,
        height_lost(flight, min(float(each.position[2]) for each in goals)),
        float(energy(thrusts)[:-1].sum() * step),
        float(changes_of(thrusts).sum() / flight.time[-1]),
        float(np.abs(off).sum() * step),
        recorder.inexact,
        recorder.off,
    )


def both_masses(
    name: str, changes: Sequence[str] = (), methods: Sequence[str] = ()
) -> Iterator[tuple[str, Case]]:
    """Yield a vehicle as its file says and as a heavy one, with their titles."""
    case = Case.load(name, changes, methods)
    yield f'`{name}`', case
    mass = float(case.vehicle.thrust_max.sum()) / case.vehicle.gravity / HEAVY
    yield f'`{name}`, heavy', Case.load(name, (*changes, f'vehicle.mass:={mass}'), methods)


def compared(case: Case, method: str) -> Iterator[tuple[str, Outcome]]:
    """Fly upsets, spins, a slalom and the losses of two rotors."""
    for name, (state, to) in MANOEUVRES.items():
        if name.startswith(('upset', 'spin')):
            yield name, flown(case, method, state, to)
    turns = [Change(round(t * 1e9), waypoint=point) for t, point in SLALOM]
    yield 'slalom', flown(case, method, NULL_STATE, SLALOM[-1][1], turns, SLALOM_DURATION)
    for rotor in (1, 2) if case.vehicle.n > 4 else ():
        failures = RotorFailures((RotorFailure(rotor, FAIL),), ANNOUNCE)
        changes = [
            replace(each, controller=each.controller and unlimited(each.controller))
            for each in case.failing(method, failures)
        ]
        yield f'loss of rotor {rotor}', flown(case, method, NULL_STATE, goal(1, 1, 1, 0), changes)
