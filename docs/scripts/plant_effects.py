"""Fly with the effects of the plant; fill the tables of docs/plant_effects.md.

Takes some minutes.
"""

import warnings
from bisect import bisect_left
from collections.abc import Mapping

import numpy as np
from pages import distance, fill, flown, shipped, telling

from ca_ros.evaluation.cases import Case
from ca_ros.evaluation.tables import table
from ca_ros.flight.record import Flight
from ca_ros.flight.waypoint import Waypoint

GOAL = Waypoint.of(1.0, 1.0, 1.0, np.pi / 4)  # the waypoint of the paper's flight

DURATION, HELD = 20.0, 5.0  # of a flight, and its end at the waypoint [s]
THERE = 0.01  # greatest distance from the waypoint in that time [m]
GAINS = 0.0, 0.5, 1.0  # values of `controller.integral_gain` [1/s]

LIMITS = {
    'motor lag': ('motor_time_constant', {}), 'delay': ('command_delay', {}),
    'delay with a lag of 50 ms': ('command_delay', {'motor_time_constant': 0.05}),
}
"""The parameter of the simulator that is limited, and others beside it."""

SHOWN = '`hexarotor`', '`hexarotor_tilted`'  # the vehicles on the page
LONGEST = 512  # a time that no vehicle tolerates [ms]

ERRORS = {
    'wind of 3 m/s, a force of 0.9 N': {'linear_drag': 0.3, 'wind': [3.0, 0.0, 0.0]},
    'k_f 10 % low': {'thrust_factor': 0.9}, 'mass 10 % high': {'mass_factor': 1.1},
    'k_f of each rotor off by up to 5 %': {'thrust_factor': [0.95, 1.0, 1.03, 0.97, 1.0, 1.02]},
    'k_tau of rotor 1 20 % low': {'torque_factor': [0.8, 1.0, 1.0, 1.0, 1.0, 1.0]},
}
"""Constant errors: parameters of the simulator."""


def fly(vehicle: str, gain: float, effects: Mapping[str, object]) -> Flight | None:
    """Fly to the waypoint; return None if the flight diverges."""
    changes = [f'simulator.{name}:={value}' for name, value in effects.items()]
    case = Case.load(vehicle, [*changes, f'controller.integral_gain:={gain}'])
    return flown(case, GOAL, DURATION)


def limit(vehicle: str, gain: float, name: str, others: Mapping[str, float]) -> int:
    """Return the greatest lag or delay [ms] with which a vehicle holds the waypoint."""

    def fails(ms: int) -> bool:
        flight = fly(vehicle, gain, {**others, name: ms / 1000.0, 'sub_steps': 10})
        return flight is None or distance(flight, GOAL, DURATION - HELD) > THERE

    return bisect_left(range(1, LONGEST), True, key=fails)


def limits_table() -> str:
    """Return the greatest lag and delays [ms] of each vehicle for each of the gains."""
    rows = [
        (f'`{vehicle}`', *(
            ' / '.join(str(limit(vehicle, gain, *limited)) for gain in GAINS)
            for limited in LIMITS.values()
        )) for vehicle in shipped(flying=True)
    ]
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
        (name, *(cell(fly('hexarotor', gain, effects)) for gain in GAINS))
        for name, effects in ERRORS.items()
    ]
    return table(('error', *(f'gain {gain:g}' for gain in GAINS)), rows)


if __name__ == '__main__':
    # The state of a tumbling vehicle overflows.
    warnings.simplefilter('ignore', RuntimeWarning)
    fill('plant_effects.md', offsets=offsets_table(), limits=limits_table())
