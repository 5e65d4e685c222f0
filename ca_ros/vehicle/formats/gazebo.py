"""Gazebo's motor models of a vehicle.

The model takes its speed from `velocity` of actuator_msgs/Actuators at its `motorNumber`, from 0
and never negative, in both senses of rotation.
"""

import argparse
from functools import partial
from xml.etree import ElementTree

from ca_ros.arguments import command
from ca_ros.vehicle.vehicle import Vehicle

TOPIC = 'command/motors'


def motor_models(vehicle: Vehicle) -> str:
    """Return Gazebo's plugins of a vehicle's rotors in SDF; links are rotor_1 and so on.

    Raises a ValueError if Gazebo's model is not that of the rotors.
    """
    vehicle.servos.refuse('model of Gazebo')
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
            'motorType': 'velocity', 'commandSubTopic': TOPIC,
            'turningDirection': 'cw' if vehicle.spins[i] > 0.0 else 'ccw',
            'maxRotVelocity': f'{vehicle.speed_max[i]:.9g}', 'motorConstant': f'{thrust:.9g}',
            'momentConstant': f'{torque / thrust:.9g}',
        }
        for name, value in values.items():
            ElementTree.SubElement(plugin, name).text = str(value)
        ElementTree.indent(plugin)
        blocks.append(ElementTree.tostring(plugin, encoding='unicode'))
    return '\n'.join(blocks)


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    parser.add_argument('vehicle', help='a shipped vehicle or a parameter file')


def run(options: argparse.Namespace) -> None:
    """Print the motor models."""
    print(motor_models(Vehicle.load(options.vehicle)))


main = partial(command, 'gazebo-motors', add_options, run)
