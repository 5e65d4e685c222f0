"""Compare the values of `thrust_deviation`; fill the tables of docs/priorities.md.

Flies manoeuvres that saturate the rotors with every shipped vehicle.  Takes about two minutes.
"""

from __future__ import annotations

from itertools import product

import numpy as np
from flights import MANOEUVRES, Outcome, both_masses, outcome, wrong
from pages import DOCS, fill, shipped, telling

from ca_ros import AdmissibleSet, Vehicle, control_allocation_matrix
from ca_ros.evaluation.tables import table
from ca_ros.problem.prioritization import THRUST_DEVIATIONS

ROWS = DOCS.parent / 'test' / 'px4_desaturation.csv'

SHOWN = ('`hexarotor`, heavy', '`quadrotor`')
"""The vehicles on the page, with the largest differences."""


VARIANTS = {
    **{
        f'`{value}`': [f'allocation.exact.thrust_deviation:={value}']
        for value in THRUST_DEVIATIONS
    },
    **{
        f'limit {limit:g}': [f'allocation.exact.airmode_limit:={limit}']
        for limit in (0.0, 0.1, 0.25)
    },
}


def flights_table() -> str:
    """Return the results of the flights with each value of the option."""
    rows = []
    for name, (words, given) in product(shipped(flying=True), VARIANTS.items()):
        for title, case in both_masses(name, given):
            found = [outcome(case, 'exact', each) for each in MANOEUVRES.values()]
            total = Outcome(*np.sum(found, axis=0).tolist())
            recovered = f'{total.recovered:.0f} of {len(found)}'
            cells = f'{total.height_lost:.2f}', f'{total.heading_error:.1f}'
            off = f'{total.off:.0f} of {total.inexact:.0f}'
            rows.append((title, words, recovered, *cells, off))
    titles = (
        *('vehicle', 'thrust deviation', 'recovered', 'height lost [m]'),
        *('heading error [rad s]', 'wrong yaw'),
    )
    rows.sort(key=lambda row: row[0])
    return telling('priorities', titles, rows, lambda row: row[0] in SHOWN, words=2)


def rows_table() -> str:
    """Return what is missed of the unattainable wrenches of PX4's test."""
    rows = np.loadtxt(ROWS, delimiter=',', skiprows=1)
    rotors = {
        'positions': [-1, -1, 0, 1, -1, 0, 1, 1, 0, -1, 1, 0], 'spins': ['cw', 'ccw', 'cw', 'ccw'],
        **dict.fromkeys(('thrust_coefficient', 'torque_coefficient', 'speed_max'), 1.0),
        'speed_min': 0.0,
    }
    parameters = {'vehicle.mass': 2.0 / 9.81, 'vehicle.inertia': [1.0, 1.0, 1.0]}
    parameters |= {f'rotors.{name}': value for name, value in rotors.items()}
    vehicle = Vehicle.from_parameters(parameters)
    gamma, admissible = control_allocation_matrix(vehicle), AdmissibleSet(vehicle)
    demands = np.column_stack([4.0 * rows[:, 3], rows[:, :3]])
    served = {
        f'`exact`, `{reversal}`': admissible.prioritize(demands, thrust_deviation=reversal)
        for reversal in THRUST_DEVIATIONS
    }
    for limit in (0.0, 0.1, 0.25):
        served[f'`exact`, `airmode_limit: {limit:g}`'] = admissible.prioritize(
            demands, airmode_limit=limit
        )
    order = ['roll pitch', 'yaw', 'thrust']
    served['`exact`, yaw before thrust'] = admissible.prioritize(demands, order)
    for i, name in enumerate(('no airmode', 'roll-pitch airmode', 'roll-pitch-yaw airmode')):
        served[f'PX4, {name}'] = rows[:, 4 + 4 * i : 8 + 4 * i] @ gamma.T
    lines = []
    for name, wrenches in served.items():
        missing = np.abs(demands - wrenches)
        missed = np.linalg.norm(missing[:, 1:3], axis=1), missing[:, 0] / 4.0, missing[:, 3]
        yaw = str(np.count_nonzero(wrong(wrenches[:, 3], demands[:, 3])))
        lines.append((name, *(f'{each.sum():.2f}' for each in missed), yaw))
    titles = ('', 'roll and pitch missed', 'thrust', 'yaw', 'wrong yaw')
    return table(titles, lines)


if __name__ == '__main__':
    fill('priorities.md', rows=rows_table(), flights=flights_table())
