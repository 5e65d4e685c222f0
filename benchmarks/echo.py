"""The echo node: the cost of a message without an allocation."""

import numpy as np
from geometry_msgs.msg import WrenchStamped

from ca_ros.nodes import topics
from ca_ros.nodes.executable import run
from ca_ros.nodes.messages import fill_speeds, nanoseconds, speeds_message, wrench_numbers
from ca_ros.nodes.settings import AllocatorSettings
from ca_ros.nodes.vehicle_node import VehicleNode
from ca_ros.vehicle.settings import AXES
from ca_ros.vehicle.vehicle import Vehicle


class EchoNode(VehicleNode):
    """Answers each command/wrench with its numbers, as many as the vehicle has rotors.

    It has the same messages, labels, quality of service, executor and start as the allocator node,
    and no timer and no diagnostics.  It converts messages as rclpy does.
    """

    declared = AllocatorSettings

    def start_diagnostics(self) -> None:
        """Do not."""

    def connect(self) -> None:
        """Begin to answer."""
        self._speeds = self.publish_stream(topics.SPEED_COMMAND)
        self.subscribe_stream(topics.WRENCH, self._serve)

    def build(self, settings: AllocatorSettings) -> int:
        """Return the number of rotors."""
        return Vehicle.from_settings(settings.vehicle, settings.rotors).n

    def adopt(self, built: int) -> None:
        """Set the number of rotors from the next command on."""
        self._chosen = np.arange(built) % len(AXES)
        self._message = speeds_message(np.zeros(built), None)

    def _serve(self, command: WrenchStamped) -> None:
        numbers = np.array(wrench_numbers(command)).take(self._chosen)
        time = nanoseconds(command.header.stamp)
        self._speeds.publish(fill_speeds(self._message, numbers, time))


if __name__ == '__main__':
    about = 'Answer wrenches (command/wrench) with their numbers (command/motor_speed).'
    raise SystemExit(run('echo', EchoNode, about))
