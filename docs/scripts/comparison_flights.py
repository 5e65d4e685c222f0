"""The flights of docs/comparison.md: recoveries, and a slalom, behind a foreign controller."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from manoeuvres import MANOEUVRES, SLALOM, Unlimited, goal, heavy

from ca_ros.arrays import Array
from ca_ros.evaluation.cases import Case
from ca_ros.evaluation.flight_metrics import RECOVERED, changes_of, height_lost
from ca_ros.evaluation.wrench_metrics import energy
from ca_ros.flight.closed_loop import Change, fly
from ca_ros.flight.controller import Controller
from ca_ros.flight.rigid_body import NULL_STATE
from ca_ros.flight.rotor_failures import RotorFailure, RotorFailures
from ca_ros.flight.waypoint import Waypoint

FAIL, ANNOUNCE, DURATION, SLALOM_DURATION = 0.5, 0.1, 8.0, 12.0
"""Time of the loss, delay of its announcement, and durations of the flights [s]."""


class Outcome(NamedTuple):
    """A flight: whether it recovered, height lost [m], energy [N^1.5 s], smoothness [N/s].

    Energy and smoothness are those of the commands, and so are wrong after the loss of a rotor.
    """

    recovered: bool
    drop: float
    energy: float
    smoothness: float


Outcomes = dict[tuple[str, str], Outcome]


def vehicles() -> Iterator[tuple[str, str, tuple[str, ...]]]:
    """Yield a title, the shipped vehicle and its changes, as shipped and heavy."""
    for name in ('quadrotor', 'hexarotor', 'octorotor', 'x8', 'y6'):
        yield f'`{name}`', name, ()
        mass = heavy(Case.load(name).vehicle)
        yield f'`{name}`, heavy', name, (f'vehicle.mass:={mass}',)


def flights(case: Case, method: str) -> Iterator[tuple[str, Outcome]]:
    """Fly all manoeuvres behind a controller that does not limit its wrench."""
    for name, (state, to) in MANOEUVRES.items():
        if name.startswith(('upset', 'spin')):
            yield name, flown(case, method, state, to)
    turns = [Change(round(t * 1e9), waypoint=point) for t, point in SLALOM]
    yield 'slalom', flown(case, method, NULL_STATE, SLALOM[-1][1], turns, SLALOM_DURATION)
    if case.vehicle.n > 4:
        for rotor in (1, 2):
            failures = RotorFailures((RotorFailure(rotor, FAIL),), ANNOUNCE)
            changes = [
                replace(each, controller=each.controller and unlimited(each.controller))
                for each in case.failing(method, failures)
            ]
            target = goal(1.0, 1.0, 1.0, 0.0)
            yield f'loss of rotor {rotor}', flown(case, method, NULL_STATE, target, changes)


def unlimited(controller: Controller) -> Unlimited:
    """Return a controller without its limit."""
    return Unlimited(controller.vehicle, controller.gains, controller.order, controller.reversal)


def flown(
    case: Case,
    method: str,
    state: Array,
    to: Waypoint,
    changes: Sequence[Change] = (),
    duration: float = DURATION,
) -> Outcome:
    """Fly one manoeuvre."""
    loop = unlimited(case.controller()), case.allocator(method), case.body()
    try:
        flight = fly(*loop, to, duration, state=state, changes=changes)
    except FloatingPointError:
        return Outcome(False, np.inf, np.inf, np.inf)
    thrusts = case.vehicle.thrusts(flight.speeds)
    goals = [to, *(each.waypoint for each in changes if each.waypoint)]
    lowest = [float(each.position[2]) for each in goals]
    return Outcome(
        flight.position_error(to) <= RECOVERED,
        height_lost(flight, min(lowest)),
        float(energy(thrusts)[:-1].sum() * flight.time[1]),
        float(changes_of(thrusts).sum() / flight.time[-1]),
    )


def outcomes(method: str, options: tuple[str, ...]) -> Outcomes:
    """Return the outcomes of all flights of a method by vehicle and manoeuvre."""
    return {
        (vehicle, manoeuvre): outcome
        for vehicle, name, changes in vehicles()
        for manoeuvre, outcome in flights(Case.load(name, (*changes, *options)), method)
    }


def slalom(own: Outcomes) -> Array:
    """Return the sums of energy and smoothness over the slaloms, (2,)."""
    each = [outcome for (_, name), outcome in own.items() if name == 'slalom']
    return np.sum([(outcome.energy, outcome.smoothness) for outcome in each], axis=0)
