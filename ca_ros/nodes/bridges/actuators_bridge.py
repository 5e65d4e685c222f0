"""Rotor speeds and tilt angles to actuator_msgs/Actuators."""

from functools import partial
from typing import Any

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

    takes_tilts = True

    def __init__(self, node_name: str = 'actuators_bridge', **kwargs: Any) -> None:
        super().__init__(node_name, **kwargs)
        pass_actuators(self, 'command/actuators')


def pass_actuators(bridge: Bridge, target: str, gazebo: bool = False) -> None:
    """Let a bridge pass command/motor_speed on to a topic of Actuators.

    `gazebo`: as its model takes them, velocities that are not negative.
    """
    from actuator_msgs.msg import Actuators

    def convert(speeds: Float64MultiArray, *angles: Float64MultiArray) -> Any:
        vehicle, order = bridge.vehicle, bridge.order
        name, values = 'velocity', sound_speeds(speeds.data, vehicle)
        if gazebo and values.min() < 0.0:
            raise ValueError(f'rotor speeds {[*speeds.data]}: Gazebo takes none that is negative')
        if not gazebo and bridge.settings.bridge.actuators == 'normalized':
            name, values = 'normalized', vehicle.throttles(values)
        message = Actuators(**{name: ordered(values, order).tolist()})
        for each in angles:
            message.position = servo_angles(each.data, vehicle, order).tolist()
        message.header.stamp = stamp(speeds_stamp(speeds) or 0)
        return message

    publisher = bridge.create_publisher(Actuators, target, COMMAND)
    bridge.streams.subscribe_commands(bridge.passes(convert, publisher), bridge.vehicle.tilts)


ABOUT = 'Pass command/motor_speed on as actuator_msgs/Actuators (command/actuators).'
main = partial(run, 'actuators_bridge', ActuatorsBridge, ABOUT)
