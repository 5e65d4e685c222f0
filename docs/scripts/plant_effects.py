"""Fly with the effects of the plant; fill the tables of docs/plant_effects.md."""

from bisect import bisect_left
from collections.abc import Mapping
from itertools import product

import numpy as np
from pages import distance, fill, flown, shipped, spread, telling

from ca_ros.control.waypoint import Waypoint
from ca_ros.simulation.record import Flight
from ca_ros.studies.cases import Case
from ca_ros.studies.tables import table

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


def limit(vehicle: str, kind: str, gain: float) -> int:
    """Return the greatest lag or delay [ms] with which a vehicle holds the waypoint."""
    name, others = LIMITS[kind]

    def fails(ms: int) -> bool:
        flight = fly(vehicle, gain, {**others, name: ms / 1000.0, 'sub_steps': 10})
        return flight is None or distance(flight, GOAL, DURATION - HELD) > THERE

    return bisect_left(range(1, LONGEST), True, key=fails)


def limits_table() -> str:
    """Return the greatest lag and delays [ms] of each vehicle for each of the gains."""
    vehicles = shipped(flying=True)
    cells = [*product(vehicles, LIMITS, GAINS)]
    found = dict(zip(cells, spread(limit, cells), strict=True))
    rows = [
        (f'`{vehicle}`', *(
            ' / '.join(str(found[vehicle, kind, gain]) for gain in GAINS) for kind in LIMITS
        )) for vehicle in vehicles
    ]
    titles = ('vehicle', *(f'{name} [ms]' for name in LIMITS))
    return telling('limits', titles, rows, lambda row: row[0] in SHOWN)


def offsets(error: str, gain: float) -> str:
    """Return the errors at the end of a flight with a constant error of the model."""
    flight = fly('hexarotor', gain, ERRORS[error])
    if flight is None:
        return 'diverges'
    turned = np.degrees(flight.heading_error(GOAL))
    return f'{1e3 * flight.position_error(GOAL):.1f} mm, {turned:.1f}°'


def offsets_table() -> str:
    """Return the errors at the end of flights with constant errors of the model."""

    found = iter(spread(offsets, [*product(ERRORS, GAINS)]))
    rows = [(name, *(next(found) for _ in GAINS)) for name in ERRORS]
    return table(('error', *(f'gain {gain:g}' for gain in GAINS)), rows)


if __name__ == '__main__':
    fill('plant_effects.md', offsets=offsets_table(), limits=limits_table())
