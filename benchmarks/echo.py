"""The echo node: the cost of a message without an allocation."""

from typing import Any

import numpy as np
from geometry_msgs.msg import WrenchStamped
from rclpy.node import Node

from ca_ros.nodes import topics
from ca_ros.nodes.diagnostics import Diagnostics
from ca_ros.nodes.executable import run
from ca_ros.nodes.messages import fill_speeds, nanoseconds, speeds_message, wrench_numbers
from ca_ros.nodes.parameters import Parameters
from ca_ros.nodes.stream import Streams
from ca_ros.parameter_files import AllocatorSettings
from ca_ros.vehicle.settings import AXES
from ca_ros.vehicle.vehicle import Vehicle


class EchoNode(Node):
    """Answers each command/wrench with its numbers, as many as the vehicle has rotors.

    It has the same messages, labels, quality of service, executor and start as the allocator node,
    and no timer and no diagnostics.  It converts messages as rclpy does.
    """

    declared = AllocatorSettings

    def __init__(self, node_name: str = 'echo', **kwargs: Any) -> None:
        super().__init__(node_name, **kwargs)
        settings = Parameters(self, self.declared).settings
        n = Vehicle.from_settings(settings.vehicle, settings.rotors).n
        self._chosen = np.arange(n) % len(AXES)
        self._message = speeds_message(np.zeros(n), None)
        diagnostics = Diagnostics(self, 'echo', str(settings.vehicle.name))
        streams = Streams(self, settings.mode, diagnostics.drop, diagnostics.counts)
        self._speeds = streams.publish(topics.SPEED_COMMAND)
        streams.subscribe(topics.WRENCH, self._serve)

    def _serve(self, command: WrenchStamped) -> None:
        numbers = np.array(wrench_numbers(command)).take(self._chosen)
        time = nanoseconds(command.header.stamp)
        self._speeds.publish(fill_speeds(self._message, numbers, time))


if __name__ == '__main__':
    about = 'Answer wrenches (command/wrench) with their numbers (command/motor_speed).'
    raise SystemExit(run('echo', EchoNode, about))
