"""Rotor speeds to ros2_control: command/motor_speed with the signs of the joints.

A JointGroupVelocityController takes a Float64MultiArray on ~/commands, one velocity for each of
its joints.
"""

from array import array
from functools import partial
from typing import Any

from std_msgs.msg import Float64MultiArray

from ca_ros.nodes import topics
from ca_ros.nodes.bridges.bridge import Bridge
from ca_ros.nodes.bridges.motors import joint_velocities, ordered
from ca_ros.nodes.executable import run
from ca_ros.nodes.topics import COMMAND


class Ros2ControlBridge(Bridge):
    """Publishes the velocities of the joints, negative for rotors that turn clockwise."""

    def __init__(self, node_name: str = 'ros2_control_bridge', **kwargs: Any) -> None:
        super().__init__(node_name, **kwargs)
        commands = self.create_publisher(Float64MultiArray, '~/commands', COMMAND)
        self.streams.subscribe(topics.SPEED_COMMAND, self.passes(self._convert, commands))

    def _convert(self, message: Float64MultiArray) -> Float64MultiArray:
        velocities = ordered(joint_velocities(message.data, self.vehicle), self.order)
        return Float64MultiArray(layout=message.layout, data=array('d', velocities.tobytes()))


ABOUT = 'Pass command/motor_speed on to a JointGroupVelocityController (~/commands).'
main = partial(run, 'ros2_control_bridge', Ros2ControlBridge, ABOUT)
