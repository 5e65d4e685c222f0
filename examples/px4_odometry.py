#!/usr/bin/env python3
"""PX4's state to the controller: px4_msgs/VehicleOdometry becomes a pose and a body velocity.

PX4's world is north-east-down and its body forward-right-down.  Ours are east-north-up and
forward-left-up (REP 103), so with P and F below:

    position   P p            attitude   P R F        P = [0 1 0; 1 0 0; 0 0 -1]
    velocity   (P R F)^T P v  body rates F w          F = diag(1, -1, -1)

The controller of ca_ros then takes PX4's estimate in place of the simulator's state:

    MicroXRCEAgent udp4 -p 8888
    python3 examples/px4_odometry.py
    ros2 run ca_ros controller --vehicle my.yaml
"""

from __future__ import annotations

import argparse
import signal
import sys
from collections.abc import Sequence
from typing import Any

import numpy as np

from ca_ros.arguments import split
from ca_ros.arrays import Array
from ca_ros.flight.rigid_body import rotation_matrix

NED, BODY_FRD = 1, 3
"""VehicleOdometry.POSE_FRAME_NED and VELOCITY_FRAME_NED, and VELOCITY_FRAME_BODY_FRD."""


def world(ned: Sequence[float]) -> Array:
    """Return the east-north-up components (3,) of a vector north-east-down."""
    north, east, down = ned
    return np.array([east, north, -down], dtype=float)


def body(frd: Sequence[float]) -> Array:
    """Return the forward-left-up components (3,) of a vector forward-right-down."""
    forward, right, down = frd
    return np.array([forward, -right, -down], dtype=float)


def attitude(q: Sequence[float]) -> Array:
    """Return the attitude x, y, z, w of the body forward-left-up in the world east-north-up.

    Parameters
    ----------
    q : (4,) sequence
        VehicleOdometry.q: w, x, y, z of the body forward-right-down in the world north-east-down.
    """
    w, x, y, z = np.asarray(q, dtype=float) / np.linalg.norm(q)
    return np.sqrt(0.5) * np.array([x + y, x - y, w - z, w + z])


def state(message: Any) -> tuple[Array, Array, Array, Array]:
    """Return the state in a VehicleOdometry.

    Returns
    -------
    position : (3,) array
        East-north-up [m].
    attitude : (4,) array
        x, y, z, w.
    velocity, angular_velocity : (3,) arrays
        In the body frame, forward-left-up [m/s, rad/s].

    Raises
    ------
    ValueError
        If a value is unknown (NaN), or a frame is another one.
    """
    if message.pose_frame != NED:
        raise ValueError(f'pose_frame is {message.pose_frame}, expected {NED} (north-east-down)')
    if message.velocity_frame not in (NED, BODY_FRD):
        raise ValueError(
            f'velocity_frame is {message.velocity_frame}, expected {NED} (north-east-down) or '
            f'{BODY_FRD} (body, forward-right-down)'
        )
    for name in ('position', 'q', 'velocity', 'angular_velocity'):
        if not np.isfinite(getattr(message, name)).all():
            raise ValueError(f'{name} is unknown')
    rotation = attitude(message.q)
    if message.velocity_frame == NED:
        velocity = rotation_matrix(rotation).T @ world(message.velocity)
    else:
        velocity = body(message.velocity)
    return world(message.position), rotation, velocity, body(message.angular_velocity)


def main() -> None:
    """Run the node."""
    parser = argparse.ArgumentParser(
        description="Pass PX4's state on to the controller: px4_msgs/VehicleOdometry on "
        'fmu/out/vehicle_odometry becomes local_position/pose and local_position/velocity_body.',
        epilog='ROS arguments follow --ros-args, for instance: --ros-args -r __ns:=/uav1',
    )
    parser.add_argument('--world-frame', default='map', help='frame_id of poses (default: map)')
    parser.add_argument(
        '--body-frame', default='base_link', help='frame_id of velocities (default: base_link)'
    )
    own, _ = split(sys.argv[1:])
    options = parser.parse_args(own)
    try:
        import rclpy
        from geometry_msgs.msg import PoseStamped, TwistStamped
        from px4_msgs.msg import VehicleOdometry
        from rclpy.signals import SignalHandlerOptions
        from rclpy.utilities import try_shutdown

        from ca_ros.nodes.messages import stamp, state_messages
        from ca_ros.nodes.qos import COMMAND, requested
    except ImportError as error:
        sys.exit(
            f'px4_odometry: {error}: needs a sourced ROS 2 Jazzy with ca_ros and, built from the '
            'branch of your PX4, github.com/PX4/px4_msgs'
        )
    stop: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda received, _: stop.append(received))
    # rclpy's own handlers sometimes leave an idle node hanging.
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    node = rclpy.create_node('px4_odometry')
    poses = node.create_publisher(PoseStamped, 'local_position/pose', COMMAND)
    velocities = node.create_publisher(TwistStamped, 'local_position/velocity_body', COMMAND)

    def forward(message: VehicleOdometry) -> None:
        try:
            found = state(message)
        except ValueError as error:
            node.get_logger().warning(f'dropped: {error}', throttle_duration_sec=1.0)
            return
        # The agent has added the difference of the clocks.
        time = stamp(message.timestamp_sample * 1000)
        pose, twist = state_messages(*found, time, options.world_frame, options.body_frame)
        poses.publish(pose)
        velocities.publish(twist)

    node.create_subscription(
        VehicleOdometry, 'fmu/out/vehicle_odometry', forward, requested('realtime')
    )
    while not stop:
        rclpy.spin_once(node, timeout_sec=0.1)
    node.destroy_node()
    try_shutdown()


if __name__ == '__main__':
    main()
