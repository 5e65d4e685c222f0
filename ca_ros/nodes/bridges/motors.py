"""Rotor speeds as the motors of others take them: order, signs, and Gazebo's motor models."""

import argparse
from collections.abc import Sequence
from xml.etree import ElementTree

import numpy as np

from ca_ros.arrays import Array
from ca_ros.settings import Numbers, ParameterError
from ca_ros.vehicle.tilts import refuse_tilts
from ca_ros.vehicle.vehicle import Vehicle

GAZEBO_TOPIC = 'command/motors'


def order_of(numbers: Numbers, n: int) -> list[int]:
    """Return the setting `bridge.order` as numbers from 1; empty: the order of the vehicle.

    Raises a ParameterError if it does not have each rotor once.
    """
    order = np.ravel(np.asarray(numbers, dtype=float)).tolist()
    if order == [0.0]:
        return []
    if sorted(order) != list(range(1, n + 1)):
        raise ParameterError(f'bridge.order: expected each of the rotors 1 to {n} once: {order}')
    return [int(number) for number in order]


def ordered(values: Array, order: Sequence[int]) -> Array:
    """Return values (n,) of the rotors in the order of the motors.

    `values` (n,).  `order`: for each motor the rotor that it is, from 1; empty: the same order.
    """
    return values[np.array(order) - 1] if order else values


def sound_speeds(speeds: Sequence[float] | Array, vehicle: Vehicle) -> Array:
    """Return rotor speeds as an array (n,) [rad/s].

    Raises a ValueError if there is not one speed for each rotor, at rest or within its bounds at
    the highest voltage.
    """
    found = np.asarray(speeds, dtype=float)
    if found.shape != (vehicle.n,):
        raise ValueError(f'{len(found)} rotor speeds for {vehicle.n} rotors')
    low, high = vehicle.rated_speeds
    if not ((found >= np.minimum(low, 0.0)) & (found <= high)).all():
        raise ValueError(f'rotor speeds out of bounds: {found} rad/s')
    return found


def servo_angles(angles: Sequence[float], vehicle: Vehicle, order: Sequence[int]) -> Array:
    """Return tilt angles (k,) [rad], in the order of the motors as in `ordered`.

    Raises a ValueError if there is not one angle for each servo, within its limits.
    """
    assert vehicle.tilts is not None
    found, rotors = np.asarray(angles, dtype=float), vehicle.tilts.rotors
    low, high = vehicle.tilts.sound.limits
    if found.shape != low.shape or not ((found >= low) & (found <= high)).all():
        raise ValueError(f'tilt angles {found}: expected {len(low)}, from {low} to {high} rad')
    places = [k for motor in order for k, rotor in enumerate(rotors) if rotor == motor - 1]
    return found[places] if order else found


def joint_velocities(speeds: Sequence[float], vehicle: Vehicle) -> Array:
    """Return the velocity of each rotor's joint (n,), counter-clockwise seen from above [rad/s].

    By the right-hand rule, a clockwise rotor has a negative velocity about an axis that points
    along the thrust.
    """
    return -vehicle.spins * sound_speeds(speeds, vehicle)


def motor_models(vehicle: Vehicle) -> str:
    """Return Gazebo's plugins of a vehicle's rotors in SDF; links are rotor_1 and so on.

    Raises a ValueError if Gazebo's model is not that of the rotors.
    """
    refuse_tilts(vehicle.tilts, 'model of Gazebo')
    if (vehicle.speed_min < 0.0).any():
        raise ValueError('rotors reverse (rotors.speed_min < 0), which Gazebo does not support')
    if not vehicle.curve.square:
        raise ValueError('rotors.thrust_curve: thrusts in Gazebo are k_f w^2')
    blocks = []
    for i in range(vehicle.n):
        plugin = ElementTree.Element(
            'plugin', filename='gz-sim-multicopter-motor-model-system',
            name='gz::sim::systems::MulticopterMotorModel',
        )
        thrust, torque = vehicle.thrust_coefficient[i], vehicle.torque_coefficient[i]
        values = {
            'jointName': f'rotor_{i + 1}_joint', 'linkName': f'rotor_{i + 1}', 'motorNumber': i,
            'motorType': 'velocity', 'commandSubTopic': GAZEBO_TOPIC,
            'turningDirection': 'cw' if vehicle.spins[i] > 0.0 else 'ccw',
            'maxRotVelocity': f'{vehicle.speed_max[i]:.9g}', 'motorConstant': f'{thrust:.9g}',
            'momentConstant': f'{torque / thrust:.9g}',
        }
        for name, value in values.items():
            ElementTree.SubElement(plugin, name).text = str(value)
        ElementTree.indent(plugin)
        blocks.append(ElementTree.tostring(plugin, encoding='unicode'))
    return '\n'.join(blocks)


COMMAND = 'gazebo-motors', "print Gazebo's motor models of a vehicle, for its SDF"


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    parser.add_argument('vehicle', help='a shipped vehicle or a parameter file')


def run(options: argparse.Namespace) -> None:
    """Print the motor models."""
    print(motor_models(Vehicle.load(options.vehicle)))
