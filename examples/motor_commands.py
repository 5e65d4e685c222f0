"""Pass command/motor_speed on to motors of other kinds: an example to copy.

    python examples/motor_commands.py hexarotor             # to a velocity controller
    python examples/motor_commands.py hexarotor velocity    # actuator_msgs/Actuators [rad/s]
    python examples/motor_commands.py hexarotor normalized  # the same, throttles

ros2_control's JointGroupVelocityController and ForwardCommandController take one number for each
joint (``-r commands:=/CONTROLLER/commands``).  By the right-hand rule, a rotor that turns
clockwise, seen from above, has a negative velocity about an axis along its thrust.  Actuators has
no signs, as Gazebo's MulticopterMotorModel takes it (``-r command/actuators:=command/motors``).
"""

import sys
from collections.abc import Sequence
from typing import Any

import numpy as np
import rclpy
from rclpy.node import Node
from rclpy.utilities import remove_ros_args
from std_msgs.msg import Float64MultiArray

from ca_ros import Vehicle


class MotorCommands(Node):
    """Converts each message; `order` has for each motor the rotor that it is, from 1."""

    def __init__(
        self, vehicle: str, order: Sequence[int] = (), field: str | None = None, **kwargs: Any
    ) -> None:
        super().__init__('motor_commands', **kwargs)
        self.vehicle, self.field = Vehicle.load(vehicle), field
        self.order = np.array(order or range(1, self.vehicle.n + 1)) - 1
        if field is None:
            self.publisher = self.create_publisher(Float64MultiArray, 'commands', 1)
        else:
            from actuator_msgs.msg import Actuators  # apt install ros-jazzy-actuator-msgs

            self.kind, topic = Actuators, 'command/actuators'
            self.publisher = self.create_publisher(Actuators, topic, 1)
        self.create_subscription(Float64MultiArray, 'command/motor_speed', self.convert, 1)

    def convert(self, message: Float64MultiArray) -> None:
        """Pass on one speed for each rotor within its bounds; others are dropped."""
        speeds, limit = np.array(message.data), self.vehicle.speed_max
        if speeds.shape != limit.shape or not (np.abs(speeds) <= limit).all():
            self.get_logger().warning(f'dropped: {speeds}', throttle_duration_sec=1.0)
        elif self.field is None:
            signed = -self.vehicle.spins * speeds + 0.0
            self.publisher.publish(Float64MultiArray(data=signed[self.order].tolist()))
        else:
            given = self.vehicle.throttles(speeds) if self.field == 'normalized' else speeds
            self.publisher.publish(self.kind(**{self.field: given[self.order].tolist()}))


if __name__ == '__main__':
    words = remove_ros_args(sys.argv)[1:]
    if len(words) not in (1, 2) or words[1:] not in ([], ['velocity'], ['normalized']):
        sys.exit('motor_commands: expected VEHICLE [velocity | normalized] [--ros-args ...]')
    rclpy.init()
    rclpy.spin(MotorCommands(words[0], (), *words[1:]))
