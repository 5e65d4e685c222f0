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

from ca_ros.nodes import topics
from ca_ros.nodes.bridges.actuators_bridge import pass_actuators
from ca_ros.nodes.bridges.bridge import Bridge
from ca_ros.nodes.bridges.motors import GAZEBO_TOPIC
from ca_ros.nodes.executable import run
from ca_ros.nodes.messages import pose_arrays, state_messages, twist_arrays


class GazeboBridge(Bridge):
    """Publishes Actuators.velocity, and pose and body velocity of an odometry."""

    def __init__(self, node_name: str = 'gazebo_bridge', **kwargs: Any) -> None:
        super().__init__(node_name, **kwargs)
        pass_actuators(self, GAZEBO_TOPIC, gazebo=True)
        # The odometry of Gazebo's OdometryPublisher is passed on, too.
        publishers = self.streams.publish(topics.POSE), self.streams.publish(topics.VELOCITY)
        self.streams.listen(Odometry, 'odometry', self.passes(self._odometry, *publishers))

    def _odometry(self, odometry: Odometry) -> tuple[PoseStamped, TwistStamped]:
        state = *pose_arrays(odometry.pose), *twist_arrays(odometry.twist)
        if not np.isfinite(np.concatenate(state)).all():
            raise ValueError('odometry: expected finite numbers')
        frames = self.settings.world_frame, self.settings.command_frame
        return state_messages(*state, odometry.header.stamp, *frames)


ABOUT = 'Pass command/motor_speed on to Gazebo (command/motors), and its odometry back.'
main = partial(run, 'gazebo_bridge', GazeboBridge, ABOUT)
