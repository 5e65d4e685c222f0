"""``ca_ros mixer``: the pseudo-inverse of a vehicle as the mixer of another autopilot.

A mixer gives each motor a throttle: a sum of thrust, roll, pitch and yaw, each times a column of
factors.  The columns are those of the pseudo-inverse of Gamma, each scaled so that its greatest
factor is 1.  Therefore Gamma times the mixer is diagonal: a demand about one axis moves no other.
Both autopilots turn right with a positive yaw; ArduPilot raises the nose with a positive pitch,
Betaflight lowers it [1]_ [2]_.

References
----------
.. [1] Betaflight, Mixer.md, "Custom motor mixing", as of 2024: ``mmix N THROTTLE ROLL PITCH YAW``;
   a motor in front at the left that turns clockwise has 1, 1, -1, -1.
.. [2] ArduPilot, AP_MotorsMatrix.cpp, as of 2024: the roll factor of a motor at the right is -1,
   the pitch factor at the front 1, the yaw factor of one that turns counter-clockwise 1.
"""

import argparse
from collections.abc import Sequence
from functools import partial

import numpy as np

from ca_ros.arguments import add_order, command, rotor_rows
from ca_ros.arrays import Array
from ca_ros.vehicle.effectiveness import control_allocation_matrix
from ca_ros.vehicle.settings import AXES
from ca_ros.vehicle.vehicle import Vehicle

SIGNS = {'betaflight': (1.0, 1.0, 1.0, -1.0), 'ardupilot': (1.0, 1.0, -1.0, -1.0)}
"""The signs of thrust, roll, pitch and yaw, which are positive forward-left-up here."""

MOTORS = {'betaflight': 8, 'ardupilot': 12}
"""The most motors; ArduPilot has 32 on some boards, 12 on all."""

UPRIGHT, SAME = 1.0 - 1e-6, 1e-6


def mixer(vehicle: Vehicle) -> Array:
    """Return the factors (n, 4) of thrust, roll, pitch and yaw for each motor.

    The greatest factor of each column is 1.  Raises a ValueError if the rotors cannot give the
    four axes, tilt, or have unequal ranges, which these mixers cannot take into account.
    """
    vehicle.servos.refuse('mixer of another autopilot')
    if vehicle.axes != AXES[2:]:
        raise ValueError(
            f'mixers have the axes {", ".join(AXES[2:])}; this vehicle has '
            f'{", ".join(vehicle.axes)}')
    if (vehicle.rotor_axes[:, 2] < UPRIGHT).any():
        raise ValueError('a mixer is for rotors that point upwards: rotors.axes')
    low, high = vehicle.thrust_min, vehicle.thrust_max
    if np.ptp(low) > SAME * high.max() or np.ptp(high) > SAME * high.max():
        raise ValueError(
            'the rotors have unequal ranges of thrust; these mixers take one range for all motors')
    gamma = control_allocation_matrix(vehicle)
    if np.linalg.matrix_rank(gamma) < len(gamma):
        raise ValueError('the rotors cannot control all four axes: see ca_ros audit')
    columns = np.linalg.pinv(gamma)
    if columns[:, 0].min() <= SAME * columns[:, 0].max():
        idle = (np.flatnonzero(columns[:, 0] <= SAME * columns[:, 0].max()) + 1).tolist()
        raise ValueError(
            f'rotors {idle} would get no throttle, since only then the torques cancel: see '
            'ca_ros audit')
    return np.asarray(columns / np.abs(columns).max(axis=0), float)


def betaflight(vehicle: Vehicle, order: Sequence[int] = ()) -> str:
    """Return the commands of Betaflight's command line.

    `order`: the rotor that each motor is, from 1 on; default: the same order.
    """
    rows = _ordered(vehicle, order, 'betaflight')
    lines = ['mixer CUSTOM', 'mmix reset']
    lines += [
        f'mmix {motor} ' + ' '.join(f'{value:.3f}' for value in row)
        for motor, row in enumerate(rows.tolist())]
    return '\n'.join([*lines, 'save'])


def ardupilot(vehicle: Vehicle, order: Sequence[int] = ()) -> str:
    """Return a Lua script for ArduPilot's scripting matrix, FRAME_CLASS 15.

    `order`: as for `betaflight`.
    """
    rows = _ordered(vehicle, order, 'ardupilot')
    lines = [f'-- {len(rows)} motors; set FRAME_CLASS to 15, SCR_ENABLE to 1']
    for motor, (thrust, roll, pitch, yaw) in enumerate(rows.tolist()):
        lines.append(
            f'MotorsMatrix:add_motor_raw({motor}, {roll:.6f}, {pitch:.6f}, {yaw:.6f}, '
            f'{motor + 1})')
        if abs(thrust - 1.0) > SAME:
            lines.append(f'MotorsMatrix:set_throttle_factor({motor}, {thrust:.6f})')
    return '\n'.join([
        *lines, f"assert(MotorsMatrix:init({len(rows)}), 'the motors were not set up')",
        "motors:set_frame_string('ca_ros')"])


STYLES = {'betaflight': betaflight, 'ardupilot': ardupilot}


def _ordered(vehicle: Vehicle, order: Sequence[int], style: str) -> Array:
    if vehicle.n > MOTORS[style]:
        raise ValueError(f'{vehicle.n} rotors, but {style} has {MOTORS[style]} motors at most')
    rows = rotor_rows(order, vehicle.n)
    # Without the sign of a zero.
    return np.round(mixer(vehicle)[rows] * SIGNS[style], 6) + 0.0


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    parser.add_argument('style', choices=STYLES)
    parser.add_argument('vehicle', help='a shipped vehicle or a parameter file')
    add_order(parser, 'the rotor that each motor is')


def run(options: argparse.Namespace) -> None:
    """Print the mixer."""
    print(STYLES[options.style](Vehicle.load(options.vehicle), options.order))


main = partial(command, 'mixer', add_options, run)
