#!/usr/bin/env python3
"""Rotor speeds to PX4: command/motor_speed becomes px4_msgs/ActuatorMotors.

PX4 takes a share of the greatest thrust for each motor, in offboard mode with direct_actuator set;
NaN stops a motor.  Its output x follows from the control c that it is sent by

    c = F x^2 + (1 - F) x,    F = THR_MDL_FAC

so PX4 models thrust as this function of x.  Two kinds of outputs are served:

- thrust (the default): THR_MDL_FAC was fitted to the motors, on a thrust stand.  What is sent is
  the share of thrust, (omega / omega_max)^2, and PX4 finds the output for it.
- speed: the output sets the speed, from --idle-speed at x = 0 to omega_max at x = 1, as in Gazebo
  (SIM_GZ_EC_MIN and _MAX) and with governed speed controllers.  What is sent is the c whose x is
  the speed wanted; --thrust-factor is THR_MDL_FAC as it is set there.

The motors' numbers are PX4's own: px4_parameters.py prints the vehicle's geometry as PX4 wants it.

Direct actuators bypass PX4's position, attitude and rate loops: nothing but your controller
stabilises the vehicle.  Only PX4's fail-safes remain.  With --rate-loop the speeds answer
PX4's own rate loop instead (px4_setpoints.py), and PX4 stabilises the vehicle.

    MicroXRCEAgent udp4 -p 8888
    python3 examples/px4_actuator_motors.py --vehicle my.yaml --order 2,4,1,3
"""

from __future__ import annotations

import argparse
import signal
import sys
import time
from collections.abc import Sequence

import numpy as np

from ca_ros import ParameterError, Vehicle

CONTROLS = 12
"""ActuatorMotors.NUM_CONTROLS."""

FRESH = 0.2
"""Greatest age of a command for which offboard control is reported to PX4 as alive [s]."""


def thrust_controls(speeds: np.ndarray, speed_max: np.ndarray) -> np.ndarray:
    """Return the shares of the greatest thrusts (n,) that speeds (n,) [rad/s] give."""
    return (_within(speeds, speed_max) / speed_max) ** 2


def speed_controls(
    speeds: np.ndarray, speed_max: np.ndarray, idle_speed: float, thrust_factor: float
) -> np.ndarray:
    """Return the controls (n,) for outputs that set a speed.

    Parameters
    ----------
    speeds, speed_max : (n,) arrays
        [rad/s]
    idle_speed : float
        Speed of a running motor at the least output [rad/s].
    thrust_factor : float
        THR_MDL_FAC.

    Raises
    ------
    ValueError
        If a speed is beyond `speed_max`, or below `idle_speed` but not zero.
    """
    slow = (speeds < idle_speed) & (speeds != 0.0)
    if slow.any():
        raise ValueError(
            f'{speeds[slow][0]:g} rad/s is below the idle speed, {idle_speed:g} rad/s'
        )
    output = (_within(speeds, speed_max) - idle_speed) / (speed_max - idle_speed)
    return thrust_factor * output**2 + (1.0 - thrust_factor) * output


def _within(speeds: np.ndarray, speed_max: np.ndarray) -> np.ndarray:
    if speeds.shape != speed_max.shape:
        raise ValueError(f'{len(speeds)} rotor speeds for {len(speed_max)} rotors')
    if not np.all((speeds >= 0.0) & (speeds <= speed_max)):
        raise ValueError(f'rotor speeds out of bounds: {speeds} rad/s')
    return speeds


def fields(controls: np.ndarray, speeds: np.ndarray, order: Sequence[int]) -> np.ndarray:
    """Return ActuatorMotors.control (12,), float32.

    Parameters
    ----------
    controls : (n,) array
        In the order of the vehicle's parameter file.
    speeds : (n,) array
        [rad/s]
    order : (n,) sequence
        For each of PX4's motors the rotor that it is, from 1 on; empty if the orders are the same.

    Returns
    -------
    (12,) array
        NaN, which stops a motor, for rotors at speed zero and for motors that are not there.
    """
    rows = np.asarray(order or range(1, len(controls) + 1)) - 1
    message = np.full(CONTROLS, np.nan, dtype=np.float32)
    message[: len(rows)] = np.where(speeds == 0.0, np.nan, controls)[rows]
    return message


def rotors(text: str) -> list[int]:
    """Return the numbers in a list such as 3,1,2; each from 1 to its length occurs once."""
    words = text.split(',')
    numbers = [int(word) for word in words if word.strip().isdecimal()]
    if sorted(numbers) != list(range(1, len(words) + 1)):
        raise argparse.ArgumentTypeError(f'{text!r}: expected each rotor once, as in 3,1,2')
    return numbers


