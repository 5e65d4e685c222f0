"""Manoeuvres that saturate the rotors, drawn from seeds, behind a controller without a limit."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from functools import partial
from itertools import product
from math import cos, inf, pi, radians, sin
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from ca_ros.allocation import Allocation, Allocator
from ca_ros.allocation.rates import WithinRates
from ca_ros.arrays import Array
from ca_ros.control.controller import Controller
from ca_ros.control.trajectory import Trajectory
from ca_ros.control.waypoint import Waypoint
from ca_ros.simulation.closed_loop import Change, fly, waypoint_changes
from ca_ros.simulation.rotor_failures import RotorFailure, RotorFailures
from ca_ros.studies.cases import Case
from ca_ros.studies.dynamic.metrics import RECOVERED, changes_of, height_lost
from ca_ros.studies.tables import table
from ca_ros.studies.wrench_metrics import energy
from ca_ros.vehicle.state import ANGULAR_VELOCITY, ATTITUDE, NULL_STATE, VELOCITY, difference

DURATION, SLALOM_DURATION = 8.0, 12.0  # of the flights [s]
ANNOUNCE = 0.1  # delay from the loss of a rotor to its announcement [s]
LIKELY = 1.959964  # half width of the interval that holds 95 % of a normal distribution


class Unlimited(Controller):
    """The controller without the limit of its wrench."""

    def wrench(self, *state: Any) -> Array:
        """Return the demand; the time of the state does not matter without integral action."""
        return self.demand(*state[:5])


def unlimited(controller: Controller) -> Controller:
    """Return a controller without its limit."""
    return Unlimited(controller.vehicle, controller.settings, controller.priorities)


def upset(
    tilt: float = 0.0, towards: float = 0.0, turn: ArrayLike = (0.0, 0.0, 0.0),
    velocity: ArrayLike = (0.0, 0.0, 0.0),
) -> Array:
    """Return a state: tilted [degrees] towards an azimuth [degrees], rotating and moving."""
    state = NULL_STATE.copy()
    axis = np.array([-sin(radians(towards)), cos(radians(towards)), 0.0])
    state[ATTITUDE] = Rotation.from_rotvec(radians(tilt) * axis).as_quat()
    state[ANGULAR_VELOCITY], state[VELOCITY] = turn, velocity
    return state


def goal(x: float, y: float, z: float, heading: float) -> Trajectory:
    """Return the trajectory to a position [m] with a heading [degrees]."""
    return Trajectory.to(Waypoint.of(x, y, z, radians(heading)))


class Manoeuvre(NamedTuple):
    """A flight from a state to waypoints, or with a rotor that fails; the duration is in s."""

    state: Array
    goals: Trajectory
    failures: RotorFailures = RotorFailures()
    duration: float = DURATION

    def changes(self, case: Case, method: str) -> list[Change]:
        """Return what changes on the way."""
        failing = case.announced(method, self.failures)
        return [*waypoint_changes(self.goals), *(
            replace(each, reconfigure=each.reconfigure and partial(
                each.reconfigure, changed=unlimited)) for each in failing
        )]


def upset_of(rng: np.random.Generator, n: int) -> Manoeuvre:
    """Draw an upset: tilted by 120 to 170 degrees, with a turn to make."""
    state = upset(rng.uniform(120.0, 170.0), rng.uniform(-180.0, 180.0))
    return Manoeuvre(state, goal(0, 0, 0, rng.uniform(-120.0, 120.0)))


def spin_of(rng: np.random.Generator, n: int) -> Manoeuvre:
    """Draw a spin of 8 to 16 rad/s about any axis, tilted by up to 60 degrees."""
    axis = rng.normal(size=3)
    turn = rng.uniform(8.0, 16.0) * axis / np.linalg.norm(axis)
    state = upset(rng.uniform(0.0, 60.0), rng.uniform(-180.0, 180.0), turn)
    return Manoeuvre(state, goal(0, 0, 0, 0))


def slalom_of(rng: np.random.Generator, n: int) -> Manoeuvre:
    """Draw a slalom: each of five waypoints is left before it is reached."""
    turns = [
        (1.5 * (i + 1), side * rng.uniform(1.0, 2.0), rng.uniform(0, 1), side * pi / 2.0)
        for i, side in enumerate((1, -1, 1, -1))
    ]
    waypoints = tuple(Waypoint.of(*each) for each in (*turns, (7.5, 0.0, 0.0, 0.0)))
    goals = Trajectory(tuple(1_200_000_000 * i for i in range(len(waypoints))), waypoints)
    return Manoeuvre(NULL_STATE, goals, duration=SLALOM_DURATION)


def rotor_lost_of(rng: np.random.Generator, n: int) -> Manoeuvre:
    """Draw the loss of a rotor after 0.3 to 1.5 s of a flight to a waypoint."""
    x, y, z = rng.uniform(-2.0, 2.0, 3).tolist()
    failed = RotorFailure(int(rng.integers(1, n + 1)), rng.uniform(0.3, 1.5))
    return Manoeuvre(NULL_STATE, goal(x, y, z, 0), RotorFailures((failed,), ANNOUNCE))


MANOEUVRES: dict[str, Callable[[np.random.Generator, int], Manoeuvre]] = {
    'upsets': upset_of, 'spins': spin_of, 'slalom': slalom_of, 'rotor_lost': rotor_lost_of
}
"""By the names of ``dynamic_study --manoeuvres``."""


class Counter(WithinRates):
    """An allocator within the rates of its vehicle that counts inexact answers."""

    def __init__(self, allocator: Allocator) -> None:
        super().__init__(allocator)
        self.counts = {'inexact': 0}

    def allocate(self, *given: Any) -> Allocation:
        """Allocate one wrench; see `WithinRates`."""
        answer = super().allocate(*given)
        self.counts['inexact'] += bool(answer.status)
        return answer


def flown(
    case: Case, method: str, manoeuvre: Manoeuvre, kind: type[Counter] = Counter
) -> dict[str, float]:
    """Fly a manoeuvre; return its row without names, with the counts of a kind of counter.

    Energy [N^1.5 s] and change of thrust [N/s] are those of the commands, and the heading error is
    an integral [rad s].  A flight whose numbers overflow has not recovered, and its other values
    are infinite.
    """
    counter, goals = kind(case.allocator(method)), manoeuvre.goals
    allocator: Any = counter
    loop = unlimited(case.controller()), allocator, case.body(), goals.first
    changes = manoeuvre.changes(case, method)
    try:
        flight = fly(
            *loop, manoeuvre.duration, state=manoeuvre.state, changes=changes,
            failures=manoeuvre.failures)
    except FloatingPointError:
        lost = dict.fromkeys(('height_lost', 'energy', 'change', 'heading_error'), inf)
        return {'recovered': 0, **lost, **counter.counts}
    thrusts, step = case.vehicle.thrusts(flight.speeds), flight.time[1]
    off = difference(flight.heading, goals.last.heading)
    return {
        'recovered': int(flight.position_error(goals.last) <= RECOVERED),
        'height_lost': height_lost(flight, float(min(p.position[2] for p in goals.waypoints))),
        'energy': float(energy(thrusts)[:-1].sum() * step),
        'change': float(changes_of(thrusts).sum() / flight.time[-1]),
        'heading_error': float(np.abs(off).sum() * step), **counter.counts,
    }


def fly_seeds(
    case: Case, methods: Iterable[str], names: Iterable[str], seeds: int
) -> Iterator[dict[str, Any]]:
    """Fly manoeuvres of each seed with each method, all the same ones; yield their rows."""
    for name, seed, method in product(names, range(seeds), methods):
        rng = np.random.default_rng([seed, list(MANOEUVRES).index(name)])
        row = {'manoeuvre': name, 'seed': seed, 'method': method}
        yield {**row, **flown(case, method, MANOEUVRES[name](rng, case.vehicle.n))}


def share_of(hits: int, count: int) -> tuple[float, float]:
    """Return the 95 % confidence interval of a share, that of Wilson."""
    z2 = LIKELY**2
    middle = (hits + z2 / 2.0) / (count + z2)
    half = LIKELY / (count + z2) * np.sqrt(hits * (count - hits) / count + z2 / 4.0)
    return float(max(0.0, middle - half)), float(min(1.0, middle + half))


def median_of(values: Array) -> tuple[float, float, float]:
    """Return the median and its 95 % confidence interval, from the order of the values."""
    found, count = np.sort(values), len(values)
    below = max(0, int(np.floor(count / 2.0 - LIKELY * np.sqrt(count) / 2.0)))
    return float(np.median(found)), float(found[below]), float(found[count - 1 - below])


def summary(rows: pd.DataFrame) -> str:
    """Return the table of recoveries, height lost, energy and smoothness of manoeuvres.csv."""
    made = []
    for (manoeuvre, method), own in rows.groupby(['manoeuvre', 'method'], sort=False):
        hits, count = int(own['recovered'].sum()), len(own)
        low, high = share_of(hits, count)
        cells = [manoeuvre, f'`{method}`', f'{hits} of {count} ({low:.0%} to {high:.0%})']
        for name in ('height_lost', 'energy', 'change'):
            middle, *ends = median_of(own[name].to_numpy(dtype=float))
            cells.append(f'{middle:.3g} ({ends[0]:.3g} to {ends[1]:.3g})')
        made.append(cells)
    titles = (
        'manoeuvre', 'method', 'recovered', 'height lost [m]', 'energy [N¹·⁵ s]',
        'change of thrust [N/s]',
    )  # fmt: skip
    return table(titles, made, 2)
