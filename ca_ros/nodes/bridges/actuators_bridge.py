"""Rotor speeds to actuator_msgs/Actuators: as velocities, or as throttles."""

from __future__ import annotations

from functools import partial
from typing import Any, ClassVar

from std_msgs.msg import Float64MultiArray

from ca_ros.nodes import topics
from ca_ros.nodes.bridges.bridge import Bridge
from ca_ros.nodes.bridges.motors import ordered, sound_speeds
from ca_ros.nodes.executable import run
from ca_ros.nodes.messages import speeds_stamp, stamp
from ca_ros.nodes.qos import COMMAND


class ActuatorsBridge(Bridge):
    """Publishes Actuators.velocity [rad/s] or Actuators.normalized, the throttle."""

    target: ClassVar[str] = 'command/actuators'

    def connect(self) -> None:
        from actuator_msgs.msg import Actuators

        self._kind = Actuators
        publisher = self.create_publisher(Actuators, self.target, COMMAND)
        self.subscribe_stream(topics.SPEED_COMMAND, self.passes(self._convert, publisher))

    def fields(self, speeds: Float64MultiArray) -> dict[str, list[float]]:
        """Return the fields of Actuators."""
        found = sound_speeds(speeds.data, self.vehicle)
        if self.settings.bridge.actuators == 'normalized':
            return {'normalized': ordered(self.vehicle.throttles(found), self.order).tolist()}
        return {'velocity': ordered(found, self.order).tolist()}

    def _convert(self, speeds: Float64MultiArray) -> Any:
        message = self._kind(**self.fields(speeds))
        message.header.stamp = stamp(speeds_stamp(speeds) or 0)
        return message


ABOUT = 'Pass command/motor_speed on as actuator_msgs/Actuators (command/actuators).'
main = partial(run, 'actuators_bridge', ActuatorsBridge, ABOUT)
