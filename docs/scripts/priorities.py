"""Compare the values of `allocation.exact.reversal`; fill the tables of docs/priorities.md.

Flies manoeuvres that saturate the rotors with every shipped vehicle.  Takes about two minutes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import pi

import numpy as np
from manoeuvres import MANOEUVRES, Unlimited, heavy
from pages import DOCS, fill, shipped, telling

from ca_ros import AdmissibleSet, Vehicle, control_allocation_matrix, make_allocator
from ca_ros.allocation import Allocation
from ca_ros.arrays import Array
from ca_ros.evaluation.flight_metrics import RECOVERED
from ca_ros.evaluation.tables import table
from ca_ros.flight.closed_loop import fly
from ca_ros.flight.gains import Gains
from ca_ros.flight.rigid_body import RigidBody
from ca_ros.flight.waypoint import Waypoint
from ca_ros.nodes.parameters import load
from ca_ros.problem.prioritization import REVERSALS

ROWS = DOCS.parent / 'test' / 'px4_desaturation.csv'

DURATION = 8.0
"""Of each flight [s]."""

ROUNDING = 1e-9

SHOWN = ('`hexarotor`, heavy', '`quadrotor`', '`hexarotor_tilted`, heavy')
"""The vehicles on the page, with the largest differences."""


class Recorder:
    """An allocator that counts unattainable wrenches, and those with a wrong yaw."""

    def __init__(self, vehicle: Vehicle, reversal: str) -> None:
        self.allocator = make_allocator('exact', vehicle, reversal=reversal)
        self.yaw = vehicle.axes.index('yaw')
        self.saturated = self.off = 0

    def allocate(self, u: Array) -> Allocation:
        """Allocate one wrench."""
        answer = self.allocator.allocate(u)
        if answer.status:
            self.saturated += 1
            self.off += bool(off_sense(answer.wrench[self.yaw], u[self.yaw]))
        return answer


def off_sense(served: Array | float, demand: Array | float) -> Array:
    """Tell which values are reversed, exceed their demand, or are not zero without a demand."""
    low, high = np.minimum(demand, 0.0), np.maximum(demand, 0.0)
    return (served < low - ROUNDING) | (served > high + ROUNDING)


@dataclass
class Outcome:
    """Sums over manoeuvres; `drop` is the height lost [m], the others are integrals [rad s]."""

    recovered: int = 0
    drop: float = 0.0
    tilt: float = 0.0
    heading: float = 0.0
    saturated: int = 0
    off: int = 0

    def add(
        self, vehicle: Vehicle, gains: Gains, reversal: str, state: Array, to: Waypoint
    ) -> None:
        """Fly one manoeuvre."""
        recorder = Recorder(vehicle, reversal)
        flight = fly(
            Unlimited(vehicle, gains), recorder, RigidBody(vehicle), to, DURATION, state=state
        )
        step = flight.time[1]
        lowest = min(state[2], to.position[2])
        off = (flight.heading - to.heading + pi) % (2.0 * pi) - pi
        self.recovered += flight.position_error(to) <= RECOVERED
        self.drop += max(lowest - float(flight.position[:, 2].min()), 0.0)
        self.tilt += float(flight.tilt.sum()) * step
        self.heading += float(np.abs(off).sum()) * step
        self.saturated += recorder.saturated
        self.off += recorder.off


def flights_table() -> str:
    """Return the results of the flights with each value of `reversal`."""
    rows = []
    for plain in shipped():
        sound, gains = Vehicle.load(plain), Gains.from_parameters(load(plain))
        if sound.buoyancy:
            # A vehicle in water neither falls nor has a heavy variant.
            continue
        weighty = replace(sound, mass=heavy(sound))
        for vehicle, name in ((sound, plain), (weighty, f'{plain}, heavy')):
            for reversal in REVERSALS:
                found = Outcome()
                for state, to in MANOEUVRES.values():
                    found.add(vehicle, gains, reversal, state, to)
                rows.append(
                    (
                        f'`{plain}`{name.removeprefix(plain)}',
                        f'`{reversal}`',
                        f'{found.recovered} of {len(MANOEUVRES)}',
                        f'{found.drop:.2f}',
                        f'{found.tilt:.2f}',
                        f'{found.heading:.1f}',
                        f'{found.off} of {found.saturated}',
                    )
                )
    titles = (
        'vehicle',
        'thrust deviation',
        'recovered',
        'height lost [m]',
        'tilt [rad s]',
        'heading error [rad s]',
        'wrong yaw',
    )
    return telling('priorities', titles, rows, lambda row: row[0] in SHOWN, words=2)


def rows_table() -> str:
    """Return what is missed of the unattainable wrenches of PX4's test."""
    rows = np.loadtxt(ROWS, delimiter=',', skiprows=1)
    vehicle = Vehicle.from_parameters(
        {
            'vehicle.mass': 2.0 / 9.81,
            'vehicle.inertia': [1.0, 1.0, 1.0],
            'rotors.positions': [-1, -1, 0, 1, -1, 0, 1, 1, 0, -1, 1, 0],
            'rotors.spins': ['cw', 'ccw', 'cw', 'ccw'],
            'rotors.thrust_coefficient': 1.0,
            'rotors.torque_coefficient': 1.0,
            'rotors.speed_min': 0.0,
            'rotors.speed_max': 1.0,
        }
    )
    gamma, admissible = control_allocation_matrix(vehicle), AdmissibleSet(vehicle)
    demands = np.column_stack([4.0 * rows[:, 3], rows[:, :3]])
    served = {
        f'`exact`, `{reversal}`': admissible.prioritize(demands, reversal=reversal)
        for reversal in REVERSALS
    }
    served['`exact`, yaw before thrust'] = admissible.prioritize(
        demands, ['roll pitch', 'yaw', 'thrust']
    )
    for i, name in enumerate(('no airmode', 'roll-pitch airmode', 'roll-pitch-yaw airmode')):
        served[f'PX4, {name}'] = rows[:, 4 + 4 * i : 8 + 4 * i] @ gamma.T
    lines = []
    for name, wrenches in served.items():
        missing = np.abs(demands - wrenches)
        lines.append(
            (
                name,
                f'{np.linalg.norm(missing[:, 1:3], axis=1).sum():.2f}',
                f'{missing[:, 0].sum() / 4.0:.2f}',
                f'{missing[:, 3].sum():.2f}',
                str(np.count_nonzero(off_sense(wrenches[:, 3], demands[:, 3]))),
            )
        )
    titles = ('', 'roll and pitch missed', 'thrust', 'yaw', 'wrong yaw')
    return table(titles, lines)


def main() -> None:
    """Fill the page."""
    fill('priorities.md', rows=rows_table(), flights=flights_table())


if __name__ == '__main__':
    main()
