#!/usr/bin/env python3
"""Rotor speeds to Gazebo: command/motor_speed becomes actuator_msgs/Actuators.

Gazebo's MulticopterMotorModel takes its speed from `velocity` at its `motorNumber`, from 0 on and
never negative, in both senses of rotation, which `turningDirection` sets.  --sdf prints the
plugins of a vehicle, so that Gazebo and the allocator agree on order, spins and coefficients;
ros_gz_bridge carries the message:

    python3 examples/gazebo_actuators.py --sdf my.yaml    # into the model's SDF
    ros2 run ros_gz_bridge parameter_bridge \\
        /uav1/command/motors@actuator_msgs/msg/Actuators]gz.msgs.Actuators
    python3 examples/gazebo_actuators.py --ros-args -r __ns:=/uav1
"""

from __future__ import annotations

import argparse
import signal
import sys
from collections.abc import Sequence
from xml.etree import ElementTree

from ca_ros import Vehicle

TOPIC = 'command/motors'


def velocities(speeds: Sequence[float]) -> list[float]:
    """Return Actuators.velocity for rotor speeds (n,) [rad/s]."""
    if not all(0.0 <= speed < float('inf') for speed in speeds):
        raise ValueError(f'rotor speeds {list(speeds)}: expected finite ones, none negative')
    return [float(speed) for speed in speeds]


def motor_models(vehicle: Vehicle) -> str:
    """Return the plugins of a vehicle's rotors in SDF; joints and links are rotor_1 and so on."""
    if (vehicle.speed_min < 0.0).any():
        raise ValueError('rotors reverse (rotors.speed_min < 0), which is not supported')
    blocks = []
    for i in range(vehicle.n):
        plugin = ElementTree.Element(
            'plugin',
            filename='gz-sim-multicopter-motor-model-system',
            name='gz::sim::systems::MulticopterMotorModel',
        )
        thrust, torque = vehicle.thrust_coefficient[i], vehicle.torque_coefficient[i]
        values = {
            'jointName': f'rotor_{i + 1}_joint',
            'linkName': f'rotor_{i + 1}',
            'motorNumber': i,
            'motorType': 'velocity',
            'commandSubTopic': TOPIC,
            'turningDirection': 'cw' if vehicle.spins[i] > 0.0 else 'ccw',
            'maxRotVelocity': f'{vehicle.speed_max[i]:.9g}',
            'motorConstant': f'{thrust:.9g}',
            'momentConstant': f'{torque / thrust:.9g}',
        }
        for name, value in values.items():
            ElementTree.SubElement(plugin, name).text = str(value)
        ElementTree.indent(plugin)
        blocks.append(ElementTree.tostring(plugin, encoding='unicode'))
    return '\n'.join(blocks)


def main() -> None:
    """Run the node."""
    parser = argparse.ArgumentParser(
        description='Pass rotor speeds (command/motor_speed) on to Gazebo, as '
        f'actuator_msgs/Actuators ({TOPIC}).',
        epilog='ROS arguments follow --ros-args, for instance: --ros-args -r __ns:=/uav1',
    )
    parser.add_argument(
        '--sdf',
        metavar='VEHICLE',
        help="print the motor models of a vehicle for the model's SDF, and end",
    )
    words = sys.argv[1:]
    own = words[: words.index('--ros-args')] if '--ros-args' in words else words
    if vehicle := parser.parse_args(own).sdf:
        try:
            print(motor_models(Vehicle.load(vehicle)))
        except ValueError as error:
            sys.exit(f'gazebo_actuators: {error}')
        return
    try:
        import rclpy
        from actuator_msgs.msg import Actuators
        from rclpy.signals import SignalHandlerOptions
        from rclpy.utilities import try_shutdown
        from std_msgs.msg import Float64MultiArray

        from ca_ros.nodes.messages import speeds_stamp, stamp
        from ca_ros.nodes.qos import COMMAND, requested
    except ImportError as error:
        sys.exit(
            f'gazebo_actuators: {error}: needs a sourced ROS 2 Jazzy with ca_ros and '
            'ros-jazzy-actuator-msgs'
        )
    stop: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda received, _: stop.append(received))
    # rclpy's own handlers sometimes leave an idle node hanging.
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    node = rclpy.create_node('gazebo_actuators')
    publisher = node.create_publisher(Actuators, TOPIC, COMMAND)

    def forward(command: Float64MultiArray) -> None:
        try:
            message = Actuators(velocity=velocities(command.data))
        except ValueError as error:
            node.get_logger().warning(f'dropped: {error}', throttle_duration_sec=1.0)
            return
        message.header.stamp = stamp(speeds_stamp(command) or 0)
        publisher.publish(message)

    node.create_subscription(
        Float64MultiArray, 'command/motor_speed', forward, requested('realtime')
    )
    while not stop:
        rclpy.spin_once(node, timeout_sec=0.1)
    node.destroy_node()
    try_shutdown()


if __name__ == '__main__':
    main()
