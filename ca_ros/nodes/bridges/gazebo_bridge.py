"""Rotor speeds to Gazebo's MulticopterMotorModel, and its odometry to the controller.

The model takes its speed from `velocity` of actuator_msgs/Actuators at its `motorNumber`, from 0
and never negative, in both senses of rotation.  ``python -m ca_ros gazebo-motors VEHICLE`` prints
the models of a vehicle; ros_gz_bridge carries the messages.
"""

from functools import partial
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseStamped, TwistStamped
from nav_msgs.msg import Odometry
from std_msgs.msg import Float64MultiArray

from ca_ros.nodes import topics
from ca_ros.nodes.bridges.actuators_bridge import ActuatorsBridge
from ca_ros.nodes.bridges.motors import GAZEBO_TOPIC
from ca_ros.nodes.executable import run
from ca_ros.nodes.messages import pose_arrays, state_messages, twist_arrays


class GazeboBridge(ActuatorsBridge):
    """Publishes Actuators.velocity, and pose and body velocity of an odometry."""

    takes_tilts = False
    target = GAZEBO_TOPIC

    def connect(self) -> None:
        """Pass the odometry of Gazebo's OdometryPublisher on, too."""
        super().connect()
        publishers = self.publish_stream(topics.POSE), self.publish_stream(topics.VELOCITY)
        self.listen(Odometry, 'odometry', self.passes(self._state, *publishers))

    def convert(self, speeds: Float64MultiArray, *angles: Float64MultiArray) -> Any:
        message = super().convert(speeds, *angles)
        if min(speeds.data) < 0.0:
            raise ValueError(f'rotor speeds {[*speeds.data]}: Gazebo takes none that is negative')
        return message

    def _state(self, odometry: Odometry) -> tuple[PoseStamped, TwistStamped]:
        state = *pose_arrays(odometry.pose), *twist_arrays(odometry.twist)
        if not np.isfinite(np.concatenate(state)).all():
            raise ValueError('odometry: expected finite numbers')
        frames = self.settings.world_frame, self.settings.command_frame
        return state_messages(*state, odometry.header.stamp, *frames)


ABOUT = 'Pass command/motor_speed on to Gazebo (command/motors), and its odometry back.'
main = partial(run, 'gazebo_bridge', GazeboBridge, ABOUT)
