"""Compare the values of `axis_reversal`; fill the tables of docs/priorities.md.

Flies manoeuvres that saturate the rotors with every shipped vehicle, behind a controller that does
not limit its wrench.  Takes about two minutes.
"""

from itertools import product
from typing import Any

import numpy as np
import pandas as pd
from pages import DOCS, both_masses, fill, shipped, telling

from ca_ros import AdmissibleSet, Vehicle, control_allocation_matrix
from ca_ros.allocation import Allocation, Allocator
from ca_ros.arrays import Array
from ca_ros.problem.prioritization import AXIS_REVERSALS
from ca_ros.studies.dynamic.manoeuvres import Counter, Manoeuvre, flown, goal, upset
from ca_ros.studies.tables import table
from ca_ros.vehicle.state import NULL_STATE

ROWS = DOCS.parent / 'test' / 'px4_desaturation.csv'

SHOWN = ('`hexarotor`', '`hexarotor`, heavy', '`quadrotor`')
"""The vehicles on the page, with the largest differences."""

LIMITS = 0.0, 0.1, 0.25  # values of `airmode_limit`
ROUNDING = 1e-9

VARIANTS = {
    **{f'`{each}`': [f'allocation.exact.axis_reversal:={each}'] for each in AXIS_REVERSALS},
    **{f'limit {limit:g}': [f'allocation.exact.airmode_limit:={limit}'] for limit in LIMITS},
}

MANOEUVRES = [
    Manoeuvre(state, goal(*where)) for where, state in [
        # Upsets of 150 and 120 degrees, the last with a turn.
        ((0, 0, 0, 60), upset(150, 0)),
        ((0, 0, 0, 60), upset(150, 45)),
        ((0, 0, 0, 60), upset(150, 90)),
        ((0, 0, 0, -120), upset(120, -45)),
        # Spins about x, about y and z, and about all axes.
        ((0, 0, 0, 0), upset(turn=(12, 0, 0))),
        ((0, 0, 0, 0), upset(turn=(0, 10, -8))),
        ((0, 0, 0, 0), upset(60, 45, (-9, 7, 10))),
        # Gusts from the side and from above.
        ((0, 0, 0, 0), upset(30, 0, (4, 4, 0), (12, -6, 0))),
        ((0, 0, 0, 0), upset(40, 90, (6, -3, 4), (4, 4, -10))),
        # A dive and climbs with turns, and fast commands of the attitude.
        ((20, 0, -6, 143), NULL_STATE),
        ((8, -6, 4, 170), NULL_STATE),
        ((5, 5, -3, -170), upset(turn=(0, 0, 8), velocity=(0, 0, 6))),
        ((3, 0, 3, 90), upset(turn=(8, -8, 0))),
    ]
]
"""Each from a state to a waypoint [m, degrees]."""


class Recorder(Counter):
    """An allocator that counts inexact answers, and those with a wrong yaw."""

    def __init__(self, allocator: Allocator) -> None:
        super().__init__(allocator)
        self.counts['off'] = 0

    def allocate(self, *given: Any) -> Allocation:
        """Allocate one wrench."""
        answer, axes = super().allocate(*given), self.allocator.problem.axes
        if answer.status and 'yaw' in axes:
            yaw = axes.index('yaw')
            self.counts['off'] += bool(wrong(answer.wrench[yaw], given[0][yaw]))
        return answer


def wrong(served: Array | float, demand: Array | float) -> Array:
    """Tell which values are reversed, exceed their demand, or are not zero without a demand."""
    low, high = np.minimum(demand, 0.0), np.maximum(demand, 0.0)
    return np.asarray((served < low - ROUNDING) | (served > high + ROUNDING))


def flights_table() -> str:
    """Return the results of the flights with each value of the option."""
    rows = []
    for name, (words, given) in product(shipped(flying=True), VARIANTS.items()):
        for title, case in both_masses(name, given):
            found = pd.DataFrame(flown(case, 'exact', each, Recorder) for each in MANOEUVRES)
            total = found.sum()
            rows.append((
                title, words, f'{total["recovered"]:.0f} of {len(found)}',
                f'{total["height_lost"]:.2f}', f'{total["heading_error"]:.1f}',
                f'{total["off"]:.0f} of {total["inexact"]:.0f}',
            ))
    titles = (
        *('vehicle', 'thrust deviation', 'recovered', 'height lost [m]'),
        *('heading error [rad s]', 'wrong yaw'),
    )
    rows.sort(key=lambda row: row[0])
    return telling('priorities', titles, rows, lambda row: row[0] in SHOWN, words=2)


def rows_table() -> str:
    """Return what is missed of the unattainable wrenches of PX4's test."""
    rows = np.loadtxt(ROWS, delimiter=',', skiprows=1)
    vehicle = Vehicle.from_parameters({
        'vehicle.mass': 2.0 / 9.81, 'vehicle.inertia': [1.0, 1.0, 1.0],
        'rotors.positions': [-1, -1, 0, 1, -1, 0, 1, 1, 0, -1, 1, 0],
        'rotors.spins': ['cw', 'ccw', 'cw', 'ccw'], 'rotors.thrust_coefficient': 1.0,
        'rotors.torque_coefficient': 1.0, 'rotors.speed_min': 0.0, 'rotors.speed_max': 1.0,
    })
    gamma, admissible = control_allocation_matrix(vehicle), AdmissibleSet(vehicle)
    demands = np.column_stack([4.0 * rows[:, 3], rows[:, :3]])
    options: dict[str, dict[str, Any]] = {
        **{f'`{value}`': {'axis_reversal': value} for value in AXIS_REVERSALS},
        **{f'`airmode_limit: {limit:g}`': {'airmode_limit': limit} for limit in LIMITS},
        'yaw before thrust': {'order': ['roll pitch', 'yaw', 'thrust']},
    }
    served = {
        f'`exact`, {words}': admissible.prioritize(demands, **own)
        for words, own in options.items()
    }
    for i, name in enumerate(('no airmode', 'roll-pitch airmode', 'roll-pitch-yaw airmode')):
        served[f'PX4, {name}'] = rows[:, 4 + 4 * i : 8 + 4 * i] @ gamma.T
    lines = []
    for name, wrenches in served.items():
        missing = np.abs(demands - wrenches)
        missed = np.linalg.norm(missing[:, 1:3], axis=1), missing[:, 0] / 4.0, missing[:, 3]
        yaw = str(np.count_nonzero(wrong(wrenches[:, 3], demands[:, 3])))
        lines.append((name, *(f'{each.sum():.2f}' for each in missed), yaw))
    return table(('', 'roll and pitch missed', 'thrust', 'yaw', 'wrong yaw'), lines)


if __name__ == '__main__':
    fill('priorities.md', rows=rows_table(), flights=flights_table())
