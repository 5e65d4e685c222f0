#!/usr/bin/env python3
"""PX4's rate loop to the allocator: its thrust and torque set-points become command/wrench.

PX4 normalises its set-points.  A thrust of -1 along z asks all motors for their greatest thrust.
Roll and pitch share one scale, with which a torque of 1 changes the motors by 1/sqrt(2) (root mean
square over all of them); a yaw of 1 changes the most affected motor by 1.  `units` derives these
scales from the vehicle as PX4 does from CA_ROTOR* (ControlAllocationPseudoInverse.cpp), so the
gains of PX4's rate loop remain right, and without saturation PX4's own allocator and ca_ros give
the same motors.

This replaces PX4's allocator in simulation and on the bench, where the set-points can take the way
over DDS.  docs/px4.md names what PX4 must send for it, and what must be stopped there.

    python3 examples/px4_setpoints.py --vehicle my.yaml
    ros2 run ca_ros allocator --vehicle my.yaml
    python3 examples/px4_actuator_motors.py --vehicle my.yaml --rate-loop
"""

from __future__ import annotations

import argparse
import signal
import sys
from collections.abc import Sequence

import numpy as np

from ca_ros import Vehicle
from ca_ros.arguments import split
from ca_ros.arrays import Array
from ca_ros.vehicle.effectiveness import rotor_wrenches

FLIP = np.array([1.0, -1.0, -1.0, 1.0, -1.0, -1.0])
"""From forward-right-down to forward-left-up, force before torque."""

CT, SMALL = 6.5, 1e-3
"""PX4's default of CA_ROTOR*_CT, and the greatest share of a motor that it takes as zero."""

APART = 20_000
"""Greatest difference of the samples of a thrust and a torque that are used together [us]."""


def units(vehicle: Vehicle) -> Array:
    """Return what set-points of 1 stand for (6,): force [N] before torque [N m], as magnitudes.

    Raises
    ------
    ValueError
        If the rotors cannot control them.
    """
    full = vehicle.thrust_coefficient * vehicle.speed_max**2
    shares = np.linalg.pinv(FLIP[:, None] * rotor_wrenches(vehicle) * (CT * full / full.max())).T

    def mean(row: Array, small: float) -> float:
        return float(row[row > small].mean()) if (row > small).any() else 0.0

    x, y, z = (mean(np.abs(row), float(np.finfo(np.float32).eps)) for row in shares[:3])
    level = max(np.sqrt(2.0 * mean(row**2, SMALL**2)) for row in shares[3:5])
    scales = np.array([x or z, y or z, z, level, level, shares[5].max()])
    if not (scales > 0.0).all():
        raise ValueError('the rotors cannot control thrust, roll or pitch, and yaw')
    return np.asarray(full.max() / CT / scales)


def wrench(thrust: Sequence[float], torque: Sequence[float], unit: Array) -> Array:
    """Return a wrench (6,), force before torque [N, N m], forward-left-up.

    Parameters
    ----------
    thrust, torque : (3,) sequences
        VehicleThrustSetpoint.xyz and VehicleTorqueSetpoint.xyz: normalised, forward-right-down.
    unit : (6,) array
        As `units` returns it.

    Raises
    ------
    ValueError
        If a number is not finite.
    """
    given = np.array([*thrust, *torque], dtype=float)
    if not np.isfinite(given).all():
        raise ValueError(f'set-points {given}: expected finite numbers')
    return FLIP * unit * given


def main() -> None:
    """Run the node."""
    parser = argparse.ArgumentParser(
        description="Pass the set-points of PX4's rate loop (px4_msgs/VehicleThrustSetpoint and "
        'VehicleTorqueSetpoint on fmu/out/) on to the allocator, as command/wrench.',
        epilog='ROS arguments follow --ros-args, for instance: --ros-args -r __ns:=/uav1',
    )
    parser.add_argument('--vehicle', required=True, help='a shipped vehicle or a parameter file')
    parser.add_argument(
        '--body-frame', default='base_link', help='frame_id of wrenches (default: base_link)'
    )
    own, _ = split(sys.argv[1:])
    options = parser.parse_args(own)
    try:
        unit = units(Vehicle.load(options.vehicle))
    except ValueError as error:
        sys.exit(f'px4_setpoints: {error}')
    try:
        import rclpy
        from geometry_msgs.msg import WrenchStamped
        from px4_msgs.msg import VehicleThrustSetpoint, VehicleTorqueSetpoint
        from rclpy.signals import SignalHandlerOptions
        from rclpy.utilities import try_shutdown
        from std_msgs.msg import Header

        from ca_ros.nodes.messages import stamp, wrench_message
        from ca_ros.nodes.qos import COMMAND, requested
    except ImportError as error:
        sys.exit(
            f'px4_setpoints: {error}: needs a sourced ROS 2 Jazzy with ca_ros and, built from the '
            'branch of your PX4, github.com/PX4/px4_msgs'
        )
    stop: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda received, _: stop.append(received))
    # rclpy's own handlers sometimes leave an idle node hanging.
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    node = rclpy.create_node('px4_setpoints')
    publisher = node.create_publisher(WrenchStamped, 'command/wrench', COMMAND)
    thrusts: list[VehicleThrustSetpoint] = []

    def forward(torque: VehicleTorqueSetpoint) -> None:
        time = torque.timestamp_sample
        try:
            if not thrusts or abs(thrusts[0].timestamp_sample - time) > APART:
                raise ValueError(f'a torque without a thrust within {APART / 1000:g} ms')
            found = wrench(thrusts[0].xyz, torque.xyz, unit)
        except ValueError as error:
            node.get_logger().warning(f'dropped: {error}', throttle_duration_sec=1.0)
            return
        header = Header(stamp=stamp(time * 1000), frame_id=options.body_frame)
        publisher.publish(wrench_message(found, header))

    def keep(thrust: VehicleThrustSetpoint) -> None:
        thrusts[:] = [thrust]

    # As in PX4, each torque is allocated, with the newest thrust.
    qos = requested('realtime')
    for kind, name, receive in (
        (VehicleThrustSetpoint, 'fmu/out/vehicle_thrust_setpoint', keep),
        (VehicleTorqueSetpoint, 'fmu/out/vehicle_torque_setpoint', forward),
    ):
        node.create_subscription(kind, name, receive, qos)
    while not stop:
        rclpy.spin_once(node, timeout_sec=0.1)
    node.destroy_node()
    try_shutdown()


if __name__ == '__main__':
    main()
