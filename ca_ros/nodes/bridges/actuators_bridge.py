"""Rotor speeds and tilt angles to actuator_msgs/Actuators."""

from __future__ import annotations

from functools import partial
from typing import Any, ClassVar

from std_msgs.msg import Float64MultiArray

from ca_ros.nodes.bridges.bridge import Bridge
from ca_ros.nodes.bridges.motors import ordered, servo_angles, sound_speeds
from ca_ros.nodes.executable import run
from ca_ros.nodes.messages import speeds_stamp, stamp
from ca_ros.nodes.topics import COMMAND


class ActuatorsBridge(Bridge):
    """Publishes Actuators.velocity [rad/s] or Actuators.normalized, the throttle.

    If rotors tilt, Actuators.position has the angles of their servos [rad].
    """

    target: ClassVar[str] = 'command/actuators'
    takes_tilts = True

    def connect(self) -> None:
        from actuator_msgs.msg import Actuators

        self._kind = Actuators
        publisher = self.create_publisher(Actuators, self.target, COMMAND)
        self.subscribe_commands(self.passes(self._convert, publisher), self.vehicle.tilts)

    def fields(
        self, speeds: Float64MultiArray, *angles: Float64MultiArray
    ) -> dict[str, list[float]]:
        """Return the fields of Actuators."""
        found = sound_speeds(speeds.data, self.vehicle)
        name, values = 'velocity', found
        if self.settings.bridge.actuators == 'normalized':
            name, values = 'normalized', self.vehicle.throttles(found)
        fields = {name: ordered(values, self.order).tolist()}
        for message in angles:
            fields['position'] = servo_angles(message.data, self.vehicle, self.order).tolist()
        return fields

    def _convert(self, speeds: Float64MultiArray, *angles: Float64MultiArray) -> Any:
        message = self._kind(**self.fields(speeds, *angles))
        message.header.stamp = stamp(speeds_stamp(speeds) or 0)
        return message


ABOUT = 'Pass command/motor_speed on as actuator_msgs/Actuators (command/actuators).'
main = partial(run, 'actuators_bridge', ActuatorsBridge, ABOUT)
