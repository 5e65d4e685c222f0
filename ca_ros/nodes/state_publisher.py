"""The publishers of a simulated state: pose, velocity, and on request odometry and the clock."""

from __future__ import annotations

from rosgraph_msgs.msg import Clock

from ca_ros.arrays import Array
from ca_ros.flight.rigid_body import ANGULAR_VELOCITY, ATTITUDE, POSITION, velocity_in_body
from ca_ros.nodes import topics
from ca_ros.nodes.messages import odometry_message, stamp, state_messages
from ca_ros.nodes.vehicle_node import VehicleNode


class StatePublisher:
    """Publishes the states of a vehicle.

    Parameters
    ----------
    node : VehicleNode
        Its settings name the frames and the optional topics.
    """

    def __init__(self, node: VehicleNode) -> None:
        self._node = node
        self._pose, self._velocity = map(node.publish_stream, (topics.POSE, topics.VELOCITY))
        settings = node.settings.simulator
        self._odometry, self._clock = (
            node.publish_stream(topic) if enabled else None
            for topic, enabled in (
                (topics.ODOMETRY, settings.publish_odometry),
                (topics.CLOCK, settings.publish_clock),
            )
        )

    def publish(self, state: Array, time: int) -> None:
        """Publish a state (13,) of a time [ns]."""
        pose, velocity = state_messages(
            state[POSITION],
            state[ATTITUDE],
            velocity_in_body(state),
            state[ANGULAR_VELOCITY],
            stamp(time),
            self._node.settings.world_frame,
            self._node.settings.command_frame,
        )
        # The clock comes first: nodes that use it must not see stamps of the future.
        if self._clock is not None:
            self._clock.publish(Clock(clock=pose.header.stamp))
        self._pose.publish(pose)
        self._velocity.publish(velocity)
        if self._odometry is not None:
            self._odometry.publish(odometry_message(pose, velocity))
