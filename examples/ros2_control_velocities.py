#!/usr/bin/env python3
"""Rotor speeds to ros2_control: command/motor_speed with the signs of the joints.

A JointGroupVelocityController takes a std_msgs/Float64MultiArray on ~/commands, one velocity for
each of its `joints`: list them in the order of the rotors in the vehicle's parameter file.  Where
each counts its velocity positive in the sense in which its rotor turns, no adapter is needed:

    ros2 run ca_ros allocator --vehicle my.yaml --ros-args \\
        -r command/motor_speed:=/rotor_controller/commands

This one is for joints whose axes point along the thrust: by the right-hand rule a rotor that turns
clockwise, seen from above, then has a negative velocity:

    python3 examples/ros2_control_velocities.py --vehicle my.yaml --ros-args \\
        -r ~/commands:=/rotor_controller/commands
"""

from __future__ import annotations

import argparse
import signal
import sys
from collections.abc import Sequence

from ca_ros import ParameterError, Vehicle


def joint_velocities(speeds: Sequence[float], spins: Sequence[float]) -> list[float]:
    """Return the velocity of each joint [rad/s], positive counter-clockwise.

    Parameters
    ----------
    speeds : (n,) sequence
        [rad/s]
    spins : (n,) sequence
        `Vehicle.spins`: +1 for a rotor that turns clockwise, -1 for one that does not.

    Raises
    ------
    ValueError
        If there are more or fewer speeds than rotors.
    """
    if len(speeds) != len(spins):
        raise ValueError(f'{len(speeds)} rotor speeds for {len(spins)} rotors')
    return [
        float(speed if spin < 0.0 else -speed) for speed, spin in zip(speeds, spins, strict=True)
    ]


def main() -> None:
    """Run the node."""
    parser = argparse.ArgumentParser(
        description='Pass rotor speeds (command/motor_speed) on to a JointGroupVelocityController '
        '(~/commands), negative for rotors that turn clockwise.',
        epilog='ROS arguments follow --ros-args, for instance: '
        '--ros-args -r ~/commands:=/rotor_controller/commands',
    )
    parser.add_argument('--vehicle', required=True, help='a shipped vehicle or a parameter file')
    words = sys.argv[1:]
    own = words[: words.index('--ros-args')] if '--ros-args' in words else words
    try:
        spins = Vehicle.load(parser.parse_args(own).vehicle).spins.tolist()
    except ParameterError as error:
        sys.exit(f'ros2_control_velocities: {error}')
    try:
        import rclpy
        from rclpy.signals import SignalHandlerOptions
        from rclpy.utilities import try_shutdown
        from std_msgs.msg import Float64MultiArray

        from ca_ros.nodes.qos import COMMAND, requested
    except ImportError as error:
        sys.exit(f'ros2_control_velocities: {error}: needs a sourced ROS 2 Jazzy with ca_ros')
    stop: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda received, _: stop.append(received))
    # rclpy's own handlers sometimes leave an idle node hanging.
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    node = rclpy.create_node('ros2_control_velocities')
    publisher = node.create_publisher(Float64MultiArray, '~/commands', COMMAND)

    def forward(command: Float64MultiArray) -> None:
        try:
            data = joint_velocities(command.data, spins)
        except ValueError as error:
            node.get_logger().warning(f'dropped: {error}', throttle_duration_sec=1.0)
            return
        publisher.publish(Float64MultiArray(layout=command.layout, data=data))

    node.create_subscription(
        Float64MultiArray, 'command/motor_speed', forward, requested('realtime')
    )
    while not stop:
        rclpy.spin_once(node, timeout_sec=0.1)
    node.destroy_node()
    try_shutdown()


if __name__ == '__main__':
    main()
