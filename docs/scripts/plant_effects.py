"""Fly with the effects of the plant; fill the tables of docs/plant_effects.md.

Takes some minutes.
"""

import warnings
from collections.abc import Callable, Mapping
from functools import partial

import numpy as np
from pages import fill, shipped, telling

from ca_ros.evaluation.cases import Case
from ca_ros.evaluation.tables import table
from ca_ros.flight.closed_loop import fly
from ca_ros.flight.record import Flight
from ca_ros.flight.waypoint import Waypoint

GOAL = Waypoint.of(1.0, 1.0, 1.0, np.pi / 4)  # the waypoint of the paper's flight

DURATION, HELD = 20.0, 5.0  # of a flight, and its end at the waypoint [s]
THERE = 0.01  # greatest distance from the waypoint in that time [m]
GAINS = 0.0, 0.5, 1.0  # values of `controller.integral_gain` [1/s]

Effects = Callable[[int], dict[str, int]]

LIMITS: dict[str, Effects] = {
    'motor lag': lambda ms: {'motor_time_constant': ms}, 'delay': lambda ms: {'command_delay': ms},
    'delay with a lag of 50 ms': lambda ms: {'command_delay': ms, 'motor_time_constant': 50},
}
"""Parameters of the simulator [ms] for each of the limits."""

SHOWN = '`hexarotor`', '`hexarotor_tilted`'  # the vehicles on the page
LONGEST = 512  # a time that no vehicle tolerates [ms]

ERRORS = {
    'wind of 3 m/s, a force of 0.9 N': {'linear_drag': 0.3, 'wind': [3.0, 0.0, 0.0]},
    'k_f 10 % low': {'thrust_factor': 0.9}, 'mass 10 % high': {'mass_factor': 1.1},
    'k_f of each rotor off by up to 5 %': {'thrust_factor': [0.95, 1.0, 1.03, 0.97, 1.0, 1.02]},
    'k_tau of rotor 1 20 % low': {'torque_factor': [0.8, 1.0, 1.0, 1.0, 1.0, 1.0]},
}
"""Constant errors: parameters of the simulator."""


def flown(vehicle: str, gain: float, effects: Mapping[str, object]) -> Flight | None:
    """Fly to the waypoint; return None if the flight diverges."""
    changes = [f'simulator.{name}:={value}' for name, value in effects.items()]
    case = Case.load(vehicle, [*changes, f'controller.integral_gain:={gain}'])
    try:
        return fly(case.controller(), case.allocator('exact'), case.plant(), GOAL, DURATION)
    except FloatingPointError:
        return None


def tolerates(vehicle: str, gain: float, effects: Effects, time: int) -> bool:
    """Return whether a vehicle reaches the waypoint with a lag or delay [ms] and stays there."""
    seconds = {name: ms / 1000.0 for name, ms in effects(time).items()}
    flight = flown(vehicle, gain, {**seconds, 'sub_steps': 10})
    if flight is None:
        return False
    late = flight.position[flight.time >= DURATION - HELD]
    return float(np.linalg.norm(late - GOAL.position, axis=1).max(initial=0.0)) <= THERE


def limit(good: Callable[[int], bool]) -> int:
    """Return the greatest whole number that is good, by bisection."""
    low, high = 0, LONGEST
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if good(middle) else (low, middle)
    return low


def limits_table() -> str:
    """Return the greatest lag and delays [ms] of each vehicle for each of the gains."""
    rows = []
    for vehicle in shipped(flying=True):
        cells = []
        for effects in LIMITS.values():
            found = [limit(partial(tolerates, vehicle, gain, effects)) for gain in GAINS]
            cells.append(' / '.join(map(str, found)))
        rows.append((f'`{vehicle}`', *cells))
    titles = ('vehicle', *(f'{name} [ms]' for name in LIMITS))
    return telling('limits', titles, rows, lambda row: row[0] in SHOWN)


def offsets_table() -> str:
    """Return the errors at the end of flights with constant errors of the model."""

    def cell(flight: Flight | None) -> str:
        if flight is None:
            return 'diverges'
        turned = np.degrees(flight.heading_error(GOAL))
        return f'{1e3 * flight.position_error(GOAL):.1f} mm, {turned:.1f}°'

    rows = [
        (name, *(cell(flown('hexarotor', gain, effects)) for gain in GAINS))
        for name, effects in ERRORS.items()
    ]
    return table(('error', *(f'gain {gain:g}' for gain in GAINS)), rows)


if __name__ == '__main__':
    # The state of a tumbling vehicle overflows.
    warnings.simplefilter('ignore', RuntimeWarning)
    fill('plant_effects.md', offsets=offsets_table(), limits=limits_table())