def parse(words: Sequence[str]) -> tuple[argparse.Namespace, Vehicle]:
    """Return the options and the vehicle; leave with one line if they are wrong."""
    parser = argparse.ArgumentParser(
        description='Pass rotor speeds (command/motor_speed) on to PX4, as '
        'px4_msgs/ActuatorMotors on fmu/in/actuator_motors, and keep its offboard mode alive '
        'while they come.',
        epilog='ROS arguments follow --ros-args, for instance: --ros-args -r __ns:=/uav1',
    )
    parser.add_argument('--vehicle', required=True, help='a shipped vehicle or a parameter file')
    parser.add_argument(
        '--order',
        type=rotors,
        default=[],
        metavar='A,B,..',
        help="the rotor, from 1 on, that each of PX4's motors is (default: the same order)",
    )
    parser.add_argument(
        '--outputs',
        choices=('thrust', 'speed'),
        default='thrust',
        help='what THR_MDL_FAC stands for there: the thrust of the motors, as fitted (default), '
        'or outputs that set a speed',
    )
    parser.add_argument(
        '--idle-speed',
        type=float,
        default=0.0,
        metavar='W',
        help='of --outputs speed: the speed at the least output [rad/s] (default: 0)',
    )
    parser.add_argument(
        '--thrust-factor',
        type=float,
        default=0.0,
        metavar='F',
        help="of --outputs speed: THR_MDL_FAC, in [0, 1] (default: 0, PX4's own)",
    )
    parser.add_argument(
        '--rate-loop',
        action='store_true',
        help="do not keep offboard mode alive: the commands answer the set-points of PX4's own "
        'rate loop (px4_setpoints.py)',
    )
    options = parser.parse_args(words)
    try:
        vehicle = Vehicle.load(options.vehicle)
    except ParameterError as error:
        sys.exit(f'px4_actuator_motors: {error}')
    if vehicle.n > CONTROLS:
        sys.exit(f'px4_actuator_motors: {vehicle.n} rotors, but PX4 has {CONTROLS} motors at most')
    if (vehicle.speed_min < 0.0).any():
        words = 'rotors reverse (rotors.speed_min < 0), which is not supported'
        sys.exit(f'px4_actuator_motors: {words}')
    if options.order and len(options.order) != vehicle.n:
        parser.error(f'--order: expected {vehicle.n} rotors, got {len(options.order)}')
    if not 0.0 <= options.thrust_factor <= 1.0:
        parser.error(f'--thrust-factor: expected 0 to 1, got {options.thrust_factor:g}')
    if not 0.0 <= options.idle_speed < vehicle.speed_max.min():
        parser.error(f'--idle-speed: expected 0 to the greatest speed, got {options.idle_speed:g}')
    if options.outputs == 'speed' and options.idle_speed > vehicle.speed_min.min():
        parser.error('--idle-speed: is above rotors.speed_min: raise that in the parameter file')
    return options, vehicle


def main() -> None:
    """Run the node."""
    words = sys.argv[1:]
    own = words[: words.index('--ros-args')] if '--ros-args' in words else words
    options, vehicle = parse(own)
    try:
        import rclpy
        from px4_msgs.msg import ActuatorMotors, OffboardControlMode
        from rclpy.signals import SignalHandlerOptions
        from rclpy.utilities import try_shutdown
        from std_msgs.msg import Float64MultiArray

        from ca_ros.nodes.messages import speeds_stamp
        from ca_ros.nodes.qos import COMMAND, requested
    except ImportError as error:
        sys.exit(
            f'px4_actuator_motors: {error}: needs a sourced ROS 2 Jazzy with ca_ros and, built '
            'from the branch of your PX4, github.com/PX4/px4_msgs'
        )
    stop: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda received, _: stop.append(received))
    # rclpy's own handlers sometimes leave an idle node hanging.
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    node = rclpy.create_node('px4_actuator_motors')
    motors = node.create_publisher(ActuatorMotors, 'fmu/in/actuator_motors', COMMAND)
    alive = node.create_publisher(OffboardControlMode, 'fmu/in/offboard_control_mode', COMMAND)
    last = -float('inf')

    def now() -> int:
        return node.get_clock().now().nanoseconds // 1000

    def forward(command: Float64MultiArray) -> None:
        nonlocal last
        speeds = np.array(command.data)
        try:
            if options.outputs == 'thrust':
                controls = thrust_controls(speeds, vehicle.speed_max)
            else:
                controls = speed_controls(
                    speeds, vehicle.speed_max, options.idle_speed, options.thrust_factor
                )
        except ValueError as error:
            node.get_logger().warning(f'dropped: {error}', throttle_duration_sec=1.0)
            return
        stamp = speeds_stamp(command)
        if stamp is not None:
            # Without one it is the timeout action, which must not hold off the fail-safe.
            last = time.monotonic()
        motors.publish(
            ActuatorMotors(
                timestamp=now(),
                timestamp_sample=(stamp or 0) // 1000,
                control=fields(controls, speeds, options.order),
            )
        )

    def beat() -> None:
        # PX4 leaves offboard mode by its own fail-safe when this ceases.
        if not options.rate_loop and time.monotonic() - last <= FRESH:
            alive.publish(OffboardControlMode(timestamp=now(), direct_actuator=True))

    node.create_subscription(
        Float64MultiArray, 'command/motor_speed', forward, requested('realtime')
    )
    node.create_timer(0.1, beat)
    while not stop:
        rclpy.spin_once(node, timeout_sec=0.1)
    node.destroy_node()
    try_shutdown()


if __name__ == '__main__':
    main()
