"""Rotor speeds and tilt angles to actuator_msgs/Actuators."""

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
        self.subscribe_commands(self.passes(self.convert, publisher), self.vehicle.tilts)

    def convert(self, speeds: Float64MultiArray, *angles: Float64MultiArray) -> Any:
        """Return the message."""
        name, values = 'velocity', sound_speeds(speeds.data, self.vehicle)
        if self.settings.bridge.actuators == 'normalized':
            name, values = 'normalized', self.vehicle.throttles(values)
        message = self._kind(**{name: ordered(values, self.order).tolist()})
        for each in angles:
            message.position = servo_angles(each.data, self.vehicle, self.order).tolist()
        message.header.stamp = stamp(speeds_stamp(speeds) or 0)
        return message


ABOUT = 'Pass command/motor_speed on as actuator_msgs/Actuators (command/actuators).'
main = partial(run, 'actuators_bridge', ActuatorsBridge, ABOUT)
